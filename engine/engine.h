// The engine meshes a closed surface out of core: which leaf next, load, refine, commit; then
// writer and audit stream the result from the store.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/formats/mesh_format.h"
#include "engine/ingest/surface_source.h"
#include "engine/shared/input_error.h"
#include "storage/records.h"
#include "storage/store.h"

namespace locvol {

// λ as the user gives it: an absolute length, or a percentage of the smallest side of the bounding
// box of the surface.
struct SizeSpec {
  double value = 0;
  bool is_percent = false;
};

// λ in the units of the coordinates. Throws InputError unless it is positive and finite.
double absolute_size(const SizeSpec& size, const Box& box);

struct MeshOptions {
  std::filesystem::path input;  // empty: the surface is in no file
  std::filesystem::path store;
  SizeSpec size;
  std::uint64_t leaf_capacity = 0;  // κ; 0: the default
  Initialization init = Initialization::kCover;
  std::uint64_t seed = 0;
  double radius_edge_bound = 2;
  double spacing_floor = 0.02;  // as a fraction of λ
  bool is_forced = false;       // start anew over a store of another run
};

struct Progress {
  Phase phase = Phase::kIngest;
  std::uint64_t num_leaves = 0, num_queued = 0, num_visits = 0;
  std::uint64_t num_in_epoch = 0;  // of num_queued: in the open epoch, which nothing joins
  std::uint64_t num_points = 0, num_cells = 0;
  std::uint32_t epoch = 0;          // of kInitialize: 0 covers leaves, 1 fills holes
  std::uint32_t first_epoch = 1;    // of kRefine
  std::uint64_t num_triangles = 0;  // read, checked and cut so far, one after another; of kIngest
};

// The functions are called by one thread at a time, not always the same one: with num_threads 1,
// the caller.
struct RunControl {
  // Called after each visit and each commit, and now and then while a large surface is ingested;
  // may be empty.
  std::function<void(const Progress&)> on_progress;
  // Asked between visits, and ten times a second wherever something takes long: true ends the run
  // after a commit. A visit in hand is dropped, to be made again. May be empty.
  std::function<bool()> is_stopped;
  std::function<void(const std::string&)> on_note;  // repairs of the input, and such
  // Called once, with the surface and the parameters of the run that begins or goes on. What it
  // throws ends the run; one that begins has written nothing by then. May be empty.
  std::function<void(const RunRecord&)> on_run = {};
  // The file that the mesh will be written to, if it will: its disk must have room for it.
  std::filesystem::path output = {};
  OutputOptions output_options = {};
  // Cap on the memory of the whole process, heap and mapped pages; 0: half of what is free. It has
  // no influence on the result.
  std::uint64_t memory_bytes = 0;
  int num_threads = 0;  // 0: all that the process may use. No influence on the result either
};

enum class RunOutcome { kDone, kUnresolved, kInterrupted };

struct RunSummary {
  RunOutcome outcome = RunOutcome::kDone;
  RunRecord run;
  std::uint64_t num_leaves = 0, num_points = 0, num_cells = 0, num_unresolved = 0;
  std::uint64_t num_visits = 0, max_visits_of_a_leaf = 0, num_deletions = 0;
  std::array<std::uint64_t, kNumConditions> num_insertions{};
};

// Another input or other parameters than the store's; the message names the difference.
class StoreMismatch : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Starts a run, or goes on with the one that the store holds. Throws InputError, StoreError,
// StoreMismatch, OverBudget, RefineError: a VisitError, if it can be made again from the store.
// Throws Stopped where is_stopped() ends it before the run is known; then nothing is changed.
RunSummary mesh(const MeshOptions& options, const RunControl& control = {});
// Of any surface. REQUIRES: options.input is empty unless it is that file
RunSummary mesh(const SurfaceSource& surface, const MeshOptions& options,
                const RunControl& control = {});
// Goes on with the run in `store`; needs neither the input nor the parameters, but for an input
// that was in no file if it had not been taken in.
RunSummary resume(const std::filesystem::path& store, const RunControl& control = {});
RunSummary summarize(const Reader& reader);

}  // namespace locvol
