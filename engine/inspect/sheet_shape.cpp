#include "engine/inspect/sheet_shape.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace locvol {
namespace {

using Matrix3 = std::array<std::array<double, 3>, 3>;

Point normalized(const Point& v) {
  const double length = norm(v);
  return length > 0 ? (1 / length) * v : Point{};
}

// The eigenvector of the smallest eigenvalue of a symmetric matrix, by Jacobi's rotations.
Point least_axis(Matrix3 a) {
  Matrix3 axes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // columns
  for (int sweep = 0; sweep < 30; ++sweep)
    for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
      if (a[p][q] == 0) continue;
      const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const double t = std::copysign(1 / (std::abs(theta) + std::hypot(theta, 1)), theta);
      const double c = 1 / std::hypot(t, 1), s = t * c;
      for (std::size_t k = 0; k < 3; ++k) {
        const double of_p = a[k][p], of_q = a[k][q];
        a[k][p] = c * of_p - s * of_q;
        a[k][q] = s * of_p + c * of_q;
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const double of_p = a[p][k], of_q = a[q][k];
        a[p][k] = c * of_p - s * of_q;
        a[q][k] = s * of_p + c * of_q;
        const double axis_p = axes[k][p], axis_q = axes[k][q];
        axes[k][p] = c * axis_p - s * axis_q;
        axes[k][q] = s * axis_p + c * axis_q;
      }
    }
  std::size_t least = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (a[k][k] < a[least][least]) least = k;
  return normalized({axes[0][least], axes[1][least], axes[2][least]});
}

// Solves n linear equations, each with its right side last; nothing if they tell no one solution.
template <std::size_t n>
std::optional<std::array<double, n>> solved(std::array<std::array<double, n + 1>, n> rows) {
  constexpr double kSingular = 1e-13;
  double largest = 0;
  for (const auto& row : rows)
    for (std::size_t k = 0; k < n; ++k) largest = std::max(largest, std::abs(row[k]));
  for (std::size_t k = 0; k < n; ++k) {
    const auto pivot = std::ranges::max_element(
        rows.begin() + static_cast<std::ptrdiff_t>(k), rows.end(), {},
        [&](const std::array<double, n + 1>& row) { return std::abs(row[k]); });
    if (!(std::abs((*pivot)[k]) > kSingular * largest)) return std::nullopt;
    std::swap(rows[k], *pivot);
    for (std::size_t other = 0; other < n; ++other) {
      if (other == k) continue;
      const double factor = rows[other][k] / rows[k][k];
      for (std::size_t j = k; j <= n; ++j) rows[other][j] -= factor * rows[k][j];
    }
  }
  std::array<double, n> solution;
  for (std::size_t k = 0; k < n; ++k) solution[k] = rows[k][n] / rows[k][k];
  return solution;
}

// Two unit vectors across it.
std::pair<Point, Point> axes_across(const Point& axis) {
  const double x = std::abs(axis.x), y = std::abs(axis.y), z = std::abs(axis.z);
  const Point other = x <= y && x <= z ? Point{1, 0, 0} : y <= z ? Point{0, 1, 0} : Point{0, 0, 1};
  const Point u = normalized(cross(axis, other));
  return {u, cross(axis, u)};
}

// From the axis or the center to a place.
Point out_of(const SheetShape& shape, const Point& place) {
  const Point from = place - shape.place;
  return shape.form == SheetForm::kSphere ? from
                                          : from - dot(from, shape.direction) * shape.direction;
}

}  // namespace

void ShapeSums::add(const std::array<Point, 3>& corners) {
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
  const Point axis = least_axis({{{squares.x, mixed.x, mixed.z},
                                  {mixed.x, squares.y, mixed.y},
                                  {mixed.z, mixed.y, squares.z}}});
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

ShapeCheck::ShapeCheck(const ShapeSums& sums) : flatness_(sums.flatness()) {
  constexpr double kLeastOfPlane = 0.9;  // of what is closed, the normal is rounding
  if (flatness_ > kLeastOfPlane) candidates_[0].shape = sums.plane();
  candidates_[1].shape = sums.cylinder().value_or(SheetShape{});
  candidates_[2].shape = sums.sphere().value_or(SheetShape{});
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
      const double off = shape.form == SheetForm::kPlane
                             ? dot(corners[k] - shape.place, shape.direction)
                             : norm(out[k]) - shape.radius;
      shape.deviation = std::max(shape.deviation, std::abs(off));
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
    const double half = 0.5 * kLeastTriangles * candidate.most_turn;
    if (half >= std::numbers::pi) continue;
    const double most =
        shape.form == SheetForm::kCylinder ? std::sin(half) / half : 0.5 * (1 + std::cos(half));
    if (!(flatness_ <= most)) continue;
    shape.is_hollow = candidate.facing < 0;
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
