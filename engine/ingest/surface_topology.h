// Which triangles are neighbors: the combinatorial side of a triangle surface, or of a piece of it.
//
// Half-edge 3 t + k runs from corner k of triangle t to the next one.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/ingest/triangle_soup.h"

namespace locvol {

inline constexpr std::uint32_t kNoHalfEdge = 0xffffffff;

inline std::uint32_t next_half_edge(std::uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
inline std::uint32_t previous_half_edge(std::uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }
inline std::uint32_t origin(std::span<const TriangleCorners> triangles, std::uint32_t h) {
  return triangles[h / 3][h % 3];
}
inline std::uint32_t target(std::span<const TriangleCorners> triangles, std::uint32_t h) {
  return origin(triangles, next_half_edge(h));
}
// The corner beyond the half-edge's edge.
inline std::uint32_t apex(std::span<const TriangleCorners> triangles, std::uint32_t h) {
  return origin(triangles, previous_half_edge(h));
}

// For each half-edge, that of the triangle beyond its edge; kNoHalfEdge unless there is exactly
// one.
using Mates = std::vector<std::uint32_t>;

// The half-edges of each edge. Memory: 24 bytes a triangle.
class EdgeTable {
 public:
  EdgeTable(std::size_t num_vertices, std::span<const TriangleCorners> triangles);

  // visit(half_edges): ascending, one call for each edge.
  template <class Visit>
  void for_each_edge(const Visit& visit);

 private:
  // One half-edge, as its edge's smaller vertex lists it.
  struct Use {
    std::uint32_t larger_vertex = 0, half_edge = 0;
    friend auto operator<=>(const Use&, const Use&) = default;
  };

  std::vector<std::uint32_t> begin_;  // of each vertex's uses
  std::vector<Use> uses_;
};

template <class Visit>
void EdgeTable::for_each_edge(const Visit& visit) {
  std::vector<std::uint32_t> half_edges;
  for (std::size_t v = 0; v + 1 < begin_.size(); ++v) {
    const std::span uses(uses_.data() + begin_[v], begin_[v + 1] - begin_[v]);
    std::ranges::sort(uses);
    for (std::size_t i = 0; i < uses.size();) {
      half_edges.clear();
      const std::uint32_t larger = uses[i].larger_vertex;
      for (; i < uses.size() && uses[i].larger_vertex == larger; ++i)
        half_edges.push_back(uses[i].half_edge);
      visit(std::span<const std::uint32_t>(half_edges));
    }
  }
}

// Edges of any number of triangles but two pair none.
Mates paired_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles);
// The same of each body by itself (for_each_body_at). `body_of`: by triangle
Mates paired_edges(std::size_t num_vertices, std::span<const TriangleCorners> triangles,
                   std::span<const std::uint32_t> body_of);

// Leaves only those mates whose edges are whole, for which is_whole(half_edge) is asked.
template <class IsWhole>
void unpair_others(Mates& mates, const IsWhole& is_whole) {
  for (std::uint32_t h = 0; h < mates.size(); ++h)
    if (const std::uint32_t g = mates[h]; g != kNoHalfEdge && h < g && !is_whole(h))
      mates[h] = mates[g] = kNoHalfEdge;
}

// Of an edge where several bodies meet: visit(half_edges) for each that has more than one of them,
// and then for all the others, if there are any: where a body has two, they go together, and where
// two have one each, these do. `of_body`: scratch
template <class BodyOf, class Visit>
void for_each_body_at(std::span<const std::uint32_t> half_edges, const BodyOf& body_of,
                      std::vector<std::uint32_t>& of_body, const Visit& visit);

template <class BodyOf, class Visit>
void for_each_body_at(std::span<const std::uint32_t> half_edges, const BodyOf& body_of,
                      std::vector<std::uint32_t>& of_body, const Visit& visit) {
  of_body.assign(half_edges.begin(), half_edges.end());
  std::ranges::stable_sort(of_body, {}, body_of);
  std::vector<std::uint32_t> alone;
  for (auto first = of_body.begin(); first != of_body.end();) {
    const auto end =
        std::find_if(first, of_body.end(), [&](auto h) { return body_of(h) != body_of(*first); });
    if (end - first == 1)
      alone.push_back(*first);
    else
      visit(std::span<const std::uint32_t>(first, end));
    first = end;
  }
  if (!alone.empty()) visit(std::span<const std::uint32_t>(alone));
}

// Parts of a surface whose triangles hang together by their edges.
struct Components {
  std::vector<std::uint32_t> of_triangle;  // numbered by their first triangles
  std::uint32_t count = 0;
  std::vector<bool> is_turned;  // by triangle: its orientation differs from its component's first
  std::uint32_t conflict = kNoHalfEdge;  // where no orientation is consistent, if anywhere
};
Components find_components(std::span<const TriangleCorners> triangles,
                           std::span<const std::uint32_t> mates);

// Reverses the orientation of the marked triangles and keeps their mates in step.
void turn_triangles(const std::vector<bool>& is_turned, std::span<TriangleCorners> triangles,
                    std::span<std::uint32_t> mates);

// visit(triangle) for each of the fan around the origin of half-edge h, whatever their orientation.
// False if it does not close: then not all have been.
template <class Visit>
bool for_each_in_fan(std::span<const TriangleCorners> triangles,
                     std::span<const std::uint32_t> mates, std::uint32_t h, const Visit& visit) {
  const std::uint32_t v = origin(triangles, h);
  std::uint32_t leaving = previous_half_edge(h);  // each triangle is left by its other edge at v
  do {
    visit(leaving / 3);
    const std::uint32_t mate = mates[leaving];
    if (mate == kNoHalfEdge) return false;
    leaving = origin(triangles, mate) == v ? previous_half_edge(mate) : next_half_edge(mate);
  } while (leaving / 3 != h / 3);
  return true;
}

// Counts the triangles of that fan; 0 if it does not close.
std::uint32_t fan_around(std::span<const TriangleCorners> triangles,
                         std::span<const std::uint32_t> mates, std::uint32_t h);

}  // namespace locvol
