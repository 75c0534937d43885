// What read_surface() and check_surface() repair and what they refuse, beyond the format of the
// file.

#include "engine/ingest/surface_input.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "engine/ingest/input_file.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {
namespace {

class SurfaceInput : public testing::Test {
 protected:
  InputSurface read(const Polygons& s) const { return files_.read("surface.off", to_off(s)); }
  void expect_refused(const Polygons& s, const std::vector<std::string>& parts) const {
    const std::string message = refusal(files_, "surface.off", to_off(s));
    EXPECT_FALSE(message.empty()) << "accepted, but should be refused with: " << parts.front();
    for (const std::string& part : parts)
      EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks: " << part;
  }
  static bool has_note(const InputSurface& s, const std::string& part) {
    return std::any_of(s.facts.notes.begin(), s.facts.notes.end(), [&](const std::string& note) {
      return note.find(part) != std::string::npos;
    });
  }

  SurfaceFiles files_;
};

TEST_F(SurfaceInput, EqualPointsAreMergedInOrderOfAppearance) {
  Polygons loose;
  for (const auto& f : cube().faces) {
    const auto n = static_cast<std::uint32_t>(loose.vertices.size());
    for (const auto v : f) loose.vertices.push_back(cube().vertices[v]);
    loose.faces.push_back({n, n + 1, n + 2});
  }
  for (std::size_t i = 0; i < loose.vertices.size(); i += 2)
    for (int axis = 0; axis < 3; ++axis)
      if (loose.vertices[i][axis] == 0) loose.vertices[i][axis] = -0.0;
  const InputSurface s = read(loose);
  EXPECT_EQ(s.vertices.size(), 8u);
  EXPECT_EQ(s.triangles[0], (std::array<std::uint32_t, 3>{0, 1, 2}));
  EXPECT_EQ(s.vertices[1], loose.vertices[1]);
  EXPECT_EQ(s.pieces, read(cube()).pieces);
  EXPECT_TRUE(has_note(s, "left out 28 vertices"));
  for (const Point& p : s.vertices)
    for (int axis = 0; axis < 3; ++axis) EXPECT_FALSE(std::signbit(p[axis]));
}

TEST_F(SurfaceInput, UnusedVerticesAreDroppedAndDoNotCountInTheBox) {
  Polygons s = cube();
  s.vertices.insert(s.vertices.begin(), {1000, 0, 0});
  s.vertices.push_back({0, -1e200, 0});
  for (auto& f : s.faces)
    for (auto& v : f) ++v;
  const InputSurface read_back = read(s);
  EXPECT_EQ(read_back.facts.num_vertices, 8u);
  EXPECT_EQ(read_back.facts.box, (Box{{0, 0, 0}, {1, 1, 1}}));
  EXPECT_EQ(read_back.pieces, read(cube()).pieces);
  EXPECT_TRUE(has_note(read_back, "left out 2 vertices"));
}

TEST_F(SurfaceInput, RepeatedAndCollapsedTrianglesAreDropped) {
  Polygons s = cube();
  for (const auto& f : cube().faces) s.faces.push_back({f[1], f[2], f[0]});
  s.faces.push_back(cube().faces[3]);  // a third copy
  s.faces.insert(s.faces.begin(), {4, 4, 5});
  const InputSurface read_back = read(s);
  EXPECT_EQ(read_back.pieces, read(cube()).pieces);
  EXPECT_TRUE(has_note(read_back, "dropped 13 triangles that repeated"));
  EXPECT_TRUE(has_note(read_back, "dropped 1 triangle with two equal corners"));
}

TEST_F(SurfaceInput, OneRepeatedTriangleIsDroppedWhateverItsOrientation) {
  Polygons s = cube();
  s.faces.push_back({s.faces[5][2], s.faces[5][1], s.faces[5][0]});
  EXPECT_EQ(read(s).pieces, read(cube()).pieces);
}

TEST_F(SurfaceInput, SheetsWithoutThicknessAreRefused) {
  const Polygons pillow{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 1}}};
  expect_refused(pillow, {"intersects itself"});
  const Polygons square{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
                        {{0, 1, 2}, {0, 2, 3}, {0, 2, 1}, {0, 3, 2}}};
  expect_refused(square, {"more than two triangles", "doubled faces"});
  const Polygons other_diagonal{square.vertices, {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}}};
  expect_refused(other_diagonal, {"intersects itself"});
}

TEST_F(SurfaceInput, OpenSurfaceIsRefusedWithCountAndPlace) {
  Polygons s = cube();
  s.faces.pop_back();
  expect_refused(s, {"not closed", "3 edges", "(1, 0, 1) to (1, 1, 1)", "triangle",
                     "close the holes", "or repair it: locvol repair "});
}

