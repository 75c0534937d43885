// CAD files from end to end: whole runs of shapes that OpenCASCADE makes, against what it says of
// them itself.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <BRepBuilderAPI_Transform.hxx>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <gp_Trsf.hxx>
#include <gp_Vec.hxx>
#include <map>
#include <numbers>
#include <random>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/ingest/surface_survey.h"
#include "engine/inspect/crease_table.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/plan/same_run.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/stop_source.h"
#include "tests/engine/described.h"
#include "tests/engine/store_contents.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/tools/cad/cad_shapes.h"

namespace locvol {
namespace {

class Cad : public testing::Test {
 protected:
  std::filesystem::path step(const CadShape& shape, const std::string& unit = "MM") {
    const std::filesystem::path file = dir_ / (shape.name + ".step");
    write_step(shape, file, unit);
    return file;
  }

  // Given up after `seconds`.
  SurveyedSurface surveyed(const std::filesystem::path& file, SurveyLaw law = {},
                           std::chrono::seconds seconds = std::chrono::seconds(300)) {
    const auto end = std::chrono::steady_clock::now() + seconds;
    const StopSource stop([end] { return std::chrono::steady_clock::now() > end; });
    IngestWatch watch(&stop, {});
    Workers workers(1);
    law.has_sheets = true;
    law.sharp_angle = 40;
    return survey_surface(surface_at(file, dir_.path()), dir_.path(), watch, workers, law);
  }

  MeshOptions options(const std::filesystem::path& file, const Size& size,
                      const std::string& store = "store") {
    MeshOptions options;
    options.input = file;
    options.size = size;
    options.store = dir_ / store;
    return options;
  }
  RunSummary meshed(const MeshOptions& options) {
    RunControl control;
    control.num_threads = 1;
    return mesh(options, control);
  }

  // What the file is refused for.
  std::string refusal(const std::filesystem::path& file) {
    try {
      surveyed(file);
    } catch (const InputError& error) {
      return error.what();
    }
    return {};
  }

