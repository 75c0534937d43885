#include "refine/domain/leaf_domain.h"

#include <bit>
#include <cassert>
#include <cmath>
#include <limits>

#include "octree/sort_and_unite.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/crossing.h"
#include "refine/domain/triangle_box.h"

namespace locvol {
namespace {

constexpr int kMinGridSide = 4;
constexpr std::size_t kUsualGridCells = 48 * 48 * 48;
constexpr std::size_t kMaxGridCells = std::size_t{1} << 22;
constexpr double kAnywhere = std::numeric_limits<double>::infinity();
constexpr std::uint8_t kMaxRings = 254;  // distances beyond it are not told apart

Crossing crossing_of(const Point& a, const Point& b, const Triangle& triangle) {
  const auto& [u, v, w] = triangle.corners;
  const Point n = cross(v - u, w - u);
  const double from = dot(a - u, n), to = dot(b - u, n);
  const double t = from == to ? 0.5 : std::clamp(from / (from - to), 0.0, 1.0);
  return {t < 0.5 ? a + t * (b - a) : b + (1 - t) * (a - b), t, triangle.id, sheet_of(triangle),
          change_across(triangle)};
}

// As sort_and_unite(), where many of the numbers below `all` are there, and often: without sorting.
void sort_and_unite_most(std::vector<std::uint32_t>& numbers, std::size_t all) {
  std::vector<std::uint64_t> is_there((all + 63) / 64);
  for (const std::uint32_t n : numbers) is_there[n / 64] |= std::uint64_t{1} << n % 64;
  numbers.clear();
  for (std::size_t word = 0; word < is_there.size(); ++word)
    for (std::uint64_t bits = is_there[word]; bits != 0; bits &= bits - 1)
      numbers.push_back(
          static_cast<std::uint32_t>(64 * word + std::size_t(std::countr_zero(bits))));
}

}  // namespace

struct LeafDomain::Impl {
  using Index = std::uint32_t;
  static constexpr int kWord = 64;  // bits

  // Some of the triangles that a query is done with: many grid cells hold the same.
  class Recent {
   public:
    bool holds(Index t) const { return std::ranges::find(triangles_, t) != triangles_.end(); }
    void add(Index t) { triangles_[num_++ % triangles_.size()] = t; }

   private:
    static constexpr Index kNone = std::numeric_limits<Index>::max();
    std::array<Index, 8> triangles_{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
    std::size_t num_ = 0;
  };

  std::vector<Triangle> triangles;
  std::vector<Box> boxes;  // of the triangles
  std::vector<CreaseEdge> creases;
  double crease_floor = 0;
  std::vector<CornerPoint> corners;
  BoxTree crease_tree;
  Box region;
  bool is_whole = false;
  std::optional<SheetId> only_sheet;
  double slack = 0;
  std::array<int, 3> num{};  // grid cells on each axis
  Point step, inverse_step;
  std::vector<Index> first;  // of a grid cell's triangles in `held`; one more at the end
  std::vector<Index> held;
  std::vector<DomainState> of_center;   // of a grid cell
  std::vector<std::uint64_t> occupied;  // bit i of a row's words: its cell i holds triangles
  std::vector<std::uint8_t> rings;      // Chebyshev distance to a cell with triangles
  std::vector<Index> both;              // of spread()

  std::size_t num_cells() const {
    return std::size_t(num[0]) * std::size_t(num[1]) * std::size_t(num[2]);
  }
  std::size_t index(int i, int j, int k) const {
    return row(j, k) * std::size_t(num[0]) + std::size_t(i);
  }
  std::size_t row(int j, int k) const {
    return std::size_t(k) * std::size_t(num[1]) + std::size_t(j);
  }
  std::size_t words_in_row() const { return std::size_t(num[0] + kWord - 1) / kWord; }
  int coordinate(double v, int axis) const {
    const double c = (v - region.min[axis]) * inverse_step[axis];
    return c <= 0 ? 0 : c >= num[std::size_t(axis)] ? num[std::size_t(axis)] - 1 : int(c);
  }
  std::array<int, 3> cell_of(const Point& p) const {
    return {coordinate(p.x, 0), coordinate(p.y, 1), coordinate(p.z, 2)};
  }
  Point center(int i, int j, int k) const {
    return {region.min.x + (i + 0.5) * step.x, region.min.y + (j + 0.5) * step.y,
            region.min.z + (k + 0.5) * step.z};
  }
  Box box(int i, int j, int k) const {
    const Point low{region.min.x + i * step.x, region.min.y + j * step.y,
                    region.min.z + k * step.z};
    return {low, low + step};
  }
  std::span<const Index> held_by(std::size_t cell) const {
    return {held.data() + first[cell], held.data() + first[cell + 1]};
  }

