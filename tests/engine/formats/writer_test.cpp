#include "engine/formats/writer.h"

#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <string>

#include "tests/engine/file_size_limit.h"
#include "tests/engine/formats/meshed_sphere.h"
#include "tests/engine/hand_made_mesh.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

// Reads back what the writer promises to write, and nothing else of the format.
class Vtu {
 public:
  explicit Vtu(const std::filesystem::path& file) : bytes_(bytes_of(file)) {
    EXPECT_TRUE(bytes_.starts_with("<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" "));
    EXPECT_NE(bytes_.find("byte_order=\"LittleEndian\" header_type=\"UInt64\""), std::string::npos);
    const std::string mark = "<AppendedData encoding=\"raw\">";
    data_ = bytes_.find('_', bytes_.find(mark) + mark.size()) + 1;
    EXPECT_EQ(data_ % 8, 0u);
    const std::size_t num_points = number("NumberOfPoints=\""),
                      num_cells = number("NumberOfCells=\"");
    points = array<Point>("Float64", "Points");
    cells = array<std::array<std::int32_t, 4>>("Int32", "connectivity");
    offsets = array<std::int32_t>("Int32", "offsets");
    types = array<std::uint8_t>("UInt8", "types");
    leaves = array<std::uint32_t>("UInt32", "leaf");
    EXPECT_EQ(points.size(), num_points);
    for (const std::size_t n : {cells.size(), offsets.size(), types.size(), leaves.size()}) {
      EXPECT_EQ(n, num_cells);
    }
    EXPECT_EQ(bytes_.substr(end_), "\n  </AppendedData>\n</VTKFile>\n");
  }

  std::size_t size() const { return bytes_.size(); }

  // Cells by coordinates, each from its smallest vertex on and in positive orientation.
  std::multiset<std::array<Point, 4>> placed_cells() const {
    std::multiset<std::array<Point, 4>> result;
    for (const auto& cell : cells) {
      std::array<Point, 4> p;
      for (std::size_t i = 0; i < 4; ++i) p[i] = points.at(static_cast<std::size_t>(cell[i]));
      EXPECT_GT(exact_orientation(p[0], p[1], p[2], p[3]), 0);
      std::ranges::sort(p);
      result.insert(p);
    }
    return result;
  }

  std::vector<Point> points;
  std::vector<std::array<std::int32_t, 4>> cells;
  std::vector<std::int32_t> offsets;
  std::vector<std::uint8_t> types;
  std::vector<std::uint32_t> leaves;

 private:
  std::size_t number(const std::string& before, std::size_t from = 0) const {
    return std::stoull(bytes_.substr(bytes_.find(before, from) + before.size(), 24));
  }

  template <class T>
  std::vector<T> array(const std::string& type, const std::string& name) {
    const std::size_t tag = bytes_.find("<DataArray type=\"" + type + "\" Name=\"" + name + "\"");
    EXPECT_NE(tag, std::string::npos) << name;
    const std::size_t place = data_ + number("offset=\"", tag);
    std::uint64_t num_bytes = 0;
    std::memcpy(&num_bytes, &bytes_.at(place), 8);
    EXPECT_LE(place + 8 + num_bytes, bytes_.size());
    std::vector<T> values(num_bytes / sizeof(T));
    if (num_bytes > 0) std::memcpy(values.data(), &bytes_.at(place + 8), num_bytes);
    end_ = std::max(end_, place + 8 + num_bytes);
    return values;
  }

  std::string bytes_;
  std::size_t data_ = 0, end_ = 0;
};

std::multiset<std::array<Point, 4>> placed_cells(const HandMadeMesh& mesh) {
  std::multiset<std::array<Point, 4>> result;
  for (const CellIds& cell : mesh.cells) {
    auto p = mesh.corners(cell);
    std::ranges::sort(p);
    result.insert(p);
  }
  return result;
}

HandMadeMesh with_unused_points(HandMadeMesh mesh) {
  for (int i = 0; i < 40; ++i) {
    const double x = -1.9 + 0.19 * i;
    mesh.points.push_back({mesh.next_id(), {x, 5.5, 0.1 * i}, PointKind::kVolume});
  }
  return mesh;
}

TEST(Writer, AnyOctreeGivesTheSameMesh) {
  for (const HandMadeMesh& used : different_meshes()) {
    const HandMadeMesh mesh = with_unused_points(used);
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const TempDir dir;
      const Store store = HandMadeStore(mesh, octree).write(dir / "store");
      const WriteSummary summary = write_vtu(store, dir / "mesh.vtu");
      const Vtu vtu(dir / "mesh.vtu");
      EXPECT_EQ(vtu.placed_cells(), placed_cells(mesh));
      EXPECT_EQ(vtu.points.size(), mesh.used_ids().size());
      EXPECT_EQ(std::set(vtu.points.begin(), vtu.points.end()).size(), vtu.points.size());
      EXPECT_EQ(summary.num_vertices, vtu.points.size());
      EXPECT_EQ(summary.num_cells, mesh.cells.size());
      EXPECT_EQ(summary.bytes, vtu.size());
      EXPECT_EQ(names_in(dir), (Names{"mesh.vtu", "store"}));
    }
  }
}

TEST(Writer, NumbersVerticesLeafByLeafAndThenById) {
  const HandMadeMesh mesh = with_unused_points(lattice_ball({2, 2, 2}, 2.6));
  for (const LinearOctree& octree : octrees()) {
    std::vector<std::pair<MortonKey, std::uint64_t>> order;
    for (const std::uint64_t id : mesh.used_ids()) {
      order.emplace_back(octree.leaf_owning(hand_made_frame(), mesh.point(id).position), id);
    }
    std::ranges::sort(order);
    const TempDir dir;
    write_vtu(HandMadeStore(mesh, octree).write(dir / "store"), dir / "mesh.vtu");
    const Vtu vtu(dir / "mesh.vtu");
    ASSERT_EQ(vtu.points.size(), order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
      EXPECT_EQ(vtu.points[i], mesh.point(order[i].second).position);
    }
  }
}

TEST(Writer, CellsCarryTheLeafOfTheirSmallestVertex) {
  const HandMadeMesh mesh = lattice_ball({2, 2, 2}, 2.6);
  const LinearOctree octree = mixed_octree();
  const TempDir dir;
  write_vtu(HandMadeStore(mesh, octree).write(dir / "store"), dir / "mesh.vtu");
  const Vtu vtu(dir / "mesh.vtu");
  EXPECT_TRUE(std::ranges::is_sorted(vtu.leaves));
  for (std::size_t i = 0; i < vtu.cells.size(); ++i) {
    std::array<Point, 4> p;
    for (std::size_t k = 0; k < 4; ++k)
      p[k] = vtu.points[static_cast<std::size_t>(vtu.cells[i][k])];
    EXPECT_EQ(octree.leaves()[vtu.leaves[i]],
              octree.leaf_owning(hand_made_frame(), std::ranges::min(p)));
    EXPECT_EQ(vtu.types[i], 10);
    EXPECT_EQ(vtu.offsets[i], static_cast<std::int64_t>(4 * (i + 1)));
  }
}

TEST(Writer, TheSameStoreGivesTheSameBytes) {
  const TempDir dir;
  const Store store =
      HandMadeStore(lattice_ball({2, 2, 2}, 2.6), mixed_octree()).write(dir / "store");
  write_vtu(store, dir / "once.vtu");
  write_vtu(store, dir / "twice.vtu");
  EXPECT_EQ(bytes_of(dir / "once.vtu"), bytes_of(dir / "twice.vtu"));
}

TEST(Writer, AnyNumberOfThreadsGivesTheSameBytes) {
  const TempDir dir;
  const RunSummary run = mesh_sphere(dir, 0.05);
  ASSERT_GT(run.run.counts.num_cells, 80'000U);
  const Store store = Store::open(dir / "store", {.read_only = true});
  write_vtu(store, dir / "mesh.vtu");
  const Vtu vtu(dir / "mesh.vtu");
  ASSERT_EQ(vtu.cells.size(), run.run.counts.num_cells);
  EXPECT_TRUE(std::ranges::is_sorted(vtu.leaves));
  for (std::size_t i = 0; i < vtu.cells.size(); ++i) {
    ASSERT_EQ(vtu.types[i], 10);
    ASSERT_EQ(vtu.offsets[i], static_cast<std::int64_t>(4 * (i + 1)));
    for (const std::int32_t v : vtu.cells[i])
      ASSERT_LT(static_cast<std::size_t>(v), vtu.points.size());
  }
  for (const int num_threads : {2, 3, 8}) {
    write_vtu(store, dir / "again.vtu", num_threads);
    EXPECT_TRUE(bytes_of(dir / "again.vtu") == bytes_of(dir / "mesh.vtu")) << num_threads;
  }
}

TEST(Writer, AMeshWithoutCellsIsAnEmptyFile) {
  const TempDir dir;
  const Store store = HandMadeStore(HandMadeMesh{}, LinearOctree::uniform(1)).write(dir / "store");
  const WriteSummary summary = write_vtu(store, dir / "mesh.vtu");
  const Vtu vtu(dir / "mesh.vtu");
  EXPECT_TRUE(vtu.points.empty());
  EXPECT_TRUE(vtu.cells.empty());
  EXPECT_EQ(summary.num_cells, 0u);
}

TEST(Writer, ReplacesAnOlderFileAndAStalePartialOne) {
  const TempDir dir;
  std::ofstream(dir / "mesh.vtu") << "old";
  std::ofstream(dir / "mesh.vtu.partial") << std::string(1 << 20, 'x');
  const HandMadeMesh mesh = cubes(1, [](int, int, int) { return true; });
  write_vtu(HandMadeStore(mesh, mixed_octree()).write(dir / "store"), dir / "mesh.vtu");
  EXPECT_EQ(Vtu(dir / "mesh.vtu").cells.size(), 6u);
  EXPECT_EQ(names_in(dir), (Names{"mesh.vtu", "store"}));
}

// Writing fails, says why with the file's name, and leaves the directory as it was.
void expect_failure(const Store& store, const TempDir& dir, const std::filesystem::path& file,
                    const std::string& reason) {
  const std::vector<std::string> before = names_in(dir);
  try {
    write_vtu(store, file);
    FAIL() << "wrote " << file;
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find(file.filename().string()), std::string::npos)
        << error.what();
    EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
  }
  EXPECT_EQ(names_in(dir), before);
}

TEST(WriterFailure, NoSuchDirectoryOrNotADirectory) {
  const TempDir dir;
  const Store store =
      HandMadeStore(lattice_ball({2, 2, 2}, 2), mixed_octree()).write(dir / "store");
  expect_failure(store, dir, dir / "none" / "mesh.vtu", "No such file or directory");
  std::ofstream(dir / "file") << "text";
  expect_failure(store, dir, dir / "file" / "mesh.vtu", "Not a directory");
}

TEST(WriterFailure, TheNameIsADirectory) {
  const TempDir dir;
  const Store store =
      HandMadeStore(lattice_ball({2, 2, 2}, 2), mixed_octree()).write(dir / "store");
  std::filesystem::create_directories(dir / "mesh.vtu");
  expect_failure(store, dir, dir / "mesh.vtu", "Is a directory");
}

TEST(WriterFailure, NoRoom) {
  const TempDir dir;
  const Store store =
      HandMadeStore(lattice_ball({2, 2, 2}, 2.6), mixed_octree()).write(dir / "store");
  std::ofstream(dir / "mesh.vtu") << "old";
  {
    const FileSizeLimit limit(4096);  // enough for the table of ids
    expect_failure(store, dir, dir / "mesh.vtu", "File too large");
  }
  {
    const FileSizeLimit limit(64);  // not even for that
    expect_failure(store, dir, dir / "mesh.vtu", "File too large");
  }
  EXPECT_EQ(bytes_of(dir / "mesh.vtu"), "old");
}

TEST(WriterFailure, UnfinishedRun) {
  const TempDir dir;
  HandMadeStore records(lattice_ball({2, 2, 2}, 2), mixed_octree());
  records.phase = Phase::kRefine;
  const Store store = records.write(dir / "store");
  EXPECT_THROW(write_vtu(store, dir / "mesh.vtu"), StoreError);
  EXPECT_EQ(names_in(dir), (Names{"store"}));
}

void expect_corrupt(const HandMadeStore& records, const std::string& reason) {
  const TempDir dir;
  const Store store = records.write(dir / "store");
  try {
    write_vtu(store, dir / "mesh.vtu");
    FAIL() << "wrote a mesh from records with " << reason;
  } catch (const CorruptRecord& error) {
    EXPECT_TRUE(error.leaf().is_valid());
    EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
  }
  EXPECT_EQ(names_in(dir), (Names{"store"}));
}

TEST(WriterFailure, RecordsThatContradictEachOther) {
  const HandMadeStore good(lattice_ball({2, 2, 2}, 2.6), mixed_octree());
  const auto first_with_cells = [](HandMadeStore& store) -> HandMadeStore::Leaf& {
    return std::ranges::find_if(store.leaves,
                                [](const auto& entry) {
                                  return entry.second.cells.cells.size() > 1 &&
                                         entry.second.points.points.size() > 1;
                                })
        ->second;
  };
  HandMadeStore store = good;
  first_with_cells(store).cells.vertices.back() = 1000000;
  expect_corrupt(store, "1000000");

  store = good;
  auto& vertices = first_with_cells(store).cells.vertices;
  std::swap(vertices[0], vertices[1]);
  expect_corrupt(store, "order of id");

  store = good;
  auto& points = first_with_cells(store).points.points;
  std::swap(points[0], points[1]);
  expect_corrupt(store, "order of id");
}

}  // namespace
}  // namespace locvol
