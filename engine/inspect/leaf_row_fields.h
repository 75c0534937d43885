// What is told of leaves, as exchange/pack.h asks for it.
#pragma once

#include <boost/serialization/level.hpp>
#include <boost/serialization/string.hpp>
#include <string>
#include <tuple>

#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/poor_cell.h"
#include "refine/leaf_fields.h"
#include "storage/codec.h"

namespace boost::serialization {

// LeafInfo is sent as the store's codec writes it.
template <class Archive>
void serialize(Archive& archive, locvol::LeafInfo& info, unsigned) {
  std::string record;
  if constexpr (Archive::is_saving::value) record = locvol::encode(info, locvol::MortonKey());
  archive& record;
  if constexpr (Archive::is_loading::value)
    info = locvol::decode<locvol::LeafInfo>(record, locvol::MortonKey());
}

}  // namespace boost::serialization

BOOST_CLASS_IMPLEMENTATION(locvol::LeafInfo, object_serializable)

namespace locvol {

auto fields(Maybe<QueuePosition> auto& position) {
  auto& [epoch, color] = position;
  return std::tuple(Field("epoch", epoch), Field("color", color));
}
auto fields(Maybe<QueueEntry> auto& entry) {
  auto& [position, leaf] = entry;
  return std::tuple(Field("position", position), Field("leaf", leaf));
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
  auto& [leaf, position, radius, degrees, is_forced] = cell;
  return std::tuple(Field("leaf", leaf), Field("position", position), Field("radius", radius),
                    Field("degrees", degrees), Field("is_forced", is_forced));
}

}  // namespace locvol
