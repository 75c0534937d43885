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

// Against the first triangle at each vertex.
std::uint64_t num_pointed(std::span<const TriangleDirection> directions, const TriangleSoup& soup,
                          const std::vector<bool>& is_turned, const SharpAngle& angle,
                          const std::vector<std::uint8_t>& is_owned) {
  constexpr std::uint32_t kNone = 0xffffffff;
  std::vector<std::uint32_t> first(soup.vertices.size(), kNone);
  std::vector<bool> is_pointed(soup.vertices.size());
  for (std::uint32_t t = 0; t < directions.size(); ++t) {
    for (const std::uint32_t v : soup.triangles[t]) {
      if (first[v] == kNone)
        first[v] = t;
      else if (angle.is_exceeded(directions[first[v]].normal, directions[t].normal,
                                 is_turned[first[v]] != is_turned[t]))
        is_pointed[v] = true;
    }
  }
  std::uint64_t num = 0;
  for (std::size_t v = 0; v < is_pointed.size(); ++v) num += is_pointed[v] && is_owned[v] ? 1 : 0;
  return num;
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
  num_pointed += others.num_pointed;
  num_needles += others.num_needles;
  if (num_needles > kMaxNeedles)
    needles = {};
  else
    needles.insert(needles.end(), others.needles.begin(), others.needles.end());
}

SharpAngle::SharpAngle(double degrees, std::uint64_t first_over_hole)
    : is_given_(degrees > 0),
      least_cosine_(std::cos(degrees * std::numbers::pi / 180)),
      first_over_hole_(first_over_hole) {}

SharpEdges sharp_edges_of(std::span<const Triangle> triangles, const TriangleSoup& soup,
                          const Mates& mates, const std::vector<bool>& is_turned,
                          const SharpAngle& angle,
                          const std::function<bool(std::uint32_t half_edge)>& is_ours,
                          const std::vector<std::uint8_t>& is_owned) {
  std::vector<TriangleDirection> directions(triangles.size());
  std::ranges::transform(triangles, directions.begin(), direction_of);
  SharpEdges found;
  for (std::uint32_t h = 0; h < mates.size(); ++h) {
    const std::uint32_t g = mates[h];
    if (g == kNoHalfEdge) continue;
    const TriangleDirection &one = directions[h / 3], &other = directions[g / 3];
    const bool turns = is_turned_across(soup.triangles, g, h);
    if (h < g &&
        (one.is_needle || other.is_needle || angle.is_exceeded(one.normal, other.normal, turns)) &&
        is_ours(h))
      ++found.num_edges;
    if (!one.is_needle || h % 3 != one.longest_edge || !is_ours(h)) continue;
    const Point& across = other.is_needle ? one.normal : other.normal;
    found.needles.push_back({triangles[h / 3].id, triangles[g / 3].id,
                             turns && !other.is_needle ? -1.0 * across : across, turns,
                             other.is_needle});
  }
  found.num_needles = found.needles.size();
  found.num_pointed = num_pointed(directions, soup, is_turned, angle, is_owned);
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
