#include "engine/ingest/near_points.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "octree/disjoint_sets.h"

namespace locvol {
namespace {

// A cube of the grid with its points: from `begin` to `end` in the list by cubes.
struct FilledCube {
  GridCube at;
  std::uint32_t begin = 0, end = 0;
};

// All points of a cube are nearer to each other than the distance, for its side is at most half of
// it. So cubes are united rather than points, and two are looked at until a pair of near points is
// found.
class NearPointFinder {
 public:
  NearPointFinder(std::span<const Point> points, double distance)
      : points_(points),
        distance_(distance),
        side_(grid_side_up_to(distance / 2)),
        reach_(static_cast<int>(std::ceil(distance / side_))) {}

  PointGroups run() {
    fill_cubes();
    sets_.reset(cubes_.size());
    unite_along(0, 0);
    for (int j = 1; j <= reach_; ++j) unite_along(0, j);
    for (int i = 1; i <= reach_; ++i)
      for (int j = -reach_; j <= reach_; ++j) unite_along(i, j);
    return groups();
  }

 private:
  void fill_cubes() {
    std::vector<std::pair<GridCube, std::uint32_t>> places(points_.size());
    for (std::uint32_t p = 0; p < places.size(); ++p) places[p] = {cube_of(points_[p], side_), p};
    std::ranges::sort(places);
    by_cube_.reserve(places.size());
    for (const auto& [cube, p] : places) {
      if (cubes_.empty() || cubes_.back().at != cube)
        cubes_.push_back({cube, static_cast<std::uint32_t>(by_cube_.size()), 0});
      by_cube_.push_back(p);
      cubes_.back().end = static_cast<std::uint32_t>(by_cube_.size());
    }
  }

  // Each cube with those beyond it that are i and j cubes away in x and y, and within reach in z.
  // What is looked at moves on in the list as the cube does.
  void unite_along(int i, int j) {
    std::size_t from = 0;
    for (std::uint32_t c = 0; c < cubes_.size(); ++c) {
      const GridCube& at = cubes_[c].at;
      const double x = at[0] + i, y = at[1] + j;
      const GridCube low{x, y, i == 0 && j == 0 ? at[2] : at[2] - reach_};
      while (from < cubes_.size() && cubes_[from].at < low) ++from;
      const GridCube high{x, y, at[2] + reach_};
      for (std::size_t n = from; n < cubes_.size() && cubes_[n].at <= high; ++n)
        unite(c, static_cast<std::uint32_t>(n));
    }
  }

  void unite(std::uint32_t a, std::uint32_t b) {
    if (sets_.find(a) != sets_.find(b) && have_near_points(cubes_[a], cubes_[b])) sets_.unite(a, b);
  }

  bool have_near_points(const FilledCube& a, const FilledCube& b) const {
    for (std::uint32_t p = a.begin; p < a.end; ++p)
      for (std::uint32_t q = b.begin; q < b.end; ++q)
        if (distance_between(points_[by_cube_[p]], points_[by_cube_[q]]) < distance_) return true;
    return false;
  }

  PointGroups groups() {
    constexpr std::uint32_t kNone = 0xffffffff;
    std::vector<std::uint32_t> cube_of_point(points_.size());
    for (std::uint32_t c = 0; c < cubes_.size(); ++c)
      for (std::uint32_t p = cubes_[c].begin; p < cubes_[c].end; ++p)
        cube_of_point[by_cube_[p]] = c;
    std::vector<std::uint32_t> number(cubes_.size(), kNone);  // by their sets
    PointGroups result;
    result.of_point.resize(points_.size());
    for (std::uint32_t p = 0; p < points_.size(); ++p) {
      std::uint32_t& group = number[sets_.find(cube_of_point[p])];
      if (group == kNone) {
        group = static_cast<std::uint32_t>(result.groups.size());
        result.groups.push_back({p, 0, Box::around(points_[p])});
      }
      PointGroup& its = result.groups[group];
      ++its.count;
      its.box = its.box.joined(points_[p]);
      result.of_point[p] = group;
    }
    return result;
  }

  std::span<const Point> points_;
  double distance_, side_;
  int reach_;                      // cubes
  std::vector<FilledCube> cubes_;  // ascending
  std::vector<std::uint32_t> by_cube_;
  DisjointSets sets_;  // of cubes
};

}  // namespace

double PointGroup::width() const { return distance_between(box.min, box.max); }

double distance_between(const Point& p, const Point& q) {
  return std::hypot(p.x - q.x, p.y - q.y, p.z - q.z);
}

double grid_side_up_to(double length) { return std::ldexp(1.0, std::ilogb(length)); }

GridCube cube_of(const Point& p, double side) {
  return {std::floor(p.x / side), std::floor(p.y / side), std::floor(p.z / side)};
}

PointGroups near_groups(std::span<const Point> points, double distance) {
  return NearPointFinder(points, distance).run();
}

}  // namespace locvol
