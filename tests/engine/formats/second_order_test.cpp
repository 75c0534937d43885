// Meshes of second order: nodes in the middle of edges, on the surface where cells allow it.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <string>

#include "engine/engine.h"
#include "engine/formats/formats.h"
#include "engine/formats/mesh_format.h"
#include "engine/formats/writer.h"
#include "engine/output/mesh_edge.h"
#include "engine/output/quadratic_cell.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/formats/meshed_sphere.h"
#include "tests/engine/hand_made_mesh.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using namespace testing_shapes;

constexpr std::uint8_t kOfCell = 24, kOfFacet = 22, kOfLine = 21;

// A VTU file with the boundary.
struct QuadraticMesh {
  explicit QuadraticMesh(const std::filesystem::path& file) {
    const VtuArrays arrays(file);
    const auto coordinates = arrays.array<double>("Float64", "Points");
    for (std::size_t i = 0; i < coordinates.size(); i += 3)
      points.push_back({coordinates[i], coordinates[i + 1], coordinates[i + 2]});
    const auto types = arrays.array<std::uint8_t>("UInt8", "types");
    const auto ends = arrays.array<std::int32_t>("Int32", "offsets");
    const auto vertices = arrays.array<std::int32_t>("Int32", "connectivity");
    sheets = arrays.array<std::uint32_t>("UInt32", "sheet");
    std::size_t place = 0;
    for (std::size_t i = 0; i < types.size(); ++i) {
      const auto take = [&](auto& to) {
        std::copy_n(&vertices.at(place), to.size(), to.begin());
        place += to.size();
      };
      if (types[i] == kOfCell)
        take(cells.emplace_back());
      else if (types[i] == kOfFacet)
        take(facets.emplace_back());
      else if (types[i] == kOfLine)
        take(lines.emplace_back());
      else
        take(corner_points.emplace_back());
      EXPECT_EQ(ends[i], static_cast<std::int32_t>(place));
    }
    EXPECT_EQ(place, vertices.size());
  }

  const Point& point(std::int32_t number) const { return points.at(std::size_t(number)); }
  std::array<Point, 4> corners(std::size_t cell) const {
    const auto& c = cells[cell];
    return {point(c[0]), point(c[1]), point(c[2]), point(c[3])};
  }
  Point off_middle(std::int32_t a, std::int32_t b, std::int32_t node) const {
    return point(node) - middle(point(a), point(b));
  }
  NodeShifts shifts(std::size_t cell) const {
    const auto& c = cells[cell];
    NodeShifts shifts{};
    for (std::size_t e = 0; e < 6; ++e)
      shifts[e] = off_middle(c[kCellEdges[e][0]], c[kCellEdges[e][1]], c[4 + e]);
    return shifts;
  }
  // Nodes of facets by their edges.
  std::map<std::set<std::int32_t>, std::int32_t> boundary_nodes() const {
    std::map<std::set<std::int32_t>, std::int32_t> nodes;
    for (const auto& f : facets)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [found, is_new] = nodes.insert({{f[k], f[(k + 1) % 3]}, f[3 + k]});
        EXPECT_TRUE(is_new || found->second == f[3 + k]);
      }
    return nodes;
  }
  double volume() const;

  std::vector<Point> points;
  std::vector<std::array<std::int32_t, 10>> cells;
  std::vector<std::array<std::int32_t, 6>> facets;
  std::vector<std::array<std::int32_t, 3>> lines;  // of creases
  std::vector<std::array<std::int32_t, 1>> corner_points;
  std::vector<std::uint32_t> sheets;
};

