// LeafReport is all that a store knows of one leaf, as of one commit.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "engine/inspect/cell_mesh.h"
#include "engine/inspect/leaf_scan.h"

namespace locvol {

using CountsByKind = std::array<std::uint64_t, kNumPointKinds>;
CountsByKind counts_by_kind(std::span<const MeshPoint> points);

struct LeafReport {
  MortonKey key;
  Box box;
  std::optional<LeafInfo> info;      // absent if its record is damaged, as the lists are then empty
  LeafPoints points;                 // P_v
  CountsByKind ghosts{};             // points of other leaves within the reach of a visit
  std::vector<MortonKey> neighbors;  // leaves that touch it, in Morton order
  std::uint64_t num_triangles = 0;
  LeafCells cells;  // as stored
  // The cells with positions, but for those with a vertex that is gone: another leaf's visit may
  // delete a point, and this one waits since. Behind them are the cells of the core whose smallest
  // vertex is the leaf's.
  CellMesh mesh;
  std::uint64_t num_stale_cells = 0;  // those
  LeafUnresolved unresolved;
  std::vector<Fault> faults;  // of the leaf, and of its surroundings
};

// Reports a leaf; gives nothing if there is no such leaf.
std::optional<LeafReport> report_leaf(const Reader& reader, const RunRecord& run, MortonKey leaf);

// The leaves' boxes with cell data key, level, state (LeafState), visits, points, cells,
// core_points, core_cells, triangles, insertions, deletions, unresolved, queued, epoch, color; -1
// where it is unknown or has none.
std::uint64_t write_leaves_vtu(std::span<const LeafRow> leaves, const Frame& frame,
                               const std::filesystem::path& file);

}  // namespace locvol