  TempDir dir_;
};

std::set<std::string> names_of(const SurfaceSheets& sheets) {
  std::set<std::string> names;
  for (const SheetFacts& sheet : sheets.sheets) names.insert(sheet.name);
  return names;
}

// ---- Shapes

class CadShapes : public Cad, public testing::WithParamInterface<const char*> {};

// Bodies, faces, volumes, creases: all that the file has, and the mesh is valid.
TEST_P(CadShapes, AreMeshedAsTheyAre) {
  const CadShape shape = cad_shape(GetParam());
  const MeshOptions asked = options(step(shape), Size::percent(4));
  const RunSummary run = meshed(asked);
  EXPECT_EQ(run.outcome, RunOutcome::kDone);
  EXPECT_EQ(run.run.counts.num_unresolved, 0U);
  const Store store = Store::open(asked.store, {.read_only = true});
  const AuditReport report = audit(store);
  EXPECT_TRUE(report.is_valid()) << described(report);

  const std::size_t num_bodies = shape.solids.size();
  EXPECT_EQ(run.sheets.bodies.size(), num_bodies > 1 ? num_bodies : 0);
  int num_faces = 0;
  double volume = 0;
  for (const TopoDS_Shape& solid : shape.solids) {
    num_faces += num_faces_of(solid);
    volume += volume_of(solid);
  }
  // Where the post stands on the base, a face has two sides, and the other is a part of it.
  EXPECT_EQ(run.sheets.sheets.size(), static_cast<std::size_t>(num_faces));
  EXPECT_NEAR(run.run.surface.volume / volume, 1, 0.002);
  const MeshStatistics statistics = mesh_statistics(store);
  EXPECT_NEAR(statistics.volume / run.run.surface.volume, 1, 0.006);
  for (std::size_t b = 0; b < run.sheets.bodies.size(); ++b)
    EXPECT_NEAR(run.sheets.bodies[b].volume / volume_of(shape.solids[b]), 1, 0.002) << b;

  const CreaseTable kept = crease_table(store);
  EXPECT_TRUE(kept.not_whole.empty());
  EXPECT_GT(kept.length, 0);
}

INSTANTIATE_TEST_SUITE_P(OfOpenCascade, CadShapes,
                         testing::Values("flange", "pipe", "gear", "shell", "loft", "fillet_5",
                                         "fillet_10", "fillet_30", "fillet_100", "contact",
                                         "assembly"),
                         [](const auto& name) { return std::string(name.param); });

// ---- Contacts

class CadContacts : public Cad, public testing::WithParamInterface<const char*> {};

// What faces of two solids have in common is cut once, however these faces were made, and the faces
// of the file stay what they are.
TEST_P(CadContacts, HaveTheSameTrianglesOnBothSides) {
  const CadShape shape = cad_shape(GetParam());
  const MeshOptions asked = options(step(shape), Size::length(2));
  const RunSummary run = meshed(asked);
  EXPECT_EQ(run.run.counts.num_unresolved, 0U);
  for (const std::string& note : run.run.surface.notes)
    EXPECT_EQ(note.find(" cross"), note.npos) << note;
  const AuditReport report = audit(Store::open(asked.store, {.read_only = true}));
  EXPECT_TRUE(report.is_valid()) << described(report);

  ASSERT_EQ(run.sheets.bodies.size(), shape.solids.size());
  constexpr double kOfCircles = 0.005;  // what a circle loses to edges that turn by 20 degrees
  double volume = 0;
  for (std::size_t b = 0; b < shape.solids.size(); ++b) {
    volume += run.sheets.bodies[b].volume;
    EXPECT_LT(run.sheets.bodies[b].volume / volume_of(shape.solids[b]), 1 + kOfCircles) << b;
  }
  EXPECT_NEAR(volume / united_volume_of(shape.solids), 1, kOfCircles);
  int num_faces = 0;
  for (const TopoDS_Shape& solid : shape.solids) num_faces += num_faces_of(solid);
  std::set<std::string> faces;
  for (const SheetFacts& sheet : run.sheets.sheets) faces.insert(sheet.group);
  EXPECT_LE(faces.size(), static_cast<std::size_t>(num_faces));
  // All of a face may be on others, which then have what they have in common.
  EXPECT_GE(faces.size(), static_cast<std::size_t>(num_faces) / 2);
}

INSTANTIATE_TEST_SUITE_P(OfOpenCascade, CadContacts,
                         testing::Values("pins", "pressed", "ball", "peg", "within", "stacked",
                                         "rack"),
                         [](const auto& name) { return std::string(name.param); });

TEST_F(Cad, SolidsThatOverlapAreToldByTheirVolume) {
  const CadShape pressed = cad_shape("pressed");
  const SurveyedSurface survey = surveyed(step(pressed), {.size = Size::length(1)});
  const double overlap = 10 * std::numbers::pi * (6.3 * 6.3 - 6 * 6);
  bool is_told = false;
  for (const std::string& note : survey.facts.notes)
    if (const auto at = note.find("in a volume of "); at != note.npos) {
      is_told = true;
      EXPECT_NEAR(std::stod(note.substr(at + 15)) / overlap, 1, 0.01) << note;
    }
  EXPECT_TRUE(is_told);
}

// CAD programs know places to 10^-7 mm: solids that touch may be so far apart in the file, or
// overlap so much. Those of one file are fused, those of two are brought together, with a note.
TEST_F(Cad, SolidsThatTouchAsPreciselyAsCadFilesAreTouch) {
  for (const char* unit : {"MM", "INCH"})
    for (const double off : {6e-8, -6e-8})
      for (const bool is_one_file : {true, false}) {
        const std::string name = std::string(unit) + (off > 0 ? "_apart" : "_overlapping") +
                                 (is_one_file ? "" : "_in_two_files");
        SCOPED_TRACE(name);
        CadShape shape = cad_shape("contact");
        const int num_faces = num_faces_of(shape.solids[0]) + num_faces_of(shape.solids[1]);
        gp_Trsf move;
        move.SetTranslation(gp_Vec(3e-8, 0, off));
        shape.solids[1] = BRepBuilderAPI_Transform(shape.solids[1], move, true).Shape();
        shape.name = name;
        MeshOptions asked = options(step(shape, unit), Size::percent(4), name);
        if (!is_one_file) {
          asked.input = step({name + "_base", {shape.solids[0]}}, unit);
          asked.more_inputs = {step({name + "_post", {shape.solids[1]}}, unit)};
        }
        const RunSummary run = meshed(asked);
        EXPECT_EQ(run.run.counts.num_unresolved, 0U);
        ASSERT_EQ(run.sheets.bodies.size(), 2U);
        EXPECT_EQ(run.sheets.sheets.size(), static_cast<std::size_t>(num_faces));
        const bool is_told = std::ranges::any_of(run.run.surface.notes, [](const auto& note) {
          return note.find("which is how precise coordinates are") != note.npos;
        });
        EXPECT_EQ(is_told, !is_one_file);
        const AuditReport report = audit(Store::open(asked.store, {.read_only = true}));
        EXPECT_TRUE(report.is_valid()) << described(report);
      }
}

// ---- Names, colors, units

TEST_F(Cad, FacesHaveTheNamesAndColorsOfTheFile) {
  const SurveyedSurface survey = surveyed(step(cad_shape("names")), {.size = Size::length(1)});
  EXPECT_EQ(names_of(survey.sheets),
            (std::set<std::string>{"bottom", "top", "bolt_1", "bolt_2", "face 1", "face 2",
                                   "face 4", "face 6", "face 9"}));
  for (const SheetFacts& sheet : survey.sheets.sheets) {
    const bool is_named = !sheet.group.starts_with("face");
    ASSERT_EQ(sheet.color.has_value(), is_named) << sheet.name;
    if (is_named) {
      EXPECT_EQ(*sheet.color, (Color{255, 0, 0}));
    }
    if (sheet.name == "top") {
      EXPECT_EQ(sheet.centroid.z, 10);
    }
    if (sheet.group == "bolt") {
      EXPECT_NEAR(sheet.centroid.y, 15, 1e-9);
    }
  }
}

TEST_F(Cad, BodiesHaveTheNamesOfTheFile) {
  const SurveyedSurface survey = surveyed(step(cad_shape("contact")));
  ASSERT_EQ(survey.sheets.bodies.size(), 2U);
  EXPECT_EQ(survey.sheets.bodies[0].name, "base");
  EXPECT_EQ(survey.sheets.bodies[1].name, "post");
}

// The file tells where parts are by instances of them, which have a number, and here no name.
TEST_F(Cad, ANumberOfAnInstanceIsNoName) {
  CadShape shape = cad_shape("contact");
  shape.is_assembly = true;
  const std::filesystem::path file = step(shape);
  std::string text = std::regex_replace(
      bytes_of(file), std::regex(R"((NEXT_ASSEMBLY_USAGE_OCCURRENCE\('[^']*',)'[^']*')"), "$1''");
  std::ofstream(file) << text;
  const SurveyedSurface nameless = surveyed(file);
  ASSERT_EQ(nameless.sheets.bodies.size(), 2U);
  for (const BodyFacts& body : nameless.sheets.bodies)
    EXPECT_TRUE(body.name.starts_with("contact")) << body.name;  // of what they are in

  for (const char* name : {"solid A", "solid B"}) {
    const std::string before = "MANIFOLD_SOLID_BREP(''";
    text.replace(text.find(before), before.size(),
                 "MANIFOLD_SOLID_BREP('" + std::string(name) + "'");
  }
  std::ofstream(file) << text;
  const SurveyedSurface named = surveyed(file);
  ASSERT_EQ(named.sheets.bodies.size(), 2U);
  EXPECT_EQ(named.sheets.bodies[0].name, "solid A");
  EXPECT_EQ(named.sheets.bodies[1].name, "solid B");
}

TEST_F(Cad, CoordinatesAreInTheUnitOfTheFile) {
  const CadShape plate = cad_shape("plate");
  for (const auto& [unit, length] : {std::pair("MM", 1.0), {"INCH", 25.4}, {"M", 1000.0}}) {
    const SurveyedSurface survey = surveyed(step(plate, unit));
    EXPECT_NEAR(survey.facts.box.max.x, 80 / length, 1e-9 / length) << unit;
    EXPECT_NEAR(survey.facts.box.max.z, 10 / length, 1e-9 / length) << unit;
    EXPECT_EQ(std::ranges::count_if(
                  survey.facts.notes,
                  [](const std::string& note) { return note.find("unit") != note.npos; }),
              1);
  }
}

// ---- Other formats

TEST_F(Cad, IgesAndBrepAreReadToo) {
  for (const char* name : {"flange", "contact"}) {
    const CadShape shape = cad_shape(name);
    double volume = 0;
    for (const TopoDS_Shape& solid : shape.solids) volume += volume_of(solid);
    write_brep(shape, dir_ / "shape.brep");
    write_iges(shape, dir_ / "shape.igs");  // faces alone, which are sewn
    for (const char* file : {"shape.brep", "shape.igs"}) {
      const SurveyedSurface survey = surveyed(dir_ / file, {.size = Size::length(1)});
      EXPECT_EQ(survey.sheets.bodies.size(), shape.solids.size() > 1 ? 2U : 0U) << file;
      EXPECT_NEAR(survey.facts.volume / volume, 1, 0.002) << file;
    }
  }
}

TEST_F(Cad, WhatTheFileHoldsDecides) {
  const CadShape plate = cad_shape("plate");
  std::filesystem::rename(step(plate), dir_ / "plate.p21");
  EXPECT_NEAR(surveyed(dir_ / "plate.p21").facts.volume / volume_of(plate.solids[0]), 1, 0.002);
  std::filesystem::rename(dir_ / "plate.p21", dir_ / "plate.stl");
  EXPECT_NEAR(surveyed(dir_ / "plate.stl").facts.volume / volume_of(plate.solids[0]), 1, 0.002);
}

TEST_F(Cad, WhatIsPackedOrComesThroughTheStandardInputIsRead) {
  const CadShape plate = cad_shape("plate");
  const std::filesystem::path file = step(plate);
  const double volume = volume_of(plate.solids[0]);
  const int before = ::dup(STDIN_FILENO), input = ::open(file.c_str(), O_RDONLY);
  ::dup2(input, STDIN_FILENO);
  ::close(input);
  const SurveyedSurface survey = surveyed("-");
  ::dup2(before, STDIN_FILENO);
  ::close(before);
  EXPECT_NEAR(survey.facts.volume / volume, 1, 0.002);
  ASSERT_EQ(std::system(("gzip -k " + file.string()).c_str()), 0);
  EXPECT_NEAR(surveyed(file.string() + ".gz").facts.volume / volume, 1, 0.002);
}

// ---- Finer where λ asks for it

TEST_F(Cad, FacesAreCutAsFineAsTheSizeAsksFor) {
  const CadShape post{"post", {cad_shape("contact").solids[1]}};
  const std::filesystem::path file = step(post);
  const double volume = volume_of(post.solids[0]);
  double before = 1;
  for (const double size : {8.0, 2.0, 0.5}) {
    const double error =
        std::abs(surveyed(file, {.size = Size::length(size)}).facts.volume / volume - 1);
    EXPECT_LT(error, before / 2) << size;
    before = error;
  }
}

// ---- The same run

TEST_F(Cad, ARunGoesOnToTheSameBytes) {
  const MeshOptions whole = options(step(cad_shape("flange")), Size::percent(6), "whole");
  meshed(whole);
  MeshOptions stopped = whole;
  stopped.store = dir_ / "stopped";
  // In the middle of what is read, and later on.
  for (int num_asked = 1; num_asked < 200; num_asked += 1 + num_asked / 2) {
    RunControl control;
    control.num_threads = 1;
    control.is_stopped = [n = 0, num_asked]() mutable { return ++n > num_asked; };
    try {
      mesh(stopped, control);
    } catch (const Stopped&) {
      // Nothing is in the store yet.
    }
  }
  meshed(stopped);
  EXPECT_EQ(contents_of(stopped.store), contents_of(whole.store));
}

TEST_F(Cad, ResumeCutsFacesAsTheRunDid) {
  const MeshOptions whole = options(step(cad_shape("contact")), Size::percent(6), "whole");
  meshed(whole);
  MeshOptions asked = whole;
  asked.store = dir_ / "stopped";
  RunControl control;
  control.num_threads = 1;
  bool has_begun = false;
  control.on_run = [&](const RunRecord&) { has_begun = true; };
  control.is_stopped = [&] { return has_begun; };
  try {
    mesh(asked, control);
  } catch (const Stopped&) {
  }
  ASSERT_TRUE(Store::exists(asked.store));
  RunControl on;
  on.num_threads = 1;
  resume(asked.store, on);
  EXPECT_EQ(contents_of(asked.store), contents_of(whole.store));
}

TEST_F(Cad, AnotherSizeIsAnotherRun) {
  const std::filesystem::path file = step(cad_shape("loft"));
  meshed(options(file, Size::percent(8)));
  EXPECT_THROW(meshed(options(file, Size::percent(9))), StoreMismatch);
}

// ---- Sizes by face

TEST_F(Cad, SizesAreGivenForFacesByNameNumberAndPlace) {
  const std::filesystem::path file = step(cad_shape("names"));
  std::map<std::string, std::uint64_t> num_cells;
  for (const std::string name : {"top", "#3", "near 40,25,11", "near 40 25 10"}) {
    MeshOptions asked = options(file, Size::length(3), "by " + name);
    asked.sheets = {{name, Size::length(1.5), {}}};
    num_cells[name] = meshed(asked).run.counts.num_cells;
  }
  for (const auto& [name, num] : num_cells) EXPECT_EQ(num, num_cells["top"]) << name;
  MeshOptions asked = options(file, Size::length(3), "other");
  asked.sheets = {{"#77", Size::length(1.5), {}}};
  EXPECT_THROW(meshed(asked), InputError);
}

// ---- Several files

TEST_F(Cad, ACadFileAndAMeshAreBodiesTogether) {
  const std::filesystem::path base = step({"base", {cad_shape("contact").solids[0]}});
  const std::filesystem::path box = dir_ / "top.off";
  std::ofstream(box) << "OFF\n8 6 0\n0 0 10\n40 0 10\n40 40 10\n0 40 10\n0 0 20\n40 0 20\n40 40 "
                        "20\n0 40 20\n4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 "
                        "4 7\n";
  MeshOptions asked = options(base, Size::percent(20));
  asked.more_inputs = {box};
  const RunSummary run = meshed(asked);
  ASSERT_EQ(run.sheets.bodies.size(), 2U);
  EXPECT_EQ(run.sheets.bodies[0].name, "base");
  EXPECT_EQ(run.sheets.bodies[1].name, "top");
  EXPECT_NEAR(run.sheets.bodies[1].volume, 16000, 1e-6);
}

// ---- Files that are broken

TEST_F(Cad, WhatIsNoCadFileIsRefusedWithItsName) {
  for (const char* name : {"a.step", "a.stp", "a.iges", "a.brep"}) {
    std::ofstream(dir_ / name) << "What is this?\n";
    EXPECT_NE(refusal(dir_ / name).find(name), std::string::npos);
    EXPECT_NE(refusal(dir_ / name).find("does not begin with"), std::string::npos);
  }
  std::ofstream(dir_ / "empty.step");
  EXPECT_NE(refusal(dir_ / "empty.step").find("is empty"), std::string::npos);
}

TEST_F(Cad, AFileThatIsCutOffIsRefused) {
  const std::string bytes = bytes_of(step(cad_shape("flange")));
  for (const double share : {0.001, 0.02, 0.3, 0.7, 0.99}) {
    const std::filesystem::path file = dir_ / "cut.step";
    std::ofstream(file) << bytes.substr(
        0, static_cast<std::size_t>(share * static_cast<double>(bytes.size())));
    const std::string text = refusal(file);
    EXPECT_NE(text.find("cut.step"), std::string::npos) << share;
  }
}

// Never a crash: it is read as something, or refused. Some are more than anyone would wait for, as
// a face that has become a thousand times as large: there a stop ends it.
TEST_F(Cad, BytesThatAreWrongDoNoHarm) {
  std::mt19937 random(7);
  struct Trial {
    const char *shape, *name;
    int num_rounds;
  };
  for (const auto& [of, name, num_rounds] : {Trial{"loft", "shape.step", 12},
                                             {"loft", "shape.igs", 12},
                                             {"loft", "shape.brep", 12},
                                             {"peg", "shape.step", 4},
                                             {"rack", "shape.brep", 4}}) {
    const CadShape shape = cad_shape(of);
    write_step(shape, dir_ / "shape.step");
    write_iges(shape, dir_ / "shape.igs");
    write_brep(shape, dir_ / "shape.brep");
    const std::string bytes = bytes_of(dir_ / name);
    for (int round = 0; round < num_rounds; ++round) {
      std::string damaged = bytes;
      for (int i = 0; i < 1 + round / 5; ++i)
        damaged[100 + random() % (damaged.size() - 100)] =
            "0123456789#(),.;'$*E-A\n"[random() % 23];
      if (round % 5 == 4) damaged.resize(random() % damaged.size());
      std::ofstream(dir_ / name) << damaged;
      try {
        surveyed(dir_ / name, {.size = Size::percent(10)}, std::chrono::seconds(2));
      } catch (const Stopped&) {
      } catch (const std::runtime_error& error) {
        EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
      }
    }
  }
}

TEST_F(Cad, ABoxWithoutALidNamesWhatWouldMeshIt) {
  CadShape open{"open", {}};
  open.solids = {shell_without_a_face(cad_shape("shell").solids[0])};
  const std::string text = refusal(step(open));
  EXPECT_NE(text.find("not closed"), std::string::npos) << text;
  EXPECT_NE(text.find("--inside winding"), std::string::npos) << text;
}

TEST_F(Cad, ACapThatIsTooSmallIsToldBeforeTheFileIsRead) {
  const std::filesystem::path file = step(cad_shape("gear"));
  EXPECT_THROW(surveyed(file, {.memory_cap = 1 << 20}), OverBudget);
}

}  // namespace
}  // namespace locvol
