// BoundarySurface is the boundary of the finished mesh, as leaves list its facets, in the order of
// the cells that have them.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/output/by_sheet.h"
#include "engine/output/leaf_lists.h"
#include "engine/output/leaf_window.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/vertex_numbering.h"
#include "engine/output/vertex_positions.h"
#include "engine/shared/workers.h"
#include "octree/mesh_facet.h"
#include "storage/store.h"

namespace locvol {

struct BoundaryFacet {
  std::array<std::uint64_t, 3> vertices{};  // counterclockwise from outside, the smallest first
  std::uint64_t cell = 0;                   // whose facet it is; without cells: its own number
  std::uint32_t across = 0;                 // from which of the cell's vertices, 0 to 3
  FacetLabels labels;
};

// Facets come in the order of their cells, vertices in that of their numbers in the mesh. In a run
// of the surface alone, facets come leaf by leaf, in the order of their vertices' numbers.
//
// A facet is listed by the leaf of its smallest vertex, its cell by that of the cell's, which is
// within 2λ. Leaf by leaf, facets go to a nameless file beside the output; from there, those of the
// leaves around one are looked up among its cells. Of several ranks, each tells those beside it of
// its own, and has the facets of its cells and the vertices of its leaves.
//
// Where there are several sheets, facets and vertices can also be had sheet by sheet, each in the
// same order; a vertex is of each sheet that has a facet with it.
// Memory: 24 bytes a leaf, 64 a leaf of another rank beside, 12 MB for lists of leaves near the
// current one, and for each thread a leaf's cells and facets; 20 MB while facets are found.
// Threads: used by one at a time. Errors: StoreError, also if a facet is of no cell;
// std::system_error.
class BoundarySurface {
 public:
  // All but `workers` must outlive this object. What looks at all leaves throws Stopped.
  // `exchange`: as for VertexNumbering
  BoundarySurface(const Reader& reader, const VertexNumbering& numbering,
                  VertexPositions& positions, const std::filesystem::path& output,
                  PageRelease& pages, Workers& workers, const StopToken* stop = nullptr,
                  Exchange& exchange = alone());
  BoundarySurface(const BoundarySurface&) = delete;
  BoundarySurface& operator=(const BoundarySurface&) = delete;

  std::uint64_t num_facets() const { return num_facets_.all; }  // of all ranks
  std::uint64_t num_own_facets() const { return facets_.size(); }
  std::uint64_t num_facets_of_lower_ranks() const { return num_facets_.before; }
  // Likewise. Found by the first call, which all ranks make; vertices() and places ask for it.
  std::uint64_t num_vertices();
  std::uint64_t num_own_vertices() const { return end_own_vertex_; }

  // Some of the rank's own facets, one after another; what was not asked for is empty.
  struct Facets {
    std::uint64_t first = 0;  // its place among those of all ranks
    std::vector<BoundaryFacet> facets;
    std::vector<std::array<Point, 3>> corners;
    std::vector<std::array<std::uint64_t, 3>> places;  // of the vertices, among the boundary's
    // In the middle of its edges, the first from the first vertex to the second; if set_nodes() was
    // called.
    std::vector<std::array<std::uint64_t, 3>> nodes;
  };
  struct FacetParts {
    bool has_corners = false, has_places = false;  // REQUIRES: num_vertices() was called
  };
  struct Vertices {
    std::uint64_t first = 0;  // likewise
    std::vector<std::uint64_t> vertices;
    std::vector<Point> positions;
  };
  // From here on, facets come with what `number_of_node` says of their edges.
  using NumberOfNode = std::function<std::uint64_t(const MeshEdge&)>;
  void set_nodes(NumberOfNode number_of_node) { number_of_node_ = std::move(number_of_node); }
  // Of the cells that an own leaf has.
  std::vector<BoundaryFacet> facets_of_leaf(std::size_t leaf) const {
    return facets_.list(leaf - numbering_->first_own()).values;
  }
  // Give some after some, and then nothing.
  std::function<std::optional<Facets>()> facets(const FacetParts& parts);
  std::function<std::optional<Vertices>()> vertices();  // REQUIRES: num_vertices() was called

