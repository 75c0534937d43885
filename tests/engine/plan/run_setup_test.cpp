#include "engine/plan/run_setup.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "engine/plan/disk_room.h"
#include "engine/plan/octree_plan.h"
#include "engine/plan/run_estimate.h"
#include "engine/plan/same_run.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

// A run in a box, with the box' facts.
RunRecord planned_in_box(const MeshOptions& options, const Point& sides) {
  RunRecord run = planned_run(options, "ab12", {{0, 0, 0}, sides});
  run.surface.volume = sides.x * sides.y * sides.z;
  run.surface.area = 2 * (sides.x * sides.y + sides.y * sides.z + sides.z * sides.x);
  return run;
}

MeshOptions options_with(const Size& size) {
  MeshOptions options;
  options.input = "box.off";
  options.store = "box.store";
  options.size = size;
  return options;
}

RunParameters parameters_with(double size, std::uint64_t leaf_capacity) {
  RunParameters parameters;
  parameters.size = size;
  parameters.leaf_capacity = leaf_capacity;
  return parameters;
}

constexpr const char* kNothing = "nothing was thrown";

template <class Error, class Action>
std::string message_of(const Action& action) {
  try {
    action();
  } catch (const Error& e) {
    return e.what();
  }
  return kNothing;
}

TEST(PlannedRun, TakesPercentOfTheSmallestSide) {
  const RunRecord run = planned_in_box(options_with({5, true}), {4, 2, 3});
  EXPECT_DOUBLE_EQ(run.parameters.size, 0.1);
  EXPECT_EQ(run.parameters.leaf_capacity, kDefaultLeafCapacity);
  EXPECT_EQ(run.parameters.input_digest, "ab12");
  EXPECT_TRUE(std::filesystem::path(run.surface.file).is_absolute());
  EXPECT_EQ(planned_in_box(options_with({0.5, false}), {4, 2, 3}).parameters.size, 0.5);
}

// A ball has one corner alone: the other, at the origin, once made it reach into the model.
TEST(PlannedRun, TellsOfABallOutsideTheModel) {
  const Box box{{-1, -1, -1}, {1, 1, 1}};
  MeshOptions options = options_with({0.3, false});
  using Kind = SizedShape::Kind;
  options.shapes = {{Kind::kBall, {0.05}, {5, 5, 5}, {}, 1, "the ball"},
                    {Kind::kBall, {0.05}, {1.5, 0, 0}, {}, 1, "the near one"},
                    {Kind::kSegment, {0.05}, {0, 0, 3}, {0, 2, 3}, 0, "the segment"}};
  const RunRecord run = planned_run(options, "ab12", box);
  const std::vector<std::string> notes = notes_on_shapes(options, run.parameters, box);
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_TRUE(notes[0].starts_with("the ball: this shape lies outside the model, 5.93 from"))
      << notes[0];
  EXPECT_TRUE(notes[1].starts_with("the segment: this shape lies outside the model, 2 from"))
      << notes[1];
  options.shapes = {SizedShape::segment({0.05}, {-HUGE_VAL, 0, 0}, {0, 0, 0})};
  EXPECT_THROW(planned_run(options, "ab12", box), InputError);
}

TEST(PlannedRun, RefusesOptionsOutOfRange) {
  const Point surface{1, 1, 1};
  for (const double size : {0.0, -1.0, std::nan(""), HUGE_VAL, 1e-300, 1e300})
    EXPECT_THROW(planned_in_box(options_with({size, false}), surface), InputError) << size;
  for (const double angle : {-1.0, 40.5, std::nan(""), HUGE_VAL}) {
    auto options = options_with({1, true});
    options.min_dihedral = angle;
    EXPECT_THROW(planned_in_box(options, surface), InputError) << angle;
  }
  for (const double floor : {-0.1, 0.6, std::nan("")}) {
    auto options = options_with({1, true});
    options.spacing_floor = floor;
    EXPECT_THROW(planned_in_box(options, surface), InputError) << floor;
  }
}

TEST(PlannedRun, AsksForAnglesUnlessInPaperMode) {
  const auto bound_of = [](const MeshOptions& options) {
    return planned_in_box(options, Point{1, 1, 1}).parameters.min_dihedral;
  };
  auto options = options_with({5, true});
  EXPECT_EQ(bound_of(options), kDefaultMinDihedral);
  options.init = Initialization::kPaper;
  EXPECT_EQ(bound_of(options), 0);
  options.min_dihedral = 12;
  EXPECT_EQ(bound_of(options), 12);
  options.init = Initialization::kCover;
  options.min_dihedral = 0;
  EXPECT_EQ(bound_of(options), 0);
}

