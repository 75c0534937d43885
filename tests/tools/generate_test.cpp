#include "tools/generate.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <numeric>
#include <ostream>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "octree/geometry.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"

namespace locvol {

void PrintTo(const ShapeInfo& shape, std::ostream* out) { *out << shape.name; }

namespace {

constexpr double kPi = std::numbers::pi;

using Indices = std::array<std::uint32_t, 3>;

struct GeneratedMesh {
  std::vector<Point> vertices;
  std::vector<Indices> triangles;

  Point corner(std::size_t t, std::size_t i) const { return vertices[triangles[t][i]]; }
  double volume() const {
    double sum = 0;
    for (std::size_t t = 0; t < triangles.size(); ++t)
      sum += dot(corner(t, 0), cross(corner(t, 1), corner(t, 2)));
    return sum / 6;
  }
};

template <typename T>
T read_at(const std::string& bytes, std::size_t place) {
  T value;
  std::memcpy(&value, bytes.data() + place, sizeof value);
  return value;
}

// Corners with equal coordinates become one vertex, in order of their first appearance.
GeneratedMesh read_stl(const std::filesystem::path& file) {
  const std::string bytes = bytes_of(file);
  GeneratedMesh mesh;
  mesh.triangles.resize(read_at<std::uint32_t>(bytes, 80));
  EXPECT_EQ(bytes.size(), 84 + 50 * mesh.triangles.size());
  std::map<std::array<float, 3>, std::uint32_t> ids;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      const auto p = read_at<std::array<float, 3>>(bytes, 84 + 50 * t + 12 * (i + 1));
      const auto [entry, is_new] = ids.emplace(p, mesh.vertices.size());
      if (is_new) mesh.vertices.push_back({p[0], p[1], p[2]});
      mesh.triangles[t][i] = entry->second;
    }
    const auto normal = read_at<std::array<float, 3>>(bytes, 84 + 50 * t);
    const Point edges =
        cross(mesh.corner(t, 1) - mesh.corner(t, 0), mesh.corner(t, 2) - mesh.corner(t, 0));
    EXPECT_NEAR(dot(edges, {normal[0], normal[1], normal[2]}) / norm(edges), 1, 1e-3);
  }
  return mesh;
}

GeneratedMesh read_ply(const std::filesystem::path& file) {
  const std::string bytes = bytes_of(file), mark = "end_header\n";
  const std::size_t start = bytes.find(mark) + mark.size();
  GeneratedMesh mesh;
  std::istringstream header(bytes.substr(0, start));
  for (std::string word; header >> word;) {
    std::size_t count = 0;
    if (word == "vertex" && header >> count) mesh.vertices.resize(count);
    if (word == "face" && header >> count) mesh.triangles.resize(count);
  }
  EXPECT_EQ(bytes.size(), start + 24 * mesh.vertices.size() + 13 * mesh.triangles.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto p = read_at<std::array<double, 3>>(bytes, start + 24 * v);
    mesh.vertices[v] = {p[0], p[1], p[2]};
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::size_t place = start + 24 * mesh.vertices.size() + 13 * t;
    EXPECT_EQ(bytes[place], 3);
    mesh.triangles[t] = read_at<Indices>(bytes, place + 1);
  }
  return mesh;
}

std::uint64_t edge(std::uint32_t from, std::uint32_t to) { return std::uint64_t{from} << 32 | to; }

