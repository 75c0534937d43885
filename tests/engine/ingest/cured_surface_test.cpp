// What repair and wrap make of surfaces that cannot be meshed.
#include "engine/ingest/cured_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "engine/shared/memory_budget.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMuch = std::uint64_t{4} << 30;

CuredSurface repair_of(const std::string& name, const std::string& content,
                       const std::optional<Size>& weld = std::nullopt, std::uint64_t cap = kMuch) {
  const SurfaceFiles files;
  IngestWatch watch;
  Workers workers(2);
  return repaired_surface(surface_in_file(files.write(name, content), files.directory()), weld,
                          files.directory(), cap, watch, workers);
}
CuredSurface wrap_of(const std::string& content, std::uint64_t cap = kMuch) {
  const SurfaceFiles files;
  IngestWatch watch;
  Workers workers(2);
  return wrapped_surface(surface_in_file(files.write("open.off", content), files.directory()),
                         Size::length(0.1), std::nullopt, files.directory(), cap, watch, workers);
}

std::string reason_of(const std::function<void()>& cure) {
  try {
    cure();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

// Of radius 1, with 2 n (n - 1) triangles.
Polygons sphere(std::uint32_t n) {
  Polygons shape;
  shape.vertices.push_back({0, 0, -1});
  for (std::uint32_t i = 1; i < n; ++i)
    for (std::uint32_t k = 0; k < n; ++k) {
      const double up = std::numbers::pi * i / n, around = 2 * std::numbers::pi * k / n;
      shape.vertices.push_back(
          {std::sin(up) * std::cos(around), std::sin(up) * std::sin(around), -std::cos(up)});
    }
  shape.vertices.push_back({0, 0, 1});
  const auto at = [n](std::uint32_t i, std::uint32_t k) { return 1 + (i - 1) * n + k % n; };
  for (std::uint32_t k = 0; k < n; ++k) {
    shape.faces.push_back({0, at(1, k + 1), at(1, k)});
    for (std::uint32_t i = 1; i + 1 < n; ++i) {
      shape.faces.push_back({at(i, k), at(i, k + 1), at(i + 1, k + 1)});
      shape.faces.push_back({at(i, k), at(i + 1, k + 1), at(i + 1, k)});
    }
    shape.faces.push_back({at(n - 1, k), at(n - 1, k + 1), 1 + (n - 1) * n});
  }
  return shape;
}

TEST(CuredSurface, AHoleIsFilledInTheGroupAround) {
  Polygons open = cube();
  open.faces.erase(open.faces.begin() + 3);
  const std::vector<std::string> groups = {"a", "a", "b", "c", "c", "c", "c", "c", "c", "c", "c"};
  const CuredSurface cured = repair_of("open.obj", to_grouped_obj(open, groups));
  EXPECT_DOUBLE_EQ(cured.facts.volume, 1);
  EXPECT_EQ(cured.changes.num_holes, 1u);
  EXPECT_EQ(cured.changes.num_filling, 1u);
  EXPECT_EQ(cured.changes.largest_hole, 3u);
  EXPECT_EQ(cured.groups, (std::vector<std::string>{"a", "b", "c"}));
  ASSERT_EQ(cured.surface.groups.size(), 12u);
  for (const SheetId group : cured.surface.groups) EXPECT_TRUE(1 <= group && group <= 3);
}

TEST(CuredSurface, ASoundSurfaceStaysAsItIs) {
  const CuredSurface cured = repair_of("cube.off", to_off(cube()));
  EXPECT_EQ(cured.surface.vertices.size(), 8u);
  const Polygons before = cube();
  for (std::size_t t = 0; t < 12; ++t)
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(cured.surface.vertices[cured.surface.triangles[t][k]],
                before.vertices[before.faces[t][k]]);
  EXPECT_EQ(cured.changes.num_holes + cured.changes.num_doubled + cured.changes.num_turned +
                cured.changes.num_joined,
            0u);
}

TEST(CuredSurface, DamageAtRandomIsCured) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  const Polygons sound = sphere(24);
  for (int round = 0; round < 6; ++round) {
    Polygons damaged{sound.vertices, {}};
    std::uint64_t num_lost = 0, num_doubled = 0;
    for (auto face : sound.faces) {
      const auto fate = random() % 100;
      if (fate < 3) {
        ++num_lost;
        continue;
      }
      if (fate < 30) std::swap(face[0], face[1]);
      damaged.faces.push_back(face);
      if (fate >= 95) {
        ++num_doubled;
        damaged.faces.push_back({face[1], face[2], face[0]});
      }
    }
    const CuredSurface cured = repair_of("damaged.off", to_off(damaged));
    EXPECT_EQ(cured.changes.num_doubled, num_doubled);
    EXPECT_EQ(cured.changes.num_joined, 0u);
    EXPECT_EQ(cured.facts.num_components, 1u);
    EXPECT_EQ(cured.facts.euler_characteristic, 2);
    // What is filled lies inside the ball, and not far.
    EXPECT_GT(cured.facts.volume, 3.9);
    EXPECT_LT(cured.facts.volume, 4 * std::numbers::pi / 3);
  }
}

TEST(CuredSurface, PointsAtOpenEdgesAreJoinedNoFartherThanItSays) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-1e-5, 1e-5);
  const Polygons sound = sphere(12);
  Polygons torn;  // each triangle has corners of its own
  for (const auto& face : sound.faces) {
    std::vector<std::uint32_t> corners;
    for (const std::uint32_t v : face) {
      const Point& p = sound.vertices[v];
      corners.push_back(static_cast<std::uint32_t>(torn.vertices.size()));
      torn.vertices.push_back({p.x + noise(random), p.y + noise(random), p.z + noise(random)});
    }
    torn.faces.push_back(corners);
  }
  const CuredSurface cured = repair_of("torn.off", to_off(torn));
  EXPECT_EQ(cured.facts.num_vertices, sound.vertices.size());
  EXPECT_EQ(cured.changes.num_joined, torn.vertices.size() - sound.vertices.size());
  EXPECT_GT(cured.changes.largest_move, 0);
  EXPECT_LE(cured.changes.largest_move, 2e-5 * std::sqrt(3));
  EXPECT_NE(reason_of([&] { repair_of("torn.off", to_off(torn), Size::length(0)); }), "");
}

