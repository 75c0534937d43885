// The laws against whole runs, and in closed forms.
#include "engine/plan/run_estimate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "tests/engine/closed_shapes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

SurfaceFacts facts_of(double volume, double area) {
  SurfaceFacts facts;
  facts.volume = volume;
  facts.area = area;
  return facts;
}

RunEstimate estimate_of(const SurfaceFacts& facts, double size) {
  RunParameters parameters;
  parameters.size = size;
  return estimate_run(facts, parameters);
}

struct Trial {
  const char* name;
  Shape shape;
  double size;
  double growth = 0, max_size = 0;
};

void expect_work_of(const RunEstimate& estimate, std::uint64_t num_listed,
                    const std::filesystem::path& store) {
  EXPECT_NEAR(estimate.num_listed_cells, static_cast<double>(num_listed),
              0.15 * static_cast<double>(num_listed));
  const auto bytes = static_cast<double>(std::filesystem::file_size(store / "data.mdb"));
  EXPECT_LT(bytes, kBytesFactor * estimate.store_bytes);
}

// None of these was used for the fit.
TEST(RunEstimate, IsThatOfWholeRuns) {
  const std::vector<Trial> trials = {
      {"coarse ball", sphere(2, 31, 64), 0.3},
      {"ball", sphere(2, 31, 64), 0.1},
      {"flat torus", torus(3, 0.5, 90, 30), 0.12},
      {"two", together(sphere(1, 15, 32), translated(torus(1, 0.4, 60, 30), {5, 0, 0})), 0.08},
      {"growing ball", sphere(2, 61, 128), 0.08, 0.2},
      {"growing torus", torus(3, 0.5, 90, 30), 0.06, 0.3},
      {"bounded ball", sphere(2, 61, 128), 0.06, 0.2, 0.09}};
  for (const auto& [name, shape, size, growth, max_size] : trials) {
    SCOPED_TRACE(name);
    const TempDir scratch;
    write_off(shape, scratch / "surface.off");
    MeshOptions options;
    options.input = scratch / "surface.off";
    options.store = scratch / "store";
    options.size = {size, false};
    options.growth = growth;
    if (max_size > 0) options.max_size = {max_size, false};
    const RunSummary made = mesh(options);
    const RunEstimate estimate = estimate_run(made.run.surface, made.run.parameters);
    const auto num_cells = static_cast<double>(made.run.counts.num_cells);
    EXPECT_GT(kCellsFactor * estimate.num_cells, num_cells);
    EXPECT_LT(estimate.num_cells / kCellsFactor, num_cells);
    EXPECT_NEAR(estimate.num_vertices, static_cast<double>(made.run.counts.num_points),
                0.15 * static_cast<double>(made.run.counts.num_points));
    std::uint64_t num_listed = 0;
    const Store store = Store::open(options.store, {.read_only = true});
    store.snapshot().for_each_leaf([&](MortonKey, const LeafInfo& info) {
      num_listed += info.num_cells;
      return true;
    });
    expect_work_of(estimate, num_listed, options.store);
    RunRecord as_it_began = made.run;  // with its sizes, where they vary
    as_it_began.phase = Phase::kRefine;
    expect_work_of(estimate_run(as_it_began, {}), num_listed, options.store);
    for (const FormatInfo& format : mesh_formats()) {
      SCOPED_TRACE(format.name);
      const OutputOptions output = {format.format, format.has_cell_data};
      const WriteSummary written = write_mesh(store, scratch / "mesh", output);
      const RunEstimate of_format = estimate_run(made.run.surface, made.run.parameters, 1, output);
      const auto file_bytes = static_cast<double>(written.bytes);
      EXPECT_GT(kFileFactor * of_format.output.file_bytes, file_bytes);
      EXPECT_LT(of_format.output.file_bytes / kFileFactor, file_bytes);
    }
  }
}

TEST(RunEstimate, OfHalfTheSizeIsEightTimesTheVolumeAndFourTimesTheSurface) {
  const SurfaceFacts facts = facts_of(1, 6);
  const RunEstimate fine = estimate_of(facts, 0.001), finer = estimate_of(facts, 0.0005);
  EXPECT_NEAR(finer.num_cells / fine.num_cells, 8, 0.05);
  EXPECT_NEAR(finer.num_listed_cells / fine.num_listed_cells, 4, 0.01);
  EXPECT_NEAR(fine.num_cells * 1e-9, 12 / std::pow(1.75, 3), 0.05);
  EXPECT_NEAR(finer.output.file_bytes / finer.num_cells, 49, 0.5);
}

TEST(RunEstimate, OfMoreThreadsTakesLessTimeAndMakesTheSame) {
  SurfaceFacts facts = facts_of(1, 6);
  facts.num_triangles = 1000;
  RunParameters parameters;
  parameters.size = 0.01;
  const RunEstimate one = estimate_run(facts, parameters, 1),
                    four = estimate_run(facts, parameters, 4);
  EXPECT_EQ(one.num_cells, four.num_cells);
  EXPECT_LT(four.total_seconds(), 0.5 * one.total_seconds());
  EXPECT_GT(four.total_seconds(), 0.25 * one.total_seconds());
}

TEST(RunEstimate, SaysWhereTheSurfaceIsThin) {
  EXPECT_FALSE(estimate_of(facts_of(1, 6), 0.3).is_thin);
  EXPECT_TRUE(estimate_of(facts_of(1, 6), 0.4).is_thin);
}

TEST(DefaultSize, MakesAUsefulMesh) {
  const auto cells_of = [](const SurfaceFacts& facts) {
    return estimated_num_cells(facts, {.surface = default_size(facts)});
  };
  EXPECT_NEAR(cells_of(facts_of(1, 6)), 5e5, 1e5);
  EXPECT_NEAR(cells_of(facts_of(1e-9, 6e-6)), 5e5, 1e5);  // of any unit
  EXPECT_NEAR(cells_of(facts_of(1e30, 6e20)), 5e5, 1e5);
  // A plate of 1 by 1 by 0.004: two λ thick, with more cells.
  const SurfaceFacts plate = facts_of(0.004, 2.016);
  EXPECT_LT(2 * default_size(plate), 1.1 * 2 * plate.volume / plate.area);
  EXPECT_GT(cells_of(plate), 5e5);
  // One that would take more than five million cells.
  EXPECT_NEAR(cells_of(facts_of(0.0001, 2)), 5e6, 2e6);
  EXPECT_EQ(default_size(facts_of(0, 2)), 0);
  EXPECT_EQ(default_size(facts_of(0, 0)), 0);
}

TEST(DefaultSize, HasTwoDigits) {
  for (const double side : {0.0137, 1.0, 77.7, 3e5}) {
    const double size = default_size(facts_of(side * side * side, 6 * side * side));
    char text[32];
    std::snprintf(text, sizeof text, "%.1e", size);
    EXPECT_EQ(size, std::strtod(text, nullptr)) << side;
  }
}

}  // namespace
}  // namespace locvol
