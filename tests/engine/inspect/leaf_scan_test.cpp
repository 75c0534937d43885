#include "engine/inspect/leaf_scan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "octree/octree.h"
#include "tests/damaged_record.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

constexpr int kLevel = 4;  // 4096 leaves: several pieces

LeafInfo info_of(MortonKey key) {
  LeafInfo info;
  info.num_points = key.bits() >> 52 & 255;
  return info;
}

void put_leaves(Store& store, const LinearOctree& octree) {
  Batch batch = store.begin();
  for (const MortonKey key : octree.leaves()) batch.put_leaf(key, info_of(key));
  batch.commit();
}

void split(Store& store, MortonKey leaf) {
  Batch batch = store.begin();
  batch.erase_leaf(leaf);
  for (int octant = 0; octant < 8; ++octant) {
    const MortonKey child = leaf.child(octant);
    batch.put_leaf(child, info_of(child));
  }
  batch.commit();
}

class LeafScan : public testing::Test {
 protected:
  LeafScan() { put_leaves(store_, octree_); }

  std::vector<LeafRow> scan(const ScanOptions& options = {}) {
    std::vector<LeafRow> rows;
    const auto take = [&](const LeafRow& row) {
      rows.push_back(row);
      return true;
    };
    scan_leaves(store_, take, faults_, options);
    return rows;
  }

  const TempDir dir_;
  LinearOctree octree_ = LinearOctree::uniform(kLevel);
  Store store_ = Store::open(dir_ / "store", {.create = true, .is_durable = false});
  std::vector<Fault> faults_;
};

TEST_F(LeafScan, VisitsEveryLeafOnce) {
  const auto rows = scan();
  ASSERT_EQ(rows.size(), octree_.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_EQ(rows[i].key, octree_.leaves()[i]);
    EXPECT_EQ(rows[i].info, info_of(rows[i].key));
  }
  EXPECT_TRUE(faults_.empty());
}

TEST_F(LeafScan, StopsWhenAsked) {
  int num = 0;
  scan_leaves(
      store_, [&](const LeafRow&) { return ++num < 1500; }, faults_);
  EXPECT_EQ(num, 1500);
}

// What is split while the scan is at another leaf shows as itself or as its children: in any case
// the rows are an octree.
TEST_F(LeafScan, CoversTheRootWhileLeavesSplit) {
  const unsigned seed = 7;
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  std::vector<MortonKey> keys;
  bool has_shown_child = false;
  const auto take = [&](const LeafRow& row) {
    if (keys.size() % 100 == 0) {
      const auto leaves = octree_.leaves();
      const MortonKey leaf = leaves[random() % leaves.size()];
      split(store_, leaf);
      octree_.split(leaf);
      split(store_, octree_.leaf_at(row.key));
      octree_.split(octree_.leaf_at(row.key));
    }
    keys.push_back(row.key);
    has_shown_child |= row.key.level() > kLevel;
    return true;
  };
  scan_leaves(store_, take, faults_);
  EXPECT_TRUE(has_shown_child);
  EXPECT_NO_THROW(LinearOctree{keys});
  EXPECT_TRUE(faults_.empty());
}

TEST_F(LeafScan, ShowsDamageInItsPlace) {
  const MortonKey damaged = octree_.leaves()[2000];
  LeafInfo info = info_of(damaged);
  info.num_deletions = 0x123456789abcdef;  // so that no other leaf's record is alike
  {
    Batch batch = store_.begin();
    batch.put_leaf(damaged, info);
    batch.commit();
  }
  const auto path = store_.directory();
  store_ = Store::open(dir_ / "other", {.create = true});
  damage_record(path, info, damaged);
  store_ = Store::open(path);

  const auto rows = scan();
  ASSERT_EQ(rows.size(), octree_.size());
  for (const LeafRow& row : rows) {
    const bool is_damaged = row.key == damaged;
    EXPECT_EQ(row.info.has_value(), !is_damaged);
    EXPECT_EQ(row.state() == LeafState::kDamaged, is_damaged);
    ASSERT_EQ(row.faults.size(), is_damaged ? 1U : 0U);
    if (is_damaged) {
      EXPECT_EQ(row.faults[0].leaf, damaged);
    }
  }
  EXPECT_TRUE(faults_.empty());
}

