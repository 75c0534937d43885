// FarSurface: how far the surface is from a place that is far from it, in memory that does not grow
// with its triangles: of each leaf, some hundreds of points of the surface.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "octree/geometry.h"
#include "refine/box_tree.h"

namespace locvol {

// Points of the surface stand for it: one in each of a leaf's 16 x 16 x 16 parts that it passes
// through, the one closest to the part's center. Where the surface is smooth, the nearest of them
// is too far by up to s² / (4 d), for parts of side s and a distance d: half of it is taken off.
//
// Memory: 24 bytes a point. Threads: const functions are safe from many.
class FarSurface {
 public:
  // `triangles`: that meet the leaf's box. Leaves come in one order: the distances do not depend on
  // it, and look-ups are fast if leaves that come after one another are near each other.
  void add(const Box& leaf, std::span<const Triangle> triangles);
  void finish();  // once all leaves are there

  // From p to the surface, or `bound` if no point is closer. REQUIRES: finish() was called
  double distance(const Point& p, double bound) const;
  std::size_t bytes() const {
    return points_.capacity() * sizeof(Point) + groups_.capacity() * sizeof(Group) + tree_.bytes();
  }

 private:
  struct Group {  // the points of a leaf
    Box box;
    std::size_t first = 0, end = 0;
  };

  double part_ = 0;  // the largest side of a part
  std::vector<Point> points_;
  std::vector<Group> groups_;
  BoxTree tree_;  // of the groups
};

}  // namespace locvol
