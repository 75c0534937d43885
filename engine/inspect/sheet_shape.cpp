#include "engine/inspect/sheet_shape.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "engine/inspect/shape_algebra.h"
#include "engine/inspect/shape_fit.h"

namespace locvol {
namespace {

// From the axis, the center, or the circle in the middle of the tube, to a place.
Point out_of(const SheetShape& shape, const Point& place) {
  const Point from = place - shape.place;
  if (shape.form == SheetForm::kSphere) return from;
  const Point across = from - dot(from, shape.direction) * shape.direction;
  return shape.form == SheetForm::kTorus ? from - shape.radius * normalized(across) : across;
}

// How far a place is from it. `out`: out_of() there
double off_shape(const SheetShape& shape, const Point& place, const Point& out) {
  switch (shape.form) {
    case SheetForm::kPlane:
      return dot(place - shape.place, shape.direction);
    case SheetForm::kCone: {
      const double along = dot(place - shape.place, shape.direction);
      return std::cos(shape.half_angle) * norm(out) - std::sin(shape.half_angle) * along;
    }
    case SheetForm::kTorus:
      return norm(out) - shape.tube_radius;
    default:
      return norm(out) - shape.radius;
  }
}

// By which samples are chosen: it has nothing to do with where a corner is.
std::uint64_t mixed_bits(const Point& p) {
  std::uint64_t bits = 0;
  for (const double c : {p.x, p.y, p.z}) {
    bits += std::bit_cast<std::uint64_t>(c == 0 ? 0.0 : c) + 0x9e3779b97f4a7c15;
    bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9;
    bits = (bits ^ (bits >> 27)) * 0x94d049bb133111eb;
    bits ^= bits >> 31;
  }
  return bits;
}

}  // namespace

void ShapeSums::add_sample(const Point& corner) {
  const std::uint64_t bits = mixed_bits(corner);
  if (samples_.size() == kMostSamples && bits >= samples_.back().first) return;
  const auto place = std::ranges::lower_bound(samples_, std::pair(bits, corner));
  if (place != samples_.end() && place->second == corner) return;
  samples_.emplace(place, bits, corner);
  if (samples_.size() > kMostSamples) samples_.pop_back();
}

std::vector<Point> ShapeSums::samples() const {
  std::vector<Point> samples;
  for (const auto& [bits, corner] : samples_) samples.push_back(corner);
  return samples;
}

void ShapeSums::add(const std::array<Point, 3>& corners) {
  for (const Point& corner : corners) add_sample(corner);
  std::array<Point, 3> p;
  std::ranges::transform(corners, p.begin(), [&](const Point& c) { return c - origin_; });
  const Point area_vector = 0.5 * cross(p[1] - p[0], p[2] - p[0]);
  const double area = norm(area_vector);
  sums_[kArea].add(area);
  const auto add_vector = [&](std::size_t at, const Point& v) {
    for (int axis = 0; axis < 3; ++axis) sums_[at + static_cast<std::size_t>(axis)].add(v[axis]);
  };
  const auto add_product = [&](std::size_t at, const Point& v, double factor) {
    add_vector(at, factor * Point{v.x * v.x, v.y * v.y, v.z * v.z});
    add_vector(at + 3, factor * Point{v.x * v.y, v.y * v.z, v.z * v.x});
  };
  add_vector(kAreaVector, area_vector);
  add_vector(kCentroid, area / 3 * (p[0] + p[1] + p[2]));
  if (area > 0) add_product(kNormals, area_vector, 1 / area);
  sums_[kNumCorners].add(3);
  for (const Point& c : p) {
    add_vector(kFirst, c);
    add_product(kSecond, c, 1);
    add_vector(kThird, {c.x * c.x * c.x, c.y * c.y * c.y, c.z * c.z * c.z});
    add_vector(kThird + 3, {c.x * c.x * c.y, c.y * c.y * c.z, c.z * c.z * c.x});
    add_vector(kThird + 6, {c.x * c.x * c.z, c.y * c.y * c.x, c.z * c.z * c.y});
    sums_[kThird + 9].add(c.x * c.y * c.z);
  }
}

void ShapeSums::add(std::span<const CompensatedSum> sums) {
  for (std::size_t i = 0; i < kNumSums; ++i) sums_[i].add(sums[i]);
}

Point ShapeSums::centroid() const {
  return area() > 0 ? origin_ + 1 / area() * vector(kCentroid) : origin_;
}

double ShapeSums::flatness() const { return area() > 0 ? norm(area_vector()) / area() : 0; }

double ShapeSums::second(const Point& a, const Point& b) const {
  const Point squares = vector(kSecond), mixed = vector(kSecond + 3);
  return squares.x * a.x * b.x + squares.y * a.y * b.y + squares.z * a.z * b.z +
         mixed.x * (a.x * b.y + a.y * b.x) + mixed.y * (a.y * b.z + a.z * b.y) +
         mixed.z * (a.z * b.x + a.x * b.z);
}

// The sum of (p·a)(p·b)(p·c).
double ShapeSums::third(const Point& a, const Point& b, const Point& c) const {
  // By how often each axis is named.
  const auto moment = [&](int i, int j, int k) {
    std::array<int, 3> count{};
    for (const int axis : {i, j, k}) ++count[static_cast<std::size_t>(axis)];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (count[axis] == 3) return value(kThird + axis);
      if (count[axis] == 2) return value(kThird + (count[(axis + 1) % 3] == 1 ? 3 : 6) + axis);
    }
    return value(kThird + 9);
  };
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) sum += a[i] * b[j] * c[k] * moment(i, j, k);
  return sum;
}

