// The locvol-mpi command: `mesh`, by all processes of an MPI job.
#include <CLI/CLI.hpp>

#include "engine/exchange/exchange.h"
#include "tools/command_line.h"
#include "tools/commands.h"
#include "tools/exit_code.h"
#include "tools/guarded.h"
#include "tools/mpi/mpi_exchange.h"
#include "tools/stop_signal.h"

namespace locvol {
namespace {

constexpr const char* kDescription =
    "Meshes the volume inside a closed surface with tetrahedra, out of core, by all processes of "
    "an "
    "MPI job: mpirun -n 8 locvol-mpi mesh part.stl -o part.vtu --store /local/part-%r. The mesh is "
    "that of `locvol mesh`.";

int run(int argc, char** argv, Exchange& exchange) {
  CLI::App app(kDescription, "locvol-mpi");
  app.footer(kFooter);
  app.set_version_flag("--version", "locvol-mpi " LOCVOL_VERSION);
  app.require_subcommand(1);
  MeshCommand mesh;
  declare_mesh(app, mesh);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {  // the same on all ranks
    if (exchange.rank() == 0) return report_usage(app, error);
    return error.get_exit_code() == 0 ? kExitDone : kExitUsage;
  }
  note_store(store_of(mesh, exchange.rank()));
  return run_mesh_as_rank(mesh, exchange);
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  locvol::clean_up_on_signals();
  locvol::MpiExchange exchange(argc, argv);
  const std::string name = "locvol-mpi: rank " + std::to_string(exchange.rank());
  const int code = locvol::guarded(name.c_str(), [&] { return locvol::run(argc, argv, exchange); });
  // Others wait for this rank.
  if (code == locvol::kExitError) exchange.end_all(code);
  return code;
}
