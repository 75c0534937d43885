#include "tools/leaf_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

namespace locvol {
namespace {

LeafRow row(int octant, std::uint32_t num_visits, std::uint64_t num_cells) {
  LeafInfo info;
  info.num_visits = num_visits;
  info.num_cells = num_cells;
  info.num_points = num_cells;
  info.num_insertions = {1, 0, 2, 0, 0, num_cells};
  info.num_moves = 3;
  return {.key = MortonKey::root().child(octant), .info = info, .unresolved = {}, .faults = {}};
}

LeafRow damaged_row(int octant) {
  const MortonKey key = MortonKey::root().child(octant);
  return {.key = key, .info = {}, .unresolved = {}, .faults = {{key, "bad"}}};
}

std::vector<int> octants(const std::vector<LeafRow>& rows) {
  std::vector<int> octants;
  for (const LeafRow& r : rows) octants.push_back(r.key.octant());
  return octants;
}

std::vector<LeafRow> sorted(const LeafListing& listing, const std::vector<LeafRow>& rows) {
  SortedLeaves leaves(listing);
  for (const LeafRow& r : rows) leaves.add(r);
  return leaves.take();
}

TEST(LeafCondition, ComparesEachField) {
  const LeafRow leaf = row(3, 2, 7);
  for (const char* text : {"visits=2", "visits==2", "visits >= 2", "visits<3", "visits!=1",
                           "cells>6", "cells <= 7", "points=7", "level=1", "insertions=10",
                           "deletions=0", "moves=3", "unresolved=0", "triangles<1"}) {
    EXPECT_TRUE(parse_condition(text).holds(leaf)) << text;
  }
  for (const char* text : {"visits=3", "visits>2", "visits<2", "cells!=7", "level>1"}) {
    EXPECT_FALSE(parse_condition(text).holds(leaf)) << text;
    EXPECT_TRUE(parse_condition(text).holds(damaged_row(1))) << text;
  }
}

TEST(LeafCondition, SaysWhatCanBeGiven) {
  for (const char* text : {"", "visits", "visits>", "visits>x", "visits>-1", "visits=>2",
                           "2>visits", "visits>2>1", "frob>1", "visits>1.5"}) {
    try {
      parse_condition(text);
      ADD_FAILURE() << text;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find("visits, points"), std::string::npos);
    }
  }
  EXPECT_THROW(parse_sort("frob"), std::invalid_argument);
  EXPECT_THROW(parse_state("queued"), std::invalid_argument);
  EXPECT_EQ(parse_sort("key"), nullptr);
  EXPECT_EQ(parse_sort("cells")->name, "cells");
  EXPECT_EQ(parse_state("unvisited"), LeafState::kUnvisited);
}

TEST(LeafListing, SortsCountsDownAndKeysUp) {
  const std::vector<LeafRow> rows = {row(0, 1, 5), row(1, 3, 9), damaged_row(2), row(3, 3, 2),
                                     row(4, 0, 5)};
  LeafListing listing;
  EXPECT_TRUE(listing.is_streamed());
  EXPECT_EQ(octants(sorted(listing, rows)), (std::vector{0, 1, 2, 3, 4}));
  listing.sort = parse_sort("cells");
  EXPECT_FALSE(listing.is_streamed());
  EXPECT_EQ(octants(sorted(listing, rows)), (std::vector{1, 0, 4, 3, 2}));
  listing.is_reversed = true;
  EXPECT_EQ(octants(sorted(listing, rows)), (std::vector{3, 0, 4, 1, 2}));
  listing.sort = parse_sort("key");
  EXPECT_EQ(octants(sorted(listing, rows)), (std::vector{4, 3, 1, 0, 2}));
  listing.limit = 2;
  EXPECT_EQ(octants(sorted(listing, rows)), (std::vector{4, 3}));
}

TEST(LeafListing, KeepsTheFirstOfMany) {
  LeafListing listing;
  listing.sort = parse_sort("cells");
  listing.limit = 3;
  std::vector<LeafRow> rows;
  for (std::uint64_t i = 0; i < 10000; ++i) rows.push_back(row(1, 0, i * 7919 % 10007));
  const auto first = sorted(listing, rows);
  std::ranges::sort(rows, std::ranges::greater{},
                    [](const LeafRow& r) { return r.info->num_cells; });
  ASSERT_EQ(first.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(first[i].info, rows[i].info);
}

TEST(LeafListing, ShowsWhatMeetsAllConditions) {
  LeafListing listing;
  listing.conditions = {parse_condition("visits>1"), parse_condition("cells<5")};
  EXPECT_FALSE(listing.shows(row(0, 1, 2)));
  EXPECT_FALSE(listing.shows(row(0, 2, 5)));
  EXPECT_TRUE(listing.shows(row(0, 2, 4)));
  EXPECT_TRUE(listing.shows(damaged_row(0)));
  listing.state = LeafState::kDamaged;
  EXPECT_FALSE(listing.shows(row(0, 2, 4)));
  EXPECT_TRUE(listing.shows(damaged_row(0)));
}

}  // namespace
}  // namespace locvol