  double distance_bound(int rings_around) const {
    return rings_around <= 1 ? 0 : (rings_around - 1) * std::min({step.x, step.y, step.z}) - slack;
  }

  void choose_grid(const GridFineness& fineness);
  template <class Visit>
  void for_each_cell_met(Index triangle, Visit visit) const;
  void fill_grid(const StopToken* stop);
  void measure_rings();
  void note_sheets();
  void spread_states(const Point& reference, DomainState state, const StopToken* stop);
  void spread_over_plane(int i0, int j0, int k, int from);
  void spread_over_row(int i0, int j, int k, int from);
  void spread(const std::array<int, 3>& a, const std::array<int, 3>& b);
  DomainState change_between(const Point& a, const Point& b, std::span<const Index> some) const;
  template <class Visit>
  bool for_each_cell_near(const Point& p, double distance, Visit visit) const;
  template <class Visit>
  bool for_each_held_near(const Point& p, double distance, Visit visit) const;
  template <class Visit>
  bool for_few_cells_in(const Box& box, Visit visit) const;
  template <class Visit>
  void for_each_cell_along(Point a, Point b, Visit visit) const;
  bool clip(Point& a, Point& b) const;
  std::array<int, 3> cell_with_triangles(std::array<int, 3> at) const;
};

// Cells of half the resolution, or smaller, where those that the surface passes through would hold
// more than kTrianglesPerCell triangles; but never more than a visit can use.
void LeafDomain::Impl::choose_grid(const GridFineness& fineness) {
  double area = 0;
  const double volume_side =
      std::cbrt((region.max.x - region.min.x) * (region.max.y - region.min.y) *
                (region.max.z - region.min.z));
  const double area_bound = volume_side * volume_side;
  for (const Triangle& t : triangles) {
    const auto& [a, b, c] = t.corners;
    area += std::min(0.5 * norm(cross(b - a, c - a)), area_bound);
  }
  const double usual = fineness.resolution > 0 ? 0.5 * fineness.resolution
                                               : volume_side / std::cbrt(double(kUsualGridCells));
  const double finest = volume_side / std::cbrt(double(kMaxGridCells));
  const double dense = std::sqrt(fineness.triangles_per_cell * area / double(triangles.size()));
  const double side =
      triangles.empty() ? volume_side / kMinGridSide : std::max(finest, std::min(usual, dense));
  for (int axis = 0; axis < 3; ++axis) {
    const double extent = region.max[axis] - region.min[axis];
    const int n = std::clamp(int(extent / side), kMinGridSide, 1024);
    num[std::size_t(axis)] = n;
    step[axis] = extent / n;
    inverse_step[axis] = n / extent;
  }
}

template <class Visit>
void LeafDomain::Impl::for_each_cell_met(Index triangle, Visit visit) const {
  const Box& tb = boxes[triangle];
  if (!tb.overlaps(region.expanded(slack))) return;
  const auto low = cell_of({tb.min.x - slack, tb.min.y - slack, tb.min.z - slack});
  const auto high = cell_of({tb.max.x + slack, tb.max.y + slack, tb.max.z + slack});
  const bool is_small = high[0] - low[0] + high[1] - low[1] + high[2] - low[2] <= 1;
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i)
        if (is_small || !plane_misses(triangles[triangle], box(i, j, k), slack))
          visit(index(i, j, k));
}

void LeafDomain::Impl::fill_grid(const StopToken* stop) {
  StopPoll poll(stop);
  std::vector<std::pair<std::uint32_t, Index>> met;  // grid cell, triangle; in order of triangle
  first.assign(num_cells() + 1, 0);
  for (Index t = 0; t < triangles.size(); ++t) {
    poll();
    for_each_cell_met(t, [&](std::size_t cell) {
      met.emplace_back(static_cast<std::uint32_t>(cell), t);
      ++first[cell + 1];
    });
  }
  for (std::size_t c = 0; c < num_cells(); ++c) first[c + 1] += first[c];
  held.resize(met.size());
  std::vector<Index> next(first.begin(), first.end() - 1);
  for (const auto& [cell, t] : met) held[next[cell]++] = t;
  occupied.assign(std::size_t(num[1]) * std::size_t(num[2]) * words_in_row(), 0);
  const auto line = std::size_t(num[0]);
  for (const auto& [cell, t] : met) {
    const std::size_t i = cell % line;
    occupied[cell / line * words_in_row() + i / kWord] |= std::uint64_t{1} << i % kWord;
  }
}

// Twice over the grid, forth and back: a cell is one ring farther than the nearest of its neighbors
// that come before it (Rosenfeld and Pfaltz, "Distance functions on digital pictures", 1968).
void LeafDomain::Impl::measure_rings() {
  const std::size_t line = std::size_t(num[0]);
  rings.resize(num_cells());
  for (std::size_t cell = 0; cell < num_cells(); ++cell)
    rings[cell] = first[cell] < first[cell + 1] ? 0 : kMaxRings;
  std::vector<std::uint8_t> nearest(line + 2, kMaxRings);  // of four rows; ends on both sides
  for (const int way : {+1, -1}) {
    const auto row = [&](int j, int k) { return rings.data() + index(0, j, k); };
    for (int n = 0; n < num[2]; ++n)
      for (int m = 0; m < num[1]; ++m) {
        const int k = way > 0 ? n : num[2] - 1 - n, j = way > 0 ? m : num[1] - 1 - m;
        std::fill(nearest.begin(), nearest.end(), kMaxRings);
        const auto take_in = [&](int dj, int dk) {
          if (j + dj < 0 || j + dj >= num[1] || k + dk < 0 || k + dk >= num[2]) return;
          const std::uint8_t* other = row(j + dj, k + dk);
          for (std::size_t i = 0; i < line; ++i)
            nearest[i + 1] = std::min(nearest[i + 1], other[i]);
        };
        take_in(-way, 0);
        for (int dj = -1; dj <= 1; ++dj) take_in(dj, -way);
        std::uint8_t* here = row(j, k);
        for (std::size_t i = 0; i < line; ++i) {
          const std::uint8_t around =
              std::min(std::min(nearest[i], nearest[i + 1]), nearest[i + 2]);
          here[i] = std::min(here[i], static_cast<std::uint8_t>(around + 1));
        }
        if (way > 0)
          for (std::size_t i = 1; i < line; ++i)
            here[i] = static_cast<std::uint8_t>(std::min<int>(here[i], here[i - 1] + 1));
        else
          for (std::size_t i = line - 1; i-- > 0;)
            here[i] = static_cast<std::uint8_t>(std::min<int>(here[i], here[i + 1] + 1));
      }
  }
}

DomainState LeafDomain::Impl::change_between(const Point& a, const Point& b,
                                             std::span<const Index> some) const {
  const Box segment = Box::around(a).joined(b);
  DomainState change;
  for (const Index t : some)
    if (boxes[t].overlaps(segment) && segment_crosses(a, b, triangles[t]))
      change = change.crossed(change_across(triangles[t]));
  return change;
}

void LeafDomain::Impl::note_sheets() {
  if (triangles.empty()) return;
  const SheetId first_sheet = sheet_of(triangles.front());
  if (std::ranges::all_of(triangles, [&](const Triangle& t) { return sheet_of(t) == first_sheet; }))
    only_sheet = first_sheet;
}

// From center to center of neighboring cells: along x, then from row to row, then from plane to
// plane. The segment between two centers crosses only triangles that one of the two cells holds.
void LeafDomain::Impl::spread_states(const Point& reference, DomainState state,
                                     const StopToken* stop) {
  of_center.resize(num_cells());
  const auto [i0, j0, k0] = cell_of(reference);
  const std::size_t start = index(i0, j0, k0);
  of_center[start] = state.crossed(change_between(reference, center(i0, j0, k0), held_by(start)));
  const auto spread_over = [&](int k, int from) {
    throw_if_stopped(stop);
    spread_over_plane(i0, j0, k, from);
  };
  for (int k = k0; k < num[2]; ++k) spread_over(k, k == k0 ? 0 : -1);
  for (int k = k0; k-- > 0;) spread_over(k, 1);
}

// `from`: the way to the plane that is done already, or 0 in the first.
void LeafDomain::Impl::spread_over_plane(int i0, int j0, int k, int from) {
  if (from != 0) spread({i0, j0, k + from}, {i0, j0, k});
  for (int j = j0; j < num[1]; ++j) spread_over_row(i0, j, k, j == j0 ? 0 : -1);
  for (int j = j0; j-- > 0;) spread_over_row(i0, j, k, 1);
}

void LeafDomain::Impl::spread_over_row(int i0, int j, int k, int from) {
  if (from != 0) spread({i0, j + from, k}, {i0, j, k});
  const std::size_t row = index(0, j, k);
  const auto step_to = [&](int i, int before) {
    const std::size_t here = row + std::size_t(before), there = row + std::size_t(i);
    if (rings[here] == 0 || rings[there] == 0)
      spread({before, j, k}, {i, j, k});
    else
      of_center[there] = of_center[here];
  };
  for (int i = i0 + 1; i < num[0]; ++i) step_to(i, i - 1);
  for (int i = i0; i-- > 0;) step_to(i, i + 1);
}

void LeafDomain::Impl::spread(const std::array<int, 3>& a, const std::array<int, 3>& b) {
  const std::size_t here = index(a[0], a[1], a[2]), there = index(b[0], b[1], b[2]);
  of_center[there] = of_center[here];
  if (rings[here] > 0 && rings[there] > 0) return;
  both.clear();
  std::ranges::set_union(held_by(here), held_by(there), std::back_inserter(both));
  of_center[there] = of_center[here].crossed(
      change_between(center(a[0], a[1], a[2]), center(b[0], b[1], b[2]), both));
}

// The part of the segment from a to b inside the region, a rounding error longer; as points, and
// false if there is none.
bool LeafDomain::Impl::clip(Point& a, Point& b) const {
  double t0 = 0, t1 = 1;
  const Point d = b - a;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = region.min[axis] - 4 * slack, high = region.max[axis] + 4 * slack;
    if (d[axis] == 0) {
      if (a[axis] < low || a[axis] > high) return false;
      continue;
    }
    const double in = ((d[axis] > 0 ? low : high) - a[axis]) / d[axis];
    const double out = ((d[axis] > 0 ? high : low) - a[axis]) / d[axis];
    t0 = std::max(t0, in);
    t1 = std::min(t1, out);
  }
  if (t0 > t1) return false;
  if (t1 < 1) b = a + t1 * d;
  if (t0 > 0) a = a + t0 * d;
  return true;
}

