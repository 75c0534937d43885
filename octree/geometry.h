// Points, boxes and triangles: the plain values that every layer passes on.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>

#include "octree/domain_state.h"
#include "octree/mesh_facet.h"

namespace locvol {

struct Point {
  double x = 0, y = 0, z = 0;
  double operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
  double& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  friend auto operator<=>(const Point&, const Point&) = default;  // lexicographic
  friend bool operator==(const Point&, const Point&) = default;
};

// What follows is small and in every loop: GCC would leave some of it out of line in large units.
[[gnu::always_inline]] inline Point operator+(const Point& a, const Point& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
[[gnu::always_inline]] inline Point operator-(const Point& a, const Point& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
[[gnu::always_inline]] inline Point operator*(double s, const Point& a) {
  return {s * a.x, s * a.y, s * a.z};
}
[[gnu::always_inline]] inline double dot(const Point& a, const Point& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
[[gnu::always_inline]] inline Point cross(const Point& a, const Point& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
[[gnu::always_inline]] inline double norm(const Point& a) { return std::sqrt(dot(a, a)); }
// The largest coordinate, in absolute value. (Of a list, std::max takes branches.)
[[gnu::always_inline]] inline double max_norm(const Point& a) {
  return std::max(std::max(std::abs(a.x), std::abs(a.y)), std::abs(a.z));
}
[[gnu::always_inline]] inline double squared_distance(const Point& a, const Point& b) {
  return dot(a - b, a - b);
}

// A closed axis-parallel box. Distances are Euclidean, 0 where the two meet. Without branches,
// which nobody could foretell: whole loops ask little else.
struct Box {
  Point min, max;

  static Box around(const Point& p) { return {p, p}; }
  Box joined(const Point& p) const {
    return {{std::min(min.x, p.x), std::min(min.y, p.y), std::min(min.z, p.z)},
            {std::max(max.x, p.x), std::max(max.y, p.y), std::max(max.z, p.z)}};
  }
  Box joined(const Box& b) const { return joined(b.min).joined(b.max); }
  Box common(const Box& b) const {  // turned inside out if they do not overlap
    return {{std::max(min.x, b.min.x), std::max(min.y, b.min.y), std::max(min.z, b.min.z)},
            {std::min(max.x, b.max.x), std::min(max.y, b.max.y), std::min(max.z, b.max.z)}};
  }
  Box expanded(double d) const {
    return {{min.x - d, min.y - d, min.z - d}, {max.x + d, max.y + d, max.z + d}};
  }
  Point center() const {
    return {0.5 * (min.x + max.x), 0.5 * (min.y + max.y), 0.5 * (min.z + max.z)};
  }
  [[gnu::always_inline]] bool contains(const Point& p) const {
    return (min.x <= p.x) & (p.x <= max.x) & (min.y <= p.y) & (p.y <= max.y) & (min.z <= p.z) &
           (p.z <= max.z);
  }
  [[gnu::always_inline]] bool overlaps(const Box& b) const {
    return (min.x <= b.max.x) & (b.min.x <= max.x) & (min.y <= b.max.y) & (b.min.y <= max.y) &
           (min.z <= b.max.z) & (b.min.z <= max.z);
  }
  [[gnu::always_inline]] double squared_distance(const Point& p) const {
    const double dx = gap(min.x - p.x, p.x - max.x), dy = gap(min.y - p.y, p.y - max.y),
                 dz = gap(min.z - p.z, p.z - max.z);
    return dx * dx + dy * dy + dz * dz;
  }
  [[gnu::always_inline]] double squared_distance(const Box& b) const {
    const double dx = gap(min.x - b.max.x, b.min.x - max.x),
                 dy = gap(min.y - b.max.y, b.min.y - max.y),
                 dz = gap(min.z - b.max.z, b.min.z - max.z);
    return dx * dx + dy * dy + dz * dz;
  }
  // No point of b is farther.
  double most_distance(const Box& b) const {
    const auto most = [](double below, double above) { return std::max({0.0, below, above}); };
    return norm({most(min.x - b.min.x, b.max.x - max.x), most(min.y - b.min.y, b.max.y - max.y),
                 most(min.z - b.min.z, b.max.z - max.z)});
  }
  double volume() const {  // 0 of an empty one
    const Point sides = max - min;
    return std::max(sides.x, 0.0) * std::max(sides.y, 0.0) * std::max(sides.z, 0.0);
  }
  friend bool operator==(const Box&, const Box&) = default;

 private:
  // How far something lies beyond the box on one axis: below it, or above it. max(.., 0) takes a
  // branch.
  [[gnu::always_inline]] static double gap(double below, double above) {
    const double larger = std::max(below, above);
    return 0.5 * (larger + std::abs(larger));
  }
};

// Tells whether p is in a leaf's half-open box.
[[gnu::always_inline]] inline bool is_in_leaf(const Box& box, const Point& p) {
  return (box.min.x <= p.x) & (p.x < box.max.x) & (box.min.y <= p.y) & (p.y < box.max.y) &
         (box.min.z <= p.z) & (p.z < box.max.z);
}

// A triangle of the input surface; ids are different and in the order of the file.
struct Triangle {
  std::uint64_t id = 0;
  std::array<Point, 3> corners;
  SheetId sheet = 1;  // while a surface is taken in, and sheets are not known: its named group
  // Of the state, across it: the bodies on its two sides, whichever way it faces.
  DomainState change = DomainState::in(kOnlyBody);

  Box box() const { return Box::around(corners[0]).joined(corners[1]).joined(corners[2]); }
  friend bool operator==(const Triangle&, const Triangle&) = default;
};

// Where a mesh point comes from decides what may happen to it.
enum class PointKind : std::uint8_t {
  kSurface = 0,   // on the input surface
  kVolume = 1,    // inside, there from the start, or where C7 wants it: others know what it changes
  kLattice = 2,   // of the BCC lattice, at least 0.5 λ below the surface; never deleted
  kInserted = 3,  // inside, for C2 to C6: leaves around have to look at what it changes
  kCrease = 4,    // on a crease of the surface, or a corner
};

inline constexpr std::size_t kNumPointKinds = 5;

inline bool is_on_surface(PointKind kind) {
  return kind == PointKind::kSurface || kind == PointKind::kCrease;
}

// Tells whether a surface point closer than λ may have the point deleted.
inline bool is_deletable(PointKind kind) {
  return kind == PointKind::kVolume || kind == PointKind::kInserted;
}

// A point of P. `id` is mesh-wide, given at the commit that creates the point, in a fixed order.
struct MeshPoint {
  std::uint64_t id = 0;
  Point position;
  PointKind kind = PointKind::kSurface;
  friend bool operator==(const MeshPoint&, const MeshPoint&) = default;
};

}  // namespace locvol
