#include "tools/command_line.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "engine/ingest/size_file.h"
#include "engine/plan/option_table.h"
#include "engine/shared/closest_word.h"
#include "engine/shared/standard_input.h"
#include "tools/arguments.h"
#include "tools/tell_user.h"

namespace locvol {
namespace {

// What is said of the first word that is neither a command nor an option of the one that was typed.
// Empty: it is not that.
std::string unknown_word_text(const CLI::App& app) {
  const auto typed = app.get_subcommands();
  const CLI::App& command = typed.empty() ? app : *typed.front();
  const std::vector<std::string> words = command.remaining();
  std::vector<std::string> known;
  std::string what;
  if (typed.empty() && !words.empty() && !words.front().starts_with('-')) {
    what = fmt::format("there is no command '{}'", words.front());
    for (const CLI::App* subcommand : app.get_subcommands([](const CLI::App*) { return true; }))
      known.push_back(subcommand->get_name());
  } else if (!words.empty() && words.front().starts_with("--")) {
    what = fmt::format("there is no option '{}'", words.front());
    for (const CLI::Option* option : command.get_options())
      for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  } else {
    return {};
  }
  const std::string meant = closest_word(words.front().substr(0, words.front().find('=')), known);
  return meant.empty() ? what : fmt::format("{}; is '{}' meant?", what, meant);
}

using Text = const std::string&;
void parse(Text text, const OptionText&, Size& value) { value = parse_size(text); }
void parse(Text text, const OptionText&, std::optional<Size>& value) { value = parse_weld(text); }
void parse(Text text, const OptionText&, Initialization& value) { value = parse_init(text); }
void parse(Text text, const OptionText&, InsideRule& value) { value = parse_inside(text); }
void parse(Text text, const OptionText& option, std::uint64_t& value) {
  value = option.range.least > 0 ? parse_count(text) : parse_seed(text);
}
void parse(Text text, const OptionText& option, double& value) {
  value = parse_number(text, option);
}
void parse(Text text, const OptionText& option, std::optional<double>& value) {
  value = parse_number(text, option);
}

// See add_sizes() and add_sharp().
void parse(Text, const OptionText&, std::vector<SizedShape>&) {}
void parse(Text, const OptionText&, std::vector<SizedPart>&) {}
void parse(Text, const OptionText&, std::filesystem::path&) {}
// See add_bodies().
void parse(Text, const OptionText&, bool&) {}
void parse(Text, const OptionText&, std::vector<std::string>&) {}

// A flag for a value that turns something off.
void add_no_sharp(CLI::App& app, MeshOptions& options) {
  app.add_flag_callback(
         "--no-sharp", [&options] { options.sharp_angle = 0; },
         "Keep no sharp edges, and part no sheets there: as --sharp-angle 0")
      ->excludes(app.get_option("--sharp-angle"));
}

// A flag for a value that --inside has.
void add_wrap(CLI::App& app, MeshOptions& options) {
  app.add_flag_callback(
         "--wrap", [&options] { options.inside = InsideRule::kWrap; },
         "Mesh what a new surface encloses that wraps all triangles: as --inside wrap")
      ->excludes(app.get_option("--inside"));
}

// A file that is read once the surface is known.
void add_sharp(CLI::App& app, MeshOptions& options) {
  app.add_option(
         "--sharp", options.sharp_polylines,
         "Polylines along edges of the surface that are sharp whatever their angle: in each "
         "line of the file the number of points, and their coordinates (CGAL's "
         ".polylines.txt)")
      ->type_name("FILE");
}

void add_bodies(CLI::App& app, MeshOptions& options) {
  app.add_flag("--bodies", options.has_bodies,
               "Each group of the surface that is closed by itself is a body; without groups, each "
               "shell is. What lies in another body is cut out of it");
  app.add_option("--void", options.voids,
                 "This body is none, but a cavity of the one that it lies in. May be repeated")
      ->type_name("NAME")
      ->allow_extra_args(false);
}

void add_surface_only(CLI::App& app, MeshOptions& options) {
  app.add_flag("--surface-only", options.is_surface_only,
               "Mesh the surface alone: triangles, and no cells. All points lie on the surface");
}

// Those of the table that have help.
void add_options(CLI::App& app, MeshOptions& options, OptionGroup group) {
  for_each_given_option([&](const auto& option) {
    if (option.group != group || *option.help.text == '\0') return;
    auto& target = options.*option.given;
    const auto parse_option = [&option, &target](Text text) {
      auto value = target;
      parse(text, option, value);
      return value;
    };
    add_parsed(app, option.name.typed, parse_option, target, filled(option.help.text, option))
        ->type_name(option.help.value);
  });
}

}  // namespace

CLI::Option* add_output(CLI::App& app, std::filesystem::path& output,
                        std::vector<std::string_view> extensions) {
  const auto parse = [extensions](const std::string& text) {
    return parse_output(text, extensions);
  };
  return add_parsed(app, "-o,--output", parse, output,
                    fmt::format("File to write ({})", fmt::join(extensions, ", ")))
      ->type_name("FILE");
}

CLI::Option* add_format(CLI::App& app, OutputOptions& options, const std::string& otherwise) {
  return add_parsed(app, "--format", parse_format, options.format,
                    fmt::format("Format of the file (default: {}); `locvol export --help` lists "
                                "all",
                                otherwise))
      ->type_name("NAME");
}

CLI::Option* add_cell_data(CLI::App& app, OutputOptions& options) {
  return add_parsed(app, "--cell-data", parse_cell_data, options.has_quality,
                    "Write with the cells (vtu, vtu-zlib, vtkhdf): leaf, or also their quality: "
                    "radius-edge ratio and least dihedral angle (default: leaf)")
      ->type_name("leaf|quality");
}

void check_output(const OutputOptions& options) {
  const auto check = [&](const char* option, const auto& require) {
    try {
      require(options);
    } catch (const InputError& error) {
      throw CLI::ValidationError(option, error.what());
    }
  };
  check("--cell-data", require_cell_data);
  check("--order", require_order);
}

CLI::Option* add_boundary(CLI::App& app, OutputOptions& options) {
  return app.add_flag("--boundary", options.has_boundary,
                      "Write the boundary's triangles with the cells, and of which sheet each is "
                      "(vtu, vtu-zlib, vtkhdf, tetgen; the other formats always do)");
}

CLI::Option* add_order(CLI::App& app, OutputOptions& options) {
  return app
      .add_option(
          "--order", options.order,
          "2: cells have a node in the middle of each edge, too; those of boundary edges are "
          "on the surface (default: 1)")
      ->check(CLI::Range(1, 2))
      ->type_name("1|2");
}

CLI::Option* add_split_interfaces(CLI::App& app, OutputOptions& options) {
  return app.add_flag("--split-interfaces", options.splits_interfaces,
                      "Of several bodies, each has vertices of its own, and what lies between two "
                      "is there once for "
                      "each (for contact)");
}

CLI::Option* add_faces(CLI::App& app, OutputOptions& options) {
  return app.add_flag(
      "--faces", options.has_faces,
      "Write OUTPUT.faces.json, too: name, area, place and shape of each sheet, for "
      "programs that look for one");
}

CLI::Option* add_mesh_output(CLI::App& app, std::filesystem::path& output, OutputOptions& options,
                             const std::function<std::filesystem::path()>& choose) {
  CLI::Option* file =
      app.add_option("-o,--output", output,
                     choose
                         ? "File to write (default: called as the surface, a .vtu in the current "
                           "directory)"
                         : "File to write")
          ->type_name("FILE");
  CLI::Option* format = add_format(app, options, "by its extension")->needs(file);
  add_cell_data(app, options)->needs(file);
  add_boundary(app, options)->needs(file);
  add_order(app, options)->needs(file);
  add_split_interfaces(app, options)->needs(file);
  add_faces(app, options)->needs(file);
  app.final_callback([&output, &options, file, format, choose] {
    if (file->count() == 0 && choose) output = choose();
    if (file->count() == 0) return;
    if (output.empty()) throw CLI::ValidationError("-o", "is empty: give the name of a file");
    try {
      if (format->count() == 0) options.format = format_meant_by(output);
    } catch (const InputError& error) {
      throw CLI::ValidationError("-o", fmt::format("{}, or --format names one", error.what()));
    }
    check_output(options);
  });
  return file;
}

std::string format_list() {
  std::string list = "Formats, by name and by extension:\n";
  for (const FormatInfo& info : mesh_formats())
    list += fmt::format("  {:<9} {:<14} {}\n", info.name, fmt::join(info.extensions, " "),
                        info.description);
  return list;
}

void add_store(CLI::App& app, std::filesystem::path& store) {
  app.add_option("DIR", store, "Store of a run")->type_name("")->required();
}

void add_json(CLI::App& app, bool& is_json) {
  app.add_flag("--json", is_json, "Print the result as JSON");
}

void add_memory(CLI::App& app, std::uint64_t& memory_bytes) {
  add_parsed(app, "-m,--memory", parse_memory, memory_bytes,
             "Cap on the memory of the process (512M, 2G, 25% of what is free; default: 50%); the "
             "mesh is the same under any")
      ->type_name("SIZE");
}

void add_threads(CLI::App& app, int& num_threads) {
  add_parsed(app, "-t,--threads", parse_threads, num_threads,
             "Threads to work with (default: as many as the process may use); the mesh is the same "
             "with any number")
      ->type_name("N");
}

void add_quiet(CLI::App& app, bool& is_quiet) {
  app.add_flag("-q,--quiet", is_quiet, "No progress and no notes on stderr");
}

void add_sizes(CLI::App& app, MeshOptions& options) {
  add_options(app, options, OptionGroup::kSizes);
  const auto take_sizes = [&options](const std::vector<std::string>& files) {
    for (const std::filesystem::path file : files) {
      if (file.extension() != ".vti") {
        GivenSizes read = read_size_file(file);
        std::ranges::move(read.shapes, std::back_inserter(options.shapes));
        std::ranges::move(read.sheets, std::back_inserter(options.sheets));
        std::ranges::move(read.bodies, std::back_inserter(options.bodies));
      } else if (!std::exchange(options.size_image, file).empty()) {
        throw CLI::ValidationError("--sizes: one image of sizes at most");
      }
    }
    return true;
  };
  app.add_option(
         "--sizes", take_sizes,
         fmt::format(
             "Points, balls, boxes, lines, sheets and bodies with sizes, or a VTK image of sizes "
             "(.vti), where cells are to be smaller; around them they grow by {} of "
             "the way, to --size, unless --growth is given. May be repeated",
             kDefaultGrowth))
      ->type_name("FILE")
      ->take_all();
  add_options(app, options, OptionGroup::kSurface);
  add_no_sharp(app, options);
  add_wrap(app, options);
  add_sharp(app, options);
  add_bodies(app, options);
  add_surface_only(app, options);
}

void add_surfaces(CLI::App& app, std::filesystem::path& first,
                  std::vector<std::filesystem::path>& others) {
  const auto take = [&first, &others](const std::vector<std::string>& files) {
    first = files.front();
    others.assign(files.begin() + 1, files.end());
  };
  app.add_option_function<std::vector<std::string>>(
         "SURFACE", take, std::string(kSurfaceHelp) + "; of several, each is a body")
      ->type_name("")
      ->required();
}

CLI::Option* add_leaf(CLI::App& app, std::optional<LeafSpec>& leaf,
                      const std::string& description) {
  return add_parsed(app, "--leaf", parse_leaf, leaf,
                    description + ", by its key or a point in it (x,y,z)")
      ->type_name("KEY");
}

CLI::Option* add_vtu(CLI::App& app, std::filesystem::path& file, const std::string& description) {
  const auto parse = [](const std::string& text) { return parse_output(text, {".vtu"}); };
  return add_parsed(app, "--vtu", parse, file, description)->type_name("FILE");
}

CLI::Option* add_limit(CLI::App& app, std::optional<std::uint64_t>& limit,
                       const std::string& description) {
  return add_parsed(app, "--limit", parse_count, limit, description)->type_name("N");
}

// Called as the surface, in the current directory.
std::filesystem::path chosen_output(const std::filesystem::path& surface) {
  if (surface == kFromStandardInput)
    throw CLI::ValidationError("-o", "is needed where the surface comes through standard input");
  std::filesystem::path name = surface.filename();
  if (name.extension() == ".gz") name = name.stem();
  return name.replace_extension(".vtu");
}

CLI::App* declare_mesh(CLI::App& app, MeshCommand& command) {
  CLI::App* mesh = app.add_subcommand("mesh", "Mesh the volume inside a surface");
  MeshOptions& options = command.options;
  add_surfaces(*mesh, options.input, options.more_inputs);
  add_mesh_output(*mesh, command.control.output, command.control.output_options, [&command] {
    command.is_output_chosen = true;
    return chosen_output(command.options.input);
  });
  add_parsed(
      *mesh, "-s,--size", parse_size, command.size,
      fmt::format(
          "{}; default: one for about half a million cells, or more where thin walls take them",
          kSizeHelp))
      ->type_name("SIZE");
  add_sizes(*mesh, options);
  add_memory(*mesh, command.control.memory_bytes);
  add_threads(*mesh, command.control.num_threads);
  add_parsed(*mesh, "--store", parse_directory, options.store,
             "Directory of the run's store, kept at the end (default: OUTPUT.locvol, removed "
             "when the run is done with exit code 0)")
      ->type_name("DIR");
  mesh->add_flag("--keep-store", command.is_store_kept, "Keep the default store, too");
  add_options(*mesh, options, OptionGroup::kRun);
  mesh->add_flag("--force", options.is_forced, "Start anew over the store of another run");
  add_quiet(*mesh, command.is_quiet);
  add_json(*mesh, command.is_json);
  return mesh;
}

CLI::App* declare_resume(CLI::App& app, ResumeCommand& command) {
  CLI::App* resume = app.add_subcommand("resume", "Go on with an interrupted run; keeps its store");
  add_store(*resume, command.store);
  add_mesh_output(*resume, command.control.output, command.control.output_options);
  add_memory(*resume, command.control.memory_bytes);
  add_threads(*resume, command.control.num_threads);
  add_quiet(*resume, command.is_quiet);
  add_json(*resume, command.is_json);
  return resume;
}

CLI::App* declare_export(CLI::App& app, ExportCommand& command) {
  CLI::App* export_app = app.add_subcommand("export", "Write the mesh of a finished run");
  add_store(*export_app, command.store);
  add_mesh_output(*export_app, command.output, command.output_options)->required();
  add_memory(*export_app, command.memory_bytes);
  add_threads(*export_app, command.num_threads);
  export_app->footer(format_list());
  add_quiet(*export_app, command.is_quiet);
  add_json(*export_app, command.is_json);
  return export_app;
}

CLI::App* declare_report(CLI::App& app, ReportCommand& command) {
  CLI::App* report = app.add_subcommand(
      "report", "Write a page about a run, for any browser: a view of the mesh, figures, facts");
  add_store(*report, command.store);
  add_output(*report, command.output, {".html"})->required();
  add_parsed(*report, "--cells", parse_count, command.max_cells,
             "Put at most so many cells on the page: all of the mesh, or those at some planes "
             "(default: 2M)")
      ->type_name("N");
  add_json(*report, command.is_json);
  return report;
}

CLI::App* declare_audit(CLI::App& app, AuditCommand& command) {
  CLI::App* audit = app.add_subcommand(
      "audit",
      "Check the mesh of a finished run from its store alone; exit code 1 if it is not valid");
  add_store(*audit, command.store);
  add_parsed(*audit, "--one-in", parse_count, command.one_in,
             "Check one leaf in N, with all that lies near it (default: all)")
      ->type_name("N");
  add_quiet(*audit, command.is_quiet);
  add_json(*audit, command.is_json);
  return audit;
}

CLI::App* declare_inspect(CLI::App& app, InspectCommand& command) {
  CLI::App* inspect = app.add_subcommand(
      "inspect", "Look into a store, also while its run goes on; exit code 1 if it is damaged");
  add_store(*inspect, command.store);
  CLI::App* view = inspect->add_option_group("View", "Instead of the summary");
  view->add_flag("--leaves", command.lists_leaves, "List the leaves with state and counts");
  view->add_flag("--queue", command.lists_queue, "List the queue, in its order");
  view->add_flag("--unresolved", command.lists_unresolved, "List the unresolved sites");
  view->add_flag("--sizes", command.lists_sizes, "How many cells of which sizes are asked for");
  view->add_flag("--faces", command.lists_faces,
                 "Of a finished run, name, area, place and shape of each sheet");
  view->add_flag("--sharp", command.lists_creases,
                 "List the surface's creases, where it is sharp or its sheets meet");
  add_leaf(*view, command.leaf, "One leaf in full");
  view->require_option(0, 1);

  LeafListing& listing = command.listing;
  CLI::App* which = inspect->add_option_group("Leaves", "For --leaves, and --vtu without --leaf");
  const auto add_condition = [&listing](const std::vector<std::string>& texts) {
    try {
      for (const std::string& text : texts) listing.conditions.push_back(parse_condition(text));
    } catch (const std::invalid_argument& error) {
      throw CLI::ValidationError("--where", error.what());
    }
  };
  which
      ->add_option_function<std::vector<std::string>>(
          "--where", add_condition, "Only leaves with, say, 'visits>2'; may be repeated")
      ->type_name("CONDITION")
      ->allow_extra_args(false);
  add_parsed(*which, "--state", parse_state, listing.state, "Only leaves of this state")
      ->type_name("clean|waiting|unvisited|core|empty|damaged");
  add_parsed(*which, "--sort", parse_sort, listing.sort,
             "By key (ascending), or by level, visits, points, cells, triangles, insertions, "
             "deletions or unresolved (descending)")
      ->type_name("FIELD");
  which->add_flag("--reverse", listing.is_reversed, "In reverse order");
  add_limit(*inspect, listing.limit, "List at most so many");
  inspect->add_flag("--check", command.reads_all,
                    "Read every record, to find damage (summary, --leaves)");
  add_vtu(*inspect, command.vtu,
          "Write a file to look at instead: the leaves' boxes, with --leaf its cells, with --sizes "
          "the octree of sizes, with --sharp creases and corners");
  add_json(*inspect, command.is_json);
  inspect->final_callback([&command, which] {
    const bool is_of_leaves =
        command.lists_leaves ||
        (!command.vtu.empty() && !command.leaf && !command.lists_sizes && !command.lists_creases);
    if (which->count_all() > 0 && !is_of_leaves) {
      throw CLI::ValidationError(
          "--where, --state, --sort and --reverse go with --leaves, or with "
          "--vtu");
    }
    if (!command.vtu.empty() && (command.lists_queue || command.lists_unresolved))
      throw CLI::ValidationError(
          "--vtu goes with --leaf, with --leaves, with --sizes, with --sharp or alone");
  });
  return inspect;
}

int report_usage(const CLI::App& app, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return app.exit(error);  // --help and --version
  const std::string unknown = unknown_word_text(app);
  tell_user("{0}: error: {1}\n{0}: `{0} --help` and `{0} COMMAND --help` say more\n",
            app.get_name(), unknown.empty() ? error.what() : unknown);
  return kExitUsage;
}

}  // namespace locvol
