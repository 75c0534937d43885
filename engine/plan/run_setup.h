// What is decided before a run starts: its parameters, and whether it can be done at all.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/plan/options.h"
#include "engine/shared/memory_budget.h"
#include "storage/store.h"

namespace locvol {

inline constexpr std::uint64_t kDefaultLeafCapacity = 30000;

// In the units of the coordinates. Throws InputError with its name unless it is positive and
// finite.
double absolute_size(const Size& size, const Box& box, const std::string& name = "size");

// MeshOptions::weld in these units. Throws as absolute_size().
std::optional<double> weld_length(const std::optional<Size>& weld, const Box& box);
double gap_length(const Size& gap, const Box& box);  // likewise of MeshOptions::gap

// The record of a run that has yet to ingest the surface whose file has this digest, and which has
// this bounding box. Throws InputError, with the cure, for options out of range and for sizes that
// double arithmetic cannot handle on this surface.
RunRecord planned_run(const MeshOptions& options, const std::string& digest, const Box& surface,
                      const FilesOfOptions& files = {});
// With all that is known of a surface which was checked before.
RunRecord planned_run(const MeshOptions& options, const std::string& digest,
                      const SurfaceFacts& surface, const FilesOfOptions& files = {});

// Of shapes with sizes that lie outside of the surface's box: where, and whether they matter all
// the same. A sentence each.
std::vector<std::string> notes_on_shapes(const MeshOptions& options, const RunParameters& planned,
                                         const Box& surface);

// How a run shares out the memory under `cap`: one that has yet to be ingested, as far as the
// parameters tell what its visits will take, and one in a store, leaf by leaf.
// Throws OverBudget, naming the least cap that would do.
MemoryPlan planned_memory(const RunRecord& run, std::uint64_t cap);
MemoryPlan planned_memory(const Reader& reader, std::uint64_t cap);

// The least cap on memory under which a run can be planned that has yet to be ingested.
std::uint64_t least_memory(const RunRecord& run);

// Throws InputError unless sizes that are known ask for a number of cells that anyone could want.
void require_few_cells(const RunRecord& run);

}  // namespace locvol