TEST(PlannedRun, RefusesCoordinatesBeyondDoubleArithmetic) {
  EXPECT_THROW(planned_in_box(options_with({5, true}), {1e200, 1e200, 1e200}), InputError);
  EXPECT_THROW(planned_in_box(options_with({5, true}), {1e-170, 1e-170, 1e-170}), InputError);
}

TEST(PlanOctree, MakesLeavesThatHoldHalfTheirCapacity) {
  RunParameters parameters = parameters_with(0.01, 20000);
  const OctreePlan plan = plan_octree(parameters, {{0, 0, 0}, {1, 2, 3}});
  const double side = plan.frame.side(plan.level);
  EXPECT_NEAR(side / 0.01, std::cbrt(0.5 * 20000 / 0.3732), 0.01);
  EXPECT_GE(plan.frame.side(0), 3.06);
  EXPECT_TRUE(plan.frame.contains({-0.03, -0.03, -0.03}));
  EXPECT_TRUE(plan.frame.contains({1.03, 2.03, 3.03}));
}

TEST(PlanOctree, KeepsLeavesWideEnoughForTinyCapacities) {
  RunParameters parameters = parameters_with(0.1, 1);
  const OctreePlan plan = plan_octree(parameters, {{0, 0, 0}, {1, 1, 1}});
  EXPECT_GE(plan.frame.side(plan.level), kMinLeafSide * 0.1);
}

TEST(PlanOctree, IsOneLeafWhereThatHoldsAllAndInPaperMode) {
  RunParameters parameters = parameters_with(1, 20000);
  EXPECT_EQ(plan_octree(parameters, {{0, 0, 0}, {1, 1, 1}}).level, 0);
  parameters.size = 0.001;
  parameters.init = Initialization::kPaper;
  EXPECT_EQ(plan_octree(parameters, {{0, 0, 0}, {1, 1, 1}}).level, 0);
}

TEST(PlanOctree, RefusesLeavesBeyondTheDeepestLevel) {
  EXPECT_THROW(plan_octree(parameters_with(1e-9, 50), {{0, 0, 0}, {1, 1, 1}}), InputError);
}

// All places are on one disk, but for those that begin with "other".
DiskOf disks(double free_bytes, double other_free_bytes) {
  return [=](const std::filesystem::path& place) {
    return place.string().starts_with("other") ? Disk{2, other_free_bytes} : Disk{1, free_bytes};
  };
}

std::string refusal(const RunRecord& run, const std::string& output, const DiskOf& disk,
                    const OutputOptions& options = {}) {
  return message_of<InputError>([&] { require_room(run, "no-store", output, options, disk); });
}

constexpr double kPlenty = 1e18;

TEST(RequireRoom, RefusesAThinPlateAtFivePercentOfItsThickness) {
  const RunRecord run = planned_in_box(options_with({5, true}), {2, 2, 2e-6});
  const auto message = refusal(run, "", disks(1e12, kPlenty));
  EXPECT_NE(message.find("choose a size of at least"), std::string::npos) << message;
}

// Nearly all cells are of the lattice core, which is not stored one by one.
TEST(RequireRoom, TakesABillionCellsOfACubeInTenGigabytesButNotTheirFile) {
  RunRecord run = planned_in_box(options_with({0.134, true}), {1, 1, 1});
  EXPECT_NEAR(estimated_num_cells(run.surface, false, run.parameters), 0.95e9, 0.05e9);
  EXPECT_NO_THROW(require_room(run, "no-store", "", {}, disks(1e10, 0)));
  EXPECT_NO_THROW(require_room(run, "no-store", "other/a.vtu", {}, disks(1e10, 3.5e10)));
  const auto message = refusal(run, "other/a.vtu", disks(1e10, 2.5e10));
  EXPECT_NE(message.find("the mesh other/a.vtu would take about 3"), std::string::npos) << message;
  EXPECT_NE(message.find(" where 25 GB are free"), std::string::npos) << message;
  EXPECT_EQ(message.find("store"), std::string::npos) << message;
  run.parameters.init = Initialization::kPaper;
  EXPECT_NE(refusal(run, "", disks(1e10, 0)).find("the store no-store"), std::string::npos);
}

TEST(RequireRoom, AddsUpWhatOneDiskHasToTake) {
  const RunRecord run = planned_in_box(options_with({1, true}), {1, 1, 1});
  const RunEstimate estimate = estimate_run(run.surface, run.parameters);
  const double both = estimate.store_bytes + estimate.output.disk_bytes();
  EXPECT_NO_THROW(require_room(run, "no-store", "a.vtu", {}, disks(1.01 * both, 0)));
  const auto message = refusal(run, "a.vtu", disks(0.99 * both, kPlenty));
  EXPECT_NE(message.find("the store no-store would take about"), std::string::npos) << message;
  EXPECT_NE(message.find(", and the mesh a.vtu would take about"), std::string::npos) << message;
  EXPECT_NO_THROW(require_room(run, "no-store", "other/a.vtu", {}, disks(0.99 * both, kPlenty)));
}

