// Sheets of surfaces, against a flood fill in memory, and those of shapes that people know.
#include "engine/ingest/surface_sheets.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <map>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "engine/ingest/sheet_plan.h"
#include "tests/engine/ingest/random_surfaces.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {
namespace {

struct Sheeted {
  std::vector<SheetFacts> sheets;
  std::vector<SheetId> of_triangles;  // in order of id
  std::vector<Triangle> triangles;
  std::vector<std::string> notes;
};

struct SheetTrial {
  double sharp_angle = 40, least_area = 0;
  std::uint64_t bucket_capacity = kBucketCapacity;
  int num_threads = 1;
};

Sheeted sheets_in(const std::filesystem::path& file, const SheetTrial& trial = {}) {
  IngestWatch watch;
  Workers workers(trial.num_threads);
  RawSurface raw = read_surface(file, std::filesystem::temp_directory_path(), watch);
  const Frame frame = frame_of(raw.box);
  CheckedSurface surface =
      check_surface(std::move(raw), frame, watch, workers, trial.bucket_capacity, IngestShare(),
                    std::nullopt, trial.sharp_angle);
  Sheeted found;
  found.sheets =
      number_sheets(surface, {trial.sharp_angle, trial.least_area}, watch, workers, IngestShare())
          .sheets;
  std::map<std::uint64_t, Triangle> triangles;
  for (const TriangleBucket& bucket : surface.buckets.all())
    for (const Triangle& t : surface.load(bucket)) {
      const auto [known, is_new] = triangles.emplace(t.id, t);
      EXPECT_EQ(known->second, t) << "cells differ";
    }
  for (const auto& [id, triangle] : triangles) {
    found.of_triangles.push_back(triangle.sheet);
    found.triangles.push_back(triangle);
  }
  found.notes = surface.facts.notes;
  return found;
}

std::vector<std::string> names_of(const Sheeted& found) {
  std::vector<std::string> names;
  for (const SheetFacts& sheet : found.sheets) names.push_back(sheet.name);
  return names;
}

// The flood fill: from triangle to triangle by pairs of corners, with angles from arccos.
std::vector<SheetId> flooded(const std::vector<Triangle>& triangles,
                             const std::vector<std::string>& groups, double degrees) {
  std::map<std::pair<Point, Point>, std::vector<std::size_t>> beside;
  std::vector<Point> normals;
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const auto& [a, b, c] = triangles[t].corners;
    const Point normal = cross(b - a, c - a);
    normals.push_back((1 / norm(normal)) * normal);
    for (const auto& [p, q] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)})
      beside[std::minmax(p, q)].push_back(t);
  }
  // Which way around an edge a triangle goes: from its smaller to its larger end, or back.
  const auto goes_up = [&](std::size_t t, const Point& p, const Point& q) {
    const auto& corners = triangles[t].corners;
    for (std::size_t i = 0; i < 3; ++i)
      if (corners[i] == p && corners[(i + 1) % 3] == q) return true;
    return false;
  };
  std::vector<SheetId> sheets(triangles.size());
  SheetId num_sheets = 0;
  for (std::size_t first = 0; first < triangles.size(); ++first) {
    if (sheets[first] != 0) continue;
    sheets[first] = ++num_sheets;
    std::deque<std::size_t> waiting = {first};
    for (; !waiting.empty(); waiting.pop_front()) {
      const std::size_t t = waiting.front();
      const auto& [a, b, c] = triangles[t].corners;
      for (const auto& [p, q] : {std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)})
        for (const std::size_t other : beside[{p, q}]) {
          if (sheets[other] != 0 || groups[other] != groups[t]) continue;
          const double sign = goes_up(t, p, q) == goes_up(other, p, q) ? -1 : 1;
          const double cosine = std::clamp(sign * dot(normals[t], normals[other]), -1.0, 1.0);
          if (std::acos(cosine) * 180 / std::numbers::pi > degrees) continue;
          sheets[other] = num_sheets;
          waiting.push_back(other);
        }
    }
  }
  return sheets;
}

// A box whose side is a group each, or has no name.
std::string named_box(const std::vector<std::string>& names, const Point& max = {1, 1, 1}) {
  return to_grouped_obj(box_of_quads({0, 0, 0}, max), names);
}