// The cells with triangles that the box meets, if it meets few cells: to find out which of them a
// short segment touches would take longer. False if not.
template <class Visit>
bool LeafDomain::Impl::for_few_cells_in(const Box& box, Visit visit) const {
  constexpr int kFew = 4;
  const auto low = cell_of(box.min), high = cell_of(box.max);
  if ((high[0] - low[0] + 1) * (high[1] - low[1] + 1) * (high[2] - low[2] + 1) > kFew) return false;
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j)
      for (int i = low[0]; i <= high[0]; ++i)
        if (rings[index(i, j, k)] == 0) visit(index(i, j, k));
  return true;
}

// The cells with triangles that the segment touches, and some beside it: slab by slab along the
// axis on which it spans most cells, generous by a rounding error, leaping where no triangle is
// near.
template <class Visit>
void LeafDomain::Impl::for_each_cell_along(Point a, Point b, Visit visit) const {
  if (!clip(a, b)) return;
  if (for_few_cells_in(Box::around(a).joined(b).expanded(slack), visit)) return;
  const auto from = cell_of(a), to = cell_of(b);
  std::size_t main = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (std::abs(from[axis] - to[axis]) > std::abs(from[main] - to[main])) main = axis;
  const int m = int(main), u = (m + 1) % 3, v = (m + 2) % 3;
  const double length = b[m] - a[m];
  const int last = std::max(from[main], to[main]);
  for (int s = std::min(from[main], to[main]), leap = 0; s <= last; s += leap) {
    double t0 = 0, t1 = 1;
    if (from[main] != to[main]) {
      const double low = region.min[m] + s * step[m];
      t0 = (low - slack - a[m]) / length;
      t1 = (low + step[m] + slack - a[m]) / length;
      if (t0 > t1) std::swap(t0, t1);
      if (s == from[main]) t0 = 0;  // the first and the last also hold what lies beyond the region
      if (s == to[main]) t1 = 1;
      t0 = std::clamp(t0, 0.0, 1.0);
      t1 = std::clamp(t1, 0.0, 1.0);
    }
    const auto range = [&](int axis) {
      const double p = a[axis] + t0 * (b[axis] - a[axis]), q = a[axis] + t1 * (b[axis] - a[axis]);
      return std::array{coordinate(std::min(p, q) - slack, axis),
                        coordinate(std::max(p, q) + slack, axis)};
    };
    const auto ru = range(u), rv = range(v);
    std::array<int, 3> c{};
    c[main] = s;
    int nearest = kMaxRings;
    for (int i = ru[0]; i <= ru[1]; ++i)
      for (int j = rv[0]; j <= rv[1]; ++j) {
        c[std::size_t(u)] = i;
        c[std::size_t(v)] = j;
        const std::size_t cell = index(c[0], c[1], c[2]);
        nearest = std::min<int>(nearest, rings[cell]);
        if (rings[cell] == 0) visit(cell);
      }
    leap =
        std::max(1, nearest - 2);  // a slab on, the segment is at most one cell aside; 2 to spare
  }
}

