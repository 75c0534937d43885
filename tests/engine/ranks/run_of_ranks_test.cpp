// Whole runs of several ranks against one process.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/writer.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/sheet_table.h"
#include "engine/plan/same_run.h"
#include "engine/rank_engine.h"
#include "engine/ranks/move_leaves.h"
#include "engine/ranks/rank_store.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "tests/cube_off.h"
#include "tests/directories.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/file_size_limit.h"
#include "tests/engine/ranks/written_by_ranks.h"
#include "tests/engine/store_contents.h"
#include "tests/file_bytes.h"
#include "tests/skip_reasons.h"
#include "tests/stops_at.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_shapes;

class RunOfRanks : public testing::Test {
 protected:
  MeshOptions options(const std::string& store, double size, std::uint64_t leaf_capacity) const {
    MeshOptions options;
    options.input = scratch_ / "input.off";
    options.store = scratch_ / store;
    options.size = {size, false};
    options.leaf_capacity = leaf_capacity;
    return options;
  }

  // All that the ranks have of their own, in one store.
  Contents mesh_by(int num_ranks, const MeshOptions& options, int num_threads,
                   const ThreadRanksOptions& ranks = {}) {
    const std::string name = options.store.string() + "-" + std::to_string(num_ranks);
    run_as_ranks(
        num_ranks,
        [&](Exchange& exchange) {
          MeshOptions all = options;
          all.store = name + "-%r";
          RunControl control;
          control.num_threads = num_threads;
          mesh_as_rank(all, control, exchange);
          std::optional<Store> whole;
          if (exchange.rank() == 0) {
            std::filesystem::remove_all(name);
            whole = Store::open(name, {.create = true});
          }
          const Store own =
              Store::open(store_of_rank(all.store, exchange.rank()), {.read_only = true});
          join_leaves({&own, 1}, whole ? &*whole : nullptr, exchange);
        },
        ranks);
    return contents_of(name);
  }

  // What two ranks say to it.
  std::string refusal_of(const MeshOptions& options) {
    try {
      mesh_by(2, options, 1);
    } catch (const StoreError& e) {
      return e.what();
    } catch (const StoreMismatch& e) {
      return e.what();
    }
    return "none";
  }

  // As if the machine of one of three had failed, again and again: after 32 words, whatever they
  // are, or `spread` and some more. All ranks end then.
  void expect_to_go_on_after_ends(const MeshOptions& options, std::uint64_t round,
                                  std::uint64_t spread) {
    if (round == 0) mesh(options);
    const Contents expected = contents_of(options.store);
    MeshOptions again = options;
    again.store += "-" + std::to_string(round);
    int num_ended = 0;
    for (bool is_done = false; !is_done;) {
      const std::uint64_t last = 32 + 5 * round + static_cast<std::uint64_t>(num_ended) % spread;
      const int ending = (num_ended + static_cast<int>(round)) % 3;
      const ThreadRanksOptions ranks{.fault = [&](int from, int to, std::uint64_t number) {
        if (from == ending && to == (from + 1) % 3 && number == last)
          throw std::runtime_error("killed");
        return MessageFault::kNone;
      }};
      try {
        EXPECT_TRUE(are_equal(expected, mesh_by(3, again, 1, ranks)));
        is_done = true;
      } catch (const std::runtime_error& e) {
        EXPECT_EQ(std::string(e.what()), "killed");
        ASSERT_LT(++num_ended, 500);
      }
    }
    EXPECT_GT(num_ended, 1);
  }

  // By so many ranks, of which one ends after so many words, when all others but one have heard
  // the next; if it is alone, after as many commits. False: one has ended.
  static bool goes_on(const MeshOptions& all, int num_ranks, std::uint64_t num_words) {
    std::uint64_t num_told = 0;
    RunControl control;
    control.num_threads = 1;
    if (num_ranks == 1)
      control.on_progress = [&](const Progress&) {
        if (++num_told > num_words) throw std::runtime_error("killed");
      };
    const int ending = static_cast<int>(num_words) % num_ranks;
    const int last = ending == num_ranks - 1 ? num_ranks - 2 : num_ranks - 1;
    const ThreadRanksOptions ranks{.fault = [&](int from, int to, std::uint64_t number) {
      if (from == ending && to == last && number == num_words) throw std::runtime_error("killed");
      return MessageFault::kNone;
    }};
    try {
      run_as_ranks(
          num_ranks, [&](Exchange& exchange) { mesh_as_rank(all, control, exchange); }, ranks);
    } catch (const std::runtime_error& e) {
      EXPECT_EQ(std::string(e.what()), "killed");
      return false;
    }
    return true;
  }

  static std::optional<RankRecord> record_in(const std::filesystem::path& directory) {
    if (!Store::exists(directory)) return std::nullopt;
    return Store::open(directory, {.read_only = true}).snapshot().rank();
  }

  static bool is_within_superstep(const std::filesystem::path& stores) {
    const auto first = record_in(store_of_rank(stores, 0));
    for (std::size_t rank = 0; first && rank < first->first.size(); ++rank) {
      const auto other = record_in(store_of_rank(stores, static_cast<int>(rank)));
      if (other && other->num_moves == first->num_moves &&
          (other->applied || other->superstep != first->superstep))
        return true;
    }
    return false;
  }

