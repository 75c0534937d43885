// VertexNumbering gives the used points of a finished store their numbers in the output;
// NumberWindow looks them up.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/output/leaf_window.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/stored_mesh.h"
#include "engine/output/vertex_copies.h"
#include "engine/shared/partial_file.h"
#include "octree/octree.h"
#include "octree/site_block.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

// Used points (named by some cell) are numbered leaf by leaf in Morton order: in a leaf by id, then
// those of the lattice core, by site. In a run of the surface alone, what is said of cells is true
// of facets, in the order of their vertices' ids in each leaf.
// Where bodies are to share no vertex, each point has a number for each body that has cells with
// it, in the order of these. Points of the core are of one. A cell may name points of any leaf
// within 2λ, so which points of a leaf are used is known only from its neighbors: one pass over the
// store finds it out, and leaves the used ids, in the order of their numbers, in a nameless file of
// 8 bytes per vertex beside the output; of copies, 16. Of several ranks, each numbers its own
// leaves, and is told the numbers of points beside them. What is said of all vertices, cells and
// leaves is then of all ranks, and what is asked of one leaf is known of own ones; of others within
// kCellReach, what numbers need. Leaves beyond stand for all that is there. Memory: 56 bytes per
// leaf, and 16 MB while it is made. Threads: const functions are safe from many threads. Errors:
// StoreError; CorruptRecord when records contradict each other; std::system_error.
class VertexNumbering {
 public:
  // `reader` is used by the constructor only, which throws Stopped.
  // `exchange`: of the ranks that have the run together, which all call it. `sides`: null, or those
  // of several bodies that are to share no vertex; it must outlive this object.
  VertexNumbering(const Reader& reader, const RunRecord& run, const std::filesystem::path& output,
                  PageRelease& pages, const StopToken* stop = nullptr, Exchange& exchange = alone(),
                  const SheetSides* sides = nullptr);

  VertexNumbering(const VertexNumbering&) = delete;
  VertexNumbering& operator=(const VertexNumbering&) = delete;

  bool is_surface_only() const { return is_surface_only_; }
  // Null: each point has one number.
  const SheetSides* sides() const { return sides_; }
  std::span<const MortonKey> leaves() const { return octree_.leaves(); }
  // The rank's own leaves, from `first` to before `end`; and the place of one among all leaves.
  std::size_t first_own() const { return first_own_; }
  std::size_t end_own() const { return end_own_; }
  std::uint64_t place(std::size_t leaf) const { return first_place_ + (leaf - first_own_); }
  std::uint64_t num_vertices() const { return first_vertex_.back(); }
  std::uint64_t num_cells() const { return first_cell_.back(); }
  // Of a leaf; num_leaves: the end.
  std::uint64_t first_vertex(std::size_t leaf) const { return first_vertex_[leaf]; }
  std::uint64_t first_cell(std::size_t leaf) const { return first_cell_[leaf]; }
  // The leaf whose point has this number, and the one that has this cell. REQUIRES: there is one
  std::size_t leaf_of(std::uint64_t vertex) const;
  std::size_t leaf_of_cell(std::uint64_t cell) const;
  bool is_core(std::uint64_t vertex) const { return vertex >= first_core_vertex(leaf_of(vertex)); }
  // The same of any point; -1: it has no number.
  bool is_core(std::uint64_t id, std::int64_t number) const {
    return id < kFirstOtherId && number >= 0 && is_core(static_cast<std::uint64_t>(number));
  }
  // See leaves_near(); `distance`: over the LeafScale
  std::vector<std::size_t> near(std::size_t leaf, double distance) const {
    return leaves_near(octree_, frame_, leaf, distance * scale_.of(leaf));
  }
  // Over which distances from a leaf are.
  double scale(std::size_t leaf) const { return scale_.of(leaf); }
  const Lattice& lattice() const { return lattice_; }
  // The number of a leaf's first point of the core.
  std::uint64_t first_core_vertex(std::size_t leaf) const {
    return first_vertex_[leaf + 1] - num_core_vertices_[leaf];
  }
  std::uint64_t num_core_vertices(std::size_t leaf) const { return num_core_vertices_[leaf]; }
  // As its record counts them.
  std::uint64_t num_core_cells(std::size_t leaf) const { return num_core_cells_[leaf]; }
  SiteBox sites(std::size_t leaf) const { return lattice_.sites_in(frame_.box(leaves()[leaf])); }

