#include "engine/inspect/crease_file.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <vector>

#include "engine/engine.h"
#include "engine/formats/mesh_arrays.h"
#include "tests/cube_off.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

TEST(CreaseFile, OfACubeHasTwelveLinesAndEightVertices) {
  const TempDir dir;
  MeshOptions options;
  options.input = dir / "cube.off";
  options.store = dir / "store";
  options.size = {0.2, false};
  options.leaf_capacity = 50;
  std::ofstream(options.input) << kCube;
  mesh(options, {});
  const RunPart part = whole_run(Store::open(options.store, {.read_only = true}));
  const RunRecord run = *part.store->snapshot().run();
  const auto [num_edges, num_corners, bytes] = write_creases_vtu(part, run, dir / "creases.vtu");
  EXPECT_EQ(num_edges, 12U);
  EXPECT_EQ(num_corners, 8U);
  EXPECT_EQ(bytes, std::filesystem::file_size(dir / "creases.vtu"));
  const VtuArrays vtu(dir / "creases.vtu");
  EXPECT_EQ(vtu.num_points(), 32U);
  EXPECT_EQ(vtu.num_cells(), 20U);
  std::vector<std::uint8_t> types(12, kVtkLine);
  types.insert(types.end(), 8, kVtkVertex);
  EXPECT_EQ(vtu.array<std::uint8_t>("UInt8", "types"), types);
  const auto offsets = vtu.array<std::int64_t>("Int64", "offsets");
  EXPECT_EQ(offsets[11], 24);
  EXPECT_EQ(offsets[19], 32);
  const auto points = vtu.array<Point>("Float64", "Points");
  const auto connectivity = vtu.array<std::int64_t>("Int64", "connectivity");
  const auto creases = vtu.array<std::int64_t>("Int64", "crease");
  const auto corners = vtu.array<std::int64_t>("Int64", "corner");
  const auto point = [&](std::size_t i) {
    return points[static_cast<std::size_t>(connectivity[i])];
  };
  std::vector<int> num_with(13);
  for (std::size_t cell = 0; cell < 20; ++cell) {
    ++num_with[static_cast<std::size_t>(creases[cell])];
    EXPECT_EQ(corners[cell] > 0, cell >= 12);
    if (cell >= 12) continue;
    EXPECT_EQ(squared_distance(point(2 * cell), point(2 * cell + 1)), 1);
  }
  EXPECT_EQ(num_with[0], 8);
  for (std::size_t crease = 1; crease <= 12; ++crease) EXPECT_EQ(num_with[crease], 1);
}

}  // namespace
}  // namespace locvol
