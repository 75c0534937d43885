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
#include "tools/start_process.h"
#include "tools/stop_signal.h"

namespace locvol {
namespace {

constexpr const char* kDescription =
    "Meshes the volume inside a closed surface with tetrahedra, out of core.";
using Subcommand = std::pair<CLI::App*, std::function<int()>>;

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
  add_surfaces(*info, command.surface, command.options.more_inputs);
  add_parsed(*info, "-s,--size", parse_size, command.size,
             "λ, as for mesh, to estimate what a run takes (default: as mesh chooses it)")
      ->type_name("SIZE");
  add_sizes(*info, command.options);
  add_format(*info, command.output_options, "vtu");
  add_cell_data(*info, command.output_options);
  add_boundary(*info, command.output_options);
  add_order(*info, command.output_options);
  info->final_callback([&command] { check_output(command.output_options); });
  add_vtu(*info, command.vtu, "Find the sizes, and write their octree to this file, to look at");
  add_json(*info, command.is_json);
  return info;
}

void add_cured(CLI::App& app, CureCommand& command) {
  app.add_option("SURFACE", command.surface, kSurfaceHelp)->type_name("")->required();
  add_output(app, command.output, {".ply", ".obj", ".stl"})->required();
  add_memory(app, command.memory_bytes);
  add_json(app, command.is_json);
}

CLI::App* declare_repair(CLI::App& app, CureCommand& command) {
  CLI::App* repair = app.add_subcommand(
      "repair", "Fill holes and drop doubled and loose triangles of a surface that is not closed");
  add_cured(*repair, command);
  add_parsed(*repair, "--weld", parse_weld, command.weld,
             "Points at open edges that are closer become one: a length, or a percentage of the "
             "smallest side (default: 0.0001 of the longest side, at most a tenth of the shortest "
             "open edge)")
      ->type_name("LENGTH");
  return repair;
}

CLI::App* declare_wrap(CLI::App& app, CureCommand& command) {
  CLI::App* wrap =
      app.add_subcommand("wrap", "Wrap a closed surface around any triangles, at a small distance");
  add_cured(*wrap, command);
  add_parsed(*wrap, "--alpha", parse_size, command.alpha,
             "Bridge what a ball of this radius does not go through: a length, or a percentage of "
             "the smallest side (default: a 50th of the longest side)")
      ->type_name("LENGTH");
  add_parsed(*wrap, "--offset", parse_size, command.offset,
             "Distance from the triangles (default: a 30th of --alpha)")
      ->type_name("LENGTH");
  return wrap;
}

std::string shape_list() {
  std::string list = "Shapes:\n";
  for (const ShapeInfo& shape : shapes()) {
    list += fmt::format("  {:<18} {}; at least {} triangles\n", shape.name, shape.description,
                        shape.min_triangles);
  }
  list +=
      fmt::format("  {:<18} a cube of grains, each a body (mesh it with --bodies): give --grains\n",
                  kPolycrystal);
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
      ->type_name("N");
  add_parsed(*generate, "--grains", parse_count, command.num_grains,
             "How many grains a polycrystal has, at most 10,000")
      ->type_name("N");
  CLI::Option* seed = add_parsed(*generate, "--seed", parse_seed, command.grains_seed,
                                 "Seed of the grains' places (default: 0)");
  seed->type_name("N");
  add_json(*generate, command.is_json);
  generate->final_callback([&command, seed] {
    const bool is_polycrystal = command.shape == kPolycrystal;
    if (is_polycrystal && command.num_triangles > 0)
      throw CLI::ValidationError("--triangles", "a polycrystal has as many as its grains need");
    if (!is_polycrystal && (command.num_grains > 0 || seed->count() > 0))
      throw CLI::ValidationError("--grains, --seed", "of a polycrystal alone");
    if (is_polycrystal && command.num_grains == 0) throw CLI::RequiredError("--grains");
    if (!is_polycrystal && command.num_triangles == 0) throw CLI::RequiredError("--triangles");
  });
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

// What who calls the command alone may want to do first.
constexpr const char* kFirstSteps =
    R"(locvol fills closed surfaces with tetrahedra, within a memory cap.

  locvol info part.stl                is it closed, how large would a mesh be
  locvol mesh part.stl                makes part.vtu, for ParaView, of about half a million cells
  locvol mesh part.step -o part.inp   from CAD to CalculiX and Abaqus: faces keep their names
  locvol mesh part.stl -o part.msh --size 1% --memory 2G
  locvol repair part.stl -o new.stl   if it is not closed

`locvol --help` lists the commands, `locvol COMMAND --help` their options.
)";

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
  CureCommand repair, wrap;
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
      {declare_repair(app, repair), [&] { return run_repair(repair); }},
      {declare_wrap(app, wrap), [&] { return run_wrap(wrap); }},
      {declare_generate(app, generate), [&] { return run_generate(generate); }},
      {declare_reference(app, reference_form),
       [&] { return print_reference(app, reference_form); }},
  };
  if (argc < 2) {
    fmt::print("{}", kFirstSteps);
    return kExitUsage;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return report_usage(app, error);
  }
  if (subcommands[0].first->parsed()) note_store(store_of(mesh, false));
  if (subcommands[1].first->parsed()) note_store(resume.store);
  for (const auto& [subcommand, run_subcommand] : subcommands) {
    if (subcommand->parsed()) return run_subcommand();
  }
  return kExitUsage;
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  locvol::start_process();
  locvol::clean_up_on_signals();
  return locvol::guarded("locvol", [&] { return locvol::run(argc, argv); });
}