  // By three ranks, until one ends within a superstep.
  static void end_within_superstep(const MeshOptions& all) {
    for (std::uint64_t num_words = 40; !is_within_superstep(all.store); ++num_words)
      ASSERT_FALSE(goes_on(all, 3, num_words)) << "before it was within a superstep";
  }

  Contents joined(const std::filesystem::path& stores) {
    const std::filesystem::path whole = scratch_ / "joined";
    std::filesystem::remove_all(whole);
    run_as_ranks(2, [&](Exchange& exchange) { join_ranks(stores, whole, {}, exchange); });
    return contents_of(whole);
  }

  TempDir scratch_;
};

TEST_F(RunOfRanks, HasTheRecordsOfOneProcess) {
  write_off(sphere(1, 24, 48), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.06, 200);
  mesh(options);
  const Contents expected = contents_of(options.store);
  EXPECT_GT(expected.leaves.size(), 100U);
  for (const int num_ranks : {1, 2, 3, 7})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, num_ranks % 2 + 1))) << num_ranks;
}

TEST_F(RunOfRanks, KeepsCreasesAsOneProcess) {
  write_off(turned(testing_shapes::wedge(3, 2, 0.5)), scratch_ / "input.off");
  for (const double growth : {0.0, 0.2}) {
    MeshOptions options = this->options(growth > 0 ? "graded" : "store", 0.15, 100);
    options.growth = growth;
    mesh(options);
    const Contents expected = contents_of(options.store);
    EXPECT_TRUE(expected.run.has_creases);
    for (const int num_ranks : {2, 5})
      EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1)))
          << num_ranks << ", " << growth;
  }
}

TEST_F(RunOfRanks, KeepsGivenCreasesAsOneProcess) {
  const testing_shapes::Shape ball = sphere(1, 15, 32);
  write_off(ball, scratch_ / "input.off");
  const std::filesystem::path given = scratch_ / "given.txt";
  std::ofstream file(given);
  file.precision(17);
  file << 17;
  for (std::uint32_t j = 0; j <= 16; ++j) {
    const Point& p = ball.vertices[1 + 7 * 32 + j];
    file << "  " << p.x << ' ' << p.y << ' ' << p.z;
  }
  file.close();
  MeshOptions options = this->options("store", 0.2, 100);
  options.sharp_polylines = given;
  mesh(options);
  const Contents expected = contents_of(options.store);
  EXPECT_EQ(expected.sheets.creases.size(), 1U);
  for (const int num_ranks : {1, 3})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1))) << num_ranks;
  expect_to_go_on_after_ends(options, 1, 23);
}

TEST_F(RunOfRanks, WithCreasesGoesOnAfterAnyRankEnds) {
  write_off(turned(testing_shapes::wedge(3, 2, 0.5)), scratch_ / "input.off");
  for (std::uint64_t round = 0; round < 2; ++round)
    expect_to_go_on_after_ends(options("store", 0.3, 200), round, 23);
}

TEST_F(RunOfRanks, WritesTheBytesOfOneProcess) {
  write_off(together(sphere(1, 24, 48), translated(torus(0.5, 0.2, 30, 16), {1.9, 0, 0.4})),
            scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.08, 300);
  mesh(options);
  const Store store = Store::open(options.store, {.read_only = true});
  const MeshStatistics expected = mesh_statistics(store);
  for (const int num_ranks : {1, 3, 6}) {
    SCOPED_TRACE(num_ranks);
    MeshOptions many = options;
    many.store += "-" + std::to_string(num_ranks) + "-%r";
    run_as_ranks(num_ranks, [&](Exchange& exchange) {
      const RunSummary summary = mesh_as_rank(many, {}, exchange);
      const Store part =
          Store::open(store_of_rank(many.store, exchange.rank()), {.read_only = true});
      const MeshStatistics all = mesh_statistics(part, 1, {}, nullptr, exchange);
      EXPECT_EQ(all.num_cells, summary.run.counts.num_cells);
      EXPECT_EQ(all.num_cells, expected.num_cells);
      EXPECT_EQ(all.num_core_cells, expected.num_core_cells);
      EXPECT_EQ(all.dihedral_angles.counts, expected.dihedral_angles.counts);
      EXPECT_EQ(all.min_dihedral_angles.counts, expected.min_dihedral_angles.counts);
      EXPECT_EQ(all.radius_edge_ratios.counts, expected.radius_edge_ratios.counts);
      EXPECT_EQ(all.radii_over_size.counts, expected.radii_over_size.counts);
      EXPECT_EQ(all.num_cells_by_octave, expected.num_cells_by_octave);
      EXPECT_EQ(all.max_dihedral_degrees, expected.max_dihedral_degrees);
      EXPECT_EQ(all.min_dihedral_degrees, expected.min_dihedral_degrees);
      EXPECT_EQ(all.max_circumradius, expected.max_circumradius);
      EXPECT_NEAR(all.volume, expected.volume, 1e-12 * expected.volume);
    });
    for (const FormatInfo& format : mesh_formats())
      for (const bool has_quality : {false, true})
        for (const auto& [has_boundary, order] : {std::pair{false, 1}, {true, 1}, {true, 2}}) {
          if (has_quality && !format.has_cell_data) continue;
          if (order == 2 && (!format.has_second_order() || has_quality != format.has_cell_data))
            continue;
          SCOPED_TRACE(format.name);
          const OutputOptions output{.format = format.format,
                                     .has_quality = has_quality,
                                     .has_boundary = has_boundary,
                                     .order = order};
          const TempDir of_one, of_many;
          const WriteSummary one = write_mesh(store, of_one / "mesh", output);
          run_as_ranks(num_ranks, [&](Exchange& exchange) {
            const Store part =
                Store::open(store_of_rank(many.store, exchange.rank()), {.read_only = true});
            EXPECT_EQ(write_mesh(part, of_many / "mesh", output, 1 + num_ranks % 2, {}, nullptr,
                                 exchange),
                      one);
          });
          EXPECT_EQ(names_in(of_many), names_in(of_one));
          for (const auto& file : files_of(output, of_one / "mesh"))
            EXPECT_TRUE(bytes_of(of_many / file.filename()) == bytes_of(file)) << file;
        }
  }
}

