#include "engine/formats/formats.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <string>

#include "engine/formats/mesh_arrays.h"
#include "engine/formats/mesh_format.h"
#include "engine/formats/output_estimate.h"
#include "engine/formats/writer.h"
#include "tests/engine/file_size_limit.h"
#include "tests/engine/formats/meshed_sphere.h"
#include "tests/engine/hand_made_mesh.h"
#include "tests/file_bytes.h"
#include "tests/stops_at.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using Triangle3 = std::array<Point, 3>;

Triangle3 smallest_first(Triangle3 triangle) {
  std::ranges::rotate(triangle, std::ranges::min_element(triangle));
  return triangle;
}

// Of the cell's facets those that no other cell has, the way round that has the cell behind.
std::multiset<Triangle3> boundary_triangles(const HandMadeMesh& mesh) {
  std::multiset<Triangle3> result;
  for (const auto& ids : boundary_of(mesh)) {
    const auto is_in = [&](const CellIds& cell) {
      return std::ranges::all_of(
          ids, [&](std::uint64_t id) { return std::ranges::find(cell, id) != cell.end(); });
    };
    const CellIds& cell = *std::ranges::find_if(mesh.cells, is_in);
    const std::uint64_t apex = *std::ranges::find_if(
        cell, [&](std::uint64_t id) { return std::ranges::find(ids, id) == ids.end(); });
    Triangle3 t;
    for (std::size_t i = 0; i < 3; ++i) t[i] = mesh.point(ids[i]).position;
    if (exact_orientation(t[0], t[1], t[2], mesh.point(apex).position) > 0) std::swap(t[1], t[2]);
    result.insert(smallest_first(t));
  }
  return result;
}

TEST(BoundarySurface, IsTheFacetsInOneCellOutwardUnderAnyOctree) {
  for (const HandMadeMesh& mesh : different_meshes()) {
    const auto expected = boundary_triangles(mesh);
    for (const LinearOctree& octree : octrees()) {
      SCOPED_TRACE(octree.size());
      const TempDir dir;
      const Store store = HandMadeStore(mesh, octree).write(dir / "store");
      MeshSource source(store, dir / "mesh", 2);
      BoundarySurface& boundary = source.boundary();
      ASSERT_EQ(boundary.num_facets(), expected.size());
      const std::uint64_t num_vertices = boundary.num_vertices();

      std::vector<Point> positions;
      const auto vertices = boundary.vertices();
      while (const auto some = vertices()) {
        EXPECT_EQ(some->first, positions.size());
        EXPECT_TRUE(std::ranges::is_sorted(some->vertices));
        positions.insert(positions.end(), some->positions.begin(), some->positions.end());
      }
      EXPECT_EQ(positions.size(), num_vertices);
      EXPECT_EQ(std::set(positions.begin(), positions.end()).size(), positions.size());

      std::multiset<Triangle3> by_corners, by_places;
      std::uint64_t last_cell = 0;
      const auto facets = boundary.facets({.has_corners = true, .has_places = true});
      while (const auto some = facets()) {
        for (const Triangle3& corners : some->corners) by_corners.insert(smallest_first(corners));
        for (const auto& [a, b, c] : some->places)
          by_places.insert(smallest_first({positions.at(a), positions.at(b), positions.at(c)}));
        for (const BoundaryFacet& facet : some->facets) {
          EXPECT_GE(facet.cell, last_cell);
          last_cell = facet.cell;
        }
      }
      EXPECT_EQ(by_corners, expected);
      EXPECT_EQ(by_places, expected);
    }
  }
}

// All that it can hold.
OutputOptions all_of(const FormatInfo& format) {
  return {format.format, format.has_cell_data, false, true};
}

