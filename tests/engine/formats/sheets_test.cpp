// Sheets of a mesh in each format that has words for them.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "engine/formats/sheet_names.h"
#include "engine/formats/writer.h"
#include "engine/ingest/surface_input.h"
#include "engine/output/mesh_source.h"
#include "tests/engine/hand_made_mesh.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using Triangle3 = std::array<Point, 3>;

// Which side of the box from 0 to 3 the facet lies in: the lower one of an axis, then the upper
// one.
SheetId side_of(const Triangle3& corners) {
  for (int axis = 0; axis < 3; ++axis)
    for (const double end : {0.0, 3.0})
      if (std::ranges::all_of(corners, [&](const Point& p) { return p[axis] == end; }))
        return static_cast<SheetId>(2 * axis + (end > 0) + 1);
  ADD_FAILURE() << "a facet in no side";
  return 1;
}

const std::vector<std::string> kNames = {"inlet",  "outlet \"A\"", "wall 1",
                                         "WALL 1", "Einlaß/ #",    "7th side"};

class SheetsOfABox : public testing::Test {
 protected:
  SheetsOfABox() : made_(cubes(3, [](int, int, int) { return true; }), mixed_octree()) {
    made_.sheet_of = side_of;
    for (const std::string& name : kNames) {
      SheetFacts facts;
      facts.name = facts.group = name;
      facts.box = {{0, 0, 0}, {3, 3, 3}};
      made_.sheets.sheets.push_back(facts);
    }
    store_.emplace(made_.write(dir_ / "store"));
  }

  std::string written(MeshFormat format, const std::string& name) {
    const WriteSummary summary = write_mesh(*store_, dir_ / name, {format, false}, 2);
    EXPECT_EQ(summary.num_boundary_facets, 108U);
    std::string bytes = bytes_of(dir_ / name);
    EXPECT_EQ(bytes.size(), summary.bytes);
    return bytes;
  }

  // Of a surface file: the names of sides, by their numbers, and how many triangles each has.
  std::map<std::string, int> read_back(const std::string& name) {
    IngestWatch watch;
    const RawSurface raw = read_surface(dir_ / name, dir_.path(), watch);
    std::map<std::string, int> found;
    std::map<std::string, std::set<SheetId>> sides;
    for (const TriangleList& list : raw.triangles)
      raw.spill.for_each(list, [&](const Triangle& t) {
        ++found[raw.groups[t.sheet - 1]];
        sides[raw.groups[t.sheet - 1]].insert(side_of(t.corners));
      });
    for (const auto& [group, of_group] : sides) EXPECT_EQ(of_group.size(), 1U) << group;
    return found;
  }

  TempDir dir_;
  HandMadeStore made_;
  std::optional<Store> store_;
};

TEST_F(SheetsOfABox, FacetsAndVerticesComeSheetBySheet) {
  for (const LinearOctree& octree : octrees()) {
    HandMadeStore made(cubes(3, [](int, int, int) { return true; }), octree);
    made.sheet_of = side_of;
    made.sheets = made_.sheets;
    const TempDir dir;
    const Store store = made.write(dir / "store");
    MeshSource mesh(store, dir / "mesh", 1);
    BoundarySurface& boundary = mesh.boundary();
    EXPECT_EQ(boundary.num_vertices(), 56U);
    boundary.sort_facets();
    ASSERT_EQ(boundary.num_sheets(), 6U);
    std::uint64_t num_facets = 0;
    for (SheetId sheet = 1; sheet <= 6; ++sheet) {
      EXPECT_EQ(boundary.num_facets_of(sheet), 18U);
      EXPECT_EQ(boundary.first_own_facet_of(sheet), num_facets);
      std::set<std::uint64_t> vertices;
      const auto facets = boundary.facets_of(sheet, {.has_corners = true});
      while (const auto some = facets()) {
        EXPECT_EQ(some->first, num_facets);
        num_facets += some->facets.size();
        EXPECT_TRUE(std::ranges::is_sorted(some->facets, {}, &BoundaryFacet::cell));
        for (const Triangle3& corners : some->corners) EXPECT_EQ(side_of(corners), sheet);
        for (const BoundaryFacet& facet : some->facets)
          vertices.insert(facet.vertices.begin(), facet.vertices.end());
      }
      EXPECT_EQ(boundary.num_vertices_of(sheet), 16U);
      std::vector<std::uint64_t> listed;
      const auto next = boundary.vertices_of(sheet);
      while (const auto some = next()) {
        EXPECT_EQ(some->first, listed.size());
        listed.insert(listed.end(), some->vertices.begin(), some->vertices.end());
      }
      EXPECT_TRUE(std::ranges::equal(listed, vertices));
    }
    EXPECT_EQ(num_facets, boundary.num_facets());
  }
}

