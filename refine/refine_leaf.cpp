#include "refine/refine_leaf.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <deque>
#include <numbers>
#include <numeric>
#include <set>
#include <span>
#include <utility>
#include <variant>

#include "octree/site_block.h"
#include "octree/sort_and_unite.h"
#include "refine/conditions.h"
#include "refine/domain/closest_point.h"
#include "refine/improve_angles.h"
#include "refine/leaf_creases.h"
#include "refine/leaf_mesh.h"
#include "refine/mirror.h"
#include "refine/revisit.h"

namespace locvol {
namespace {

using Cell = LeafMesh::Cell;
using CellRef = LeafMesh::CellRef;
using Facet = LeafMesh::Facet;

// A facet with both its cells as they were when it was looked at: its dual edge is theirs.
struct FacetRef {
  CellRef here, there;
  int index = 0;
  Facet facet() const { return {here.cell, index}; }
};

// The names of what the items' numbers are numbers of, ascending: from now on these are places
// among them. `vertices_of`: of an item, the numbers; they are below `bound`
template <class Item, class VerticesOf, class NameOf>
std::vector<VertexRef> names_in_use(std::vector<Item>& items, const VerticesOf& vertices_of,
                                    std::size_t bound, const NameOf& name_of) {
  constexpr auto kUnused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> place(bound, kUnused);
  std::vector<std::pair<VertexRef, std::uint32_t>> used;
  for (Item& item : items)
    for (const std::uint32_t v : vertices_of(item))
      if (std::exchange(place[v], 0) == kUnused) used.emplace_back(name_of(v), v);
  std::ranges::sort(used);
  std::vector<VertexRef> names;
  names.reserve(used.size());
  for (const auto& [name, v] : used) {
    place[v] = static_cast<std::uint32_t>(names.size());
    names.push_back(name);
  }
  for (Item& item : items)
    for (std::uint32_t& v : vertices_of(item)) v = place[v];
  return names;
}

// Vertices ascending as far as the orientation permits, cells ascending: the same list from the
// same set of cells, whose vertices are below `bound`.
void bring_into_order(std::vector<MeshCell>& cells, std::size_t bound) {
  for (MeshCell& cell : cells) sort_oriented(cell.vertices);
  // By the second vertex and then the first, which leaves few with the same two.
  std::vector<MeshCell> sorted(cells.size());
  std::vector<std::uint32_t> next(bound + 1);  // place of the next cell by one of its vertices
  for (const std::size_t k : {1, 0}) {
    std::ranges::fill(next, 0);
    for (const MeshCell& cell : cells) ++next[cell.vertices[k] + 1];
    std::partial_sum(next.begin(), next.end(), next.begin());
    for (const MeshCell& cell : cells) sorted[next[cell.vertices[k]]++] = cell;
    cells.swap(sorted);
  }
  for (std::size_t end = 0; end < cells.size();) {
    const std::size_t begin = end;
    const auto& first = cells[begin].vertices;
    while (end < cells.size() && cells[end].vertices[0] == first[0] &&
           cells[end].vertices[1] == first[1])
      ++end;
    std::sort(cells.begin() + std::ptrdiff_t(begin), cells.begin() + std::ptrdiff_t(end));
  }
}

std::string place_of(const Box& leaf) {
  const auto& [a, b] = leaf;
  return fmt::format(" in the leaf ({}, {}, {}) to ({}, {}, {})", a.x, a.y, a.z, b.x, b.y, b.z);
}

// The insertion rule deletes volume points within λ of a new surface point. Where surface balls are
// small already, so much less: within this many of their radii, or of each point inserted between
// two close sheets all that had been graded around would have to come again.
constexpr double kCleared = 2;

class Refinement {
 public:
  using OnStep = std::function<void(const RefineStep&)>;
  // All must outlive it.
  Refinement(const LeafInput& input, const Surroundings& around, const OnStep& on_step,
             LeafMesh::OwnPoints own)
      : input_(input), surroundings_(around), on_step_(on_step), mesh_(input, around, own) {
    if (!around.are_sides_apart) return;
    creases_.emplace(around.domain, mesh_, around.crease_points, input.criteria.size);
    num_told_ = mesh_.num_locals();
  }

  void restore();                                    // C1–C6
  const LeafDelta& delta() const { return delta_; }  // so far
  LeafDelta finish();                                // restores C7, and lists what there is

 private:
  enum class Outcome { kChanged, kBlocked };

  // What may be violated, by condition: first come, first served. The last come first would stay in
  // one place and pile up points there: twice as many for C6 between the folds of a rough surface.
  template <class Ref>
  using Waiting = std::array<std::deque<Ref>, kC6 + 1>;
  template <class Ref>
  using Cure = Outcome (Refinement::*)(const Ref&, Condition condition);

  bool restore_next();
  bool is_alive(const CellRef& ref) const { return mesh_.is_alive(ref); }
  bool is_alive(const FacetRef& ref) const { return is_alive(ref.here) && is_alive(ref.there); }
  template <class Ref>
  std::optional<Ref> pop_alive(std::deque<Ref>& waiting) const;
  template <class Ref>
  bool restore_next(Waiting<Ref>& waiting, Condition condition, Cure<Ref> cure);
  bool restore_next_disk();
  bool restore_next_crease();
  bool insert_next_mirror();
  void note_mirrors(const Point& q, Condition condition);
  Outcome restore_segments(LocalIndex v);
  Outcome halve(const LeafCreases::Segment& segment, const std::optional<Point>& q,
                Condition condition);
  void tell_creases();
  bool keeps_sheets(LocalIndex v, std::span<const LinkEdge> link);
  std::array<BodyId, 2> bodies_at(const Facet& f) const;
  bool is_between_its_bodies(const Facet& f) const;
  bool has_several_pairs(std::span<const Facet> star) const;
  void look_at_fresh_cells();
  void look_at(Cell cell, bool is_boundary_changed);
  void look_at(Facet facet);
  void look_at_vertex(LocalIndex v);
  void pass_disks();

  Outcome restore_facet(const FacetRef& facet, Condition condition);
  Outcome restore_disk(LocalIndex v);
  Outcome restore_lost_part(LocalIndex v);
  const PointCubes& corners();
  void start_from_corners();
  Outcome restore_open_end(const FacetRef& facet, Condition condition);
  Outcome restore_cell(const CellRef& cell, Condition condition);