TEST(SurfaceSheets, ABoxHasSix) {
  const SurfaceFiles files;
  const Sheeted found = sheets_in(files.write("box.obj", named_box({}, {3, 2, 1})));
  EXPECT_EQ(names_of(found), (std::vector<std::string>{"sheet 1", "sheet 2", "sheet 3", "sheet 4",
                                                       "sheet 5", "sheet 6"}));
  EXPECT_EQ(found.of_triangles, (std::vector<SheetId>{1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6}));
  const SheetFacts& last = found.sheets.back();
  EXPECT_EQ(last.group, "");
  EXPECT_EQ(last.first_triangle, 10U);
  EXPECT_EQ(last.num_triangles, 2U);
  EXPECT_DOUBLE_EQ(last.area, 2);
  EXPECT_DOUBLE_EQ(last.centroid.x, 3);
  EXPECT_DOUBLE_EQ(last.centroid.y, 1);
  EXPECT_DOUBLE_EQ(last.centroid.z, 0.5);
  EXPECT_EQ(last.box, (Box{{3, 0, 0}, {3, 2, 1}}));
}

TEST(SurfaceSheets, NamesStayAndAreCutWhereItIsSharp) {
  const SurfaceFiles files;
  // The lower and upper side, and two that meet in an edge; the others have no name.
  const auto file =
      files.write("named.obj", named_box({"inlet", "wall_1", "wall", "", "", "wall"}));
  EXPECT_EQ(names_of(sheets_in(file)), (std::vector<std::string>{"inlet", "wall_1", "wall_1_",
                                                                 "sheet 4", "sheet 5", "wall_2"}));
  const Sheeted by_names = sheets_in(file, {.sharp_angle = 0});
  EXPECT_EQ(names_of(by_names), (std::vector<std::string>{"inlet", "wall_1", "wall", "sheet 4"}));
  EXPECT_EQ(by_names.of_triangles, (std::vector<SheetId>{1, 1, 2, 2, 3, 3, 4, 4, 4, 4, 3, 3}));
  EXPECT_EQ(by_names.sheets[2].num_triangles, 4U);
}

TEST(SurfaceSheets, WhatIsSmoothAndHasNoNameIsOne) {
  const SurfaceFiles files;
  const auto ball = files.write("ball.off", to_off(to_polygons(testing_shapes::sphere(1, 20, 30))));
  const Sheeted found = sheets_in(ball, {.bucket_capacity = 50});
  EXPECT_TRUE(found.sheets.empty());
  EXPECT_EQ(found.of_triangles, std::vector<SheetId>(found.triangles.size(), 1));
  const Sheeted box = sheets_in(files.write("box.obj", named_box({})), {.sharp_angle = 0});
  EXPECT_TRUE(box.sheets.empty());
  const Sheeted wide = sheets_in(files.write("box.obj", named_box({})), {.sharp_angle = 100});
  EXPECT_TRUE(wide.sheets.empty());
  EXPECT_EQ(wide.of_triangles, std::vector<SheetId>(12, 1));
}

TEST(SurfaceSheets, ACylinderHasASideAndTwoEnds) {
  const SurfaceFiles files;
  const Sheeted round = sheets_in(files.write("round.off", to_off(cylinder(40))));
  ASSERT_EQ(round.sheets.size(), 3U);
  EXPECT_EQ(round.sheets[0].num_triangles, 80U);
  // Eight sides turn by 45 degrees each.
  EXPECT_EQ(sheets_in(files.write("eight.off", to_off(cylinder(8)))).sheets.size(), 10U);
  EXPECT_EQ(
      sheets_in(files.write("eight.off", to_off(cylinder(8))), {.sharp_angle = 46}).sheets.size(),
      3U);
}