namespace {

// If all parts of the surface change the state alike, there are two states.
std::optional<BodyId> only_body_of(const DomainPiece& piece) {
  DomainState other = piece.reference_state;
  if (!piece.triangles.empty()) {
    const DomainState change = change_across(piece.triangles.front());
    if (!std::ranges::all_of(piece.triangles,
                             [&](const Triangle& t) { return change_across(t) == change; }))
      return std::nullopt;
    other = other.crossed(change);
  }
  const BodyId here = piece.reference_state.body(), there = other.body();
  if (here == kNoBody && there == kNoBody) return kOnlyBody;
  if (here == there || here == kNoBody || there == kNoBody) return std::max(here, there);
  return std::nullopt;
}

}  // namespace

LeafDomain::LeafDomain(DomainPiece piece, const StopToken* stop)
    : impl_(std::make_unique<Impl>()), only_body_(only_body_of(piece)) {
  impl_->triangles = std::move(piece.triangles);
  impl_->region = piece.region;
  impl_->is_whole = piece.is_whole;
  impl_->boxes.reserve(impl_->triangles.size());
  Box all = piece.region;  // a plane's rounding errors go with the triangle's size
  for (const Triangle& t : impl_->triangles) {
    impl_->boxes.push_back(t.box());
    all = all.joined(impl_->boxes.back());
  }
  impl_->slack = slack_at(largest_coordinate(all));
  impl_->choose_grid(piece.fineness);
  impl_->fill_grid(stop);
  impl_->measure_rings();
  impl_->spread_states(piece.reference, piece.reference_state, stop);
  impl_->note_sheets();
  impl_->creases = std::move(piece.creases);
  impl_->crease_floor = piece.crease_floor;
  impl_->corners = std::move(piece.corners);
  std::vector<Box> of_creases(impl_->creases.size());
  std::ranges::transform(impl_->creases, of_creases.begin(), &CreaseEdge::box);
  impl_->crease_tree = BoxTree(std::move(of_creases));
}

