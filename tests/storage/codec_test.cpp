#include "storage/codec.h"

#include <gtest/gtest.h>
#include <zstd.h>

#include <bit>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>

#include "tests/directories.h"
#include "tests/file_bytes.h"
#include "tests/storage/samples.h"

namespace locvol {
namespace {

using namespace testing_samples;

// -- Laws on random records -----------------------------------------------------------------------

template <class Record>
void expect_round_trip(const Record& record, MortonKey leaf) {
  const std::string bytes = encode(record, leaf);
  EXPECT_EQ(bytes, encode(record, leaf));
  EXPECT_TRUE(decode<Record>(bytes, leaf) == record);
}

TEST(Codec, RandomRecordsComeBack) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  Generator random(seed);
  for (int round = 0; round < 200; ++round) {
    const MortonKey leaf = random.leaf();
    const std::size_t size = random.integer(round % 20 == 0 ? 5000 : 30);
    expect_round_trip(random.points(size), leaf);
    expect_round_trip(random.cells(size), leaf);
    expect_round_trip(random.facets(size), leaf);
    expect_round_trip(random.surface(size), leaf);
    expect_round_trip(random.unresolved(size), leaf);
    expect_round_trip(random.sizes(size), leaf);
    expect_round_trip(random.info(), leaf);
    expect_round_trip(random.run(), MortonKey());
    expect_round_trip(random.timeline(size), MortonKey());
    const QueueEntry entry = random.queue_entry();
    expect_round_trip(entry, entry.leaf);
  }
}

TEST(Codec, KeepsTheBitsOfCoordinates) {
  const double values[] = {-0.0,
                           0.0,
                           std::numeric_limits<double>::denorm_min(),
                           -std::numeric_limits<double>::infinity(),
                           std::numeric_limits<double>::max(),
                           std::bit_cast<double>(std::uint64_t{0x7ff4000000000123})};
  LeafPoints record;
  for (const double value : values) record.points.push_back({1, {value, 1, value}, {}});
  LeafSurface surface{{{1, {Point{0.0, 0, 0}, Point{-0.0, 0, 0}, Point{0.0, -0.0, 0}}}}};
  const auto points = decode<LeafPoints>(encode(record, sample_leaf()), sample_leaf());
  const auto triangles = decode<LeafSurface>(encode(surface, sample_leaf()), sample_leaf());
  ASSERT_EQ(points.points.size(), std::size(values));
  for (std::size_t i = 0; i < std::size(values); ++i)
    EXPECT_EQ(std::bit_cast<std::uint64_t>(points.points[i].position.z),
              std::bit_cast<std::uint64_t>(values[i]));
  EXPECT_FALSE(std::signbit(triangles.triangles[0].corners[0].x));
  EXPECT_TRUE(std::signbit(triangles.triangles[0].corners[1].x));
  EXPECT_TRUE(std::signbit(triangles.triangles[0].corners[2].y));
}

// -- Damage ---------------------------------------------------------------------------------------

// Whatever happens to the bytes, the answer is an error or the record that was stored.
template <class Record>
void expect_damage_is_noticed(const Record& record, MortonKey leaf) {
  const std::string bytes = encode(record, leaf);
  std::size_t num_unharmed = 0;
  const auto expect_error_or_same = [&](const std::string& damaged) {
    try {
      EXPECT_TRUE(decode<Record>(damaged, leaf) == record);
      ++num_unharmed;
    } catch (const DecodeError&) {
    }
  };
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string damaged = bytes;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      expect_error_or_same(damaged);
    }
    EXPECT_THROW(decode<Record>(bytes.substr(0, i), leaf), DecodeError) << i << " bytes left";
  }
  // Some bits do not matter: unused ones of the header, a distance between equal runs of bytes.
  EXPECT_LT(num_unharmed, 8 * bytes.size() / 20);
  EXPECT_THROW(decode<Record>(bytes + '\0', leaf), DecodeError);
  EXPECT_THROW(decode<Record>(bytes + bytes, leaf), DecodeError);
}