SheetShape ShapeSums::plane() const {
  return {.form = SheetForm::kPlane, .place = centroid(), .direction = normalized(area_vector())};
}

// The axis is across all normals. Seen along it, x² + y² + d x + e y + f is 0 on the circle.
std::optional<SheetShape> ShapeSums::cylinder() const {
  const Point squares = vector(kNormals), mixed = vector(kNormals + 3);
  const Point axis = axes_of({{{squares.x, mixed.x, mixed.z},
                               {mixed.x, squares.y, mixed.y},
                               {mixed.z, mixed.y, squares.z}}})[0];
  const auto [u, v] = axes_across(axis);
  const Point first = vector(kFirst);
  const double of_u = dot(first, u), of_v = dot(first, v);
  const double uu = second(u, u), uv = second(u, v), vv = second(v, v);
  const auto circle = solved<3>({{{uu, uv, of_u, -third(u, u, u) - third(u, v, v)},
                                  {uv, vv, of_v, -third(u, u, v) - third(v, v, v)},
                                  {of_u, of_v, value(kNumCorners), -uu - vv}}});
  if (!circle) return std::nullopt;
  const auto [d, e, f] = *circle;
  const double squared = 0.25 * (d * d + e * e) - f;
  if (!(squared > 0)) return std::nullopt;
  const Point middle = centroid();
  const Point place = origin_ - 0.5 * d * u - 0.5 * e * v;
  return SheetShape{.form = SheetForm::kCylinder,
                    .place = place + dot(middle - place, axis) * axis,
                    .direction = axis,
                    .radius = std::sqrt(squared)};
}

std::optional<SheetShape> ShapeSums::sphere() const {
  constexpr std::array<Point, 3> kAxes = {Point{1, 0, 0}, Point{0, 1, 0}, Point{0, 0, 1}};
  std::array<std::array<double, 5>, 4> rows{};
  const Point first = vector(kFirst);
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      rows[i][j] = second(kAxes[i], kAxes[j]);
      rows[i][4] -= third(kAxes[j], kAxes[j], kAxes[i]);
    }
    rows[i][3] = rows[3][i] = first[static_cast<int>(i)];
    rows[3][4] -= second(kAxes[i], kAxes[i]);
  }
  rows[3][3] = value(kNumCorners);
  const auto sphere = solved<4>(rows);
  if (!sphere) return std::nullopt;
  const Point center = -0.5 * Point{(*sphere)[0], (*sphere)[1], (*sphere)[2]};
  const double squared = dot(center, center) - (*sphere)[3];
  if (!(squared > 0)) return std::nullopt;
  return SheetShape{.form = SheetForm::kSphere,
                    .place = origin_ + center,
                    .direction = {},
                    .radius = std::sqrt(squared)};
}

// Normals of a cone make one angle with its axis, so that they vary least along it.
std::array<Point, 3> ShapeSums::axes_of_normals() const {
  const double w = area() > 0 ? 1 / area() : 0;
  const Point mean = area_vector(), squares = vector(kNormals), mixed = vector(kNormals + 3);
  const double xy = mixed.x - w * mean.x * mean.y, yz = mixed.y - w * mean.y * mean.z,
               zx = mixed.z - w * mean.z * mean.x;
  return axes_of({{{squares.x - w * mean.x * mean.x, xy, zx},
                   {xy, squares.y - w * mean.y * mean.y, yz},
                   {zx, yz, squares.z - w * mean.z * mean.z}}});
}