// Edges are used once in each direction, and the triangles at a vertex form one cycle.
void expect_closed_oriented_manifold(const GeneratedMesh& mesh) {
  std::unordered_map<std::uint64_t, std::uint32_t> opposite;  // directed edge -> third corner
  for (const Indices& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      ASSERT_TRUE(opposite.emplace(edge(t[i], t[(i + 1) % 3]), t[(i + 2) % 3]).second);
  std::vector<std::size_t> num_triangles(mesh.vertices.size());
  std::vector<std::uint32_t> some_neighbor(mesh.vertices.size());
  for (const Indices& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      ASSERT_TRUE(opposite.contains(edge(t[(i + 1) % 3], t[i])));
      ++num_triangles[t[i]];
      some_neighbor[t[i]] = t[(i + 1) % 3];
    }
  }
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    ASSERT_GE(num_triangles[v], 3U) << "vertex " << v;
    std::size_t num_steps = 0;
    std::uint32_t at = some_neighbor[v];
    do {
      at = opposite.at(edge(v, at));
      ++num_steps;
    } while (at != some_neighbor[v] && num_steps <= num_triangles[v]);
    ASSERT_EQ(num_steps, num_triangles[v]) << "vertex " << v;
  }
}

void expect_no_degenerate_or_repeated_triangles(const GeneratedMesh& mesh) {
  std::set<Indices> seen;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Point a = mesh.corner(t, 0), b = mesh.corner(t, 1), c = mesh.corner(t, 2);
    const double longest = std::sqrt(
        std::max({squared_distance(a, b), squared_distance(b, c), squared_distance(c, a)}));
    ASSERT_GT(norm(cross(b - a, c - a)), 0.05 * longest * longest) << "triangle " << t;
    Indices sorted = mesh.triangles[t];
    std::ranges::sort(sorted);
    ASSERT_TRUE(seen.insert(sorted).second) << "triangle " << t;
  }
}

std::size_t num_components(const GeneratedMesh& mesh) {
  std::vector<std::uint32_t> up(mesh.vertices.size());
  std::iota(up.begin(), up.end(), 0U);
  const auto top = [&](std::uint32_t v) {
    while (up[v] != v) v = up[v] = up[up[v]];
    return v;
  };
  std::size_t count = up.size();
  for (const Indices& t : mesh.triangles) {
    for (const std::uint32_t other : {t[1], t[2]}) {
      if (top(t[0]) == top(other)) continue;
      up[top(other)] = top(t[0]);
      --count;
    }
  }
  return count;
}

int genus_of(const GeneratedMesh& mesh) {
  const auto v = static_cast<int>(mesh.vertices.size());
  const auto f = static_cast<int>(mesh.triangles.size());
  return 1 - (v - f / 2) / 2;
}

void expect_good_surface(const GeneratedMesh& mesh, const ShapeInfo& shape) {
  ASSERT_NO_FATAL_FAILURE(expect_closed_oriented_manifold(mesh));
  ASSERT_NO_FATAL_FAILURE(expect_no_degenerate_or_repeated_triangles(mesh));
  EXPECT_EQ(num_components(mesh), 1U);
  EXPECT_EQ(genus_of(mesh), shape.genus);
  EXPECT_GT(mesh.volume(), 0);
  for (const Point& p : mesh.vertices) ASSERT_LT(norm(p), 1.2);
}

class EveryShape : public testing::TestWithParam<ShapeInfo> {};

TEST_P(EveryShape, IsGoodAtManySizesInBothFormats) {
  const TempDir dir;
  for (const std::uint64_t wanted : {2'000, 5'000, 13'000, 20'000}) {
    if (wanted < GetParam().min_triangles) continue;
    SCOPED_TRACE(wanted);
    const GeneratedSurface made = generate(GetParam().name, wanted, dir / "s.stl");
    EXPECT_NEAR(static_cast<double>(made.num_triangles) / static_cast<double>(wanted), 1, 0.05);
    EXPECT_EQ(made.bytes, std::filesystem::file_size(dir / "s.stl"));
    const GeneratedMesh stl = read_stl(dir / "s.stl");
    EXPECT_EQ(stl.triangles.size(), made.num_triangles);
    EXPECT_EQ(stl.vertices.size(), made.num_vertices);
    ASSERT_NO_FATAL_FAILURE(expect_good_surface(stl, GetParam()));

    const GeneratedSurface again = generate(GetParam().name, wanted, dir / "s.ply");
    EXPECT_EQ(again.bytes, std::filesystem::file_size(dir / "s.ply"));
    const GeneratedMesh ply = read_ply(dir / "s.ply");
    ASSERT_NO_FATAL_FAILURE(expect_good_surface(ply, GetParam()));
    ASSERT_EQ(ply.triangles.size(), stl.triangles.size());
    for (std::size_t t = 0; t < ply.triangles.size(); ++t) {
      for (std::size_t i = 0; i < 3; ++i) {
        for (int axis = 0; axis < 3; ++axis)
          ASSERT_EQ(static_cast<float>(ply.corner(t, i)[axis]), stl.corner(t, i)[axis]);
      }
    }
  }
}

