// Facets of finished meshes have the sheets of the triangles closest to them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/output/mesh_source.h"
#include "refine/domain/closest_point.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/store_contents.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

class FacetSheets : public testing::Test {
 protected:
  MeshOptions options(const std::string& obj, double size) {
    MeshOptions options;
    options.input = dir_ / "surface.obj";
    std::ofstream(options.input) << obj;
    options.size = {size, false};
    options.leaf_capacity = 300;
    return options;
  }

  Contents meshed(MeshOptions options, const std::string& name, int num_threads = 1) {
    options.store = dir_ / name;
    RunControl control;
    control.num_threads = num_threads;
    mesh(options, control);
    return contents_of(options.store);
  }

  // Facets by sheet, and their areas. All are told wrong that are farther from their sheet than
  // from another.
  std::map<SheetId, double> areas_of(const std::string& name) {
    std::map<std::uint64_t, Triangle> triangles;
    for (const auto& [key, leaf] : contents_of(dir_ / name).leaves)
      for (const Triangle& t : leaf.surface.triangles) triangles.emplace(t.id, t);
    const Store store = Store::open(dir_ / name, {.read_only = true});
    MeshSource source(store, dir_ / "mesh", 1);
    std::map<SheetId, double> areas;
    std::uint64_t num_wrong = 0;
    const auto facets = source.boundary().facets({.has_corners = true});
    while (const auto some = facets())
      for (std::size_t f = 0; f < some->facets.size(); ++f) {
        const auto& [a, b, c] = some->corners[f];
        const SheetId sheet = some->facets[f].labels.sheet;
        areas[sheet] += 0.5 * norm(cross(b - a, c - a));
        const Point centroid = 1.0 / 3 * (a + b + c);
        double nearest = std::numeric_limits<double>::infinity(), of_sheet = nearest;
        for (const auto& [id, t] : triangles) {
          const Point q = closest_on_triangle(t.corners, centroid);
          const double distance = std::sqrt(squared_distance(q, centroid));
          nearest = std::min(nearest, distance);
          if (t.sheet == sheet) of_sheet = std::min(of_sheet, distance);
        }
        num_wrong += of_sheet > nearest + 1e-9;
      }
    EXPECT_EQ(num_wrong, 0U);
    const AuditReport report = audit(store);
    EXPECT_EQ(report.num_wrong_facets, 0U);
    EXPECT_TRUE(report.is_valid());
    return areas;
  }

  TempDir dir_;
};

TEST_F(FacetSheets, OfABoxWithSixNames) {
  const Polygons box = box_of_quads({0, 0, 0}, {3, 2, 1});
  const std::vector<std::string> names = {"below", "above", "front", "back", "left", "right"};
  const MeshOptions options = this->options(to_grouped_obj(box, names), 0.15);
  const Contents contents = meshed(options, "one");
  ASSERT_EQ(contents.sheets.sheets.size(), 6U);
  for (std::size_t s = 0; s < 6; ++s) EXPECT_EQ(contents.sheets.sheets[s].name, names[s]);
  const std::map<SheetId, double> areas = areas_of("one");
  const std::vector<double> expected = {6, 6, 3, 3, 2, 2};
  for (SheetId sheet = 1; sheet <= 6; ++sheet)
    EXPECT_NEAR(areas.at(sheet), expected[sheet - 1], 0.15 * expected[sheet - 1]) << sheet;
  EXPECT_TRUE(are_equal(contents, meshed(options, "three", 3)));
}

TEST_F(FacetSheets, OfACylinderBySharpEdges) {
  MeshOptions options = this->options(to_grouped_obj(cylinder(64, 2)), 0.2);
  const Contents contents = meshed(options, "cylinder");
  ASSERT_EQ(contents.sheets.sheets.size(), 3U);
  EXPECT_EQ(contents.sheets.sheets[0].name, "sheet 1");
  EXPECT_NEAR(contents.sheets.sheets[0].area, 4 * std::numbers::pi, 0.02);
  const std::map<SheetId, double> areas = areas_of("cylinder");
  EXPECT_NEAR(areas.at(1), 4 * std::numbers::pi, 1);
  EXPECT_NEAR(areas.at(2), std::numbers::pi, 0.5);
  EXPECT_NEAR(areas.at(3), std::numbers::pi, 0.5);
  options.sharp_angle = 0;
  const Contents plain = meshed(options, "plain");
  EXPECT_TRUE(plain.sheets.sheets.empty());
  for (const auto& [key, leaf] : plain.leaves)
    for (const MeshFacet& facet : leaf.facets.facets) EXPECT_EQ(facet.labels, FacetLabels());
}

}  // namespace
}  // namespace locvol