// A ball and a ring, of three ranks.
class MeshOfRanks : public RunOfRanks {
 protected:
  virtual void write_input() const {
    write_off(together(sphere(1, 24, 48), translated(torus(0.5, 0.2, 30, 16), {1.9, 0, 0.4})),
              scratch_ / "input.off");
  }
  void mesh_by_ranks(double size, std::uint64_t leaf_capacity = 500) {
    write_input();
    options_ = options("store-%r", size, leaf_capacity);
    run_as_ranks(3, [&](Exchange& exchange) {
      const RunSummary summary = mesh_as_rank(options_, {}, exchange);
      if (exchange.rank() == 0) num_cells_ = summary.run.counts.num_cells;
    });
  }
  Store part(const Exchange& exchange) const {
    return Store::open(store_of_rank(options_.store, exchange.rank()), {.read_only = true});
  }

  MeshOptions options_;
  std::uint64_t num_cells_ = 0;
};

class FileOfRanks : public MeshOfRanks {
 protected:
  void SetUp() override {
    mesh_by_ranks(0.08);
    join();
  }
  void join() {
    run_as_ranks(2, [&](Exchange& exchange) {
      join_ranks(options_.store, scratch_ / "whole", {}, exchange);
    });
  }
  // All ranks write the mesh, of which this one is asked to stop.
  void write(const std::filesystem::path& file, MeshFormat format, int stopped_rank = -1,
             const StopToken* stop = nullptr) const {
    run_as_ranks(3, [&](Exchange& exchange) {
      write_mesh(part(exchange), file, {format}, 1, {},
                 exchange.rank() == stopped_rank ? stop : nullptr, exchange);
    });
  }
  void expect_blocks_of_one_process(int order) const;
};

// A cube, whose leaves have few points.
class CreasedFileOfRanks : public FileOfRanks {
 protected:
  void write_input() const override { std::ofstream(scratch_ / "input.off") << kCube; }
  void SetUp() override {
    mesh_by_ranks(0.13, 60);
    join();
  }
};

void FileOfRanks::expect_blocks_of_one_process(int order) const {
  using Blocks = std::vector<std::vector<std::byte>>;
  const OutputOptions kAll{
      .format = MeshFormat::kVtuZlib, .has_quality = true, .has_boundary = true, .order = order};
  const auto blocks_of = [&](MeshSource& source, const ArrayInfo& info, std::uint64_t items) {
    std::vector<Blocks> all;  // by run: of tetrahedra, and of triangles
    ArrayBlocks arrays(source, kAll, scratch_ / "mesh");
    for (const auto& blocks : arrays.blocks(info, items)) {
      all.emplace_back();
      arrays.for_each(
          blocks,
          [](std::span<const std::byte> bytes) {
            return std::vector<std::byte>(bytes.begin(), bytes.end());
          },
          [&](std::vector<std::byte> block) { all.back().push_back(std::move(block)); });
    }
    return all;
  };
  const Store whole = Store::open(scratch_ / "whole", {.read_only = true});
  MeshSource one(whole, scratch_ / "mesh", 1, {}, nullptr, alone(), {.order = order});
  std::vector<ArrayInfo> infos = mesh_arrays(counts_of(one, kAll), kAll, {8, 4});
  infos.push_back(*std::ranges::find(infos, ArrayName::kEnds, &ArrayInfo::array));
  infos.back().array = ArrayName::kStarts;
  ++infos.back().num_items;
  for (const ArrayInfo& info : infos)
    for (const std::uint64_t items : {std::uint64_t{17}, std::uint64_t{1000}, one.num_cells()}) {
      SCOPED_TRACE(info.name);
      std::array<std::vector<Blocks>, 3> of_ranks;
      run_as_ranks(3, [&](Exchange& exchange) {
        const Store store = part(exchange);
        MeshSource source(store, scratch_ / "mesh", 2, {}, nullptr, exchange, {.order = order});
        of_ranks[static_cast<std::size_t>(exchange.rank())] = blocks_of(source, info, items);
      });
      const auto in_order = [](std::span<const std::vector<Blocks>> parts) {
        Blocks all;
        for (std::size_t run = 0; run < parts.front().size(); ++run)
          for (const auto& of_rank : parts)
            all.insert(all.end(), of_rank[run].begin(), of_rank[run].end());
        return all;
      };
      const Blocks all = in_order(of_ranks);
      const std::array of_one = {blocks_of(one, info, items)};
      EXPECT_EQ(all.size(), (info.num_items + items - 1) / items);
      EXPECT_TRUE(all == in_order(of_one)) << items;
    }
}

