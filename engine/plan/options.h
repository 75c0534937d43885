// What a user asks of a run, and is told while it goes on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "engine/formats/mesh_format.h"
#include "engine/plan/library_options.h"
#include "storage/records.h"

namespace locvol {

// Without a growth, of sizes around shapes.
inline constexpr double kDefaultGrowth = 0.2;
// Over λ, of sizes that the surface asks for.
inline constexpr double kDefaultLeast = 0.02;
// Above it, the octree of sizes need not be balanced.
inline constexpr double kMostGrowth = 0.3;

// Degrees. What refinement alone leaves are slivers, which no solver takes.
inline constexpr double kDefaultMinDihedral = 15;

// What is known of an image of sizes.
struct ImageFacts {
  std::string digest;  // of its values and where they are; empty: there is none
  double least = 0;    // of all values
};

// What is known of the files that options name, once they have been read.
struct FilesOfOptions {
  ImageFacts image = {};
  std::string sharp_polylines = {};  // digest; empty: there are none
};

// With the files of the surface.
struct MeshOptions : Options {
  std::filesystem::path input = {};  // empty: the surface is in no file; or kFromStandardInput
  // Each of these files is a body then, and so is the first. All are files, none the standard
  // input.
  std::vector<std::filesystem::path> more_inputs = {};
};

struct Progress {
  Phase phase = Phase::kIngest;
  RunCounts counts = {};
  std::uint64_t num_leaves = 0, num_queued = 0;
  std::uint64_t num_in_epoch = 0;  // of num_queued: in the open epoch, which nothing joins
  std::uint32_t epoch = 0;
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
  // Sizes that vary are known now, and with them what the mesh will take.
  std::function<void(const RunRecord&)> on_sizes = {};
  // The file that the mesh will be written to, if it will: its disk must have room for it.
  std::filesystem::path output = {};
  OutputOptions output_options = {};
  bool is_in_pieces = false;  // by several ranks: each writes a file of its own, on its disk
  // Cap on the memory of the whole process, heap and mapped pages; 0: half of what is free. It has
  // no influence on the result.
  std::uint64_t memory_bytes = 0;
  int num_threads = 0;  // 0: all that the process may use. No influence on the result either
};

}  // namespace locvol