// The derivative's determinant from the shape functions of ten nodes, at barycentric coordinates.
double determinant(const std::array<Point, 4>& corners, const NodeShifts& shifts,
                   const std::array<double, 4>& at) {
  std::array<Point, 4> by_coordinate{};
  for (std::size_t i = 0; i < 4; ++i) by_coordinate[i] = (4 * at[i] - 1) * corners[i];
  for (std::size_t e = 0; e < 6; ++e) {
    const auto& [i, j] = kCellEdges[e];
    const Point node = middle(corners[i], corners[j]) + shifts[e];
    by_coordinate[i] = by_coordinate[i] + 4 * at[j] * node;
    by_coordinate[j] = by_coordinate[j] + 4 * at[i] * node;
  }
  return dot(cross(by_coordinate[1] - by_coordinate[0], by_coordinate[2] - by_coordinate[0]),
             by_coordinate[3] - by_coordinate[0]);
}

// By quadrature at five points, which is exact for polynomials of third degree.
double QuadraticMesh::volume() const {
  double sum = 0;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const auto at = corners(c);
    const auto off = shifts(c);
    sum += -0.8 / 6 * determinant(at, off, {0.25, 0.25, 0.25, 0.25});
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<double, 4> place;
      place.fill(1.0 / 6);
      place[k] = 0.5;
      sum += 0.45 / 6 * determinant(at, off, place);
    }
  }
  return sum;
}

double straight(const std::array<Point, 4>& c) {
  return dot(cross(c[1] - c[0], c[2] - c[0]), c[3] - c[0]);
}

constexpr std::array<Point, 4> kCorners{{{0, 0, 0}, {1, 0, 0}, {0.2, 1.1, 0}, {0.3, 0.2, 0.9}}};

TEST(QuadraticCell, IsOneWhereNodesAreInTheMiddle) {
  EXPECT_NEAR(least_jacobian(kCorners, {}), 1, 1e-15);
  EXPECT_EQ(allowed_nodes(kCorners, {}), 0);
}

// Between the corners (0, 0, 0) and (1, 0, 0), a node at x = 1/4 makes the derivative vanish at the
// first.
TEST(QuadraticCell, VanishesAtACornerWithANodeAtAQuarter) {
  const std::array<Point, 4> corners{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (const double x : {-0.25, 0.25})
    EXPECT_NEAR(least_jacobian(corners, {Point{x, 0, 0}}), 0, 1e-15);
  EXPECT_NEAR(least_jacobian(corners, {Point{-0.125, 0, 0}}), 0.5, 1e-15);
}

class RandomShifts : public testing::TestWithParam<double> {
 protected:
  NodeShifts next() {
    std::uniform_real_distribution<double> off(-GetParam(), GetParam());
    NodeShifts shifts{};
    for (Point& shift : shifts)
      if (random_() % 2 == 0) shift = {off(random_), off(random_), off(random_)};
    return shifts;
  }
  std::array<double, 4> next_place() {
    std::array<double, 4> at{};
    double sum = 0;
    for (double& t : at) sum += t = std::exponential_distribution<double>()(random_);
    for (double& t : at) t /= sum;
    return at;
  }
  std::mt19937_64 random_{7};
};

TEST_P(RandomShifts, LeastJacobianIsALowerBound) {
  for (int i = 0; i < 300; ++i) {
    const NodeShifts shifts = next();
    const double least = least_jacobian(kCorners, shifts) * straight(kCorners);
    double seen = HUGE_VAL;
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<double, 4> corner{};
      corner[k] = 1;
      seen = std::min(seen, determinant(kCorners, shifts, corner));
    }
    for (int j = 0; j < 50; ++j) seen = std::min(seen, determinant(kCorners, shifts, next_place()));
    EXPECT_LE(least, seen + 1e-12);
  }
}

