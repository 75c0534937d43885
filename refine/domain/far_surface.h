// FarSurface: how far the surface is from a place that is far from it, by points that stand for it:
// the fewer, the farther they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/leaf_surface.h"
#include "octree/morton_key.h"
#include "refine/domain/box_tree.h"

namespace locvol {

// A point that stands for the surface in a node of the octree.
struct FarPoint {
  MortonKey node;
  std::uint64_t place =
      0;  // in its box, in steps of 2^-16 of the side: x, y, z from the lowest bit
  friend bool operator==(const FarPoint&, const FarPoint&) = default;
};

// What is enough for places in a box.
class FarPoints {
 public:
  // The distance of p from the surface, or `bound` if no point is closer.
  double distance(const Point& p, double bound) const;
  std::size_t size() const { return points_.size(); }

 private:
  friend class FarSurface;
  struct Sample {
    Point position;
    double side = 0;  // of its node
  };
  struct Group {  // of neighbors
    std::size_t first = 0, end = 0;
  };
  void finish();

  std::vector<Sample> points_;
  std::vector<Group> groups_;
  BoxTree tree_;  // of the groups
};

// Each leaf that the surface passes through is cut into 16 x 16 x 16 nodes; of each that the
// surface passes through, and of each node above, the point that is closest to its center stands
// for it. Where the surface is smooth, the nearest of them is too far by up to s² / (4 d), for
// nodes of side s and a distance d: half of it is taken off.
//
// What stands for the surface in a node depends on nothing but the surface there: so points of
// several processes, each of its own leaves, put together are those of one.
//
// Memory: 16 bytes a point. Threads: const functions are safe from many.
class FarSurface {
 public:
  explicit FarSurface(const Frame& frame) : frame_(frame) {}

  // `surface`: that meets the leaf's box.
  void add(MortonKey leaf, const LeafSurface& surface);
  void finish();  // once all leaves are there
  // What another process has to know of a part of the surface, as far as it is enough for places in
  // these boxes. It gets the points by add_told(). REQUIRES: finish() was called
  std::vector<FarPoint> seen_from(std::span<const Box> places) const;
  void add_told(std::span<const FarPoint> points);

  // REQUIRES: finish() was called
  FarPoints around(const Box& places) const;
  std::size_t bytes() const { return points_.capacity() * sizeof(FarPoint); }

 private:
  // Calls visit(point, is_enough) for nodes from the root down, but not below those that are
  // enough.
  template <class Visit>
  void descend(std::span<const Box> places, const Visit& visit) const;
  void put_in_order();

  Frame frame_;
  std::vector<FarPoint> points_;  // a node before what lies in it
};

}  // namespace locvol