TEST(RequireRoom, AsksForWhatTheFormatTakes) {
  const RunRecord run = planned_in_box(options_with({0.5, true}), {1, 1, 1});  // 19 million cells
  const auto fits = [&](const char* format, bool has_quality, double free_bytes) {
    const OutputOptions options = {*format_named(format), has_quality};
    return refusal(run, "other/a", disks(kPlenty, free_bytes), options) == kNothing;
  };
  EXPECT_FALSE(fits("vtu", false, 0.5e9));
  EXPECT_TRUE(fits("vtkhdf", false, 0.3e9));
  EXPECT_FALSE(fits("vtkhdf", true, 0.3e9));  // 8 bytes a cell lie beside it
  EXPECT_TRUE(fits("msh2", false, 0.8e9));
  EXPECT_FALSE(fits("abaqus", false, 0.8e9));
  // The boundary is small, but what it is found from is not.
  EXPECT_TRUE(fits("stl", false, 0.1e9));
  EXPECT_FALSE(fits("stl", false, 0.03e9));
  const OutputOptions tetgen = {MeshFormat::kTetgen};
  const auto message = refusal(run, "other/a", disks(kPlenty, 0), tetgen);
  EXPECT_NE(message.find(" as tetgen, with temporary files "), std::string::npos) << message;
}

TEST(RequireRoom, NamesEachDiskThatIsTooSmall) {
  const RunRecord run = planned_in_box(options_with({0.1, true}), {1, 1, 1});
  const auto message = refusal(run, "other/a.vtu", disks(1e8, 2e9));
  EXPECT_NE(message.find("where 0.1 GB are free; the mesh other/a.vtu"), std::string::npos)
      << message;
  EXPECT_NE(message.find("where 2 GB are free; choose"), std::string::npos) << message;
}

TEST(RequireRoom, NamesNoSizeForADiskThatIsFull) {
  const RunRecord run = planned_in_box(options_with({1, true}), {1, 1, 1});
  for (const char* output : {"", "a.vtu"}) {
    const auto message = refusal(run, output, disks(0, 0));
    EXPECT_NE(message.find("0 GB are free; choose a larger disk"), std::string::npos) << message;
  }
}

TEST(RequireRoom, OfAFinishedRunIsByItsCounts) {
  RunRecord run = planned_in_box(options_with({1, true}), {1, 1, 1});  // for 2.4 million cells
  run.phase = Phase::kDone;
  run.counts.num_cells = 100'000'000;
  run.counts.num_points = 18'000'000;
  const auto message = refusal(run, "a.vtu", disks(2.9e9, 0));
  EXPECT_NE(message.find("the mesh a.vtu would take about 2.93 GB"), std::string::npos) << message;
  EXPECT_NE(message.find("choose another format"), std::string::npos) << message;
  EXPECT_EQ(message.find("store"), std::string::npos) << message;
  EXPECT_EQ(refusal(run, "a.vtu", disks(3.1e9, 0)), kNothing);
}

TEST(RequireRoom, NamesASizeThatFits) {
  const RunRecord run = planned_in_box(options_with({0.1, true}), {1, 1, 1});
  for (const char* output : {"", "a.vtu", "other/a.vtu"}) {
    const DiskOf disk = disks(9e8, 2e9);
    const auto message = refusal(run, output, disk);
    const std::string words = "choose a size of at least ";
    const auto place = message.find(words);
    ASSERT_NE(place, std::string::npos) << message;
    RunRecord larger = run;
    larger.parameters.size = 1.01 * std::stod(message.substr(place + words.size()));
    EXPECT_NO_THROW(require_room(larger, "no-store", output, {}, disk));
    EXPECT_LT(larger.parameters.size, 0.1);
  }
}

// A pipe whose wall is a tenth of λ: by volume and area alone it would be told to take 160 kB.
TEST(RequireRoom, OfAThinWallIsForWhatItTakes) {
  RunRecord run = planned_in_box(options_with({1, false}), {20, 20, 50});
  run.surface.volume = 312;
  run.surface.area = 6263;
  run.surface.facing = {1000, {{.step = -107, .num_walls = 990}}};  // 0.1
  const auto message = refusal(run, "a.vtu", disks(2e7, 0));
  EXPECT_NE(message.find("in walls about 0.1 thick"), std::string::npos) << message;
  EXPECT_NE(message.find("choose a larger disk"), std::string::npos) << message;  // no size helps
  EXPECT_EQ(refusal(run, "a.vtu", disks(2e8, 0)), kNothing);
  run.surface.facing.places.clear();
  EXPECT_EQ(refusal(run, "a.vtu", disks(2e7, 0)), kNothing);
}

