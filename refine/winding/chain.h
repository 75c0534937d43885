// Chain: oriented triangles, each so many times: what winding numbers are of. Internal to
// refine/winding.
#pragma once

#include <array>
#include <cstdint>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "octree/geometry.h"
#include "octree/mesh_facet.h"
#include "octree/stop.h"

namespace locvol {

struct ChainTriangle {
  std::array<std::uint32_t, 3> corners;  // different points; seen from the front they turn left
  std::int32_t times = 1;                // not 0
  SheetId group = 0;
};

// An edge of a triangle.
struct ChainEdge {
  std::uint32_t low = 0, high = 0, triangle = 0;
  bool is_upward = false;  // the triangle has it from low to high
  friend auto operator<=>(const ChainEdge&, const ChainEdge&) = default;
};

// An edge that the triangles leave open, on the way that it has in a triangle.
struct OpenEdge {
  std::uint32_t from = 0, to = 0;
  std::int32_t times = 1;  // above 0
  SheetId group = 0;       // of one of its triangles
  std::uint32_t apex = 0;  // the corner beyond it in that
};

struct Chain {
  std::vector<Point> vertices;  // all different
  std::vector<ChainTriangle> triangles;

  std::array<Point, 3> points_of(const ChainTriangle& t) const {
    return {vertices[t.corners[0]], vertices[t.corners[1]], vertices[t.corners[2]]};
  }
  Point normal_of(const ChainTriangle& t) const;  // of any length
  double area() const;
  // As who finds pairs of them asks.
  std::vector<std::array<std::uint32_t, 3>> corners() const;
};

std::vector<ChainEdge> edges_of(const Chain& chain);  // in order
// visit(edges) for those of each two vertices.
template <class Visit>
void for_each_edge(std::span<const ChainEdge> edges, const Visit& visit) {
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    while (end < edges.size() && edges[end].low == edges[begin].low &&
           edges[end].high == edges[begin].high)
      ++end;
    visit(edges.subspan(begin, end - begin));
  }
}

// Triangles of one place become one, turned as the first is, and those that cancel each other go.
// Order is that of the first of each.
void unite_equal(Chain& chain);
// Chains are added up; equal points become one vertex.
void append(const Chain& other, Chain& chain);
// In order of their ends. None: the chain is closed.
std::vector<OpenEdge> open_edges(const Chain& chain);
// Of the triangles, those whose two vertices are marked; the smaller vertex first.
std::set<std::pair<std::uint32_t, std::uint32_t>> edges_between(const Chain& chain,
                                                                const std::vector<bool>& is_marked);
// Each loop as places in `edges`, without a vertex twice; an edge is in as many as it is there.
// In an order that the edges decide.
std::vector<std::vector<std::uint32_t>> loops_of(std::span<const OpenEdge> edges,
                                                 std::size_t num_vertices);

// Makes one what is nearer than the distance: vertices, and a vertex and an edge of one triangle,
// which then goes through that vertex in all its triangles. What was closed is so afterwards, for
// edges are moved as wholes. Else what rounding parts is cut into dust.
void snap(Chain& chain, double distance);

// Cuts triangles that meet along each other, so that they have vertices, edges and triangles in
// common; those without area go, for the cuts give their corners to what they lie on. Returns how
// many have changed. Throws Stopped.
std::size_t cut_along_each_other(Chain& chain, const StopToken* stop);

}  // namespace locvol