// What a cell allows will do, whichever of the nodes are back in the middle, and no more nodes
// would.
TEST_P(RandomShifts, AllowedNodesAreAsManyAsCanBe) {
  for (int i = 0; i < 100; ++i) {
    const NodeShifts shifts = next();
    const auto some_of = [&](unsigned nodes) {
      NodeShifts some{};
      for (std::size_t e = 0; e < 6; ++e)
        if (nodes >> e & 1) some[e] = shifts[e];
      return some;
    };
    const auto will_do = [&](unsigned nodes) {
      for (unsigned part = nodes; part != 0; part = (part - 1) & nodes)
        if (least_jacobian(kCorners, some_of(part)) < kLeastJacobian) return false;
      return true;
    };
    unsigned off = 0;
    for (std::size_t e = 0; e < 6; ++e)
      if (shifts[e] != Point{}) off |= 1U << e;
    const unsigned allowed = allowed_nodes(kCorners, shifts);
    EXPECT_EQ(allowed & ~off, 0U);
    EXPECT_TRUE(will_do(allowed));
    for (unsigned nodes = 0; nodes < 64; ++nodes)
      if ((nodes & ~off) == 0 && std::popcount(nodes) > std::popcount(allowed)) {
        EXPECT_FALSE(will_do(nodes));
      }
  }
}

INSTANTIATE_TEST_SUITE_P(Sizes, RandomShifts, testing::Values(0.01, 0.05, 0.15, 0.4));

// Every edge of every cell has one node, under any octree, whether its cells are listed or of the
// core.
void check_edges(const QuadraticMesh& mesh, const WriteSummary& written) {
  std::map<std::set<std::int32_t>, std::int32_t> nodes;
  std::set<std::int32_t> numbers;
  for (const auto& cell : mesh.cells)
    for (std::size_t e = 0; e < 6; ++e) {
      const auto [found, is_new] =
          nodes.insert({{cell[kCellEdges[e][0]], cell[kCellEdges[e][1]]}, cell[4 + e]});
      ASSERT_TRUE(is_new || found->second == cell[4 + e]);
      numbers.insert(cell[4 + e]);
    }
  ASSERT_EQ(nodes.size(), written.num_nodes);
  ASSERT_EQ(numbers.size(), nodes.size());
  ASSERT_EQ(mesh.points.size(), written.num_vertices + written.num_nodes);
  if (numbers.empty()) return;
  EXPECT_EQ(*numbers.begin(), static_cast<std::int32_t>(written.num_vertices));
  EXPECT_EQ(*numbers.rbegin() + 1, static_cast<std::int32_t>(mesh.points.size()));
  for (const auto& [edge, node] : mesh.boundary_nodes()) EXPECT_EQ(nodes.at(edge), node);
}

constexpr OutputOptions kSecondOrder = {.has_boundary = true, .order = 2};

TEST(SecondOrder, HasANodeForEachEdgeUnderAnyOctree) {
  for (const HandMadeMesh& mesh : different_meshes())
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const TempDir dir;
      const Store store = HandMadeStore(mesh, octree).write(dir / "store");
      const WriteSummary written = write_mesh(store, dir / "mesh.vtu", kSecondOrder, 2);
      check_edges(QuadraticMesh(dir / "mesh.vtu"), written);
    }
}

class SecondOrderOf : public testing::Test {
 protected:
  // Into the store, and the file.
  QuadraticMesh mesh_of(const Shape& shape, double size, std::uint64_t leaf_capacity = 500) {
    write_off(shape, dir_ / "input.off");
    std::filesystem::remove_all(dir_ / "store");
    MeshOptions options;
    options.input = dir_ / "input.off";
    options.store = dir_ / "store";
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    mesh(options);
    written_ = write_mesh(store(), dir_ / "mesh.vtu", kSecondOrder, 2);
    const QuadraticMesh mesh(dir_ / "mesh.vtu");
    check_edges(mesh, written_);
    check_jacobians(mesh);
    return mesh;
  }
  Store store() const { return Store::open(dir_ / "store", {.read_only = true}); }

  static void check_jacobians(const QuadraticMesh& mesh) {
    for (std::size_t c = 0; c < mesh.cells.size(); ++c)
      ASSERT_GE(least_jacobian(mesh.corners(c), mesh.shifts(c)), 0.999 * kLeastJacobian);
  }

  TempDir dir_;
  WriteSummary written_;
};

