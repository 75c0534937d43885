#include "tools/faces.h"

#include <fmt/format.h>

#include <algorithm>
#include <numbers>
#include <span>
#include <string_view>

#include "engine/shared/partial_file.h"

namespace locvol {
namespace {

double degrees(double radians) { return radians * 180 / std::numbers::pi; }

Json shape_json(const SheetShape& shape) {
  switch (shape.form) {
    case SheetForm::kPlane:
      return {
          {"kind", "plane"}, {"normal", to_json(shape.direction)}, {"deviation", shape.deviation}};
    case SheetForm::kCylinder:
      return {{"kind", "cylinder"},
              {"axis", to_json(shape.direction)},
              {"center", to_json(shape.place)},
              {"radius", shape.radius},
              {"is_hollow", shape.is_hollow},
              {"deviation", shape.deviation}};
    case SheetForm::kSphere:
      return {{"kind", "sphere"},
              {"center", to_json(shape.place)},
              {"radius", shape.radius},
              {"is_hollow", shape.is_hollow},
              {"deviation", shape.deviation}};
    case SheetForm::kCone:
      return {{"kind", "cone"},
              {"axis", to_json(shape.direction)},
              {"tip", to_json(shape.place)},
              {"half_angle_degrees", degrees(shape.half_angle)},
              {"is_hollow", shape.is_hollow},
              {"deviation", shape.deviation}};
    case SheetForm::kTorus:
      return {{"kind", "torus"},
              {"axis", to_json(shape.direction)},
              {"center", to_json(shape.place)},
              {"radius", shape.radius},
              {"tube_radius", shape.tube_radius},
              {"is_hollow", shape.is_hollow},
              {"deviation", shape.deviation}};
    case SheetForm::kOther:
      break;
  }
  return {{"kind", "other"}};
}

// Where the name comes from.
std::string_view source_of(const SheetTable& table, const SheetFacts& sheet) {
  if (!sheet.group.empty()) return "file";
  return table.rows.size() == 1 ? "whole surface" : "sharp edges";
}

std::string shape_text(const SheetShape& shape) {
  switch (shape.form) {
    case SheetForm::kPlane:
      return fmt::format(", plane, normal {}", rounded_text(shape.direction));
    case SheetForm::kCylinder:
      return fmt::format(", {} of radius {:.6g}", shape.is_hollow ? "hollow cylinder" : "cylinder",
                         shape.radius);
    case SheetForm::kSphere:
      return fmt::format(", {} of radius {:.6g}", shape.is_hollow ? "hollow sphere" : "sphere",
                         shape.radius);
    case SheetForm::kCone:
      return fmt::format(", {} of {:.6g}° around its axis",
                         shape.is_hollow ? "hollow cone" : "cone", degrees(shape.half_angle));
    case SheetForm::kTorus:
      return fmt::format(", {} of radius {:.6g}, its tube {:.6g}",
                         shape.is_hollow ? "hollow torus" : "torus", shape.radius,
                         shape.tube_radius);
    case SheetForm::kOther:
      break;
  }
  return {};
}

}  // namespace

Json to_json(const SheetTable& table) {
  Json faces = Json::array();
  for (const SheetRow& row : table.rows)
    faces.push_back({{"id", faces.size() + 1},
                     {"name", row.surface.name},
                     {"group", row.surface.group},
                     {"named_by", source_of(table, row.surface)},
                     {"bodies", {row.behind, row.before}},
                     {"num_facets", row.num_facets},
                     {"area", row.facet_area},
                     {"shape", shape_json(row.shape)},
                     {"surface",
                      {{"num_triangles", row.surface.num_triangles},
                       {"area", row.surface.area},
                       {"centroid", to_json(row.surface.centroid)},
                       {"box", to_json(row.surface.box)}}}});
  return {{"tolerance", table.tolerance}, {"faces", faces}};
}

std::string sheet_text(const SheetRow& row) {
  return fmt::format("{} facets, area {:.6g} (surface: {:.6g}), centroid {}{}", row.num_facets,
                     row.facet_area, row.surface.area, rounded_text(row.surface.centroid),
                     shape_text(row.shape));
}

std::string sheet_table_text(const SheetTable& table, std::size_t most_rows) {
  std::string text;
  const std::size_t num_shown = std::min(table.rows.size(), most_rows);
  for (std::size_t s = 0; s < num_shown; ++s) {
    const SheetRow& row = table.rows[s];
    text += fmt::format("{}  {}: {}\n", s + 1, row.surface.name, sheet_text(row));
  }
  if (num_shown < table.rows.size())
    text += fmt::format("and {} more: --json lists all\n", table.rows.size() - num_shown);
  return text;
}

std::filesystem::path faces_file(const std::filesystem::path& output) {
  return output.string() + ".faces.json";
}

void write_faces(const Store& store, const std::filesystem::path& output, bool is_split,
                 const StopToken* stop, Exchange& exchange) {
  SheetTable table = sheet_table(store, output, stop, exchange);
  const SurfaceSheets sheets = store.snapshot().sheets();
  if (is_split && sheets.has_several_bodies()) table = with_both_sides(std::move(table), sheets);
  do_on_all(exchange, [&] {
    if (exchange.rank() != 0) return;
    const std::string text = json_text(to_json(table));
    PartialFile file(faces_file(output), stop);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish();
  });
}

}  // namespace locvol
