// Bodies that share no vertex: the same cells at the same places, with vertices of their own.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/formats/mesh_format.h"
#include "engine/formats/writer.h"
#include "engine/inspect/sheet_table.h"
#include "engine/output/mesh_source.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "engine/shared/leaf_facets.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/ranks/written_by_ranks.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using testing_shapes::box;
using testing_shapes::Shape;
using Place = std::array<double, 3>;

struct WholeMesh {
  std::vector<Place> points;  // with the nodes
  std::vector<MeshPiece::Cell> cells;
  std::vector<MeshPiece::Nodes> nodes;
  std::vector<BodyId> bodies;
};
WholeMesh whole(MeshSource& mesh) {
  WholeMesh all;
  std::vector<Place> nodes;
  const auto next =
      mesh.pieces({.has_points = true, .has_cells = true, .has_node_points = mesh.order() == 2});
  while (const auto piece = next()) {
    all.points.insert(all.points.end(), piece->points.begin(), piece->points.end());
    nodes.insert(nodes.end(), piece->node_points.begin(), piece->node_points.end());
    all.cells.insert(all.cells.end(), piece->cells.begin(), piece->cells.end());
    all.nodes.insert(all.nodes.end(), piece->nodes.begin(), piece->nodes.end());
    all.bodies.insert(all.bodies.end(), piece->bodies.begin(), piece->bodies.end());
  }
  all.points.insert(all.points.end(), nodes.begin(), nodes.end());
  return all;
}

// Two cubes side by side, and half a cube upon both; a ball inside the first.
class SplitInterfaces : public testing::Test {
 protected:
  std::filesystem::path off(const std::string& name, const Shape& shape) {
    const std::filesystem::path file = dir_ / (name + ".off");
    std::ofstream out(file);
    out << "OFF\n" << shape.vertices.size() << ' ' << shape.triangles.size() << " 0\n";
    for (const Point& p : shape.vertices) out << p.x << ' ' << p.y << ' ' << p.z << '\n';
    for (const auto& [a, b, c] : shape.triangles) out << "3 " << a << ' ' << b << ' ' << c << '\n';
    return file;
  }
  MeshOptions options() {
    MeshOptions options;
    options.input = off("left", box({0, 0, 0}, {1, 1, 1}));
    Shape ball = testing_shapes::sphere(0.3, 6, 12);
    for (Point& p : ball.vertices) p = p + Point{0.5, 0.5, 0.5};
    options.more_inputs = {off("right", box({1, 0, 0}, {2, 1, 1})),
                           off("above", box({0.5, 0, 1}, {1.5, 1, 1.5})), off("ball", ball)};
    options.size = {0.15, false};
    options.leaf_capacity = 300;
    options.store = dir_ / "store";
    return options;
  }
  const TempDir dir_;
};

TEST_F(SplitInterfaces, GiveEachBodyVerticesOfItsOwn) {
  mesh(options());
  const Store store = Store::open(dir_ / "store", {.read_only = true});
  for (const int order : {1, 2}) {
    SCOPED_TRACE(order);
    MeshSource joined(store, dir_ / "mesh", 1, {}, nullptr, alone(), {.order = order});
    MeshSource split(store, dir_ / "mesh", 2, {}, nullptr, alone(),
                     {.order = order, .is_split = true});
    const WholeMesh one = whole(joined), all = whole(split);
    ASSERT_EQ(all.cells.size(), one.cells.size());
    ASSERT_EQ(all.points.size(), split.num_points());
    EXPECT_TRUE(all.bodies == one.bodies);
    EXPECT_EQ(std::set(all.bodies.begin(), all.bodies.end()).size(), 4U);

    // The same places, and as many points as bodies have of the joined mesh's.
    std::set<std::pair<std::int64_t, BodyId>> expected;
    std::map<std::int64_t, BodyId> body_of;
    const auto compare = [&](std::int64_t number, std::int64_t of_one, BodyId body) {
      EXPECT_EQ(all.points.at(static_cast<std::size_t>(number)),
                one.points.at(static_cast<std::size_t>(of_one)));
      EXPECT_EQ(body_of.try_emplace(number, body).first->second, body);
      expected.emplace(of_one, body);
    };
    for (std::size_t c = 0; c < all.cells.size(); ++c) {
      for (std::size_t k = 0; k < 4; ++k) compare(all.cells[c][k], one.cells[c][k], all.bodies[c]);
      for (std::size_t e = 0; order == 2 && e < 6; ++e)
        compare(all.nodes[c][e], one.nodes[c][e], all.bodies[c]);
    }
    EXPECT_EQ(expected.size(), all.points.size());
    EXPECT_EQ(body_of.size(), all.points.size());
    EXPECT_GT(all.points.size(), one.points.size() + 100);
  }
}

