#include "tools/visit_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <fstream>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "engine/shared/partial_file.h"
#include "refine/leaf_fields.h"
#include "tools/arguments.h"
#include "tools/results.h"

namespace locvol {

auto fields(Maybe<StoredVisit> auto& visit) {
  auto& [leaf, is_clean, num_visits, input, all_points, cells, num_left_out] = visit;
  return std::tuple(Field("leaf", leaf), Field("is_clean", is_clean),
                    Field("num_visits", num_visits), Field("input", input),
                    Field("all_points", all_points), Field("cells", cells),
                    Field("num_left_out", num_left_out));
}

namespace {

// {"format": "locvol visit", "version": 13, "visit": {...}}: a struct is an object of its fields()
// (refine/leaf_fields.h), or an array of them where there are many; an infinite number is null, and
// so is a last visit that there was not.
constexpr const char* kFormat = "locvol visit";
constexpr int kVersion = 13;

template <class T>
concept Row = Maybe<T, Point> || Maybe<T, MeshPoint> || Maybe<T, Triangle> ||
    Maybe<T, CreaseEdge> || Maybe<T, CornerPoint> || Maybe<T, LatticeSite> || Maybe<T, LatticeRow>;

template <class T>
Json json_of(const T& value) {
  Json json;
  if constexpr (std::same_as<T, double>) {
    if (std::isfinite(value)) json = value;
  } else if constexpr (std::same_as<T, MortonKey>) {
    json = key_text(value);
  } else if constexpr (std::is_enum_v<T>) {
    json = static_cast<int>(value);
  } else if constexpr (std::is_arithmetic_v<T>) {
    json = value;
  } else if constexpr (Row<T>) {
    for_each_field(value,
                   [&](const char*, const auto& member) { json.push_back(json_of(member)); });
  } else if constexpr (HasFields<const T>) {
    for_each_field(value,
                   [&](const char* name, const auto& member) { json[name] = json_of(member); });
  } else if constexpr (requires { value.has_value(); }) {
    if (value) json = json_of(*value);
  } else {
    json = Json::array();
    for (const auto& item : value) json.push_back(json_of(item));
  }
  return json;
}

template <class T>
void read(const Json& json, T& value) {
  if constexpr (std::same_as<T, double>) {
    value = json.is_null() ? std::numeric_limits<double>::infinity() : json.get<double>();
  } else if constexpr (std::same_as<T, MortonKey>) {
    value = parse_key(json.get<std::string>());
  } else if constexpr (std::same_as<T, PointKind>) {
    if (!json.is_number_unsigned() || json.get<std::uint64_t>() >= kNumPointKinds)
      throw std::runtime_error("a point of unknown kind");
    value = static_cast<PointKind>(json.get<int>());
  } else if constexpr (std::is_arithmetic_v<T>) {
    json.get_to(value);
  } else if constexpr (Row<T>) {
    std::size_t i = 0;
    for_each_field(value, [&](const char*, auto& member) { read(json.at(i++), member); });
  } else if constexpr (HasFields<T>) {
    for_each_field(value, [&](const char* name, auto& member) { read(json.at(name), member); });
  } else if constexpr (requires { value.has_value(); }) {
    if (!json.is_null()) read(json, value.emplace());
  } else {
    if (!json.is_array()) throw std::runtime_error("a list is missing");
    if constexpr (requires { value.resize(0); }) value.resize(json.size());
    for (std::size_t i = 0; i < value.size(); ++i) read(json.at(i), value[i]);
  }
}

// What the visit relies on.
void require_sense(const StoredVisit& visit) {
  const LeafInput& input = visit.input;
  if (!(input.criteria.size > 0)) throw std::runtime_error("the size is not positive");
  if (!input.domain.region.contains(input.domain.reference) ||
      !input.domain.region.contains(input.box.center()))
    throw std::runtime_error("the leaf lies outside its surface");
  for (const MeshPoint& p : input.own)
    if (!input.box.contains(p.position))
      throw std::runtime_error("an own point is not in the leaf");
  const auto is_near = [&](const LatticeSite& site) {
    return input.box.expanded((kCoreReach + 1) * input.core.lattice.size())
        .contains(input.core.lattice.undisplaced(site));
  };
  for (const auto& [first, count, body] : input.core.rows)
    if (count == 0 || count > 1U << 20 || !is_near(first) ||
        !is_near(first + LatticeSite{0, 0, 2 * static_cast<std::int32_t>(count - 1)}))
      throw std::runtime_error("a row of the core is not near the leaf");
  if (!input.last_visit) return;
  const auto& [vertices, cells] = input.last_visit->cells;
  for (const MeshCell& cell : cells)
    for (const std::uint32_t v : cell.vertices)
      if (v >= vertices.size()) throw std::runtime_error("a cell has no such vertex");
}

}  // namespace

void write_visit(const StoredVisit& visit, const std::filesystem::path& file) {
  const Json json = {{"format", kFormat}, {"version", kVersion}, {"visit", json_of(visit)}};
  const std::string text = json.dump() + "\n";
  PartialFile out(file);
  out.write_at(0, std::as_bytes(std::span(text)));
  out.publish();
}

StoredVisit read_visit(const std::filesystem::path& file) try {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("it cannot be opened");
  const Json json = Json::parse(in);
  if (json.at("format") != kFormat) throw std::runtime_error("its format is another");
  if (json.at("version") != kVersion) throw std::runtime_error("its version is another");
  StoredVisit visit;
  read(json.at("visit"), visit);
  require_sense(visit);
  return visit;
} catch (const std::exception& e) {
  throw std::runtime_error(fmt::format("{} is no visit that `locvol replay --dump` has written: {}",
                                       file.string(), e.what()));
}

}  // namespace locvol