TEST_F(FileOfRanks, HasTheBlocksOfOneProcess) { expect_blocks_of_one_process(1); }
TEST_F(CreasedFileOfRanks, HasTheBlocksOfOneProcess) {
  for (const int order : {1, 2}) expect_blocks_of_one_process(order);
}

TEST_F(CreasedFileOfRanks, HasTheBytesOfOneProcess) {
  const Store whole = Store::open(scratch_ / "whole", {.read_only = true});
  MeshSource source(whole, scratch_ / "mesh", 1);
  EXPECT_EQ(source.corners().size(), 8U);
  EXPECT_GT(source.num_crease_edges(), 80U);
  std::vector<OutputOptions> outputs;
  for (const FormatInfo& info : mesh_formats())
    for (const int order : {1, 2})
      if (order == 1 || info.has_second_order())
        outputs.push_back({.format = info.format,
                           .has_quality = info.has_cell_data,
                           .has_boundary = true,
                           .order = order});
  expect_files_of_one_process(
      whole, [&](const Exchange& exchange) { return part(exchange); }, outputs, scratch_.path());
}

// Each edge is in one piece, which has its vertices and its node; a vertex is a corner in all that
// have it.
TEST_F(CreasedFileOfRanks, PiecesHaveAllEdgesAndCornersOnce) {
  const Store whole = Store::open(scratch_ / "whole", {.read_only = true});
  MeshSource source(whole, scratch_ / "mesh", 1, {}, nullptr, alone(), {.order = 2});
  using Edges = std::set<std::tuple<std::uint64_t, std::uint64_t, std::uint64_t, CreaseId>>;
  using Corners = std::set<std::pair<std::uint64_t, std::uint64_t>>;
  const auto add = [](MeshSource& mesh, Edges& edges, Corners& corners) {
    const auto number_of = [&](std::int64_t point) {
      return mesh.number_of(static_cast<std::uint64_t>(point));
    };
    const auto next = mesh.lines();
    while (const auto some = next())
      for (std::size_t i = 0; i < some->lines.size(); ++i) {
        const auto& [a, b] = some->lines[i];
        EXPECT_TRUE(edges
                        .insert({number_of(a), number_of(b), number_of(some->nodes[i][0]),
                                 some->creases[i]})
                        .second);
      }
    for (const KeptCorner& corner : mesh.corners())
      EXPECT_TRUE(corners.emplace(mesh.number_of(corner.vertex), corner.corner).second);
  };
  Edges edges, expected_edges;
  Corners corners, expected_corners;
  add(source, expected_edges, expected_corners);
  std::mutex mutex;
  run_as_ranks(3, [&](Exchange& exchange) {
    const Store store = part(exchange);
    MeshSource own(store, scratch_ / "mesh", 1, {}, nullptr, exchange,
                   {.is_part = true, .order = 2});
    own.creases();  // which all ranks call, before one waits for its turn
    std::vector<KeptCorner> of_vertices = own.corners_by_vertex();
    const std::lock_guard lock(mutex);
    add(own, edges, corners);
    for (const KeptCorner& corner : of_vertices)
      EXPECT_TRUE(expected_corners.contains({own.number_of(corner.vertex), corner.corner}));
    EXPECT_GE(of_vertices.size(), own.corners().size());
  });
  EXPECT_EQ(expected_corners.size(), 8U);
  EXPECT_TRUE(edges == expected_edges);
  EXPECT_TRUE(corners == expected_corners);
}

TEST_F(FileOfRanks, SheetsAreThoseOfOneProcess) {
  const SheetTable expected =
      sheet_table(Store::open(scratch_ / "whole", {.read_only = true}), scratch_ / "table");
  ASSERT_EQ(expected.rows.size(), 2U);  // it has two components
  run_as_ranks(3, [&](Exchange& exchange) {
    const SheetTable table = sheet_table(part(exchange), scratch_ / "table", nullptr, exchange);
    ASSERT_EQ(table.rows.size(), expected.rows.size());
    for (std::size_t s = 0; s < table.rows.size(); ++s) {
      const SheetRow &row = table.rows[s], &one = expected.rows[s];
      EXPECT_GT(row.num_facets, 100U);
      EXPECT_EQ(row.num_facets, one.num_facets);
      EXPECT_DOUBLE_EQ(row.facet_area, one.facet_area);
      EXPECT_EQ(row.shape.form, one.shape.form);
      EXPECT_NEAR(row.shape.radius, one.shape.radius, 1e-12);
      EXPECT_NEAR(row.shape.deviation, one.shape.deviation, 1e-12);
    }
  });
}