  bool is_disk(LocalIndex v, std::vector<Facet>& star);
  bool is_on_crease(LocalIndex v) const { return mesh_.local(v).point.kind == PointKind::kCrease; }
  Outcome insert_on_surface(const Point& q, Condition condition, Cell hint,
                            PointKind kind = PointKind::kSurface);
  Outcome insert_in_volume(const Point& q, Condition condition, Cell hint);
  bool take_in_missing(const Point& q, Cell hint) {
    return take_in_unloaded(q, hint) || take_in_ghosts(q, hint) || take_in_core(q, hint);
  }
  bool take_in_unloaded(const Point& q, Cell hint);
  bool take_in_ghosts(const Point& q, Cell hint);
  bool take_in_core(const Point& q, Cell hint);
  void note_taken_in(const MeshPoint& p);
  struct SurfaceBall {
    Point center;
    double radius = 0;
    Cell cell = LeafMesh::kNoCell;  // of its facet
  };
  std::optional<SurfaceBall> encroached_ball(const Point& q) const;
  VertexRef new_point(const Point& q, PointKind kind, Condition condition);
  void insert(const Point& q, PointKind kind, Condition condition);
  std::optional<std::vector<Point>> others_changed(const Point& q) const;
  void forget_changed();
  void delete_volume_points_near(const Point& q);
  // By a point closer than the spacing floor, or than a distance; leaving_ does not count.
  bool is_blocked(const Point& q) const { return is_blocked(q, floor_at(q)); }
  bool is_blocked(const Point& q, double distance) const;
  double floor_at(const Point& q) const {
    return mesh_.scaled(input_.criteria.spacing_floor, surroundings_.sizes.on_surface_at(q));
  }
  // How far from the leaf all is known around a place of the surface where h is `size`: closer than
  // that to it, it is not much smaller.
  double loaded_around(double size) const {
    const double least = surroundings_.sizes.has_shapes() ? 1 - surroundings_.sizes.growth() : 1;
    return least * mesh_.scaled(input_.criteria.reach, size);
  }
  bool is_in_fold(const Point& q) const;
  bool is_in_fold(Facet f) const;  // all of its vertices are
  bool is_overfull() const {
    return input_.max_own_points > 0 && mesh_.num_own() > input_.max_own_points;
  }

  void tell(RefineStep::Action action, int condition, VertexRef ref, const MeshPoint& point) const {
    if (on_step_) on_step_({action, condition, attempt_.radius, ref, point.position, point.kind});
  }
  void tell_blocked() const {
    tell(RefineStep::Action::kBlocked, attempt_.condition, 0, {0, attempt_.position, {}});
  }

  void list_unresolved();
  // Lists of cells hold local indices, and behind those indices into `core`, ids of core points.
  using Cells = std::vector<MeshCell>;
  void list_cells();
  void list_facets();
  void list_triangulated_cells(Cells& cells) const;
  void list_cells_at_core(Cells& cells, std::vector<std::uint64_t>& core) const;
  bool is_met(std::uint64_t id) const { return std::ranges::binary_search(delta_.met_core, id); }
  [[noreturn]] void throw_unchanged() const;
  std::string place() const { return place_of(input_.box); }

  const LeafInput& input_;
  const Surroundings& surroundings_;
  const OnStep& on_step_;
  const bool is_surface_only_ = input_.criteria.is_surface_only;
  const Bounds bounds_{surroundings_.sizes, input_.criteria.radius_edge_bound};
  LeafMesh mesh_;
  std::optional<LeafCreases> creases_;  // null: sides are not told apart
  std::size_t num_told_ = 0;            // locals that creases_ knows
  LeafDelta delta_;
  std::uint64_t num_insertions_ = 0;

  Waiting<FacetRef> facets_;
  Waiting<CellRef> cells_;
  std::vector<LocalIndex> c3_;  // vertices that may break it: the last come first
  std::vector<bool> is_in_c3_;
  std::vector<LocalIndex> c0_;  // likewise
  std::vector<bool> is_in_c0_;
  std::vector<LeafCreases::Segment> segments_;
  struct Mirror {
    Point position;
    Condition condition = kC3;  // for which its point came
    double distance = 0;        // between the two
  };
  std::deque<Mirror> mirrors_;  // of points on sheets that were inserted

  // Violations whose cure the spacing floor forbade when it was tried.
  struct Blocked {
    std::variant<FacetRef, CellRef, LocalIndex> where;
    Violation violation;
  };
  std::vector<Blocked> blocked_;
  Violation attempt_;  // the last insertion that was tried