TEST(Codec, NoticesEveryFlippedBitAndEveryCut) {
  Generator random(1);
  expect_damage_is_noticed(sample_run(), MortonKey());
  expect_damage_is_noticed(sample_memory(), MortonKey());
  expect_damage_is_noticed(random.timeline(10), MortonKey());
  expect_damage_is_noticed(sample_info(), sample_leaf());
  expect_damage_is_noticed(sample_queue_entry(), sample_leaf());
  expect_damage_is_noticed(StoreFormat(), MortonKey());
  expect_damage_is_noticed(KeySums{{1, 2, 3, 4, 5, 6, 7}}, MortonKey());
  expect_damage_is_noticed(random.points(100), sample_leaf());
  expect_damage_is_noticed(random.cells(300), sample_leaf());
  expect_damage_is_noticed(random.facets(100), sample_leaf());
  expect_damage_is_noticed(random.surface(100), sample_leaf());
  expect_damage_is_noticed(random.unresolved(30), sample_leaf());
  expect_damage_is_noticed(random.sizes(30), sample_leaf());
}

TEST(Codec, NoticesARecordInAnothersPlace) {
  const std::string bytes = encode(sample_points(), sample_leaf());
  EXPECT_THROW(decode<LeafPoints>(bytes, MortonKey::root()), DecodeError);
  EXPECT_THROW(decode<LeafCells>(bytes, sample_leaf()), DecodeError);
  EXPECT_THROW(decode<LeafUnresolved>(bytes, sample_leaf()), DecodeError);
}

// Sound frames, as an attacker or a bug would make them.
std::string content_of(const std::string& frame) {
  std::string content(ZSTD_getFrameContentSize(frame.data(), frame.size()), '\0');
  ZSTD_decompress(content.data(), content.size(), frame.data(), frame.size());
  return content;
}

std::string frame_of(const std::string& content, bool has_checksum = true) {
  ZSTD_CCtx* const context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, has_checksum ? 1 : 0);
  std::string frame(ZSTD_compressBound(content.size()), '\0');
  frame.resize(ZSTD_compress2(context, frame.data(), frame.size(), content.data(), content.size()));
  ZSTD_freeCCtx(context);
  return frame;
}

template <class Record>
void expect_error_about(const std::string& frame, const std::string& words) {
  try {
    decode<Record>(frame, sample_leaf());
    ADD_FAILURE() << "was decoded; expected: " << words;
  } catch (const DecodeError& error) {
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
  }
}

constexpr std::size_t kVersionAt = 9, kFieldsAt = 13;  // in the content, see codec.cpp

TEST(Codec, RefusesOtherVersions) {
  std::string content = content_of(encode(sample_points(), sample_leaf()));
  EXPECT_EQ(content[kVersionAt], 1);
  content[kVersionAt] = 2;
  expect_error_about<LeafPoints>(frame_of(content), "version 2");
}

TEST(Codec, RefusesLiesAboutLengthsBeforeItAllocates) {
  const std::string content = content_of(encode(sample_points(), sample_leaf()));
  for (const std::uint64_t lie : {std::uint64_t{1000}, std::uint64_t{1} << 40, ~std::uint64_t{0}}) {
    std::string lying = content;
    std::memcpy(lying.data() + kFieldsAt, &lie, sizeof lie);
    expect_error_about<LeafPoints>(frame_of(lying), "beyond its end");
  }
  std::string shorter = content;
  --shorter[kFieldsAt];
  EXPECT_THROW(decode<LeafPoints>(frame_of(shorter), sample_leaf()), DecodeError);
  expect_error_about<LeafPoints>(frame_of(content + "x"), "left over");
}