TEST_F(FileOfRanks, IsNotThereIfAnyStops) {
  for (const MeshFormat format : {MeshFormat::kVtu, MeshFormat::kVtuZlib, MeshFormat::kVtkHdf,
                                  MeshFormat::kMsh4, MeshFormat::kAbaqus, MeshFormat::kTetgen})
    for (const int rank : {0, 2}) {
      SCOPED_TRACE(info_of(format).name);
      const TempDir dir;
      const StopsAt never(StopsAt::kNever);
      write(dir / "whole", format, rank, &never);
      const Names expected = names_in(dir);
      const std::uint64_t num_asked = never.num_asked();
      ASSERT_GT(num_asked, 0U);
      for (const std::uint64_t question : {std::uint64_t{1}, (num_asked + 1) / 2, num_asked}) {
        const StopsAt stop(question);
        EXPECT_THROW(write(dir / "mesh", format, rank, &stop), Stopped) << rank << " " << question;
        EXPECT_EQ(names_in(dir), expected);
      }
    }
}

// The last one is HDF5's, which never gives back what it holds of a file that it could not write.
TEST_F(FileOfRanks, IsNotThereWithoutRoom) {
  for (const MeshFormat format : {MeshFormat::kVtu, MeshFormat::kVtuZlib, MeshFormat::kMsh4,
                                  MeshFormat::kMedit, MeshFormat::kPly, MeshFormat::kVtkHdf}) {
    SCOPED_TRACE(info_of(format).name);
    const TempDir dir;
    const FileSizeLimit limit(4096);
    EXPECT_THROW(write(dir / "mesh", format), std::runtime_error);
    EXPECT_EQ(names_in(dir), Names());
  }
}

// Of three ranks, in each format that has pieces.
class PiecesOfRanks : public MeshOfRanks {
 protected:
  void SetUp() override { mesh_by_ranks(0.06); }

  static std::vector<OutputOptions> outputs() {
    std::vector<OutputOptions> outputs;
    for (const FormatInfo& info : mesh_formats())
      if (can_be_written_in_pieces(info.format))
        for (const int order : {1, 2})
          outputs.push_back(
              {.format = info.format, .has_quality = true, .has_boundary = true, .order = order});
    return outputs;
  }

  WriteSummary write(const std::filesystem::path& directory, const OutputOptions& output,
                     int num_threads) {
    WriteSummary written;
    run_as_ranks(3, [&](Exchange& exchange) {
      const WriteSummary of_all = write_piece_as_rank(part(exchange), directory / "mesh.any",
                                                      output, exchange, num_threads);
      if (exchange.rank() == 0) written = of_all;
    });
    return written;
  }
};

TEST_F(PiecesOfRanks, AreTheSameBytesForAnyNumberOfThreads) {
  EXPECT_EQ(outputs().size(), 8U);
  for (const OutputOptions& output : outputs()) {
    SCOPED_TRACE(info_of(output.format).name);
    const TempDir one, many;
    const WriteSummary written = write(one.path(), output, 1);
    write(many.path(), output, 3);
    const auto index = index_of_pieces(one / "mesh.any", output.format);
    EXPECT_EQ(names_in(one).size(), index ? 4U : 3U);
    std::uint64_t bytes = 0;
    for (const std::string& name : names_in(one)) {
      EXPECT_TRUE(bytes_of(one / name) == bytes_of(many / name)) << name;
      if (!index || one / name != *index) bytes += std::filesystem::file_size(one / name);
    }
    EXPECT_EQ(names_in(one), names_in(many));
    EXPECT_EQ(written.bytes, bytes);
    EXPECT_EQ(written.num_cells, num_cells_);
  }
}

// The place of one rank's is taken; or no rank has room.
TEST_F(PiecesOfRanks, LeaveNothingBehindWhenOneFails) {
  for (const OutputOptions& output : outputs()) {
    SCOPED_TRACE(info_of(output.format).name);
    const TempDir dir;
    const std::filesystem::path taken = piece_of(dir / "mesh.any", output.format, 1);
    std::filesystem::create_directory(taken);
    EXPECT_THROW(write(dir.path(), output, 1), std::runtime_error);
    EXPECT_EQ(names_in(dir), Names{taken.filename().string()});
    std::filesystem::remove(taken);
    const FileSizeLimit limit(1024);
    EXPECT_THROW(write(dir.path(), output, 1), std::runtime_error);
    EXPECT_EQ(names_in(dir), Names{});
  }
}

// Leaves that are split, whose parts are a copy's, or beyond.
TEST_F(RunOfRanks, SplitsLeavesAsOneProcess) {
  write_off(torus(1, 0.4, 32, 16), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.15, 12);
  mesh(options);
  const Contents expected = contents_of(options.store);
  for (const int num_ranks : {2, 9})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1))) << num_ranks;
}

