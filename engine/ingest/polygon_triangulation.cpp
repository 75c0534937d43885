#include "engine/ingest/polygon_triangulation.h"

#include <algorithm>
#include <cmath>

#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

// Twice the polygon's area vector (Newell), taken from its first corner.
Point area_vector(std::span<const Point> corners) {
  Point sum;
  for (std::size_t i = 1; i + 1 < corners.size(); ++i)
    sum = sum + cross(corners[i] - corners[0], corners[i + 1] - corners[0]);
  return sum;
}

int largest_axis(const Point& v) {
  const double x = std::abs(v.x), y = std::abs(v.y), z = std::abs(v.z);
  return x > y && x > z ? 0 : y > z ? 1 : 2;
}

bool are_all_collinear(std::span<const Point> corners) {
  for (std::size_t i = 2; i < corners.size(); ++i)
    if (!are_collinear(corners[0], corners[1], corners[i])) return false;
  return true;
}

class EarClipper {
 public:
  explicit EarClipper(std::span<const Point> corners) : corners_(corners) {
    const Point area = area_vector(corners);
    axis_ = largest_axis(area);
    sign_ = area[axis_] < 0 ? -1 : 1;
    const auto n = static_cast<std::uint32_t>(corners.size());
    for (std::uint32_t i = 0; i < n; ++i) ring_.push_back({(i + n - 1) % n, (i + 1) % n});
    for (std::uint32_t i = 0; i < n; ++i) update(i);
    late_reflex_.clear();  // these are found in the ring
    for (Corner& corner : ring_) corner.num_late = 0;
  }

  bool run(std::vector<std::array<std::uint32_t, 3>>& triangles) {
    std::size_t num_left = corners_.size();
    std::size_t num_tried = 0;  // since the last ear
    for (std::uint32_t i = 0; num_left > 3; i = ring_[i].next) {
      if (!is_ear(i)) {
        if (++num_tried > num_left) return false;
        continue;
      }
      triangles.push_back(triangle_at(i));
      clip(i);
      --num_left;
      num_tried = 0;
      last_ = ring_[i].next;
    }
    triangles.push_back(triangle_at(last_));
    return turn(ring_[last_].previous, last_, ring_[last_].next) > 0;
  }

 private:
  struct Corner {
    std::uint32_t previous, next;
    bool is_reflex = false;  // or straight; of a corner that is clipped, no longer
    // How far is_ear() has searched for a corner in the way.
    std::uint32_t searched = 0;  // the next corner of the ring to look at
    std::size_t num_late = 0;    // of late_reflex_
  };

  int turn(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
    return sign_ * orientation_along(axis_, corners_[a], corners_[b], corners_[c]);
  }

  std::array<std::uint32_t, 3> triangle_at(std::uint32_t i) const {
    return {ring_[i].previous, i, ring_[i].next};
  }

  // The corner i has new neighbors.
  void update(std::uint32_t i) {
    Corner& corner = ring_[i];
    const bool was_reflex = corner.is_reflex;
    corner.is_reflex = turn(corner.previous, i, corner.next) <= 0;
    if (corner.is_reflex && !was_reflex) late_reflex_.push_back(i);
    corner.searched = ring_[corner.next].next;
    corner.num_late = late_reflex_.size();
  }

  // A corner found out of the way of a triangle stays so, unless it becomes reflex. So each search
  // goes on where the last one for the same triangle stopped, and all of them together take a time
  // that grows with the square of the corners, however few ears there are. Corners clipped since
  // still lead on to those behind them.
  bool is_ear(std::uint32_t i) {
    Corner& corner = ring_[i];
    if (corner.is_reflex) return false;
    for (; corner.searched != corner.previous; corner.searched = ring_[corner.searched].next)
      if (is_in_the_way(corner.searched, i)) return false;
    for (; corner.num_late < late_reflex_.size(); ++corner.num_late)
      if (is_in_the_way(late_reflex_[corner.num_late], i)) return false;
    return true;
  }

  // Only a reflex or straight corner can lie in the triangle of a convex one.
  bool is_in_the_way(std::uint32_t p, std::uint32_t i) const {
    if (!ring_[p].is_reflex) return false;
    const auto [a, b, c] = triangle_at(i);
    if (!is_in_box(p, a, b, c) || is_at(p, a) || is_at(p, b) || is_at(p, c)) return false;
    return turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0;
  }

  // Saves most of the exact tests.
  bool is_in_box(std::uint32_t p, std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
    for (const int axis : {(axis_ + 1) % 3, (axis_ + 2) % 3}) {
      const auto [low, high] =
          std::minmax({corners_[a][axis], corners_[b][axis], corners_[c][axis]});
      if (corners_[p][axis] < low || corners_[p][axis] > high) return false;
    }
    return true;
  }

  bool is_at(std::uint32_t p, std::uint32_t q) const { return corners_[p] == corners_[q]; }

  void clip(std::uint32_t i) {
    const auto [a, clipped, c] = triangle_at(i);
    ring_[a].next = c;
    ring_[c].previous = a;
    ring_[clipped].is_reflex = false;
    update(a);
    update(c);
  }

  std::span<const Point> corners_;
  int axis_ = 2;
  int sign_ = 1;
  std::vector<Corner> ring_;
  std::vector<std::uint32_t> late_reflex_;  // corners in the order in which they became reflex
  std::uint32_t last_ = 0;                  // a corner that is not clipped
};

}  // namespace

bool triangulate_polygon(std::span<const Point> corners,
                         std::vector<std::array<std::uint32_t, 3>>& triangles) {
  triangles.clear();
  if (are_all_collinear(corners)) {
    for (std::uint32_t i = 1; i + 1 < corners.size(); ++i) triangles.push_back({0, i, i + 1});
    return true;
  }
  return EarClipper(corners).run(triangles);
}

}  // namespace locvol
