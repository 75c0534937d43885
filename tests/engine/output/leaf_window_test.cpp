#include "engine/output/leaf_window.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

namespace locvol {
namespace {

using Pairs = std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>>;

Pairs common(const std::vector<std::uint64_t>& ids, const std::vector<std::uint64_t>& table) {
  Pairs pairs;
  for_each_common(ids, table, [&](auto i, auto j) { pairs.emplace_back(i, j); });
  return pairs;
}

// Ascending, in runs: most steps are 1, some long.
std::vector<std::uint64_t> random_ids(std::mt19937& random) {
  std::uniform_int_distribution<int> size(0, 300), step(1, 30), run(0, 9);
  std::vector<std::uint64_t> ids;
  std::uint64_t id = 0;
  for (int n = size(random); n > 0; --n)
    ids.push_back(id += static_cast<std::uint64_t>(run(random) > 0 ? 1 : 20 * step(random)));
  return ids;
}

TEST(ForEachCommon, FindsThePlacesOfEachCommonIdInOrder) {
  constexpr unsigned kSeed = 41;
  std::mt19937 random(kSeed);
  std::size_t num_common = 0;
  for (int n = 0; n < 500; ++n) {
    const auto ids = random_ids(random), table = random_ids(random);
    Pairs expected;
    for (std::size_t i = 0; i < ids.size(); ++i)
      if (const auto found = std::ranges::find(table, ids[i]); found != table.end())
        expected.emplace_back(i, found - table.begin());
    ASSERT_EQ(common(ids, table), expected) << "seed " << kSeed << ", n " << n;
    num_common += expected.size();
  }
  EXPECT_GT(num_common, 1000u);
}

TEST(ForEachCommon, OfWhatHasNoEntries) {
  EXPECT_EQ(common({}, {}), Pairs());
  EXPECT_EQ(common({1, 2}, {}), Pairs());
  EXPECT_EQ(common({}, {1, 2}), Pairs());
  EXPECT_EQ(common({3}, {3}), (Pairs{{0, 0}}));
}

}  // namespace
}  // namespace locvol
