// Formats and damaged files: what read_whole_surface() takes, and with which words it refuses.

#include <gtest/gtest.h>
#include <unistd.h>

#include <random>
#include <string>
#include <vector>

#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/engine/ingest/surface_writers.h"

namespace locvol {
namespace {

void expect_unit_cube(const InputSurface& s) {
  EXPECT_EQ(s.facts.num_vertices, 8u);
  EXPECT_EQ(s.facts.num_triangles, 12u);
  EXPECT_EQ(s.facts.euler_characteristic, 2);
  EXPECT_DOUBLE_EQ(s.facts.volume, 1);
  EXPECT_DOUBLE_EQ(s.facts.area, 6);
  EXPECT_EQ(s.facts.box, (Box{{0, 0, 0}, {1, 1, 1}}));
  expect_closed(s);
}

void expect_refused(const std::string& message, const std::vector<std::string>& parts) {
  EXPECT_FALSE(message.empty()) << "accepted, but should be refused with: " << parts.front();
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks: " << part;
}

TEST(SurfaceReader, EveryFormatGivesTheSameCube) {
  const SurfaceFiles files;
  const InputSurface expected = files.read("expected.off", to_off(cube()));
  for (const auto& [name, content] : in_every_format(cube())) {
    SCOPED_TRACE(name);
    const InputSurface s = files.read(name, content);
    expect_unit_cube(s);
    EXPECT_EQ(s.pieces, expected.pieces);
    EXPECT_EQ(s.facts.file, (files.directory() / name).string());
    EXPECT_TRUE(s.facts.notes.empty());
  }
}

TEST(SurfaceReader, PolygonsAreCutInEveryFormatThatHasThem) {
  const SurfaceFiles files;
  const Polygons quads = box_of_quads({0, 0, 0}, {1, 1, 1});
  for (const auto& [name, content] : in_every_format(quads)) {
    SCOPED_TRACE(name);
    if (!name.ends_with(".stl")) expect_unit_cube(files.read(name, content));
  }
}

TEST(SurfaceReader, NoFileThatIsCutIsTakenForAnotherSurface) {
  const SurfaceFiles files;
  for (const auto& [name, content] : in_every_format(cube())) {
    // Every length near the end, every seventh before.
    for (std::size_t length = content.size() % 7; length < content.size();
         length += length + 40 < content.size() ? 7 : 1) {
      try {
        const InputSurface s = files.read(name, content.substr(0, length));
        // Only the end of the last line may be missing, all of "endsolid", or XML's last tags.
        EXPECT_DOUBLE_EQ(s.facts.volume, 1) << name << " cut at byte " << length;
        EXPECT_GE(length + 30, content.size()) << name;
      } catch (const InputError&) {
      }
    }
  }
}

TEST(SurfaceReader, DamagedBytesNeverCrash) {
  const SurfaceFiles files;
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::size_t num_refused = 0, num_tried = 0;
  for (const auto& [name, content] : in_every_format(cube())) {
    for (int i = 0; i < 100; ++i, ++num_tried) {
      std::string damaged = content;
      for (unsigned n = 1 + random() % 4; n > 0; --n)
        damaged[random() % damaged.size()] = static_cast<char>(random() % 256);
      try {
        expect_closed(files.read(name, damaged));
      } catch (const InputError&) {
        ++num_refused;
      }
    }
  }
  EXPECT_GT(num_refused, num_tried / 4);
}

TEST(SurfaceReader, BinaryStlMayBeginWithSolid) {
  const SurfaceFiles files;
  expect_unit_cube(files.read("a.stl", to_binary_stl(cube(), "solid made by a CAD system")));
}

TEST(SurfaceReader, ContentDecidesWithoutAKnownExtension) {
  const SurfaceFiles files;
  for (const auto& [name, content] : in_every_format(cube()))
    expect_unit_cube(files.read("x", content));
  expect_unit_cube(files.read("CUBE.OFF", to_off(cube())));
}

TEST(SurfaceReader, ContentThatContradictsTheExtensionIsRefused) {
  const SurfaceFiles files;
  expect_refused(refusal(files, "a.off", to_binary_stl(cube())),
                 {"binary STL", "rename it to .stl"});
  expect_refused(refusal(files, "a.ply", to_off(cube())), {"OFF", "rename it to .off"});
  expect_refused(refusal(files, "a.stl", to_obj(cube())), {"OBJ", "rename it to .obj"});
  expect_refused(refusal(files, "a.obj", to_ply(cube(), PlyEncoding::kAscii)), {"PLY"});
  expect_refused(refusal(files, "a.txt", "no surface at all\n"), {"no known format", "convert"});
}

TEST(SurfaceReader, OffVariants) {
  const SurfaceFiles files;
  const std::string off = to_off(cube());
  const std::string body = off.substr(off.find('\n', 4) + 1);
  expect_unit_cube(files.read("crlf.off", to_off(cube(), "\r\n")));
  expect_unit_cube(files.read("one_line.off", "OFF 8 12 0\n" + body));
  expect_unit_cube(files.read("two_counts.off", "OFF\n8 12\n" + body));
  expect_unit_cube(files.read("no_keyword.off", "8 12 0\n" + body));
  expect_unit_cube(files.read("comments.off", "# a\nOFF # b\n\n# c\n8 12 0\n" + body + "# d\n\n"));

  std::string colored = "COFF\n8 12 0\n", normals = "NOFF\n8 12 0\n", faces;
  for (const Point& p : cube().vertices) {
    colored += fmt::format("{} {} {} 255 128 0 255\n", p.x, p.y, p.z);
    normals += fmt::format("\t{} {} {}  0 0 1\n", p.x, p.y, p.z);
  }
  for (const auto& f : cube().faces) faces += fmt::format("3 {} 0.5 0.5 0.5\n", fmt::join(f, " "));
  expect_unit_cube(files.read("coff.off", colored + faces));
  expect_unit_cube(files.read("noff.off", normals + faces));
}

TEST(SurfaceReader, ObjVariants) {
  const SurfaceFiles files;
  std::string vertices, faces, relative = "f";
  for (const Point& p : cube().vertices)
    vertices += fmt::format("v  +{} {:.3e}\t{} 0.5 0.5 0.5\r\nvn 0 0 1\nvt 0 0\n", p.x, p.y, p.z);
  for (const auto& f : cube().faces) {
    faces += fmt::format("f {0}/1/1 {1}//1 \\\n {2}/1\n", f[0] + 1, f[1] + 1, f[2] + 1);
    relative += fmt::format("{} {} {} {}\n", relative.size() > 1 ? "f" : "", int(f[0]) - 8,
                            int(f[1]) - 8, int(f[2]) - 8);
  }
  const std::string head = "mtllib a.mtl\ng all\nusemtl grey\ns off\n";
  expect_unit_cube(files.read("slashes.obj", head + vertices + faces));
  expect_unit_cube(files.read("relative.obj", head + vertices + relative));
  expect_unit_cube(files.read("faces_first.obj", head + faces + vertices));
}

TEST(SurfaceReader, PlyWithOtherElementsPropertiesAndTypes) {
  const SurfaceFiles files;
  for (const bool is_big : {false, true}) {
    std::string data = fmt::format(
        "ply\r\nformat binary_{}_endian 1.0\r\nobj_info x\r\nelement camera 1\r\nproperty list "
        "ushort "
        "double poses\r\nelement face 12\r\nproperty uchar red\r\nproperty list ushort short "
        "vertex_index\r\nproperty list char float weights\r\nelement vertex 8\r\nproperty float "
        "quality\r\nproperty double z\r\nproperty short y\r\nproperty float x\r\nelement edge "
        "0\r\nproperty int a\r\nend_header\r\n",
        is_big ? "big" : "little");
    append_bytes(data, 2, 2, is_big);
    data.append(16, '\x7f');  // NaN: not ours to judge
    for (const auto& f : cube().faces) {
      append_bytes(data, 200, 1);
      append_bytes(data, 3, 2, is_big);
      for (const auto v : f) append_bytes(data, v, 2, is_big);
      append_bytes(data, 1, 1);
      append_float(data, 0.5, is_big);
    }
    for (const Point& p : cube().vertices) {
      append_bytes(data, 0x7fc00000, 4, is_big);  // NaN
      append_bytes(data, std::bit_cast<std::uint64_t>(p.z), 8, is_big);
      append_bytes(data, static_cast<std::uint64_t>(p.y), 2, is_big);
      append_float(data, p.x, is_big);
    }
    expect_unit_cube(files.read("extra.ply", data));
  }
}

TEST(SurfaceReader, LinesAndRecordsMayCrossBuffers) {
  // A strip of boxes, 4 MB as text, each line of another length.
  Polygons boxes;
  for (int i = 0; i < 4000; ++i)
    boxes.append(box_of_triangles({2.0 * i, 0, 0}, {2.0 * i + 1 + 1.0 / (i + 3), 1, 1}));
  const SurfaceFiles files;
  const InputSurface expected = files.read("boxes.off", to_off(boxes));
  EXPECT_EQ(expected.facts.num_components, 4000u);
  EXPECT_EQ(files.read("boxes.obj", to_obj(boxes)).pieces, expected.pieces);
  EXPECT_EQ(files.read("boxes.stl", to_ascii_stl(boxes)).pieces, expected.pieces);
  const std::vector<Triangle> rounded =
      files.read("little.ply", to_ply(boxes, PlyEncoding::kLittleEndian)).pieces;
  EXPECT_EQ(files.read("big.ply", to_ply(boxes, PlyEncoding::kBigEndian)).pieces, rounded);
  EXPECT_EQ(files.read("binary.stl", to_binary_stl(boxes)).pieces, rounded);
}

struct Damage {
  std::string name, content;
  std::vector<std::string> parts;  // of the message
};

TEST(SurfaceReader, DamagedFilesAreRefusedWithPlaceAndReason) {
  const SurfaceFiles files;
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n";
  const std::vector<Damage> table = {
      {"empty.off", "", {"0 bytes"}},
      {"nan.off", "OFF\n3 1 0\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", {"line 4", "nan", "not finite"}},
      {"inf.obj", "v 0 0 -inf\n", {"line 1", "-inf", "not finite"}},
      {"overflow.obj", "v 0 0 1e999\n", {"line 1", "1e999", "not finite"}},
      {"comma.obj", "v 0,5 0 1\n", {"line 1", "0,5", "no number"}},
      {"word.off", "OFF\n3 1 0\n0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n", {"line 4", "zero"}},
      {"index.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", {"line 6", "vertex 3", "only 3"}},
      {"negative.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", {"line 6", "negative"}},
      {"half.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1.5 2\n", {"line 6", "no integer"}},
      {"edge.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", {"line 6", "2 corners"}},
      {"longer.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n", {"line 7", "header"}},
      {"lying.off", "OFF\n2000000000 4000000000 0\n0 0 0\n", {"line 2", "2000000000", "bytes"}},
      {"huge.off", "OFF\n99999999999999999999 1 0\n", {"line 2", "no integer"}},
      {"four.off", "4OFF\n1 1 1\n", {"dimension"}},
      {"binary.off", "OFF BINARY\n\1\2\3", {"ends too early"}},
      {"zero.obj", "v 0 0 0\nf 0 1 2\n", {"line 2", "no vertex 0"}},
      {"back.obj", "v 0 0 0\nf -1 -2 -3\n", {"line 2", "no vertex -2"}},
      {"index.obj", "v 0 0 0\nv 1 0 0\nf 1 2 3\n", {"line 3", "vertex 2", "only 2"}},
      {"free.obj", "v 0 0 0\ncstype bspline\n", {"line 2", "free-form"}},
      {"junk.obj", "v 0 0 0\n%%%%\n", {"line 2", "no line of an OBJ file"}},
      {"cut.obj", "v 0 0 0\nv 1 0\n", {"line 2", "missing"}},
      {"bow.obj", "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n", {"line 5", "crosses itself"}},
      {"short.stl", "solid", {"no vertices"}},
      {"cut.stl",
       "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n",
       {"inside a facet", "cut off"}},
      {"four.stl",
       "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0 0\nvertex 0 0 0\n"
       "vertex 0 0 0\n",
       {"line 7", "vertex too many"}},
      {"two.stl",
       "solid\nfacet\nouter loop\nvertex 0 0 0\nvertex 0 0 0\nendloop\nendfacet\nendsolid\n",
       {"line 7", "three vertices"}},
      {"lying.stl",
       std::string(80, ' ') + "\xff\xff\xff\xff" + std::string(50, ' '),
       {"4294967295"}},
      {"tiny.stl", "\x89PNG\r\n\x1a\n", {"84 bytes"}},
      {"axis.ply",
       ply + "element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0\n1 0\n0 "
             "1\n",
       {"x, y and z"}},
      {"cut.ply",
       "ply\nformat ascii 1.0\nelement ver",
       {"line 3", "number of elements is missing"}},
      {"header.ply", ply, {"inside its PLY header"}},
      {"format.ply", "ply\nelement vertex 0\nend_header\n", {"lacks", "format"}},
      {"type.ply",
       "ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n",
       {"line 4", "type"}},
      {"lying.ply",
       "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float "
       "x\nproperty float y\nproperty float z\nend_header\n" +
           std::string(64, '\0'),
       {"2000000000", "vertex", "64 bytes"}},
      {"list.ply",
       "ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uint int "
       "vertex_indices\nend_header\n\xff\xff\xff\xff" +
           std::string(9, '\0'),
       {"cut off"}},
      {"nothing.ply",
       "ply\nformat ascii 1.0\nelement x 4000000000\nend_header\n",
       {"no properties"}},
      {"strips.ply",
       "ply\nformat ascii 1.0\nelement tristrips 1\nproperty int length\nend_header\n3\n",
       {"strips", "vertex_indices"}},
      {"points.ply",
       ply + "property float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n",
       {"no faces", "3"}},
      {"zero.off", "OFF\n0 0 0\n", {"no vertices"}},
      {"no_facet.stl", "solid x\nendsolid x\n", {"no vertices"}},
  };
  for (const auto& [name, content, parts] : table) {
    SCOPED_TRACE(name);
    expect_refused(refusal(files, name, content), parts);
  }
}

TEST(SurfaceReader, NanInBinaryFilesIsRefused) {
  const SurfaceFiles files;
  Polygons broken = cube();
  broken.vertices[5].y = std::numeric_limits<double>::quiet_NaN();
  expect_refused(refusal(files, "a.stl", to_binary_stl(broken)), {"triangle", "not finite"});
  expect_refused(refusal(files, "a.ply", to_ply(broken, PlyEncoding::kBigEndian)),
                 {"vertex 5", "not finite"});
}

TEST(SurfaceReader, DenormalCoordinatesAreRead) {
  const SurfaceFiles files;
  std::string off = to_off(cube());
  off.replace(off.find("0 0 0\n", 9), 6, "1e-320 0 -1e-999\n");
  const InputSurface s = files.read("denormal.off", off);
  EXPECT_EQ(s.vertices[0], (Point{1e-320, 0, 0}));
}

TEST(SurfaceReader, WhatIsNoReadableFileIsRefused) {
  const SurfaceFiles files;
  const auto message = [](const std::filesystem::path& path) -> std::string {
    try {
      read_whole_surface(path);
    } catch (const InputError& error) {
      return error.what();
    }
    return {};
  };
  expect_refused(message(files.directory() / "missing.stl"), {"missing.stl", "no such file"});
  expect_refused(message(files.directory()), {"directory"});
  expect_refused(message("/dev/null"), {"/dev/null", "device"});
  if (geteuid() != 0) {  // root may read all
    const auto closed = files.write("closed.off", to_off(cube()));
    std::filesystem::permissions(closed, std::filesystem::perms::none);
    expect_refused(message(closed), {"cannot be opened", "permissions"});
  }
}

TEST(SurfaceReader, LineWithoutEndIsRefusedWithoutReadingItAll) {
  const SurfaceFiles files;
  const auto path = files.write("line.off", "OFF ");
  std::filesystem::resize_file(path, std::uint64_t{1} << 33);  // sparse: 8 GB of zeros
  EXPECT_THROW(read_whole_surface(path), InputError);
}

}  // namespace
}  // namespace locvol