// More records than memory holds wait in a file beside the output, which is not there yet.
TEST(BySheet, SortsMoreThanMemoryHolds) {
  const TempDir dir;
  BySheet<std::uint64_t> sorted(dir / "mesh.msh", 3);
  constexpr std::uint64_t kNum = 1'000'000;
  for (std::uint64_t i = 0; i < kNum; ++i) sorted.append(static_cast<SheetId>(i % 3 + 1), i);
  sorted.finish(alone());
  for (SheetId sheet = 1; sheet <= 3; ++sheet) {
    const std::uint64_t num = sorted.num_own(sheet);
    EXPECT_EQ(num, (kNum + 3 - sheet) / 3);
    const std::vector<std::uint64_t> all = sorted.read(sheet, 0, num);
    for (std::uint64_t i = 0; i < num; ++i) ASSERT_EQ(all[i], 3 * i + sheet - 1);
  }
}

TEST_F(SheetsOfABox, TextOfStlHasASolidEach) {
  written(MeshFormat::kStlText, "box.stl");
  std::map<std::string, int> expected;
  for (const std::string& name : kNames) expected[name] = 18;
  EXPECT_EQ(read_back("box.stl"), expected);
}

TEST_F(SheetsOfABox, PlyHasAProperty) {
  const std::string bytes = written(MeshFormat::kPly, "box.ply");
  EXPECT_NE(bytes.find("comment sheet 5: Einlaß/ #\n"), std::string::npos);
  const std::map<std::string, int> found = read_back("box.ply");
  EXPECT_EQ(found.size(), 6U);
  EXPECT_EQ(found.at("sheet 6"), 18);
}

TEST_F(SheetsOfABox, ObjHasGroups) {
  written(MeshFormat::kObj, "box.obj");
  const std::map<std::string, int> found = read_back("box.obj");
  EXPECT_EQ(found.size(), 6U);
  EXPECT_EQ(found.at("outlet_\"A\""), 18);
  EXPECT_EQ(found.at("Einlaß/__"), 18);
}

TEST_F(SheetsOfABox, MeditHasReferences) {
  std::istringstream text(written(MeshFormat::kMedit, "box.mesh"));
  std::string word;
  std::size_t count = 0;
  std::vector<Point> points;
  while (text >> word && word != "Vertices") continue;
  text >> count;
  points.resize(count);
  for (Point& p : points) text >> p.x >> p.y >> p.z >> word;
  while (text >> word && word != "Triangles") continue;
  text >> count;
  EXPECT_EQ(count, 108U);
  for (std::size_t i = 0; i < count; ++i) {
    std::size_t a = 0, b = 0, c = 0;
    SheetId reference = 0;
    text >> a >> b >> c >> reference;
    EXPECT_EQ(reference, side_of({points.at(a - 1), points.at(b - 1), points.at(c - 1)}));
  }
}

TEST_F(SheetsOfABox, VtuHasTrianglesAsCells) {
  const OutputOptions options = {MeshFormat::kVtu, true, false, true};
  const WriteSummary summary = write_mesh(*store_, dir_ / "box.vtu", options, 2);
  EXPECT_EQ(summary.num_boundary_facets, 108U);
  const VtuArrays vtu(dir_ / "box.vtu");
  const auto points = vtu.array<double>("Float64", "Points");
  const auto corners = vtu.array<std::int32_t>("Int32", "connectivity");
  const auto sheets = vtu.array<SheetId>("UInt32", "sheet");
  const auto angles = vtu.array<float>("Float32", "min_dihedral_degrees");
  const auto types = vtu.array<std::uint8_t>("UInt8", "types");
  ASSERT_EQ(sheets.size(), summary.num_cells + 108);
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const bool is_triangle = i >= summary.num_cells;
    EXPECT_EQ(types.at(i), is_triangle ? 5 : 10);
    EXPECT_EQ(std::isnan(angles.at(i)), is_triangle);
    if (!is_triangle) {
      EXPECT_EQ(sheets[i], 0U);
      continue;
    }
    Triangle3 triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto corner = static_cast<std::size_t>(
          corners.at(4 * summary.num_cells + 3 * (i - summary.num_cells) + k));
      triangle[k] = {points.at(3 * corner), points.at(3 * corner + 1), points.at(3 * corner + 2)};
    }
    EXPECT_EQ(sheets[i], side_of(triangle));
  }
}