TEST_P(EveryShape, KeepsItsFormWithTheFewestTriangles) {
  const TempDir dir;
  generate(GetParam().name, GetParam().min_triangles, dir / "s.ply");
  const GeneratedMesh mesh = read_ply(dir / "s.ply");
  expect_good_surface(mesh, GetParam());
  EXPECT_NEAR(
      static_cast<double>(mesh.triangles.size()) / static_cast<double>(GetParam().min_triangles), 1,
      0.15);
  EXPECT_THROW(generate(GetParam().name, GetParam().min_triangles - 1, dir / "t.ply"),
               std::invalid_argument);
}

// A smooth surface: the error of the volume falls as the triangles grow in number.
TEST_P(EveryShape, ConvergesToOneVolume) {
  const TempDir dir;
  std::vector<double> volumes;
  for (const std::uint64_t wanted : {20'000, 80'000, 320'000}) {
    generate(GetParam().name, wanted, dir / "s.ply");
    volumes.push_back(read_ply(dir / "s.ply").volume());
  }
  const double first = volumes[1] - volumes[0], second = volumes[2] - volumes[1];
  EXPECT_LT(std::abs(first), 0.025 * volumes[2]);
  EXPECT_NEAR(first / second, 4, 0.5);
}

TEST_P(EveryShape, GivesEqualBytesEveryTime) {
  const TempDir dir;
  for (const std::string name : {"a.stl", "b.stl"}) generate(GetParam().name, 15'000, dir / name);
  EXPECT_EQ(bytes_of(dir / "a.stl"), bytes_of(dir / "b.stl"));
}

INSTANTIATE_TEST_SUITE_P(Shapes, EveryShape, testing::ValuesIn(shapes().begin(), shapes().end()),
                         [](const auto& parameter) {
                           std::string name(parameter.param.name);
                           std::ranges::replace(name, '-', '_');
                           return name;
                         });

TEST(Generate, VolumesNearTheirFormulas) {
  const TempDir dir;
  const auto volume = [&](const char* shape) {
    generate(shape, 20'000, dir / "s.ply");
    return read_ply(dir / "s.ply").volume();
  };
  EXPECT_NEAR(volume("sphere"), 4 * kPi / 3, 0.005);
  EXPECT_NEAR(volume("torus"), 2 * kPi * kPi * 0.7 * 0.3 * 0.3, 0.005);
  // The length of the trefoil times the section of its tube.
  double length = 0;
  const auto knot = [](double t) {
    return 1.0 / 3 *
           Point{std::sin(t) + 2 * std::sin(2 * t), std::cos(t) - 2 * std::cos(2 * t),
                 -std::sin(3 * t)};
  };
  for (int i = 0; i < 10000; ++i)
    length += norm(knot(2 * kPi * (i + 1) / 10000) - knot(2 * kPi * i / 10000));
  EXPECT_NEAR(volume("knot"), length * kPi * 0.16 * 0.16, 0.01);
}

TEST(Generate, SmallNumbersComeClose) {
  const TempDir dir;
  for (std::uint64_t wanted = 12; wanted < 600; wanted += 7) {
    const GeneratedSurface made = generate("sphere", wanted, dir / "s.stl");
    EXPECT_NEAR(static_cast<double>(made.num_triangles), static_cast<double>(wanted),
                std::max(16.0, 0.12 * static_cast<double>(wanted)));
    expect_closed_oriented_manifold(read_stl(dir / "s.stl"));
  }
}

TEST(Generate, RefusesWhatItCannotMake) {
  const TempDir dir;
  EXPECT_THROW(generate("cube", 1000, dir / "s.stl"), std::invalid_argument);
  EXPECT_THROW(generate("sphere", 1000, dir / "s.obj"), std::invalid_argument);
  EXPECT_THROW(generate("sphere", 1000, dir / "stl"), std::invalid_argument);
  EXPECT_THROW(generate("sphere", 0, dir / "s.stl"), std::invalid_argument);
  EXPECT_THROW(generate("sphere", 5'000'000'000, dir / "s.stl"), std::invalid_argument);
  EXPECT_THROW(generate("sphere", 10'000'000'000, dir / "s.ply"), std::invalid_argument);
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
}

// The grains of a polycrystal, each with vertices of its own; its vertices' numbers in the file are
// in `numbers`.
struct GeneratedGrain {
  GeneratedMesh mesh;
  std::vector<std::uint32_t> numbers;
};
std::vector<GeneratedGrain> read_grains(const std::filesystem::path& file) {
  const std::string bytes = bytes_of(file), mark = "end_header\n";
  const std::size_t start = bytes.find(mark) + mark.size();
  std::size_t num_vertices = 0, num_faces = 0;
  std::istringstream header(bytes.substr(0, start));
  for (std::string word; header >> word;) {
    if (word == "vertex") header >> num_vertices;
    if (word == "face") header >> num_faces;
  }
  EXPECT_EQ(bytes.size(), start + 24 * num_vertices + 17 * num_faces);
  std::vector<GeneratedGrain> grains;
  std::vector<std::unordered_map<std::uint32_t, std::uint32_t>> places;
  for (std::size_t f = 0; f < num_faces; ++f) {
    const std::size_t at = start + 24 * num_vertices + 17 * f;
    const auto number = read_at<std::uint32_t>(bytes, at + 13);
    EXPECT_GE(number, std::max<std::size_t>(grains.size(), 1));  // they come one after another
    grains.resize(std::max<std::size_t>(grains.size(), number));
    places.resize(grains.size());
    auto& [mesh, numbers] = grains.at(number - 1);
    Indices& triangle = mesh.triangles.emplace_back();
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t v = read_at<Indices>(bytes, at + 1)[i];
      const auto [place, is_new] =
          places[number - 1].try_emplace(v, static_cast<std::uint32_t>(numbers.size()));
      triangle[i] = place->second;
      if (!is_new) continue;
      const auto p = read_at<std::array<double, 3>>(bytes, start + 24 * v);
      mesh.vertices.push_back({p[0], p[1], p[2]});
      numbers.push_back(v);
    }
  }
  return grains;
}

bool is_on_cube(const Point& a, const Point& b, const Point& c) {
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(a[axis]) == 1 && a[axis] == b[axis] && b[axis] == c[axis]) return true;
  return false;
}

// Each is closed and turned outwards; they fill the cube; and what is not of the cube's sides is
// there twice, once with each of two grains, turned the other way.
TEST(Generate, APolycrystalFillsItsCube) {
  const TempDir dir;
  for (const std::uint64_t num : {1, 2, 30, 1000}) {
    for (const std::uint64_t seed : {0, 7}) {
      SCOPED_TRACE(testing::Message() << num << " grains of seed " << seed);
      const GeneratedSurface made = generate_polycrystal(num, seed, dir / "p.ply");
      EXPECT_EQ(made.bytes, std::filesystem::file_size(dir / "p.ply"));
      const std::vector<GeneratedGrain> grains = read_grains(dir / "p.ply");
      ASSERT_EQ(grains.size(), num);
      double volume = 0;
      std::map<Indices, int> sides;  // of a triangle between grains: one turned so, one otherwise
      for (const auto& [mesh, numbers] : grains) {
        ASSERT_NO_FATAL_FAILURE(expect_closed_oriented_manifold(mesh));
        EXPECT_EQ(num_components(mesh), 1U);
        EXPECT_EQ(genus_of(mesh), 0);
        EXPECT_GT(mesh.volume(), 0);
        volume += mesh.volume();
        for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
          if (is_on_cube(mesh.corner(t, 0), mesh.corner(t, 1), mesh.corner(t, 2))) continue;
          Indices named;
          for (std::size_t i = 0; i < 3; ++i) named[i] = numbers[mesh.triangles[t][i]];
          std::ranges::rotate(named, std::ranges::min_element(named));
          const bool is_turned = named[1] > named[2];
          if (is_turned) std::swap(named[1], named[2]);
          int& sum = sides.try_emplace(named, 0).first->second;
          ASSERT_EQ(sum & (is_turned ? 2 : 1), 0);
          sum |= is_turned ? 2 : 1;
        }
      }
      EXPECT_NEAR(volume, 8, 1e-12);
      EXPECT_TRUE(std::ranges::all_of(sides, [](const auto& side) { return side.second == 3; }));
    }
  }
}

TEST(Generate, APolycrystalIsAFunctionOfItsSeed) {
  const TempDir dir;
  generate_polycrystal(50, 3, dir / "a.ply");
  generate_polycrystal(50, 3, dir / "b.ply");
  generate_polycrystal(50, 4, dir / "c.ply");
  EXPECT_EQ(bytes_of(dir / "a.ply"), bytes_of(dir / "b.ply"));
  EXPECT_NE(bytes_of(dir / "a.ply"), bytes_of(dir / "c.ply"));
  EXPECT_THROW(generate_polycrystal(0, 3, dir / "d.ply"), std::invalid_argument);
  EXPECT_THROW(generate_polycrystal(10'001, 3, dir / "d.ply"), std::invalid_argument);
  EXPECT_THROW(generate_polycrystal(3, 3, dir / "d.stl"), std::invalid_argument);
}

TEST(Generate, NamesTheFileThatCannotBeWritten) {
  const TempDir dir;
  const std::string file = dir / "missing/s.stl";
  try {
    generate("sphere", 1000, file);
    FAIL() << "wrote into a folder that is not there";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find(file), std::string::npos) << error.what();
  }
}

// Writing past a limit on the size of files fails as a full disk does.
class SmallFilesOnly {
 public:
  explicit SmallFilesOnly(rlim_t max_bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &saved_);
    const rlimit limit = {max_bytes, saved_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  SmallFilesOnly(const SmallFilesOnly&) = delete;
  SmallFilesOnly& operator=(const SmallFilesOnly&) = delete;
  ~SmallFilesOnly() {
    setrlimit(RLIMIT_FSIZE, &saved_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit saved_{};
  void (*handler_)(int);
};

TEST(Generate, LeavesNothingBehindWhenTheDiskIsFull) {
  const TempDir dir;
  for (const std::string name : {"s.stl", "s.ply"}) {
    for (const rlim_t max_bytes : {rlim_t{10'000}, rlim_t{2'500'000}}) {
      const SmallFilesOnly limit(max_bytes);
      EXPECT_THROW(generate("bracelet", 100'000, dir / name), std::runtime_error);
      EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
    }
  }
}

TEST(Generate, ReplacesAFileAndLeavesNoPartialOne) {
  const TempDir dir;
  std::ofstream(dir / "s.ply") << "old";
  generate("torus", 1000, dir / "s.ply");
  EXPECT_EQ(genus_of(read_ply(dir / "s.ply")), 1);
  EXPECT_FALSE(std::filesystem::exists(dir / "s.ply.partial"));
  EXPECT_FALSE(std::filesystem::exists(dir / "s.ply.partial.faces"));
}

}  // namespace
}  // namespace locvol
