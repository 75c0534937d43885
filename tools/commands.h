// The subcommands: each calls the engine, prints its result to stdout and the rest to stderr, and
// returns the exit code. Errors are thrown.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "engine/engine.h"
#include "octree/morton_key.h"

namespace locvol {

// Documented in --help and the README.
enum ExitCode : int {
  kExitDone = 0,
  kExitError = 1,
  kExitUsage = 2,
  kExitUnresolved = 3,
  kExitInterrupted = 4,
};

struct MeshCommand {
  MeshOptions options;  // store: empty for the default, OUTPUT.locvol
  std::filesystem::path output;
  bool is_store_kept = false;  // a store that the user names is kept in any case
  bool is_quiet = false;
  bool is_json = false;
};

struct ResumeCommand {
  std::filesystem::path store;
  std::filesystem::path output;  // empty: none is written
  bool is_quiet = false;
  bool is_json = false;
};

struct InspectCommand {
  std::filesystem::path store;
  bool lists_leaves = false;
  bool lists_queue = false;
  std::optional<MortonKey> leaf;
  bool is_json = false;
};

struct ExportCommand {
  std::filesystem::path store;
  std::filesystem::path output;
  bool is_json = false;
};

struct AuditCommand {
  std::filesystem::path store;
  bool is_json = false;
};

struct InfoCommand {
  std::filesystem::path surface;
  std::optional<SizeSpec> size;
  bool is_json = false;
};

struct GenerateCommand {
  std::string shape;
  std::uint64_t num_triangles = 0;
  std::filesystem::path output;
  bool is_json = false;
};

// Where `mesh` keeps its run: the directory that the user names, or OUTPUT.locvol.
std::filesystem::path store_of(const MeshCommand& command);
int run_mesh(const MeshCommand& command);
int run_resume(const ResumeCommand& command);
int run_inspect(const InspectCommand& command);
int run_export(const ExportCommand& command);
int run_audit(const AuditCommand& command);
int run_info(const InfoCommand& command);
int run_generate(const GenerateCommand& command);

}  // namespace locvol