TEST_F(SurfaceInput, ARefusalNamesACommandThatAShellTakes) {
  const SurfaceFiles files;
  Polygons sheet = cube();
  sheet.faces.resize(2);
  const std::string message = refusal(files, "it's a sheet.off", to_off(sheet));
  EXPECT_NE(message.find("it'\\''s a sheet.off' -o wrapped.ply"), std::string::npos) << message;
}

TEST_F(SurfaceInput, CubesThatTouchAreRefused) {
  Polygons at_edge = cube();
  at_edge.append(box_of_triangles({1, 1, 0}, {2, 2, 1}));
  expect_refused(at_edge, {"not manifold", "1 edge belongs", "(1, 1, 0)", "(1, 1, 1)",
                           "or wrap it: locvol wrap "});
  Polygons at_vertex = cube();
  at_vertex.append(box_of_triangles({1, 1, 1}, {2, 2, 2}));
  expect_refused(at_vertex, {"not manifold", "1 vertex", "(1, 1, 1)", "locvol wrap "});
  Polygons at_face = cube();
  at_face.append(box_of_triangles({1, 0.25, 0.25}, {2, 0.75, 0.75}));
  expect_refused(at_face, {"intersects itself", "triangle 10", "(1, 0.25, 0.25)"});
}

TEST_F(SurfaceInput, ProjectivePlaneIsRefusedAsNotOrientable) {
  // The triangulation with six vertices.
  const Polygons plane{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 0.5}, {0.3, 0.7, 2}},
                       {{0, 1, 2},
                        {0, 2, 3},
                        {0, 3, 4},
                        {0, 4, 5},
                        {0, 5, 1},
                        {1, 2, 4},
                        {2, 3, 5},
                        {3, 4, 1},
                        {4, 5, 2},
                        {5, 1, 3}}};
  expect_refused(plane, {"not orientable", "locvol wrap "});
}

TEST_F(SurfaceInput, OverlappingCubesAreRefusedWithTheFirstPair) {
  Polygons s = cube();
  s.append(box_of_triangles({0.5, 0.5, 0.5}, {1.5, 1.5, 1.5}));
  expect_refused(s, {"intersects itself", "triangle 2 ", "(0.5, 0.5, 0.5)", "locvol wrap "});
}

TEST_F(SurfaceInput, ExtremeSizesAreRefused) {
  expect_refused(box_of_triangles({0, 0, 0}, {1e60, 1e60, 1e60}), {"diagonal", "another unit"});
  expect_refused(box_of_triangles({-1e308, 0, 0}, {1e308, 1, 1}), {"diagonal", "another unit"});
  expect_refused(box_of_triangles({0, 0, 0}, {1e-60, 1e-60, 1e-60}), {"diagonal", "another unit"});
  expect_refused(box_of_triangles({1e12, 0, 0}, {1e12 + 1, 1, 1}), {"move it to the origin"});
  for (const double scale : {1e-49, 1e-20, 1e20, 1e49})
    EXPECT_NEAR(read(box_of_triangles({0, 0, 0}, {scale, scale, scale})).facts.volume /
                    (scale * scale * scale),
                1, 1e-14);
  EXPECT_NEAR(read(box_of_triangles({1e8, 0, 0}, {1e8 + 1, 1, 1})).facts.volume, 1, 1e-14);
}

TEST_F(SurfaceInput, ThinPlateIsAccepted) {
  EXPECT_NEAR(read(box_of_triangles({0, 0, 0}, {2, 2, 2e-9})).facts.volume, 8e-9, 1e-22);
}

// A cube whose edge from (0,0,0) to (1,0,0) carries extra vertices on one side only; flat triangles
// join them to the edge on the other side.
Polygons cube_with_flat_triangles(const std::vector<double>& at) {
  Polygons s = cube();
  s.faces.erase(s.faces.begin() + 4);  // {0, 1, 5}, of the face y = 0
  std::uint32_t last = 0;
  for (const double x : at) {
    const auto v = static_cast<std::uint32_t>(s.vertices.size());
    s.vertices.push_back({x, 0, 0});
    s.faces.push_back({last, v, 5});
    s.faces.push_back({last, 1, v});  // flat: last, v and 1 lie on the edge
    last = v;
  }
  s.faces.push_back({last, 1, 5});
  return s;
}

