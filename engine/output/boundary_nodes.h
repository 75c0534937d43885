// BoundaryNodes are the nodes of second-order cells that are on edges of the boundary: which there
// are, and where they lie.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "engine/output/boundary_surface.h"
#include "engine/output/by_sheet.h"
#include "engine/output/edge_window.h"
#include "engine/output/leaf_lists.h"
#include "engine/output/leaf_window.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/mesh_window.h"
#include "engine/output/near_lists.h"
#include "engine/output/node_places.h"
#include "engine/output/vertex_numbering.h"
#include "engine/shared/idle_pool.h"
#include "engine/shared/workers.h"
#include "storage/store.h"

namespace locvol {

// Where nodes are that are not in the middle of their edges.
struct NodeOnSurface {
  MeshEdge edge;  // of copies, between the first ones of its ends; all are there
  Point position;
};

// Nodes of boundary edges lie on the surface (NodePlaces), but for those that a cell does not allow
// there (allowed_nodes()): these, and all others, are in the middle.
//
// 1. Of each leaf: the edges of the facets that its cells have go to a nameless file.
// 2. Leaf by leaf, by any thread: its own edges are gathered from leaves within 2λ, and the places
//    of their nodes are found on the surface around.
// 3. Likewise: cells that have such nodes are asked which they do not allow there.
// 4. Of each leaf, the nodes that no cell around refuses are kept.
// What a cell allows does not depend on what others refuse, so one pass will do, in any order. Of
// several ranks, each does so for its own leaves, and is told the lists of those beside them.
//
// Memory: 32 bytes a leaf, 16 MB for lists of leaves near the current one; while it is made, 20 MB
// for the surface and for points, which the threads divide, and for each thread the surface around
// a leaf.
// Disk: 32 bytes for each edge of a facet while it is made, and 40 for each node off the middle.
// Threads: used by one at a time, but for on_surface(). Errors: StoreError; std::system_error.
class BoundaryNodes {
 public:
  // All must outlive it. All ranks call it. Throws Stopped.
  BoundaryNodes(const Store& store, const RunRecord& run, const VertexNumbering& numbering,
                MeshWindows& windows, EdgeWindows& edge_windows, const BoundarySurface& boundary,
                const std::filesystem::path& output, PageRelease& pages, Workers& workers,
                const StopToken* stop, Exchange& exchange);
  BoundaryNodes(const BoundaryNodes&) = delete;
  BoundaryNodes& operator=(const BoundaryNodes&) = delete;

  std::uint64_t size() const { return num_nodes_.all; }  // of all ranks
  // Of these, off the middle; and in the middle though the surface is not there.
  std::uint64_t num_on_surface() const { return num_on_surface_; }
  std::uint64_t num_kept_off() const { return num_kept_off_; }
  // Of a leaf, own or beside, those off the middle, in the order of their edges. Safe from many
  // threads.
  std::vector<NodeOnSurface> on_surface(std::size_t leaf) const { return on_surface_.of(leaf); }

  // The rank's own, in the order of their numbers: some after some, and then nothing; without
  // positions. `first` is among those of all ranks. By sheet as BoundarySurface has vertices.
  std::function<std::optional<BoundarySurface::Vertices>()> nodes() const;
  std::function<std::optional<BoundarySurface::Vertices>()> nodes_of(SheetId sheet) const;
  std::uint64_t num_nodes_of(SheetId sheet) const {
    return by_sheet_ ? by_sheet_->of_ranks(sheet).all : size();
  }

 private:
  // Of a facet; of an edge there are two.
  struct FacetEdge;
  struct OwnEdges;
  struct EdgeShape;
  struct FoundNodes;
  struct SurfaceWindow;
  struct CellsToAsk;
  using Candidates = NearLists<NodeOnSurface>;
  using Refused = NearLists<MeshEdge>;

  static std::vector<FacetEdge> edges_of(std::span<const BoundaryFacet> facets);
  void find_places(const Store& store, NearLists<FacetEdge>& edges, Candidates& candidates,
                   Workers& workers);
  std::vector<EdgeShape> shapes_of(const OwnEdges& own, FoundNodes& found);
  FoundNodes places_of(const OwnEdges& own, LendingPool<SurfaceWindow>& surfaces);
  NodePlaces surface_around(std::size_t leaf, const Box& region, SurfaceWindow& window) const;
  void ask_cells(Candidates& candidates, Refused& refused, Workers& workers);
  std::vector<MeshEdge> refused_by(const CellsToAsk& cells);
  std::uint64_t keep(const Candidates& candidates, Refused& refused);

  const RunRecord& run_;
  const VertexNumbering* numbering_;
  MeshWindows& windows_;
  EdgeWindows& edge_windows_;
  PageRelease& pages_;
  const StopToken* stop_;
  LeafLists<std::uint64_t> nodes_;  // of own leaves
  std::optional<BySheet<std::uint64_t>> by_sheet_;
  NearLists<NodeOnSurface> on_surface_;
  SumOfRanks num_nodes_;
  std::uint64_t num_on_surface_ = 0, num_kept_off_ = 0;
};

}  // namespace locvol