LeafDomain::LeafDomain(LeafDomain&&) noexcept = default;
LeafDomain& LeafDomain::operator=(LeafDomain&&) noexcept = default;
LeafDomain::~LeafDomain() = default;

const Box& LeafDomain::region() const { return impl_->region; }
std::span<const Triangle> LeafDomain::triangles() const { return impl_->triangles; }
std::span<const CreaseEdge> LeafDomain::creases() const { return impl_->creases; }
double LeafDomain::crease_floor() const { return impl_->crease_floor; }
std::span<const CornerPoint> LeafDomain::corners() const { return impl_->corners; }
const BoxTree& LeafDomain::crease_tree() const { return impl_->crease_tree; }
std::optional<SheetId> LeafDomain::only_sheet() const { return impl_->only_sheet; }

LeafDomain::Location LeafDomain::locate(const Point& p) const {
  const auto [i, j, k] = impl_->cell_of(p);
  const std::size_t cell = impl_->index(i, j, k);
  const double bound = impl_->distance_bound(impl_->rings[cell]);
  if (!impl_->region.contains(p))
    return {impl_->is_whole ? std::optional(DomainState()) : std::nullopt, bound};
  const DomainState state = impl_->of_center[cell];
  if (impl_->rings[cell] > 0) return {state, bound};
  return {state.crossed(impl_->change_between(p, impl_->center(i, j, k), impl_->held_by(cell))),
          bound};
}