TEST(RequireRoom, OfARunThatGoesOnIsForTheRest) {
  const TempDir dir;
  std::filesystem::create_directory(dir / "store");
  RunRecord run = planned_in_box(options_with({1, true}), {1, 1, 1});
  const RunEstimate estimate = estimate_run(run.surface, run.parameters);
  const DiskOf disk = [&](const std::filesystem::path&) {
    return Disk{1, estimate.output.disk_bytes() + 0.2 * estimate.store_bytes};
  };
  const auto require = [&] { require_room(run, dir / "store", "a.vtu", {}, disk); };
  EXPECT_THROW(require(), InputError);
  std::ofstream(dir / "store" / "data.mdb");
  std::filesystem::resize_file(dir / "store" / "data.mdb",
                               static_cast<std::uintmax_t>(0.9 * estimate.store_bytes));
  EXPECT_NO_THROW(require());
  std::filesystem::resize_file(dir / "store" / "data.mdb", 0);
  EXPECT_THROW(require(), InputError);
  run.phase = Phase::kDone;
  EXPECT_NO_THROW(require());
}

TEST(DiskOf, ADirectoryYetToBeMadeIsThatOfItsParent) {
  EXPECT_GT(disk_of("no/such/directory").free_bytes, 0);
  EXPECT_EQ(disk_of("no/such/directory").id, disk_of(".").id);
}

TEST(RequireSameRun, NamesEachOptionThatDiffersWithBothValues) {
  RunRecord held;
  held.parameters = parameters_with(0.1, 100);
  held.surface.file = "/there/part.stl";
  held.phase = Phase::kRefine;
  held.counts.num_cells = 1234;
  EXPECT_NO_THROW(require_same_run(held, held, "dir"));
  RunRecord asked = held;
  asked.parameters.size = 0.25;
  asked.parameters.init = Initialization::kPaper;
  auto message = message_of<StoreMismatch>([&] { require_same_run(held, asked, "dir"); });
  for (const char* text : {"the store dir", "--size is 0.1 in it, and 0.25 here",
                           "--init is cover in it, and paper here", "not done, with 1234 cells",
                           "--force", "--store", "`resume dir` goes on with it"})
    EXPECT_NE(message.find(text), std::string::npos) << text << " in " << message;
  EXPECT_EQ(message.find("seed"), std::string::npos) << message;

  held.phase = Phase::kDone;
  held.counts.num_unresolved = 3;
  message = message_of<StoreMismatch>([&] { require_same_run(held, asked, "dir"); });
  EXPECT_NE(message.find("is done, with 3 unresolved sites"), std::string::npos) << message;
  EXPECT_NE(message.find("writes its mesh again"), std::string::npos) << message;
}

TEST(RequireSameRun, TellsAChangedSurfaceByNameSizeAndTime) {
  const TempDir dir;
  const std::string file = (dir / "part.stl").string();
  std::ofstream(file) << "12345";
  RunRecord held;
  held.parameters = parameters_with(0.1, 100);
  held.surface.file = file;
  RunRecord asked = held;
  asked.parameters.input_digest = "cd";
  // Of a moment that is on 2023-11-14 everywhere but for the zones farthest from Greenwich.
  auto message =
      message_of<StoreMismatch>([&] { require_same_run(held, asked, "dir", 1'700'000'000); });
  for (const std::string& text : {file, std::string("2023-11-1"), std::string("5 bytes")})
    EXPECT_NE(message.find(text), std::string::npos) << text << " in " << message;
  EXPECT_EQ(message.find("cd"), std::string::npos) << message;

  held.surface.file = "/there/other.stl";
  message = message_of<StoreMismatch>([&] { require_same_run(held, asked, "dir"); });
  EXPECT_NE(message.find("/there/other.stl"), std::string::npos) << message;
  EXPECT_NE(message.find(file), std::string::npos) << message;
  asked.surface.file = held.surface.file = kInMemory;
  EXPECT_THROW(require_same_run(held, asked, "dir"), StoreMismatch);
}

TEST(IsInVain, WithoutPointsOrWithoutACellAtTheEnd) {
  RunRecord run;
  run.phase = Phase::kSize;
  EXPECT_TRUE(is_in_vain(run));
  run.phase = Phase::kRefine;
  run.counts.num_points = 7;
  EXPECT_FALSE(is_in_vain(run));
  run.phase = Phase::kDone;
  EXPECT_TRUE(is_in_vain(run));
  run.counts.num_cells = 1;
  EXPECT_FALSE(is_in_vain(run));
}

}  // namespace
}  // namespace locvol
