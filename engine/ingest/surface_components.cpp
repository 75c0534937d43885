#include "engine/ingest/surface_components.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "refine/domain/exact_predicates.h"

namespace locvol {

void SurfaceComponent::add(const SurfaceComponent& other, bool is_turned) {
  if (is_above(other.top, top)) top = other.top;
  CompensatedSum its = other.six_volume;
  if (is_turned) its.negate();
  six_volume.add(its);
  six_volume_error += other.six_volume_error;
  num_triangles += other.num_triangles;
  num_turned += is_turned ? other.num_triangles - other.num_turned : other.num_turned;
}

void SurfaceComponent::add_corners(const Triangle& triangle) {
  for (const Point& p : triangle.corners)
    if (is_above(p, top)) top = p;
}

void SurfaceComponent::add_volume(const Triangle& triangle, bool is_turned, double z) {
  const auto& [a, b, c] = triangle.corners;
  ++num_triangles;
  if (is_turned) ++num_turned;
  const Point u = b - a, v = c - a;
  const double za = a.z - z, zb = b.z - z, zc = c.z - z;
  const double term = (za + zb + zc) * (u.x * v.y - u.y * v.x);
  six_volume.add(is_turned ? -term : term);
  six_volume_error += 16 * std::numeric_limits<double>::epsilon() *
                      (std::abs(za) + std::abs(zb) + std::abs(zc)) *
                      (std::abs(u.x * v.y) + std::abs(u.y * v.x));
}

Nesting::Nesting(std::span<const SurfaceComponent> components) {
  for (std::uint32_t c = 0; c < components.size(); ++c) queries_.push_back({components[c].top, c});
  build(0, queries_.size(), 0);
}

Nesting::Nesting(std::span<const std::array<Point, 3>> beside) : beside_(beside) {
  double largest = 0;
  for (std::uint32_t t = 0; t < beside.size(); ++t) {
    const auto& [a, b, c] = beside[t];
    queries_.push_back({1.0 / 3 * (a + b + c), t});
    largest = std::max({largest, max_norm(a), max_norm(b), max_norm(c)});
  }
  rounding_ = 16 * std::numeric_limits<double>::epsilon() * largest;
  build(0, queries_.size(), 0);
}

void Nesting::build(std::size_t begin, std::size_t end, int axis) {
  if (end - begin < 2) return;
  const std::size_t middle = begin + (end - begin) / 2;
  const auto at = [&](std::size_t i) { return queries_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(begin), at(middle), at(end), [axis](const Query& q, const Query& r) {
    return q.point[axis] != r.point[axis] ? q.point[axis] < r.point[axis]
                                          : q.component < r.component;
  });
  build(begin, middle, (axis + 1) % 3);
  build(middle + 1, end, (axis + 1) % 3);
}

// A component's own triangles are never above its highest vertex.
void Nesting::add(const Triangle& triangle, std::uint64_t mark) {
  Box box = triangle.box().expanded(rounding_);
  box.min.z = -std::numeric_limits<double>::infinity();
  visit(0, queries_.size(), 0, triangle, box, mark);
}

void Nesting::visit(std::size_t begin, std::size_t end, int axis, const Triangle& triangle,
                    const Box& box, std::uint64_t mark) {
  if (begin == end) return;
  const std::size_t middle = begin + (end - begin) / 2;
  Query& query = queries_[middle];
  if (box.contains(query.point) && is_crossed(query, triangle)) query.sum ^= mark;
  const double at = query.point[axis];
  if (box.min[axis] <= at) visit(begin, middle, (axis + 1) % 3, triangle, box, mark);
  if (box.max[axis] >= at) visit(middle + 1, end, (axis + 1) % 3, triangle, box, mark);
}

bool Nesting::is_crossed(const Query& query, const Triangle& triangle) const {
  return beside_.empty() ? ray_crosses(query.point, triangle) != 0
                         : ray_from_centroid_crosses(beside_[query.component], triangle);
}

std::vector<std::uint64_t> Nesting::sums() const {
  std::vector<std::uint64_t> sums(queries_.size());
  for (const Query& query : queries_) sums[query.component] = query.sum;
  return sums;
}

std::vector<bool> Nesting::cavities() const {
  std::vector<bool> is_cavity(queries_.size());
  for (const Query& query : queries_) is_cavity[query.component] = (query.sum & 1) != 0;
  return is_cavity;
}

}  // namespace locvol
