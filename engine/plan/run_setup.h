// What is decided before a run starts: its parameters, its octree, and whether it can be done at
// all.
#pragma once

#include <filesystem>
#include <string>

#include "engine/engine.h"
#include "engine/shared/memory_budget.h"
#include "storage/records.h"

namespace locvol {

inline constexpr std::uint64_t kDefaultLeafCapacity = 30000;

// The record of a run that has yet to ingest the surface whose file has this digest, and which has
// this bounding box. Throws InputError, with the cure, for options out of range and for sizes that
// double arithmetic cannot handle on this surface.
RunRecord planned_run(const MeshOptions& options, const std::string& digest, const Box& surface);
// With all that is known of a surface which was checked before.
RunRecord planned_run(const MeshOptions& options, const std::string& digest,
                      const SurfaceFacts& surface);

// Where the run's leaves lie at the start: near the surface and inside they are nodes of `level`.
struct OctreePlan {
  Frame frame;
  int level = 0;
};

// So wide that a leaf filled with lattice points has half as many as κ, but at least 4 λ.
double start_leaf_side(const RunParameters& parameters);

// Cover: leaves that will hold about half of κ lattice points, at least 4 λ wide; paper: one leaf.
// Throws InputError, with the cure, if the surface is too large for leaves that small at all.
OctreePlan plan_octree(const RunParameters& parameters, const Box& surface);

// How a run shares out the memory under `cap`: one that has yet to be ingested, as far as the
// parameters tell what its visits will take, and one in a store, leaf by leaf.
// Throws OverBudget, naming the least cap that would do.
MemoryPlan planned_memory(const RunRecord& run, std::uint64_t cap);
MemoryPlan planned_memory(const Reader& reader, std::uint64_t cap);

// The least cap on memory under which a run can be planned that has yet to be ingested.
std::uint64_t least_memory(const RunRecord& run);

// Throws StoreMismatch, naming each parameter that differs and both its values.
void require_same_run(const RunParameters& held, const RunParameters& asked,
                      const std::filesystem::path& store);

}  // namespace locvol
