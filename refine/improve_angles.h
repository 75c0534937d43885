// ImproveAngles restores C7: no cell at an own vertex has a dihedral angle below the bound, nor one
// whose circumcenter lies in the leaf. It moves volume points, one at a time; where that does not
// help it inserts points, and moves surface points along the surface. Internal to refine/.
//
// A change is judged on the cells that it would make, before anything is changed. It is made only
// if C1–C6 hold in these as before, and either no cell of them is below the bound, or fewer are:
// counts of cells below each of a list of angles, compared lexicographically, go down. So the other
// conditions need not be asked again, whoever's points are around, and it ends.
//
// Cost: 60 µs for a cell below the bound (Lucy, 15°).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <queue>
#include <span>
#include <vector>

#include "refine/conditions.h"
#include "refine/leaf.h"
#include "refine/leaf_creases.h"
#include "refine/leaf_mesh.h"
#include "refine/vertex_move.h"

namespace locvol {

class ImproveAngles {
 public:
  // REQUIRES: C1–C6 hold at own vertices, but where they are unresolved
  // All must outlive it.
  using OnStep = std::function<void(const RefineStep&)>;
  // `creases`: null where none are near
  ImproveAngles(const LeafInput& input, const Surroundings& around, const OnStep& on_step,
                LeafMesh& mesh, LeafCreases* creases, LeafDelta& delta);

  // Throws Stopped.
  void run();

 private:
  using Cell = LeafMesh::Cell;
  using Change = Delaunay::Change;
  using NewCell = Delaunay::NewCell;
  using Facet = std::array<LocalIndex, 3>;  // ascending
  static constexpr std::array<double, 6> kFractions{1. / 3, 1. / 2, 2. / 3, 0.8, 0.9, 1};
  static constexpr double kPartOfWall = 0.4;
  static constexpr std::size_t kMuchBelow = 2;  // no cell of a vertex that moves is below this one
  using Counts = std::array<std::uint32_t, kFractions.size()>;  // of cells below these of the bound

  struct Poor {
    double cosine = 0;
    double wall = 0;  // of one that leads across a narrow part, its width over the longest edge
    LeafMesh::CellRef cell;
    std::array<LocalIndex, 4> vertices;  // ascending
    // The worst comes first.
    friend bool operator<(const Poor& a, const Poor& b) {
      return a.cosine != b.cosine ? a.cosine < b.cosine : a.vertices > b.vertices;
    }
  };
  enum class Verdict { kNone, kBetter, kGood };
  // A place of a vertex that makes fewer cells below the bound.
  struct Better {
    Counts counts{};
    LocalIndex vertex = 0;
    Point place;
  };

  void look_at(Cell c);
  bool improve(const Poor& poor);
  bool improve(Cell poor);
  bool improve_on_surface(Cell poor);
  // Lists places for a vertex of a cell, or near it.
  using Lister = void (ImproveAngles::*)(LocalIndex v, Cell poor);
  bool try_places(LocalIndex v, Cell poor, Lister list);
  bool try_better();
  void bound_radii_at(const Point& q);
  bool try_insertions(Cell poor);
  bool take_in_ghosts(const Point& q);
  bool take_in_core(const Point& q);
  // Not at once: it has leaves visited again.
  bool may_meet_core() const { return round_ > 0 && surroundings_.core != nullptr; }
  bool is_left_to_others(Cell poor) const;
  double width_of_wall(Cell c) const;
  bool is_thin(double wall) const;
  // Is a cell much flatter than the wall that it leads across?
  static bool is_flat(double cosine, double wall) {
    return wall > 0 && cosine * cosine * (1 + kPartOfWall * kPartOfWall * wall * wall) > 1;
  }
  void ask_for(double degrees);
  void list_places_in_wall(LocalIndex v, Cell poor);
  void list_sheared_place(LocalIndex v, Cell poor);
  void list_places_along(LocalIndex v, Cell poor);
  bool slide(Cell poor, Lister list);
  bool improve_in_wall(const Poor& poor);
  bool is_movable(LocalIndex v) const;
  std::span<const LocalIndex> movable_around(Cell poor);
  void list_places(LocalIndex v, Cell poor);
  void list_places_in_ball(Cell poor);
  void list_places_on_surface(Cell poor);
  bool put_on_surface(Point& q) const;
  bool may_stand(const Point& q, LocalIndex v);

