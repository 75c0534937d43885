#include "engine/inspect/surface_thinner.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace locvol {

std::uint64_t SurfaceThinner::cube_at(const Point& p) const {
  const auto step = [&](double value, double origin) {
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 21) - 1;
    return static_cast<std::uint64_t>(std::llround((value - origin) / grid_) + 1) & kMask;
  };
  return step(p.x, origin_.x) << 42 | step(p.y, origin_.y) << 21 | step(p.z, origin_.z);
}

std::uint32_t SurfaceThinner::vertex_of(std::uint64_t cube) {
  const auto [place, is_new] =
      index_.try_emplace(cube, static_cast<std::uint32_t>(vertices_.size()));
  if (is_new) vertices_.push_back({.cube = cube, .sum = {}});
  return place->second;
}

void SurfaceThinner::add(const Triangle& triangle) {
  JoinedTriangle joined{.num = 1, .sheet = triangle.sheet};
  for (std::size_t i = 0; i < 3; ++i) {
    const Point& corner = triangle.corners[i];
    joined.vertices[i] = vertex_of(cube_at(corner));
    Vertex& vertex = vertices_[joined.vertices[i]];
    for (std::size_t axis = 0; axis < 3; ++axis)
      vertex.sum[axis].add(corner[static_cast<int>(axis)]);
    ++vertex.count;
  }
  const auto& [a, b, c] = joined.vertices;
  if (a != b && b != c && c != a) add(joined);
}

void SurfaceThinner::add(JoinedTriangle triangle) {
  auto& [t, num, sheet] = triangle;
  std::ranges::rotate(t, std::ranges::min_element(t));
  if (t[1] > t[2]) {
    std::swap(t[1], t[2]);
    num = -num;
  }
  const auto [place, is_new] = triangles_.try_emplace(t);
  Joined& joined = place->second;
  if (joined.num != 0) --num_triangles_;
  joined.num += num;
  joined.sheet = is_new ? sheet : std::min(joined.sheet, sheet);
  if (joined.num != 0) ++num_triangles_;
}

void SurfaceThinner::add(const Part& part) {
  std::vector<std::uint32_t> places;
  for (const auto& [cube, sum, count] : part.vertices) {
    places.push_back(vertex_of(cube));
    Vertex& vertex = vertices_[places.back()];
    for (std::size_t axis = 0; axis < 3; ++axis) vertex.sum[axis].add(sum[axis]);
    vertex.count += count;
  }
  for (JoinedTriangle triangle : part.triangles) {
    for (std::uint32_t& vertex : triangle.vertices) vertex = places.at(vertex);
    add(triangle);
  }
}

SurfaceThinner::Part SurfaceThinner::take_part() {
  Part part{.vertices = std::exchange(vertices_, {}), .triangles = {}};
  for (const auto& [vertices, joined] : std::exchange(triangles_, {}))
    part.triangles.push_back({vertices, joined.num, joined.sheet});
  std::ranges::sort(part.triangles, {}, &JoinedTriangle::vertices);  // no order of a table shows
  index_.clear();
  num_triangles_ = 0;
  return part;
}

ViewSurface SurfaceThinner::take() {
  ViewSurface surface;
  for (const auto& [cube, sum, count] : vertices_)
    surface.vertices.push_back((1 / static_cast<double>(count)) *
                               Point{sum[0].value(), sum[1].value(), sum[2].value()});
  using OfSheet = std::pair<std::array<std::uint32_t, 3>, SheetId>;
  std::vector<OfSheet> triangles;
  for (const auto& [t, joined] : triangles_)
    for (int i = 0; i < std::abs(joined.num); ++i)
      triangles.emplace_back(joined.num > 0 ? t : std::array{t[0], t[2], t[1]}, joined.sheet);
  std::ranges::sort(triangles);  // no order of a hash table shows
  for (const auto& [t, sheet] : triangles) {
    surface.triangles.push_back(t);
    surface.sheets.push_back(sheet);
  }
  return surface;
}

}  // namespace locvol
