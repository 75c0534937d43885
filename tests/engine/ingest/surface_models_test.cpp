// The shared models: each is what its table says, and each bad file ends as its class demands.

#include <gtest/gtest.h>

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tests/directories.h"
#include "tests/engine/ingest/surface_fixtures.h"
#include "tests/skip_reasons.h"

namespace locvol {
namespace {

const std::filesystem::path kModels = models_directory();

struct Model {
  const char* file;
  std::uint64_t num_vertices, num_triangles, num_components;
  std::int64_t genus;
  double volume;
};

constexpr Model kGoodModels[] = {
    {"9handletorus.ply", 9392, 18816, 1, 9, 271.275},
    {"3holes.ply", 3596, 7200, 1, 3, 0.0994653},
    {"homer.ply", 6002, 12000, 1, 0, 0.0212419},
    {"lucy.ply", 49987, 99970, 1, 0, 8.16725e+07},
    {"bimba.ply", 50001, 99998, 1, 0, 0.166718},
    {"happy_buddha.ply", 49893, 99822, 1, 10, 0.354063},
    {"chinese_lion.ply", 25194, 50384, 1, 0, 229769},
    {"stanford_bunny.ply", 35162, 70320, 1, 0, 0.000754572},
    {"armadillo.ply", 43243, 86482, 1, 0, 0.0686187},
    {"dragon.ply", 50002, 100004, 1, 1, 155.747},
    {"elephant.off", 2775, 5558, 1, 3, 0.0462012},
    {"fandisk.ply", 6475, 12946, 1, 0, 20.2434},
    {"rocker_arm.obj", 10044, 20088, 1, 1, 0.0425136},
    {"joint.off", 221, 446, 1, 2, 0.359494},
    {"anchor.ply", 3793, 7598, 1, 4, 0.143541},
    {"cheese.ply", 8629, 17786, 1, 133, 0.000441185},
    {"menger_sponge_3.ply", 7983, 21598, 1, 1409, 0.406442},
    {"dancing_children.ply", 12163, 24354, 1, 8, 0.670694},
    {"fertility.ply", 26222, 52456, 1, 4, 0.029367},
    {"turbine.ply", 9210, 18460, 1, 11, 0.0363093},
    {"eyeglasses.ply", 29674, 59344, 1, 0, 0.0124647},
    {"knot.ply", 3200, 6400, 1, 1, 0.0951747},
    {"nested_shells.ply", 3075, 6138, 3, 0, 99972.8},
    {"thingi_73416.stl", 38396, 76840, 1, 13, 12850.8},
    {"thingi_112932.stl", 3932, 7880, 2, 6, 2402.95},
    {"cube.off", 8, 12, 1, 0, 8},
};

// What is to become of a bad file: the message contains `refusal`, or, where that is empty, the
// file is accepted with this volume.
struct BadModel {
  const char* file;
  const char* refusal;
  double volume = 0;
};

constexpr double kJointVolume = 0.359494, kNestedVolume = 99972.8;
constexpr BadModel kBadModels[] = {
    // not a volume: reject
    {"open_cube.off", "4 edges belong to one triangle only"},
    {"open_head.off", "not closed"},
    {"elephant_with_holes.off", "not closed"},
    {"moebius_strip.off", "not closed"},
    {"zero_volume_square.off", "doubled faces"},
    {"random_soup.stl", "300 edges belong to one triangle only"},
    {"points_only.ply", "no faces"},
    {"degenerate_open_sliding.off", "not closed"},
    {"nearly_duplicated_vertices_joint.off", "not closed"},
    // self-intersecting
    {"spheres_intersecting.off", "intersects itself"},
    {"self_intersecting_sphere.obj", "intersects itself"},
    // non-manifold
    {"nonmanifold_edge_two_cubes.off", "more than two triangles"},
    {"nonmanifold_vertex_two_cubes.off", "(1, 1, 1)"},
    {"nonmanifold_face_graph.off", "not closed"},
    {"joined_tetrahedra.obj", "3 edges belong to more than two triangles"},
    // degenerate triangles: the nearly collinear ones of the first are folds
    {"degenerate_closed_joint.off", "intersects itself"},
    {"collapsed_edge_joint.off", "", 0.359556},
    // repairable
    {"duplicated_vertices_joint.off", "", kJointVolume},
    {"unstitched_box.ply", "", 1},
    {"duplicate_faces_joint.off", "", kJointVolume},
    {"inconsistent_orientation_blobby.off", "", 0.0500825},
    {"inward_tetrahedron.off", "", 1.0 / 6},
    {"inward_joint.off", "", kJointVolume},
    {"nested_shells_all_outward.ply", "", kNestedVolume},
    {"isolated_vertices_cube.off", "", 8},
    // valid, only unusual
    {"polygonal_faces.off", "", 1971.06},
    {"comments_quads.off", "", 12.3168},
    {"crlf_cube.off", "", 8},
    {"ascii_joint.stl", "", kJointVolume},
    {"ascii_joint.ply", "", kJointVolume},
    {"big_endian_joint.ply", "", kJointVolume},
    // valid but extreme
    {"thin_plate_1e-6.off", "", 8e-6},
    {"huge_coordinates.off", "another unit"},
    {"tiny_coordinates.off", "another unit"},
    // bad files
    {"nan_coordinate.off", "line 6"},
    {"inf_coordinate.off", "line 8"},
    {"nan_binary.ply", "vertex 2"},
    {"empty_file.off", "0 bytes"},
    {"zero_counts.off", "no vertices"},
    {"empty.ply", "no vertices"},
    {"empty.stl", "no vertices"},
    {"empty.obj", "no vertices"},
    {"truncated.obj", "line 9"},
    {"truncated.off", "83 bytes"},
    {"truncated.ply", "72 bytes"},
    {"truncated.stl", "promises 20 triangles"},
    {"truncated_binary_3holes.ply", "cut off"},
    {"corrupted_invalid_double.off", "X0.425325"},
    {"corrupted_invalid_facet_vertex.off", "vertex 100"},
    {"corrupted_invalid_facet_vertex.obj", "line 20"},
    {"corrupted_invalid_face_count.ply", "cut off"},
    {"corrupted_invalid_triangle_count.stl", "promises 22 triangles"},
    {"lying_header.ply", "2000000000"},
    {"lying_header.off", "2000000000"},
    {"lying_header.stl", "4000000000"},
    {"not_a_mesh.off", "no OFF file"},
    {"not_a_mesh.stl", "no whole STL file"},
    {"stl_named_off.off", "rename it to .stl"},
};

std::set<std::string> surface_files(const std::filesystem::path& directory) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(directory)) {
    const std::string extension = entry.path().extension();
    if (extension == ".ply" || extension == ".off" || extension == ".obj" || extension == ".stl")
      names.insert(entry.path().filename());
  }
  return names;
}

