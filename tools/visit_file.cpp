#include "tools/visit_file.h"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>

#include "engine/shared/partial_file.h"
#include "tools/arguments.h"
#include "tools/results.h"

namespace locvol {
namespace {

// {"format": "locvol visit", "version": 3, ...}; points are [id, kind, x, y, z], triangles
// [id, 9 coordinates], cells 4 ids, or 4 places in a list of ids; an infinite length is null, and
// so is a last visit that there was not.
constexpr const char* kFormat = "locvol visit";
constexpr int kVersion = 4;

Json points_json(const std::vector<MeshPoint>& points) {
  Json json = Json::array();
  for (const auto& [id, p, kind] : points)
    json.push_back({id, static_cast<int>(kind), p.x, p.y, p.z});
  return json;
}

std::vector<MeshPoint> points_from(const Json& json) {
  std::vector<MeshPoint> points;
  for (const Json& row : json) {
    const int kind = row.at(1);
    if (kind < 0 || kind > 2) throw std::runtime_error("a point has an unknown kind");
    points.push_back({row.at(0), {row.at(2), row.at(3), row.at(4)}, static_cast<PointKind>(kind)});
  }
  return points;
}

Json triangles_json(const std::vector<Triangle>& triangles) {
  Json json = Json::array();
  for (const auto& [id, corners] : triangles) {
    Json row = {id};
    for (const Point& p : corners)
      for (int axis = 0; axis < 3; ++axis) row.push_back(p[axis]);
    json.push_back(std::move(row));
  }
  return json;
}

std::vector<Triangle> triangles_from(const Json& json) {
  std::vector<Triangle> triangles;
  for (const Json& row : json) {
    Triangle& triangle = triangles.emplace_back();
    triangle.id = row.at(0);
    for (std::size_t i = 0; i < 3; ++i)
      triangle.corners[i] = {row.at(3 * i + 1), row.at(3 * i + 2), row.at(3 * i + 3)};
  }
  return triangles;
}

Point point_from(const Json& json) { return {json.at(0), json.at(1), json.at(2)}; }
Box box_from(const Json& json) { return {point_from(json.at("min")), point_from(json.at("max"))}; }

Json length_json(double length) { return std::isfinite(length) ? Json(length) : Json(nullptr); }
double length_from(const Json& json) {
  return json.is_null() ? std::numeric_limits<double>::infinity() : json.get<double>();
}

Json criteria_json(const Criteria& criteria) {
  return {{"size", criteria.size},
          {"radius_edge_bound", criteria.radius_edge_bound},
          {"reach", length_json(criteria.reach)},
          {"spacing_floor", criteria.spacing_floor},
          {"cover_radius", length_json(criteria.cover_radius)}};
}

Criteria criteria_from(const Json& json) {
  return {.size = json.at("size"),
          .radius_edge_bound = json.at("radius_edge_bound"),
          .reach = length_from(json.at("reach")),
          .spacing_floor = json.at("spacing_floor"),
          .cover_radius = length_from(json.at("cover_radius"))};
}

Json last_visit_json(const std::optional<LastVisit>& last) {
  if (!last) return nullptr;
  return {{"first_new_id", last->first_new_id},
          {"deleted", points_json(last->deleted)},
          {"vertices", last->cells.vertices},
          {"cells", last->cells.cells}};
}

std::optional<LastVisit> last_visit_from(const Json& json) {
  if (json.is_null()) return std::nullopt;
  LastVisit last;
  json.at("first_new_id").get_to(last.first_new_id);
  last.deleted = points_from(json.at("deleted"));
  json.at("vertices").get_to(last.cells.vertices);
  json.at("cells").get_to(last.cells.cells);
  return last;
}

StoredVisit visit_from(const Json& json) {
  if (json.at("format") != kFormat) throw std::runtime_error("its format is another");
  if (json.at("version") != kVersion) throw std::runtime_error("its version is another");
  StoredVisit visit;
  visit.leaf = parse_key(json.at("leaf").get<std::string>());
  json.at("is_clean").get_to(visit.is_clean);
  json.at("num_visits").get_to(visit.num_visits);
  json.at("num_left_out").get_to(visit.num_left_out);
  visit.input.criteria = criteria_from(json.at("criteria"));
  visit.input.box = box_from(json.at("box"));
  json.at("max_own_points").get_to(visit.input.max_own_points);
  json.at("max_insertions").get_to(visit.input.max_insertions);
  visit.input.last_visit = last_visit_from(json.at("last_visit"));
  visit.region = box_from(json.at("region"));
  json.at("is_center_inside").get_to(visit.is_center_inside);
  visit.input.own = points_from(json.at("own"));
  visit.input.ghosts = points_from(json.at("ghosts"));
  visit.core = points_from(json.at("core"));
  if (json.contains("all_points")) visit.all_points = points_from(json.at("all_points"));
  visit.triangles = triangles_from(json.at("triangles"));
  json.at("cells").get_to(visit.cells);
  return visit;
}

void require_sense(const StoredVisit& visit) {
  const LeafInput& input = visit.input;
  if (!(input.criteria.size > 0)) throw std::runtime_error("the size is not positive");
  if (!visit.region.contains(input.box.center()))
    throw std::runtime_error("the leaf lies outside its surface");
  for (const MeshPoint& p : input.own)
    if (!input.box.contains(p.position))
      throw std::runtime_error("an own point is not in the leaf");
  if (!input.last_visit) return;
  const auto& [vertices, cells] = input.last_visit->cells;
  for (const auto& cell : cells)
    for (const std::uint32_t v : cell)
      if (v >= vertices.size()) throw std::runtime_error("a cell has no such vertex");
}

}  // namespace

void write_visit(const StoredVisit& visit, const std::filesystem::path& file) {
  Json json = {{"format", kFormat},
               {"version", kVersion},
               {"leaf", key_text(visit.leaf)},
               {"is_clean", visit.is_clean},
               {"num_visits", visit.num_visits},
               {"num_left_out", visit.num_left_out},
               {"criteria", criteria_json(visit.input.criteria)},
               {"box", to_json(visit.input.box)},
               {"max_own_points", visit.input.max_own_points},
               {"max_insertions", visit.input.max_insertions},
               {"last_visit", last_visit_json(visit.input.last_visit)},
               {"region", to_json(visit.region)},
               {"is_center_inside", visit.is_center_inside},
               {"own", points_json(visit.input.own)},
               {"ghosts", points_json(visit.input.ghosts)},
               {"core", points_json(visit.core)}};
  if (visit.all_points) json["all_points"] = points_json(*visit.all_points);
  json["triangles"] = triangles_json(visit.triangles);
  json["cells"] = visit.cells;
  const std::string text = json.dump() + "\n";
  PartialFile out(file);
  out.write_at(0, std::as_bytes(std::span(text)));
  out.publish();
}

StoredVisit read_visit(const std::filesystem::path& file) try {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("it cannot be opened");
  StoredVisit visit = visit_from(Json::parse(in));
  require_sense(visit);
  return visit;
} catch (const std::exception& e) {
  throw std::runtime_error(fmt::format("{} is no visit that `locvol replay --dump` has written: {}",
                                       file.string(), e.what()));
}

}  // namespace locvol