TEST(CuredSurface, LooseTrianglesAndFinsGo) {
  Polygons shape = sphere(40);
  const auto num = static_cast<std::uint32_t>(shape.vertices.size());
  // A fin on an edge, and a triangle by itself.
  const auto edge = shape.faces[100];
  const Point outside = 1.02 * shape.vertices[edge[0]];
  shape.vertices.push_back(outside);
  shape.faces.push_back({edge[0], edge[1], num});
  for (const Point& p : {Point{2, 0, 0}, Point{2.05, 0, 0}, Point{2, 0.05, 0}})
    shape.vertices.push_back(p);
  shape.faces.push_back({num + 1, num + 2, num + 3});
  const CuredSurface cured = repair_of("loose.off", to_off(shape));
  EXPECT_EQ(cured.changes.num_fins, 1u);
  EXPECT_EQ(cured.changes.num_loose, 1u);
  EXPECT_LT(cured.changes.dropped_area, 0.001);
  EXPECT_EQ(cured.facts.num_triangles, sphere(40).faces.size());
}

TEST(CuredSurface, WhatRepairCannotCureIsToldWithWhatCan) {
  Polygons two = cube();
  two.append(box_of_triangles({1, 1, 0}, {2, 2, 1}));
  const std::string at_an_edge = reason_of([&] { repair_of("two.off", to_off(two)); });
  EXPECT_NE(at_an_edge.find("two.off: repaired, it would still be wrong: is not manifold"),
            std::string::npos)
      << at_an_edge;
  EXPECT_NE(at_an_edge.find("locvol wrap "), std::string::npos);
  Polygons crossing = cube();
  crossing.append(box_of_triangles({0.5, 0.4, 0.3}, {2, 2, 2}));
  const std::string crossed = reason_of([&] { repair_of("crossed.off", to_off(crossing)); });
  EXPECT_NE(crossed.find("crossed.off: repaired, it would still be wrong: intersects itself"),
            std::string::npos)
      << crossed;
}

TEST(CuredSurface, AnOpenSurfaceIsWrapped) {
  Polygons open = cube();
  open.faces.resize(10);
  const CuredSurface cured = wrap_of(to_off(open));
  EXPECT_DOUBLE_EQ(cured.alpha, 0.1);
  EXPECT_DOUBLE_EQ(cured.offset, 0.1 / 30);
  const double room = cured.offset * (1 + 1e-9);
  const Box around{{-room, -room, -room}, {1 + room, 1 + room, 1 + room}};
  for (const Point& p : cured.surface.vertices) EXPECT_TRUE(around.contains(p));
  EXPECT_GT(cured.facts.volume, 0);
}

TEST(CuredSurface, TooLittleMemoryIsToldBefore) {
  constexpr std::uint64_t kLittle = std::uint64_t{48} << 20;
  for (const std::string& reason :
       {reason_of([] { repair_of("cube.off", to_off(cube()), std::nullopt, kLittle); }),
        reason_of([] { wrap_of(to_off(cube()), kLittle); })}) {
    EXPECT_NE(reason.find("MiB of memory, but the cap is 48 MiB"), std::string::npos) << reason;
    EXPECT_NE(reason.find("--memory"), std::string::npos);
  }
}

TEST(CuredSurface, ItsFilesHoldTheSameTrianglesAndGroups) {
  const SurfaceFiles files;
  std::vector<std::string> groups(12, "rest");
  groups[0] = groups[1] = "in let";
  Polygons shape = cube();
  for (Point& p : shape.vertices) p = {p.x / 3, p.y / 7, p.z + 0.1};
  const CuredSurface cured = repair_of("named.obj", to_grouped_obj(shape, groups));
  for (const char* const name : {"a.obj", "a.stl", "a.ply"}) {
    SCOPED_TRACE(name);
    const auto file = files.directory() / name;
    write_surface(cured, file);
    IngestWatch watch;
    const RawSurface raw = read_surface(file, files.directory(), watch);
    EXPECT_EQ(raw.groups, std::string_view(name) == "a.ply"
                              ? (std::vector<std::string>{"group 1", "group 2"})
                              : (std::vector<std::string>{"in let", "rest"}));
    std::size_t t = 0;
    for (const TriangleList& list : raw.triangles)
      raw.spill.for_each(list, [&](const Triangle& triangle) {
        EXPECT_EQ(triangle.sheet, cured.surface.groups[t]);
        for (std::size_t k = 0; k < 3; ++k)
          EXPECT_EQ(triangle.corners[k], cured.surface.vertices[cured.surface.triangles[t][k]]);
        ++t;
      });
    EXPECT_EQ(t, 12u);
  }
}

}  // namespace
}  // namespace locvol
