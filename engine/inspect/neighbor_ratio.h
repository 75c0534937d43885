// NeighborRatio finds how fast a mesh's cells grow: the largest ratio of two neighbors' sizes.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <span>
#include <utility>
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

// NeighborRatio compares cells that share a facet: they are listed by leaves near each other.
// Memory: LeafLists, what is told, and 8 MB while ratio() is found.
class NeighborRatio {
 public:
  // `store`: beside which a nameless file is to be.
  explicit NeighborRatio(const std::filesystem::path& store) : open_(store) {}

  void add(const LeafNeighbors& leaf);  // in Morton order
  // Where several ranks measure a mesh, one tells another the open facets of a leaf, which the
  // other has added as one without cells.
  std::vector<OpenFacet> open_facets(std::size_t leaf) const { return open_.list(leaf).values; }
  void put_told(std::size_t leaf, std::vector<OpenFacet> open) { told_[leaf] = std::move(open); }
  // near(leaf): the places of leaves near it. Throws Stopped.
  double ratio(const std::function<std::vector<std::size_t>(std::size_t leaf)>& near,
               const StopToken* stop = nullptr) const;

 private:
  bool has_open(std::size_t leaf) const { return open_.length(leaf) > 0 || told_.contains(leaf); }
  LeafList<OpenFacet> list(std::size_t leaf) const;

  LeafLists<OpenFacet> open_;
  std::map<std::size_t, std::vector<OpenFacet>> told_;
  double most_ = 0;
};

}  // namespace locvol