TEST_F(SplitInterfaces, HaveFacetsAndCreasesOfBothSides) {
  mesh(options());
  const Store store = Store::open(dir_ / "store", {.read_only = true});
  MeshSource joined(store, dir_ / "mesh", 1);
  MeshSource split(store, dir_ / "mesh", 1, {}, nullptr, alone(), {.is_split = true});
  const WholeMesh all = whole(split);
  std::map<std::array<std::int64_t, 3>, int> num_cells;
  for (const auto& cell : all.cells)
    for (const auto& [a, b, c] : kFacets) {
      std::array facet = {cell[a], cell[b], cell[c]};
      std::ranges::sort(facet);
      ++num_cells[facet];
    }
  std::uint64_t num_boundary = 0;
  for (const auto& [facet, num] : num_cells) num_boundary += num == 1;
  EXPECT_EQ(split.num_boundary_facets(), num_boundary);

  // Each sheet is of one body, whose vertices it has; an interface has as many facets on each side.
  std::map<SheetId, std::uint64_t> num_of_sheet, num_joined;
  std::map<std::int64_t, BodyId> body_of;
  for (std::size_t c = 0; c < all.cells.size(); ++c)
    for (const std::int64_t v : all.cells[c]) body_of[v] = all.bodies[c];
  const auto next = split.triangles();
  while (const auto piece = next())
    for (std::size_t t = 0; t < piece->triangles.size(); ++t) {
      const SheetId sheet = piece->sheets[t];
      ++num_of_sheet[sheet];
      std::array facet = piece->triangles[t];
      std::ranges::sort(facet);
      EXPECT_EQ(num_cells.at(facet), 1);
      for (const std::int64_t v : facet)
        EXPECT_EQ(body_of.at(v), split.sheets().sheets.at(sheet - 1).bodies[0]);
    }
  const auto next_joined = joined.triangles();
  while (const auto piece = next_joined())
    for (const SheetId sheet : piece->sheets) ++num_joined[sheet];
  const SurfaceSheets& sheets = joined.sheets();
  SheetId added = static_cast<SheetId>(sheets.sheets.size());
  for (SheetId s = 1; s <= sheets.sheets.size(); ++s) {
    EXPECT_EQ(num_of_sheet[s], num_joined[s]);
    const auto& [behind, before] = sheets.sheets[s - 1].bodies;
    if (before == kNoBody) {
      EXPECT_EQ(split.sheets().sheets[s - 1].name, sheets.sheets[s - 1].name);
      continue;
    }
    EXPECT_EQ(num_of_sheet[++added], num_joined[s]);
    EXPECT_EQ(split.sheets().sheets[s - 1].name,
              sheets.sheets[s - 1].name + " of " + sheets.bodies[behind - 1].name);
    EXPECT_EQ(split.sheets().sheets.at(added - 1).name,
              sheets.sheets[s - 1].name + " of " + sheets.bodies[before - 1].name);
  }
  EXPECT_EQ(split.sheets().sheets.size(), added);
  EXPECT_GT(added, sheets.sheets.size() + 3);

  // An edge between two cubes is in both.
  EXPECT_GT(split.num_crease_edges(), joined.num_crease_edges());
  std::set<LinePiece::Line> lines;
  const auto next_line = split.lines();
  while (const auto piece = next_line())
    for (const LinePiece::Line& line : piece->lines) {
      EXPECT_EQ(body_of.at(line[0]), body_of.at(line[1]));
      EXPECT_TRUE(lines.insert(line).second);
    }
  EXPECT_EQ(lines.size(), split.num_crease_edges());
}