TEST(SurfaceSheets, AreTheSameForAnyCellsAndThreadsAndThoseOfAFloodFill) {
  const SurfaceFiles files;
  Random random(7);
  for (int trial = 0; trial < 12; ++trial) {
    Polygons shape = trial % 3 == 0   ? manifold_voxels(random, files)
                     : trial % 3 == 1 ? random_balls(random)
                                      : cylinder(20 + below(random, 30));
    shuffle(shape, random);
    // Groups in slabs.
    std::string text;
    for (const Point& p : shape.vertices) text += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
    std::vector<std::string> groups;
    for (const auto& face : shape.faces) {
      const Point& p = shape.vertices[face[0]];
      groups.push_back(trial < 6 ? "" : fmt::format("slab {}", std::floor(p.x + 0.3 * p.y)));
      text += fmt::format("g {}\nf", groups.back());
      for (const std::uint32_t v : face) text += fmt::format(" {}", v + 1);
      text += "\n";
    }
    const auto file = files.write("shape.obj", text);
    const double angle = uniform(random, 5, 60);
    const Sheeted found = sheets_in(file, {.sharp_angle = angle});
    ASSERT_EQ(found.triangles.size(), shape.faces.size());
    EXPECT_EQ(found.of_triangles, flooded(found.triangles, groups, angle)) << trial;
    for (const std::uint64_t capacity : {12, 100, 1000}) {
      const SheetTrial cut{.sharp_angle = angle,
                           .bucket_capacity = capacity,
                           .num_threads = capacity == 100 ? 3 : 1};
      const Sheeted other = sheets_in(file, cut);
      EXPECT_EQ(other.sheets, found.sheets) << capacity;
      EXPECT_EQ(other.of_triangles, found.of_triangles) << capacity;
    }
    const double least_area = trial % 3 == 1 ? 0.05 : 1.5;
    const Sheeted few = sheets_in(file, {.sharp_angle = angle, .least_area = least_area});
    const Sheeted in_cells =
        sheets_in(file, {.sharp_angle = angle, .least_area = least_area, .bucket_capacity = 40});
    EXPECT_EQ(in_cells.sheets, few.sheets);
    EXPECT_EQ(in_cells.of_triangles, few.of_triangles);
  }
}

// Points as floats leave needles with any normal: they are of the sheet across their longest edge.
TEST(SurfaceSheets, NeedlesAreOfTheFaceTheyLieIn) {
  const SurfaceFiles files;
  // A box whose upper side is cut by two needles, whose middle points are off the line a little.
  Polygons box = box_of_triangles({0, 0, 0}, {1, 1, 1});
  std::erase_if(box.faces, [&](const auto& face) {
    return std::ranges::all_of(face, [&](std::uint32_t v) { return box.vertices[v].z == 1; });
  });
  const auto m = static_cast<std::uint32_t>(box.vertices.size());
  box.vertices.push_back({0.5, 0.5 + 2e-7, 1 + 1e-6});
  box.vertices.push_back({0.25, 0.25 - 1e-7, 1 - 1e-6});
  // 4: (0, 0), 5: (1, 0), 6: (0, 1), 7: (1, 1)
  box.faces.push_back({4, 5, m + 1});
  box.faces.push_back({m + 1, 5, 7});
  box.faces.push_back({m + 1, 7, m});
  box.faces.push_back({4, m + 1, m});
  box.faces.push_back({4, m, 6});
  box.faces.push_back({m, 7, 6});
  const Sheeted found = sheets_in(files.write("needles.off", to_off(box)));
  EXPECT_EQ(found.sheets.size(), 6U);
  const Sheeted in_cells =
      sheets_in(files.write("needles.off", to_off(box)), {.bucket_capacity = 4});
  EXPECT_EQ(in_cells.of_triangles, found.of_triangles);
}

// ---- What is too small ----

SheetPart part(std::uint64_t first, double area, SheetId group = 1) {
  SheetPart part;
  part.first_triangle = first;
  part.group = group;
  part.area.add(area);
  return part;
}
SheetBorder border(std::uint32_t a, std::uint32_t b, double length) {
  SheetBorder border{a, b, false, {}};
  border.length.add(length);
  return border;
}

TEST(SheetPlan, SpecksBecomeOneWithTheLongestBorder) {
  const std::vector<std::string> groups = {"", "wall"};
  const std::vector<SheetPart> parts = {part(9, 5), part(3, 0.1), part(4, 0.2), part(0, 7),
                                        part(1, 0.01, 2)};
  const std::vector<SheetBorder> borders = {border(0, 1, 1),   border(1, 2, 0.3), border(1, 3, 0.6),
                                            border(1, 3, 0.6), border(0, 2, 0.5), border(2, 3, 0.4),
                                            border(3, 3, 9)};
  const SheetPlan plan = plan_sheets(parts, borders, groups, {.least_area = 0.5});
  // The first speck goes to part 3, which then has 0.7 of a border with the other one.
  EXPECT_EQ(plan.of_part, (std::vector<SheetId>{3, 1, 1, 1, 2}));
  EXPECT_EQ(plan.num_specks, 2U);
  EXPECT_EQ(plan.sheets[1].name, "wall");
  EXPECT_EQ(plan_sheets(parts, borders, groups, {}).sheets.size(), 5U);
  EXPECT_TRUE(plan.pieces.empty());
}