std::optional<SheetShape> ShapeSums::cone(double tolerance) const {
  const auto cone = fitted_cone(samples(), axes_of_normals(), tolerance);
  if (!cone) return std::nullopt;
  return SheetShape{.form = SheetForm::kCone,
                    .place = cone->tip,
                    .direction = cone->axis,
                    .half_angle = cone->half_angle};
}

std::optional<SheetShape> ShapeSums::torus(double tolerance) const {
  const auto torus = fitted_torus(samples(), axes_of_normals(), tolerance);
  if (!torus) return std::nullopt;
  return SheetShape{.form = SheetForm::kTorus,
                    .place = torus->center,
                    .direction = torus->axis,
                    .radius = torus->radius,
                    .tube_radius = torus->tube_radius};
}

ShapeCheck::ShapeCheck(const ShapeSums& sums, double tolerance) : flatness_(sums.flatness()) {
  constexpr double kLeastOfPlane = 0.9;  // of what is closed, the normal is rounding
  if (flatness_ > kLeastOfPlane) candidates_[0].shape = sums.plane();
  candidates_[1].shape = sums.cylinder().value_or(SheetShape{});
  candidates_[2].shape = sums.sphere().value_or(SheetShape{});
  // To look for them takes 25 ms where there are none. A tip and a circle are on a sphere, too.
  const std::vector<Point> samples = sums.samples();
  const auto has_all = [&](const Candidate& candidate) {
    const SheetShape& shape = candidate.shape;
    return shape.form != SheetForm::kOther && std::ranges::all_of(samples, [&](const Point& p) {
             return std::abs(off_shape(shape, p, out_of(shape, p))) <= tolerance;
           });
  };
  if (has_all(candidates_[0]) || has_all(candidates_[1])) return;
  candidates_[3].shape = sums.cone(tolerance).value_or(SheetShape{});
  if (candidates_[3].shape.form == SheetForm::kOther)
    candidates_[4].shape = sums.torus(tolerance).value_or(SheetShape{});
}

void ShapeCheck::add(const std::array<Point, 3>& corners) {
  const Point area_vector = 0.5 * cross(corners[1] - corners[0], corners[2] - corners[0]);
  for (Candidate& candidate : candidates_) {
    SheetShape& shape = candidate.shape;
    if (shape.form == SheetForm::kOther) continue;
    std::array<Point, 3> out;
    std::ranges::transform(corners, out.begin(),
                           [&](const Point& corner) { return out_of(shape, corner); });
    for (std::size_t k = 0; k < 3; ++k) {
      shape.deviation = std::max(shape.deviation, std::abs(off_shape(shape, corners[k], out[k])));
      const Point& other = out[(k + 1) % 3];
      candidate.most_turn =
          std::max(candidate.most_turn, std::atan2(norm(cross(out[k], other)), dot(out[k], other)));
    }
    candidate.facing += dot(area_vector, normalized(out[0] + out[1] + out[2]));
  }
}

// A sheet that spans an angle a of a cylinder has the flatness sin(a/2) / (a/2), and one that is a
// cap of a sphere, a/2 from its pole to its rim, (1 + cos(a/2)) / 2.
SheetShape ShapeCheck::shape(double tolerance) const {
  constexpr double kLeastTriangles = 3;
  for (const Candidate& candidate : candidates_) {
    SheetShape shape = candidate.shape;
    if (shape.form == SheetForm::kOther || !(shape.deviation <= tolerance)) continue;
    if (shape.form == SheetForm::kPlane) return shape;
    shape.is_hollow = candidate.facing < 0;
    // Fitted to more corners than any shape can be bent to.
    if (shape.form == SheetForm::kCone || shape.form == SheetForm::kTorus) return shape;
    const double half = 0.5 * kLeastTriangles * candidate.most_turn;
    if (half >= std::numbers::pi) continue;
    const double most =
        shape.form == SheetForm::kCylinder ? std::sin(half) / half : 0.5 * (1 + std::cos(half));
    if (!(flatness_ <= most)) continue;
    return shape;
  }
  return {};
}

std::vector<double> ShapeCheck::found() const {
  std::vector<double> found;
  for (const Candidate& candidate : candidates_)
    found.insert(found.end(), {candidate.shape.deviation, candidate.most_turn, candidate.facing});
  return found;
}

void ShapeCheck::add_found(std::span<const double> found) {
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    Candidate& candidate = candidates_[i];
    candidate.shape.deviation = std::max(candidate.shape.deviation, found[3 * i]);
    candidate.most_turn = std::max(candidate.most_turn, found[3 * i + 1]);
    candidate.facing += found[3 * i + 2];
  }
}

}  // namespace locvol
