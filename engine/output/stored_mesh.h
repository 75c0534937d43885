// What those begin with that read the mesh from a store: its run, its octree, and the leaves and
// points around a leaf.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "octree/octree.h"
#include "storage/store.h"

namespace locvol {

// Throw StoreError if the store holds no run; finished_run() also if it is not done.
RunRecord stored_run(const Store& store, const Reader& reader);
RunRecord finished_run(const Store& store, const Reader& reader);
// Does the run put points on the creases and corners that its surface has?
inline bool keeps_creases(const RunRecord& run) {
  return run.has_creases && run.parameters.init == Initialization::kCover;
}
// Beside which nameless files may lie: in the store's directory, or if nothing may be written there
// in that for temporary files.
std::filesystem::path place_for_lists(const Store& store);
// Throws CorruptRecord unless the leaves cover the root.
LinearOctree stored_octree(const Store& store, const Reader& reader);

// A cell's vertices lie this close to its smallest one; over λ.
inline constexpr double kCellReach = 2;

// The leaves within `distance` of a leaf, with itself: places in Morton order, ascending. Within
// kCellReach are all vertices of the leaf's cells.
std::vector<std::size_t> leaves_near(const LinearOctree& octree, const Frame& frame,
                                     std::size_t leaf, double distance);
// Over which such distances are: λ for all leaves; or, where sizes vary, how large h may be where
// balls through a leaf's points are centered. Memory: then 8 bytes a leaf.
class LeafScale {
 public:
  LeafScale(const Reader& reader, const RunRecord& run);
  double of(std::size_t leaf) const { return of_leaves_.empty() ? size_ : of_leaves_[leaf]; }

 private:
  double size_;  // λ
  std::vector<double> of_leaves_;
};

[[noreturn]] void throw_unknown_point(std::uint64_t id, MortonKey leaf);  // a CorruptRecord

// The listed points of a leaf, to be found by their ids.
struct PointTable {
  explicit PointTable(const LeafPoints& points);

  std::vector<std::uint64_t> ids;  // ascending
  std::vector<Point> positions;
  std::size_t bytes() const { return sizeof *this + 32 * ids.capacity(); }
};

}  // namespace locvol
