#include "engine/ingest/wall_probes.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "octree/mix.h"

namespace locvol {
namespace {

std::uint64_t hash_of(const std::array<Point, 3>& corners) {
  std::uint64_t sum = 0, factor = 0x9e3779b97f4a7c15;
  for (const Point& p : corners) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto bits = std::bit_cast<std::uint64_t>(p[axis]);
      sum += (bits ^ bits >> 32) * factor;
      factor *= 0xbf58476d1ce4e5b9;
    }
  }
  return mix(sum);
}

double fraction(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

// The steps that fill a square the most evenly, of those that a place is found by in one step.
constexpr double kStepX = 0.7548776662466927, kStepY = 0.5698402909980532;

// Two triangles face each other if their normals are within 32° of parallel; measured on wedges,
// whose edges are refined up to about that angle. They belong to sheets if lines that lean go
// 0.4 times as far as between two planes: in a rod they go a tenth to a third.
constexpr double kFacingCosine = 0.85, kFlatness = 0.4;
// Rods and holes that lie so close, in their own widths, are refined as sheets are: a sponge.
constexpr double kPacked = 3.5;

}  // namespace

void ProbePicker::add(const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const Point normal = cross(b - a, c - a);
  const double twice_area = norm(normal);
  if (!(twice_area > 0) || !std::isfinite(twice_area)) return;  // refused elsewhere
  const std::uint64_t hash = hash_of(triangle.corners);
  const double step = 2 / twice_area, phase = fraction(hash);
  if (!may_take(phase * step)) return;
  const double x0 = fraction(mix(hash ^ 1)), y0 = fraction(mix(hash ^ 2));
  for (std::uint64_t i = 0; i < kNumProbes && may_take((phase + static_cast<double>(i)) * step);
       ++i) {
    const auto n = static_cast<double>(i);
    double x = x0 + n * kStepX, y = y0 + n * kStepY;
    x -= std::floor(x);
    y -= std::floor(y);
    if (x + y > 1) {  // the other half of the parallelogram
      x = 1 - x;
      y = 1 - y;
    }
    add({.order = (phase + n) * step,
         .place = a + x * (b - a) + y * (c - a),
         .direction = (1 / twice_area) * normal,
         .corners = triangle.corners});
  }
}

void ProbePicker::add(const WallProbe& probe) {
  if (probes_.size() == kNumProbes) {
    if (!(probe < probes_.front())) return;
    std::ranges::pop_heap(probes_);
    probes_.pop_back();
  }
  probes_.push_back(probe);
  std::ranges::push_heap(probes_);
}

std::vector<WallProbe> ProbePicker::take() {
  std::ranges::sort(probes_);
  return std::exchange(probes_, {});
}

WallProbes::WallProbes(std::span<const WallProbe> probes, const Box& box)
    : rounding_(64 * std::numeric_limits<double>::epsilon() *
                std::max(max_norm(box.min), max_norm(box.max))) {
  lines_.reserve(kNumLines * probes.size());
  for (const WallProbe& probe : probes) {
    const Point& normal = probe.direction;
    const Point edge = probe.corners[1] - probe.corners[0];
    const Point along = (1 / norm(edge)) * edge;
    add_line(probe, normal);
    for (const Point& aside : {along, cross(normal, along)})
      add_line(probe, (1 / std::hypot(1, kLean)) * (normal + kLean * aside));
  }
}

void WallProbes::add_line(const WallProbe& probe, const Point& direction) {
  const Point axis = std::abs(direction.x) < 0.6 ? Point{1, 0, 0} : Point{0, 1, 0};
  const Point across = cross(direction, axis);
  const Point unit = (1 / norm(across)) * across;
  lines_.push_back({probe.place,
                    direction,
                    unit,
                    cross(direction, unit),
                    probe.corners,
                    {probe.place, direction}});
}

// Seen along the line, does the triangle go around it? What is rounded is the same for both
// triangles at an edge, so that a line passes one of them.
std::optional<LineHit> WallProbes::hit(std::uint32_t number,
                                       const std::array<Point, 3>& corners) const {
  const Line& line = lines_[number];
  std::array<double, 3> x, y, z;
  for (std::size_t i = 0; i < 3; ++i) {
    const Point to = corners[i] - line.place;
    x[i] = dot(to, line.across);
    y[i] = dot(to, line.beside);
    z[i] = dot(to, line.direction);
  }
  const double a = x[1] * y[2] - x[2] * y[1], b = x[2] * y[0] - x[0] * y[2],
               c = x[0] * y[1] - x[1] * y[0];
  const bool is_around = (a > 0 && b > 0 && c > 0) || (a < 0 && b < 0 && c < 0);
  if (!is_around || corners == line.corners) return std::nullopt;
  const double distance = (a * z[0] + b * z[1] + c * z[2]) / (a + b + c);
  if (std::abs(distance) <= rounding_) return std::nullopt;
  const Point normal = cross(corners[1] - corners[0], corners[2] - corners[0]);
  return LineHit{number, distance, std::abs(dot(normal, line.direction)) / norm(normal)};
}

