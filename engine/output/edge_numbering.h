// EdgeNumbering gives the edges of a finished mesh numbers: those of the nodes in their middles,
// for cells of second order. EdgeWindow looks them up.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/output/leaf_lists.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/mesh_window.h"
#include "engine/output/vertex_numbering.h"
#include "engine/shared/workers.h"
#include "storage/store.h"

namespace locvol {

// Of a point of the core, a bit for each of the kLargerNeighbors.
inline constexpr std::uint8_t kAllCoreSteps = (1U << kLargerNeighbors.size()) - 1;

// Edges have the numbers after those of the vertices, leaf by leaf in Morton order.
//
// An edge is of the leaf of its smaller vertex, by number; between two points of the core, of the
// leaf of its smaller site. In a leaf come first the edges that cells list, ascending; then those
// of the core, by site and then by the step to the other one (kLargerNeighbors).
//
// - Edges of the core are known by formula: each point of it has all 14 that the lattice has there.
// - Others are in cells of leaves within 2λ. Of each leaf, the edges of its cells go to a nameless
//   file beside the output, own ones and those of other leaves apart; leaf by leaf, the latter are
//   looked up in the lists of leaves around.
//
// Of several ranks, each tells those beside it which edges of theirs its cells have, and what
// numbers its own edges got.
// Memory: 24 bytes a leaf, 64 a leaf of another rank beside, and 8 MB while it is made.
// Disk: 16 bytes for each edge that cells list, up to 40 while it is made, and a byte for each
// point of a core that is not whole.
// Threads: const functions are safe from many threads. Errors: CorruptRecord; std::system_error.
class EdgeNumbering {
 public:
  // `on_cells(n)`: so many of the rank's cells are done. Throws Stopped. All ranks call it.
  EdgeNumbering(const Reader& reader, const VertexNumbering& numbering, MeshWindows& windows,
                const std::filesystem::path& output, PageRelease& pages, Workers& workers,
                const StopToken* stop, Exchange& exchange,
                const std::function<void(std::uint64_t)>& on_cells);
  EdgeNumbering(const EdgeNumbering&) = delete;
  EdgeNumbering& operator=(const EdgeNumbering&) = delete;

  std::uint64_t size() const { return num_edges_.all; }  // of all ranks
  std::uint64_t num_own() const { return own_first_.back() - own_first_.front(); }
  // Numbers. Of a leaf, own or beside; REQUIRES for the end: own.
  std::uint64_t first(std::size_t leaf) const { return place_of(leaf).first; }
  std::uint64_t end(std::size_t own_leaf) const { return own_first_[own_leaf - first_own_ + 1]; }
  std::uint64_t first_of_core(std::size_t leaf) const {
    const Place place = place_of(leaf);
    return place.first + listed_.length(place.list);
  }
  // That cells list, in the order of their numbers.
  LeafList<MeshEdge> listed(std::size_t leaf) const { return listed_.list(place_of(leaf).list); }
  std::uint64_t num_listed(std::size_t leaf) const { return listed_.length(place_of(leaf).list); }
  // Of each point of the leaf's core, which of the kLargerNeighbors are points of the core, too: a
  // bit each. Empty: all are, of all points.
  std::vector<std::uint8_t> core_steps(std::size_t leaf) const {
    return core_steps_.list(place_of(leaf).list).values;
  }
  // Calls visit(leaf) for those of other ranks whose numbers are known, in Morton order.
  template <class Visit>
  void for_each_leaf_beside(const Visit& visit) const {
    for (const auto& [leaf, place] : beside_) visit(leaf);
  }

 private:
  struct Place {
    std::size_t list = 0;
    std::uint64_t first = 0;
  };
  // Of a leaf's cells, and of its core.
  struct Found {
    std::vector<MeshEdge> own, foreign;
    std::vector<std::uint8_t> core_steps;
    std::uint64_t num_core = 0;
  };
  class Lists;

  Place place_of(std::size_t leaf) const;
  Found find(std::size_t leaf, MeshWindows& windows) const;
  void find_all(Lists& lists, MeshWindows& windows, PageRelease& pages, Workers& workers,
                const StopToken* stop, const std::function<void(std::uint64_t)>& on_cells);
  void number(Lists& lists, const StopToken* stop, Exchange& exchange);
  void tell_numbers(const Reader& reader, Exchange& exchange);

  const VertexNumbering* numbering_;
  std::size_t first_own_, end_own_;
  // Of own leaves, and then of those beside them.
  LeafLists<MeshEdge> listed_;
  LeafLists<std::uint8_t> core_steps_;
  std::vector<std::uint64_t> num_core_;   // of own leaves
  std::vector<std::uint64_t> own_first_;  // likewise, and the end
  std::map<std::size_t, Place> beside_;
  SumOfRanks num_edges_;
};

}  // namespace locvol