template <std::size_t N, typename Row>
std::set<std::string> names_of(const Row (&table)[N]) {
  std::set<std::string> names;
  for (const Row& row : table) names.insert(row.file);
  return names;
}

class SurfaceModels : public testing::Test {
 protected:
  void SetUp() override {
    if (kModels.empty()) GTEST_SKIP() << kNoModels;
  }
};

TEST_F(SurfaceModels, TablesNameEveryFile) {
  EXPECT_EQ(surface_files(kModels), names_of(kGoodModels));
  EXPECT_EQ(surface_files(kModels / "bad"), names_of(kBadModels));
}

TEST_F(SurfaceModels, GoodModelsAreWhatTheirTableSays) {
  for (const Model& model : kGoodModels) {
    SCOPED_TRACE(model.file);
    const InputSurface s = read_whole_surface(kModels / model.file);
    EXPECT_EQ(s.facts.num_vertices, model.num_vertices);
    EXPECT_EQ(s.facts.num_triangles, model.num_triangles);
    EXPECT_EQ(s.facts.num_components, model.num_components);
    EXPECT_EQ(s.facts.euler_characteristic,
              2 * static_cast<std::int64_t>(model.num_components) - 2 * model.genus);
    EXPECT_NEAR(s.facts.volume, model.volume, 5e-6 * model.volume);
    EXPECT_TRUE(s.facts.notes.empty()) << s.facts.notes.front();
    expect_closed(s);
  }
}

TEST_F(SurfaceModels, BadFilesEndAsTheirClassDemands) {
  for (const BadModel& model : kBadModels) {
    SCOPED_TRACE(model.file);
    const std::string expected = model.refusal;
    try {
      const InputSurface s = read_whole_surface(kModels / "bad" / model.file);
      EXPECT_TRUE(expected.empty()) << "accepted, but should be refused with: " << expected;
      EXPECT_NEAR(s.facts.volume, model.volume, 1e-5 * model.volume);
      expect_closed(s);
    } catch (const InputError& error) {
      EXPECT_FALSE(expected.empty()) << error.what();
      EXPECT_NE(std::string(error.what()).find(expected), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find(model.file), std::string::npos) << error.what();
    }
  }
}

TEST_F(SurfaceModels, NestedShellsHaveOneVolumeHoweverTheyFace) {
  EXPECT_DOUBLE_EQ(
      read_whole_surface(kModels / "bad" / "nested_shells_all_outward.ply").facts.volume,
      read_whole_surface(kModels / "nested_shells.ply").facts.volume);
}

}  // namespace
}  // namespace locvol
