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
  double sharp_angle = 40;
  bool is_small = false;  // a wall no wider than its size, or as tightly bent
};

// Its run, with a store "store" there.
RunSummary mesh(const Trial& trial, const TempDir& scratch) {
  write_off(trial.shape, scratch / "surface.off");
  MeshOptions options;
  options.input = scratch / "surface.off";
  options.store = scratch / "store";
  options.size = {trial.size, false};
  options.growth = trial.growth;
  options.sharp_angle = trial.sharp_angle;
  if (trial.max_size > 0) options.max_size = {trial.max_size, false};
  return mesh(options);
}

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
      {"ball", sphere(2, 31, 64), 0.13},
      {"flat torus", torus(3, 0.5, 90, 30), 0.14},
      {"two", together(sphere(1, 15, 32), translated(torus(1, 0.4, 60, 30), {5, 0, 0})), 0.1},
      {"growing ball", sphere(2, 61, 128), 0.1, 0.2},
      {"growing torus", torus(3, 0.5, 90, 30), 0.08, 0.3},
      {"bounded ball", sphere(2, 61, 128), 0.08, 0.2, 0.12}};
  for (const Trial& trial : trials) {
    SCOPED_TRACE(trial.name);
    const TempDir scratch;
    const RunSummary made = mesh(trial, scratch);
    const RunEstimate estimate = estimate_run(made.run.surface, made.run.parameters);
    const auto num_cells = static_cast<double>(made.run.counts.num_cells);
    EXPECT_GT(kCellsFactor * estimate.num_cells, num_cells);
    EXPECT_LT(estimate.num_cells / kCellsFactor, num_cells);
    EXPECT_NEAR(estimate.num_vertices, static_cast<double>(made.run.counts.num_points),
                0.15 * static_cast<double>(made.run.counts.num_points));
    std::uint64_t num_listed = 0;
    const Store store = Store::open(scratch / "store", {.read_only = true});
    store.snapshot().for_each_leaf([&](MortonKey, const LeafInfo& info) {
      num_listed += info.num_cells;
      return true;
    });
    expect_work_of(estimate, num_listed, scratch / "store");
    RunRecord as_it_began = made.run;  // with its sizes, where they vary
    as_it_began.phase = Phase::kRefine;
    expect_work_of(estimate_run(as_it_began, {}), num_listed, scratch / "store");
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

// A surface that is known, in a run that has not begun.
RunRecord before(const RunRecord& run) {
  RunRecord record;
  record.parameters = run.parameters;
  record.surface = run.surface;
  record.has_creases = run.has_creases;
  return record;
}

class RunEstimateOfWalls : public testing::TestWithParam<double> {};  // of the sharp angle

// None of these was used for the fit. Where the surface faces itself across less than λ, cells are
// as many as it takes to tell the sheets apart, whatever λ is; but for surfaces with creases, whose
// sheets are sampled each by itself.
TEST_P(RunEstimateOfWalls, IsWithinAFactorOfTwo) {
  const Box slab{{0, 0, 0}, {6, 5, 1.5}};
  const std::vector<Trial> trials = {
      {.name = "pipe", .shape = turned(pipe(1.5, 0.12, 4, 40)), .size = 1, .is_small = true},
      {"pipe of a wall as thick as half a size", turned(pipe(3, 0.5, 8, 40)), 1},
      {"shell", shell(2, 0.15, 30), 1},
      {"sheet", turned(box_shape({{0, 0, 0}, {3, 4, 0.05}})), 0.9},
      {.name = "sheet as thin as can be resolved",
       .shape = turned(box_shape({{0, 0, 0}, {1, 1.2, 0.022}})),
       .size = 1,
       .is_small = true},
      {"gap", turned(together(box_shape(slab), translated(box_shape(slab), {0, 0, 1.65}))), 1},
      {"knife", turned(testing_shapes::wedge(6, 8, 0.15)), 1},
      {"growing shell", shell(2, 0.15, 30), 0.8, 0.2}};
  for (Trial trial : trials) {
    if (trial.is_small && GetParam() > 0) continue;  // its layer takes several times as many
    trial.sharp_angle = GetParam();
    SCOPED_TRACE(trial.name);
    const TempDir scratch;
    const RunSummary made = mesh(trial, scratch);
    const RunEstimate estimate = estimate_run(before(made.run), {});
    const auto expect_twice = [](double estimated, double came) {
      EXPECT_GT(2 * estimated, came);
      EXPECT_LT(estimated / 2, came);
    };
    const auto num_cells = static_cast<double>(made.run.counts.num_cells);
    expect_twice(estimate.num_cells, num_cells);
    EXPECT_GT(kCellsFactor * estimate.doubt * estimate.num_cells, num_cells);
    expect_twice(estimate.num_vertices, static_cast<double>(made.run.counts.num_points));
    if (!made.run.has_creases) {
      EXPECT_GT(estimate.narrow.num_cells, 0.15 * estimate.num_cells);
    }
    const Store store = Store::open(scratch / "store", {.read_only = true});
    const auto bytes =
        static_cast<double>(std::filesystem::file_size(scratch / "store" / "data.mdb"));
    if (bytes > 5e5) expect_twice(estimate.store_bytes, bytes);
    const WriteSummary written = write_mesh(store, scratch / "mesh.vtu", {});
    expect_twice(estimate.output.file_bytes, static_cast<double>(written.bytes));
    RunRecord as_it_began = made.run;  // with its sizes, where they vary
    as_it_began.phase = Phase::kRefine;
    expect_twice(estimate_run(as_it_began, {}).num_cells, num_cells);
  }
}
INSTANTIATE_TEST_SUITE_P(With, RunEstimateOfWalls, testing::Values(0.0, 40.0));

// Of a wall of unit thickness, all around a volume, or of gaps of that width.
SurfaceFacts facts_of_wall(double area, bool is_gap = false) {
  SurfaceFacts facts = facts_of(is_gap ? area : area / 2, area);
  facts.num_components = 1;
  facts.facing = {1000, {{.step = 0}}};
  (is_gap ? facts.facing.places[0].num_gaps : facts.facing.places[0].num_walls) = 1000;
  return facts;
}

RunParameters with_floor(double size) {
  RunParameters parameters;
  parameters.size = size;
  parameters.spacing_floor = 0.02;
  return parameters;
}

TEST(RunEstimate, OfAWallIsOfItsThicknessAndOfNoSizeAboveIt) {
  const SurfaceFacts wall = facts_of_wall(1000);
  const auto num_cells = [&](double size) {
    return estimated_num_cells(wall, false, with_floor(size));
  };
  EXPECT_NEAR(num_cells(10) / num_cells(40), 1, 0.05);
  EXPECT_NEAR(num_cells(20), 1.87 * 1000, 60);
  EXPECT_GT(num_cells(0.5), 8 * num_cells(2));
  EXPECT_LT(num_cells(60), 20);  // below the floor: nothing tells its sides apart
  // No jump where a wall begins to ask for more than λ does.
  for (double size = 0.2; size < 5; size *= 1.02)
    EXPECT_NEAR(num_cells(1.02 * size) / num_cells(size), 1, 0.12) << size;
  // Twice the surface, twice the cells; half of all lengths, as many.
  EXPECT_NEAR(estimated_num_cells(facts_of_wall(2000), false, with_floor(10)), 2 * num_cells(10),
              1);
  SurfaceFacts half = facts_of(1000.0 / 2 / 8, 1000.0 / 4);
  half.facing = {1000, {{.step = -FacingPlaces::kStepsPerOctave, .num_walls = 1000}}};
  EXPECT_NEAR(estimated_num_cells(half, false, with_floor(5)), num_cells(10), 1);
  const RunEstimate coarse = estimate_run(wall, with_floor(20));
  EXPECT_NEAR(coarse.narrow.distance, 1, 0.02);
  EXPECT_NE(narrow_text(coarse).find("in walls about 1 thick"), std::string::npos)
      << narrow_text(coarse);
  EXPECT_EQ(lost_text(coarse), "");
  const RunEstimate lost = estimate_run(wall, with_floor(60));
  EXPECT_EQ(lost.narrow.lost_area, 1);
  EXPECT_NE(lost_text(lost).find("choose one below 51"), std::string::npos) << lost_text(lost);
  EXPECT_EQ(narrow_text(estimate_run(wall, with_floor(0.3))), "");
}

TEST(RunEstimate, OfAGapHasMoreThanWithoutIt) {
  const SurfaceFacts gap = facts_of_wall(1000, true);
  SurfaceFacts none = gap;
  none.facing.places.clear();
  const auto more = [&](double size) {
    return estimated_num_cells(gap, false, with_floor(size)) -
           estimated_num_cells(none, false, with_floor(size));
  };
  EXPECT_NEAR(more(20), 2.75 * 1000, 120);
  EXPECT_LT(more(0.8), 10);
  EXPECT_NE(narrow_text(estimate_run(gap, with_floor(20))).find("at gaps about 1 wide"),
            std::string::npos);
}

// Layers make cells smaller, down to the least size, and only that is more.
TEST(RunEstimate, OfLayersIsKnownBeforeSizesAre) {
  const SurfaceFacts wall = facts_of_wall(1000);
  RunParameters parameters = with_floor(10);
  parameters.layers = 3;
  parameters.min_size = 0.01;
  parameters.growth = 0.2;  // as planned_run() has it
  parameters.max_size = parameters.size;
  // Across them 3 cells that are 1 / (3 · 1.35) wide, of which there are 7.6 to the square.
  const double layers = estimated_num_cells(wall, false, parameters);
  EXPECT_NEAR(layers, 7.6 * 1000 * std::pow(3 * 1.35, 2), 0.1 * layers);
  parameters.min_size = 0.5;
  EXPECT_LT(estimated_num_cells(wall, false, parameters), 0.3 * layers);
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
    return estimated_num_cells(facts, false, default_size(facts));
  };
  EXPECT_NEAR(cells_of(facts_of(1, 6)), 5e5, 1e5);
  EXPECT_NEAR(cells_of(facts_of(1e-9, 6e-6)), 5e5, 1e5);  // of any unit
  EXPECT_NEAR(cells_of(facts_of(1e30, 6e20)), 5e5, 1e5);
  EXPECT_NEAR(cells_of(facts_of(0.004, 2.016)), 5e5, 1e5);
  EXPECT_EQ(default_size(facts_of(0, 2)), 0);
  EXPECT_EQ(default_size(facts_of(0, 0)), 0);
}

