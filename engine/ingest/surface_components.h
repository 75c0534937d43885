// Puts the connected components of a surface together from those of its pieces, and finds what they
// enclose.
#pragma once

#include <cmath>
#include <compare>
#include <cstdint>
#include <limits>
#include <span>
#include <unordered_map>
#include <vector>

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

// A triangle that also lies beyond the cells that have come.
struct OpenTriangle {
  std::uint64_t id = 0;
  std::uint32_t component = 0;  // its place among these
  bool is_turned = false;       // against the component's orientation
  friend auto operator<=>(const OpenTriangle&, const OpenTriangle&) = default;
};

struct JoinedComponents {
  std::vector<SurfaceComponent> components;
  std::vector<OpenTriangle> open;  // in order of id
};

// Cells come in Morton order; a triangle that meets several cells is in a part of each, and so
// joins those parts. Memory: 8 bytes a part, and about 50 for each triangle of which a cell has
// come and another has not: those across a section of the model.
class ComponentJoiner {
 public:
  // Numbers the parts that other cells may have parts of.
  std::uint32_t add_part(const SurfaceComponent& part);
  // A part that no other cell has part of.
  void add_whole(const SurfaceComponent& component) { components_.push_back(component); }
  // The triangle is in the part, `is_turned` against its orientation. `is_last`: no later cell has
  // it. Returns false if the orientations of its parts contradict each other.
  bool join(std::uint64_t triangle, std::uint32_t part, bool is_turned, bool is_last);
  JoinedComponents take();

 private:
  struct Place {
    std::uint32_t part = 0;
    bool is_turned = false;
  };
  Place root_of(std::uint32_t part);

  std::vector<SurfaceComponent> components_, parts_;
  std::vector<Place> parents_;  // union-find, with the orientation relative to the parent's
  std::unordered_map<std::uint64_t, Place> open_;
};

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