  // That hold points which the leaf's cells may name.
  std::vector<std::size_t> neighbors(std::size_t leaf) const { return near(leaf, kCellReach); }
  // Of a leaf's used points but for those of the core, in the order of their numbers: ascending, of
  // copies each as often as there are.
  std::vector<std::uint64_t> used_ids(std::size_t leaf) const;
  // REQUIRES: sides()
  std::vector<VertexCopy> used_copies(std::size_t leaf) const;
  // Where they lie: calls visit(position). `points`: the leaf's
  template <class Visit>
  void for_each_listed(std::size_t leaf, const LeafPoints& points, const Visit& visit) const {
    const std::vector<std::uint64_t> used = used_ids(leaf);
    auto next = used.begin();
    for (const MeshPoint& point : points.points) {
      for (; next != used.end() && *next == point.id; ++next) visit(point.position);
    }
  }
  // Likewise of all, the core's last.
  template <class Visit>
  void for_each_vertex(const Reader& reader, std::size_t leaf, const Visit& visit) const {
    const LeafPoints points = reader.points(leaves()[leaf]);
    for_each_listed(leaf, points, visit);
    const SiteBox all = sites(leaf);
    for_each_core_site(points.core, all, all, [&](const LatticeSite& site, std::uint64_t) {
      visit(lattice_.position(site));
    });
  }

  // Of several ranks, which all call it: list(leaf) of own leaves goes to the ranks within the
  // distance (over the LeafScale), a mebibyte at once; take(leaf, list) gets what others tell.
  using NumbersOf = std::function<std::vector<std::uint64_t>(std::size_t leaf)>;
  using TakeNumbers =
      std::function<void(std::size_t leaf, const std::vector<std::uint64_t>& numbers)>;
  void tell_ranks_beside(const Reader& reader, Exchange& exchange, double distance,
                         const NumbersOf& list, const TakeNumbers& take) const;

 private:
  // Of one leaf: its points, which of them its own cells name, and what else they name.
  struct Names {
    std::vector<std::uint64_t> own;
    std::vector<bool> is_named;
    std::vector<std::uint64_t> foreign;
    std::vector<VertexCopy> own_copies, foreign_copies;  // with sides(), instead of these two
    std::uint64_t num_cells = 0, num_core_points = 0, num_core_cells = 0;

    std::size_t bytes() const {
      return sizeof *this + 8 * (own.capacity() + foreign.capacity()) + is_named.capacity() / 8 +
             sizeof(VertexCopy) * (own_copies.capacity() + foreign_copies.capacity());
    }
  };
  Names load_names(const Reader& reader, PageRelease& pages, std::size_t leaf) const;
  // Both give ids as used_ids() does, or copies as flat().
  std::vector<std::uint64_t> find_used(std::size_t leaf, LeafWindow<Names>& names) const;
  std::vector<std::uint64_t> find_used_copies(std::size_t leaf, LeafWindow<Names>& names) const;
  void check_core(std::size_t leaf, const LatticeCore& core) const;
  // Of so many vertices, from the `first` of the file on.
  std::vector<std::uint64_t> read_words(std::uint64_t first, std::uint64_t count) const;
  void write_words(std::uint64_t first, std::span<const std::uint64_t> words);
  std::size_t words_of_vertex() const { return sides_ == nullptr ? 1 : 2; }
  // Of own leaves, and of those beside them.
  struct Numbered {
    std::uint64_t first_vertex = 0, num_core = 0, first_used = 0, num_used = 0;
  };
  // What cells of other ranks' leaves within reach name.
  void exchange_names(const Reader& reader, PageRelease& pages, Exchange& exchange);
  std::vector<std::pair<std::size_t, Numbered>> numbers_beside(const Reader& reader,
                                                               std::span<const Numbered> own,
                                                               Exchange& exchange);
  void number(std::span<const Numbered> own,
              std::span<const std::pair<std::size_t, Numbered>> beside, std::uint64_t num_all);

