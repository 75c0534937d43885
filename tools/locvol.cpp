// The locvol command: declares what can be typed, calls the subcommand, and catches every error.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <exception>
#include <functional>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/ingest/size_file.h"
#include "tools/arguments.h"
#include "tools/commands.h"
#include "tools/generate.h"
#include "tools/reference.h"
#include "tools/stop_signal.h"

namespace locvol {
namespace {

constexpr const char* kDescription =
    "Meshes the volume inside a closed surface with tetrahedra, out of core.";
constexpr const char* kFooter =
    "Results go to stdout, progress to stderr.\n"
    "Exit codes: 0 done; 1 error (audit: not valid); 2 usage; 3 done, but with unresolved sites;\n"
    "4 interrupted, and resumable.";
constexpr const char* kSizeHelp =
    "Bound λ of circumradii and surface balls: a length (0.01), or a percentage of the smallest "
    "side of the bounding box (2%)";

using Subcommand = std::pair<CLI::App*, std::function<int()>>;

// The store of the command, for the message when no memory is left to make one.
std::array<char, 4096> store_name{};

void note_store(const std::filesystem::path& store) {
  std::snprintf(store_name.data(), store_name.size(), "%s", store.c_str());
}

// An option whose text `parse` makes into a value; its std::invalid_argument is a usage error.
template <typename Parse>
CLI::Option* add_parsed(CLI::App& app, const std::string& name, Parse parse, auto& target,
                        const std::string& description) {
  const auto assign = [name, parse, &target](const std::string& text) {
    try {
      target = parse(text);
    } catch (const std::invalid_argument& error) {
      throw CLI::ValidationError(name, error.what());
    }
  };
  return app.add_option_function<std::string>(name, assign, description);
}

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

void check_cell_data(const OutputOptions& options) {
  if (options.has_quality && !info_of(options.format).has_cell_data)
    throw CLI::ValidationError("--cell-data",
                               fmt::format("{} holds no cell data: write vtu, vtu-zlib or vtkhdf",
                                           info_of(options.format).name));
}

// The mesh's file; its format, by name or by extension; its cell data.
CLI::Option* add_mesh_output(CLI::App& app, std::filesystem::path& output, OutputOptions& options) {
  CLI::Option* file = app.add_option("-o,--output", output, "File to write")->type_name("FILE");
  CLI::Option* format = add_format(app, options, "by its extension")->needs(file);
  add_cell_data(app, options)->needs(file);
  app.final_callback([&output, &options, format] {
    if (output.empty()) return;
    try {
      if (format->count() == 0) options.format = format_meant_by(output);
    } catch (const InputError& error) {
      throw CLI::ValidationError("-o", fmt::format("{}, or --format names one", error.what()));
    }
    check_cell_data(options);
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
  add_parsed(app, "--growth", parse_growth, options.growth,
             fmt::format("Cells grow from the surface inwards, by so much of the way: 0 (the "
                         "default: one size) to {}",
                         kMostGrowth))
      ->type_name("G");
  add_parsed(app, "--max-size", parse_size, options.max_size,
             "What cells do not grow beyond, as --size")
      ->type_name("SIZE");
  add_parsed(app, "--per-circle", parse_number_of_edges, options.per_circle,
             "Smaller cells where the surface is curved: so many edges around a circle")
      ->type_name("N");
  add_parsed(app, "--deviation", parse_size, options.deviation,
             "Smaller cells where the boundary would be farther from the surface, as --size")
      ->type_name("LENGTH");
  add_parsed(app, "--layers", parse_layers, options.layers,
             "Smaller cells where a part is thin: so many across it")
      ->type_name("K");
  add_parsed(
      app, "--min-size", parse_size, options.min_size,
      fmt::format("What these three do not go below, as --size (default: {} λ)", kDefaultLeast))
      ->type_name("SIZE");
  const auto take_sizes = [&options](const std::vector<std::string>& files) {
    for (const std::filesystem::path file : files) {
      if (file.extension() != ".vti") {
        for (SizeRequest& request : read_size_requests(file))
          options.shapes.push_back(std::move(request));
      } else if (!std::exchange(options.size_image, file).empty()) {
        throw CLI::ValidationError("--sizes: one image of sizes at most");
      }
    }
    return true;
  };
  app.add_option(
         "--sizes", take_sizes,
         fmt::format("Points, balls, boxes and lines with sizes, or a VTK image of sizes "
                     "(.vti), where cells are to be smaller; around them they grow by {} of "
                     "the way, to --size, unless --growth is given. May be repeated",
                     kDefaultGrowth))
      ->type_name("FILE")
      ->take_all();
}

CLI::App* declare_mesh(CLI::App& app, MeshCommand& command) {
  CLI::App* mesh = app.add_subcommand("mesh", "Mesh the volume inside a surface");
  MeshOptions& options = command.options;
  mesh->add_option("SURFACE", options.input, "Closed surface: STL, OBJ, OFF or PLY")
      ->type_name("")
      ->required();
  add_mesh_output(*mesh, command.control.output, command.control.output_options)->required();
  add_parsed(*mesh, "-s,--size", parse_size, command.size,
             fmt::format("{}; default: one for about half a million cells", kSizeHelp))
      ->type_name("SIZE");
  add_sizes(*mesh, options);
  add_memory(*mesh, command.control.memory_bytes);
  add_threads(*mesh, command.control.num_threads);
  mesh->add_option("--store", options.store,
                   "Directory of the run's store, kept at the end (default: OUTPUT.locvol, removed "
                   "when the run is done with exit code 0)")
      ->type_name("DIR");
  mesh->add_flag("--keep-store", command.is_store_kept, "Keep the default store, too");
  add_parsed(*mesh, "--leaf-capacity", parse_count, options.leaf_capacity,
             "Split a leaf with more points than this")
      ->type_name("K");
  add_parsed(*mesh, "--init", parse_init, options.init,
             "First points: cover the domain, or few as in the paper (default: cover)")
      ->type_name("cover|paper");
  add_parsed(*mesh, "--seed", parse_seed, options.seed, "Seed of the surface sample (default: 0)")
      ->type_name("N");
  add_parsed(*mesh, "--min-dihedral", parse_angle, options.min_dihedral,
             fmt::format("Leave no cell with a dihedral angle below this, in degrees; 0: any "
                         "(default: {}; with --init paper 0)",
                         kDefaultMinDihedral))
      ->type_name("DEG");
  add_parsed(*mesh, "--spacing-floor", parse_fraction, options.spacing_floor,
             fmt::format("Insert no point closer than this to another, as a fraction of λ "
                         "(default: {})",
                         options.spacing_floor))
      ->type_name("F");
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

CLI::Option* add_leaf(CLI::App& app, auto& leaf, const std::string& description) {
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

CLI::App* declare_inspect(CLI::App& app, InspectCommand& command) {
  CLI::App* inspect = app.add_subcommand(
      "inspect", "Look into a store, also while its run goes on; exit code 1 if it is damaged");
  add_store(*inspect, command.store);
  CLI::App* view = inspect->add_option_group("View", "Instead of the summary");
  view->add_flag("--leaves", command.lists_leaves, "List the leaves with state and counts");
  view->add_flag("--queue", command.lists_queue, "List the queue, in its order");
  view->add_flag("--unresolved", command.lists_unresolved, "List the unresolved sites");
  view->add_flag("--sizes", command.lists_sizes, "How many cells of which sizes are asked for");
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
          "the octree of sizes");
  add_json(*inspect, command.is_json);
  inspect->final_callback([&command, which] {
    const bool is_of_leaves =
        command.lists_leaves || (!command.vtu.empty() && !command.leaf && !command.lists_sizes);
    if (which->count_all() > 0 && !is_of_leaves) {
      throw CLI::ValidationError(
          "--where, --state, --sort and --reverse go with --leaves, or with "
          "--vtu");
    }
    if (!command.vtu.empty() && (command.lists_queue || command.lists_unresolved))
      throw CLI::ValidationError("--vtu goes with --leaf, with --leaves, with --sizes or alone");
  });
  return inspect;
}

CLI::App* declare_replay(CLI::App& app, ReplayCommand& command) {
  CLI::App* replay = app.add_subcommand(
      "replay",
      "Repeat one leaf's visit step by step, changing nothing; exit code 1 if the leaf is clean "
      "and comes out otherwise");
  CLI::Option* store = replay->add_option("DIR", command.store, "Store of a run")->type_name("");
  CLI::Option* leaf = add_leaf(*replay, command.leaf, "The leaf");
  replay->add_option("--from", command.from, "Instead: a visit that --dump has written")
      ->type_name("FILE")
      ->excludes(store)
      ->excludes(leaf);
  add_parsed(
      *replay, "--dump", [](const std::string& text) { return parse_output(text, {".json"}); },
      command.dump, "Write all that the visit depends on to this file, to repeat it elsewhere")
      ->type_name("FILE");
  add_limit(*replay, command.limit, "List at most so many steps");
  add_vtu(*replay, command.vtu, "Write the resulting cells to this file, too");
  add_json(*replay, command.is_json);
  replay->final_callback([&command] {
    if (command.from.empty() && (command.store.empty() || !command.leaf))
      throw CLI::RequiredError("DIR and --leaf, or --from,");
  });
  return replay;
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
  add_quiet(*audit, command.is_quiet);
  add_json(*audit, command.is_json);
  return audit;
}

CLI::App* declare_info(CLI::App& app, InfoCommand& command) {
  CLI::App* info =
      app.add_subcommand("info", "Read a surface, say what it is and estimate what its mesh takes");
  info->add_option("SURFACE", command.surface, "Closed surface: STL, OBJ, OFF or PLY")
      ->type_name("")
      ->required();
  add_parsed(*info, "-s,--size", parse_size, command.size,
             "λ, as for mesh, to estimate what a run takes (default: as mesh chooses it)")
      ->type_name("SIZE");
  add_sizes(*info, command.options);
  add_format(*info, command.output_options, "vtu");
  add_cell_data(*info, command.output_options);
  info->final_callback([&command] { check_cell_data(command.output_options); });
  add_vtu(*info, command.vtu, "Find the sizes, and write their octree to this file, to look at");
  add_json(*info, command.is_json);
  return info;
}

std::string shape_list() {
  std::string list = "Shapes:\n";
  for (const ShapeInfo& shape : shapes()) {
    list += fmt::format("  {:<18} {}; at least {} triangles\n", shape.name, shape.description,
                        shape.min_triangles);
  }
  return list;
}

CLI::App* declare_generate(CLI::App& app, GenerateCommand& command) {
  CLI::App* generate = app.add_subcommand("generate", "Write a surface of a known shape");
  add_parsed(*generate, "SHAPE", parse_shape, command.shape, "Name of the shape")
      ->type_name("")
      ->required();
  add_output(*generate, command.output, {".stl", ".ply"})->required();
  add_parsed(*generate, "-n,--triangles", parse_count, command.num_triangles,
             "About how many (50000, 50k, 1.5M)")
      ->type_name("N")
      ->required();
  add_json(*generate, command.is_json);
  generate->footer(shape_list());
  return generate;
}

CLI::App* declare_reference(CLI::App& app, std::string& form) {
  CLI::App* command =
      app.add_subcommand("reference", "Print the manual page, or the completion script of a shell");
  const auto parse = [](const std::string& text) {
    if (!is_reference_form(text))
      throw std::invalid_argument(fmt::format("'{}' is none of man, bash, zsh, fish", text));
    return text;
  };
  add_parsed(*command, "FORM", parse, form, "What to print")
      ->type_name("man|bash|zsh|fish")
      ->required();
  return command;
}

int print_reference(const CLI::App& app, const std::string& form) {
  fmt::print("{}", reference(app, form));
  return kExitDone;
}

int report_usage(const CLI::App& app, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return app.exit(error);  // --help and --version
  fmt::print(stderr,
             "locvol: error: {}\nlocvol: `locvol --help` and `locvol COMMAND --help` say more\n",
             error.what());
  return kExitUsage;
}

int run(int argc, char** argv) {
  CLI::App app(kDescription, "locvol");
  app.footer(kFooter);
  app.set_version_flag("--version", "locvol " LOCVOL_VERSION);
  app.require_subcommand(1);
  MeshCommand mesh;
  ResumeCommand resume;
  InspectCommand inspect;
  ReplayCommand replay;
  ExportCommand export_command;
  ReportCommand report;
  AuditCommand audit;
  InfoCommand info;
  GenerateCommand generate;
  std::string reference_form;
  const std::vector<Subcommand> subcommands = {
      {declare_mesh(app, mesh), [&] { return run_mesh(mesh); }},
      {declare_resume(app, resume), [&] { return run_resume(resume); }},
      {declare_inspect(app, inspect), [&] { return run_inspect(inspect); }},
      {declare_replay(app, replay), [&] { return run_replay(replay); }},
      {declare_export(app, export_command), [&] { return run_export(export_command); }},
      {declare_report(app, report), [&] { return run_report(report); }},
      {declare_audit(app, audit), [&] { return run_audit(audit); }},
      {declare_info(app, info), [&] { return run_info(info); }},
      {declare_generate(app, generate), [&] { return run_generate(generate); }},
      {declare_reference(app, reference_form),
       [&] { return print_reference(app, reference_form); }},
  };
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return report_usage(app, error);
  }
  if (subcommands[0].first->parsed()) note_store(store_of(mesh));
  if (subcommands[1].first->parsed()) note_store(resume.store);
  for (const auto& [subcommand, run_subcommand] : subcommands) {
    if (subcommand->parsed()) return run_subcommand();
  }
  return kExitUsage;
}

// A result that did not reach its reader is no result.
void flush_output() {
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    throw std::runtime_error("cannot write to standard output");
  }
}

int fail(const char* message) {
  for (const char* text : {"locvol: error: ", message, "\n"}) std::fputs(text, stderr);
  return kExitError;
}

// The system refused memory or a file, for now: nothing is lost. Allocates nothing.
int fail_resumably(const char* message, const char* cure) {
  const auto print = [](std::initializer_list<const char*> texts) {
    for (const char* text : texts) std::fputs(text, stderr);
  };
  print({"locvol: error: ", message, "; "});
  if (store_name[0] != '\0')
    print({"the store ", store_name.data(), " keeps what was committed: "});
  print({cure, ", and give the same command again\n"});
  return kExitError;
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  locvol::clean_up_on_signals();
  try {
    const int code = locvol::run(argc, argv);
    locvol::flush_output();
    return code;
  } catch (const std::bad_alloc&) {
    return locvol::fail_resumably("out of memory", "free some memory");
  } catch (const std::system_error& error) {
    return locvol::fail_resumably(error.what(), "mend that");
  } catch (const std::exception& error) {
    return locvol::fail(error.what());
  } catch (...) {
    return locvol::fail("unknown error");
  }
}
