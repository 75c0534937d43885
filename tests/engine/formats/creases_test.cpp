// Creases and corners of a mesh, and what files tell of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "engine/engine.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/output_estimate.h"
#include "engine/formats/sheet_names.h"
#include "engine/formats/writer.h"
#include "engine/inspect/crease_table.h"
#include "engine/output/mesh_source.h"
#include "engine/output/vertex_positions.h"
#include "tests/cube_off.h"
#include "tests/engine/closed_shapes.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using VertexPair = std::array<std::uint64_t, 2>;

// The edge of the unit cube that two points lie on: an axis, and where it is on the others.
std::optional<int> edge_of_cube(const Point& p, const Point& q) {
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const auto is_end = [](double a, double b) { return a == b && (a == 0 || a == 1); };
    if (is_end(p[u], q[u]) && is_end(p[v], q[v]))
      return 4 * axis + 2 * static_cast<int>(p[u]) + static_cast<int>(p[v]);
  }
  return std::nullopt;
}

Point place_of(MeshSource& mesh, std::uint64_t vertex) {
  const auto next = mesh.pieces({.has_points = true});
  while (const auto piece = next())
    if (vertex < piece->first_vertex + piece->points.size()) {
      const auto& [x, y, z] = piece->points[vertex - piece->first_vertex];
      return {x, y, z};
    }
  ADD_FAILURE() << "no vertex " << vertex;
  return {};
}

// With small leaves, so that edges of the mesh lead from leaf to leaf.
class CreasesOfACube : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    dir_.emplace();
    MeshOptions options;
    options.input = *dir_ / "cube.off";
    options.store = *dir_ / "store";
    options.size = {0.12, false};
    options.leaf_capacity = 50;
    std::ofstream(options.input) << kCube;
    mesh(options);
    store_.emplace(Store::open(options.store, {.read_only = true}));
  }
  static void TearDownTestSuite() {
    store_.reset();
    dir_.reset();
  }

  inline static std::optional<TempDir> dir_;
  inline static std::optional<Store> store_;
};

TEST_F(CreasesOfACube, AreTheEdgesOfFacetsThatLieOnThem) {
  MeshSource mesh(*store_, *dir_ / "mesh", 1);
  std::map<VertexPair, std::pair<int, std::uint64_t>>
      expected;  // which of the cube's, and the first cell
  std::map<std::uint64_t, Point> places;
  const auto facets = mesh.boundary().facets({.has_corners = true});
  while (const auto some = facets())
    for (std::size_t f = 0; f < some->facets.size(); ++f)
      for (std::size_t i = 0; i < 3; ++i) {
        const auto& [vertices, cell, across, labels] = some->facets[f];
        const std::size_t j = (i + 1) % 3;
        places[vertices[i]] = some->corners[f][i];
        if (const auto edge = edge_of_cube(some->corners[f][i], some->corners[f][j]))
          expected.try_emplace(
              {std::min(vertices[i], vertices[j]), std::max(vertices[i], vertices[j])}, *edge,
              cell);
      }
  KeptCreases& creases = mesh.creases();
  EXPECT_GT(expected.size(), 100U);
  EXPECT_EQ(creases.num_edges(), expected.size());
  std::map<std::uint64_t, std::set<int>> edges_of_crease;
  std::vector<double> lengths(13);
  std::uint64_t last_cell = 0;
  const auto next = creases.edges();
  while (const auto some = next())
    for (const KeptEdge& edge : some->edges) {
      const auto found = expected.find(edge.vertices);
      ASSERT_NE(found, expected.end());
      EXPECT_EQ(found->second.second, edge.cell);
      EXPECT_LE(last_cell, edge.cell);
      last_cell = edge.cell;
      edges_of_crease[edge.crease].insert(found->second.first);
      lengths.at(edge.crease) += norm(places.at(edge.vertices[1]) - places.at(edge.vertices[0]));
    }
  ASSERT_EQ(edges_of_crease.size(), 12U);
  for (const auto& [crease, edges] : edges_of_crease) {
    EXPECT_EQ(edges.size(), 1U);
    EXPECT_NEAR(lengths[crease], 1, 1e-12);
    EXPECT_NEAR(creases.kept()[crease - 1].length, 1, 1e-12);
    const Box& box = creases.kept()[crease - 1].box;
    EXPECT_EQ(norm(box.max - box.min), 1);
  }
  ASSERT_EQ(creases.corners().size(), 8U);
  for (const KeptCorner& corner : creases.corners()) {
    EXPECT_EQ(places.at(corner.vertex), corner.position);
    for (const int axis : {0, 1, 2})
      EXPECT_TRUE(corner.position[axis] == 0 || corner.position[axis] == 1);
  }
}

