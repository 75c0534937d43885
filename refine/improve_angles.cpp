#include "refine/improve_angles.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "octree/mix.h"
#include "octree/sort_and_unite.h"
#include "refine/cell_shape.h"
#include "refine/crease_leaf.h"
#include "refine/domain/fragment.h"
#include "refine/mirror.h"

namespace locvol {
namespace {

constexpr double kAngleSlack = 1e-6;  // relative, of what is not known to the last bit
// Rounds, with other places each time, go on as long as one leaves no more than this share of the
// cells; from kFirstForFew on for a few cells, too, until so many have been tried in vain.
constexpr double kWorthwhile = 0.8;
constexpr int kFirstForFew = 2;
constexpr std::size_t kFew = 16, kTriesOfFew = 384;
// What is flat in a wall is told by each cell's own width, so that two could make each other anew
// for ever: where a round makes so many times the poor cells that it began with, they are the
// next one's.
constexpr std::size_t kMadeInWalls = 4;
// Between sheets closer than λ nothing helps most cells. So many more of them than of others, and
// only moves are tried, which cost far less than insertions.
constexpr std::size_t kPatience = 50;
// Likewise of what is tried on the surface: where that helps at all, it helps three cells of four;
// in folds it helps none, and each trial asks for the sides of many cells, where much surface is.
constexpr std::size_t kPatienceOnSurface = 4, kFewOnSurface = 3;
// Places tried: steps along a direction, over the scale (λ, but less where cells are small); within
// a ball, over its radius; numbers of others.
constexpr std::array<double, 4> kSteps{0.1, 0.18, 0.05, 0.28};
constexpr std::array<double, 6> kIntoBall{0.97, 0.9, 0.8, 0.65, 0.5, 0.3};
constexpr int kNumAround = 8;
constexpr std::size_t kNumInBall = 24;
constexpr int kNumThrown = 240;         // to have so many in the ball, the leaf and on the surface
constexpr double kFacetAngle = 25;      // degrees; boundary facets may have it
constexpr double kAround = 0.4;         // over the scale
constexpr double kToSurface = 0.5;      // over λ: places farther from it are not tried on it
constexpr double kScale = 1.2;          // over the radius of the cell
constexpr std::size_t kNumMovable = 8;  // neighbors of a cell that are tried

// Of cells that lead across narrow parts: their width over the longest edge; the part of it that
// the tangent of a cell's angle is at least, unless it is flat; steps over its square and the way.
constexpr double kNarrow = 0.5;
constexpr std::array<double, 3> kStepsInWall{0.1, 0.3, 0.03};
// By how much points slide along creases, over the way to the closer neighbor.
constexpr std::array<double, 5> kPartsOfStep{0.1, 0.2, 0.3, 0.4, 0.05};

// Looks random, and is a function of its seeds.
class Noise {
 public:
  Noise(std::uint64_t a, std::uint64_t b, int round)
      : state_(mix(a ^ mix(b ^ mix(static_cast<std::uint64_t>(round))))) {}
  double in_unit_interval() { return static_cast<double>(bits() >> 11) * 0x1p-53; }
  std::size_t below(std::size_t bound) { return bits() % bound; }
  Point in_unit_ball() {
    for (;;) {
      const double x = in_unit_interval(), y = in_unit_interval(), z = in_unit_interval();
      const Point p{2 * x - 1, 2 * y - 1, 2 * z - 1};
      if (dot(p, p) <= 1) return p;
    }
  }

