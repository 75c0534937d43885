// Vertices of several bodies, once for each of them: a mesh whose bodies share none, for contact.
#pragma once

#include <compare>
#include <cstdint>
#include <vector>

#include "octree/body_id.h"
#include "octree/mesh_facet.h"
#include "storage/records.h"

namespace locvol {

// A vertex as one body has it.
struct VertexCopy {
  std::uint64_t id = 0;  // of the point
  BodyId body = kNoBody;
  friend auto operator<=>(const VertexCopy&, const VertexCopy&) = default;
};

// The same cells, whose list of vertices has each point that they name once for each of the bodies
// that they are of, in the order of ids and bodies. `bodies`: of each of these vertices
struct CellsOfCopies {
  LeafCells cells;
  std::vector<BodyId> bodies;
};
CellsOfCopies with_copies(LeafCells cells);
// A sheet between two bodies becomes two. The one that belongs to the body with the larger id,
// which is `behind`, keeps its number; those of the others come after all sheets, in the same
// order. Each is called after its body, too: "weld of rotor".
class SheetSides {
 public:
  explicit SheetSides(const SurfaceSheets& sheets);
  // That of the body before it; the sheet itself, if there is none.
  SheetId other_side(SheetId sheet) const;
  const SurfaceSheets& sheets() const { return sheets_; }

 private:
  SurfaceSheets sheets_;
  std::vector<SheetId> other_side_;  // of each sheet of the surface
};

// The same of facets. One between two bodies becomes one of each.
struct FacetsOfCopies {
  LeafFacets facets;
  std::vector<BodyId> bodies;
};
FacetsOfCopies with_copies(const LeafFacets& facets, const SheetSides& sides);
// Is this the facet of the body in front of it, which with_copies() has added?
inline bool is_added(const FacetLabels& labels) { return labels.behind < labels.before; }

}  // namespace locvol
