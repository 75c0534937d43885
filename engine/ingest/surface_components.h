// Puts the connected components of a surface together from those of its pieces, and finds what they
// enclose.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "engine/ingest/part_joiner.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"

namespace locvol {

// A component, or the part of it in one cell. Volume and orientation are relative to one of its
// triangles.
struct SurfaceComponent {
  // The component's highest vertex (in z, then x, then y).
  Point top{0, 0, -std::numeric_limits<double>::infinity()};
  CompensatedSum six_volume;    // six times the volume, positive if it faces outward
  double six_volume_error = 0;  // a bound
  std::uint64_t num_triangles = 0;
  std::uint64_t num_turned = 0;  // of these, those against its orientation

  bool has_certain_volume() const { return std::abs(six_volume.value()) > six_volume_error; }
  double volume() const { return six_volume.value() / 6; }
  void add(const SurfaceComponent& other, bool is_turned);
};

// Is p higher than q?
inline bool is_above(const Point& p, const Point& q) { return p.z != q.z ? p.z > q.z : p < q; }

using JoinedComponents = JoinedParts<SurfaceComponent>;
using ComponentJoiner = PartJoiner<SurfaceComponent>;

// Element i: do an odd number of the other components lie around component i, so that it bounds a
// cavity? Triangles are given one by one. Decided exactly.
// Memory: 48 bytes a component. Time: a logarithm for each triangle, and as much as triangles lie
// above tops.
class Nesting {
 public:
  explicit Nesting(std::span<const SurfaceComponent> components);
  void add(const Triangle& triangle);
  std::vector<bool> take_cavities();

 private:
  struct Query {
    Point point;
    std::uint32_t component = 0;
    bool is_odd = false;
  };
  void build(std::size_t begin, std::size_t end, int axis);
  void visit(std::size_t begin, std::size_t end, int axis, const Triangle& triangle,
             const Box& box);

  std::vector<Query> queries_;  // a k-d tree: the middle one divides the others
};

}  // namespace locvol