TEST_F(CreasesOfACube, ComeCreaseByCrease) {
  MeshSource mesh(*store_, *dir_ / "mesh", 1);
  KeptCreases& creases = mesh.creases();
  std::map<std::uint64_t, std::set<std::uint64_t>> vertices_of;
  std::map<std::uint64_t, std::vector<VertexPair>> edges_of;
  const auto next = creases.edges();
  while (const auto some = next())
    for (const KeptEdge& edge : some->edges) {
      vertices_of[edge.crease].insert(edge.vertices.begin(), edge.vertices.end());
      edges_of[edge.crease].push_back(edge.vertices);
    }
  creases.sort();
  std::uint64_t place = 0;
  for (CreaseId crease = 1; crease <= 12; ++crease) {
    EXPECT_EQ(creases.first_own_edge_of(crease), place);
    std::vector<VertexPair> edges;
    const auto next_edges = creases.edges_of(crease);
    while (const auto some = next_edges()) {
      EXPECT_EQ(some->first, place);
      for (const KeptEdge& edge : some->edges) edges.push_back(edge.vertices);
      place += some->edges.size();
    }
    EXPECT_EQ(edges, edges_of[crease]);
    std::vector<std::uint64_t> vertices;
    const auto next_vertices = creases.vertices_of(crease);
    while (const auto some = next_vertices())
      vertices.insert(vertices.end(), some->vertices.begin(), some->vertices.end());
    EXPECT_EQ(creases.num_vertices_of(crease), vertices.size());
    EXPECT_TRUE(std::ranges::equal(vertices, vertices_of[crease]));
    EXPECT_EQ(vertices.size(), edges.size() + 1);
  }
}

TEST_F(CreasesOfACube, AreCellsOfVtuWithTheBoundary) {
  const OutputOptions options{
      .format = MeshFormat::kVtu, .has_quality = true, .has_boundary = true};
  const WriteSummary written = write_mesh(*store_, *dir_ / "cube.vtu", options, 2);
  EXPECT_EQ(written.bytes, bytes_of(*dir_ / "cube.vtu").size());
  const VtuArrays vtu(*dir_ / "cube.vtu");
  MeshSource mesh(*store_, *dir_ / "mesh", 1);
  const std::size_t num_cells = mesh.num_cells(), num_facets = mesh.boundary().num_facets(),
                    num_edges = mesh.num_crease_edges();
  ASSERT_EQ(vtu.num_cells(), num_cells + num_facets + num_edges + 8);
  std::vector<std::uint8_t> types(num_cells, kVtkTetra);
  types.insert(types.end(), num_facets, kVtkTriangle);
  types.insert(types.end(), num_edges, kVtkLine);
  types.insert(types.end(), 8, kVtkVertex);
  EXPECT_EQ(vtu.array<std::uint8_t>("UInt8", "types"), types);
  const auto points = vtu.array<Point>("Float64", "Points");
  const auto connectivity = vtu.array<std::int32_t>("Int32", "connectivity");
  const auto creases = vtu.array<std::uint32_t>("UInt32", "crease");
  const auto corners = vtu.array<std::uint32_t>("UInt32", "corner");
  ASSERT_EQ(connectivity.size(), 4 * num_cells + 3 * num_facets + 2 * num_edges + 8);
  ASSERT_EQ(corners.size(), points.size());
  EXPECT_EQ(points.size() - static_cast<std::size_t>(std::ranges::count(corners, 0U)), 8U);
  std::map<std::uint32_t, std::set<int>> edges_of_crease;
  for (std::size_t i = 0; i < vtu.num_cells(); ++i) {
    const bool is_line = types[i] == kVtkLine;
    EXPECT_EQ(creases[i] > 0, is_line);
    if (!is_line) continue;
    const std::size_t first = 4 * num_cells + 3 * num_facets + 2 * (i - num_cells - num_facets);
    const auto edge = edge_of_cube(points[static_cast<std::size_t>(connectivity[first])],
                                   points[static_cast<std::size_t>(connectivity[first + 1])]);
    edges_of_crease[creases[i]].insert(edge.value());
  }
  EXPECT_EQ(edges_of_crease.size(), 12U);
  for (std::size_t i = 1; i <= 8; ++i)
    EXPECT_EQ(corners[static_cast<std::size_t>(connectivity[connectivity.size() - 9 + i])], i);
}

// Nor do they take anything there.
TEST_F(CreasesOfACube, AreNotToldWithoutTheBoundary) {
  write_mesh(*store_, *dir_ / "cells.vtu", {.format = MeshFormat::kVtu}, 1);
  const VtuArrays vtu(*dir_ / "cells.vtu");
  EXPECT_THROW(vtu.array<std::uint32_t>("UInt32", "crease"), std::runtime_error);
}