 private:
  std::uint64_t bits() { return state_ = mix(state_); }
  std::uint64_t state_;
};

// What points that came in this visit are vertices of was in no list.
template <class List>
void tell_gone(const std::map<typename List::Name, Point>& gone,
               std::vector<OfOther<List>>& others) {
  for (const auto& [name, smallest] : gone)
    if (std::ranges::none_of(vertices_in(name), [](VertexRef v) { return (v & kNewPoint) != 0; }))
      others.push_back({name, smallest});
}

// What comes and goes again is nothing to others.
template <class ByName>
void note_change(const ByName& gone, const ByName& made, ByName& all_gone, ByName& all_made) {
  for (const auto& item : gone)
    if (all_made.erase(item.first) == 0) all_gone.insert(item);
  for (const auto& item : made)
    if (all_gone.erase(item.first) == 0) all_made.insert(item);
}

}  // namespace

ImproveAngles::ImproveAngles(const LeafInput& input, const Surroundings& around,
                             const OnStep& on_step, LeafMesh& mesh, LeafCreases* creases,
                             LeafDelta& delta)
    : input_(input),
      surroundings_(around),
      on_step_(on_step),
      mesh_(mesh),
      creases_(creases),
      delta_(delta),
      move_(mesh.delaunay()) {
  ask_for(input.criteria.min_dihedral);
  poor_cosine_ = bound_;
  const double size = around.sizes.largest();
  limits_.squared_radius = size * size;
  limits_.radius_edge = bounds_.radius_edge;
}

void ImproveAngles::ask_for(double degrees) {
  for (std::size_t k = 0; k < kFractions.size(); ++k)
    cosines_[k] = std::cos(kDegree * (kFractions[k] * degrees + kAngleSlack));
  bound_ = cosines_.back();
  limits_.cosine = cosines_[kMuchBelow];
}

void ImproveAngles::run() {
  for (Cell c = 0; c < mesh_.delaunay().cell_bound(); ++c)
    if (mesh_.delaunay().is_cell(c)) look_at(c);
  StopPoll poll(surroundings_.stop, 8);
  std::size_t num_before = 0, num_tries = 0;
  for (round_ = 0; !waiting_.empty(); ++round_) {
    const std::size_t num = waiting_.size();
    const bool is_worthwhile =
        static_cast<double>(num) <= kWorthwhile * static_cast<double>(num_before);
    num_before = num;
    num_made_in_walls_ = 0;
    most_made_in_walls_ = kMadeInWalls * num;
    if (round_ >= kFirstForFew && !is_worthwhile) {
      num_tries += num;
      if (num > kFew || num_tries > kTriesOfFew) break;
    }
    while (!waiting_.empty()) {
      poll();
      const Poor poor = waiting_.top();
      waiting_.pop();
      if (!mesh_.is_alive(poor.cell)) continue;
      if (improve(poor)) {
        ++num_improved_;
      } else {
        left_.push_back(poor);
      }
    }
    for (const Poor& poor : std::exchange(left_, {}))
      if (mesh_.is_alive(poor.cell) && !is_left_to_others(poor.cell.cell)) waiting_.push(poor);
  }
  list_poor();
  tell_gone(others_gone_.cells, delta_.others_gone);
  tell_gone(others_gone_.facets, delta_.others_facets_gone);
  for (const auto& [name, smallest] : others_made_.cells)
    delta_.others_made.push_back({name, smallest});
  for (const auto& [name, smallest] : others_made_.facets)
    delta_.others_facets_made.push_back({name, smallest});
}

// Others try a cell if it is new, or if they have left it to this leaf; and only if something has
// changed: so it ends.
void ImproveAngles::list_poor() {
  const bool is_changed = !delta_.inserted.empty() || !delta_.deleted.empty();
  for (; !waiting_.empty(); waiting_.pop()) {
    const auto& [cosine, wall, ref, vertices] = waiting_.top();
    PoorCell poor{.position = mesh_.ball(ref.cell).center,
                  .degrees = std::acos(std::min(1.0, cosine)) * 180 / std::numbers::pi,
                  .others = {}};
    if (is_changed && (mesh_.is_made_later(ref) || is_in_leaf(input_.box, poor.position)))
      for (const LocalIndex v : vertices)
        if (!mesh_.is_own(v) && !mesh_.local(v).is_core)
          poor.others.push_back(mesh_.local(v).point.position);
    if (!poor.others.empty() && !is_in_leaf(input_.box, poor.position))
      poor.others.push_back(poor.position);
    delta_.poor.push_back(std::move(poor));
  }
}

ImproveAngles::Facet ImproveAngles::facet(const std::array<LocalIndex, 4>& cell, int off) const {
  Facet result = facet_of(cell, off);
  std::ranges::sort(result);
  return result;
}

// Cells at own points; and those whose circumcenters lie in the leaf, for what helps may lie there.
void ImproveAngles::look_at(Cell c) {
  if (mesh_.delaunay().is_infinite(c)) return;
  const bool has_own = mesh_.has_own_vertex(c);
  const double most = surroundings_.sizes.largest();
  if (!has_own && !(input_.box.squared_distance(mesh_.point(c, 0)) < most * most)) return;
  const double cosine = largest_cosine(mesh_.corners(c));
  if (!(cosine > poor_cosine_) || !mesh_.is_member(c) || mesh_.is_hollow(c)) return;
  if (!has_own && !(is_in_leaf(input_.box, mesh_.ball(c).center) && mesh_.is_loaded(mesh_.ball(c))))
    return;
  const double wall = width_of_wall(c);
  if (is_thin(wall) && !is_flat(cosine, wall)) return;
  Poor poor{cosine, wall, mesh_.ref(c), mesh_.delaunay().vertices(c)};
  std::ranges::sort(poor.vertices);
  if (wall_ > 0 && ++num_made_in_walls_ > most_made_in_walls_)
    left_.push_back(poor);
  else
    waiting_.push(poor);
}

// Of a cell that leads from side to side of a narrow part, without a vertex inside. Else 0.
double ImproveAngles::width_of_wall(Cell c) const {
  if (creases_ == nullptr) return 0;
  const std::array<Point, 4> corners = mesh_.corners(c);
  const auto normals = creases_->normals(mesh_.delaunay().vertices(c), corners);
  if (!normals) return 0;
  const double width = relative_width(corners, *normals);
  return width < kNarrow ? width : 0;
}

// Is there room for one layer alone, with angles below the bound?
bool ImproveAngles::is_thin(double wall) const {
  return wall > 0 && wall < kThinWall * std::tan(kDegree * input_.criteria.min_dihedral);
}

// ---- What is tried ------------------------------------------------------------------------------

bool ImproveAngles::improve(const Poor& poor) {
  if (is_flat(poor.cosine, poor.wall) && improve_in_wall(poor)) return true;
  return !is_thin(poor.wall) && improve(poor.cell.cell);
}

// Four points nearly in a circle, two on each side, make a cell much flatter than the wall. One of
// them moves a little: on a crease first to where it is across from another as samples are from
// their mirrors.
bool ImproveAngles::improve_in_wall(const Poor& poor) {
  wall_ = poor.wall;
  ask_for(std::atan(kPartOfWall * wall_) / kDegree);
  const auto try_to = [&] {
    if (slide(poor.cell.cell, &ImproveAngles::list_sheared_place)) return true;
    kind_ = PointKind::kSurface;
    better_.clear();
    for (const LocalIndex v : mesh_.delaunay().vertices(poor.cell.cell))
      if (mesh_.is_own(v) && mesh_.local(v).point.kind == PointKind::kSurface &&
          try_places(v, poor.cell.cell, &ImproveAngles::list_places_in_wall))
        return true;
    return try_better() || slide(poor.cell.cell, &ImproveAngles::list_places_along);
  };
  const bool is_improved = try_to();
  wall_ = 0;
  ask_for(input_.criteria.min_dihedral);
  return is_improved;
}

bool ImproveAngles::improve(Cell poor) {
  better_.clear();
  kind_ = PointKind::kVolume;
  const auto vertices = mesh_.delaunay().vertices(poor);
  for (const LocalIndex v : vertices)
    if (is_movable(v) && try_places(v, poor, &ImproveAngles::list_places)) return true;
  const bool is_left = left_.size() > kPatience + num_improved_ || is_left_to_others(poor);
  if (!is_left)
    for (const LocalIndex v : movable_around(poor))
      if (try_places(v, poor, &ImproveAngles::list_places)) return true;
  if (try_better()) return true;
  if (is_left) return false;
  list_places_in_ball(poor);
  if (try_insertions(poor)) return true;
  if (num_failed_on_surface_ > kPatienceOnSurface * (num_improved_on_surface_ + kFewOnSurface))
    return false;
  const bool is_improved = improve_on_surface(poor);
  ++(is_improved ? num_improved_on_surface_ : num_failed_on_surface_);
  return is_improved;
}

bool ImproveAngles::improve_on_surface(Cell poor) {
  kind_ = PointKind::kSurface;
  better_.clear();
  const auto vertices = mesh_.delaunay().vertices(poor);
  for (const LocalIndex v : vertices)
    if (mesh_.is_own(v) && mesh_.local(v).point.kind == PointKind::kSurface &&
        try_places(v, poor, &ImproveAngles::list_places))
      return true;
  if (try_better() || slide(poor, &ImproveAngles::list_places_along)) return true;
  kind_ = PointKind::kSurface;
  list_places_on_surface(poor);
  return try_insertions(poor);
}

// Along creases, between neighbors.
bool ImproveAngles::slide(Cell poor, Lister list) {
  if (creases_ == nullptr) return false;
  kind_ = PointKind::kCrease;
  better_.clear();
  for (const LocalIndex v : mesh_.delaunay().vertices(poor))
    if (mesh_.is_own(v) && mesh_.local(v).point.kind == PointKind::kCrease &&
        try_places(v, poor, list))
      return true;
  return try_better();
}

// To the leaf of its circumcenter.
bool ImproveAngles::is_left_to_others(Cell poor) const {
  const Point& center = mesh_.ball(poor).center;
  return std::ranges::any_of(input_.waiting,
                             [&](const Box& box) { return is_in_leaf(box, center); });
}

// Of points that are not on the surface. Neighbors of the core come last, for then core points must
// be listed.
bool ImproveAngles::is_movable(LocalIndex v) const {
  if (v == kInfiniteVertex) return false;
  const LeafMesh::Local& local = mesh_.local(v);
  return local.is_own && !is_on_surface(local.point.kind) &&
         !(local.is_at_core && !may_meet_core());
}

// Neighbors of its vertices, the closest to its ball first.
std::span<const LocalIndex> ImproveAngles::movable_around(Cell poor) {
  const Delaunay& delaunay = mesh_.delaunay();
  const auto vertices = delaunay.vertices(poor);
  const Point center = mesh_.ball(poor).center;
  movable_.clear();
  for (const LocalIndex v : vertices) {
    delaunay.cells_around(v, around_);
    for (const Cell near : around_)
      for (const LocalIndex w : delaunay.vertices(near))
        if (is_movable(w) && std::ranges::find(vertices, w) == vertices.end())
          movable_.push_back(w);
  }
  sort_and_unite(movable_);
  std::ranges::stable_sort(
      movable_, {}, [&](LocalIndex v) { return squared_distance(delaunay.point(v), center); });
  return std::span(movable_).first(std::min(movable_.size(), kNumMovable));
}

// The first place that leaves no cell below the bound is taken.
bool ImproveAngles::try_places(LocalIndex v, Cell poor, Lister list) {
  const Point before = mesh_.delaunay().point(v);
  take_in_core(before);
  if (!move_.take_out(v)) return false;
  (this->*list)(v, poor);
  if (kind_ == PointKind::kSurface)
    std::erase_if(places_, [&](Point& q) { return !put_on_surface(q); });
  const double growth = surroundings_.sizes.growth();
  const double known =
      surroundings_.sizes.has_shapes()
          ? 0
          : input_.criteria.reach - reach_factor(growth, kNeighborhood) * input_.criteria.size;
  for (const Point& q : places_) {
    if (!is_in_leaf(input_.box, q) || !may_stand(q, v)) continue;
    bound_radii_at(q);
    const bool is_far = squared_distance(q, before) > known * known;
    if (((is_far && take_in_ghosts(q)) | take_in_core(q)) && !move_.take_out(v)) return false;
    if (!move_.find(q, limits(), change_) || !is_gone(poor)) continue;
    const std::optional<Counts> counts = counts_of_made();
    const Verdict verdict = verdict_on(counts);
    if (verdict == Verdict::kBetter) better_.push_back({*counts, v, q});
    if (verdict != Verdict::kGood || !is_allowed_once_counted(verdict)) continue;
    make();
    return true;
  }
  return false;
}

// Of cells at a vertex there: they are asked again where their centers are.
void ImproveAngles::bound_radii_at(const Point& q) {
  if (surroundings_.sizes.is_uniform()) return;
  const double most = 0.5 * surroundings_.sizes.reach_of_balls(q, kNeighborhood);
  limits_.squared_radius = most * most;
}

// The best place is taken that may be. They are judged no earlier: seldom is none good.
bool ImproveAngles::try_better() {
  std::ranges::stable_sort(better_, {}, &Better::counts);
  LocalIndex out = kInfiniteVertex;
  for (const auto& [counts, v, q] : better_) {
    if (!may_stand(q, v)) continue;
    if (std::exchange(out, v) != v && !move_.take_out(v)) return false;
    bound_radii_at(q);
    if (!move_.find(q, limits(), change_) || !are_cells_good() || !is_allowed(Verdict::kBetter))
      continue;
    make();
    return true;
  }
  return false;
}

// Of the cell's vertex: down the gradient of the squared circumradius, which has others come into
// the ball, and up that of its height; to the place that is best for an optimal Delaunay
// triangulation (Chen and Xu, 2004); some around. Of another: into the cell's ball.
void ImproveAngles::list_places(LocalIndex v, Cell poor) {
  const Delaunay& delaunay = mesh_.delaunay();
  const Point p = delaunay.point(v);
  const CellBall& ball = mesh_.ball(poor);
  const double scale =
      std::min(surroundings_.sizes.at(ball.center), kScale * std::sqrt(ball.squared_radius));
  const auto& vertices = delaunay.vertices(poor);
  places_.clear();
  const auto at = std::ranges::find(vertices, v);
  if (at == vertices.end()) {
    const Point away = p - ball.center;
    const double radius = std::sqrt(ball.squared_radius) / norm(away);
    for (const double part : kIntoBall) places_.push_back(ball.center + (part * radius) * away);
    return;
  }
  const auto i = static_cast<std::size_t>(at - vertices.begin());
  const Point a = delaunay.point(vertices[(i + 1) % 4]), b = delaunay.point(vertices[(i + 2) % 4]),
              c = delaunay.point(vertices[(i + 3) % 4]);
  Point up = cross(b - a, c - a);
  up = (dot(up, p - a) < 0 ? -1 : 1) / norm(up) * up;
  // R² = r² + t², with the radius r of the facet's circle and the center's height t above it: the
  // gradient is 2 t (p - center) over p's height.
  const Point out = p - ball.center;
  const Point down = (dot(up, ball.center - a) > 0 ? -1 : 1) / norm(out) * out;
  for (const double step : kSteps) {
    places_.push_back(p + (step * scale) * down);
    places_.push_back(p + (step * scale) * up);
  }
  Point sum;
  double volume = 0;
  for (const Cell near : move_.star()) {
    if (!mesh_.is_member(near)) continue;
    const auto& [k, l, m, n] = mesh_.corners(near);
    const double part = dot(cross(l - k, m - k), n - k);
    volume += part;
    sum = sum + part * mesh_.ball(near).center;
  }
  if (volume > 0) places_.insert(places_.begin() + 2, 1 / volume * sum);
  Noise noise(mesh_.local(v).ref, mesh_.local(vertices[i ^ 1]).ref, round_);
  for (int n = 0; n < kNumAround; ++n)
    places_.push_back(p + (kAround * scale) * noise.in_unit_ball());
}

// To the closest place there, if that is near. That of a flat cell may be anywhere.
bool ImproveAngles::put_on_surface(Point& q) const {
  const double farthest = kToSurface * input_.criteria.size;
  if (!(input_.box.squared_distance(q) <= farthest * farthest)) return false;
  const auto closest = surroundings_.domain.closest_to(
      q, kToSurface * mesh_.scaled(input_.criteria.size, surroundings_.sizes.on_surface_at(q)));
  if (closest) q = closest->position;
  return closest.has_value();
}

// No vertex comes into the ball of one on a crease, and on the surface each stays on its sheet.
bool ImproveAngles::may_stand(const Point& q, LocalIndex v) {
  if (creases_ == nullptr) return true;
  if (kind_ == PointKind::kCrease)
    return creases_->may_slide(v, q, kLongestStep * surroundings_.sizes.on_surface_at(q));
  if (creases_->is_in_ball(q)) return false;
  if (kind_ != PointKind::kSurface) return true;
  const auto closest = surroundings_.domain.closest_to(q, input_.criteria.size);
  if (!closest) return false;
  sheet_ = closest->side.sheet;
  return v == mesh_.num_locals() || std::ranges::equal(creases_->sheets(v), std::array{sheet_});
}

void ImproveAngles::list_places_along(LocalIndex v, Cell) {
  places_.clear();
  creases_->append_places_along(v, kPartsOfStep, places_);
}

// Across from the closest vertex of the cell, as mirrors are.
void ImproveAngles::list_sheared_place(LocalIndex v, Cell poor) {
  const Delaunay& delaunay = mesh_.delaunay();
  const Point p = delaunay.point(v);
  Point across;
  double least = std::numeric_limits<double>::infinity();
  for (const LocalIndex w : delaunay.vertices(poor))
    if (const double distance2 = squared_distance(delaunay.point(w), p);
        w != v && distance2 < least) {
      least = distance2;
      across = delaunay.point(w) - p;
    }
  places_.clear();
  creases_->append_place_towards(
      v, sheared_across(across, kMirrorReach * surroundings_.sizes.on_surface_at(p)), places_);
}

// Towards the cell's other vertices and away, by so little that sides stay apart
// (`sheared_across`): of points that are nearly in a circle none need be.
void ImproveAngles::list_places_in_wall(LocalIndex v, Cell poor) {
  const Point p = mesh_.delaunay().point(v);
  places_.clear();
  for (const double step : kStepsInWall)
    for (const LocalIndex w : mesh_.delaunay().vertices(poor)) {
      if (w == v) continue;
      const Point way = (step * wall_ * wall_) * (mesh_.delaunay().point(w) - p);
      places_.push_back(p + way);
      places_.push_back(p - way);
    }
}

bool ImproveAngles::try_insertions(Cell poor) {
  for (const Point& q : places_) {
    if (!may_stand(q, static_cast<LocalIndex>(mesh_.num_locals()))) continue;
    bound_radii_at(q);
    take_in_ghosts(q);
    take_in_core(q);
    move_.put_in_new();
    if (!move_.find_insertion(q, poor, limits(), change_)) continue;
    const Verdict verdict = verdict_on(counts_of_made());
    if (verdict == Verdict::kNone || !is_allowed_once_counted(verdict)) continue;
    make();
    return true;
  }
  return false;
}

void ImproveAngles::list_places_in_ball(Cell poor) {
  const CellBall& ball = mesh_.ball(poor);
  const auto& vertices = mesh_.delaunay().vertices(poor);
  Noise noise(mesh_.local(vertices[0]).ref, mesh_.local(vertices[1]).ref, round_);
  places_.clear();
  for (int n = 0; n < kNumThrown && places_.size() < kNumInBall; ++n) {
    const Point q = ball.center + std::sqrt(ball.squared_radius) * noise.in_unit_ball();
    if (is_in_leaf(input_.box, q)) places_.push_back(q);
  }
}

// The last resort, mostly for cells of four surface points: in the circumball, centers of the
// cell's surface balls, and some around on the surface.
void ImproveAngles::list_places_on_surface(Cell poor) {
  const Delaunay& delaunay = mesh_.delaunay();
  const CellBall& ball = mesh_.ball(poor);
  places_.clear();
  for (int i = 0; i < 4; ++i) {
    if (mesh_.body(delaunay.neighbor(poor, i)) == mesh_.body(poor) ||
        !mesh_.has_own_vertex(LeafMesh::Facet{poor, i}))
      continue;
    const auto dual = mesh_.dual_crossings({poor, i});
    if (dual.count > 0 && is_in_leaf(input_.box, dual.ball_center))
      places_.push_back(dual.ball_center);
  }
  const double radius = std::sqrt(ball.squared_radius);
  const auto& vertices = delaunay.vertices(poor);
  Noise noise(mesh_.local(vertices[0]).ref, mesh_.local(vertices[1]).ref, round_);
  const std::size_t most = places_.size() + kNumInBall;
  for (int n = 0; n < kNumThrown && places_.size() < most; ++n) {
    Point q = ball.center + radius * noise.in_unit_ball();
    if (put_on_surface(q) && squared_distance(q, ball.center) < ball.squared_radius &&
        is_in_leaf(input_.box, q))
      places_.push_back(q);
  }
}

// All points within 2λ of q must be there; true if some were not.
bool ImproveAngles::take_in_ghosts(const Point& q) {
  mesh_.take_in_ghosts(q, mesh_.delaunay().newest_cell(), near_);
  return note_taken_in();
}

bool ImproveAngles::take_in_core(const Point& q) {
  if (!may_meet_core()) return false;
  mesh_.take_in_core(q, mesh_.delaunay().newest_cell(), near_);
  return note_taken_in();
}

// What was found before names cells that may be gone.
bool ImproveAngles::note_taken_in() {
  if (near_.empty()) return false;
  better_.clear();
  delta_.stats.points_added += near_.size();
  for (const MeshPoint& p : near_) tell(RefineStep::Action::kTakeIn, p.id, p);
  return true;
}

// ---- What a change would do ---------------------------------------------------------------------

bool ImproveAngles::is_gone(Cell c) const {
  return std::ranges::find(change_.gone, c) != change_.gone.end();
}

// Once its cells are good. Of a volume point, all around which must be inside, limits_ have been
// asked by then.
bool ImproveAngles::is_allowed(Verdict verdict) {
  return are_facets_good() && !(verdict == Verdict::kBetter && leaves_poor_to_others()) &&
         (!is_on_surface(kind_) || is_insertion() || do_samples_hide_as_before());
}

// Of a surface point, its cells are good if they were counted.
bool ImproveAngles::is_allowed_once_counted(Verdict verdict) {
  return (is_on_surface(kind_) || are_cells_good()) && is_allowed(verdict);
}

// All points that matter are there: place and radius are well within the reach.
bool ImproveAngles::do_samples_hide_as_before() const {
  if (!std::isfinite(input_.criteria.cover_radius)) return true;
  const Point& before = mesh_.delaunay().point(change_.vertex);
  const SizeField& sizes = surroundings_.sizes;
  const double radius = mesh_.cover_radius_from(before);
  const double least = mesh_.scaled(
      input_.criteria.cover_radius,
      sizes.on_surface_at(before) - (sizes.has_shapes() ? sizes.growth() * radius : 0));
  std::vector<Point> samples{change_.place}, hidden;
  for (LocalIndex v = 0; v < mesh_.num_locals(); ++v) {
    const auto& [point, ref, is_own, is_core, is_at_core, is_alive] = mesh_.local(v);
    if (v == change_.vertex || !is_alive ||
        !(squared_distance(point.position, before) < 4 * radius * radius))
      continue;
    if (is_on_surface(point.kind)) samples.push_back(point.position);
    if (point.kind == PointKind::kLattice) hidden.push_back(point.position);
  }
  return is_covered_without(surroundings_.domain, before, {least, radius}, samples, hidden);
}

// Nobody would look at them again.
bool ImproveAngles::leaves_poor_to_others() const {
  for (std::size_t n = 0; n < prospects_.size(); ++n)
    if (prospects_[n].state.own == 0 && prospects_[n].state.is_member() &&
        move_.cosines()[n] > bound_)
      return true;
  return false;
}

ImproveAngles::Verdict ImproveAngles::verdict_on(const std::optional<Counts>& made) const {
  if (!made) return Verdict::kNone;
  if (*made == Counts{}) return Verdict::kGood;
  return *made < counts_of_gone() ? Verdict::kBetter : Verdict::kNone;
}

void ImproveAngles::count(double cosine, Counts& counts) const {
  for (std::size_t k = 0; k < counts.size(); ++k) counts[k] += cosine > cosines_[k];
}

// A surface point makes cells outside, and these do not count. Null if not all cells are good,
// which need not be known if too many of them are poor: to ask on which side a cell is takes long.
std::optional<ImproveAngles::Counts> ImproveAngles::counts_of_made() {
  const bool makes_outside = is_on_surface(kind_);
  if (makes_outside && makes_poor_inside()) return std::nullopt;
  Counts counts{};
  for (std::size_t n = 0; n < change_.made.size(); ++n)
    if (const double cosine = move_.cosines()[n];
        cosine > bound_ && (!makes_outside || mesh_.appraise(change_, n, kind_).state.is_member()))
      count(cosine, counts);
  if (makes_outside && (verdict_on(counts) == Verdict::kNone || !are_cells_good()))
    return std::nullopt;
  return counts;
}

ImproveAngles::Counts ImproveAngles::counts_of_gone() const {
  Counts counts{};
  for (const Cell c : change_.gone)
    if (!mesh_.delaunay().is_infinite(c) && mesh_.is_member(c) && !mesh_.is_hollow(c))
      count(largest_cosine(mesh_.corners(c)), counts);
  return counts;
}

// Of a surface point: is a cell much below the bound that would have to be inside? Cheap, and most
// often so. (Of volume points limits_ have told.)
bool ImproveAngles::makes_poor_inside() const {
  if (!is_on_surface(kind_)) return false;
  for (std::size_t n = 0; n < change_.made.size(); ++n) {
    const auto& vertices = change_.made[n].vertex;
    const bool must_be_inside = std::ranges::any_of(vertices, [&](LocalIndex v) {
      return v != change_.vertex && !is_on_surface(mesh_.local(v).point.kind);
    });
    if (must_be_inside && move_.cosines()[n] > limits_.cosine) return true;
  }
  return false;
}

// C5, C6; and C2 in so far as all cells at a volume point are inside. Of the core nothing changes,
// or all of it around is there.
bool ImproveAngles::are_cells_good() {
  if (makes_poor_inside()) return false;
  for (const Cell c : change_.gone) {
    if (mesh_.is_hollow(c)) return false;
    for (const LocalIndex v : mesh_.delaunay().vertices(c))
      if (v == kInfiniteVertex || (mesh_.local(v).is_core && !may_meet_core())) return false;
  }
  prospects_.clear();
  for (std::size_t n = 0; n < change_.made.size(); ++n)
    prospects_.push_back(mesh_.appraise(change_, n, kind_));
  for (std::size_t n = 0; n < prospects_.size(); ++n) {
    const CellState& state = prospects_[n].state;
    if (state.side == Side::kNotLoaded || state.is_hollow) return false;
    if (!state.is_member()) {
      if (must_be_inside(state.on_surface)) return false;
      continue;
    }
    const CellView cell = mesh_.view(change_, prospects_, n);
    if (const auto broken = judge(cell, bounds_);
        broken && !(broken == kC6 && creases_ != nullptr &&
                    creases_->is_exempt(change_.made[n].vertex, cell.corners)))
      return false;
  }
  return true;
}

// C1 to C4; and dual edges cross the surface where bodies differ, and nowhere else. Where the
// boundary changes, its facets are disks as before.
bool ImproveAngles::are_facets_good() {
  if (!list_facets()) return false;
  // Of the same vertices, but one of them moves.
  const bool is_moved = is_on_surface(kind_);
  if ((facets_made_ != facets_gone_ || is_moved) &&
      !(are_facets_as_round() && are_creases_kept() && is_boundary_kept() &&
        are_between_their_bodies()))
    return false;
  return std::ranges::all_of(facets_to_judge_, [&](const FacetToJudge& f) {  // what takes longest
    const FacetView view = mesh_.view(change_, prospects_, f.made, f.index);
    return !judge_end(view) && !judge(view, bounds_) && (view.dual.count > 0) == f.is_on_boundary;
  });
}

// On the boundary, those that come and those that go; and which of all that come are to be judged.
// False if this cannot be known, or changes the core.
bool ImproveAngles::list_facets() {
  constexpr std::uint32_t kNew = Delaunay::kNewCell;
  const auto body = [&](std::uint32_t cell) {
    return cell & kNew ? prospects_[cell & ~kNew].state.body() : mesh_.body(cell);
  };
  facets_made_.clear();
  bodies_at_.clear();
  facets_to_judge_.clear();
  for (std::uint32_t n = 0; n < change_.made.size(); ++n) {
    const NewCell& cell = change_.made[n];
    const CellState& state = prospects_[n].state;
    for (int i = 0; i < 4; ++i) {
      const std::uint32_t beyond = cell.neighbor[std::size_t(i)];
      if ((beyond & kNew) && (beyond & ~kNew) < n) continue;  // seen from there
      if ((beyond & kNew) == 0 && mesh_.side(beyond) == Side::kNotLoaded) return false;
      const bool is_on_boundary = body(kNew | n) != body(beyond);
      if (((state.own & state.hidden) & ~(1 << i)) != 0) {
        if ((is_on_boundary || ((beyond & kNew) == 0 && mesh_.is_hollow(beyond))) && changes_core())
          return false;
        continue;
      }
      if (!is_on_boundary && state.side == Side::kFar && is_out_of_reach(cell, i)) continue;
      facets_to_judge_.push_back({n, i, is_on_boundary});
      if (is_on_boundary) facets_made_.push_back(facet(cell.vertex, i));
      if (is_on_boundary && has_bodies_)
        bodies_at_[facets_made_.back()] = pair_of(body(kNew | n), body(beyond));
    }
  }
  facets_gone_.clear();
  for (const Cell c : change_.gone) {
    const unsigned hidden = mesh_.state(c).own & mesh_.state(c).hidden;
    for (int i = 0; i < 4; ++i) {
      if ((hidden & ~(1u << i)) != 0) continue;
      const BodyId one = mesh_.body(c), other = mesh_.body(mesh_.delaunay().neighbor(c, i));
      if (one == other) continue;
      facets_gone_.push_back(facet(mesh_.delaunay().vertices(c), i));
      if (!has_bodies_) continue;
      // One that stays, between other bodies, would be a facet of both lists.
      const auto [known, is_new] = bodies_at_.try_emplace(facets_gone_.back(), pair_of(one, other));
      if (!is_new && known->second != pair_of(one, other)) return false;
    }
  }
  std::ranges::sort(facets_made_);
  sort_and_unite(facets_gone_);  // between two that go
  return true;
}

// The vertices of each new facet lie where the surface parts its bodies.
bool ImproveAngles::are_between_their_bodies() const {
  return !has_bodies_ || std::ranges::all_of(facets_made_, [&](const Facet& f) {
    const std::array<BodyId, 2>& bodies = bodies_at_.at(f);
    return std::ranges::all_of(f, [&](LocalIndex v) {
      return v == change_.vertex ? mesh_.is_between(change_.place, bodies)
                                 : mesh_.is_between(v, bodies);
    });
  });
}

// Each new facet lies on one sheet. Of a crease's edges none goes: one between two facets that go
// is to be between two that come.
bool ImproveAngles::are_creases_kept() const {
  if (creases_ == nullptr) return true;
  const auto is_of_sheet = [&](LocalIndex v, SheetId sheet) {
    return v == change_.vertex ? sheet == sheet_
                               : std::ranges::binary_search(creases_->sheets(v), sheet);
  };
  const auto is_of_one_sheet = [&](const Facet& f) {
    if (kind_ == PointKind::kCrease || std::ranges::find(f, change_.vertex) == f.end())
      return creases_->have_common_sheet(f[0], f[1], f[2]);
    return std::ranges::all_of(f, [&](LocalIndex v) { return is_of_sheet(v, sheet_); });
  };
  if (!std::ranges::all_of(facets_made_, is_of_one_sheet)) return false;
  const auto num_with = [](const std::vector<Facet>& facets, LocalIndex a, LocalIndex b) {
    return std::ranges::count_if(facets, [&](const Facet& f) {
      return std::ranges::find(f, a) != f.end() && std::ranges::find(f, b) != f.end();
    });
  };
  for (const Facet& f : facets_gone_)
    for (const auto& [i, j] : {std::pair(0, 1), std::pair(0, 2), std::pair(1, 2)}) {
      const LocalIndex a = f[std::size_t(i)], b = f[std::size_t(j)];
      if (mesh_.local(a).point.kind == PointKind::kCrease &&
          mesh_.local(b).point.kind == PointKind::kCrease && creases_->is_neighbor(a, b) &&
          num_with(facets_gone_, a, b) != num_with(facets_made_, a, b))
        return false;
    }
  return kind_ != PointKind::kCrease || are_segments_kept();
}

// C0 at a vertex that slides: in the smallest balls around the edges to its neighbors lies no
// vertex, for none of those lies there that have a cell with such an edge.
bool ImproveAngles::are_segments_kept() const {
  for (const LocalIndex w : creases_->neighbors_of(change_.vertex)) {
    const Point &p = change_.place, &q = mesh_.delaunay().point(w), middle = 0.5 * (p + q);
    bool is_edge = false;
    for (const NewCell& cell : change_.made) {
      if (std::ranges::find(cell.vertex, w) == cell.vertex.end() ||
          std::ranges::find(cell.vertex, change_.vertex) == cell.vertex.end())
        continue;
      is_edge = true;
      for (const LocalIndex v : cell.vertex)
        if (v != w && v != change_.vertex && v != kInfiniteVertex &&
            4 * squared_distance(mesh_.delaunay().point(v), middle) < squared_distance(p, q))
          return false;
    }
    if (!is_edge) return false;
  }
  return true;
}

// Is one of the facet's corners so far from the vertex that no ball that counts has both? Then all
// of the dual edge that counts is as before. It may be unknown, where all corners are ghosts.
bool ImproveAngles::is_out_of_reach(const NewCell& cell, int off) const {
  const auto is_far_from = [&](const Point& q) {
    const double reach = mesh_.reach_at(q);
    for (int k = 0; k < 4; ++k)
      if (k != off && squared_distance(place(cell.vertex[std::size_t(k)]), q) > reach * reach)
        return true;
    return false;
  };
  return is_far_from(change_.place) &&
         (is_insertion() || is_far_from(mesh_.delaunay().point(change_.vertex)));
}

// No angle is below kFacetAngle and all that were there before.
bool ImproveAngles::are_facets_as_round() const {
  const Delaunay& delaunay = mesh_.delaunay();
  double most = std::cos(kFacetAngle * std::numbers::pi / 180);
  for (const auto& [a, b, c] : facets_gone_)
    most = std::max(
        most, largest_cosine(std::array{delaunay.point(a), delaunay.point(b), delaunay.point(c)}));
  return std::ranges::all_of(facets_made_, [&](const Facet& f) {
    return largest_cosine(std::array{place(f[0]), place(f[1]), place(f[2])}) <= most;
  });
}

// All is inside around a hidden point. What looks like the boundary there is next to core points
// that are not loaded: the cells at these stay as they are, or it will not do.
bool ImproveAngles::changes_core() {
  if (surroundings_.core == nullptr) return true;
  met_core_.clear();
  surroundings_.core->append_met(change_.place, met_core_);
  return !met_core_.empty();
}

// With the same vertices (and the new one) as before, so as many facets (and two more).
bool ImproveAngles::is_boundary_kept() {
  std::vector<LocalIndex> before = distinct_vertices(facets_gone_);
  const std::vector<LocalIndex> after = distinct_vertices(facets_made_);
  const bool is_new = kind_ == PointKind::kSurface && is_insertion();
  if (is_new) before.push_back(change_.vertex);
  return before == after && facets_made_.size() == facets_gone_.size() + (is_new ? 2 : 0) &&
         std::ranges::all_of(after, [&](LocalIndex v) { return is_disk_after(v); });
}

// Whether the boundary facets at v will be a disk.
bool ImproveAngles::is_disk_after(LocalIndex v) {
  if (v < mesh_.num_locals() && !mesh_.is_own(v)) return is_disk_kept(v);
  star_.clear();
  if (v < mesh_.num_locals()) mesh_.boundary_at(v, star_);
  std::vector<LinkEdge> link;
  std::vector<std::array<BodyId, 2>> bodies;  // of each
  for (const LeafMesh::Facet& at : star_) {
    const Facet f = facet(mesh_.delaunay().vertices(at.cell), at.index);
    if (std::ranges::binary_search(facets_gone_, f)) continue;
    link.push_back(link_edge(f, v));
    if (has_bodies_)
      bodies.push_back(
          pair_of(mesh_.body(at.cell), mesh_.body(mesh_.delaunay().neighbor(at.cell, at.index))));
  }
  for (const Facet& f : facets_made_) {
    if (std::ranges::find(f, v) == f.end()) continue;
    link.push_back(link_edge(f, v));
    if (has_bodies_) bodies.push_back(bodies_at_.at(f));
  }
  if (std::ranges::adjacent_find(bodies, std::ranges::not_equal_to()) == bodies.end())
    return !judge(StarView{link});
  std::vector<BodyLinkEdge> of_bodies;
  for (std::size_t n = 0; n < link.size(); ++n) of_bodies.push_back({link[n], bodies[n]});
  return !judge(BodyStarView{of_bodies}) && are_junctions_kept(v, link);
}

// Where more than two facets come to an edge, it is of a crease: are_creases_kept() has counted.
bool ImproveAngles::are_junctions_kept(LocalIndex v, std::span<const LinkEdge> link) const {
  const auto is_kept = [&](LocalIndex w) {
    const auto num =
        std::ranges::count_if(link, [&](const LinkEdge& e) { return e.a == w || e.b == w; });
    return num == 2 || (creases_ != nullptr && v < mesh_.num_locals() && w < mesh_.num_locals() &&
                        creases_->is_neighbor(v, w));
  };
  return std::ranges::all_of(link, [&](const LinkEdge& e) { return is_kept(e.a) && is_kept(e.b); });
}

// The same of a ghost, whose star is not known as a whole. Of several bodies, what changes there is
// to be between the same two.
bool ImproveAngles::is_disk_kept(LocalIndex v) {
  std::optional<std::array<BodyId, 2>> first;
  if (has_bodies_)
    for (const auto* facets : {&facets_gone_, &facets_made_})
      for (const Facet& f : *facets) {
        if (std::ranges::find(f, v) == f.end()) continue;
        if (first && *first != bodies_at_.at(f)) return false;
        first = bodies_at_.at(f);
      }
  const auto link_of = [&](const std::vector<Facet>& facets, const std::vector<Facet>& others) {
    std::vector<LinkEdge> link;
    for (const Facet& f : facets)
      if (std::ranges::find(f, v) != f.end() && !std::ranges::binary_search(others, f))
        link.push_back(link_edge(f, v));
    return link;
  };
  const StarChange change{link_of(facets_gone_, facets_made_), link_of(facets_made_, facets_gone_)};
  return !judge(change, [&](LocalIndex w) { return is_off_boundary(v, w); });
}

// Is no boundary facet at the edge, as far as is known?
bool ImproveAngles::is_off_boundary(LocalIndex v, LocalIndex w) {
  const Delaunay& delaunay = mesh_.delaunay();
  if (w >= delaunay.num_vertices()) return true;
  delaunay.cells_around(v, around_);
  std::erase_if(around_, [&](Cell c) {
    return std::ranges::find(delaunay.vertices(c), w) == delaunay.vertices(c).end();
  });
  if (around_.empty()) return true;
  const BodyId body = mesh_.body(around_.front());
  return std::ranges::all_of(around_, [&](Cell c) {
    const Side side = mesh_.side(c);
    const bool is_known =
        mesh_.is_own(w) || (side < Side::kNotLoaded && mesh_.is_loaded(mesh_.ball(c)));
    return is_known && body_at(side) == body;
  });
}

// ---- Changing -----------------------------------------------------------------------------------

void ImproveAngles::make() {
  OfOthers gone, made;
  const bool changes_boundary = is_on_surface(kind_) || facets_made_ != facets_gone_;
  for (const Cell c : change_.gone) {
    note_others(c, gone);
    if (changes_boundary) note_others_facets(c, gone);
    note_met_core(c);
  }
  const bool is_new = is_insertion();
  PointKind kind = kind_;
  const MeshPoint before = is_new ? MeshPoint{} : mesh_.local(change_.vertex).point;
  if (!is_new && (before.kind == PointKind::kInserted || is_on_surface(before.kind))) {
    kind = before.kind;  // others may still have to look
    delta_.left.push_back(before.position);
  }
  VertexRef ref = is_new ? 0 : mesh_.local(change_.vertex).ref;
  if ((ref & kNewPoint) != 0) {
    delta_.inserted[ref & ~kNewPoint].position = change_.place;
  } else {
    if (!is_new) delta_.moved.push_back(before);
    ref = kNewPoint | delta_.inserted.size();
    delta_.inserted.push_back({change_.place, kind, false, std::vector<Point>{}});
  }
  if (is_new) {
    ++delta_.stats.insertions[kC7 - 1];
    mesh_.insert(change_, kind, ref);
  } else {
    ++delta_.stats.moves;
    mesh_.move(change_, kind, ref);
    if (kind == PointKind::kCrease) creases_->slide(change_.vertex);
  }
  tell(is_new ? RefineStep::Action::kInsert : RefineStep::Action::kMove, ref,
       {0, change_.place, kind});
  for (const Cell c : mesh_.delaunay().new_cells()) {
    note_others(c, made);
    if (changes_boundary) note_others_facets(c, made);
    note_met_core(c);
    look_at(c);
  }
  note_change(gone.cells, made.cells, others_gone_.cells, others_made_.cells);
  note_change(gone.facets, made.facets, others_gone_.facets, others_made_.facets);
}

// The leaf of its smallest vertex lists it. Leaves of cells at core points will be visited, for
// these are met.
void ImproveAngles::note_others(Cell c, OfOthers& changed) const {
  if (mesh_.state(c).own == 0b1111 || !mesh_.is_member(c) || mesh_.is_hollow(c)) return;
  NamedCell name{.vertices = {}, .body = mesh_.body(c)};
  int smallest = 0;
  for (int i = 0; i < 4; ++i) {
    const LeafMesh::Local& local = mesh_.local(mesh_.delaunay().vertex(c, i));
    if (local.is_core) return;
    name.vertices[std::size_t(i)] = local.ref;
    if (mesh_.point(c, i) < mesh_.point(c, smallest)) smallest = i;
  }
  if (mesh_.is_own(mesh_.delaunay().vertex(c, smallest))) return;
  sort_oriented(name.vertices);
  changed.cells.emplace(name, mesh_.point(c, smallest));
}

// Likewise.
void ImproveAngles::note_others_facets(Cell c, OfOthers& changed) const {
  for (int i = 0; i < 4; ++i) {
    const LeafMesh::Facet facet{c, i};
    if (!mesh_.may_be_of_boundary(facet)) continue;
    const auto found = mesh_.boundary_facet(facet);
    if (!found || mesh_.is_own(found->smallest)) continue;
    NamedFacet name{.vertices = {}, .labels = mesh_.labels(*found)};
    std::ranges::transform(found->vertices, name.vertices.begin(),
                           [&](LocalIndex v) { return mesh_.local(v).ref; });
    name.vertices = smallest_first(name.vertices);
    changed.facets.emplace(name, mesh_.delaunay().point(found->smallest));
  }
}

void ImproveAngles::note_met_core(Cell c) {
  for (const LocalIndex v : mesh_.delaunay().vertices(c))
    if (v != kInfiniteVertex && mesh_.local(v).is_core)
      delta_.met_core.push_back(mesh_.local(v).point.id);
}

}  // namespace locvol