TEST_F(SurfaceInput, FlatTrianglesAreFlippedAway) {
  for (const std::vector<double>& at : {std::vector{0.5}, {0.25, 0.5}, {0.1, 0.2, 0.3, 0.7, 0.9}}) {
    const InputSurface s = read(cube_with_flat_triangles(at));
    EXPECT_EQ(s.facts.num_vertices, 8 + at.size());
    EXPECT_EQ(s.facts.num_triangles, 12 + 2 * at.size());
    EXPECT_DOUBLE_EQ(s.facts.volume, 1);
    EXPECT_DOUBLE_EQ(s.facts.area, 6);
    EXPECT_TRUE(has_note(s, "without area"));
    expect_closed(s);
    for (const auto& [a, b, c] : s.corners()) {
      EXPECT_GT(norm(cross(b - a, c - a)), 0);
    }
  }
}

TEST_F(SurfaceInput, FlatTriangleThatCannotBeFlippedIsRefused) {
  // A tetrahedron with collinear corners 0, 1, 2: every edge exists already.
  const Polygons flat{{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {0, 1, 0}},
                      {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}};
  expect_refused(flat, {"no area", "(1, 0, 0)"});
}

TEST_F(SurfaceInput, OrientationDoesNotMatterAndIsNoted) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  for (int round = 0; round < 50; ++round) {
    Polygons s = cube();
    std::uint64_t num_turned = 0;
    for (auto& f : s.faces) {
      if (random() % 2) continue;
      std::swap(f[1], f[2]);
      ++num_turned;
    }
    const InputSurface read_back = read(s);
    EXPECT_DOUBLE_EQ(read_back.facts.volume, 1);
    expect_closed(read_back);
    EXPECT_EQ(has_note(read_back, fmt::format("{} triangle", num_turned)), num_turned > 0);
  }
}

// Boxes in boxes in boxes, in any order and orientation. Corners of inner boxes lie right below
// corners, edges and diagonals of outer ones, where a careless ray miscounts.
TEST_F(SurfaceInput, VolumeIsThatOfTheMaterialByNesting) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  for (int round = 0; round < 100; ++round) {
    std::vector<Polygons> shells;
    double volume = 0;
    const int depth = static_cast<int>(1 + random() % 6);
    for (int k = 0; k < depth; ++k) {
      const double low = k, high = 20 - k;
      shells.push_back(box_of_triangles({low, low, low}, {high, high, high}));
      volume += (k % 2 ? -1 : 1) * std::pow(high - low, 3);
    }
    // Small boxes side by side in the innermost one, on a grid that meets its edges and diagonals.
    for (int i = 0; i < 4; ++i) {
      const double x = 8 + (i % 2) * 2, y = 8 + (i / 2) * 2;
      shells.push_back(box_of_triangles({x, y, 8}, {x + 1, y + 1, 9}));
      volume += depth % 2 ? -1 : 1;
    }
    shells.push_back(box_of_triangles({30, 0, 0}, {32, 2, 2}));
    volume += 8;
    std::shuffle(shells.begin(), shells.end(), random);
    Polygons all;
    for (Polygons& shell : shells) {
      if (random() % 2)
        for (auto& f : shell.faces) std::swap(f[0], f[1]);
      all.append(shell);
    }
    const InputSurface s = read(all);
    EXPECT_DOUBLE_EQ(s.facts.volume, volume);
    EXPECT_EQ(s.facts.num_components, shells.size());
    EXPECT_EQ(s.facts.euler_characteristic, static_cast<std::int64_t>(2 * shells.size()));
  }
}

TEST_F(SurfaceInput, DigestIsThatOfTheFilesBytes) {
  const std::string digest = read(cube()).digest;
  Sha256 hash;
  const std::string bytes = to_off(cube());
  hash.update(bytes.data(), bytes.size());
  EXPECT_EQ(digest, hash.hex_digest());
  EXPECT_EQ(digest, digest_of_file(files_.directory() / "surface.off"));
  EXPECT_NE(files_.read("other.off", bytes + "# end\n").digest, digest);
  Polygons moved = cube();
  moved.vertices[7].x = std::nextafter(1.0, 2.0);
  EXPECT_NE(read(moved).digest, digest);
  // Larger than any buffer, so that it is read in pieces.
  const std::string large = bytes + "#" + std::string(1000000, 'x');
  const std::string of_large = files_.read("large.off", large).digest;
  EXPECT_EQ(of_large, digest_of_file(files_.directory() / "large.off"));
}

TEST(Sha256, AgreesWithTheStandard) {
  const auto digest = [](const std::string& text) {
    Sha256 hash;
    for (const char c : text) hash.update(&c, 1);
    Sha256 at_once;
    at_once.update(text.data(), text.size());
    const std::string bytewise = hash.hex_digest();
    EXPECT_EQ(at_once.hex_digest(), bytewise);
    return bytewise;
  };
  EXPECT_EQ(digest(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(digest("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(digest("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(digest(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

}  // namespace
}  // namespace locvol
