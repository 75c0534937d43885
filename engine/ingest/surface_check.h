// Judges a surface cell by cell.
//
// Everything is judged once, where all that matters is at hand: an edge in the cell that owns its
// smaller vertex (in lexicographic order), a vertex in the cell that owns it, two triangles in
// every cell that both meet. Triangles with the same vertices count once, unless said otherwise.
//
// Several bodies may touch in triangles, edges and vertices that they have in common: then each is
// judged by itself, as if the others were not there, and two triangles of one place are no copies
// if they are of two bodies.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/sharp_edges.h"
#include "engine/ingest/surface_components.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/ingest/wall_probes.h"
#include "engine/shared/compensated_sum.h"
#include "engine/shared/workers.h"

namespace locvol {

struct EdgeFlaws {
  std::uint64_t count = 0;
  // The first in the file: corner `half_edge % 3` of triangle `half_edge / 3`.
  std::uint64_t half_edge = ~std::uint64_t{0};
  Point from, to;

  void add(std::uint64_t number, const Point& origin, const Point& target);
  void add(const EdgeFlaws& others);
};

struct EdgeCounts {
  EdgeFlaws border;    // in one triangle
  EdgeFlaws overused;  // in three or more

  void add(const EdgeCounts& others);
};

// By group (Triangle::sheet), which of several bodies that are given its triangles are of, from 0
// on; empty: all are of one.
using GivenBodies = std::vector<std::uint32_t>;
inline std::uint32_t given_body(std::span<const std::uint32_t> given, const Triangle& triangle) {
  return given.empty() ? 0 : given[triangle.sheet - 1];
}

using TrianglePair = std::pair<Triangle, Triangle>;  // the first has the smaller id

struct SurfaceFindings {
  EdgeCounts edges;                 // with all copies of triangles
  EdgeCounts edges_without_copies;  // with one of each
  std::uint64_t num_copies = 0;     // triangles beyond the first with the same vertices
  std::optional<TrianglePair> first_copy;
  bool is_copy_needed = false;  // a triangle with copies has an edge that is not in two triangles

  EdgeFlaws conflicts;            // edges that no orientation can serve; some, if there are any
  std::uint64_t num_pinched = 0;  // vertices whose triangles form more than one fan
  Point first_pinched;            // the smallest
  std::optional<TrianglePair> intersection;  // the smallest pair, by first and second id
  bool has_contacts = false;  // bodies have a triangle, an edge or a vertex in common

  std::uint64_t num_vertices = 0, num_triangles = 0;
  CompensatedSum area;
  JoinedComponents joined;  // none that is complete, where edges are in one triangle
  SharpEdges sharp;         // in CheckScope::kAll
  LineSights sights;        // of the lines of all probes, in CheckScope::kAll

  void add(const SurfaceFindings& others);  // but for their components

  // Where triangles lie on others, copies are dropped if that leaves their edges in two triangles
  // each; elsewhere they stay, for they are part of what is wrong.
  bool drops_copies() const {
    return num_copies > 0 && edges.overused.count > 0 && !is_copy_needed;
  }
  const EdgeCounts& edges_that_count() const {
    return drops_copies() ? edges_without_copies : edges;
  }
};

enum class CheckScope {
  kNeighbors,  // edges and orientation only: all that can be said while triangles have no area
  kAll,
  kBetweenBodies,  // all, but that a body may meet itself
  // All but that nothing meets anything else, of one that faces away from the only body: parts that
  // meet in an edge or a vertex are judged by what lies behind them.
  kFacingAway,
};

// Checks the cells of the buckets' range. `box` is around the surface. Each thread is at a cell of
// its own. Memory: see check_surface(). Throws as TriangleSpill, Stopped.
SurfaceFindings check_cells(const TriangleSpill& spill, const TriangleBuckets& buckets,
                            const Box& box, const WallProbes& probes, const SharpAngle& angle,
                            CheckScope scope, IngestWatch& watch, Workers& workers,
                            std::span<const std::uint32_t> given = {});

// Drops all but the first of triangles of a body with the same vertices. REQUIRES: they are in
// order of id
void drop_copies(std::vector<Triangle>& triangles, std::span<const std::uint32_t> given = {});

// Tells whether the triangle's smallest corner is one that the cell owns.
bool owns_triangle(const Box& cell, const Triangle& triangle);

}  // namespace locvol
