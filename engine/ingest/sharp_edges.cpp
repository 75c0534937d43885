#include "engine/ingest/sharp_edges.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace locvol {
namespace {

constexpr double kNeedleHeight = 1e-5;  // over the longest edge
constexpr int kMostSteps = 1000;        // from needle to needle

const Needle* find_needle(const std::vector<Needle>& needles, std::uint64_t id) {
  const auto place = std::ranges::lower_bound(needles, id, {}, &Needle::id);
  return place != needles.end() && place->id == id ? &*place : nullptr;
}

}  // namespace

TriangleDirection direction_of(const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const Point normal = cross(b - a, c - a);
  const double twice_area = norm(normal);
  const std::array<double, 3> squares = {squared_distance(a, b), squared_distance(b, c),
                                         squared_distance(c, a)};
  const auto longest = std::ranges::max_element(squares);
  return {twice_area > 0 ? (1 / twice_area) * normal : Point{},
          twice_area < kNeedleHeight * *longest,
          static_cast<std::uint32_t>(longest - squares.begin())};
}

void SharpEdges::add(const SharpEdges& others) {
  num_edges += others.num_edges;
  num_needles += others.num_needles;
  if (num_needles > kMaxNeedles)
    needles = {};
  else
    needles.insert(needles.end(), others.needles.begin(), others.needles.end());
}

SharpAngle::SharpAngle(double degrees)
    : is_given_(degrees > 0), least_cosine_(std::cos(degrees * std::numbers::pi / 180)) {}

SharpEdges sharp_edges_of(std::span<const Triangle> triangles,
                          std::span<const TriangleCorners> soup, const Mates& mates,
                          const SharpAngle& angle,
                          const std::function<bool(std::uint32_t half_edge)>& is_ours) {
  std::vector<TriangleDirection> directions(triangles.size());
  std::ranges::transform(triangles, directions.begin(), direction_of);
  SharpEdges found;
  for (std::uint32_t h = 0; h < mates.size(); ++h) {
    const std::uint32_t g = mates[h];
    if (g == kNoHalfEdge) continue;
    const TriangleDirection &one = directions[h / 3], &other = directions[g / 3];
    const bool is_turned = is_turned_across(soup, g, h);
    if (h < g &&
        (one.is_needle || other.is_needle ||
         angle.is_exceeded(one.normal, other.normal, is_turned)) &&
        is_ours(h))
      ++found.num_edges;
    if (!one.is_needle || h % 3 != one.longest_edge || !is_ours(h)) continue;
    const Point& across = other.is_needle ? one.normal : other.normal;
    found.needles.push_back({triangles[h / 3].id, triangles[g / 3].id,
                             is_turned && !other.is_needle ? -1.0 * across : across, is_turned,
                             other.is_needle});
  }
  found.num_needles = found.needles.size();
  return found;
}

NeedleNormals::NeedleNormals(std::vector<Needle> needles) : needles_(std::move(needles)) {
  std::ranges::sort(needles_, {}, &Needle::id);
  std::vector<Point> normals;
  normals.reserve(needles_.size());
  for (const Needle& needle : needles_) {
    const Needle* end = &needle;
    bool is_turned = false;
    int num_steps = 0;
    while (end != nullptr && end->is_next_to_needle && num_steps++ < kMostSteps) {
      is_turned = is_turned != end->is_turned;
      end = find_needle(needles_, end->across);
    }
    const bool is_found = end != nullptr && !end->is_next_to_needle;
    const Point normal = is_found ? end->normal : needle.normal;
    normals.push_back(is_found && is_turned ? -1.0 * normal : normal);
  }
  for (std::size_t i = 0; i < needles_.size(); ++i) needles_[i].normal = normals[i];
}

Point NeedleNormals::normal_of(const Triangle& triangle) const {
  const TriangleDirection direction = direction_of(triangle);
  const Needle* needle = direction.is_needle ? find_needle(needles_, triangle.id) : nullptr;
  return needle ? needle->normal : direction.normal;
}

}  // namespace locvol