TEST_F(SplitInterfaces, AreTwoRowsOfTheTableOfSheets) {
  mesh(options());
  const Store store = Store::open(dir_ / "store", {.read_only = true});
  const SurfaceSheets sheets = store.snapshot().sheets();
  const SheetTable joined = sheet_table(store, dir_ / "table");
  const SheetTable split = with_both_sides(joined, sheets);
  MeshSource mesh(store, dir_ / "mesh", 1, {}, nullptr, alone(), {.is_split = true});
  mesh.boundary().sort_facets();
  ASSERT_EQ(split.rows.size(), mesh.sheets().sheets.size());
  for (std::size_t s = 0; s < split.rows.size(); ++s) {
    const SheetRow& row = split.rows[s];
    EXPECT_EQ(row.surface.name, mesh.sheets().sheets[s].name);
    EXPECT_EQ(row.behind, mesh.sheets().sheets[s].bodies[0]);
    EXPECT_EQ(row.num_facets, mesh.num_boundary_facets_of(static_cast<SheetId>(s + 1)));
    if (s < joined.rows.size()) {
      EXPECT_EQ(row.shape.direction, joined.rows[s].shape.direction);
      continue;
    }
    const auto other = std::ranges::find_if(split.rows, [&](const SheetRow& first) {
      return first.behind == row.before && first.before == row.behind &&
             first.surface.first_triangle == row.surface.first_triangle;
    });
    ASSERT_NE(other, split.rows.end());
    if (row.shape.form == SheetForm::kPlane)
      EXPECT_EQ(row.shape.direction, -1 * other->shape.direction);
    else
      EXPECT_NE(row.shape.is_hollow, other->shape.is_hollow);
  }
}

TEST_F(SplitInterfaces, OfSeveralRanksHaveTheBytesOfOneProcess) {
  MeshOptions of_ranks = options();
  of_ranks.store = dir_ / "store-%r";
  const auto part = [&](const Exchange& exchange) {
    return Store::open(store_of_rank(of_ranks.store, exchange.rank()), {.read_only = true});
  };
  run_as_ranks(3, [&](Exchange& exchange) { mesh_as_rank(of_ranks, {}, exchange); });
  run_as_ranks(
      2, [&](Exchange& exchange) { join_ranks(of_ranks.store, dir_ / "whole", {}, exchange); });
  const Store whole = Store::open(dir_ / "whole", {.read_only = true});
  std::vector<OutputOptions> outputs;
  for (const FormatInfo& info : mesh_formats())
    for (const int order : {1, 2})
      if (order == 1 || info.has_second_order())
        outputs.push_back({.format = info.format,
                           .has_boundary = true,
                           .splits_interfaces = true,
                           .order = order});
  expect_files_of_one_process(whole, part, outputs, dir_.path());
}

// Pieces of ranks are meshes by themselves.
TEST_F(SplitInterfaces, AreInPiecesOfRanks) {
  MeshOptions of_ranks = options();
  of_ranks.store = dir_ / "store-%r";
  std::array<std::uint64_t, 3> num_facets{}, num_all{};
  run_as_ranks(3, [&](Exchange& exchange) {
    mesh_as_rank(of_ranks, {}, exchange);
    const Store store =
        Store::open(store_of_rank(of_ranks.store, exchange.rank()), {.read_only = true});
    MeshSource piece(store, dir_ / ("piece" + std::to_string(exchange.rank())), 1, {}, nullptr,
                     exchange, {.is_part = true, .order = 2, .is_split = true});
    const WholeMesh own = whole(piece);
    std::map<std::int64_t, BodyId> body_of;
    for (std::size_t c = 0; c < own.cells.size(); ++c) {
      for (const std::int64_t v : own.cells[c])
        EXPECT_EQ(body_of.try_emplace(v, own.bodies[c]).first->second, own.bodies[c]);
      for (std::size_t e = 0; e < 6; ++e) {
        const auto& [i, j] = kCellEdges[e];
        const auto at = [&](std::int64_t v) { return own.points.at(static_cast<std::size_t>(v)); };
        const Place a = at(own.cells[c][i]), b = at(own.cells[c][j]), m = at(own.nodes[c][e]);
        for (std::size_t axis = 0; axis < 3; ++axis)
          EXPECT_NEAR(m[axis], (a[axis] + b[axis]) / 2, 0.05);
      }
    }
    const auto rank = static_cast<std::size_t>(exchange.rank());
    num_facets[rank] = piece.num_boundary_facets();
    num_all[rank] = piece.boundary().num_facets();
  });
  EXPECT_EQ(num_facets[0] + num_facets[1] + num_facets[2], num_all[0]);
}

TEST_F(SplitInterfaces, OfOneBodyAreNone) {
  MeshOptions one = options();
  one.more_inputs.clear();
  mesh(one);
  const Store store = Store::open(dir_ / "store", {.read_only = true});
  write_mesh(store, dir_ / "joined.vtu", {.has_boundary = true});
  write_mesh(store, dir_ / "split.vtu", {.has_boundary = true, .splits_interfaces = true});
  EXPECT_TRUE(bytes_of(dir_ / "joined.vtu") == bytes_of(dir_ / "split.vtu"));
}

}  // namespace
}  // namespace locvol