// A hit is of the cell that has its place. That may be none, by a rounding, for a hit in a billion.
std::vector<LineHit> WallProbes::hits_in(
    const Box& cell, const TriangleTree& tree, std::span<const Point> vertices,
    std::span<const std::array<std::uint32_t, 3>> triangles) const {
  std::vector<LineHit> hits;
  for (std::uint32_t number = 0; number < lines_.size(); ++number) {
    const Line& line = lines_[number];
    TriangleTree::Stretch stretch = line.all;
    if (!stretch.meets(cell, rounding_)) continue;
    const bool is_straight = number % kNumLines == 0;
    tree.for_each_along(stretch, rounding_, [&](std::uint32_t t) {
      const auto& [a, b, c] = triangles[t];
      const auto met = hit(number, {vertices[a], vertices[b], vertices[c]});
      if (!met || !is_in_leaf(cell, line.place + met->distance * line.direction)) return;
      hits.push_back(*met);
      if (met->distance < 0)
        stretch.first = std::max(stretch.first, met->distance);
      else if (!is_straight)
        stretch.last = std::min(stretch.last, met->distance);
    });
  }
  return hits;
}

void LineSight::add(const LineHit& hit) {
  const bool is_ahead = hit.distance > 0;
  keep_nearer(is_ahead ? ahead_ : behind_, {std::abs(hit.distance), hit.cosine});
  is_odd_ahead_ ^= is_ahead;
}

void LineSight::add(const LineSight& other) {
  keep_nearer(ahead_, other.ahead_);
  keep_nearer(behind_, other.behind_);
  is_odd_ahead_ ^= other.is_odd_ahead_;
}

void add(LineSights& all, const LineSights& others) {
  if (all.empty()) all.resize(others.size());
  assert(others.empty() || all.size() == others.size());
  for (std::size_t i = 0; i < others.size(); ++i) all[i].add(others[i]);
}

namespace {

struct Facing {
  double distance = 0;
  bool is_flat = false;  // two sheets, as far as the lines that lean can tell
};

// The surface that a probe's lines meet on one side, if it faces the probe's.
std::optional<Facing> facing_on(std::span<const LineSight> lines, bool is_ahead) {
  const LineSight::Nearest& across = lines.front().nearest(is_ahead);
  if (!std::isfinite(across.distance) || across.cosine < kFacingCosine) return std::nullopt;
  const double of_sheet = across.distance * std::hypot(1, WallProbes::kLean);
  const bool is_flat = std::ranges::all_of(lines.subspan(1), [&](const LineSight& leaning) {
    return leaning.nearest(is_ahead).distance >= kFlatness * of_sheet;
  });
  return Facing{across.distance, is_flat};
}

std::int32_t step_of(double distance) {
  return static_cast<std::int32_t>(std::floor(std::log2(distance) * FacingPlaces::kStepsPerOctave));
}

}  // namespace

FacingFacts facing_facts(const LineSights& sights) {
  FacingFacts facts;
  std::map<std::int32_t, FacingPlaces> by_step;
  for (std::size_t i = 0; i < sights.size(); i += WallProbes::kNumLines) {
    const std::span lines = std::span(sights).subspan(i, WallProbes::kNumLines);
    const bool is_ahead = lines.front().is_inside_ahead();
    ++facts.num_places;
    const auto inside = facing_on(lines, is_ahead), outside = facing_on(lines, !is_ahead);
    if (!inside && !outside) continue;
    const bool is_outside = !inside || (outside && outside->distance < inside->distance);
    const auto [distance, is_flat] = is_outside ? *outside : *inside;
    const double beyond = lines.front().nearest(is_outside == is_ahead).distance;
    const bool is_sheet = is_flat || beyond <= kPacked * distance;
    FacingPlaces& places = by_step[step_of(distance)];
    places.step = step_of(distance);
    ++(is_outside ? (is_sheet ? places.num_gaps : places.num_holes)
                  : (is_sheet ? places.num_walls : places.num_rods));
  }
  for (const auto& [step, places] : by_step) facts.places.push_back(places);
  return facts;
}

}  // namespace locvol
