// Pages by several ranks, against that of one store that has what they have: the same bytes.
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/rank_engine.h"
#include "engine/ranks/rank_store.h"
#include "tests/engine/closed_shapes.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tools/page/page.h"

namespace locvol {
namespace {

using namespace testing_shapes;

class PageOfRanks : public testing::TestWithParam<int> {
 protected:
  void mesh(
      const std::function<void(MeshOptions&)>& choose = [](MeshOptions&) {},
      const Shape& shape = together(sphere(1, 16, 32),
                                    translated(torus(0.5, 0.2, 16, 8), {1.9, 0, 0.4}))) {
    write_off(shape, scratch_ / "input.off");
    MeshOptions options;
    options.input = scratch_ / "input.off";
    options.store = scratch_ / "part-%r";
    options.size = {0.11, false};
    options.leaf_capacity = 300;
    choose(options);
    run_as_ranks(GetParam(), [&](Exchange& exchange) { mesh_as_rank(options, {}, exchange); });
  }

  std::filesystem::path part(int rank) const { return store_of_rank(scratch_ / "part-%r", rank); }

  void change_parts(const std::function<void(Batch&)>& change) {
    for (int rank = 0; rank < GetParam(); ++rank) {
      Store store = Store::open(part(rank));
      Batch batch = store.begin();
      change(batch);
      batch.commit();
    }
  }

  PageSummary page_of_ranks(const ViewLimits& limits) {
    PageSummary page;
    run_as_ranks(GetParam(), [&](Exchange& exchange) {
      const Store own = Store::open(part(exchange.rank()), {.read_only = true});
      const PageSummary of_rank = write_page(own, many_, limits, 1, exchange);
      if (exchange.rank() == 0) page = of_rank;
    });
    return page;
  }

  // Returns what is told of the page.
  PageSummary expect_same(const ViewLimits& limits) {
    const std::filesystem::path whole = scratch_ / "whole";
    if (!std::filesystem::exists(whole))
      run_as_ranks(GetParam(), [&](Exchange& exchange) {
        join_ranks(scratch_ / "part-%r", whole, {}, exchange);
      });
    const PageSummary page = write_page(Store::open(whole, {.read_only = true}), one_, limits, 1);
    const PageSummary of_ranks = page_of_ranks(limits);
    EXPECT_EQ(of_ranks.bytes, page.bytes);
    EXPECT_EQ(of_ranks.num_cells, page.num_cells);
    EXPECT_EQ(of_ranks.num_mesh_cells, page.num_mesh_cells);
    EXPECT_TRUE(bytes_of(many_) == bytes_of(one_));
    return page;
  }

  bool says(std::string_view text) const { return bytes_of(one_).find(text) != std::string::npos; }

  TempDir scratch_;
  const std::filesystem::path one_ = scratch_ / "one.html", many_ = scratch_ / "many.html";
};

TEST_P(PageOfRanks, HasAllCells) {
  mesh();
  const PageSummary page = expect_same({});
  EXPECT_GT(page.num_mesh_cells, 7'500U);
  EXPECT_EQ(page.num_cells, page.num_mesh_cells);
}

TEST_P(PageOfRanks, HasCellsAtPlanesAndAThinnedSurface) {
  mesh();
  for (const std::uint64_t max_cells : {7'000, 6'000, 5'000}) {
    const PageSummary page =
        expect_same({.max_cells = max_cells, .max_triangles = 400, .max_leaves = 30});
    EXPECT_GT(page.num_cells, 500U);
    EXPECT_LE(page.num_cells, max_cells);
    EXPECT_TRUE(says("thinned to"));
  }
  EXPECT_EQ(expect_same({.max_cells = 10}).num_cells, 0U);
}

// Of a ring, planes now and then meet more cells than was estimated, and than there is room for.
TEST_P(PageOfRanks, HasFewerPlanesWhereThoseChosenMeetTooManyCells) {
  mesh([](MeshOptions& options) { options.size = {0.1, false}; }, torus(1, 0.15, 96, 16));
  const std::uint64_t num_cells = expect_same({}).num_cells;
  // Each number of ranks has others of these.
  for (auto part = static_cast<std::uint64_t>(8 + GetParam() % 4); part < 40; part += 4) {
    const ViewLimits limits{.max_cells = num_cells * part / 40};
    EXPECT_LE(expect_same(limits).num_cells, limits.max_cells);
  }
}

TEST_P(PageOfRanks, WhereSizesVary) {
  mesh([](MeshOptions& options) {
    options.growth = 0.3;
    options.size = {0.2, false};
    options.deviation = Size{0.05, false};
  });
  expect_same({});
  EXPECT_GT(expect_same({.max_cells = 5'000}).num_cells, 500U);
}

// Of a mesh made without a bound on angles, in stores that say there was one.
TEST_P(PageOfRanks, MarksTheFirstSitesAndPoorCells) {
  mesh([](MeshOptions& options) { options.min_dihedral = 0; });
  change_parts([](Batch& batch) {
    RunRecord run = batch.run().value();
    run.parameters.min_dihedral = 15;
    std::optional<MortonKey> leaf;
    batch.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
      if (info.holding == Holding::kOwn && info.num_points > 3) leaf = key;
      return !leaf;
    });
    LeafInfo info = batch.leaf(*leaf).value();
    LeafUnresolved unresolved;
    for (std::size_t i = 0; i < 3; ++i)
      unresolved.sites.push_back({1, batch.points(*leaf).points.at(i).position, 0.01});
    run.counts.num_unresolved = info.num_unresolved = 3;
    batch.put_leaf(*leaf, info);
    batch.put_unresolved(*leaf, unresolved);
    batch.put_run(run);
  });
  expect_same({});
  EXPECT_TRUE(says("<caption>Poor cells</caption>"));
  EXPECT_TRUE(says("<caption>Unresolved sites</caption>"));
  for (const std::uint64_t max_sites : {2, 4, 7}) {
    expect_same({.max_sites = max_sites});
    EXPECT_TRUE(says(" poor cells are marked."));
  }
}

TEST_P(PageOfRanks, IsNotThereIfARankHasADamagedStore) {
  mesh();
  Store store = Store::open(part(GetParam() - 1));
  Batch batch = store.begin();
  batch.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
    if (info.holding == Holding::kOwn && info.num_cells > 0) batch.put_points(leaf, {});
    return true;
  });
  batch.commit();
  EXPECT_THROW(page_of_ranks({}), CorruptRecord);
  EXPECT_FALSE(std::filesystem::exists(many_));
}

INSTANTIATE_TEST_SUITE_P(Ranks, PageOfRanks, testing::Values(1, 2, 3, 5));

}  // namespace
}  // namespace locvol
