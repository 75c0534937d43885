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

#include "tools/arguments.h"
#include "tools/command_line.h"
#include "tools/commands.h"
#include "tools/generate.h"
#include "tools/guarded.h"
#include "tools/reference.h"
#include "tools/stop_signal.h"

namespace locvol {
namespace {

constexpr const char* kDescription =
    "Meshes the volume inside a closed surface with tetrahedra, out of core.";
using Subcommand = std::pair<CLI::App*, std::function<int()>>;

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

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  locvol::clean_up_on_signals();
  return locvol::guarded("locvol", [&] { return locvol::run(argc, argv); });
}