class EveryFormat : public testing::TestWithParam<FormatInfo> {
 protected:
  static void SetUpTestSuite() {
    dir_.emplace();
    ASSERT_GT(mesh_sphere(*dir_, 0.06).run.counts.num_cells, 40'000U);
  }
  static void TearDownTestSuite() { dir_.reset(); }

  static Store store() { return Store::open(*dir_ / "store", {.read_only = true}); }
  static OutputOptions options() { return all_of(GetParam()); }
  // All that can be written.
  static std::vector<OutputOptions> outputs() {
    std::vector<OutputOptions> outputs = {{GetParam().format}, options()};
    if (GetParam().has_second_order()) {
      outputs.push_back(options());
      outputs.back().order = 2;
    }
    return outputs;
  }
  static std::string bytes_written(const OutputOptions& output, int num_threads) {
    const TempDir dir;
    const WriteSummary written = write_mesh(store(), dir / "mesh", output, num_threads);
    std::string all;
    for (const std::string& name : names_in(dir)) all += bytes_of(dir / name);
    EXPECT_EQ(written.bytes, all.size());
    return all;
  }

  static inline std::optional<TempDir> dir_;
};

TEST_P(EveryFormat, AnyNumberOfThreadsGivesTheSameBytes) {
  for (const OutputOptions& output : outputs()) {
    const std::string bytes = bytes_written(output, 1);
    for (const int num_threads : {2, 5}) EXPECT_TRUE(bytes_written(output, num_threads) == bytes);
  }
}

TEST_P(EveryFormat, HoldsAMeshWithoutCells) {
  const TempDir dir;
  const Store empty = HandMadeStore(HandMadeMesh{}, LinearOctree::uniform(1)).write(dir / "store");
  for (const OutputOptions& output : outputs()) {
    const WriteSummary written = write_mesh(empty, dir / "mesh", output);
    EXPECT_EQ(written.num_cells, 0u);
    EXPECT_GT(written.bytes, 0u);
  }
}

// What a failure leaves behind is what was there before. One thread asks least: each asks once
// more at the end.
TEST_P(EveryFormat, LeavesNothingBehindWhereverItIsStopped) {
  const TempDir dir;
  const StopsAt never(StopsAt::kNever);
  write_mesh(store(), dir / "whole", options(), 1, {}, &never);
  const Names whole = names_in(dir);
  const std::uint64_t step = 1 + never.num_asked() / 20;
  for (std::uint64_t question = 1; question <= never.num_asked(); question += step) {
    const StopsAt stop(question);
    EXPECT_THROW(write_mesh(store(), dir / "mesh", options(), 2, {}, &stop), Stopped) << question;
    EXPECT_EQ(names_in(dir), whole);
  }
}

// Sums the nameless files of this process.
std::uint64_t temporary_bytes() {
  std::uint64_t bytes = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    struct stat status = {};
    if (::stat(entry.path().c_str(), &status) != 0) continue;  // the directory itself
    if (S_ISREG(status.st_mode) && status.st_nlink == 0)
      bytes += static_cast<std::uint64_t>(status.st_size);
  }
  return bytes;
}

TEST_P(EveryFormat, TakesWhatItsEstimateSays) {
  const TempDir dir;
  const Store store = EveryFormat::store();
  std::uint64_t num_listed = 0;
  store.snapshot().for_each_leaf([&](MortonKey, const LeafInfo& info) {
    num_listed += info.num_cells;
    return true;
  });
  const RunRecord run = store.snapshot().run().value();
  for (const OutputOptions& output : outputs()) {
    const std::uint64_t before = temporary_bytes();
    std::uint64_t beside = 0;
    const WriteSummary written =
        write_mesh(store, dir / "mesh", output, 1, [&](std::uint64_t, std::uint64_t) {
          beside = std::max(beside, temporary_bytes() - before);
        });
    MeshSource source(store, dir / "mesh", 1);
    const OutputEstimate estimate = estimate_output(
        output, {.num_vertices = static_cast<double>(written.num_vertices),
                 .num_cells = static_cast<double>(written.num_cells),
                 .num_listed_cells = static_cast<double>(num_listed),
                 .num_boundary_facets = static_cast<double>(source.boundary().num_facets()),
                 .box = run.surface.box});
    const auto bytes = static_cast<double>(written.bytes);
    const bool is_compressed =
        GetParam().format == MeshFormat::kVtuZlib || GetParam().format == MeshFormat::kVtkHdf;
    EXPECT_NEAR(estimate.file_bytes, bytes, (is_compressed ? 0.15 : 0.04) * bytes);
    EXPECT_GE(1.05 * estimate.bytes_beside, static_cast<double>(beside));
    // Formats of the boundary tell no steps.
    if (!GetParam().is_surface) {
      EXPECT_GE(static_cast<double>(beside), 0.5 * estimate.bytes_beside);
    }
  }
}

// Each in a process that ends then: HDF5 never gives back what it holds of a file that it could not
// write.
class FormatWithoutRoom : public testing::TestWithParam<FormatInfo> {};

