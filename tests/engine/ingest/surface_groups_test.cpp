// Groups of triangles that have names, in each format that knows some.
#include "engine/ingest/surface_groups.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <string>
#include <vector>

#include "engine/ingest/surface_reader.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {
namespace {

struct Grouped {
  std::vector<std::string> names;
  std::vector<SheetId> of_triangles;  // in order of id
  std::vector<std::string> notes;
  friend bool operator==(const Grouped&, const Grouped&) = default;
};

Grouped grouped(const RawSurface& raw) {
  Grouped found{raw.groups, {}, raw.notes};
  for (const TriangleList& list : raw.triangles)
    raw.spill.for_each(list, [&](const Triangle& t) { found.of_triangles.push_back(t.sheet); });
  return found;
}

Grouped groups_in(const std::string& name, std::string_view content) {
  const SurfaceFiles files;
  IngestWatch watch;
  return grouped(read_surface(files.write(name, content), files.directory(), watch));
}

using Names = std::vector<std::string>;
using Groups = std::vector<SheetId>;

std::string stl_solid(std::string_view name, int num_facets, std::string_view end = "\n") {
  std::string text = fmt::format("solid{}{}", name, end);
  for (int i = 0; i < num_facets; ++i)
    text += fmt::format(
        "facet normal 0 0 1{0}outer loop{0}vertex {1} 0 0{0}vertex {2} 0 0{0}vertex {1} 1 "
        "0{0}endloop{0}endfacet{0}",
        end, i, i + 1);
  return text + fmt::format("endsolid{}{}", name, end);
}

TEST(SurfaceGroups, SolidsOfStlAreGroups) {
  const Grouped two = groups_in("two.stl", stl_solid(" inlet", 2) + stl_solid(" outer wall ", 3) +
                                               stl_solid(" inlet", 1) + stl_solid(" empty", 0));
  EXPECT_EQ(two.names, (Names{"inlet", "outer wall"}));
  EXPECT_EQ(two.of_triangles, (Groups{1, 1, 2, 2, 2, 1}));
  EXPECT_EQ(groups_in("crlf.stl", stl_solid(" inlet", 2, "\r\n") + stl_solid("", 1, "\r\n")).names,
            (Names{"inlet", ""}));
}

TEST(SurfaceGroups, NamesAreReadableWhateverTheFileHolds) {
  const auto name_of = [](std::string_view name) {
    return groups_in("odd.stl", stl_solid(" plain", 2) + stl_solid(fmt::format(" {}", name), 1))
        .names.back();
  };
  EXPECT_EQ(name_of("\"quoted\" 'name' \\ <b>"), "\"quoted\" 'name' \\ <b>");
  EXPECT_EQ(name_of("Einlaß 入口 🚪"), "Einlaß 入口 🚪");
  EXPECT_EQ(name_of("latin\xdf\x01tab\tx"), "latin__tab_x");
  EXPECT_EQ(name_of("\xed\xa0\x80\xc0\xaf\xf5z"), "______z");
  EXPECT_EQ(name_of(""), "");
  const Grouped longer = groups_in("long.stl", stl_solid(" " + std::string(254, 'a') + "ßß", 1));
  EXPECT_EQ(longer.names, Names{std::string(254, 'a')});
  EXPECT_EQ(longer.notes, Names{"cut names of groups to 255 bytes"});
}

TEST(SurfaceGroups, ObjHasGroupsThenObjectsThenMaterials) {
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
  const std::string face = "f 1 2 3\n";
  EXPECT_EQ(groups_in("none.obj", vertices + face).names, Names{""});
  EXPECT_EQ(groups_in("default.obj", "g default\n" + vertices + face).names, Names{""});
  const Grouped materials =
      groups_in("materials.obj", vertices + face + "usemtl red\n" + face + "usemtl blue\n" + face);
  EXPECT_EQ(materials.names, (Names{"", "red", "blue"}));
  const Grouped all = groups_in("all.obj", vertices + "usemtl red\no body\n" + face +
                                               "g inlet  # a comment\n" + face + "usemtl blue\n" +
                                               face + "g outlet side\n" + face + "o lid\n" + face);
  EXPECT_EQ(all.names, (Names{"body", "inlet", "outlet side", "lid"}));
  EXPECT_EQ(all.of_triangles, (Groups{1, 2, 2, 3, 4}));
  // Faces that wait for their vertices come last, and so does their group.
  const Grouped waiting =
      groups_in("waiting.obj",
                "g late\nf 1 2 3\n" + vertices + "g early\nf 2 3 4\ng late\nf 1 2 4\nf 1 4 3\n");
  EXPECT_EQ(waiting.names, (Names{"early", "late"}));
  EXPECT_EQ(waiting.of_triangles, (Groups{1, 2, 2, 2}));
}

std::string ply_of(std::string_view property, const std::vector<int>& values) {
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float "
      "z\nelement face {}\nproperty list uchar int vertex_indices\nproperty uchar "
      "red\n{}end_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n",
      values.size(), property);
  for (const int value : values) text += fmt::format("3 0 1 2 9 {}\n", value);
  return text;
}