TEST_F(SheetsOfABox, TetgenHasMarkers) {
  write_mesh(*store_, dir_ / "box.node", {MeshFormat::kTetgen, false, false, true}, 2);
  std::istringstream nodes(bytes_of(dir_ / "box.node")), faces(bytes_of(dir_ / "box.face"));
  std::size_t count = 0, index = 0;
  std::string word;
  nodes >> count >> word >> word >> word;
  std::vector<Point> points(count);
  for (Point& p : points) nodes >> index >> p.x >> p.y >> p.z;
  faces >> count >> word;
  EXPECT_EQ(count, 108U);
  EXPECT_EQ(word, "1");
  for (std::size_t i = 1; i <= count; ++i) {
    std::size_t a = 0, b = 0, c = 0;
    SheetId marker = 0;
    faces >> index >> a >> b >> c >> marker;
    EXPECT_EQ(index, i);
    EXPECT_EQ(marker, side_of({points.at(a - 1), points.at(b - 1), points.at(c - 1)}));
  }
}

TEST_F(SheetsOfABox, AbaqusHasSetsAndSurfaces) {
  const std::string text = written(MeshFormat::kAbaqus, "box.inp");
  const auto section = [&](const std::string& head) {
    const std::size_t at = text.find(head + '\n');
    EXPECT_NE(at, std::string::npos) << head;
    const std::size_t begin = at + head.size() + 1;
    return text.substr(begin, text.find('*', begin) - begin);
  };
  for (const char* name :
       {"inlet", "outlet__A_", "wall_1", "WALL_1_2", "Einla____", "S_7th_side"}) {
    const std::string nodes = section(std::string("*NSET, NSET=") + name);
    EXPECT_EQ(std::ranges::count(nodes, ','), 15) << name;
    const std::string faces = section(fmt::format("*SURFACE, NAME={}, TYPE=ELEMENT", name));
    EXPECT_EQ(std::ranges::count(faces, '\n'), 18) << name;
  }
  // That of all stays.
  EXPECT_EQ(std::ranges::count(section("*SURFACE, NAME=boundary, TYPE=ELEMENT"), '\n'), 108);
}

TEST_F(SheetsOfABox, GmshHasPhysicalSurfaces) {
  for (const MeshFormat format : {MeshFormat::kMsh4, MeshFormat::kMsh2}) {
    const std::string bytes = written(format, "box.msh");
    EXPECT_NE(
        bytes.find("$PhysicalNames\n7\n2 1 \"inlet\"\n2 2 \"outlet _A_\"\n2 3 \"wall 1\"\n2 4 "
                   "\"WALL 1\"\n2 5 \"Einlaß/ #\"\n2 6 \"7th side\"\n3 7 "
                   "\"volume\"\n$EndPhysicalNames\n"),
        std::string::npos);
  }
}

TEST(SheetNames, AreDifferentAndFit) {
  SurfaceSheets sheets;
  EXPECT_EQ(names_of_sheets(sheets, {}), std::vector<std::string>{"boundary"});
  for (const char* name : {"boundary", "Boundary", "äöü", "äöüß"}) {
    sheets.sheets.emplace_back();
    sheets.sheets.back().name = name;
  }
  EXPECT_EQ(names_of_sheets(sheets, {.most_bytes = 8, .taken = {"boundary"}}),
            (std::vector<std::string>{"bounda_2", "Boundary", "äöü", "äöüß"}));
  EXPECT_EQ(names_of_sheets(sheets, {.most_bytes = 7, .is_identifier = true}),
            (std::vector<std::string>{"boundar", "Bound_2", "S____", "S_____"}));
}

TEST_F(SheetsOfABox, AFacetOfNoKnownSheetIsDamage) {
  made_.sheet_of = [](const Triangle3&) { return SheetId{7}; };
  const TempDir dir;
  const Store store = made_.write(dir / "store");
  MeshSource mesh(store, dir / "mesh", 1);
  EXPECT_THROW(mesh.boundary().sort_facets(), StoreError);
}

}  // namespace
}  // namespace locvol