  LeafMesh::Conflict conflict_;
  std::vector<Facet> star_;
  std::vector<LinkEdge> link_;
  std::vector<Point> corners_;
  std::optional<PointCubes> corner_cubes_;  // once they are asked for
  std::vector<MeshPoint> near_;             // taken in before an insertion
  std::vector<LocalIndex> leaving_;         // deleted by the insertion at hand
  StopPoll poll_{surroundings_.stop, 8};    // of restore_next()
};

template <class Ref>
std::optional<Ref> Refinement::pop_alive(std::deque<Ref>& waiting) const {
  while (!waiting.empty()) {
    const Ref next = waiting.front();
    waiting.pop_front();
    if (is_alive(next)) return next;
  }
  return std::nullopt;
}

void Refinement::restore() {
  if (!mesh_.has_cells()) start_from_corners();
  if (!is_overfull() && mesh_.has_cells())
    while (!is_overfull() && restore_next()) {
    }
  delta_.is_overfull = is_overfull();
  forget_changed();
}

LeafDelta Refinement::finish() {
  tell_creases();
  if (!delta_.is_overfull && mesh_.has_cells() && input_.criteria.min_dihedral > 0)
    ImproveAngles(input_, surroundings_, on_step_, mesh_, creases_ ? &*creases_ : nullptr, delta_)
        .run();
  sort_and_unite(delta_.met_core);
  delta_.stats.cells_made = mesh_.num_cells_made();
  if (!delta_.is_overfull) {
    if (mesh_.has_cells()) list_unresolved();
    if (!is_surface_only_) list_cells();
    if (mesh_.has_cells()) list_facets();
  }
  return std::move(delta_);
}

// What came and went again may have stood between others.
void Refinement::forget_changed() {
  if (std::ranges::none_of(delta_.inserted, &InsertedPoint::is_deleted)) return;
  for (InsertedPoint& p : delta_.inserted) p.changed.reset();
}

// The conditions in priority order: the first one broken names the next point. False if none is.
// Where the domain has no points, cells are far and in no mesh, so that its boundary looks torn:
// these holes are filled before disks are judged.
bool Refinement::restore_next() {
  poll_();
  look_at_fresh_cells();
  return insert_next_mirror() || restore_next_crease() ||
         restore_next(facets_, kC1, &Refinement::restore_facet) ||
         restore_next(facets_, kC2, &Refinement::restore_facet) ||
         restore_next(facets_, kC5, &Refinement::restore_open_end) || restore_next_disk() ||
         restore_next(facets_, kC4, &Refinement::restore_facet) ||
         restore_next(cells_, kC5, &Refinement::restore_cell) ||
         restore_next(cells_, kC6, &Refinement::restore_cell);
}

// What survives its cure (the center of a surface ball was inserted in its place) is tried again.
template <class Ref>
bool Refinement::restore_next(Waiting<Ref>& waiting, Condition condition, Cure<Ref> cure) {
  const auto ref = pop_alive(waiting[condition]);
  if (!ref) return false;
  const std::size_t num_before = mesh_.num_locals();
  if ((this->*cure)(*ref, condition) == Outcome::kBlocked) {
    blocked_.push_back({*ref, attempt_});
    tell_blocked();
  } else if (is_alive(*ref)) {
    if (mesh_.num_locals() == num_before) throw_unchanged();
    waiting[condition].push_back(*ref);
  }
  return true;
}

bool Refinement::restore_next_disk() {
  if (c3_.empty()) return false;
  const LocalIndex v = c3_.back();
  c3_.pop_back();
  is_in_c3_[v] = false;
  if (restore_disk(v) == Outcome::kBlocked) {
    blocked_.push_back({v, attempt_});
    tell_blocked();
  }
  return true;
}

// Whatever comes on a sheet comes with its mirrors, as far as this visit inserts.
void Refinement::note_mirrors(const Point& q, Condition condition) {
  const double size = surroundings_.sizes.on_surface_at(q);
  const double farthest = mesh_.scaled(kInsertion * input_.criteria.size, size);
  for_each_in_orbit(surroundings_.domain, q, kMirrorReach * size, kMirrorDistance * size,
                    [&](const MirrorPoint& mirror, const Point& of) {
                      if (input_.box.squared_distance(mirror.position) > farthest * farthest)
                        return false;
                      mirrors_.push_back({mirror.position, condition, norm(mirror.position - of)});
                      return true;
                    });
}

// One that lies in the ball on a segment, or close to another point (kMirrorTolerance), is not
// needed.
bool Refinement::insert_next_mirror() {
  while (!mirrors_.empty()) {
    const auto [q, condition, distance] = mirrors_.front();
    tell_creases();
    const Cell hint = mesh_.delaunay().newest_cell();
    const bool is_kept_out = creases_->segment_at(q).has_value();
    if (!is_kept_out && take_in_missing(q, hint)) return true;
    mirrors_.pop_front();
    if (is_kept_out) continue;
    mesh_.find_conflict(q, hint, conflict_);
    attempt_ = {condition, q, 0};
    const double close = std::max(floor_at(q), kMirrorTolerance * distance);
    mesh_.volume_points_near(q, close, leaving_);
    if (is_blocked(q, close)) continue;
    delete_volume_points_near(q);
    insert(q, PointKind::kSurface, condition);
    return true;
  }
  return false;
}

// A crease point that stands in no one's ball has all of its segments in the triangulation.
bool Refinement::restore_next_crease() {
  if (c0_.empty()) return false;
  const LocalIndex v = c0_.back();
  c0_.pop_back();
  is_in_c0_[v] = false;
  if (restore_segments(v) == Outcome::kBlocked) {
    blocked_.push_back({v, attempt_});
    tell_blocked();
  }
  return true;
}

// ---- Looking for violations ---------------------------------------------------------------------

void Refinement::look_at_fresh_cells() {
  tell_creases();
  const auto& fresh = mesh_.fresh_cells();
  if (fresh.empty()) return;
  const bool is_boundary_changed = mesh_.is_boundary_changed();
  StopPoll poll(surroundings_.stop);
  for (std::size_t n = 0; n < fresh.size(); ++n) {
    poll();
    if (is_alive(fresh[n])) look_at(fresh[n].cell, is_boundary_changed);
  }
  if (mesh_.are_all_fresh()) pass_disks();
  mesh_.clear_fresh_cells();
}

// Takes vertices that meet C3 off its list, of a triangulation just built: to look at all boundary
// facets once is far less work than at all cells around each vertex.
void Refinement::pass_disks() {
  const Delaunay& delaunay = mesh_.delaunay();
  std::vector<std::pair<LocalIndex, LinkEdge>> found;           // with the vertex
  std::vector<std::uint32_t> first(mesh_.num_locals() + 2, 0);  // of a vertex, in `edges`
  std::vector<LocalIndex> elsewhere;  // with a facet that is not where the surface parts its bodies
  for (const auto& [cell, stamp] : mesh_.fresh_cells()) {
    if (!mesh_.is_member(cell)) continue;
    const unsigned corners = mesh_.state(cell).own & mesh_.state(cell).on_surface;
    for (int i = 0; i < 4 && corners != 0; ++i) {
      if (!mesh_.is_behind(Facet{cell, i})) continue;
      const bool is_between = is_between_its_bodies({cell, i});
      for (int at = 0; at < 4; ++at) {
        if (at == i || (corners >> at & 1) == 0) continue;
        const LocalIndex v = delaunay.vertex(cell, at);
        found.emplace_back(v, link_edge(delaunay.vertices(cell), i, v));
        ++first[v + 2];
        if (!is_between) elsewhere.push_back(v);
      }
    }
  }
  std::partial_sum(first.begin(), first.end(), first.begin());
  std::vector<LinkEdge> edges(found.size());
  for (const auto& [v, edge] : found) edges[first[v + 1]++] = edge;

  sort_and_unite(elsewhere);
  std::erase_if(c3_, [&](LocalIndex v) {
    if (std::ranges::binary_search(elsewhere, v)) return false;
    const std::span link(edges.data() + first[v], edges.data() + first[v + 1]);
    if (link.empty() || judge(StarView{link}) || !keeps_sheets(v, link)) return false;
    is_in_c3_[v] = false;
    return true;
  });
}

void Refinement::look_at(Cell cell, bool is_boundary_changed) {
  for (int i = 0; i < 4; ++i) {
    const CellState& state = mesh_.state(cell);
    if (creases_ && (state.own & state.on_surface) >> i & 1) {
      const LocalIndex v = mesh_.delaunay().vertex(cell, i);
      if (is_in_c0_.size() < mesh_.num_locals()) is_in_c0_.resize(mesh_.num_locals());
      if (is_on_crease(v) && !is_in_c0_[v]) {
        is_in_c0_[v] = true;
        c0_.push_back(v);
      }
    }
    if (is_boundary_changed && (state.own & state.on_surface) >> i & 1)
      look_at_vertex(mesh_.delaunay().vertex(cell, i));
    if ((state.facets_seen >> i & 1) == 0 && mesh_.has_own_vertex(Facet{cell, i}) &&
        !mesh_.is_hidden(Facet{cell, i}))
      look_at(Facet{cell, i});
  }
  if (is_surface_only_ || !mesh_.is_member(cell) || mesh_.is_hollow(cell)) return;
  if (const auto broken = judge(mesh_.view(cell), bounds_);
      broken && !(broken == kC6 && creases_ &&
                  creases_->is_exempt(mesh_.delaunay().vertices(cell), mesh_.corners(cell))))
    cells_[*broken].push_back(mesh_.ref(cell));
}

void Refinement::look_at(Facet facet) {
  const Delaunay& delaunay = mesh_.delaunay();
  const Cell here = facet.cell, there = delaunay.neighbor(here, facet.index);
  mesh_.note_facet_seen(facet);
  mesh_.note_facet_seen({there, delaunay.index_of_neighbor(there, here)});
  if (delaunay.is_infinite(facet)) return;
  const FacetView view = mesh_.view(facet);
  const FacetRef ref{mesh_.ref(here), mesh_.ref(there), facet.index};
  if (const auto broken = judge_end(view); broken && !is_surface_only_)
    facets_[*broken].push_back(ref);
  if (const auto broken = judge(view, bounds_)) facets_[*broken].push_back(ref);
}

void Refinement::look_at_vertex(LocalIndex v) {
  if (!is_on_surface(mesh_.local(v).point.kind) || !mesh_.local(v).is_own) return;
  if (is_in_c3_.size() < mesh_.num_locals()) is_in_c3_.resize(mesh_.num_locals());
  if (is_in_c3_[v]) return;
  is_in_c3_[v] = true;
  c3_.push_back(v);
}

// Whether the boundary facets at v (in `star`) meet C3.
bool Refinement::is_disk(LocalIndex v, std::vector<Facet>& star) {
  mesh_.boundary_at(v, star);
  link_.clear();
  for (const Facet& f : star)
    link_.push_back(link_edge(mesh_.delaunay().vertices(f.cell), f.index, v));
  if (!std::ranges::all_of(star, [&](const Facet& f) { return is_between_its_bodies(f); }))
    return false;
  if (surroundings_.domain.only_body() || !has_several_pairs(star))
    return !judge(StarView{link_}) && keeps_sheets(v, link_);
  std::vector<BodyLinkEdge> link;
  for (std::size_t n = 0; n < star.size(); ++n) link.push_back({link_[n], bodies_at(star[n])});
  return !judge(BodyStarView{link}) && keeps_sheets(v, link_);
}

std::array<BodyId, 2> Refinement::bodies_at(const Facet& f) const {
  return {mesh_.body(f.cell), mesh_.body(mesh_.delaunay().neighbor(f.cell, f.index))};
}

// Do all of its vertices lie where the surface parts its bodies? Where balls are larger than bodies
// are wide, a dual edge may lead through all of one that none of its facets is of.
bool Refinement::is_between_its_bodies(const Facet& f) const {
  if (surroundings_.domain.only_body()) return true;
  const std::array<BodyId, 2> bodies = bodies_at(f);
  for (int i = 0; i < 4; ++i)
    if (i != f.index && !mesh_.is_between(mesh_.delaunay().vertex(f.cell, i), bodies)) return false;
  return true;
}

// Do some of the facets part other bodies than the first?
bool Refinement::has_several_pairs(std::span<const Facet> star) const {
  return std::ranges::any_of(
      star, [&](const Facet& f) { return bodies_at(f) != bodies_at(star.front()); });
}

// Do all facets at v lie on one sheet each, and has v its neighbors on creases, with as many facets
// as triangles of the surface meet there? Elsewhere two do. `link`: of these facets.
bool Refinement::keeps_sheets(LocalIndex v, std::span<const LinkEdge> link) {
  if (!creases_ || link.empty()) return true;
  for (const auto& [a, b] : link)
    if (!creases_->have_common_sheet(v, a, b)) return false;
  creases_->segments(v, segments_);
  const auto num_at = [&](LocalIndex w) {
    return std::ranges::count_if(link, [&](const LinkEdge& e) { return e.a == w || e.b == w; });
  };
  if (!creases_->has_junctions())
    return std::ranges::all_of(
        segments_, [&](const LeafCreases::Segment& segment) { return num_at(segment.b) > 0; });
  std::size_t num_at_creases = 0, num_ends = 0;  // more than two of an end
  for (const LeafCreases::Segment& segment : segments_) {
    const auto num = static_cast<std::size_t>(num_at(segment.b)),
               num_sides = creases_->num_sides(segment);
    if (num == 0 || (num_sides > 0 && num != num_sides)) return false;
    if (num > 2) num_at_creases += num;
  }
  for (const auto& [a, b] : link)
    for (const LocalIndex w : {a, b}) num_ends += num_at(w) > 2;
  return num_ends == num_at_creases;
}

void Refinement::tell_creases() {
  if (!creases_) return;
  for (; num_told_ < mesh_.num_locals(); ++num_told_)
    creases_->add(static_cast<LocalIndex>(num_told_));
}

// ---- Restoring ----------------------------------------------------------------------------------

Refinement::Outcome Refinement::restore_facet(const FacetRef& ref, Condition condition) {
  const auto dual = mesh_.dual_crossings(ref.facet());
  attempt_ = {condition, dual.ball_center, std::sqrt(dual.squared_radius)};
  if (condition == kC4 && is_in_fold(dual.ball_center) && is_in_fold(ref.facet()))
    return Outcome::kBlocked;
  return insert_on_surface(dual.ball_center, condition, ref.here.cell);
}

// Gabriel's condition: no vertex lies in the smallest ball around the segment.
Refinement::Outcome Refinement::restore_segments(LocalIndex v) {
  tell_creases();
  creases_->segments(v, segments_);
  const std::vector<LeafCreases::Segment> segments = segments_;
  for (const LeafCreases::Segment& segment : segments) {
    const Point &a = mesh_.local(segment.a).point.position,
                &b = mesh_.local(segment.b).point.position;
    const Point middle = 0.5 * (a + b);
    mesh_.find_conflict(middle, mesh_.delaunay().cell_of(v), conflict_);
    if (conflict_.nearest == segment.a || conflict_.nearest == segment.b ||
        4 * conflict_.squared_distance >= squared_distance(a, b))
      continue;
    const Point q = mesh_.local(conflict_.nearest).point.position;
    attempt_ = {kC3, middle, 0.5 * std::sqrt(squared_distance(a, b))};
    const Outcome outcome = halve(segment, q, kC3);
    if (outcome == Outcome::kBlocked) return outcome;
    if (!is_in_c0_[v]) {
      is_in_c0_[v] = true;
      c0_.push_back(v);
    }
    return outcome;
  }
  return Outcome::kChanged;
}

// Creases more acute than this are not halved: it would go on down to the spacing floor.
constexpr double kHalvedAngle = 25 * std::numbers::pi / 180;

Refinement::Outcome Refinement::halve(const LeafCreases::Segment& segment,
                                      const std::optional<Point>& q, Condition condition) {
  if (segment.a == kInfiniteVertex || segment.b == kInfiniteVertex ||
      creases_->angle(segment) < kHalvedAngle)
    return Outcome::kBlocked;
  attempt_.position = creases_->halved(segment, q);
  return insert_on_surface(attempt_.position, condition, mesh_.delaunay().cell_of(segment.a),
                           PointKind::kCrease);
}

Refinement::Outcome Refinement::restore_disk(LocalIndex v) {
  if (is_disk(v, star_)) return star_.empty() ? restore_lost_part(v) : Outcome::kChanged;
  // Facets that are not where the surface parts their bodies come first.
  const auto first_of_others = std::ranges::stable_partition(star_, [&](const Facet& f) {
                                 return !is_between_its_bodies(f);
                               }).begin();
  DualCrossings largest;
  Cell hint = LeafMesh::kNoCell;
  const auto look_at_balls = [&](std::span<const Facet> facets) {
    for (const Facet& f : facets) {
      const auto dual = mesh_.dual_crossings(f);
      if (dual.count > 0 &&
          (hint == LeafMesh::kNoCell || dual.squared_radius > largest.squared_radius)) {
        largest = dual;
        hint = f.cell;
      }
    }
  };
  look_at_balls({star_.begin(), first_of_others});
  if (hint == LeafMesh::kNoCell) look_at_balls({first_of_others, star_.end()});
  attempt_ = {kC3, mesh_.local(v).point.position, 0};
  if (hint == LeafMesh::kNoCell) return Outcome::kBlocked;
  attempt_ = {kC3, largest.ball_center, std::sqrt(largest.squared_radius)};
  if (is_in_fold(mesh_.local(v).point.position) && is_in_fold(largest.ball_center))
    return Outcome::kBlocked;
  const Outcome outcome = insert_on_surface(largest.ball_center, kC3, hint);
  // Again: where points of P were missing, only those came, perhaps far from v.
  if (outcome == Outcome::kChanged) look_at_vertex(v);
  return outcome;
}

// No facet at v. Near a sharp edge that is harmless, but a small part of the surface may lie
// within v's Voronoi cell as a whole, and would be missing from the mesh: then some of its
// corners do, and the farthest one starts to unfold it. A vertex on a crease, which is to be kept,
// is missing as a part is.
Refinement::Outcome Refinement::restore_lost_part(LocalIndex v) {
  const Point p = mesh_.local(v).point.position;
  const double size = surroundings_.sizes.on_surface_at(p), floor = floor_at(p);
  const auto q = mesh_.farthest_in_voronoi_cell(v, corners(), floor, size);
  attempt_ = {kC3, p, 0};
  if (!q) return is_on_crease(v) ? Outcome::kBlocked : Outcome::kChanged;
  attempt_ = {kC3, *q, std::sqrt(squared_distance(p, *q))};
  const Outcome outcome = insert_on_surface(*q, kC3, mesh_.delaunay().cell_of(v));
  if (outcome == Outcome::kBlocked) return outcome;
  look_at_vertex(v);  // again, and the new one: nothing else might have changed
  look_at_vertex(static_cast<LocalIndex>(mesh_.num_locals() - 1));
  return outcome;
}

// Of all of the surface that is loaded.
const PointCubes& Refinement::corners() {
  if (corner_cubes_) return *corner_cubes_;
  constexpr double kMostCubes = 64;  // in a row
  const std::vector<Point> all = surroundings_.domain.vertices();
  const Box& region = surroundings_.domain.region();
  return corner_cubes_.emplace(region, input_.criteria.size, kMostCubes, all);
}

// Too few points for a cell, but some on the surface: corners of it within λ, each the farthest
// from all points so far, until there is one. Around a corner farther away points of P might be
// unknown, and it one of them.
void Refinement::start_from_corners() {
  std::set<Point> corners;
  for (LocalIndex i = 0; i < mesh_.num_locals(); ++i) {
    if (!is_on_surface(mesh_.local(i).point.kind) || !mesh_.local(i).is_own) continue;
    const Point& p = mesh_.local(i).point.position;
    const double size = surroundings_.sizes.on_surface_at(p);
    surroundings_.domain.vertices_near(p, size, corners_);
    for (const Point& q : corners_)
      if (squared_distance(p, q) < size * size) corners.insert(q);
  }
  const auto distance = [&](const Point& q) {
    double least = std::numeric_limits<double>::infinity();
    for (LocalIndex i = 0; i < mesh_.num_locals(); ++i)
      least = std::min(least, squared_distance(mesh_.local(i).point.position, q));
    return least;
  };
  while (!mesh_.has_cells() && !corners.empty()) {
    throw_if_stopped(surroundings_.stop);
    const auto farthest = std::ranges::max_element(corners, {}, distance);
    const double floor = floor_at(*farthest);
    if (distance(*farthest) <= floor * floor) return;
    const VertexRef ref = new_point(*farthest, PointKind::kSurface, kC3);
    mesh_.insert_first({ref, *farthest, PointKind::kSurface}, ref);
    corners.erase(farthest);
  }
}

// A dual edge that is still inside where balls are no longer known to be empty: its end is a
// point of the domain farther than λ from P.
Refinement::Outcome Refinement::restore_open_end(const FacetRef& ref, Condition condition) {
  const auto dual = mesh_.dual_crossings(ref.facet());
  if (!dual.open_end) return Outcome::kChanged;
  attempt_ = {condition, *dual.open_end, dual.open_radius};
  return insert_in_volume(*dual.open_end, condition, ref.here.cell);
}

Refinement::Outcome Refinement::restore_cell(const CellRef& ref, Condition condition) {
  const CellBall ball = mesh_.ball(ref.cell);  // the cell's own goes with it
  attempt_ = {condition, ball.center, std::sqrt(ball.squared_radius)};
  return insert_in_volume(ball.center, condition, ref.cell);
}

// The insertion rule (refine/ALGORITHM.md) begins with points of P that this visit had not loaded.
bool Refinement::take_in_unloaded(const Point& q, Cell hint) {
  if (surroundings_.points == nullptr) return false;
  const auto is_deleted = [&](std::uint64_t id) {
    return std::ranges::any_of(delta_.deleted, [&](const MeshPoint& p) { return p.id == id; });
  };
  const auto s = surroundings_.points->nearest(q, input_.criteria.size, is_deleted);
  if (!s || mesh_.is_known(s->id)) return false;
  mesh_.find_conflict(q, hint, conflict_);
  if (conflict_.squared_distance <= squared_distance(s->position, q)) return false;
  mesh_.find_conflict(s->position, hint, conflict_);
  mesh_.insert(*s, s->id, conflict_);
  note_taken_in(*s);
  return true;
}

// The same for ghosts that are within reach of q, and of no own point so far.
bool Refinement::take_in_ghosts(const Point& q, Cell hint) {
  mesh_.take_in_ghosts(q, hint, near_);
  for (const MeshPoint& p : near_) note_taken_in(p);
  return !near_.empty();
}

// The same for the lattice core.
bool Refinement::take_in_core(const Point& q, Cell hint) {
  mesh_.take_in_core(q, hint, near_);
  for (const MeshPoint& p : near_) note_taken_in(p);
  return !near_.empty();
}

void Refinement::note_taken_in(const MeshPoint& p) {
  ++delta_.stats.points_added;
  tell(RefineStep::Action::kTakeIn, attempt_.condition, p.id, p);
}

Refinement::Outcome Refinement::insert_on_surface(const Point& q, Condition condition, Cell hint,
                                                  PointKind kind) {
  if (creases_ && kind == PointKind::kSurface) {
    tell_creases();
    if (const auto segment = creases_->segment_at(q))
      return halve(*segment, std::nullopt, condition);
  }
  if (take_in_missing(q, hint)) return Outcome::kChanged;
  mesh_.find_conflict(q, hint, conflict_);
  mesh_.volume_points_near(q, std::min(input_.criteria.size, kCleared * attempt_.radius), leaving_);
  if (is_blocked(q)) return Outcome::kBlocked;
  delete_volume_points_near(q);
  insert(q, kind, condition);
  if (creases_ && kind == PointKind::kSurface) note_mirrors(q, condition);
  return Outcome::kChanged;
}

Refinement::Outcome Refinement::insert_in_volume(const Point& q, Condition condition, Cell hint) {
  if (take_in_missing(q, hint)) return Outcome::kChanged;
  mesh_.find_conflict(q, hint, conflict_);
  if (const auto ball = encroached_ball(q)) {
    attempt_.position = ball->center;
    attempt_.radius = ball->radius;
    return insert_on_surface(ball->center, condition, ball->cell);
  }
  if (creases_) {
    tell_creases();
    if (const auto segment = creases_->segment_at(q))
      return condition == kC6 ? Outcome::kBlocked : halve(*segment, std::nullopt, condition);
  }
  leaving_.clear();
  if (is_blocked(q)) return Outcome::kBlocked;
  insert(q, PointKind::kInserted, condition);
  return Outcome::kChanged;
}

// Inserting q destroys the surface balls that contain it, so their facets are facets of the cells
// in conflict. A ball is smaller than λ (C1), so only a point close to the surface can lie in
// one. Balls around which not all within λ is loaded are left to other leaves: their volume points
// would have to go.
std::optional<Refinement::SurfaceBall> Refinement::encroached_ball(const Point& q) const {
  if (surroundings_.domain.distance_bound(q) >= input_.criteria.size) return std::nullopt;
  std::optional<SurfaceBall> largest;
  double squared_radius = 0;
  for (const Cell c : conflict_.cells)
    for (int i = 0; i < 4; ++i) {
      if (mesh_.delaunay().is_infinite(Facet{c, i})) continue;
      const Side here = mesh_.side(c), there = mesh_.side(mesh_.delaunay().neighbor(c, i));
      if (here == Side::kNotLoaded || there == Side::kNotLoaded) continue;
      // A dual edge that crosses the surface twice is C4's: there is none left here.
      if (body_at(here) == body_at(there)) continue;
      const auto dual = mesh_.dual_crossings({c, i});
      if (dual.count == 0 || dual.squared_radius <= squared_radius ||
          squared_distance(dual.ball_center, q) >= dual.squared_radius)
        continue;
      const SizeField& sizes = surroundings_.sizes;
      // Where h is not known, the ball is too far away to be this leaf's.
      if (sizes.has_shapes() && !sizes.has(dual.ball_center)) continue;
      const double size = sizes.on_surface_at(dual.ball_center);
      const double margin = loaded_around(size) - size;
      if (!has_small_balls(dual, size) ||
          input_.box.squared_distance(dual.ball_center) > margin * margin)
        continue;
      squared_radius = dual.squared_radius;
      largest = {dual.ball_center, std::sqrt(squared_radius), c};
    }
  return largest;
}

bool Refinement::is_blocked(const Point& q, double distance) const {
  const bool is_vertex = conflict_.squared_distance == 0;  // even without a floor
  if (is_vertex && !std::ranges::binary_search(leaving_, conflict_.nearest)) return true;
  return mesh_.has_other_point_within(q, distance, conflict_.nearest, leaving_);
}

// Whether two sheets of the surface face each other at q, closer than the spacing floor. To tell
// them apart takes samples about as close as they are (measured on parallel sheets: 1.07 of their
// distance), so what is inserted there for C3 or C4 comes down to the floor, and is of no use.
bool Refinement::is_in_fold(const Point& q) const {
  return surroundings_.domain.is_fold(q, floor_at(q));
}

bool Refinement::is_in_fold(Facet f) const {
  for (int i = 0; i < 4; ++i)
    if (i != f.index && !is_in_fold(mesh_.point(f.cell, i))) return false;
  return true;
}

void Refinement::delete_volume_points_near(const Point& q) {
  if (leaving_.empty()) return;
  for (const LocalIndex i : leaving_) {
    const auto& local = mesh_.local(i);
    if (local.ref & kNewPoint)
      delta_.inserted[local.ref & ~kNewPoint].is_deleted = true;
    else
      delta_.deleted.push_back(local.point);
    tell(RefineStep::Action::kDelete, attempt_.condition, local.ref, local.point);
    ++delta_.stats.deletions;
  }
  mesh_.remove(leaving_);
  if (mesh_.has_cells()) mesh_.find_conflict(q, mesh_.delaunay().newest_cell(), conflict_);
}

VertexRef Refinement::new_point(const Point& q, PointKind kind, Condition condition) {
  if (input_.max_insertions > 0 && ++num_insertions_ > input_.max_insertions)
    throw RefineError(fmt::format("more than {} insertions{}, the last near ({}, {}, {}) for C{}",
                                  input_.max_insertions, place(), q.x, q.y, q.z, int{condition}));
  const VertexRef ref = kNewPoint | delta_.inserted.size();
  delta_.inserted.push_back({q, kind, false, std::nullopt});
  ++delta_.stats.insertions[std::size_t{condition} - 1];
  tell(RefineStep::Action::kInsert, condition, ref, {0, q, kind});
  return ref;
}

void Refinement::insert(const Point& q, PointKind kind, Condition condition) {
  const VertexRef ref = new_point(q, kind, condition);
  if (surroundings_.core) surroundings_.core->append_met(q, delta_.met_core);
  if (!mesh_.has_cells()) {
    mesh_.insert_first({ref, q, kind}, ref);
    return;
  }
  delta_.inserted.back().changed = others_changed(q);
  mesh_.insert({ref, q, kind}, ref, conflict_);
}

// A point gets another star when q becomes its neighbor, and then it is a vertex in conflict; here
// as well, where fewer points are between them. Known of q in the leaf, around which all are. Of
// the core's, LeafDelta::met_core tells.
std::optional<std::vector<Point>> Refinement::others_changed(const Point& q) const {
  const double near = surroundings_.sizes.reach_of_balls(q, kNeighborhood);
  const double reach = input_.criteria.reach;
  const bool is_around =
      std::isfinite(reach) && (reach >= near || !surroundings_.sizes.is_uniform());
  if (!is_around || !is_in_leaf(input_.box, q)) return std::nullopt;
  std::vector<Point> changed;
  for (const Cell c : conflict_.cells)
    for (const LocalIndex v : mesh_.delaunay().vertices(c)) {
      if (v == kInfiniteVertex || mesh_.is_own(v) || mesh_.local(v).is_core) continue;
      const Point& p = mesh_.delaunay().point(v);
      if (squared_distance(p, q) < near * near) changed.push_back(p);
    }
  sort_and_unite(changed);
  return changed;
}

// A cure that is not blocked brings a point; without one it would be tried for ever.
void Refinement::throw_unchanged() const {
  const Point& q = attempt_.position;
  throw RefineError(fmt::format("a cure for C{} at ({}, {}, {}) changes nothing{}",
                                attempt_.condition, q.x, q.y, q.z, place()));
}

// ---- The result ---------------------------------------------------------------------------------

// What was blocked counts only if nothing that was done later restored it.
void Refinement::list_unresolved() {
  std::set<LocalIndex> disks;
  for (const Blocked& b : blocked_) {
    if (const auto* vertex = std::get_if<LocalIndex>(&b.where)) {
      const bool is_met = is_disk(*vertex, star_) && !(star_.empty() && is_on_crease(*vertex));
      if (is_met || !disks.insert(*vertex).second) continue;
    } else if (const auto* facet = std::get_if<FacetRef>(&b.where)) {
      if (!is_alive(*facet)) continue;
    } else if (!is_alive(std::get<CellRef>(b.where))) {
      continue;
    }
    delta_.unresolved.push_back(b.violation);
  }
}

void Refinement::list_cells() {
  throw_if_stopped(surroundings_.stop);
  Cells& cells = delta_.cells.cells;
  std::vector<std::uint64_t> core;
  if (mesh_.has_cells()) list_triangulated_cells(cells);
  if (surroundings_.core != nullptr) list_cells_at_core(cells, core);

  const std::size_t num_locals = mesh_.num_locals();
  delta_.cells.vertices = names_in_use(
      cells, [](MeshCell & cell) -> auto& { return cell.vertices; }, num_locals + core.size(),
      [&](std::uint32_t v) { return v < num_locals ? mesh_.local(v).ref : core[v - num_locals]; });
  bring_into_order(cells, delta_.cells.vertices.size());
}

// A facet is on the boundary of the mesh if one of its cells is in it, or on that of two bodies if
// both are. The leaf of its smallest vertex, all of whose cells are known here, lists it.
void Refinement::list_facets() {
  const Delaunay& delaunay = mesh_.delaunay();
  std::vector<MeshFacet>& facets = delta_.facets.facets;
  for (Cell c = 0; c < delaunay.cell_bound(); ++c) {
    if (!delaunay.is_cell(c) || !mesh_.has_own_vertex(c) || !mesh_.is_member(c)) continue;
    const CellState& state = mesh_.state(c);
    if (std::popcount(static_cast<unsigned>(state.own & state.hidden)) > 1) continue;
    if (mesh_.is_hollow(c)) continue;
    for (int i = 0; i < 4; ++i) {
      const Facet facet{c, i};
      if (!mesh_.has_own_vertex(facet) || !mesh_.may_be_of_boundary(facet)) continue;
      if (!mesh_.is_behind(facet)) continue;
      const auto found = mesh_.boundary_facet(facet);
      if (found && mesh_.is_own(found->smallest))
        facets.push_back({found->vertices, mesh_.labels(*found)});
    }
  }
  delta_.facets.vertices = names_in_use(
      facets, [](MeshFacet & facet) -> auto& { return facet.vertices; }, mesh_.num_locals(),
      [&](LocalIndex v) { return mesh_.local(v).ref; });
  for (MeshFacet& facet : facets) facet.vertices = smallest_first(facet.vertices);
  std::ranges::sort(facets);
}

// A cell with a core point is the lattice's, and listed below, unless that was met by an insertion.
void Refinement::list_triangulated_cells(Cells& cells) const {
  const Delaunay& delaunay = mesh_.delaunay();
  for (Cell c = 0; c < delaunay.cell_bound(); ++c) {
    if (!delaunay.is_cell(c) || !mesh_.has_own_vertex(c) || !mesh_.is_member(c)) continue;
    if (mesh_.is_hollow(c)) continue;
    if (mesh_.state(c).own == 0b1111) {
      cells.push_back({delaunay.vertices(c), mesh_.body(c)});
      continue;
    }
    int smallest = -1;
    bool is_of_core = false;
    for (int i = 0; i < 4; ++i) {
      const LeafMesh::Local& local = mesh_.local(delaunay.vertex(c, i));
      if (local.is_core)
        is_of_core |= !is_met(local.ref);
      else if (smallest < 0 || mesh_.point(c, i) < mesh_.point(c, smallest))
        smallest = i;
    }
    if (!is_of_core && mesh_.is_own(delaunay.vertex(c, smallest)))
      cells.push_back({delaunay.vertices(c), mesh_.body(c)});
  }
}

// The lattice's cells at an own point and at a core point that no insertion met.
void Refinement::list_cells_at_core(Cells& cells, std::vector<std::uint64_t>& core) const {
  SiteBox box;
  std::vector<LocalIndex> own;  // that have neighbors in the core
  const auto site_of_local = [&](LocalIndex i) { return site_of(mesh_.local(i).point.id); };
  for (LocalIndex i = 0; i < mesh_.num_locals(); ++i) {
    const LeafMesh::Local& local = mesh_.local(i);
    if (!local.is_own || !local.is_at_core || !local.is_alive) continue;
    const LatticeSite site = site_of_local(i);
    const SiteBox around = SiteBox{site, site + LatticeSite{1, 1, 1}}.expanded(2);
    box = own.empty() ? around : box.joined(around);
    own.push_back(i);
  }
  if (own.empty()) return;

  constexpr auto kUnknown = std::numeric_limits<std::uint32_t>::max();
  SiteBlock<std::uint32_t> index(box, kUnknown);
  for (LocalIndex i = 0; i < mesh_.num_locals(); ++i) {
    const LeafMesh::Local& local = mesh_.local(i);
    if (has_site(local.point) && local.is_alive && box.contains(site_of_local(i)))
      index[site_of_local(i)] = i;
  }
  for (const LocalIndex p : own) {
    const LatticeSite site = site_of_local(p);
    const BodyId body = mesh_.body_around(mesh_.local(p).point.position);
    // Bit k: neighbor k is of the core; is listed and smaller than p, or unknown.
    std::uint32_t is_of_core = 0, is_smaller = 0, is_unknown = 0;
    std::array<std::uint32_t, kLatticeNeighbors.size()> neighbors{};
    for (std::size_t k = 0; k < neighbors.size(); ++k) {
      const LatticeSite neighbor = site + kLatticeNeighbors[k];
      std::uint32_t& v = index[neighbor];
      if (!surroundings_.core->contains(neighbor)) {
        is_unknown |= std::uint32_t{v == kUnknown} << k;
        if (v != kUnknown)
          is_smaller |= std::uint32_t{mesh_.local(v).point.position < mesh_.local(p).point.position}
                        << k;
      } else if (!is_met(site_id(neighbor))) {
        is_of_core |= 1u << k;
        if (v == kUnknown) {
          v = static_cast<std::uint32_t>(mesh_.num_locals() + core.size());
          core.push_back(site_id(neighbor));
        }
      }
      neighbors[k] = v;
    }
    for (const auto& [a, b, c] : kCellsAtSite) {
      const std::uint32_t corners = 1u << a | 1u << b | 1u << c;
      if ((corners & is_of_core) == 0 || (corners & is_smaller) != 0) continue;
      if ((corners & is_unknown) != 0)
        throw RefineError("a point of the lattice core has a neighbor that is not of the mesh" +
                          place());
      cells.push_back({{p, neighbors[a], neighbors[b], neighbors[c]}, body});
    }
  }
}

// In part, if that is enough.
LeafDelta visited(const LeafInput& input, const Surroundings& around,
                  const Refinement::OnStep& on_step) {
  if (const auto revisit = Revisit::of(input, around.sizes)) {
    std::vector<RefineStep> steps;  // told only if they count
    Refinement::OnStep keep;
    if (on_step) keep = [&](const RefineStep& step) { steps.push_back(step); };
    Refinement part(revisit->part(), around, keep, LeafMesh::OwnPoints::kListed);
    part.restore();
    if (revisit->is_complete(part.delta())) {
      LeafDelta delta = part.finish();
      if (std::ranges::all_of(delta.poor, [](const PoorCell& c) { return c.others.empty(); })) {
        std::ranges::for_each(steps, [&](const RefineStep& step) { on_step(step); });
        revisit->add_kept(delta, around.core);
        return delta;
      }
    }
  }
  Refinement whole(input, around, on_step, LeafMesh::OwnPoints::kInBox);
  whole.restore();
  return whole.finish();
}

}  // namespace

LeafDelta refine_leaf(LeafInput input, const VisitWatch& watch, const WholeModel& whole) {
  if (input.max_own_points > 0 && input.own.size() > input.max_own_points) {
    LeafDelta delta;
    delta.is_overfull = true;
    return delta;
  }
  std::optional<LeafDomain> of_leaf;
  if (whole.domain == nullptr) of_leaf.emplace(std::move(input.domain), watch.stop);
  const CoreIndex core(input.core);
  const SizeField sizes =
      input.sizes.cubes.empty() ? SizeField(input.criteria.size) : SizeField(input.sizes);
  const Surroundings around{.domain = of_leaf ? *of_leaf : *whole.domain,
                            .sizes = sizes,
                            .core = core.is_empty() ? nullptr : &core,
                            .points = whole.points,
                            .stop = watch.stop,
                            .crease_points = input.crease_points,
                            .are_sides_apart = input.are_sides_apart};
  try {
    return visited(input, around, watch.on_step);
  } catch (const DelaunayError& e) {
    throw RefineError(e.what() + place_of(input.box));
  }
}

}  // namespace locvol