// Counts that do not agree with the records are damage, too.
TEST_F(LeafScan, ReadingAllFindsWhatIsMissing) {
  const auto has_points = [](MortonKey key) { return info_of(key).num_points > 0; };
  const auto num_wrong = std::ranges::count_if(octree_.leaves(), has_points);
  const auto rows = scan({.reads_all = true});
  EXPECT_EQ(std::ranges::count(rows, LeafState::kDamaged, &LeafRow::state), num_wrong);
  EXPECT_GT(num_wrong, 0);
}

TEST(LeafRow, HasTheStateOfItsRecord) {
  LeafRow row{.key = MortonKey::root(), .info = LeafInfo(), .unresolved = {}, .faults = {}};
  EXPECT_EQ(row.state(), LeafState::kEmpty);
  row.info->num_core_points = 7;
  EXPECT_EQ(row.state(), LeafState::kCore);
  row.info->num_core_points = 0;
  row.info->queued = QueuePosition{0, 0};  // to be covered
  EXPECT_EQ(row.state(), LeafState::kUnvisited);
  row.info->num_points = 3;
  row.info->num_visits = 1;
  EXPECT_EQ(row.state(), LeafState::kWaiting);
  row.info->queued.reset();
  EXPECT_EQ(row.state(), LeafState::kClean);
  row.faults.push_back({row.key, "cells"});
  EXPECT_EQ(row.state(), LeafState::kDamaged);
}

TEST_F(LeafScan, ListsTheQueueWhileItMovesOn) {
  std::vector<QueueEntry> places;
  Batch batch = store_.begin();
  for (std::uint32_t i = 0; i < 4000; ++i) {
    places.push_back({{i / 2000, i / 500}, octree_.leaves()[i]});
    batch.put_queue_entry(places.back());
  }
  batch.commit();
  std::vector<QueueEntry> shown;
  const auto take = [&](const QueueRow& row) {
    EXPECT_TRUE(row.faults.empty());
    if (shown.size() % 50 == 0) {  // the front is visited
      Batch visit = store_.begin();
      for (std::size_t i = shown.size(); i < shown.size() + 20; ++i)
        visit.erase_queue_entry(places[i]);
      visit.commit();
    }
    shown.push_back(row.entry);
    return true;
  };
  scan_queue(store_, take, faults_);
  EXPECT_TRUE(std::ranges::is_sorted(shown));
  EXPECT_TRUE(std::ranges::includes(places, shown));
  EXPECT_GT(shown.size(), 2000U);
  EXPECT_TRUE(faults_.empty());
}

TEST_F(LeafScan, FindsLeavesAsTheOctreeDoes) {
  std::mt19937 random(11);
  const Frame frame({-1, -1, -1}, 2.0 / (1 << MortonKey::kMaxLevel));
  for (int i = 0; i < 30; ++i) {
    const MortonKey leaf = octree_.leaves()[random() % octree_.size()];
    split(store_, leaf);
    octree_.split(leaf);
  }
  const Snapshot snapshot = store_.snapshot();
  std::uniform_real_distribution<double> coordinate(-1, 1);
  for (int i = 0; i < 100; ++i) {
    const Point p{coordinate(random), coordinate(random), coordinate(random)};
    EXPECT_EQ(leaf_holding(snapshot, frame, p), octree_.leaf_owning(frame, p));
    const Box box = Box::around(p).expanded(0.05 * (coordinate(random) + 1));
    const double distance = 0.1 * (coordinate(random) + 1);
    EXPECT_EQ(stored_leaves_within(snapshot, frame, box, distance),
              octree_.leaves_within(frame, box, distance));
  }
  EXPECT_EQ(leaf_holding(snapshot, frame, {1.5, 0, 0}), std::nullopt);
}

}  // namespace
}  // namespace locvol
