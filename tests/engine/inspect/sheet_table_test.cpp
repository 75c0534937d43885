// What is known of sheets, for shapes that people know; and of whole runs.
#include "engine/inspect/sheet_table.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "engine/engine.h"
#include "engine/output/mesh_source.h"
#include "engine/shared/input_error.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

constexpr double kPi = std::numbers::pi;
using Triangle3 = std::array<Point, 3>;

SheetShape shape_of(const std::vector<Triangle3>& triangles, double tolerance = 1e-5) {
  ShapeSums sums(triangles.front()[0]);
  for (const Triangle3& t : triangles) sums.add(t);
  ShapeCheck check(sums, tolerance);
  for (const Triangle3& t : triangles) check.add(t);
  return check.shape(tolerance);
}

// n × m quadrilaterals of a patch, each cut in two.
std::vector<Triangle3> patch(int n, int m, const std::function<Point(double, double)>& at) {
  std::vector<Triangle3> triangles;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < m; ++j) {
      const auto corner = [&](int k, int l) { return at(1.0 * k / n, 1.0 * l / m); };
      triangles.push_back({corner(i, j), corner(i + 1, j), corner(i + 1, j + 1)});
      triangles.push_back({corner(i, j), corner(i + 1, j + 1), corner(i, j + 1)});
    }
  return triangles;
}

void expect_near(const Point& a, const Point& b, double tolerance) {
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(a[axis], b[axis], tolerance) << "xyz"[axis];
}

// Leaning, and far from the origin.
Point moved(const Point& p) {
  const double c = std::cos(0.7), s = std::sin(0.7);
  const Point turned = {c * p.x - s * p.z, p.y, s * p.x + c * p.z};
  return turned + Point{100, -200, 50};
}
const Point kUp = moved({0, 0, 1}) - moved({0, 0, 0});

TEST(SheetShape, APlaneHasANormal) {
  const SheetShape shape = shape_of(patch(3, 2, [](double u, double v) {
    return moved({2 * u, v, 0});
  }));
  EXPECT_EQ(shape.form, SheetForm::kPlane);
  expect_near(shape.direction, kUp, 1e-12);
  expect_near(shape.place, moved({1, 0.5, 0}), 1e-12);
}

TEST(SheetShape, ACylinderHasAnAxisAndARadius) {
  for (const double angle : {0.5 * kPi, kPi, 2 * kPi})
    for (const bool is_hollow : {false, true}) {
      const double turn = is_hollow ? -angle : angle;
      const SheetShape shape = shape_of(patch(12, 3, [&](double u, double v) {
        return moved({3 * std::cos(turn * u), 3 * std::sin(turn * u), 8 * v});
      }));
      EXPECT_EQ(shape.form, SheetForm::kCylinder) << angle;
      EXPECT_NEAR(shape.radius, 3, 1e-9);
      EXPECT_NEAR(std::abs(dot(shape.direction, kUp)), 1, 1e-12);
      const Point from = shape.place - moved({0, 0, 4});
      EXPECT_NEAR(norm(from), 0, 1e-9);
      EXPECT_EQ(shape.is_hollow, is_hollow);
      EXPECT_LT(shape.deviation, 1e-9);
    }
}

TEST(SheetShape, ASphereHasACenter) {
  for (const double height : {0.5, 1.0, 2.0}) {  // of the cap, over the radius
    const double angle = std::acos(1 - height);
    const SheetShape shape = shape_of(patch(24, 12, [&](double u, double v) {
      const double around = 2 * kPi * u, down = angle * v;
      return moved(
          {std::sin(down) * std::cos(around), std::sin(down) * std::sin(around), std::cos(down)});
    }));
    EXPECT_EQ(shape.form, SheetForm::kSphere) << height;
    EXPECT_NEAR(shape.radius, 1, 1e-9);
    expect_near(shape.place, moved({0, 0, 0}), 1e-9);
  }
}

