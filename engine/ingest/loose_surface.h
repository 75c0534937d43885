// All triangles of a surface that was read, in memory: for what cures them.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "engine/ingest/triangle_soup.h"
#include "engine/ingest/triangle_spill.h"
#include "refine/cure/cure_surface.h"

namespace locvol {

// With their groups.
inline LooseSurface loose_surface(std::span<const Triangle> triangles) {
  TriangleSoup soup = soup_of(triangles);
  LooseSurface surface{std::move(soup.vertices), std::move(soup.triangles), {}};
  surface.groups.reserve(triangles.size());
  for (const Triangle& t : triangles) surface.groups.push_back(t.sheet);
  return surface;
}
// Throws as TriangleSpill.
inline LooseSurface loose_surface(const TriangleSpill& spill, std::span<const TriangleList> lists) {
  std::vector<Triangle> triangles;
  for (const TriangleList& list : lists) {
    triangles.reserve(triangles.size() + list.count);
    spill.for_each(list, [&](const Triangle& t) { triangles.push_back(t); });
  }
  return loose_surface(triangles);
}

}  // namespace locvol
