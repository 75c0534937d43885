// Where a surface turns sharply from triangle to triangle.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "octree/geometry.h"

namespace locvol {

// A triangle's normal, as its corners turn, of length 1; and whether it is a needle, whose height
// is below 1e-5 of its longest edge: rounded coordinates say nothing of its normal.
struct TriangleDirection {
  Point normal;
  bool is_needle = false;
  std::uint32_t longest_edge = 0;  // half-edge of the triangle, 0 to 2
};
TriangleDirection direction_of(const Triangle& triangle);

// A needle has the normal of the triangle across its longest edge.
struct Needle {
  std::uint64_t id = 0, across = 0;  // triangles
  Point normal;            // of the one across, as the needle's corners turn; of a needle its own
  bool is_turned = false;  // the two turn against each other along the edge
  bool is_next_to_needle = false;
};

// What is known of a surface's sharp edges when it has been checked.
struct SharpEdges {
  static constexpr std::size_t kMaxNeedles = 200'000;

  // Edges whose triangles turn by more than the angle, or of which one is a needle.
  std::uint64_t num_edges = 0;
  // Vertices with triangles that turn against each other by more than the angle: among them the
  // tips of cones.
  std::uint64_t num_pointed = 0;
  std::uint64_t num_needles = 0;
  std::vector<Needle> needles;  // none if there are more than kMaxNeedles

  void add(const SharpEdges& others);
};

// Tells by how much normals turn, of an angle in degrees; at 0, no edge is sharp.
class SharpAngle {
 public:
  // `first_over_hole`: from this id on, triangles close holes, and their edges are not sharp.
  explicit SharpAngle(double degrees, std::uint64_t first_over_hole = kNoHoles);
  static constexpr std::uint64_t kNoHoles = std::numeric_limits<std::uint64_t>::max();
  bool is_given() const { return is_given_; }
  bool is_over_hole(const Triangle& triangle) const { return triangle.id >= first_over_hole_; }
  // Does the surface turn by more between two triangles with these normals?
  bool is_exceeded(const Triangle& one, const Point& normal, const Triangle& other,
                   const Point& other_normal, bool is_turned) const {
    return !is_over_hole(one) && !is_over_hole(other) &&
           is_exceeded(normal, other_normal, is_turned);
  }
  // `is_turned`: along their edge, the triangles' corners run the same way.
  bool is_exceeded(const Point& normal, const Point& other, bool is_turned) const {
    const double cosine = dot(normal, other);
    return is_exceeded(is_turned ? -cosine : cosine);
  }
  bool is_exceeded(double cosine) const { return is_given_ && cosine < least_cosine_; }

 private:
  bool is_given_;
  double least_cosine_;
  std::uint64_t first_over_hole_;
};

// Do the triangles on the two sides of an edge run along it the same way?
inline bool is_turned_across(std::span<const TriangleCorners> triangles, std::uint32_t g,
                             std::uint32_t h) {
  return origin(triangles, g) == origin(triangles, h);
}

// Those of the edges and vertices that are judged here. `soup`: of the triangles, of which some are
// turned against others that they hang together with. `is_ours`: the edge; `is_owned`: the vertex
SharpEdges sharp_edges_of(std::span<const Triangle> triangles, const TriangleSoup& soup,
                          const Mates& mates, const std::vector<bool>& is_turned,
                          const SharpAngle& angle,
                          const std::function<bool(std::uint32_t half_edge)>& is_ours,
                          const std::vector<std::uint8_t>& is_owned);

// The normals of all needles, from needle to needle until one has a neighbor that is none. Where
// needles lie across from each other, they keep their own.
// Threads: many.
class NeedleNormals {
 public:
  explicit NeedleNormals(std::vector<Needle> needles);
  Point normal_of(const Triangle& triangle) const;

 private:
  std::vector<Needle> needles_;  // in order of id, with the normals that they get
};

}  // namespace locvol