// Of a sphere so fine that its facets do not count.
TEST_F(SecondOrderOf, SphereIsMuchCloserToItThanStraightCells) {
  const Shape shape = sphere(1, 150, 300);
  const double whole = 4 * std::numbers::pi / 3;
  std::vector<double> of_middles, of_volumes;
  for (const double size : {0.3, 0.15}) {
    const QuadraticMesh mesh = mesh_of(shape, size);
    EXPECT_EQ(written_.num_nodes_off_surface, 0U);
    EXPECT_EQ(written_.num_nodes_on_surface, mesh.boundary_nodes().size());
    double farthest = 0, farthest_middle = 0;
    for (const auto& [edge, node] : mesh.boundary_nodes()) {
      farthest = std::max(farthest, std::abs(1 - norm(mesh.point(node))));
      farthest_middle = std::max(
          farthest_middle, 1 - norm(middle(mesh.point(*edge.begin()), mesh.point(*edge.rbegin()))));
    }
    EXPECT_LT(farthest, 2e-4);
    EXPECT_GT(farthest_middle, 20 * farthest);
    double straight_volume = 0;
    for (std::size_t c = 0; c < mesh.cells.size(); ++c)
      straight_volume += straight(mesh.corners(c)) / 6;
    EXPECT_LT(std::abs(mesh.volume() - whole), 0.05 * (whole - straight_volume));
  }
}

TEST_F(SecondOrderOf, BoxHasAllNodesInTheMiddle) {
  const QuadraticMesh mesh = mesh_of(box_shape({{0, 0, 0}, {1, 2, 1.5}}), 0.3);
  EXPECT_EQ(written_.num_nodes_on_surface, 0U);
  EXPECT_EQ(written_.num_nodes_off_surface, 0U);
  for (std::size_t c = 0; c < mesh.cells.size(); ++c) EXPECT_EQ(mesh.shifts(c), NodeShifts{});
  EXPECT_NEAR(mesh.volume(), 3, 1e-12);
}

// A rod of radius 1 from z = 0 to 3.
Shape cylinder(std::uint32_t n) {
  Shape shape;
  const auto add = [&](double r, double angle, double z) {
    shape.vertices.push_back({r * std::cos(angle), r * std::sin(angle), z});
  };
  for (const double z : {0.0, 3.0}) {
    for (std::uint32_t i = 0; i < n; ++i) add(1, 2 * std::numbers::pi * i / n, z);
  }
  add(0, 0, 0);
  add(0, 0, 3);
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t j = (i + 1) % n;
    shape.triangles.push_back({i, j, n + j});
    shape.triangles.push_back({i, n + j, n + i});
    shape.triangles.push_back({j, i, 2 * n});
    shape.triangles.push_back({n + i, n + j, 2 * n + 1});
  }
  return shape;
}

// Its rims are creases: their nodes lie on them, those of the caps in the caps, and those of the
// side on it.
TEST_F(SecondOrderOf, CylinderKeepsItsRims) {
  const QuadraticMesh mesh = mesh_of(cylinder(240), 0.35);
  std::map<std::int32_t, std::set<std::uint32_t>> sheets;  // of nodes
  for (std::size_t f = 0; f < mesh.facets.size(); ++f)
    for (std::size_t k = 3; k < 6; ++k)
      sheets[mesh.facets[f][k]].insert(mesh.sheets[mesh.cells.size() + f]);
  std::size_t num_on_rims = 0;
  for (const auto& [node, of_node] : sheets) {
    const Point& p = mesh.point(node);
    const double radius = std::hypot(p.x, p.y);
    const bool is_in_cap = std::abs(p.z) < 1e-12 || std::abs(p.z - 3) < 1e-12;
    if (of_node.size() == 2) {
      ++num_on_rims;
      EXPECT_TRUE(is_in_cap);
    }
    if (of_node.size() == 2 || !is_in_cap) {
      EXPECT_NEAR(radius, 1, 1e-4);
    }
  }
  EXPECT_GT(num_on_rims, 30U);
  EXPECT_EQ(written_.num_nodes_off_surface, 0U);
  EXPECT_NEAR(mesh.volume(), 3 * std::numbers::pi, 2e-3);
}

