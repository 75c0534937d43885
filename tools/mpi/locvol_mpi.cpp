// The locvol-mpi command: what all processes of an MPI job do together.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <string>
#include <string_view>
#include <thread>

#include "engine/exchange/exchange.h"
#include "engine/ranks/rank_store.h"
#include "tools/command_line.h"
#include "tools/commands.h"
#include "tools/exit_code.h"
#include "tools/guarded.h"
#include "tools/mpi/mpi_exchange.h"
#include "tools/reference.h"
#include "tools/start_process.h"
#include "tools/stop_signal.h"

namespace locvol {
namespace {

constexpr const char* kDescription =
    "Meshes the volume inside a closed surface with tetrahedra, out of core, by all processes of "
    "an "
    "MPI job: mpirun -n 8 locvol-mpi mesh part.stl -o part.vtu --store /local/part-%r. The mesh is "
    "that of `locvol mesh`. In the name of a store, %r is a process's number.";

void add_pieces(CLI::App* app, bool& is_in_pieces) {
  app->add_flag(
      "--pieces", is_in_pieces,
      "Write a file for each process instead of one for all, and for VTK one that makes a "
      "whole of them: for -o part.vtu part-0.vtu, ... and part.pvtu, for part.vtkhdf "
      "part-0.vtkhdf, ... and part.vtkhdf, for part.msh part_1.msh, ...");
}

CLI::App* declare_join(CLI::App& app, JoinCommand& command) {
  CLI::App* join = app.add_subcommand(
      "join",
      "Put what the stores of a run hold into one, which locvol can inspect, audit, report on and "
      "export; by any number of processes that see all of them");
  add_store(*join, command.stores);
  join->add_option("WHOLE", command.whole,
                   "Directory for that store, which the first process makes")
      ->type_name("")
      ->required();
  add_json(*join, command.is_json);
  return join;
}

struct Commands {
  MeshCommand mesh;
  ResumeCommand resume;
  ExportCommand export_command;
  ReportCommand report;
  AuditCommand audit;
  InspectCommand inspect;
  JoinCommand join;
};

void declare(CLI::App& app, Commands& commands) {
  app.footer(kFooter);
  app.set_version_flag("--version", "locvol-mpi " LOCVOL_VERSION);
  app.require_subcommand(1);
  add_pieces(declare_mesh(app, commands.mesh), commands.mesh.control.is_in_pieces);
  add_pieces(declare_resume(app, commands.resume), commands.resume.control.is_in_pieces);
  add_pieces(declare_export(app, commands.export_command), commands.export_command.is_in_pieces);
  declare_report(app, commands.report);
  declare_audit(app, commands.audit);
  declare_inspect(app, commands.inspect);
  declare_join(app, commands.join);
  app.add_subcommand("reference", "Print the manual page");
}

// By one process, without MPI: it is made where the program is built.
int print_reference(int argc, char** argv) {
  CLI::App app(kDescription, "locvol-mpi");
  Commands commands;
  declare(app, commands);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return report_usage(app, error);
  }
  fmt::print("{}", reference(app, "man"));
  return kExitDone;
}

int run(int argc, char** argv, Exchange& exchange) {
  CLI::App app(kDescription, "locvol-mpi");
  Commands commands;
  declare(app, commands);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {  // the same on all ranks
    if (exchange.rank() == 0) return report_usage(app, error);
    return error.get_exit_code() == 0 ? kExitDone : kExitUsage;
  }
  if (app.got_subcommand("mesh")) {
    note_store(store_of_rank(store_of(commands.mesh, true), exchange.rank()));
    return run_mesh_as_rank(commands.mesh, exchange);
  }
  if (app.got_subcommand("resume")) {
    note_store(store_of_rank(commands.resume.store, exchange.rank()));
    return run_resume_as_rank(commands.resume, exchange);
  }
  if (app.got_subcommand("export")) return run_export_as_rank(commands.export_command, exchange);
  if (app.got_subcommand("report")) return run_report_as_rank(commands.report, exchange);
  if (app.got_subcommand("audit")) return run_audit_as_rank(commands.audit, exchange);
  if (app.got_subcommand("inspect")) return run_inspect_as_rank(commands.inspect, exchange);
  return run_join(commands.join, exchange);
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  locvol::start_process();
  locvol::clean_up_on_signals();
  if (argc > 1 && std::string_view(argv[1]) == "reference")
    return locvol::guarded("locvol-mpi", [&] { return locvol::print_reference(argc, argv); });
  locvol::MpiExchange exchange(argc, argv);
  const std::string name = "locvol-mpi: rank " + std::to_string(exchange.rank());
  bool has_failed = true;
  const int code = locvol::guarded(name.c_str(), [&] {
    try {
      const int result = locvol::run(argc, argv, exchange);
      has_failed = false;
      return result;
    } catch (const locvol::ExchangeError&) {
      // The rank that knows why is to tell it before this one ends them all.
      std::this_thread::sleep_for(std::chrono::seconds(2));
      throw;
    }
  });
  if (has_failed) exchange.end_all(code);  // others wait for this rank
  return code;
}
