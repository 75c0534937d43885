// The link of a vertex in the mesh's boundary: the edges opposite it in its boundary facets.
// Internal to refine/.
#pragma once

#include <cstddef>
#include <span>
#include <utility>

#include "refine/delaunay.h"

namespace locvol {

struct LinkEdge {
  Delaunay::Vertex a = Delaunay::kInfinite, b = Delaunay::kInfinite;
};

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

}  // namespace locvol