// They are lines between the ends and through the nodes of edges of facets. No vertex is a corner.
TEST_F(SecondOrderOf, CylinderHasLinesOfThreeNodesOnItsRims) {
  const QuadraticMesh mesh = mesh_of(cylinder(240), 0.35, 50);
  const auto nodes = mesh.boundary_nodes();
  const VtuArrays arrays(dir_ / "mesh.vtu");
  const auto creases = arrays.array<std::uint32_t>("UInt32", "crease");
  const std::size_t num_before = mesh.cells.size() + mesh.facets.size();
  ASSERT_EQ(creases.size(), num_before + mesh.lines.size());
  EXPECT_TRUE(mesh.corner_points.empty());
  EXPECT_EQ(arrays.array<std::uint32_t>("UInt32", "corner"),
            std::vector<std::uint32_t>(mesh.points.size()));
  std::array<double, 2> angles{};
  for (std::size_t i = 0; i < mesh.lines.size(); ++i) {
    const auto& [a, b, node] = mesh.lines[i];
    EXPECT_EQ(nodes.at({a, b}), node);
    const Point &p = mesh.point(a), &q = mesh.point(b), &between = mesh.point(node);
    EXPECT_NEAR(std::hypot(between.x, between.y), 1, 1e-4);
    EXPECT_EQ(p.z, between.z);
    ASSERT_TRUE(creases[num_before + i] == 1 || creases[num_before + i] == 2);
    angles[creases[num_before + i] - 1] +=
        std::acos((p.x * q.x + p.y * q.y) / (std::hypot(p.x, p.y) * std::hypot(q.x, q.y)));
  }
  for (const double angle : angles) EXPECT_NEAR(angle, 2 * std::numbers::pi, 1e-6);
}

// Cells as large as the ring is thick cannot have all of their nodes on it.
TEST_F(SecondOrderOf, CoarseRingHasNoCellTurnedInsideOut) {
  mesh_of(torus(1, 0.3, 64, 32), 0.6);
  EXPECT_GT(written_.num_nodes_off_surface, 20U);
  EXPECT_GT(written_.num_nodes_on_surface, 20U);
}

// The vertices are those of first order, with the same numbers; and each facet is that of its cell.
TEST_F(SecondOrderOf, MeshHasTheVerticesAndCellsOfFirstOrder) {
  const QuadraticMesh mesh = mesh_of(sphere(1, 24, 48), 0.2);
  write_mesh(store(), dir_ / "first.vtu", {.has_boundary = true});
  const VtuArrays first(dir_ / "first.vtu");
  const auto points = first.array<double>("Float64", "Points");
  ASSERT_EQ(points.size(), 3 * written_.num_vertices);
  for (std::size_t i = 0; i < points.size(); ++i)
    EXPECT_EQ(points[i], mesh.points[i / 3][static_cast<int>(i % 3)]);
  const auto corners = first.array<std::int32_t>("Int32", "connectivity");
  auto next = corners.begin();
  for (const auto& cell : mesh.cells)
    for (std::size_t k = 0; k < 4; ++k) EXPECT_EQ(cell[k], *next++);
  for (const auto& facet : mesh.facets)
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(facet[k], *next++);
  EXPECT_TRUE(next == corners.end());
}

TEST_F(SecondOrderOf, FormatsWithoutCellsRefuseIt) {
  mesh_of(sphere(1, 12, 24), 0.5);
  for (const FormatInfo& info : mesh_formats()) {
    const OutputOptions output = {.format = info.format, .order = 2};
    if (info.has_second_order())
      EXPECT_GT(write_mesh(store(), dir_ / "mesh", output).num_nodes, 0U);
    else
      EXPECT_THROW(write_mesh(store(), dir_ / "mesh", output), InputError) << info.name;
  }
}

}  // namespace
}  // namespace locvol
