// A facet of the boundary of the mesh, or of one between two of its bodies, and what it parts.
#pragma once

#include <array>
#include <cstdint>

#include "octree/body_id.h"

namespace locvol {

// Numbers of what a user names in a mesh's boundary; they count from 1.
using SheetId = std::uint32_t;

inline constexpr SheetId kOnlySheet = 1;  // where there is one, it is this

struct FacetLabels {
  // A facet between two bodies is there once, and `behind` is the larger of the two.
  BodyId behind = kOnlyBody;  // its normal points away from that body's cell
  BodyId before = kNoBody;    // what lies on the other side
  SheetId sheet = kOnlySheet;
  friend auto operator<=>(const FacetLabels&, const FacetLabels&) = default;
};

struct MeshFacet {
  // Places in a list of vertices: counterclockwise seen from before, the smallest first.
  std::array<std::uint32_t, 3> vertices{};
  FacetLabels labels;
  friend auto operator<=>(const MeshFacet&, const MeshFacet&) = default;
};

// The same triangle, seen from the same side, with its smallest vertex first.
template <class Name>
constexpr std::array<Name, 3> smallest_first(const std::array<Name, 3>& facet) {
  const auto& [a, b, c] = facet;
  if (a < b && a < c) return facet;
  return b < c ? std::array{b, c, a} : std::array{c, a, b};
}

}  // namespace locvol