TEST(SurfaceGroups, PlyHasAPropertyOfFaces) {
  const Grouped found = groups_in("regions.ply", ply_of("property int region\n", {7, 7, -1, 7}));
  EXPECT_EQ(found.names, (Names{"region 7", "region -1"}));
  EXPECT_EQ(found.of_triangles, (Groups{1, 1, 2, 1}));
  EXPECT_EQ(groups_in("quality.ply", ply_of("property float label\n", {1, 2})).names, Names{""});
}

TEST(SurfaceGroups, APackedFileHasThem) {
  const SurfaceFiles files;
  const std::string text = stl_solid(" inlet", 2) + stl_solid(" outlet", 1);
  const auto path = files.directory() / "packed.stl.gz";
  const gzFile packed = gzopen(path.c_str(), "wb");
  ASSERT_EQ(gzwrite(packed, text.data(), static_cast<unsigned>(text.size())),
            static_cast<int>(text.size()));
  gzclose(packed);
  IngestWatch watch;
  EXPECT_EQ(grouped(read_surface(path, files.directory(), watch)), groups_in("plain.stl", text));
}

TEST(SurfaceGroups, TooManyNamesAreRefused) {
  const SurfaceFiles files;
  std::string text;
  for (std::size_t i = 0; i <= SurfaceGroups::kMaxGroups; ++i)
    text += stl_solid(fmt::format(" s{}", i), 1);
  EXPECT_NE(refusal(files, "many.stl", text)
                .find("more than 10000 groups with names; unite some, or export it without names"),
            std::string::npos);
}

TEST(SurfaceGroups, PartsOfAFileHaveThoseOfTheirTriangles) {
  const SurfaceFiles files;
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float "
      "y\nproperty float z\nelement face 6\nproperty uchar patch\nproperty list uchar int "
      "vertex_indices\nend_header\n";
  const auto put = [&](const auto& value) {
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (const float c : {0.F, 0.F, 0.F, 1.F, 0.F, 0.F, 0.F, 1.F, 0.F}) put(c);
  for (const int patch : {3, 3, 1, 3, 2, 1}) {
    put(static_cast<std::uint8_t>(patch));
    put(std::uint8_t{3});
    for (const std::int32_t v : {0, 1, 2}) put(v);
  }
  const auto file = files.write("parts.ply", text);
  IngestWatch watch;
  std::vector<Names> names;
  for (std::uint64_t part = 0; part < 2; ++part) {
    const auto ranges = ranges_of_surface(file);
    ASSERT_NE(ranges, nullptr);
    names.push_back(read_part_of_surface(*ranges, part, 2, files.directory(), watch).groups);
  }
  EXPECT_EQ(names[0], (Names{"patch 3", "patch 1"}));
  EXPECT_EQ(names[1], (Names{"patch 3", "patch 2", "patch 1"}));
}

}  // namespace
}  // namespace locvol
