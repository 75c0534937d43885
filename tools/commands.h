// The subcommands: each calls the engine, prints its result to stdout and the rest to stderr, and
// returns the exit code. Errors are thrown.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "engine/engine.h"
#include "engine/exchange/exchange.h"
#include "engine/formats/writer.h"
#include "tools/arguments.h"
#include "tools/exit_code.h"
#include "tools/leaf_filter.h"
#include "tools/run_command.h"

namespace locvol {

struct MeshCommand : RunCommand {
  MeshOptions options;            // store: empty for the default, OUTPUT.locvol; size: see below
  std::optional<Size> size;       // absent: chosen for the surface
  bool is_store_kept = false;     // a store that the user names is kept in any case
  bool is_output_chosen = false;  // the user has named none
};

struct ResumeCommand : RunCommand {  // whose output may be empty: none is written
  std::filesystem::path store;
};

struct InspectCommand {
  std::filesystem::path store;
  // What to show instead of the summary: at most one of these.
  bool lists_leaves = false;
  bool lists_queue = false;
  bool lists_unresolved = false;
  bool lists_sizes = false;
  bool lists_faces = false;
  bool lists_creases = false;
  std::optional<LeafSpec> leaf;
  LeafListing listing;        // of leaves; its limit, of anything that is listed
  bool reads_all = false;     // every record, to find damage
  std::filesystem::path vtu;  // not empty: written instead, the leaf's cells or the leaves' boxes
  bool is_json = false;
};

struct ReplayCommand {
  std::filesystem::path store;
  std::optional<LeafSpec> leaf;        // with `store`
  std::filesystem::path from;          // or a file that `dump` has written
  std::filesystem::path dump;          // not empty: the visit is written there
  std::optional<std::uint64_t> limit;  // of the steps that are listed
  std::filesystem::path vtu;           // not empty: the resulting cells are written there
  bool is_json = false;
};

struct ExportCommand {
  std::filesystem::path store;
  std::filesystem::path output;
  OutputOptions output_options;
  std::uint64_t memory_bytes = 0;  // 0: the default
  int num_threads = 0;             // 0: all that the process may use
  bool is_quiet = false;
  bool is_json = false;
  bool is_in_pieces = false;
};

struct JoinCommand {
  std::filesystem::path stores;  // %r is the rank
  std::filesystem::path whole;
  bool is_json = false;
};

struct ReportCommand {
  std::filesystem::path store;
  std::filesystem::path output;
  std::optional<std::uint64_t> max_cells;  // on the page
  bool is_json = false;
};

struct AuditCommand {
  std::filesystem::path store;
  std::uint64_t one_in = 1;  // so many leaves, one is checked
  bool is_quiet = false;
  bool is_json = false;
};

struct InfoCommand {
  std::filesystem::path surface;
  std::optional<Size> size;
  MeshOptions options;  // what sizes depend on alone
  OutputOptions output_options;
  std::filesystem::path vtu;  // for the octree of sizes; empty: none
  bool is_json = false;
};

struct CureCommand {
  std::filesystem::path surface, output;
  std::optional<Size> weld;           // repair
  std::optional<Size> alpha, offset;  // wrap
  std::uint64_t memory_bytes = 0;     // 0: the default
  bool is_json = false;
};

struct GenerateCommand {
  std::string shape;
  std::uint64_t num_triangles = 0;                // 0: of a polycrystal
  std::uint64_t num_grains = 0, grains_seed = 0;  // 0: of another shape
  std::filesystem::path output;
  bool is_json = false;
};

// The directory where `mesh` keeps its run: the one that the user names, where %r is the rank; or
// OUTPUT.locvol, of ranks OUTPUT.locvol-%r.
std::filesystem::path store_of(const MeshCommand& command, bool is_of_ranks);
// The subcommands. By several ranks, each calls them; what goes to stdout is the first rank's.
int run_mesh(const MeshCommand& command);
int run_resume(const ResumeCommand& command);
int run_mesh_as_rank(const MeshCommand& command, Exchange& exchange);
int run_resume_as_rank(const ResumeCommand& command, Exchange& exchange);
int run_export_as_rank(const ExportCommand& command, Exchange& exchange);
int run_report_as_rank(const ReportCommand& command, Exchange& exchange);
int run_audit_as_rank(const AuditCommand& command, Exchange& exchange);
int run_inspect_as_rank(const InspectCommand& command, Exchange& exchange);
int run_join(const JoinCommand& command, Exchange& exchange);
int run_inspect(const InspectCommand& command);
int run_replay(const ReplayCommand& command);
int run_export(const ExportCommand& command);
int run_report(const ReportCommand& command);
int run_audit(const AuditCommand& command);
int run_info(const InfoCommand& command);
int run_repair(const CureCommand& command);
int run_wrap(const CureCommand& command);
int run_generate(const GenerateCommand& command);

}  // namespace locvol
