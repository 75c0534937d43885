// What is particular to a format beyond its triangles: groups, places of parts, damage.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "engine/ingest/tag_runs.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/ingest/surface_writers.h"

namespace locvol {
namespace {

struct GroupedFaces {
  std::vector<std::string> names;
  std::vector<SheetId> of_triangles;
  std::vector<std::string> notes;
};

GroupedFaces grouped_faces(const std::string& name, std::string_view content) {
  const SurfaceFiles files;
  IngestWatch watch;
  const RawSurface raw = read_surface(files.write(name, content), files.directory(), watch);
  GroupedFaces found{raw.groups, {}, raw.notes};
  for (const TriangleList& list : raw.triangles)
    raw.spill.for_each(list, [&](const Triangle& t) { found.of_triangles.push_back(t.sheet); });
  return found;
}

using Names = std::vector<std::string>;

const FaceGroups kGroups = {1, 1, 2, 2, 1, 1, 2, 2, 1, 1, 1, 1};
const std::vector<SheetId> kSheets(kGroups.begin(), kGroups.end());

void expect_reason(const std::string& name, std::string_view content,
                   const std::vector<std::string>& parts) {
  const SurfaceFiles files;
  const std::string message = refusal(files, name, content);
  EXPECT_FALSE(message.empty()) << name << " is accepted";
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks: " << part;
}

std::string replaced_once(std::string text, std::string_view from, std::string_view to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

TEST(SurfaceFormats, ArraysOfCellsAreGroups) {
  const Names names = {"region 1", "region 2"};
  for (const bool is_binary : {false, true})
    for (const bool has_offsets : {false, true}) {
      const auto found = grouped_faces(
          "a.vtk", to_vtk(cube(), {.is_binary = is_binary, .has_offsets = has_offsets}, kGroups));
      EXPECT_EQ(found.names, names);
      EXPECT_EQ(found.of_triangles, kSheets);
    }
  for (const auto data :
       {VtpStyle::Data::kText, VtpStyle::Data::kBase64, VtpStyle::Data::kAppended})
    for (const bool is_compressed : {false, true})
      for (const bool is_big_endian : {false, true}) {
        const auto found =
            grouped_faces("a.vtp", to_vtp(cube(), {data, is_compressed, is_big_endian}, kGroups));
        EXPECT_EQ(found.names, names);
        EXPECT_EQ(found.of_triangles, kSheets);
      }
}

TEST(SurfaceFormats, PhysicalSurfacesAreGroups) {
  for (const bool is_binary : {false, true})
    for (const bool is_old : {false, true}) {
      const auto found = grouped_faces("a.msh", to_msh(cube(), {is_binary, is_old}, kGroups));
      EXPECT_EQ(found.names, (Names{"group 1", "group 2"}));
      EXPECT_EQ(found.of_triangles, kSheets);
    }
  const std::string unnamed =
      replaced_once(to_msh(cube(), {}, kGroups), "2 1 \"group 1\"", "2 5 \"other\"");
  EXPECT_EQ(grouped_faces("a.msh", unnamed).names, (Names{"physical surface 1", "group 2"}));
}

TEST(SurfaceFormats, StripsAndOtherCellsOfVtk) {
  const std::string text =
      "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 5 float\n"
      "0 0 0 1 0 0 0 1 0 1 1 0 0 0 1\nMETADATA\nINFORMATION 0\n\nVERTICES 1 2\n1 4\n"
      "POLYGONS 1 4\n3 0 1 4\nTRIANGLE_STRIPS 1 5\n4 0 1 2 3\nCELL_DATA 3\n"
      "SCALARS patch int\nLOOKUP_TABLE default\n7 8 9\n";
  const auto found = grouped_faces("strip.vtk", text);
  EXPECT_EQ(found.names, (Names{"patch 8", "patch 9"}));
  EXPECT_EQ(found.of_triangles, (std::vector<SheetId>{1, 2, 2}));
  const auto note = grouped_faces("odd.vtk", text + "ODD_DATA 3\n").notes;
  ASSERT_FALSE(note.empty());
  EXPECT_NE(note.front().find("\"ODD_DATA\""), std::string::npos);
}

TEST(SurfaceFormats, ObjectsOf3mfArePlacedWithTheirNames) {
  const SurfaceFiles files;
  const std::string object = mesh_of_3mf(cube());
  // A cube, and another, mirrored, in a group that is moved.
  const std::string file =
      to_3mf_of("<object id=\"1\" name=\"a &lt; b\">" + object +
                    "</object>\n<object id=\"2\"><components><component objectid=\"1\" "
                    "transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"/></components></object>\n"
                    "<object id=\"3\" type=\"support\">" +
                    object + "</object>\n",
                "<item objectid=\"1\"/><item objectid=\"2\" transform=\"2 0 0 0 2 0 0 0 2 5 0 0\"/>"
                "<item objectid=\"3\" transform=\"1 0 0 0 1 0 0 0 1 9 9 9\"/>",
                true);
  const InputSurface surface = files.read("two.3mf", file);
  EXPECT_DOUBLE_EQ(surface.facts.volume, 1 + 8);
  EXPECT_EQ(surface.facts.num_components, 2u);
  const auto found = grouped_faces("two.3mf", file);
  EXPECT_EQ(found.names, (Names{"a < b", "a < b 2"}));
  ASSERT_EQ(found.notes.size(), 1u);
  EXPECT_EQ(found.notes[0], "left out an object of supports");
}

TEST(SurfaceFormats, NodesOfGltfArePlacedWithTheirNames) {
  const SurfaceFiles files;
  const std::string nodes =
      R"({"children":[1,2]},{"mesh":0,"name":"left"},{"mesh":0,"name":"right",)"
      R"("translation":[5,0,0],"scale":[-2,2,2],"rotation":[0,0.7071067811865476,0,)"
      R"(0.7071067811865476]})";
  const std::string file = to_glb(cube(), nodes);
  EXPECT_NEAR(files.read("two.glb", file).facts.volume, 1 + 8, 1e-12);
  EXPECT_EQ(grouped_faces("two.glb", file).names, (Names{"left", "right"}));
}

TEST(SurfaceFormats, DamageIsToldWithItsPlace) {
  const std::string glb = to_glb(cube()), vtp = to_vtp(cube(), {}), msh = to_msh(cube(), {}),
                    vtk = to_vtk(cube(), {});
  std::string wrong_sum = to_3mf(cube(), false);
  wrong_sum[wrong_sum.find("x=\"1\"") + 3] = '2';
  expect_reason("sum.3mf", wrong_sum, {"3D/3dmodel.model", "checksum"});
  expect_reason("cut.3mf", to_3mf(cube(), true).substr(0, 300), {"zip archive", "no directory"});
  expect_reason("other.3mf", to_zip({{"a.txt", "text"}}, false), {"zip archive", "unzip"});
  expect_reason("none.3mf", to_3mf_of("", ""), {"places no object"});
  expect_reason("id.3mf", to_3mf_of("", "<item objectid=\"7\"/>"), {"no object", "\"7\""});
  expect_reason("itself.3mf",
                to_3mf_of("<object id=\"1\"><components><component objectid=\"1\"/></components>"
                          "</object>",
                          "<item objectid=\"1\"/>"),
                {"places more than"});
  expect_reason("corner.3mf",
                to_3mf_of("<object id=\"1\">" +
                              replaced_once(mesh_of_3mf(cube()), "v3=\"", "v3=\"9") + "</object>",
                          "<item objectid=\"1\"/>"),
                {"before byte ", "v3=\"9", "of which its mesh has 8"});
  expect_reason("other.gltf",
                replaced_once(to_gltf(cube()), "data:application/octet-stream;base64,", "a.bin?"),
                {"another file", "GLB"});
  expect_reason("packed.gltf",
                replaced_once(to_gltf(cube()), "\"scene\":0,\"scenes\":[{\"nodes\":[0]}]",
                              "\"extensionsRequired\":[\"EXT_meshopt_compression\"]"),
                {"EXT_meshopt_compression", "without"});
  expect_reason("count.glb", replaced_once(glb, "\"count\":8", "\"count\":9"),
                {"accessor 0", "promises 9"});
  expect_reason("json.glb", replaced_once(glb, "\"meshes\"", "\"meshed\""), {"JSON"});
  expect_reason("type.vtp", replaced_once(vtp, "PolyData", "UnstructuredGrid"),
                {"UnstructuredGrid", "surface"});
  expect_reason("count.vtp", replaced_once(vtp, "NumberOfPoints=\"8\"", "NumberOfPoints=\"9\""),
                {"\"Points\"", "ends after 24 values", "27"});
  expect_reason("huge.vtp",
                replaced_once(vtp, "NumberOfPolys=\"12\"", "NumberOfPolys=\"99999999999\""),
                {"99999999999", "bytes can hold"});
  expect_reason("grid.vtk", replaced_once(vtk, "POLYDATA", "UNSTRUCTURED_GRID"),
                {"line 4", "UNSTRUCTURED_GRID"});
  expect_reason("word.vtk", replaced_once(vtk, "POINTS 8", "POINTS 9"), {"POLYGONS", "no number"});
  expect_reason("cells.vtk", replaced_once(vtk, "POLYGONS 12 48", "POLYGONS 12 47"), {"corners"});
  expect_reason("old.msh", replaced_once(msh, "4.1 0 8", "4 0 8"), {"line 2", "version", "msh41"});
  expect_reason("node.msh", replaced_once(msh, "\n1 3 23 33 ", "\n1 3 23 34 "),
                {"line ", "no node 34"});
  expect_reason("cut.msh", msh.substr(0, msh.find("$EndElements")), {"$Elements", "cut off"});
  expect_reason("promise.off",
                replaced_once(to_binary_off(cube()), std::string("\0\0\0\x8", 4),
                              std::string("\7\0\0\x8", 4)),
                {"promises 117440520 vertices"});
}

TEST(SurfaceFormats, TagsOfNodesMeanTheVerticesThatHaveThem) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  for (int round = 0; round < 20; ++round) {
    std::vector<std::uint64_t> tags;
    for (std::uint64_t tag = 1; tags.size() < 300;
         tag += 1 + (random() % 8 == 0 ? random() % 5 : 0))
      tags.push_back(tag);
    for (int swap = 0; swap < 20; ++swap)
      std::swap(tags[random() % tags.size()], tags[random() % tags.size()]);
    TagRuns runs;
    for (const std::uint64_t tag : tags) EXPECT_TRUE(runs.add(tag));
    EXPECT_FALSE(runs.finish());
    for (std::size_t v = 0; v < tags.size(); ++v) EXPECT_EQ(runs.vertex(tags[v]), v);
    for (std::uint64_t tag = 0; tag < 400; ++tag)
      EXPECT_EQ(runs.vertex(tag).has_value(), std::ranges::count(tags, tag) == 1) << tag;
  }
  TagRuns twice;
  for (const std::uint64_t tag : {4, 5, 6, 9, 5}) EXPECT_TRUE(twice.add(tag));
  EXPECT_EQ(twice.finish(), 5u);
}

}  // namespace
}  // namespace locvol