// Without the cells, which are not looked through.
TEST_F(CreasesOfACube, AreAllKept) {
  const CreaseTable table = crease_table(*store_);
  ASSERT_EQ(table.kept.size(), 12U);
  MeshSource mesh(*store_, *dir_ / "mesh", 1);
  for (std::size_t c = 0; c < 12; ++c) {
    EXPECT_NEAR(table.kept[c].length, 1, 1e-12);
    EXPECT_EQ(table.kept[c].num_edges, mesh.creases().kept()[c].num_edges);
  }
  EXPECT_EQ(table.num_corners, 8U);
  EXPECT_NEAR(table.length, 12, 1e-12);
  EXPECT_EQ(table.kept_length(), table.length);
  EXPECT_TRUE(table.not_whole.empty());
}

// Two facets are gone from the records, and with them an edge.
TEST_F(CreasesOfACube, AreNotWholeWhereTheMeshHasNoEdge) {
  const TempDir dir;
  std::filesystem::copy(store_->directory(), dir / "store");
  {
    Store store = Store::open(dir / "store");
    MeshSource mesh(*store_, *dir_ / "mesh", 1);
    const KeptEdge lost = mesh.creases().edges()()->edges.at(20);
    const Point a = place_of(mesh, lost.vertices[0]), b = place_of(mesh, lost.vertices[1]);
    const Snapshot snapshot = store.snapshot();
    std::map<std::uint64_t, Point> places;
    for (const MortonKey leaf : snapshot.leaf_keys())
      for (const MeshPoint& p : snapshot.points(leaf).points) places[p.id] = p.position;
    Batch batch = store.begin();
    int num_lost = 0;
    for (const MortonKey leaf : snapshot.leaf_keys()) {
      LeafFacets facets = snapshot.facets(leaf);
      const auto has = [&](const MeshFacet& facet, const Point& p) {
        return std::ranges::any_of(facet.vertices, [&](std::uint32_t v) {
          const auto place = places.find(facets.vertices[v]);
          return place != places.end() && place->second == p;
        });
      };
      num_lost += static_cast<int>(
          std::erase_if(facets.facets, [&](const MeshFacet& f) { return has(f, a) && has(f, b); }));
      batch.put_facets(leaf, facets);
    }
    EXPECT_EQ(num_lost, 2);
    batch.commit();
  }
  const CreaseTable table = crease_table(Store::open(dir / "store", {.read_only = true}));
  EXPECT_EQ(table.not_whole.size(), 1U);
  EXPECT_GT(table.lost_length, 0.04);
  EXPECT_LT(table.lost_length, 0.12);
}

TEST_F(CreasesOfACube, FilesTakeWhatIsEstimated) {
  const RunRecord run = store_->snapshot().run().value();
  const OutputOptions options{.format = MeshFormat::kVtu, .has_boundary = true};
  const WriteSummary written = write_mesh(*store_, *dir_ / "cube.vtu", options, 2);
  const OutputEstimate estimate = estimate_output(
      options, {.num_vertices = static_cast<double>(written.num_vertices),
                .num_cells = static_cast<double>(written.num_cells),
                .num_boundary_facets = static_cast<double>(written.num_boundary_facets),
                .has_creases = run.has_creases,
                .box = run.surface.box});
  const auto bytes = static_cast<double>(written.bytes);
  EXPECT_NEAR(estimate.file_bytes, bytes, 0.04 * bytes);
}

TEST(NamesOfCreases, AreThoseOfTheirSheetsWhereBothHaveSome) {
  SurfaceSheets sheets;
  for (const std::string group : {"wall", "inlet", "", "in/let"}) {
    SheetFacts facts;
    facts.group = group;
    facts.name = group.empty() ? "sheet " + std::to_string(sheets.sheets.size() + 1) : group;
    sheets.sheets.push_back(facts);
  }
  for (const std::array<SheetId, 2>& sides :
       {std::array<SheetId, 2>{1, 2}, {1, 3}, {1, 1}, {1, 2}, {2, 4}})
    sheets.creases.push_back({.sheets = sides});
  sheets.num_corners = 2;
  EXPECT_EQ(crease_names(sheets), (std::vector<std::string>{"wall/inlet_1", "crease 2", "wall/wall",
                                                            "wall/inlet_2", "inlet/in/let"}));
  sheets.sheets[1].name = "crease_2";
  const MeshNames names = names_of_mesh(sheets, true, {.is_identifier = true});
  EXPECT_EQ(names.sheets, (std::vector<std::string>{"wall", "crease_2", "sheet_3", "in_let"}));
  EXPECT_EQ(names.creases, (std::vector<std::string>{"wall_crease_2_1", "crease_2_2", "wall_wall",
                                                     "wall_crease_2_2", "crease_2_in_let"}));
  EXPECT_EQ(names.corners, (std::vector<std::string>{"corner_1", "corner_2"}));
  EXPECT_TRUE(names_of_mesh(sheets, false, {}).creases.empty());
}

}  // namespace
}  // namespace locvol