// Between two circles, in steps that differ, or up to the tip.
TEST(SheetShape, AConeHasATipAndAnAngle) {
  for (const double from : {0.0, 1.0})
    for (const double angle : {0.7 * kPi, 2 * kPi})
      for (const bool is_hollow : {false, true}) {
        if (from == 0 && angle < kPi) continue;  // one circle and a point: too little to be sure
        const double turn = is_hollow ? -angle : angle;
        const SheetShape shape = shape_of(patch(16, 1, [&](double u, double v) {
          const double around = turn * (u + 0.02 * std::sin(7 * u)), z = from + (3 - from) * v;
          return moved({0.5 * z * std::cos(around), 0.5 * z * std::sin(around), -z});
        }));
        ASSERT_EQ(shape.form, SheetForm::kCone) << from << " " << angle;
        EXPECT_NEAR(shape.half_angle, std::atan(0.5), 1e-5);
        expect_near(shape.direction, -1.0 * kUp, 1e-4);
        expect_near(shape.place, moved({0, 0, 0}), 1e-4);
        EXPECT_EQ(shape.is_hollow, !is_hollow);
      }
}

// All of it, a fillet around a hole, and the bend of a pipe.
TEST(SheetShape, ATorusHasTwoRadii) {
  struct Part {
    double first, last, first_of_tube, last_of_tube;
  };
  for (const auto& [first, last, first_of_tube, last_of_tube] :
       {Part{0, 2 * kPi, 0, 2 * kPi}, Part{0, 2 * kPi, kPi, 1.5 * kPi},
        Part{0, 0.5 * kPi, 0, 2 * kPi}})
    for (const bool is_hollow : {false, true}) {
      const SheetShape shape = shape_of(patch(24, 8, [&](double u, double v) {
        const double t = is_hollow ? 1 - v : v, around = first + u * (last - first),
                     tube = first_of_tube + t * (last_of_tube - first_of_tube);
        const double r = 3 + std::cos(tube);
        return moved({r * std::cos(around), r * std::sin(around), std::sin(tube)});
      }));
      ASSERT_EQ(shape.form, SheetForm::kTorus) << last << " " << last_of_tube;
      EXPECT_NEAR(shape.radius, 3, 1e-4);
      EXPECT_NEAR(shape.tube_radius, 1, 1e-4);
      EXPECT_NEAR(std::abs(dot(shape.direction, kUp)), 1, 1e-6);
      expect_near(shape.place, moved({0, 0, 0}), 1e-4);
      EXPECT_EQ(shape.is_hollow, is_hollow);
    }
}

// In whatever order triangles come, and in parts.
TEST(SheetShape, SamplesAreTheSameInAnyOrder) {
  std::vector<Triangle3> triangles = patch(20, 20, [](double u, double v) {
    return moved({std::cos(u), std::sin(u), v});
  });
  ShapeSums all, first, rest;
  for (const Triangle3& t : triangles) all.add(t);
  std::ranges::reverse(triangles);
  for (std::size_t t = 0; t < triangles.size(); ++t) (t % 3 == 0 ? first : rest).add(triangles[t]);
  for (const Point& corner : rest.samples()) first.add_sample(corner);
  EXPECT_EQ(all.samples().size(), ShapeSums::kMostSamples);
  EXPECT_EQ(first.samples(), all.samples());
}