  // At least 1.
  SheetId num_sheets() const { return num_sheets_; }
  // Sorts them by sheet, if there are several. All ranks call it, before any of the next is called.
  void sort_facets();
  std::uint64_t num_facets_of(SheetId sheet) const {
    return facets_by_sheet_ ? facets_by_sheet_->of_ranks(sheet).all : num_facets();
  }
  std::uint64_t num_own_facets_of(SheetId sheet) const {
    return facets_by_sheet_ ? facets_by_sheet_->num_own(sheet) : num_own_facets();
  }
  // Places count on from sheet to sheet.
  std::uint64_t first_own_facet_of(SheetId sheet) const;
  std::function<std::optional<Facets>()> facets_of(SheetId sheet, const FacetParts& parts);
  // REQUIRES: num_vertices() was called. Vertices come without positions, and `first` is among
  // those of the sheet.
  std::uint64_t num_vertices_of(SheetId sheet) const {
    return vertices_by_sheet_ ? vertices_by_sheet_->of_ranks(sheet).all : num_vertices_.all;
  }
  std::function<std::optional<Vertices>()> vertices_of(SheetId sheet);

 private:
  // As a leaf lists it.
  struct ListedFacet {
    std::array<std::uint64_t, 3> vertices;  // as BoundaryFacet has them
    FacetLabels labels;
    // The same whichever side it is seen from.
    std::array<std::uint64_t, 3> key() const {
      const auto& [a, b, c] = vertices;
      return {a, std::min(b, c), std::max(b, c)};
    }
  };
  // A leaf's cells, and facets near it by key.
  struct CellsAndFacets {
    std::uint64_t first_cell = 0;
    std::vector<std::array<std::uint32_t, 4>> cells;
    std::vector<std::int64_t> numbers;  // of the vertices
    std::vector<ListedFacet> facets;
  };

  std::vector<ListedFacet> load_facets(std::size_t leaf, NumberWindow& numbers);
  static std::vector<BoundaryFacet> facets_of_cells(const CellsAndFacets& near);
  // For another rank.
  static std::vector<std::uint64_t> flat(std::span<const ListedFacet> facets);
  static std::vector<ListedFacet> facets_in(std::span<const std::uint64_t> values);
  void find_facets(Workers& workers);
  void take_listed_facets();  // the same without cells
  void find_vertices();
  // Of a leaf's list among those of own leaves, one after another, and then of those in `beside`.
  std::optional<std::size_t> place_of_list(std::size_t leaf,
                                           const std::map<std::size_t, std::size_t>& beside) const;
  // That the facets of a leaf's cells name, each with their sheets: see on_sheet().
  std::vector<std::uint64_t> vertices_of_facets(std::size_t leaf) const;
  void complete(const FacetParts& parts, Facets& some);
  std::uint64_t place_of(std::uint64_t vertex);

  const Reader* reader_;
  const VertexNumbering* numbering_;
  VertexPositions* positions_;
  std::filesystem::path output_;
  PageRelease* pages_;
  const StopToken* stop_;
  Exchange& exchange_;
  NumberOfNode number_of_node_;
  SheetId num_sheets_;
  LeafLists<BoundaryFacet> facets_;  // of own leaves
  std::optional<BySheet<BoundaryFacet>> facets_by_sheet_;
  std::vector<std::uint64_t> facets_before_;  // of each sheet, those of lower ones, of all ranks
  std::optional<BySheet<std::uint64_t>> vertices_by_sheet_;
  SumOfRanks num_facets_, num_vertices_;
  // Of own leaves, and then of those beside them that have some.
  std::optional<LeafLists<std::uint64_t>> vertices_;
  std::uint64_t end_own_vertex_ = 0;  // in these lists
  struct Beside {
    std::size_t list = 0;
    std::uint64_t first_place = 0;
  };
  std::map<std::size_t, Beside> vertices_beside_;
  std::optional<LeafWindow<LeafList<std::uint64_t>>> vertices_near_;
};

}  // namespace locvol