// Sites that stay unresolved, what is left out for them, and those that become one.
TEST_F(RunOfRanks, MendsAsOneProcess) {
  write_off(knives(), scratch_ / "input.off");
  MeshOptions options = this->options("store", 1, 500);
  options.sharp_angle = 0;
  EXPECT_EQ(mesh(options).outcome, RunOutcome::kUnresolved);
  const Contents expected = contents_of(options.store);
  for (const int num_ranks : {3})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1))) << num_ranks;
}

TEST_F(RunOfRanks, OfARealModelHasTheRecordsOfOneProcess) {
  const std::filesystem::path models = models_directory();
  if (models.empty()) GTEST_SKIP() << kNoModels;
  MeshOptions options = this->options("store", 0, 2000);
  options.input = models / "rocker_arm.obj";
  options.size = {4, true};
  mesh(options);
  const Contents expected = contents_of(options.store);
  EXPECT_GT(expected.leaves.size(), 100U);
  for (const int num_ranks : {3, 8})
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 2))) << num_ranks;
}

// Sooner or later in the run, and with what has been committed.
TEST_F(RunOfRanks, GoesOnAfterAnyRankEnds) {
  write_off(torus(1, 0.4, 48, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.12, 300);
  for (std::uint64_t round = 0; round < 4; ++round) expect_to_go_on_after_ends(options, round, 5);
}

TEST_F(RunOfRanks, EndsWhereAMessageIsLost) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.3, 300);
  mesh(options);
  const Contents expected = contents_of(options.store);
  for (std::uint64_t lost = 0; lost < 60; lost += 13) {
    MeshOptions again = options;
    again.store += "-" + std::to_string(lost);
    const ThreadRanksOptions ranks{.fault =
                                       [&](int from, int, std::uint64_t number) {
                                         return from == 1 && number == lost ? MessageFault::kLost
                                                                            : MessageFault::kNone;
                                       },
                                   .patience = std::chrono::milliseconds(400)};
    EXPECT_THROW(mesh_by(2, again, 1, ranks), ExchangeError) << lost;
    EXPECT_TRUE(are_equal(expected, mesh_by(2, again, 1))) << lost;
  }
}

TEST_F(RunOfRanks, RefusesStoresThatDoNotBelongTogether) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.3, 300);
  mesh_by(2, options, 1);
  const std::filesystem::path first = scratch_ / "store-2-0", second = scratch_ / "store-2-1",
                              aside = scratch_ / "aside";
  std::filesystem::rename(second, aside);
  EXPECT_NE(refusal_of(options).find("rank 1, store " + second.string() + ": there is no part"),
            std::string::npos);
  std::filesystem::copy(first, second, std::filesystem::copy_options::recursive);
  EXPECT_NE(
      refusal_of(options).find("rank 1, store " + second.string() + ": this is the part of rank 0"),
      std::string::npos);
  std::filesystem::remove_all(second);
  std::filesystem::rename(aside, second);
  EXPECT_EQ(refusal_of(options), "none");

  const MeshOptions alone = this->options("alone-2-1", 0.3, 300);
  mesh(alone);
  EXPECT_NE(refusal_of(this->options("alone", 0.3, 300)).find("rank 0, store"), std::string::npos);
}

TEST_F(RunOfRanks, OfOtherParametersIsRefusedUnlessForced) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  mesh_by(2, options("store", 0.3, 300), 1);
  MeshOptions other = options("store", 0.25, 300);
  EXPECT_NE(refusal_of(other).find("size"), std::string::npos) << refusal_of(other);
  other.is_forced = true;
  const Contents forced = mesh_by(2, other, 1);
  MeshOptions alone = options("alone", 0.25, 300);
  mesh(alone);
  EXPECT_TRUE(are_equal(contents_of(alone.store), forced));

  MeshOptions paper = options("paper", 0.3, 300);
  paper.init = Initialization::kPaper;
  EXPECT_THROW(mesh_by(2, paper, 1), InputError);
}

// Growth, with a bound and without, and what asks for smaller cells.
std::vector<MeshOptions> with_sizes(const MeshOptions& options) {
  std::vector<MeshOptions> some(5, options);
  some[0].growth = 0.3;
  some[1].growth = 0.2;
  some[0].size = some[1].size = {0.15, false};
  some[1].max_size = Size{0.18, false};
  some[2].shapes = {SizedShape::ball({0.05}, {0.3, 0.2, 0.1}, 0.1)};
  some[3].deviation = Size{0.02, false};
  some[4].layers = 3;
  some[4].per_circle = 12;
  for (std::size_t i = 0; i < some.size(); ++i) some[i].store += "-sizes" + std::to_string(i);
  return some;
}

TEST_F(RunOfRanks, FindsSizesAsOneProcess) {
  write_off(together(sphere(0.8, 12, 24), translated(torus(0.5, 0.2, 16, 8), {1.6, 0, 0.4})),
            scratch_ / "input.off");
  int num_ranks = 2;
  for (const MeshOptions& options : with_sizes(this->options("store", 0.2, 300))) {
    mesh(options);
    const Contents expected = contents_of(options.store);
    EXPECT_GT(expected.leaves.size(), 20U);
    EXPECT_TRUE(are_equal(expected, mesh_by(num_ranks, options, 1)))
        << options.store << ", " << num_ranks;
    num_ranks = num_ranks % 5 + 1;
  }
}