TEST(SheetShape, WhatIsNoneOfTheseIsTold) {
  const auto form = [](int n, const std::function<Point(double, double)>& at) {
    return shape_of(patch(n, 4, at)).form;
  };
  // A cup, a ring that is an ellipse across, a saddle, a cylinder with a dent.
  EXPECT_EQ(form(20,
                 [](double u, double v) {
                   const double r = 1 + v * v;
                   return Point{r * std::cos(2 * kPi * u), r * std::sin(2 * kPi * u), v};
                 }),
            SheetForm::kOther);
  EXPECT_EQ(form(20,
                 [](double u, double v) {
                   const double r = 3 + std::cos(2 * kPi * v);
                   return Point{r * std::cos(2 * kPi * u), r * std::sin(2 * kPi * u),
                                1.2 * std::sin(2 * kPi * v)};
                 }),
            SheetForm::kOther);
  EXPECT_EQ(form(20, [](double u, double v) { return Point{u, v, u * v}; }), SheetForm::kOther);
  EXPECT_EQ(form(20,
                 [](double u, double v) {
                   const double r = u == 0.5 && v == 0.5 ? 0.999 : 1;
                   return Point{r * std::cos(2 * kPi * u), r * std::sin(2 * kPi * u), v};
                 }),
            SheetForm::kOther);
  // Two or three planes have all their corners on a cylinder, too.
  EXPECT_EQ(form(2,
                 [](double u, double v) {
                   return Point{u, v, 0.1 * (u < 0.5 ? u : 1 - u)};
                 }),
            SheetForm::kOther);
  EXPECT_EQ(form(2,
                 [](double u, double v) {
                   return Point{std::cos(0.5 * u), std::sin(0.5 * u), v};
                 }),
            SheetForm::kOther);
}

TEST(SheetShape, WhatHasNoAreaHasNone) {
  EXPECT_EQ(shape_of({{Point{0, 0, 0}, Point{1, 0, 0}, Point{2, 0, 0}}}).form, SheetForm::kOther);
  EXPECT_EQ(shape_of({{Point{0, 0, 0}, Point{1, 0, 0}, Point{0, 1, 0}}}).form, SheetForm::kPlane);
}

class SheetTables : public testing::Test {
 protected:
  SheetTable table_of(const std::string& name, const std::string& surface, double size,
                      const std::vector<SizedPart>& sheets = {}) {
    MeshOptions options;
    options.input = dir_ / name;
    std::ofstream(options.input) << surface;
    options.size = {size, false};
    options.store = dir_ / (name + "-store");
    options.leaf_capacity = 500;
    options.sheets = sheets;
    mesh(options, {});
    return sheet_table(Store::open(options.store, {.read_only = true}), dir_ / "table");
  }

  TempDir dir_;
};

TEST_F(SheetTables, OfABoxAreSixPlanes) {
  const std::vector<std::string> names = {"below", "above", "front", "back", "left", "right"};
  const SheetTable table =
      table_of("box.obj", to_grouped_obj(box_of_quads({0, 0, 0}, {3, 2, 1}), names), 0.2);
  ASSERT_EQ(table.rows.size(), 6U);
  const std::vector<Point> normals = {{0, 0, -1}, {0, 0, 1},  {0, -1, 0},
                                      {0, 1, 0},  {-1, 0, 0}, {1, 0, 0}};
  const Store store = Store::open(dir_ / "box.obj-store", {.read_only = true});
  MeshSource source(store, dir_ / "mesh", 1);
  source.boundary().sort_facets();
  for (std::size_t s = 0; s < 6; ++s) {
    const SheetRow& row = table.rows[s];
    EXPECT_EQ(row.surface.name, names[s]);
    EXPECT_EQ(row.surface.num_triangles, 2U);
    EXPECT_EQ(row.shape.form, SheetForm::kPlane);
    expect_near(row.shape.direction, normals[s], 1e-12);
    expect_near(row.shape.place, row.surface.centroid, 1e-12);
    EXPECT_EQ(row.behind, 1U);
    EXPECT_EQ(row.before, 0U);
    double area = 0;
    std::uint64_t num_facets = 0;
    const auto facets =
        source.boundary().facets_of(static_cast<SheetId>(s + 1), {.has_corners = true});
    while (const auto some = facets())
      for (const auto& [a, b, c] : some->corners) {
        area += 0.5 * norm(cross(b - a, c - a));
        ++num_facets;
      }
    EXPECT_EQ(row.num_facets, num_facets);
    EXPECT_NEAR(row.facet_area, area, 1e-12);
  }
}

