// What is told of leaves, as exchange/pack.h asks for it.
#pragma once

#include <tuple>

#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/poor_cell.h"
#include "refine/leaf_fields.h"

namespace locvol {

auto fields(Maybe<QueuePosition> auto& position) {
  auto& [epoch, color] = position;
  return std::tuple(Field("epoch", epoch), Field("color", color));
}
auto fields(Maybe<QueueEntry> auto& entry) {
  auto& [position, leaf] = entry;
  return std::tuple(Field("position", position), Field("leaf", leaf));
}
auto fields(Maybe<LeafInfo> auto& info) {
  auto& [is_center_inside, num_visits, num_points, num_cells, num_triangles, num_insertions,
         num_deletions, num_moves, num_unresolved, queued, first_new_id, num_core_points,
         num_core_cells, num_left_out, least_size, largest_size, surface_size, reached_size,
         holding, ranks] = info;
  return std::tuple(Field("is_center_inside", is_center_inside), Field("num_visits", num_visits),
                    Field("num_points", num_points), Field("num_cells", num_cells),
                    Field("num_triangles", num_triangles), Field("num_insertions", num_insertions),
                    Field("num_deletions", num_deletions), Field("num_moves", num_moves),
                    Field("num_unresolved", num_unresolved), Field("queued", queued),
                    Field("first_new_id", first_new_id), Field("num_core_points", num_core_points),
                    Field("num_core_cells", num_core_cells), Field("num_left_out", num_left_out),
                    Field("least_size", least_size), Field("largest_size", largest_size),
                    Field("surface_size", surface_size), Field("reached_size", reached_size),
                    Field("holding", holding), Field("ranks", ranks));
}
auto fields(Maybe<UnresolvedSite> auto& site) {
  auto& [condition, position, radius] = site;
  return std::tuple(Field("condition", condition), Field("position", position),
                    Field("radius", radius));
}
auto fields(Maybe<LeafUnresolved> auto& unresolved) {
  auto& [sites] = unresolved;
  return std::tuple(Field("sites", sites));
}
auto fields(Maybe<Fault> auto& fault) {
  auto& [leaf, message] = fault;
  return std::tuple(Field("leaf", leaf), Field("message", message));
}
auto fields(Maybe<LeafRow> auto& row) {
  auto& [key, info, unresolved, faults] = row;
  return std::tuple(Field("key", key), Field("info", info), Field("unresolved", unresolved),
                    Field("faults", faults));
}
auto fields(Maybe<LeafPoorCell> auto& cell) {
  auto& [leaf, position, radius, degrees] = cell;
  return std::tuple(Field("leaf", leaf), Field("position", position), Field("radius", radius),
                    Field("degrees", degrees));
}

}  // namespace locvol