  bool is_surface_only_;
  const SheetSides* sides_;
  Frame frame_;
  Lattice lattice_;
  LeafScale scale_;
  LinearOctree octree_;
  OpenFile ids_file_, names_file_;
  // Of leaves beside the rank's own: where in that file are ids that their cells name, how many.
  std::map<std::size_t, std::pair<std::uint64_t, std::uint64_t>> names_beside_;
  std::vector<std::uint64_t> first_vertex_, first_cell_;  // of each leaf, and the end
  std::vector<std::uint64_t> num_core_vertices_, num_core_cells_;
  std::vector<std::uint64_t> first_used_, num_used_;  // in the file
  std::size_t first_own_ = 0, end_own_ = 0;
  std::uint64_t first_place_ = 0;
};

// Memory: 20 MB, divided by `num_shares`, for ids and cores of leaves near the current one, and
// core_numbers().
// Errors: as VertexNumbering.
class NumberWindow {
 public:
  // Both must outlive this object.
  NumberWindow(const Reader& reader, const VertexNumbering& numbering, int num_shares = 1);
  NumberWindow(const NumberWindow&) = delete;
  NumberWindow& operator=(const NumberWindow&) = delete;

  // Numbers of the core's points in the leaf and up to two sites around it, where that has some; -1
  // elsewhere. Takes 8 bytes a site of the leaf's box. Null if the leaf and all around it have
  // none. Valid until the next call of it or of numbers().
  const SiteBlock<std::int64_t>* core_numbers(std::size_t leaf);
  // Of a leaf near one whose numbers were asked for last.
  std::shared_ptr<const LatticeCore> core(std::size_t leaf) {
    const auto held = cores_.get(leaf);
    return {held, &held->core};
  }
  // What a leaf lists, and the numbers of its vertices, -1 if unused or unknown. With sides() these
  // are copies, see vertex_copies.h.
  struct Cells {
    LeafCells cells;
    std::vector<std::int64_t> numbers;
  };
  struct Facets {
    LeafFacets facets;
    std::vector<std::int64_t> numbers;
  };
  // Throws CorruptRecord if a cell names a point without a number.
  Cells cells(std::size_t leaf);
  Facets facets(std::size_t leaf);
  // Of points within 2λ of the leaf, or of the core and up to two sites away: those that have a
  // number, with it. Of copies, each. REQUIRES: ids ascend
  struct Numbered {
    std::size_t place = 0;  // among the ids
    BodyId body = kNoBody;  // of copies
    std::int64_t number = -1;
  };
  std::vector<Numbered> numbered(std::size_t leaf, std::span<const std::uint64_t> ids);
  // That of the point's first copy; without copies, the same.
  std::uint64_t first_copy(std::uint64_t vertex);
  MeshEdge first_copies(const MeshEdge& edge) {
    return edge_between(first_copy(edge.a), first_copy(edge.b));
  }

 private:
  struct Table {
    // Of the leaf's used points, ascending; of copies, all have their bodies.
    std::vector<std::uint64_t> ids;
    std::vector<BodyId> bodies;
    std::size_t bytes() const {
      return sizeof *this + 8 * ids.capacity() + sizeof(BodyId) * bodies.capacity();
    }
  };
  Table load_table(std::size_t leaf) const;
  template <class Visit, class VisitCore>
  void for_each_number(std::size_t leaf, std::span<const std::uint64_t> ids, const Visit& visit,
                       const VisitCore& visit_core);
  // `bodies`: of each, of copies; empty: there are none.
  std::vector<std::int64_t> numbers(std::size_t leaf, std::span<const std::uint64_t> ids,
                                    std::span<const BodyId> bodies);
  struct Core {
    LatticeCore core;
    std::size_t bytes() const { return sizeof *this + sizeof(LatticeRow) * core.rows.capacity(); }
  };

  const Reader* reader_;
  const VertexNumbering* numbering_;
  LeafWindow<Table> tables_;
  LeafWindow<Core> cores_;
  SiteBlock<std::int64_t> core_numbers_;
  std::size_t leaf_of_core_numbers_ = ~std::size_t{0};
  bool has_core_numbers_ = false;
};

}  // namespace locvol