void LeafDomain::crossings(const Point& a, const Point& b, std::vector<Crossing>& out) const {
  out.clear();
  const Box segment = Box::around(a).joined(b);
  if (!segment.overlaps(impl_->region)) return;
  Impl::Recent missed;
  impl_->for_each_cell_along(a, b, [&](std::size_t cell) {
    for (const Impl::Index t : impl_->held_by(cell)) {
      if (!impl_->boxes[t].overlaps(segment) || missed.holds(t)) continue;
      const Triangle& triangle = impl_->triangles[t];
      if (std::ranges::find(out, triangle.id, &Crossing::triangle) != out.end()) continue;
      if (segment_crosses(a, b, triangle))
        out.push_back(crossing_of(a, b, triangle));
      else
        missed.add(t);
    }
  });
  std::ranges::sort(out, [](const Crossing& x, const Crossing& y) {
    return x.t != y.t ? x.t < y.t : x.triangle < y.triangle;
  });
}

bool LeafDomain::is_crossed(const Point& a, const Point& b) const {
  const Box segment = Box::around(a).joined(b);
  if (!segment.overlaps(impl_->region)) return false;
  Impl::Recent missed;
  bool is_met = false;
  const auto is_met_by = [&](Impl::Index t) {
    if (!impl_->boxes[t].overlaps(segment) || missed.holds(t)) return false;
    if (segment_crosses(a, b, impl_->triangles[t])) return true;
    missed.add(t);
    return false;
  };
  impl_->for_each_cell_along(a, b, [&](std::size_t cell) {
    is_met = is_met || std::ranges::any_of(impl_->held_by(cell), is_met_by);
  });
  return is_met;
}

double LeafDomain::distance_bound(const Point& p) const {
  const auto [i, j, k] = impl_->cell_of(p);
  return impl_->distance_bound(impl_->rings[impl_->index(i, j, k)]);
}

// Calls visit(cell) for the grid cells with triangles closer to p than `distance`, until it says
// false.
template <class Visit>
bool LeafDomain::Impl::for_each_cell_near(const Point& p, double distance, Visit visit) const {
  const Point d{distance, distance, distance};
  const auto low = cell_of(p - d), high = cell_of(p + d);
  const auto squared_gap = [&](int axis, int c) {  // between p and the cells
    const double from = region.min[axis] + c * step[axis];
    const double gap =
        std::max(std::max(from - p[axis], p[axis] - (from + step[axis])) - slack, 0.0);
    return gap * gap;
  };
  for (int k = low[2]; k <= high[2]; ++k)
    for (int j = low[1]; j <= high[1]; ++j) {
      if (squared_gap(1, j) + squared_gap(2, k) >= distance * distance) continue;
      for (int word = low[0] / kWord; word <= high[0] / kWord; ++word) {
        std::uint64_t bits = occupied[row(j, k) * words_in_row() + std::size_t(word)];
        if (word == low[0] / kWord) bits &= ~std::uint64_t{0} << low[0] % kWord;
        if (word == high[0] / kWord) bits &= ~std::uint64_t{0} >> (kWord - 1 - high[0] % kWord);
        for (; bits != 0; bits &= bits - 1)
          if (!visit(index(kWord * word + std::countr_zero(bits), j, k))) return false;
      }
    }
  return true;
}

// Calls visit(triangle) for what these cells hold, until it says false; the same triangle often.
template <class Visit>
bool LeafDomain::Impl::for_each_held_near(const Point& p, double distance, Visit visit) const {
  return for_each_cell_near(
      p, distance, [&](std::size_t cell) { return std::ranges::all_of(held_by(cell), visit); });
}