TEST_F(RunOfRanks, MeasuresNeighborsOfOtherRanks) {
  write_off(sphere(1, 24, 48), scratch_ / "input.off");
  MeshOptions options = this->options("store", 0.08, 400);
  options.growth = 0.2;
  mesh(options);
  const MeshStatistics expected = mesh_statistics(Store::open(options.store, {.read_only = true}));
  EXPECT_GT(expected.max_neighbor_ratio, 1);
  mesh_by(5, options, 1);
  run_as_ranks(5, [&](Exchange& exchange) {
    const Store own = Store::open(store_of_rank(options.store.string() + "-5-%r", exchange.rank()),
                                  {.read_only = true});
    const MeshStatistics all = mesh_statistics(own, 1, {}, nullptr, exchange);
    EXPECT_EQ(all.max_neighbor_ratio, expected.max_neighbor_ratio);
    EXPECT_EQ(all.num_cells_by_octave, expected.num_cells_by_octave);
  });
}

// Ranks have copies of cells that were mended: these are measured by their owner alone.
TEST_F(RunOfRanks, MeasuresWhatWasMendedOnce) {
  write_off(knives(), scratch_ / "input.off");
  MeshOptions options = this->options("store", 1, 300);
  options.sharp_angle = 0;
  options.growth = 0.2;
  EXPECT_EQ(mesh(options).outcome, RunOutcome::kUnresolved);
  const MeshStatistics expected = mesh_statistics(Store::open(options.store, {.read_only = true}));
  mesh_by(3, options, 1);
  run_as_ranks(3, [&](Exchange& exchange) {
    const Store own = Store::open(store_of_rank(options.store.string() + "-3-%r", exchange.rank()),
                                  {.read_only = true});
    const MeshStatistics all = mesh_statistics(own, 1, {}, nullptr, exchange);
    EXPECT_EQ(all.num_cells, expected.num_cells);
    EXPECT_EQ(all.min_dihedral_angles.counts, expected.min_dihedral_angles.counts);
    EXPECT_EQ(all.max_neighbor_ratio, expected.max_neighbor_ratio);
  });
}

// As above, while sizes are found and leaves move.
TEST_F(RunOfRanks, WithSizesGoesOnAfterAnyRankEnds) {
  write_off(sphere(1, 16, 32), scratch_ / "input.off");
  MeshOptions options = with_sizes(this->options("store", 0.25, 300))[3];
  options.deviation = Size{0.02, false};
  for (std::uint64_t round = 0; round < 3; ++round) expect_to_go_on_after_ends(options, round, 7);
}

// Stopped now and then, and gone on with by any number of ranks, or begun by one process.
TEST_F(RunOfRanks, GoesOnByAnotherNumberOfRanks) {
  write_off(torus(1, 0.4, 32, 16), scratch_ / "input.off");
  for (const double growth : {0.0, 0.2}) {
    MeshOptions options = this->options("store" + std::to_string(growth), 0.15, 200);
    options.growth = growth;
    mesh(options);
    const Contents expected = contents_of(options.store);
    const auto one = [&](int rank) { return options.store.string() + "-r" + std::to_string(rank); };
    const auto stopped_after = [](int num_asked) {
      RunControl control;
      control.is_stopped = [num = std::make_shared<std::atomic<int>>(num_asked)] {
        return (*num)-- < 0;
      };
      return control;
    };
    MeshOptions begun = options;
    begun.store = one(0);
    EXPECT_EQ(mesh(begun, stopped_after(40)).outcome, RunOutcome::kInterrupted);
    MeshOptions all = options;
    all.store = options.store.string() + "-r%r";
    bool is_done = false;
    int num_interrupted = 0;
    for (int round = 0; !is_done; ++round) {
      const int num_ranks = std::array{3, 5, 2, 1, 4}[static_cast<std::size_t>(round) % 5];
      run_as_ranks(num_ranks, [&](Exchange& exchange) {
        const RunSummary summary = mesh_as_rank(all, stopped_after(3 + round), exchange);
        if (exchange.rank() == 0) is_done = summary.outcome == RunOutcome::kDone;
      });
      num_interrupted += is_done ? 0 : 1;
      ASSERT_LT(round, 100);
      for (int rank = 0; rank < 6; ++rank)
        EXPECT_EQ(std::filesystem::exists(one(rank)), rank < num_ranks) << rank;
    }
    EXPECT_GT(num_interrupted, 2);
    run_as_ranks(2, [&](Exchange& exchange) {
      mesh_as_rank(all, {}, exchange);
      std::optional<Store> whole;
      if (exchange.rank() == 0) whole = Store::open(one(9), {.create = true});
      const Store own = Store::open(one(exchange.rank()), {.read_only = true});
      join_leaves({&own, 1}, whole ? &*whole : nullptr, exchange);
    });
    EXPECT_TRUE(are_equal(expected, contents_of(one(9))));
  }
}

