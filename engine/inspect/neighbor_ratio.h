// NeighborRatio finds how fast a mesh's cells grow: the largest ratio of two neighbors' sizes.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include "engine/output/leaf_lists.h"
#include "octree/stop.h"
#include "storage/records.h"

namespace locvol {

// A facet which one cell has, of those that a leaf lists.
struct OpenFacet {
  std::array<std::uint64_t, 3> vertices{};  // ids, ascending
  double radius = 0;                        // of the cell's circumball
};

// What the cells that one leaf lists tell.
struct LeafNeighbors {
  double most = 0;              // of two that share a facet, the larger radius over the smaller
  std::vector<OpenFacet> open;  // ascending
};
// `radii`: of the cells' circumballs
LeafNeighbors leaf_neighbors(const LeafCells& cells, std::span<const double> radii);

// Of all leaves, those near each other. Two cells that share a facet are listed by such.
// Memory: LeafLists, and 8 MB while ratio() is found.
class NeighborRatio {
 public:
  // `store`: beside which a nameless file is to be.
  explicit NeighborRatio(const std::filesystem::path& store) : open_(store) {}

  void add(const LeafNeighbors& leaf);  // in Morton order
  // near(leaf): the places of leaves near it. Throws Stopped.
  double ratio(const std::function<std::vector<std::size_t>(std::size_t leaf)>& near,
               const StopToken* stop = nullptr) const;

 private:
  LeafLists<OpenFacet> open_;
  double most_ = 0;
};

}  // namespace locvol