// Down the rings from a grid cell to one that holds triangles, which is about the nearest.
std::array<int, 3> LeafDomain::Impl::cell_with_triangles(std::array<int, 3> at) const {
  for (int ring = rings[index(at[0], at[1], at[2])]; ring > 0; --ring) {
    const auto next = [&] {
      for (int k = std::max(at[2] - 1, 0); k <= std::min(at[2] + 1, num[2] - 1); ++k)
        for (int j = std::max(at[1] - 1, 0); j <= std::min(at[1] + 1, num[1] - 1); ++j)
          for (int i = std::max(at[0] - 1, 0); i <= std::min(at[0] + 1, num[0] - 1); ++i)
            if (rings[index(i, j, k)] < ring) return std::array{i, j, k};
      return at;  // where rings are no longer counted
    }();
    if (next == at) break;
    at = next;
  }
  return at;
}

// First where the nearest triangle seems to be: most points that are near are so by far.
bool LeafDomain::is_near(const Point& p, double distance) const {
  if (impl_->triangles.empty() || distance_bound(p) >= distance) return false;
  const double bound = distance * distance;
  Impl::Recent far;
  const auto is_far = [&](Impl::Index t) {
    if (impl_->boxes[t].squared_distance(p) >= bound || far.holds(t)) return true;
    if (squared_distance(impl_->triangles[t], p) < bound) return false;
    far.add(t);
    return true;
  };
  const auto [i, j, k] = impl_->cell_with_triangles(impl_->cell_of(p));
  return !std::ranges::all_of(impl_->held_by(impl_->index(i, j, k)), is_far) ||
         !impl_->for_each_held_near(p, distance, is_far);
}

// A first guess bounds where to look. `change`: if given, that of the triangles that count
std::optional<LeafDomain::Closest> LeafDomain::closest_triangle(
    const Point& p, double distance, const std::optional<DomainState>& change) const {
  std::optional<Closest> closest;
  double least = distance * distance;
  // Of those as close, the first is taken: rounding leaves none of them out.
  const auto square_with_slack = [&](double length) {
    return (length + impl_->slack) * (length + impl_->slack);
  };
  double bound = square_with_slack(distance);
  const auto look_at = [&](Impl::Index t) {
    if (impl_->boxes[t].squared_distance(p) > least) return;
    const Triangle& triangle = impl_->triangles[t];
    if (change && change_across(triangle) != *change) return;
    if (is_farther_by_a_plane(triangle.corners, p, bound)) return;
    const Point q = closest_on_triangle(triangle.corners, p);
    const double d = squared_distance(p, q);
    if (!(d < least || (d == least && closest && t < closest->triangle))) return;
    closest = {q, t}, least = d;
    bound = square_with_slack(std::sqrt(least));
  };
  if (impl_->triangles.empty()) return closest;
  const auto [i, j, k] = impl_->cell_with_triangles(impl_->cell_of(p));
  const std::size_t guess = impl_->index(i, j, k);
  std::ranges::for_each(impl_->held_by(guess), look_at);
  constexpr double kSlack = 1e-9;
  if (std::isfinite(least))
    impl_->for_each_cell_near(p, (1 + kSlack) * std::sqrt(least), [&](std::size_t cell) {
      if (cell != guess) std::ranges::for_each(impl_->held_by(cell), look_at);
      return true;
    });
  else
    for (Impl::Index t = 0; t < impl_->triangles.size(); ++t) look_at(t);
  return closest;
}

std::optional<SurfacePoint> LeafDomain::closest_to(const Point& p, double distance) const {
  const auto closest = closest_triangle(p, distance, std::nullopt);
  if (!closest) return std::nullopt;
  const Triangle& triangle = impl_->triangles[closest->triangle];
  return SurfacePoint{closest->place, {sheet_of(triangle), normal_of(triangle.corners)}};
}

