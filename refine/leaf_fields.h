// What a visit takes and gives is made of: one list for all that store, send, print or compare it.
// fields(value) gives each member's name and the member itself, in order, and for_each_field()
// hands them on. A member that is not listed does not compile.
#pragma once

#include <tuple>
#include <type_traits>

#include "octree/crease.h"
#include "octree/geometry.h"
#include "octree/lattice.h"
#include "octree/size_nodes.h"
#include "refine/cover_leaf.h"
#include "refine/crease_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/leaf.h"

namespace locvol {

template <class T>
struct Field {
  const char* name;
  T& value;
};
template <class T>
Field(const char*, T&) -> Field<T>;

auto fields(Maybe<Point> auto& point) {
  auto& [x, y, z] = point;
  return std::tuple(Field("x", x), Field("y", y), Field("z", z));
}
auto fields(Maybe<Box> auto& box) {
  auto& [min, max] = box;
  return std::tuple(Field("min", min), Field("max", max));
}
auto fields(Maybe<DomainState> auto& state) {
  return std::tuple(Field("body", DomainState::member(state)));
}
auto fields(Maybe<CornerStates> auto& corners) {
  return std::tuple(Field("states", CornerStates::member(corners)));
}
auto fields(Maybe<Triangle> auto& triangle) {
  auto& [id, corners, sheet, change] = triangle;
  return std::tuple(Field("id", id), Field("corners", corners), Field("sheet", sheet),
                    Field("change", change));
}
auto fields(Maybe<CreaseEdge> auto& edge) {
  auto& [ends, is_corner, sheets, crease] = edge;
  return std::tuple(Field("ends", ends), Field("is_corner", is_corner), Field("sheets", sheets),
                    Field("crease", crease));
}
auto fields(Maybe<CornerPoint> auto& point) {
  auto& [position, corner] = point;
  return std::tuple(Field("position", position), Field("corner", corner));
}
auto fields(Maybe<MeshPoint> auto& point) {
  auto& [id, position, kind] = point;
  return std::tuple(Field("id", id), Field("position", position), Field("kind", kind));
}
auto fields(Maybe<LatticeSite> auto& site) {
  auto& [i, j, k] = site;
  return std::tuple(Field("i", i), Field("j", j), Field("k", k));
}
auto fields(Maybe<LatticeRow> auto& row) {
  auto& [first, count, body] = row;
  return std::tuple(Field("first", first), Field("count", count), Field("body", body));
}
auto fields(Maybe<LatticeCore> auto& core) {
  auto& [is_whole, rows, body] = core;
  return std::tuple(Field("is_whole", is_whole), Field("rows", rows), Field("body", body));
}
auto fields(Maybe<Lattice> auto& lattice) {
  auto [origin, grid_origin, half, grid_side, is_of_cubes] = Lattice::members(lattice);
  return std::tuple(Field("origin", origin), Field("grid_origin", grid_origin), Field("half", half),
                    Field("grid_side", grid_side), Field("is_of_cubes", is_of_cubes));
}
auto fields(Maybe<GridFineness> auto& fineness) {
  auto& [resolution, triangles_per_cell] = fineness;
  return std::tuple(Field("resolution", resolution),
                    Field("triangles_per_cell", triangles_per_cell));
}
auto fields(Maybe<DomainPiece> auto& piece) {
  auto& [triangles, region, reference, reference_state, fineness, is_whole, creases, corners,
         crease_floor] = piece;
  return std::tuple(Field("triangles", triangles), Field("region", region),
                    Field("reference", reference), Field("reference_state", reference_state),
                    Field("fineness", fineness), Field("is_whole", is_whole),
                    Field("creases", creases), Field("corners", corners),
                    Field("crease_floor", crease_floor));
}
auto fields(Maybe<CoreRows> auto& core) {
  auto& [lattice, rows] = core;
  return std::tuple(Field("lattice", lattice), Field("rows", rows));
}

auto fields(Maybe<SizeLaw> auto& law) {
  auto& [surface, growth, most, least] = law;
  return std::tuple(Field("surface", surface), Field("growth", growth), Field("most", most),
                    Field("least", least));
}
auto fields(Maybe<SizeCube> auto& cube) {
  auto& [key, distance, excess, less] = cube;
  return std::tuple(Field("key", key), Field("distance", distance), Field("excess", excess),
                    Field("less", less));
}
auto fields(Maybe<Frame> auto& frame) {
  auto [origin, unit] = Frame::members(frame);
  return std::tuple(Field("origin", origin), Field("unit", unit));
}
auto fields(Maybe<SizedNode> auto& node) {
  auto& [key, size] = node;
  return std::tuple(Field("key", key), Field("size", size));
}

auto fields(Maybe<SizeCubes> auto& sizes) {
  auto& [law, frame, cubes] = sizes;
  return std::tuple(Field("law", law), Field("frame", frame), Field("cubes", cubes));
}

auto fields(Maybe<Criteria> auto& criteria) {
  auto& [size, radius_edge_bound, reach, min_dihedral, spacing_floor, cover_radius,
         is_surface_only] = criteria;
  return std::tuple(Field("size", size), Field("radius_edge_bound", radius_edge_bound),
                    Field("reach", reach), Field("min_dihedral", min_dihedral),
                    Field("spacing_floor", spacing_floor), Field("cover_radius", cover_radius),
                    Field("is_surface_only", is_surface_only));
}
auto fields(Maybe<MeshCell> auto& cell) {
  auto& [vertices, body] = cell;
  return std::tuple(Field("vertices", vertices), Field("body", body));
}
auto fields(Maybe<NamedCell> auto& cell) {
  auto& [vertices, body] = cell;
  return std::tuple(Field("vertices", vertices), Field("body", body));
}
auto fields(Maybe<CellList> auto& list) {
  auto& [vertices, cells] = list;
  return std::tuple(Field("vertices", vertices), Field("cells", cells));
}
auto fields(Maybe<FacetLabels> auto& labels) {
  auto& [behind, before, sheet] = labels;
  return std::tuple(Field("behind", behind), Field("before", before), Field("sheet", sheet));
}
auto fields(Maybe<MeshFacet> auto& facet) {
  auto& [vertices, labels] = facet;
  return std::tuple(Field("vertices", vertices), Field("labels", labels));
}
auto fields(Maybe<NamedFacet> auto& facet) {
  auto& [vertices, labels] = facet;
  return std::tuple(Field("vertices", vertices), Field("labels", labels));
}
auto fields(Maybe<FacetList> auto& list) {
  auto& [vertices, facets] = list;
  return std::tuple(Field("vertices", vertices), Field("facets", facets));
}
auto fields(Maybe<LastVisit> auto& last) {
  auto& [first_new_id, cells, facets, asked] = last;
  return std::tuple(Field("first_new_id", first_new_id), Field("cells", cells),
                    Field("facets", facets), Field("asked", asked));
}
auto fields(Maybe<LeafInput> auto& input) {
  auto& [criteria, box, own, ghosts, domain, core, sizes, max_own_points, last_visit,
         max_insertions, waiting, crease_points, are_sides_apart] = input;
  return std::tuple(Field("criteria", criteria), Field("box", box), Field("own", own),
                    Field("ghosts", ghosts), Field("domain", domain), Field("core", core),
                    Field("sizes", sizes), Field("max_own_points", max_own_points),
                    Field("last_visit", last_visit), Field("max_insertions", max_insertions),
                    Field("waiting", waiting), Field("crease_points", crease_points),
                    Field("are_sides_apart", are_sides_apart));
}

auto fields(Maybe<InsertedPoint> auto& point) {
  auto& [position, kind, is_deleted, changed] = point;
  return std::tuple(Field("position", position), Field("kind", kind),
                    Field("is_deleted", is_deleted), Field("changed", changed));
}
auto fields(Maybe<Violation> auto& violation) {
  auto& [condition, position, radius] = violation;
  return std::tuple(Field("condition", condition), Field("position", position),
                    Field("radius", radius));
}
auto fields(Maybe<PoorCell> auto& cell) {
  auto& [position, degrees, others] = cell;
  return std::tuple(Field("position", position), Field("degrees", degrees),
                    Field("others", others));
}
auto fields(Maybe<OthersCell> auto& cell) {
  auto& [name, smallest] = cell;
  return std::tuple(Field("cell", name), Field("smallest", smallest));
}
auto fields(Maybe<OthersFacet> auto& facet) {
  auto& [name, smallest] = facet;
  return std::tuple(Field("facet", name), Field("smallest", smallest));
}
auto fields(Maybe<VisitStats> auto& stats) {
  auto& [insertions, moves, deletions, points_added, cells_made] = stats;
  return std::tuple(Field("insertions", insertions), Field("moves", moves),
                    Field("deletions", deletions), Field("points_added", points_added),
                    Field("cells_made", cells_made));
}
auto fields(Maybe<CoverPoints> auto& points) {
  auto& [samples, lattice, core] = points;
  return std::tuple(Field("samples", samples), Field("lattice", lattice), Field("core", core));
}
auto fields(Maybe<CreasePoints> auto& points) {
  auto& [positions] = points;
  return std::tuple(Field("positions", positions));
}
auto fields(Maybe<FillPoints> auto& points) {
  auto& [centers, met_core] = points;
  return std::tuple(Field("centers", centers), Field("met_core", met_core));
}
auto fields(Maybe<LeafDelta> auto& delta) {
  auto& [inserted, deleted, moved, left, others_gone, others_made, others_facets_gone,
         others_facets_made, cells, facets, met_core, unresolved, poor, stats, is_overfull, sizes] =
      delta;
  return std::tuple(Field("inserted", inserted), Field("deleted", deleted), Field("moved", moved),
                    Field("left", left), Field("others_gone", others_gone),
                    Field("others_made", others_made),
                    Field("others_facets_gone", others_facets_gone),
                    Field("others_facets_made", others_facets_made), Field("cells", cells),
                    Field("facets", facets), Field("met_core", met_core),
                    Field("unresolved", unresolved), Field("poor", poor), Field("stats", stats),
                    Field("is_overfull", is_overfull), Field("sizes", sizes));
}

template <class T>
concept HasFields = requires(T& value) {
  fields(value);
};

// Calls visit(name, member) for each.
template <HasFields T, class Visit>
void for_each_field(T& value, const Visit& visit) {
  std::apply([&](const auto&... field) { (visit(field.name, field.value), ...); }, fields(value));
}

}  // namespace locvol