  // Of cells at a surface point, those outside may have any shape.
  VertexMove::Limits limits() const {
    return is_on_surface(kind_) ? VertexMove::Limits{} : limits_;
  }
  bool is_insertion() const { return change_.vertex == mesh_.num_locals(); }
  Verdict verdict_on(const std::optional<Counts>& made) const;
  bool is_allowed(Verdict verdict);
  bool is_allowed_once_counted(Verdict verdict);
  bool do_samples_hide_as_before() const;
  bool is_gone(Cell c) const;
  bool leaves_poor_to_others() const;
  bool are_cells_good();
  bool makes_poor_inside() const;
  bool are_facets_good();
  bool list_facets();
  bool changes_core();
  bool is_boundary_kept();
  bool are_creases_kept() const;
  bool are_between_their_bodies() const;
  bool are_segments_kept() const;
  bool is_out_of_reach(const NewCell& cell, int off) const;
  bool are_facets_as_round() const;
  bool is_disk_after(LocalIndex v);
  bool is_disk_kept(LocalIndex v);
  bool are_junctions_kept(LocalIndex v, std::span<const LinkEdge> link) const;
  static std::array<BodyId, 2> pair_of(BodyId one, BodyId other) {
    return {std::max(one, other), std::min(one, other)};
  }
  bool is_off_boundary(LocalIndex v, LocalIndex w);
  std::optional<Counts> counts_of_made();
  Counts counts_of_gone() const;
  void count(double cosine, Counts& counts) const;

  void make();
  void tell(RefineStep::Action action, VertexRef ref, const MeshPoint& point) const {
    if (on_step_) on_step_({action, kC7, 0, ref, point.position, point.kind});
  }
  bool note_taken_in();
  // What others list, with its smallest vertex.
  struct OfOthers {
    std::map<CellList::Name, Point> cells;
    std::map<FacetList::Name, Point> facets;
  };
  void note_others(Cell c, OfOthers& changed) const;
  void note_others_facets(Cell c, OfOthers& changed) const;
  void list_poor();
  void note_met_core(Cell c);

  const Point& place(LocalIndex v) const { return mesh_.place(change_, v); }
  Facet facet(const std::array<LocalIndex, 4>& cell, int off) const;

  const LeafInput& input_;
  const Surroundings& surroundings_;
  const OnStep& on_step_;
  LeafMesh& mesh_;
  LeafCreases* creases_;
  SheetId sheet_ = kOnlySheet;  // of the vertex that comes, or moves, if that is on the surface
  LeafDelta& delta_;
  const Bounds bounds_{surroundings_.sizes, input_.criteria.radius_edge_bound};
  VertexMove move_;
  std::array<double, kFractions.size()> cosines_;  // of the angles
  double bound_;                                   // the last of them
  double poor_cosine_;                             // of all that is asked for
  double wall_ = 0;                                // of the cell at hand: see Poor
  VertexMove::Limits limits_;                      // of cells at a volume point that moves or comes
  int round_ = 0;
  std::size_t num_improved_ = 0;
  std::size_t num_improved_on_surface_ = 0, num_failed_on_surface_ = 0;
  std::size_t num_made_in_walls_ = 0, most_made_in_walls_ = 0;  // in this round

  std::priority_queue<Poor> waiting_;
  std::vector<Poor> left_;

  Change change_;
  PointKind kind_ = PointKind::kVolume;  // of its vertex
  std::vector<LeafMesh::Prospect> prospects_;
  std::vector<Better> better_;

  OfOthers others_gone_, others_made_;
  std::vector<Point> places_;
  std::vector<LocalIndex> movable_;
  std::vector<Facet> facets_gone_, facets_made_;  // of the boundary
  const bool has_bodies_ = !surroundings_.domain.only_body();
  std::map<Facet, std::array<BodyId, 2>> bodies_at_;  // of these, where there are several
  struct FacetToJudge {
    std::uint32_t made = 0;  // place of a cell that comes
    int index = 0;           // the facet's, in it
    bool is_on_boundary = false;
  };
  std::vector<FacetToJudge> facets_to_judge_;
  std::vector<MeshPoint> near_;  // taken in
  std::vector<std::uint64_t> met_core_;
  std::vector<Cell> around_;
  std::vector<LeafMesh::Facet> star_;
};

}  // namespace locvol