SheetBorder rib(std::uint32_t a, std::uint32_t b) {
  SheetBorder rib{a, b, true, {}};
  rib.length.add(0.01);
  return rib;
}

// A wide part, and pieces of it that ribs part, beside another part.
TEST(SheetPlan, WhatRibsPartIsOneButStripsAndTheRest) {
  constexpr std::uint32_t kWide = 0, kBeside = 1, kEnd = 2, kTip = 3;
  std::vector<SheetPart> parts = {part(0, 5), part(1, 5), part(2, 0.02), part(3, 0.01)};
  const std::vector<SheetBorder> borders = {rib(kWide, kEnd), rib(kEnd, kTip),
                                            border(kWide, kBeside, 9), border(kEnd, kBeside, 1),
                                            border(kTip, kBeside, 1)};
  const std::vector<std::string> groups = {"side"};
  const SheetLaw law{.least_width = 0.06};
  // Together both narrow ones turn as much one way as the other, and one has a point: they are a
  // strip.
  parts[kTip].num_points = 1;
  parts[kEnd].turn.add(1);
  parts[kTip].turn.add(-1);
  SheetPlan plan = plan_sheets(parts, borders, groups, law);
  EXPECT_EQ(plan.of_part, (std::vector<SheetId>{1, 2, 2, 2}));
  EXPECT_EQ(plan.num_specks, 1U);
  ASSERT_EQ(plan.pieces.size(), 4U);
  EXPECT_EQ(plan.pieces[kEnd].part, plan.pieces[kTip].part);
  EXPECT_TRUE(plan.pieces[kEnd].is_beside_strip(plan.pieces[kBeside]));
  EXPECT_FALSE(plan.pieces[kEnd].is_beside_strip(plan.pieces[kWide]));
  // What turns one way is no strip, however narrow, and what is not narrow is none.
  parts[kTip].turn.add(2);
  plan = plan_sheets(parts, borders, groups, law);
  EXPECT_EQ(plan.of_part, (std::vector<SheetId>{1, 2, 1, 1}));
  EXPECT_TRUE(plan.pieces.empty());
  parts[kTip].turn.add(-2);
  EXPECT_EQ(plan_sheets(parts, borders, groups, {.least_width = 0.01}).of_part, plan.of_part);
  EXPECT_EQ(plan_sheets(parts, borders, groups, {}).of_part, plan.of_part);
}

TEST(SheetPlan, SaysWhenThereAreTooMany) {
  std::vector<SheetPart> parts;
  for (std::uint64_t i = 0; i <= kMaxSheets; ++i) parts.push_back(part(i, 1));
  const SheetPlan plan = plan_sheets(parts, {}, std::vector<std::string>{""}, {});
  EXPECT_EQ(plan.num_too_many, kMaxSheets + 1);
  EXPECT_TRUE(plan.sheets.empty());
  const std::vector<std::string> groups = {""};
  EXPECT_EQ(plan_sheets(parts, {}, groups, {}, {}, parts.size()).sheets.size(), kMaxSheets + 1);
}

TEST(SurfaceSheets, TooManyAreNone) {
  const SurfaceFiles files;
  Polygons boxes;
  for (std::uint32_t i = 0; i < 1700; ++i)
    boxes.append(box_of_triangles({2.0 * (i % 50), 2.0 * (i / 50), 0},
                                  {2.0 * (i % 50) + 1, 2.0 * (i / 50) + 1, 1}));
  const Sheeted found = sheets_in(files.write("boxes.off", to_off(boxes)));
  EXPECT_TRUE(found.sheets.empty());
  EXPECT_EQ(found.of_triangles, std::vector<SheetId>(found.triangles.size(), 1));
  ASSERT_EQ(found.notes.size(), 1U);
  EXPECT_EQ(found.notes.front(),
            "took no sheets from sharp edges, for there would be more than 10000");
}

}  // namespace
}  // namespace locvol