TEST_P(FormatWithoutRoom, LeavesNothingBehind) {
  const TempDir dir;
  const Store small =
      HandMadeStore(lattice_ball({2, 2, 2}, 2.6), mixed_octree()).write(dir / "store");
  Names expected = {"store"};
  for (const auto& file : files_of(all_of(GetParam()), dir / "mesh")) {
    std::ofstream(file) << "old";
    expected.push_back(file.filename().string());
  }
  std::ranges::sort(expected);
  {
    const FileSizeLimit limit(1024);
    EXPECT_THROW(write_mesh(small, dir / "mesh", all_of(GetParam())), std::runtime_error);
  }
  EXPECT_EQ(names_in(dir), expected);
  for (const auto& file : files_of(all_of(GetParam()), dir / "mesh"))
    EXPECT_EQ(bytes_of(file), "old");
}

std::string name_of_format(const testing::TestParamInfo<FormatInfo>& format) {
  std::string name(format.param.name);
  std::erase(name, '-');
  return name;
}
INSTANTIATE_TEST_SUITE_P(Formats, EveryFormat, testing::ValuesIn(mesh_formats()), name_of_format);
INSTANTIATE_TEST_SUITE_P(Formats, FormatWithoutRoom, testing::ValuesIn(mesh_formats()),
                         name_of_format);

constexpr std::uint64_t kMaxInt32 = 0x7fffffff, kMaxNarrowCells = kMaxInt32 / 4;

using Widths = std::pair<std::uint64_t, std::uint64_t>;  // of connectivity and offsets
constexpr std::array<Widths, 4> kAllWidths = {Widths{4, 4}, {4, 8}, {8, 4}, {8, 8}};

Widths widths_of(std::uint64_t num_vertices, std::uint64_t num_cells) {
  const IndexWidths widths = index_widths({num_vertices, num_cells});
  return {widths.connectivity, widths.offsets};
}

TEST(IndexWidths, AreTheLeastThatHoldTheNumbersOfEachArray) {
  EXPECT_EQ(widths_of(0, 0), Widths(4, 4));
  EXPECT_EQ(widths_of(kMaxInt32, kMaxNarrowCells), Widths(4, 4));
  EXPECT_EQ(widths_of(kMaxInt32, kMaxNarrowCells + 1), Widths(4, 8));
  EXPECT_EQ(widths_of(kMaxInt32 + 1, kMaxNarrowCells), Widths(8, 4));
  EXPECT_EQ(widths_of(kMaxInt32 + 1, kMaxNarrowCells + 1), Widths(8, 8));
  EXPECT_EQ(widths_of(1'000'000'000'000, 6'000'000'000'000), Widths(8, 8));
}

// Each array after a head of eight bytes.
TEST(MeshArrays, LieAtMultiplesOfTheirValuesSizes) {
  for (const auto& [connectivity, offsets] : kAllWidths)
    for (const bool has_quality : {false, true})
      for (const std::uint64_t num_cells : {0U, 1U, 2U, 3U, 5U}) {
        std::uint64_t place = 0;
        for (const ArrayInfo& array :
             mesh_arrays({num_cells + 3, num_cells, num_cells / 2 + 4},
                         {MeshFormat::kVtu, has_quality, false, true}, {connectivity, offsets})) {
          place += 8;
          EXPECT_EQ(place % array.value_bytes, 0U) << array.name;
          place += array.bytes();
        }
      }
}

TEST(MeshArrays, TakeWhatTheEstimateOfTheirFileSays) {
  for (const std::uint64_t num_vertices : {kMaxInt32, kMaxInt32 + 1})
    for (const std::uint64_t num_cells : {kMaxNarrowCells, kMaxNarrowCells + 1})
      for (const std::uint64_t num_facets : {std::uint64_t{0}, num_cells / 3}) {
        const OutputOptions output = {MeshFormat::kVtu, num_facets > 0, false, num_facets > 0};
        const MeshCounts counts = {num_vertices, num_cells, num_facets};
        std::uint64_t bytes = 0;
        for (const ArrayInfo& array : mesh_arrays(counts, output, index_widths(counts)))
          bytes += array.bytes();
        const OutputEstimate estimate =
            estimate_output(output, {.num_vertices = static_cast<double>(num_vertices),
                                     .num_cells = static_cast<double>(num_cells),
                                     .num_boundary_facets = static_cast<double>(num_facets),
                                     .box = {}});
        EXPECT_NEAR(estimate.file_bytes, static_cast<double>(bytes), 2000);
      }
}

