// KeptCreases are the creases and corners of the finished mesh: edges of its boundary between
// points that follow each other on a crease of the surface, and vertices that are corners of it.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/output/boundary_surface.h"
#include "engine/output/by_sheet.h"
#include "engine/output/leaf_lists.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/near_lists.h"
#include "engine/output/number_range.h"
#include "engine/output/vertex_numbering.h"
#include "octree/crease.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

// On a crease, or at a corner; what several facets have is of the first cell that has one of them.
struct KeptEdge {
  std::array<std::uint64_t, 2> vertices{};  // the smaller one first
  std::uint64_t cell = 0;
  std::uint64_t crease = 0;  // its id
  std::uint64_t way = 0;     // bits of its length along the crease
  double length() const { return std::bit_cast<double>(way); }
};
struct KeptCorner {
  std::uint64_t vertex = 0, cell = 0;
  std::uint64_t corner = 0;  // its id
  std::uint64_t leaf = 0;    // of the cell: its place in Morton order, among all
  Point position;
};

// What they are like all together, of all ranks.
struct KeptCrease {
  std::uint64_t num_edges = 0;
  double length = 0;  // along the crease
  Box box;            // of the edges
};

// Edges come in the order of their cells, corners in that of their ids.
//
// Which points follow each other is asked of each leaf that has some (refine/crease_segments.h),
// and told with the leaf of the edge's smaller vertex. The facets of a leaf's cells have such edges
// of leaves within 2λ; an edge's first cell is found where its smaller vertex is, for that leaf is
// within 2λ of all of its cells. Lists of leaves go through nameless files beside the output, and
// are told to ranks beside: as for BoundarySurface.
// Memory: 24 bytes a leaf, 64 a leaf of another rank beside, 64 a crease and a corner, 30 MB for
// creases, numbers and lists of leaves near the current one. Threads: used by one at a time.
// Errors: StoreError, std::system_error.
class KeptCreases {
 public:
  // All must outlive this object. What looks at all leaves throws Stopped. All ranks call it.
  // REQUIRES: keeps_creases(run)
  KeptCreases(const Reader& reader, const RunRecord& run, const VertexNumbering& numbering,
              const BoundarySurface& boundary, const std::filesystem::path& output,
              PageRelease& pages, const StopToken* stop = nullptr, Exchange& exchange = alone());
  // Without the boundary's cells, which takes less, when no more than kept() is asked.
  KeptCreases(const Reader& reader, const RunRecord& run, const VertexNumbering& numbering,
              const std::filesystem::path& output, PageRelease& pages,
              const StopToken* stop = nullptr, Exchange& exchange = alone());
  KeptCreases(const KeptCreases&) = delete;
  KeptCreases& operator=(const KeptCreases&) = delete;

  std::uint64_t num_edges() const { return num_edges_.all; }  // of all ranks
  std::uint64_t num_own_edges() const { return num_own_edges_; }
  std::uint64_t num_edges_of_lower_ranks() const { return num_edges_.before; }
  // Of all ranks, by id, from 1 on.
  std::span<const KeptCrease> kept() const { return kept_; }
  // Of all ranks.
  std::span<const KeptCorner> corners() const { return corners_; }

  // Some of the rank's own, one after another.
  struct Edges {
    std::uint64_t first = 0;  // its place among those of all ranks
    std::vector<KeptEdge> edges;
    std::vector<std::uint64_t> nodes;  // in their middle, if set_nodes() was called
  };
  struct Vertices {
    std::uint64_t first = 0;  // among those of the crease
    std::vector<std::uint64_t> vertices;
  };
  // From here on, edges come with what `number_of_node` says of them.
  using NumberOfNode = std::function<std::uint64_t(const MeshEdge&)>;
  void set_nodes(NumberOfNode number_of_node) { number_of_node_ = std::move(number_of_node); }
  std::function<std::optional<Edges>()> edges() const;

  // Sorts them by crease, vertices, too. All ranks call it, before any of the next is called. Of a
  // crease places count on from that before; vertices ascend, and a rank has those in its leaves.
  void sort();
  std::uint64_t num_own_edges_of(CreaseId crease) const { return by_crease_->num_own(crease); }
  std::uint64_t first_own_edge_of(CreaseId crease) const;
  std::function<std::optional<Edges>()> edges_of(CreaseId crease) const;
  std::uint64_t num_vertices_of(CreaseId crease) const {
    return vertices_by_crease_->of_ranks(crease).all;
  }
  std::function<std::optional<Vertices>()> vertices_of(CreaseId crease) const;
  // One of each edge, in the order of these. REQUIRES: set_nodes() was called
  std::function<std::optional<Vertices>()> nodes_of(CreaseId crease) const;

 private:
  // With edges go corners, whose vertices are twice the same.
  using Item = KeptEdge;
  static bool is_corner(const Item& item) { return item.vertices[0] == item.vertices[1]; }
  using Lists = NearLists<Item>;
  class Segments;  // which points follow each other
  // As far as it matters here.
  struct Facet {
    std::array<std::uint64_t, 3> vertices;
    std::uint64_t cell;
  };
  using FacetsOf = std::function<std::vector<Facet>(std::size_t leaf)>;

  void find(const FacetsOf& facets_of, bool has_cells);
  void find_segments(Lists& segments);
  void find_in_facets(const FacetsOf& facets_of, Lists& segments, Lists& found);
  void keep_first(const Lists& segments, Lists& found, Lists& first) const;
  void sort_by_cell(const Lists& found, Lists& first, Lists& of_cells) const;
  void add_up(const Lists& kept);
  Edges with_nodes(std::uint64_t first, std::vector<KeptEdge> edges) const;

  const Reader& reader_;
  const RunRecord& run_;
  const VertexNumbering& numbering_;
  std::filesystem::path output_;
  PageRelease& pages_;
  const StopToken* stop_;
  Exchange& exchange_;
  NumberOfNode number_of_node_;
  std::size_t num_creases_;
  std::optional<LeafLists<Item>> edges_;  // of own leaves, where there are cells
  std::uint64_t num_own_edges_ = 0;
  SumOfRanks num_edges_;
  std::vector<KeptCrease> kept_;
  std::vector<KeptCorner> corners_;
  std::optional<BySheet<Item>> by_crease_;
  std::optional<BySheet<std::uint64_t>> vertices_by_crease_;
  std::vector<std::uint64_t> edges_before_;  // of each crease, those of lower ones, of all ranks
};

}  // namespace locvol