// Half a million, or what the wall takes at any λ that does not lose it.
TEST(DefaultSize, OfAWallDoesNotLoseIt) {
  for (const double area : {1e3, 1e4, 1e5, 2e5, 2.5e5, 3e5, 1e6, 1e7}) {
    SCOPED_TRACE(area);
    const SurfaceFacts wall = facts_of_wall(area);
    const double size = default_size(wall);
    const RunEstimate estimate = estimate_run(wall, with_floor(size));
    EXPECT_EQ(estimate.narrow.lost_area, 0);
    EXPECT_LT(size, 1 / 0.02);
    const double of_wall = 1.87 * area;
    EXPECT_GT(estimate.num_cells, std::max(0.8 * 5e5, 0.8 * of_wall));
    EXPECT_LT(estimate.num_cells, std::max(1.2 * 5e5, 1.3 * of_wall));
    if (of_wall > 1e6) {
      EXPECT_NEAR(size, 1.2, 0.3);  // as coarse as hardly changes that
    }
    const std::string reason = default_size_reason(wall, false, size);
    EXPECT_EQ(reason.find("walls about 1 thick") != std::string::npos, of_wall > 1e6) << reason;
    EXPECT_EQ(lost_text(estimate), "");
  }
}

// Some slivers of a surface may be lost: for them, nobody pays a hundred times.
TEST(DefaultSize, OfASurfaceWithAFewThinPlacesIsAsWithout) {
  SurfaceFacts facts = facts_of(1, 6);
  facts.num_components = 1;
  facts.facing = {1000, {{.step = -700, .num_walls = 5}}};
  EXPECT_EQ(default_size(facts), default_size(facts_of(1, 6)));
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