template <class T>
std::vector<T> values_in(std::span<const std::byte> bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  EXPECT_EQ(values.size() * sizeof(T), bytes.size());
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

std::vector<std::int64_t> integers_in(std::span<const std::byte> bytes, std::uint64_t value_bytes) {
  if (value_bytes == 8) return values_in<std::int64_t>(bytes);
  const auto narrow = values_in<std::int32_t>(bytes);
  return {narrow.begin(), narrow.end()};
}

TEST(MeshArrays, HoldTheLargestNumbersOfEachWidth) {
  for (const auto& [value_bytes, largest] :
       {std::pair{4, std::int64_t{kMaxInt32}}, {8, std::int64_t{1} << 40}}) {
    const auto width = static_cast<std::uint64_t>(value_bytes);
    const std::vector<MeshPiece::Cell> cells = {{0, 1, 2, 3},
                                                {largest - 3, largest - 2, largest - 1, largest}};
    const std::vector<std::array<std::int64_t, 6>> no_nodes;
    ConnectivityBuffer buffer;
    EXPECT_EQ(
        integers_in(connectivity_bytes(cells, no_nodes, width, buffer), width),
        (std::vector<std::int64_t>{0, 1, 2, 3, largest - 3, largest - 2, largest - 1, largest}));
    const std::int64_t last = largest / 4;
    const auto num_tetrahedra = static_cast<std::uint64_t>(last);
    const auto kinds = [](std::uint64_t num_cells) {
      return cell_kinds({.num_cells = num_cells, .num_boundary_facets = 3});
    };
    EXPECT_EQ(integers_in(offset_bytes(num_tetrahedra - 1, 2, width, kinds(num_tetrahedra)), width),
              (std::vector<std::int64_t>{4 * last - 4, 4 * last}));
    EXPECT_EQ(
        integers_in(offset_bytes(num_tetrahedra - 2, 4, width, kinds(num_tetrahedra - 2)), width),
        (std::vector<std::int64_t>{4 * last - 8, 4 * last - 5, 4 * last - 2, 4 * last + 1}));
  }
}

// Blocks are what compressed files are made of; they end anywhere in a piece.
TEST(Vtu, HasTheSameMeshInEveryWidthRawAndInBlocks) {
  const TempDir dir;
  ASSERT_GT(mesh_sphere(dir, 0.06).run.counts.num_cells, 40'000U);
  const Store store = Store::open(dir / "store", {.read_only = true});
  MeshSource source(store, dir / "mesh.vtu", 2);
  const OutputOptions options = {MeshFormat::kVtu, false, false, true};
  const MeshCounts counts = {source.num_vertices(), source.num_cells(),
                             source.num_boundary_facets()};
  std::vector<std::int64_t> ends(counts.num_cells + counts.num_boundary_facets), vertices;
  for (std::size_t i = 0; i < ends.size(); ++i)
    ends[i] = (i == 0 ? 0 : ends[i - 1]) + (i < counts.num_cells ? 4 : 3);
  for (const auto& [connectivity, offsets] : kAllWidths) {
    const IndexWidths widths = {connectivity, offsets};
    PartialFile file(dir / "mesh.vtu");
    const std::uint64_t bytes = write_vtu(source, options, file, widths);
    file.publish();
    EXPECT_EQ(bytes, std::filesystem::file_size(dir / "mesh.vtu"));
    const VtuArrays vtu(dir / "mesh.vtu");
    ArrayBlocks blocks(source, options, dir / "mesh.vtu");
    for (const ArrayInfo& array : mesh_arrays(counts, options, widths)) {
      const auto raw = vtu.array<std::byte>(std::string(array.vtk_type), std::string(array.name));
      EXPECT_EQ(raw.size(), array.bytes());
      std::vector<std::byte> in_blocks;
      for (const auto& run : blocks.blocks(array, 1000))
        blocks.for_each(
            run, [](std::span<const std::byte> some) { return values_in<std::byte>(some); },
            [&](const std::vector<std::byte>& some) {
              in_blocks.insert(in_blocks.end(), some.begin(), some.end());
            });
      EXPECT_TRUE(in_blocks == raw) << array.name;
      if (array.array == ArrayName::kEnds) {
        EXPECT_TRUE(integers_in(raw, offsets) == ends);
      }
      if (array.array == ArrayName::kConnectivity) {
        const auto read = integers_in(raw, connectivity);
        if (vertices.empty()) vertices = read;
        EXPECT_TRUE(read == vertices);
      }
    }
  }
}

// Reads a binary Medit file back, of any version.
class Meditb {
 public:
  explicit Meditb(std::string bytes) : bytes_(std::move(bytes)) {
    EXPECT_EQ(take<std::int32_t>(), 1);
    version = take<std::int32_t>();
    begin_section(3);
    EXPECT_EQ(take<std::int32_t>(), 3);
    begin_section(4);
    for (std::int64_t n = integer(); n > 0; --n) {
      points.push_back(take<Point>());
      EXPECT_EQ(integer(), 1);
    }
    begin_section(8);
    cells = elements<4>();
    begin_section(6);
    triangles = elements<3>();
    EXPECT_EQ(take<std::int32_t>(), 54);
    EXPECT_EQ(place(), 0);
    EXPECT_EQ(at_, bytes_.size());
  }

  int version = 0;
  std::vector<Point> points;
  std::vector<std::array<std::int64_t, 4>> cells;
  std::vector<std::array<std::int64_t, 3>> triangles;

 private:
  template <class T>
  T take() {
    T value{};
    if (at_ + sizeof value <= bytes_.size()) std::memcpy(&value, &bytes_[at_], sizeof value);
    at_ += sizeof value;
    return value;
  }
  std::int64_t integer() { return version < 4 ? take<std::int32_t>() : take<std::int64_t>(); }
  std::int64_t place() { return version < 3 ? take<std::int32_t>() : take<std::int64_t>(); }
  // Each keyword is where the one before said.
  void begin_section(int keyword) {
    EXPECT_TRUE(next_ == 0 || at_ == next_);
    EXPECT_EQ(take<std::int32_t>(), keyword);
    next_ = static_cast<std::size_t>(place());
  }
  template <std::size_t n>
  std::vector<std::array<std::int64_t, n>> elements() {
    std::vector<std::array<std::int64_t, n>> result(static_cast<std::size_t>(integer()));
    for (auto& element : result) {
      for (std::int64_t& v : element) v = integer() - 1;
      EXPECT_EQ(integer(), 1);
    }
    return result;
  }

  std::string bytes_;
  std::size_t at_ = 0, next_ = 0;
};

TEST(Medit, HasTheSameMeshInEveryVersion) {
  const TempDir dir;
  const Store store =
      HandMadeStore(lattice_ball({2, 2, 2}, 2.6), mixed_octree()).write(dir / "store");
  std::optional<Meditb> first;
  for (const int version : {2, 3, 4}) {
    MeshSource source(store, dir / "mesh.meshb", 2);
    PartialFile file(dir / "mesh.meshb");
    const std::uint64_t bytes = write_binary_medit(source, file, version);
    file.publish();
    EXPECT_EQ(bytes, std::filesystem::file_size(dir / "mesh.meshb"));
    const Meditb read(bytes_of(dir / "mesh.meshb"));
    EXPECT_EQ(read.version, version);
    if (!first) {
      first = read;
      EXPECT_EQ(read.points.size(), source.num_vertices());
      EXPECT_EQ(read.cells.size(), source.num_cells());
      EXPECT_EQ(read.triangles.size(), source.boundary().num_facets());
    }
    EXPECT_EQ(read.points, first->points);
    EXPECT_EQ(read.cells, first->cells);
    EXPECT_EQ(read.triangles, first->triangles);
  }
}

TEST(Stl, RefusesWhatFloatsCannotTellApart) {
  HandMadeMesh mesh = cubes(1, [](int, int, int) { return true; });
  for (MeshPoint& p : mesh.points) p.position = 1e-9 * p.position + Point{1, 1, 1};
  const TempDir dir;
  const Store store = HandMadeStore(mesh, LinearOctree::uniform(0)).write(dir / "store");
  try {
    write_mesh(store, dir / "mesh.stl", {MeshFormat::kStl});
    FAIL() << "wrote it";
  } catch (const FormatLimit& error) {
    EXPECT_NE(std::string(error.what()).find("mesh.stl"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("write ply or obj"), std::string::npos);
  }
  EXPECT_EQ(names_in(dir), (Names{"store"}));
  EXPECT_EQ(write_mesh(store, dir / "mesh.ply", {MeshFormat::kPly}).num_boundary_facets, 12u);
}

// A leaf that says it has three billion cells of the core, which are not looked at.
TEST(FormatLimits, AreCheckedBeforeAByteIsWritten) {
  const TempDir dir;
  Store store = HandMadeStore(HandMadeMesh{}, LinearOctree::uniform(1)).write(dir / "store");
  {
    const MortonKey leaf = store.snapshot().leaf_keys().front();
    LeafInfo info = store.snapshot().leaf(leaf).value();
    info.num_core_cells = 3'000'000'000;
    LeafPoints points;
    points.core.is_whole = true;
    Batch batch = store.begin();
    batch.put_leaf(leaf, info);
    batch.put_points(leaf, points);
    batch.commit();
  }
  for (const char* name : {"msh2", "abaqus", "tetgen"})
    EXPECT_THROW(write_mesh(store, dir / "mesh", {*format_named(name)}), FormatLimit) << name;
  EXPECT_EQ(names_in(dir), (Names{"store"}));
}

// The message names the file, what there is too much of, and a format that holds it.
void expect_limit(MeshFormat format, MeshCounts counts, std::uint64_t MeshCounts::*what,
                  std::uint64_t most) {
  counts.*what = most;
  EXPECT_NO_THROW(check_limits(format, counts, "mesh.out"));
  ++(counts.*what);
  try {
    check_limits(format, counts, "mesh.out");
    FAIL() << info_of(format).name << " takes " << counts.*what;
  } catch (const FormatLimit& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("mesh.out"), std::string::npos) << message;
    EXPECT_NE(message.find(std::to_string(most)), std::string::npos) << message;
    EXPECT_NE(message.find(info_of(format).is_surface ? "write obj" : "write vtu"),
              std::string::npos)
        << message;
  }
}

TEST(FormatLimits, AreCheckedAgainstCounts) {
  constexpr std::uint64_t kInt32 = 0x7fffffff, kUint32 = 0xffffffff;
  expect_limit(MeshFormat::kMsh2, {}, &MeshCounts::num_vertices, kInt32);
  expect_limit(MeshFormat::kMsh2, {}, &MeshCounts::num_cells, kInt32);
  expect_limit(MeshFormat::kAbaqus, {}, &MeshCounts::num_vertices, 999'999'999);
  expect_limit(MeshFormat::kAbaqus, {}, &MeshCounts::num_cells, 999'999'999);
  expect_limit(MeshFormat::kTetgen, {}, &MeshCounts::num_vertices, kInt32);
  expect_limit(MeshFormat::kTetgen, {}, &MeshCounts::num_cells, kInt32);
  expect_limit(MeshFormat::kStl, {}, &MeshCounts::num_boundary_facets, kUint32);
  expect_limit(MeshFormat::kPly, {}, &MeshCounts::num_boundary_vertices, kInt32);
  EXPECT_THROW(check_limits(MeshFormat::kMsh2, {1, kInt32, 1, 0}, "m"), FormatLimit)
      << "tetrahedra and triangles are numbered together";
  const MeshCounts many{1'000'000'000'000, 6'000'000'000'000, 1'000'000'000, 500'000'000};
  for (const char* name : {"vtu", "vtu-zlib", "vtkhdf", "msh", "medit", "meditb", "obj"})
    EXPECT_NO_THROW(check_limits(*format_named(name), many, "m")) << name;
}

TEST(FormatOf, IsTheExtensionsWhateverItsCase) {
  EXPECT_EQ(format_of("a/b.vtu"), MeshFormat::kVtu);
  EXPECT_EQ(format_of("b.VTKHDF"), MeshFormat::kVtkHdf);
  EXPECT_EQ(format_of("b.msh"), MeshFormat::kMsh4);
  EXPECT_EQ(format_of("b.mesh"), MeshFormat::kMedit);
  EXPECT_EQ(format_of("b.v1.meshb"), MeshFormat::kMeditBinary);
  EXPECT_EQ(format_of("b.ele"), MeshFormat::kTetgen);
  for (const char* file : {"b", "b.", "b.vtk", "vtu", ""}) EXPECT_EQ(format_of(file), std::nullopt);
  EXPECT_EQ(format_named("msh2"), MeshFormat::kMsh2);
  EXPECT_EQ(format_named("Msh2"), std::nullopt);
  EXPECT_EQ(files_of({MeshFormat::kTetgen}, "a/b.ele"),
            (std::vector<std::filesystem::path>{"a/b.node", "a/b.ele"}));
  EXPECT_EQ(files_of({MeshFormat::kTetgen, false, false, true}, "a/b.v2"),
            (std::vector<std::filesystem::path>{"a/b.v2.node", "a/b.v2.ele", "a/b.v2.face",
                                                "a/b.v2.edge"}));
  EXPECT_EQ(files_of({MeshFormat::kStl}, "a.stl"), (std::vector<std::filesystem::path>{"a.stl"}));
}

}  // namespace
}  // namespace locvol
