// TriangleTree finds triangles that are near each other, or near a line: a bounding volume tree
// over them along the Morton curve.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

inline constexpr double kEndless = std::numeric_limits<double>::infinity();
inline constexpr Box kEverywhere{{-kEndless, -kEndless, -kEndless}, {kEndless, kEndless, kEndless}};

// A tree without pointers: node i of level l has the children kFanOut·i … of level l - 1; level 0
// holds the triangles, with the part of their boxes in the region. CGAL's box_self_intersection_d()
// takes 1.4 times as long with 20,000 triangles, twice with 321,000.
// Memory: about 80 bytes a triangle.
class TriangleTree {
 public:
  // `margin`: by how much the triangles' boxes are wider than they are, on each side.
  TriangleTree(std::span<const Point> vertices,
               std::span<const std::array<std::uint32_t, 3>> triangles,
               const Box& region = kEverywhere, double margin = 0);

  // visit(s, t) for every two triangles whose boxes overlap, once, in either order; not for pairs
  // without a number up to `limit`, which visits may lower.
  template <class Visit>
  void for_each_pair(const std::uint32_t& limit, const Visit& visit) const {
    const std::size_t top = levels_.size() - 1;
    pairs_within(top, 0, levels_[top].size(), limit, visit);
  }

  // A stretch of a line: place + d · direction, where d is from `first` to `last`.
  struct Stretch {
    Point place, inverse;  // the latter of the direction's coordinates
    double first = -kEndless, last = kEndless;

    Stretch(const Point& from, const Point& direction, double the_first = -kEndless,
            double the_last = kEndless)
        : place(from),
          inverse{inverse_of(direction.x), inverse_of(direction.y), inverse_of(direction.z)},
          first(the_first),
          last(the_last) {}
    // Tells whether it comes closer to the box than `margin` along each axis, by the stretches that
    // lie between the box' sides.
    bool meets(const Box& box, double margin) const {
      double in = first, out = last;
      for (int axis = 0; axis < 3; ++axis) {
        const double low = (box.min[axis] - margin - place[axis]) * inverse[axis],
                     high = (box.max[axis] + margin - place[axis]) * inverse[axis];
        in = std::max(in, std::min(low, high));
        out = std::min(out, std::max(low, high));
      }
      return in <= out;
    }

   private:
    static double inverse_of(double x) { return x == 0 ? 1e300 : 1 / x; }  // 0 · ∞ is no number
  };
  // visit(t) for every triangle whose box the stretch comes closer to than `margin` along each
  // axis. Visits may shorten it.
  template <class Visit>
  void for_each_along(const Stretch& stretch, double margin, const Visit& visit) const {
    const std::size_t top = levels_.size() - 1;
    along(top, 0, levels_[top].size(), stretch, margin, visit);
  }

 private:
  static constexpr std::size_t kFanOut = 4;
  struct Node {
    Box box;
    std::uint32_t triangle = 0;  // the smallest below
  };
  void sort_along_curve(const std::vector<Node>& nodes);
  void build_levels();

  // Among the nodes begin … end - 1 of a level.
  template <class Visit>
  void pairs_within(std::size_t level, std::size_t begin, std::size_t end,
                    const std::uint32_t& limit, const Visit& visit) const {
    for (std::size_t i = begin; i < end; ++i) {
      if (level > 0) pairs_within(level - 1, kFanOut * i, end_of_children(level, i), limit, visit);
      for (std::size_t j = i + 1; j < end; ++j) pairs_of(level, i, j, limit, visit);
    }
  }

  template <class Visit>
  void pairs_of(std::size_t level, std::size_t i, std::size_t j, const std::uint32_t& limit,
                const Visit& visit) const {
    const Node &a = levels_[level][i], &b = levels_[level][j];
    if (!a.box.overlaps(b.box) || std::min(a.triangle, b.triangle) > limit) return;
    if (level == 0) return visit(a.triangle, b.triangle);
    const std::size_t end_a = end_of_children(level, i), end_b = end_of_children(level, j);
    for (std::size_t k = kFanOut * i; k < end_a; ++k) {
      if (!levels_[level - 1][k].box.overlaps(b.box)) continue;
      for (std::size_t l = kFanOut * j; l < end_b; ++l) pairs_of(level - 1, k, l, limit, visit);
    }
  }

  template <class Visit>
  void along(std::size_t level, std::size_t begin, std::size_t end, const Stretch& stretch,
             double margin, const Visit& visit) const {
    for (std::size_t i = begin; i < end; ++i) {
      const Node& node = levels_[level][i];
      if (!stretch.meets(node.box, margin)) continue;
      if (level == 0)
        visit(node.triangle);
      else
        along(level - 1, kFanOut * i, end_of_children(level, i), stretch, margin, visit);
    }
  }

  std::size_t end_of_children(std::size_t level, std::size_t i) const {
    return std::min(kFanOut * (i + 1), levels_[level - 1].size());
  }

  std::vector<std::vector<Node>> levels_;
};

}  // namespace locvol
