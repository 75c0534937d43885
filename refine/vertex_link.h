// The link of a vertex in the mesh's boundary: the edges opposite it in its boundary facets.
// Internal to refine/.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "octree/body_id.h"
#include "octree/sort_and_unite.h"
#include "refine/delaunay.h"

namespace locvol {

struct LinkEdge {
  Delaunay::Vertex a = Delaunay::kInfinite, b = Delaunay::kInfinite;
};

// Of a facet between two bodies, the larger first; or of the boundary.
struct BodyLinkEdge {
  LinkEdge edge;
  std::array<BodyId, 2> bodies = {kOnlyBody, kNoBody};
};

// Of a facet of v.
inline LinkEdge link_edge(const std::array<Delaunay::Vertex, 3>& facet, Delaunay::Vertex v) {
  const auto& [a, b, c] = facet;
  return a == v ? LinkEdge{b, c} : b == v ? LinkEdge{a, c} : LinkEdge{a, b};
}

// The same of the facet of a cell that its vertex `off` is opposite.
inline LinkEdge link_edge(const std::array<Delaunay::Vertex, 4>& cell, int off,
                          Delaunay::Vertex v) {
  return link_edge(facet_of(cell, off), v);
}

// Tells whether the edges make one cycle, so that the facets are a disk: from edge to edge, each
// has one that goes on. They change places.
inline bool is_cycle(std::span<LinkEdge> link) {
  if (link.empty()) return false;
  Delaunay::Vertex here = link[0].b;
  for (std::size_t n = 1; n < link.size(); ++n) {
    std::size_t num_next = 0;
    for (std::size_t k = n; k < link.size(); ++k)
      if (link[k].a == here || link[k].b == here) {
        ++num_next;
        std::swap(link[n], link[k]);
      }
    if (num_next != 1) return false;
    here = link[n].a == here ? link[n].b : link[n].a;
  }
  return here == link[0].a;
}

// Do the edges of each body make one cycle, whatever lies outside of all?
inline bool has_cycle_of_each_body(std::span<const BodyLinkEdge> link) {
  std::vector<BodyId> bodies;
  for (const BodyLinkEdge& e : link)
    for (const BodyId body : e.bodies)
      if (body != kNoBody) bodies.push_back(body);
  sort_and_unite(bodies);
  std::vector<LinkEdge> of_body;
  return std::ranges::all_of(bodies, [&](BodyId body) {
    of_body.clear();
    for (const BodyLinkEdge& e : link)
      if (e.bodies[0] == body || e.bodies[1] == body) of_body.push_back(e.edge);
    return is_cycle(of_body);
  });
}

struct LinkPath {
  std::vector<Delaunay::Vertex> ends, between;  // ascending; two ends
};

// That edges make, if they make one: then one more makes a cycle of it.
inline std::optional<LinkPath> path_of(std::vector<LinkEdge> edges) {
  std::map<Delaunay::Vertex, int> degrees;
  for (const auto& [a, b] : edges) ++degrees[a], ++degrees[b];
  LinkPath path;
  for (const auto& [v, degree] : degrees) (degree == 1 ? path.ends : path.between).push_back(v);
  if (path.ends.size() != 2) return std::nullopt;
  edges.push_back({path.ends[0], path.ends[1]});
  return is_cycle(edges) ? std::optional(path) : std::nullopt;
}

}  // namespace locvol
