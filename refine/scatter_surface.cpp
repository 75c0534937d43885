#include "refine/scatter_surface.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <random>
#include <set>
#include <span>
#include <utility>

namespace locvol {
namespace {

using Indices = std::vector<std::size_t>;

double area(const Triangle& t) {
  return 0.5 * norm(cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]));
}

// The smallest index in i's set; halves the path on the way.
std::size_t root_of(Indices& parents, std::size_t i) {
  while (parents[i] != i) i = parents[i] = parents[parents[i]];
  return i;
}

// Triangle indices by connected component, both in ascending order.
std::vector<Indices> components(std::span<const Triangle> triangles) {
  std::vector<std::pair<Point, std::size_t>> corners;
  corners.reserve(3 * triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i)
    for (const Point& corner : triangles[i].corners) corners.emplace_back(corner, i);
  std::ranges::sort(corners);

  Indices parents(triangles.size());
  std::iota(parents.begin(), parents.end(), std::size_t{0});
  for (std::size_t i = 1; i < corners.size(); ++i) {
    if (corners[i].first != corners[i - 1].first) continue;
    const auto [low, high] =
        std::minmax({root_of(parents, corners[i].second), root_of(parents, corners[i - 1].second)});
    parents[high] = low;
  }

  std::vector<Indices> found;
  Indices place(triangles.size());  // of a root's component in `found`
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::size_t root = root_of(parents, i);
    if (root == i) {
      place[i] = found.size();
      found.emplace_back();
    }
    found[place[root]].push_back(i);
  }
  return found;
}

// The standard's distributions may differ between libraries, its engine does not.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }  // in [0, 1)

 private:
  std::mt19937_64 engine_;
};

// Uniform over the triangle.
Point random_point(const Triangle& t, Random& random) {
  const double r = std::sqrt(random.uniform());
  const double s = random.uniform();
  const auto& [a, b, c] = t.corners;
  return a + (r * (1 - s)) * (b - a) + (r * s) * (c - a);
}

}  // namespace

std::vector<Point> scatter_on_surface(const LeafDomain& domain, std::uint64_t seed) {
  const std::span<const Triangle> triangles = domain.triangles();
  const std::vector<Indices> parts = components(triangles);
  std::vector<Point> points;
  std::set<Point> taken;
  Random random(seed);
  for (const Indices& part : parts) {
    std::vector<double> areas;  // of the component's triangles up to and with each
    for (const std::size_t i : part)
      areas.push_back(area(triangles[i]) + (areas.empty() ? 0 : areas.back()));
    for (std::size_t n = 30 / parts.size() + 12; n > 0; --n) {
      const auto drawn = std::ranges::upper_bound(areas, random.uniform() * areas.back());
      const auto i = std::min(static_cast<std::size_t>(drawn - areas.begin()), part.size() - 1);
      const Point point = random_point(triangles[part[i]], random);
      if (taken.insert(point).second) points.push_back(point);
    }
  }
  return points;
}

}  // namespace locvol
