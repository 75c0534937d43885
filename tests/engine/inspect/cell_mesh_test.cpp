#include "engine/inspect/cell_mesh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

constexpr std::array<Point, 4> kRegular = {{{1, 1, 1}, {-1, -1, 1}, {1, -1, -1}, {-1, 1, -1}}};
constexpr std::array<Point, 4> kCorner = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
constexpr double kDegrees = 180 / std::numbers::pi;

TEST(CellQuality, OfARegularCell) {
  const CellQuality quality = quality_of(kRegular);
  EXPECT_NEAR(quality.circumradius, std::sqrt(3), 1e-12);
  EXPECT_NEAR(quality.radius_edge_ratio, std::sqrt(6) / 4, 1e-12);
  EXPECT_NEAR(quality.min_dihedral_degrees, std::acos(1.0 / 3) * kDegrees, 1e-10);
  EXPECT_NEAR(quality.max_dihedral_degrees, std::acos(1.0 / 3) * kDegrees, 1e-10);
}

TEST(CellQuality, OfACornerOfACube) {
  const CellQuality quality = quality_of(kCorner);
  EXPECT_NEAR(quality.circumradius, std::sqrt(3) / 2, 1e-12);
  EXPECT_NEAR(quality.radius_edge_ratio, std::sqrt(3) / 2, 1e-12);
  EXPECT_NEAR(quality.min_dihedral_degrees, std::acos(1 / std::sqrt(3)) * kDegrees, 1e-10);
  EXPECT_NEAR(quality.max_dihedral_degrees, 90, 1e-10);
}

TEST(CellQuality, OfAFlatCellIsTheWorst) {
  const CellQuality quality = quality_of({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}});
  EXPECT_EQ(quality.circumradius, std::numeric_limits<double>::infinity());
  EXPECT_EQ(quality.min_dihedral_degrees, 0);
  EXPECT_EQ(quality.max_dihedral_degrees, 180);
}

CellMesh two_cells() {
  CellMesh mesh;
  for (const auto& corners : {kRegular, kCorner})
    for (const Point& p : corners) {
      const auto id = static_cast<std::int64_t>(mesh.vertices.size());
      mesh.vertices.push_back({id == 7 ? -1 : 10 * id, p, PointKind(id % 3), id < 4});
    }
  mesh.cells = {{0, 1, 2, 3}, {4, 5, 6, 7}};
  return mesh;
}

TEST(CellMesh, WorstQualityIsOfAllCells) {
  const CellQuality worst = worst_quality(two_cells());
  EXPECT_NEAR(worst.circumradius, std::sqrt(3), 1e-12);
  EXPECT_NEAR(worst.radius_edge_ratio, std::sqrt(3) / 2, 1e-12);
  EXPECT_NEAR(worst.min_dihedral_degrees, std::acos(1 / std::sqrt(3)) * kDegrees, 1e-10);
  EXPECT_NEAR(worst.max_dihedral_degrees, 90, 1e-10);
}

TEST(CellMesh, IsWrittenWithItsQuality) {
  const TempDir dir;
  const CellMesh mesh = two_cells();
  const auto bytes = write_vtu(mesh, 2, dir / "cells.vtu");
  EXPECT_EQ(bytes, std::filesystem::file_size(dir / "cells.vtu"));
  const VtuArrays vtu(dir / "cells.vtu");
  EXPECT_EQ(vtu.num_points(), 8U);
  EXPECT_EQ(vtu.num_cells(), 2U);
  const auto points = vtu.array<Point>("Float64", "Points");
  ASSERT_EQ(points.size(), 8U);
  for (std::size_t i = 0; i < 8; ++i) EXPECT_EQ(points[i], mesh.vertices[i].position);
  EXPECT_EQ(vtu.array<std::int64_t>("Int64", "connectivity"),
            (std::vector<std::int64_t>{0, 1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(vtu.array<std::int64_t>("Int64", "offsets"), (std::vector<std::int64_t>{4, 8}));
  EXPECT_EQ(vtu.array<std::uint8_t>("UInt8", "types"), (std::vector<std::uint8_t>{10, 10}));
  EXPECT_EQ(vtu.array<std::int64_t>("Int64", "id").back(), -1);
  EXPECT_EQ(vtu.array<std::int64_t>("Int64", "kind"),
            (std::vector<std::int64_t>{0, 1, 2, 0, 1, 2, 0, 1}));
  EXPECT_EQ(vtu.array<std::int64_t>("Int64", "own"),
            (std::vector<std::int64_t>{1, 1, 1, 1, 0, 0, 0, 0}));
  const auto radii = vtu.array<double>("Float64", "circumradius");
  ASSERT_EQ(radii.size(), 2U);
  EXPECT_NEAR(radii[0], std::sqrt(3) / 2, 1e-12);  // over the size
  EXPECT_NEAR(radii[1], std::sqrt(3) / 4, 1e-12);
  EXPECT_NEAR(vtu.array<double>("Float64", "min_dihedral_degrees")[0],
              std::acos(1.0 / 3) * kDegrees, 1e-10);
}

}  // namespace
}  // namespace locvol
