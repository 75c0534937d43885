// A facet of the mesh's boundary, and what it parts.
#pragma once

#include <array>
#include <cstdint>

namespace locvol {

// What a user names in a mesh. Ids count from 1.
using BodyId = std::uint32_t;   // of the domain's parts; 0: outside of all
using SheetId = std::uint32_t;  // of the boundary's parts

inline constexpr BodyId kNoBody = 0;

struct FacetLabels {
  BodyId behind = 1;        // the body whose cell has the facet: its normal points away from that
  BodyId before = kNoBody;  // what lies on the other side
  SheetId sheet = 1;
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