TEST(Codec, RefusesLiesAboutTheSizeOfTheFrame) {
  // Magic number, descriptor (8-byte size, single segment, checksum), size, and an empty last
  // block.
  std::string frame("\x28\xb5\x2f\xfd\xe4\xff\xff\xff\xff\xff\xff\xff\x0f\x01\x00\x00", 16);
  expect_error_about<LeafPoints>(frame, "believable");
}

TEST(Codec, RefusesLiesAboutTheSizeOfALargeFrame) {
  Generator random(2);
  std::string frame = encode(random.points(100'000), sample_leaf());
  // Descriptor, window, and then the size, in four bytes.
  ASSERT_EQ(static_cast<unsigned char>(frame[4]) & 0xe0, 0x80);
  ASSERT_EQ(frame[9], 0);
  frame[9] = 0x7f;  // 2 GB, which so long a frame can hold, but not with the blocks of this one
  expect_error_about<LeafPoints>(frame, "believable");
}

TEST(Codec, RefusesFramesWithoutAChecksum) {
  const std::string content = content_of(encode(sample_points(), sample_leaf()));
  EXPECT_TRUE(decode<LeafPoints>(frame_of(content), sample_leaf()) == sample_points());
  expect_error_about<LeafPoints>(frame_of(content, false), "checksum");
}

TEST(Codec, RefusesValuesOutOfRange) {
  LeafPoints without_core = sample_points();
  without_core.core = {};
  std::string points = content_of(encode(without_core, sample_leaf()));
  constexpr std::size_t kBytesOfEmptyCore = 1 + sizeof(std::uint64_t) + 1;
  // The kind of the last point.
  points[points.size() - kBytesOfEmptyCore - 1] = static_cast<char>(kNumPointKinds);
  expect_error_about<LeafPoints>(frame_of(points), "means nothing");
  LeafCells not_asked = sample_cells();
  not_asked.asked.clear();
  not_asked.bodies.clear();
  std::string cells = content_of(encode(not_asked, sample_leaf()));
  constexpr std::size_t kBytesOfTwoEmptyLists = 2 * sizeof(std::uint64_t);
  cells[cells.size() - kBytesOfTwoEmptyLists - 1] = 1;  // the highest byte of the last corner
  expect_error_about<LeafCells>(frame_of(cells), "unknown vertices");
  LeafFacets unknown = sample_facets();
  unknown.facets.back().vertices[2] = 5;
  EXPECT_THROW(encode(unknown, sample_leaf()), DecodeError);
  LeafSurface without_creases = sample_surface();
  without_creases.creases.clear();
  without_creases.corners.clear();
  for (Triangle& triangle : without_creases.triangles) triangle.change = DomainState::in(kOnlyBody);
  std::string surface = content_of(encode(without_creases, sample_leaf()));
  const std::size_t bytes_of_sheets = 8 + 4 * without_creases.triangles.size();
  constexpr std::size_t kNoCreasesAndOneBody = 2;
  surface[surface.size() - kNoCreasesAndOneBody - bytes_of_sheets - 1] = 1;
  expect_error_about<LeafSurface>(frame_of(surface), "unknown corners");
  LeafSurface bad_creases = sample_surface();
  std::swap(bad_creases.creases[0], bad_creases.creases[1]);
  EXPECT_THROW(encode(bad_creases, sample_leaf()), DecodeError);
  bad_creases = sample_surface();
  std::swap(bad_creases.creases[0].ends[0], bad_creases.creases[0].ends[1]);
  EXPECT_THROW(encode(bad_creases, sample_leaf()), DecodeError);
  std::string unresolved = content_of(encode(sample_unresolved(), sample_leaf()));
  for (const char condition : {char{0}, char{7}}) {
    unresolved[kFieldsAt + sizeof(std::uint64_t)] = condition;
    expect_error_about<LeafUnresolved>(frame_of(unresolved), "condition");
  }
  LeafSizes disordered = sample_sizes();
  std::swap(disordered.cubes[0], disordered.cubes[1]);
  EXPECT_THROW(encode(disordered, sample_leaf()), DecodeError);
  LeafSizes endless = sample_sizes();
  endless.cubes[1].distance[2] = std::numeric_limits<float>::infinity();
  EXPECT_THROW(encode(endless, sample_leaf()), DecodeError);
  for (const SizedNode& bad : {SizedNode{MortonKey(), 1}, SizedNode{sample_leaf(), 0},
                               SizedNode{sample_leaf(), -1}, SizedNode{sample_leaf(), NAN}}) {
    LeafSizes nodes = sample_sizes();
    nodes.nodes.front() = bad;
    EXPECT_THROW(encode(nodes, sample_leaf()), DecodeError);
  }
  std::string timeline = content_of(encode(sample_timeline(), MortonKey()));
  timeline.back() = 10;  // the last sample's phase
  EXPECT_THROW(decode<TimelineRecord>(frame_of(timeline), MortonKey()), DecodeError);
}

TEST(Codec, RefusesACoreThatContradictsItself) {
  constexpr std::size_t kCoreAt = 8 + 4 * (4 * 8 + 1);  // after ids, x, y, z and kinds of four
  const std::string content = content_of(encode(sample_points(), sample_leaf()));
  EXPECT_TRUE(decode<LeafPoints>(frame_of(content), sample_leaf()) == sample_points());
  std::string whole = content;
  ASSERT_EQ(whole[kFieldsAt + kCoreAt], 0);
  whole[kFieldsAt + kCoreAt] = 1;
  expect_error_about<LeafPoints>(frame_of(whole), "whole");
}

// -- Golden bytes: what was ever written still opens ----------------------------------------------

std::filesystem::path golden_file(const std::string& name) {
  return tests_directory() / "storage" / "golden" / name;
}

// To add a file for a new version: raise the version in the name below, and run with
// LOCVOL_WRITE_GOLDEN=1; files that exist are never written again.
template <class Record>
void expect_golden(const std::string& name, const Record& record, MortonKey leaf) {
  const std::filesystem::path path = golden_file(name);
  if (std::getenv("LOCVOL_WRITE_GOLDEN") && !std::filesystem::exists(path))
    std::ofstream(path, std::ios::binary) << encode(record, leaf);
  EXPECT_TRUE(decode<Record>(bytes_of(path), leaf) == record) << name;
}

TEST(Codec, GoldenBytesOpen) {
  expect_golden("format.v0", StoreFormat{5}, MortonKey());
  expect_golden("run.v9", sample_run(), MortonKey());
  RunRecord of_one_body = sample_run();
  of_one_body.parameters.inside = InsideRule::kWinding;
  of_one_body.parameters.wrap_alpha = of_one_body.parameters.wrap_offset = 0;
  expect_golden("run.v8", of_one_body, MortonKey());
  of_one_body.parameters.gap = 0;
  of_one_body.parameters.inside = InsideRule::kClosed;
  of_one_body.parameters.is_surface_only = false;
  expect_golden("run.v7", of_one_body, MortonKey());
  of_one_body.parameters.body_sizes.clear();
  expect_golden("run.v6", of_one_body, MortonKey());
  of_one_body.parameters.has_bodies = false;
  of_one_body.parameters.voids.clear();
  of_one_body.surface.more_files.clear();
  of_one_body.parameters.sharp_polylines.clear();
  of_one_body.sharp_file.clear();
  expect_golden("run.v5", of_one_body, MortonKey());
  RunRecord of_before = of_one_body;
  of_before.has_creases = false;
  expect_golden("run.v4", of_before, MortonKey());
  of_before.parameters.sheet_sizes.clear();
  expect_golden("run.v3", of_before, MortonKey());
  of_before.surface.facing = {};
  of_before.parameters.weld.reset();
  of_before.parameters.sharp_angle = 0;
  expect_golden("run.v1", of_before, MortonKey());
  of_before.sizes.of_lattice = of_before.sizes.of_core = 0;
  expect_golden("run.v0", of_before, MortonKey());
  of_before = of_one_body;
  of_before.has_creases = false;
  of_before.parameters.sheet_sizes.clear();
  of_before.parameters.sharp_angle = 0;
  expect_golden("run.v2", of_before, MortonKey());
  expect_golden("leaf.v3", sample_info(), sample_leaf());
  LeafInfo of_one_rank = sample_info();
  of_one_rank.center = DomainState::in(kOnlyBody);
  expect_golden("leaf.v2", of_one_rank, sample_leaf());
  of_one_rank.ranks.clear();
  expect_golden("leaf.v1", of_one_rank, sample_leaf());
  of_one_rank.holding = Holding::kOwn;
  expect_golden("leaf.v0", of_one_rank, sample_leaf());
  expect_golden("points.v1", sample_points(), sample_leaf());
  LeafPoints points_of_one_body = sample_points();
  for (LatticeRow& row : points_of_one_body.core.rows) row.body = kOnlyBody;
  expect_golden("points.v0", points_of_one_body, sample_leaf());
  expect_golden("cells.v1", sample_cells(), sample_leaf());
  LeafCells cells_of_one_body = sample_cells();
  cells_of_one_body.bodies.clear();
  expect_golden("cells.v0", cells_of_one_body, sample_leaf());
  expect_golden("facets.v0", sample_facets(), sample_leaf());
  expect_golden("surface.v4", sample_surface(), sample_leaf());
  // What crossing a triangle changed was less before: what it parts cannot be told.
  EXPECT_THROW(decode<LeafSurface>(bytes_of(golden_file("surface.v3")), sample_leaf()),
               DecodeError);
  LeafSurface smooth_surface = sample_surface();
  for (Triangle& triangle : smooth_surface.triangles) triangle.change = DomainState::in(kOnlyBody);
  expect_golden("surface.v2", smooth_surface, sample_leaf());
  smooth_surface.creases.clear();
  smooth_surface.corners.clear();
  expect_golden("surface.v1", smooth_surface, sample_leaf());
  for (Triangle& triangle : smooth_surface.triangles) triangle.sheet = 1;
  expect_golden("surface.v0", smooth_surface, sample_leaf());
  expect_golden("sheets.v3", sample_sheets(), MortonKey());
  SurfaceSheets without_facts = sample_sheets();
  for (SheetFacts& sheet : without_facts.sheets) sheet.color.reset();
  without_facts.nearest.clear();
  expect_golden("sheets.v2", without_facts, MortonKey());
  without_facts.bodies.clear();
  for (SheetFacts& sheet : without_facts.sheets) sheet.bodies = {kOnlyBody, kNoBody};
  expect_golden("sheets.v1", without_facts, MortonKey());
  without_facts.creases.clear();
  without_facts.num_corners = 0;
  expect_golden("sheets.v0", without_facts, MortonKey());
  expect_golden("unresolved.v0", sample_unresolved(), sample_leaf());
  expect_golden("sizes.v0", sample_sizes(), sample_leaf());
  expect_golden("queue.v0", sample_queue_entry(), sample_leaf());
  expect_golden("memory.v0", sample_memory(), MortonKey());
  expect_golden("rank.v1", sample_rank(), MortonKey());
  EXPECT_THROW(decode<RankRecord>(bytes_of(golden_file("rank.v0")), MortonKey()), DecodeError);
  expect_golden("words.v0", RankWords{std::string("a\0b", 3)}, MortonKey());
  expect_golden("result.v0", RankResult{77, std::string("a\0b", 3)}, sample_leaf());
  expect_golden("timeline.v0", sample_timeline(), MortonKey());
  expect_golden("keys.v0", KeySums{{1, 0, ~std::uint64_t{0}}}, MortonKey());
}

}  // namespace
}  // namespace locvol