// As if they had been killed, again and again, each time by another number.
TEST_F(RunOfRanks, GoesOnByAnotherNumberAfterAnyRankEnds) {
  constexpr std::array kNumbers = {3, 1, 5, 2, 4, 3, 2, 5, 1};
  write_off(torus(1, 0.4, 32, 16), scratch_ / "input.off");
  for (const double growth : {0.0, 0.2}) {
    MeshOptions options = this->options("store" + std::to_string(growth), 0.15, 200);
    options.growth = growth;
    mesh(options);
    const Contents expected = contents_of(options.store);
    int num_within = 0;
    for (std::size_t round = 0; round < 3; ++round) {
      MeshOptions all = options;
      all.store += "-" + std::to_string(round) + "-%r";
      std::size_t num_ended = 0;
      while (!goes_on(all, kNumbers.at((round + num_ended) % kNumbers.size()),
                      60 + 7 * round + 5 * num_ended % 31)) {
        num_within += is_within_superstep(all.store) ? 1 : 0;
        ASSERT_LT(++num_ended, 100U);
      }
      EXPECT_TRUE(are_equal(expected, joined(all.store))) << growth << ", round " << round;
    }
    EXPECT_GT(num_within, 3) << growth;
  }
}

TEST_F(RunOfRanks, IsJoinedWithinASuperstep) {
  write_off(torus(1, 0.4, 32, 16), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.15, 200);
  mesh(options);
  const Contents expected = contents_of(options.store);
  MeshOptions all = options;
  all.store += "-%r";
  end_within_superstep(all);
  EXPECT_NE(joined(all.store).run.phase, Phase::kDone);
  MeshOptions alone = options;
  alone.store = scratch_ / "joined";
  mesh(alone);
  EXPECT_TRUE(are_equal(expected, contents_of(alone.store)));
}

TEST_F(RunOfRanks, WithTooLittleMemoryToEndASuperstepSaysSo) {
  write_off(torus(1, 0.4, 32, 16), scratch_ / "input.off");
  MeshOptions all = this->options("store-%r", 0.15, 200);
  end_within_superstep(all);
  RunControl control;
  control.memory_bytes = std::uint64_t{200} << 20;
  try {
    run_as_ranks(1, [&](Exchange& exchange) { mesh_as_rank(all, control, exchange); });
    FAIL();
  } catch (const OverBudget& e) {
    EXPECT_NE(std::string(e.what()).find("this process is to end for 3 of them"), std::string::npos)
        << e.what();
  }
  run_as_ranks(3, [&](Exchange& exchange) { mesh_as_rank(all, control, exchange); });
}

TEST_F(RunOfRanks, AsksForWhatTheLeastRunAndItsMessagesTake) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  const MeshOptions all = this->options("store-%r", 0.2, 500);
  const auto run = [&](std::uint64_t bytes) {
    RunControl control;
    control.memory_bytes = bytes;
    run_as_ranks(2, [&](Exchange& exchange) { mesh_as_rank(all, control, exchange); });
  };
  try {
    run(kLeastMemory);
    FAIL();
  } catch (const OverBudget& e) {
    EXPECT_GT(e.bytes(), kLeastMemory);
    EXPECT_THROW(run(e.bytes() - 1), OverBudget);
    run(e.bytes());
  }
}

// When some have their new stores in place, and others beside the old ones.
TEST_F(RunOfRanks, GoesOnByAnotherNumberWhereAMoveEnds) {
  write_off(sphere(1, 12, 24), scratch_ / "input.off");
  const MeshOptions options = this->options("store", 0.3, 300);
  mesh(options);
  const Contents expected = contents_of(options.store);
  const std::filesystem::path begun = scratch_ / "begun", run = scratch_ / "run";
  std::filesystem::create_directory(begun);
  MeshOptions all = options;
  all.store = begun / "%r";
  ASSERT_FALSE(goes_on(all, 4, 60));
  all.store = run / "%r";
  const auto is_moving = [&] {
    int num_in_place = 0, num_beside = 0;
    for (int rank = 0; rank < 3; ++rank) {
      const std::filesystem::path store = store_of_rank(all.store, rank);
      const auto in_place = record_in(store), beside = record_in(store.string() + ".next");
      num_in_place += in_place && in_place->first.size() == 3 ? 1 : 0;
      num_beside += beside && beside->first.size() == 3 ? 1 : 0;
    }
    return num_in_place > 0 && num_beside > 0 && num_in_place + num_beside == 3;
  };
  int num_tried = 0;
  for (std::uint64_t num_words = 0; !is_moving(); ++num_words) {
    ASSERT_LT(++num_tried, 1000);
    std::filesystem::remove_all(run);
    std::filesystem::copy(begun, run, std::filesystem::copy_options::recursive);
    if (goes_on(all, 3, num_words)) num_words = 0;
  }
  run_as_ranks(2, [&](Exchange& exchange) { mesh_as_rank(all, {}, exchange); });
  EXPECT_TRUE(are_equal(expected, joined(all.store)));
}

}  // namespace
}  // namespace locvol