SheetId LeafDomain::sheet_of_facet(const std::array<Point, 3>& corners, BodyId behind,
                                   BodyId before) const {
  if (impl_->only_sheet) return *impl_->only_sheet;
  std::array<Point, 3> sorted = corners;  // the same centroid in whatever order they come
  std::ranges::sort(sorted);
  const Point centroid = 1.0 / 3 * (sorted[0] + sorted[1] + sorted[2]);
  auto closest = closest_triangle(centroid, kAnywhere, std::nullopt);
  if (!closest) return kOnlySheet;
  // Nearly always it parts these bodies; not so beside a thin layer, where facets lie deeper.
  const DomainState change = DomainState::between(behind, before);
  if (!only_body_ && change_across(impl_->triangles[closest->triangle]) != change)
    if (const auto other = closest_triangle(centroid, kAnywhere, change)) closest = other;
  return sheet_of(impl_->triangles[closest->triangle]);
}

void LeafDomain::changes_at(const Point& p, double tolerance, std::vector<DomainState>& out) const {
  out.clear();
  impl_->for_each_held_near(p, tolerance, [&](Impl::Index t) {
    const DomainState change = change_across(impl_->triangles[t]);
    if (std::ranges::find(out, change) == out.end() &&
        impl_->boxes[t].squared_distance(p) < tolerance * tolerance &&
        squared_distance(impl_->triangles[t], p) < tolerance * tolerance)
      out.push_back(change);
    return true;
  });
}

// Edges of a crease that meet have their common end equally close: of these the first is taken.
std::optional<CreasePoint> LeafDomain::closest_on_crease(const Point& p, double distance) const {
  constexpr double kSlack = 1e-12;
  std::optional<CreasePoint> closest;
  double least = distance * distance, bound = least;
  impl_->crease_tree.for_each_within(p, bound, [&](std::size_t edge) {
    const auto& [a, b] = impl_->creases[edge].ends;
    const Point q = closest_on_segment(a, b, p);
    const double squared = squared_distance(p, q);
    if (squared < least || (squared == least && closest && edge < closest->edge)) {
      closest = {q, edge};
      least = squared;
      bound = std::min(bound, (1 + kSlack) * least + std::numeric_limits<double>::min());
    }
  });
  return closest;
}

void LeafDomain::triangles_near(const Point& p, double distance, std::vector<Triangle>& out) const {
  std::vector<Impl::Index> near;
  impl_->for_each_held_near(p, distance, [&](Impl::Index t) {
    if (impl_->boxes[t].squared_distance(p) < distance * distance) near.push_back(t);
    return true;
  });
  if (near.size() > impl_->triangles.size() / 32)
    sort_and_unite_most(near, impl_->triangles.size());
  else
    sort_and_unite(near);
  out.clear();
  out.reserve(near.size());
  for (const Impl::Index t : near) out.push_back(impl_->triangles[t]);
}

void LeafDomain::vertices_near(const Point& p, double distance, std::vector<Point>& out) const {
  out.clear();
  std::vector<Triangle> near;
  triangles_near(p, distance, near);
  for (const Triangle& t : near) out.insert(out.end(), t.corners.begin(), t.corners.end());
  sort_and_unite(out);
}

std::vector<Point> LeafDomain::vertices() const {
  std::vector<Point> all;
  for (const Triangle& t : impl_->triangles)
    all.insert(all.end(), t.corners.begin(), t.corners.end());
  sort_and_unite(all);
  return all;
}

// By the normals of what is near, against that of what is nearest. Shells of two bodies that lie in
// each other face each other, too, though both face the same way.
bool LeafDomain::is_fold(const Point& p, double distance) const {
  constexpr double kCosineOfFold = -0.5;  // parts at less than 60° face each other
  std::vector<Triangle> near;
  triangles_near(p, distance, near);
  struct Facing {
    Point normal;
    DomainState change;
  };
  std::vector<Facing> all;
  double nearest = distance * distance;
  Facing here;
  for (const Triangle& t : near) {
    const double squared = squared_distance(t, p);
    const auto& [a, b, c] = t.corners;
    const Point area = cross(b - a, c - a);
    const double length = norm(area);
    if (!(squared < distance * distance && length > 0)) continue;
    all.push_back({(1 / length) * area, change_across(t)});
    if (squared < nearest) {
      nearest = squared;
      here = all.back();
    }
  }
  return std::ranges::any_of(all, [&](const Facing& other) {
    const double cosine = dot(here.normal, other.normal);
    return cosine < kCosineOfFold || (other.change != here.change && cosine > -kCosineOfFold);
  });
}

}  // namespace locvol