TEST_F(SheetTables, OfACylinderAreASideAndTwoPlanes) {
  const SheetTable table = table_of("cylinder.obj", to_grouped_obj(cylinder(64, 2)), 0.3);
  ASSERT_EQ(table.rows.size(), 3U);
  EXPECT_EQ(table.rows[0].shape.form, SheetForm::kCylinder);
  EXPECT_NEAR(table.rows[0].shape.radius, 1, 1e-6);
  EXPECT_NEAR(std::abs(table.rows[0].shape.direction.z), 1, 1e-9);
  EXPECT_EQ(table.rows[1].shape.form, SheetForm::kPlane);
  EXPECT_EQ(table.rows[2].shape.form, SheetForm::kPlane);
}

TEST_F(SheetTables, OfWhatIsOneSheetHasARow) {
  const auto file = dir_ / "sphere.off";
  testing_shapes::write_off(testing_shapes::sphere(1, 20, 40), file);
  std::string text;
  {
    std::ifstream in(file);
    text.assign(std::istreambuf_iterator<char>(in), {});
  }
  const SheetTable table = table_of("again.off", text, 0.3);
  ASSERT_EQ(table.rows.size(), 1U);
  EXPECT_EQ(table.rows[0].surface.name, "boundary");
  EXPECT_EQ(table.rows[0].shape.form, SheetForm::kSphere);
  EXPECT_NEAR(table.rows[0].shape.radius, 1, 1e-6);
  expect_near(table.rows[0].surface.centroid, {0, 0, 0}, 1e-9);
}

// Facets of a sheet with a size are as small as that, and grow from there.
TEST_F(SheetTables, SizesByNameAreThoseOnTheSheet) {
  const std::vector<std::string> names = {"below", "above", "side", "side", "side", "side"};
  const std::string box = to_grouped_obj(box_of_quads({0, 0, 0}, {1, 1, 1}), names);
  const SheetTable plain = table_of("plain.obj", box, 0.2);
  const SheetTable fine = table_of("fine.obj", box, 0.2, {{"above", {0.05, false}, {}}});
  ASSERT_EQ(fine.rows.size(), 6U);  // the group "side" is four sheets
  const auto facet_area = [](const SheetRow& row) {
    return row.facet_area / static_cast<double>(row.num_facets);
  };
  EXPECT_NEAR(facet_area(fine.rows[1]), facet_area(plain.rows[1]) / 16,
              0.25 * facet_area(plain.rows[1]) / 16);
  EXPECT_LT(facet_area(fine.rows[2]), 0.7 * facet_area(plain.rows[2]));
  EXPECT_NEAR(facet_area(fine.rows[0]), facet_area(plain.rows[0]),
              0.25 * facet_area(plain.rows[0]));
  // A group's name is that of all its sheets.
  const SheetTable sides = table_of("sides.obj", box, 0.2, {{"side", {0.05, false}, {}}});
  for (const std::size_t s : {2U, 3U, 4U, 5U})
    EXPECT_LT(facet_area(sides.rows[s]), 0.1 * facet_area(plain.rows[s]));
}

TEST_F(SheetTables, ANameThatNoSheetHasIsRefusedWithThoseThereAre) {
  const std::vector<std::string> names = {"below", "above", "side", "side", "side", "side"};
  const std::string box = to_grouped_obj(box_of_quads({0, 0, 0}, {1, 1, 1}), names);
  const auto refusal = [&](const std::string& surface, const SizedPart& sheet) -> std::string {
    try {
      table_of("box.obj", surface, 0.3, {sheet});
    } catch (const InputError& e) {
      return e.what();
    }
    return {};
  };
  EXPECT_EQ(refusal(box, {"abvoe", {0.1, false}, {}}),
            "a size is given for the sheet 'abvoe', and no sheet of the surface has that name: "
            "there are below, above, side, side_1, side_2, side_3, side_4; is 'above' meant?");
  const std::string of_other = refusal(to_grouped_obj(cylinder(40)), {"a", {0.1, false}, {}});
  EXPECT_NE(of_other.find("no sheet"), std::string::npos) << of_other;
  EXPECT_NE(refusal(box, {"above", {0, false}, {}}).find("sheet above: size 0"), std::string::npos);
  EXPECT_NE(refusal(box, {"above", {1e-12, false}, {}}).find("choose a size of at least"),
            std::string::npos);
}

}  // namespace
}  // namespace locvol
