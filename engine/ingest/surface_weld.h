// Makes points of a surface one that are nearly so: writers that round the same vertex in several
// ways leave gaps along edges.
//
// Points hang together by steps shorter than a distance, and become the smallest of them, in
// lexicographic order. A group as wide as two distances (its box, from corner to corner) is no
// point that was written in several ways, but a row of points: it stays as it is. So no point moves
// farther than that, and points that are all nearer to each other than the distance become one.
//
// A cell of the surface's buckets decides for the points that it owns: with those around it within
// four distances it knows each of their groups as a whole, or that it is too wide. So the result is
// the same however the surface is cut.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/shared/workers.h"
#include "octree/geometry.h"

namespace locvol {

enum class WeldPoints {
  kOfOpenEdges,  // the ends of edges in one triangle only
  kAll,
  kBetweenBodies,  // of all, groups with points of two bodies
};

// Lengths of edges, of which only those matter that lie far from others.
class EdgeLengths {
 public:
  void add(double length);
  void add(const EdgeLengths& others);
  // The smallest distance above `above` and `least` that no edge is as long as, nor up to ten times
  // it; of distances between the same edges the largest. At most `most`. So an edge either goes, or
  // is ten times as long as what its ends may be joined with.
  std::optional<double> next_distance(double above, double least, double most) const;
  // Of the edges that are longer than `least`; infinite: there is none.
  double shortest_above(double least) const;

 private:
  // The shortest and the longest length in each quarter of an octave, by exponent and two bits.
  // There are a few thousand at most.
  std::map<std::uint64_t, std::pair<double, double>> ranges_;
};

// The functions below take a surface whose triangles are all in `spill`, and in `buckets`. Memory:
// as check_cells(), 24 MB while triangles are put in order, and 300 bytes for each of
// kMaxWeldTriangles for each thread where more triangles than a bucket has lie within 16 distances.
// They throw std::system_error, Stopped.

// The lengths of edges with an end among the points.
EdgeLengths edge_lengths(const TriangleSpill& spill, const TriangleBuckets& buckets,
                         WeldPoints points, IngestWatch& watch, Workers& workers);

inline constexpr std::size_t kMaxWeldTriangles = 200'000;
// The least width of a cell, in distances: in a narrower one there would be more of others than of
// its own.
inline constexpr double kLeastWeldCell = 16;

struct WeldedSurface {
  double distance = 0;
  bool is_crowded = false;          // more than kMaxWeldTriangles in such a cell: nothing is done
  std::uint64_t num_joined = 0;     // points that became another; 0: all else is empty
  double width = 0;                 // of the widest group that became one point
  std::optional<Point> too_wide;    // the smallest point of the groups that stay
  TriangleList triangles;           // in order of id, those that the surface had
  std::vector<Triangle> collinear;  // those without area; one more than kMaxCollinear: too many
  std::uint64_t num_collapsed = 0;  // left out, for two corners became one
  std::uint64_t num_copies = 0;     // of triangles, which there had been before
};

// `given`: see given_body(); asked for bodies.
WeldedSurface welded_surface(TriangleSpill& spill, const TriangleBuckets& buckets,
                             WeldPoints points, double distance, IngestWatch& watch,
                             Workers& workers, std::span<const std::uint32_t> given = {});

}  // namespace locvol
