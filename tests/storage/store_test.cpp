#include "storage/store.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <fstream>
#include <future>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <thread>

#include "storage/file_system.h"
#include "tests/directories.h"
#include "tests/skip_reasons.h"
#include "tests/storage/child_process.h"
#include "tests/storage/samples.h"
#include "tests/storage/store_errors.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_samples;

constexpr StoreOptions kCreate{.create = true};
constexpr StoreOptions kTiny{.create = true, .map_bytes = 1};  // grows many times

// -- Against a model ------------------------------------------------------------------------------

// All that a store holds.
struct Model {
  struct Leaf {
    LeafPoints points;
    LeafCells cells;
    LeafFacets facets;
    LeafSurface surface;
    LeafUnresolved unresolved;
  };
  std::optional<RunRecord> run;
  std::map<MortonKey, LeafInfo> infos;
  std::map<MortonKey, Leaf> leaves;
  std::set<QueueEntry> queue;
};

void expect_same_lists(const Reader& reader, const Model& model) {
  std::vector<MortonKey> keys;
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    keys.push_back(key);
    const auto found = model.infos.find(key);
    EXPECT_TRUE(found != model.infos.end() && found->second == info);
    return true;
  });
  EXPECT_EQ(keys.size(), model.infos.size());
  EXPECT_TRUE(std::ranges::is_sorted(keys));
  EXPECT_EQ(reader.leaf_keys(), keys);
  const std::size_t middle = keys.size() / 2;
  const MortonKey from = keys.empty() ? MortonKey() : keys[middle];
  EXPECT_EQ(reader.leaf_keys(from, keys.size() + 1),
            std::vector(keys.begin() + static_cast<std::ptrdiff_t>(middle), keys.end()));
  EXPECT_EQ(reader.leaf_keys(MortonKey(), middle),
            std::vector(keys.begin(), keys.begin() + static_cast<std::ptrdiff_t>(middle)));
  std::vector<QueueEntry> queue;
  reader.for_each_queued([&](const QueueEntry& entry) {
    queue.push_back(entry);
    return true;
  });
  EXPECT_TRUE(std::ranges::equal(queue, model.queue));
  EXPECT_EQ(reader.queue_keys({}, queue.size() + 1), queue);
  if (queue.empty()) return;
  EXPECT_EQ(reader.queue_keys(queue.back(), 9), std::vector(1, queue.back()));
  EXPECT_EQ(reader.queue_keys(queue[0], 1), std::vector(1, queue[0]));
}

void expect_same(const Reader& reader, const Model& model, const std::vector<MortonKey>& keys) {
  EXPECT_EQ(reader.run(), model.run);
  for (const MortonKey key : keys) {
    const auto info = model.infos.find(key);
    EXPECT_EQ(reader.leaf(key),
              info == model.infos.end() ? std::nullopt : std::optional(info->second));
    const auto leaf = model.leaves.find(key);
    const Model::Leaf expected = leaf == model.leaves.end() ? Model::Leaf() : leaf->second;
    EXPECT_EQ(reader.points(key), expected.points);
    EXPECT_EQ(reader.cells(key), expected.cells);
    EXPECT_EQ(reader.facets(key), expected.facets);
    EXPECT_EQ(reader.surface(key), expected.surface);
    EXPECT_EQ(reader.unresolved(key), expected.unresolved);
  }
  expect_same_lists(reader, model);
}

// One random change, to both.
void change(Generator& random, const std::vector<MortonKey>& keys, Batch& batch, Model& model) {
  const MortonKey key = keys[random.integer(keys.size())];
  const std::size_t size = random.integer(4) == 0 ? random.integer(3000) : random.integer(20);
  Model::Leaf& leaf = model.leaves[key];
  switch (random.integer(10)) {
    case 0:
      batch.put_run(*(model.run = random.run()));
      break;
    case 1:
      batch.put_leaf(key, model.infos[key] = random.info());
      break;
    case 2:
      batch.put_points(key, leaf.points = random.points(size));
      break;
    case 3:
      batch.put_cells(key, leaf.cells = random.cells(size + 1));
      break;
    case 4:
      batch.put_surface(key, leaf.surface = random.surface(size));
      break;
    case 5:
      batch.put_unresolved(key, leaf.unresolved = random.unresolved(size));
      break;
    case 6:
      batch.erase_leaf(key);
      model.leaves.erase(key);
      model.infos.erase(key);
      break;
    case 7: {
      const QueueEntry entry{random.position(), key};
      batch.put_queue_entry(entry);
      model.queue.insert(entry);
      break;
    }
    case 8:
      batch.put_facets(key, leaf.facets = random.facets(size));
      break;
    default:
      if (model.queue.empty()) break;
      batch.erase_queue_entry(*model.queue.begin());
      model.queue.erase(model.queue.begin());
  }
}

// Reads its own writes; sees nothing of what is not committed; keeps snapshots; survives reopening
// and a map that must grow all the time.
TEST(Store, BehavesLikeItsModel) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  Generator random(seed);
  std::vector<MortonKey> keys(40);
  for (MortonKey& key : keys) key = random.leaf();
  const TempDir dir;
  Model committed;
  std::optional<Store> store(Store::open(dir / "s", kTiny));
  for (int round = 0; round < 25; ++round) {
    Model before = committed, pending = committed;
    const Snapshot snapshot = store->snapshot();
    {
      Batch batch = store->begin();
      for (int i = 0; i < 30; ++i) change(random, keys, batch, pending);
      expect_same(batch, pending, keys);
      if (random.integer(3) != 0) {
        batch.commit();
        committed = pending;
      }
    }
    expect_same(snapshot, before, keys);
    expect_same(store->snapshot(), committed, keys);
    if (round % 5 == 4) {
      // The old snapshot keeps the environment open, so it cannot be opened anew beside it.
      EXPECT_THROW(Store::open(dir / "s"), StoreError);
    }
    if (::testing::Test::HasFailure()) return;
  }
  store.reset();
  expect_same(Store::open(dir / "s", kReadOnly).snapshot(), committed, keys);
  expect_same(Store::open(dir / "s").snapshot(), committed, keys);
}

TEST(Store, StartsEmpty) {
  const TempDir dir;
  EXPECT_FALSE(Store::exists(dir / "s"));
  const Store store = Store::open(dir / "s", kCreate);
  EXPECT_TRUE(Store::exists(dir / "s"));
  expect_same(store.snapshot(), Model(), {MortonKey::root()});
  EXPECT_FALSE(store.snapshot().has_queue_entry({{0, 0}, MortonKey::root()}));
}

TEST(Store, QueueIsInOrderAcrossManyEntries) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  Generator random(seed);
  const TempDir dir;
  Store store = Store::open(dir / "s", kTiny);
  std::set<QueueEntry> entries;
  const auto add = [&](Batch& batch, int count) {
    for (int i = 0; i < count; ++i) {
      QueueEntry entry = random.queue_entry();
      entry.position.epoch *= 0x12345;  // all bytes of the key count
      batch.put_queue_entry(entry);
      entries.insert(entry);
    }
  };
  Batch first = store.begin();
  add(first, 2000);
  first.commit();
  Batch batch = store.begin();
  add(batch, 2000);
  const auto erase = [&](std::size_t begin, std::size_t end) {
    auto from = std::next(entries.begin(), static_cast<std::ptrdiff_t>(begin));
    for (std::size_t i = begin; i < end; ++i, from = entries.erase(from))
      batch.erase_queue_entry(*from);
  };
  erase(3000, 3500);
  erase(0, 1000);  // whole strides of erased entries
  const auto expect_in_order = [&](const Reader& reader) {
    auto expected = entries.begin();
    reader.for_each_queued([&](const QueueEntry& entry) {
      EXPECT_TRUE(expected != entries.end() && *expected == entry);
      EXPECT_TRUE(reader.has_queue_entry(entry));
      return expected++ != entries.end();
    });
    EXPECT_TRUE(expected == entries.end());
  };
  expect_in_order(batch);
  batch.commit();
  expect_in_order(store.snapshot());
}

TEST(Store, VisitorsMayStopAndMayUseTheStore) {
  const TempDir dir;
  Store store = Store::open(dir / "s", kTiny);
  Batch batch = store.begin();
  for (int i = 0; i < 1000; ++i) batch.put_leaf(leaf_number(i), sample_info());
  batch.commit();
  int num_seen = 0;
  store.snapshot().for_each_leaf([&](MortonKey, const LeafInfo&) { return ++num_seen < 300; });
  EXPECT_EQ(num_seen, 300);
  num_seen = 0;
  store.snapshot().for_each_leaf([&](MortonKey key, const LeafInfo&) {
    Batch inner = store.begin();
    inner.put_points(key, Generator(static_cast<std::uint64_t>(num_seen)).points(200));
    inner.erase_leaf(leaf_number(999));
    inner.commit();
    return ++num_seen < 100;
  });
  EXPECT_EQ(store.snapshot().points(leaf_number(99)), Generator(99).points(200));
  EXPECT_EQ(store.snapshot().leaf_keys().size(), 999u);
}

TEST(Store, BytesWrittenCountsWhatIsStored) {
  const TempDir dir;
  Store store = Store::open(dir / "s", kCreate);
  Batch batch = store.begin();
  EXPECT_EQ(batch.bytes_written(), 0u);
  batch.put_points(sample_leaf(), Generator(1).points(10000));
  EXPECT_GT(batch.bytes_written(), 100000u);
  EXPECT_LT(batch.bytes_written(), 400000u);
  const std::uint64_t written = batch.bytes_written();
  batch.commit();
  for (const DatabaseSize& size : store.sizes()) {
    if (size.name != "points") continue;
    EXPECT_GE(size.num_entries, written / 4080);
    EXPECT_LE(size.num_entries, written / 4080 + 1);
    EXPECT_GE(size.bytes, written);
    EXPECT_LE(size.bytes, written * 11 / 10 + 8192);
  }
  EXPECT_EQ(store.sizes().size(), 9u);
}

// -- Map growth -----------------------------------------------------------------------------------

TEST(Store, GrowsUnderLiveSnapshots) {
  const TempDir dir;
  Store store = Store::open(dir / "s", kTiny);
  std::vector<Snapshot> snapshots;
  for (int i = 0; i < 60; ++i) {
    Batch batch = store.begin();
    batch.put_points(leaf_number(i), Generator(static_cast<std::uint64_t>(i)).points(3000));
    batch.put_leaf(leaf_number(i), sample_info());
    batch.commit();
    snapshots.push_back(store.snapshot());
  }
  for (int i = 0; i < 60; ++i) {
    EXPECT_EQ(snapshots[static_cast<std::size_t>(i)].leaf_keys().size(),
              static_cast<std::size_t>(i + 1));
    EXPECT_EQ(snapshots[static_cast<std::size_t>(i)].points(leaf_number(i)),
              Generator(static_cast<std::uint64_t>(i)).points(3000));
  }
}

TEST(Store, OneBatchLargerThanTheMap) {
  const TempDir dir;
  Store store = Store::open(dir / "s", kTiny);
  Batch batch = store.begin();
  for (int i = 0; i < 200; ++i) batch.put_points(leaf_number(i), Generator(7).points(2000));
  batch.commit();
  for (int i = 0; i < 200; ++i)
    EXPECT_EQ(store.snapshot().points(leaf_number(i)).points.size(), 2000u);
}

TEST(Store, ThreadsReadWhileTheMapGrows) {
  const TempDir dir;
  Store store = Store::open(dir / "s", kTiny);
  constexpr int kNumLeaves = 120;
  std::atomic<bool> is_over = false;
  std::atomic<int> num_wrong = 0, num_reads = 0;
  const auto read = [&] {
    while (!is_over) {
      const Snapshot snapshot = store.snapshot();
      const auto keys = snapshot.leaf_keys();
      for (const MortonKey key : keys)
        num_wrong += snapshot.points(key).points.size() != snapshot.leaf(key)->num_points;
      store.release_pages();
      ++num_reads;
    }
  };
  std::thread first(read), second(read);
  for (int i = 0; i < kNumLeaves; ++i) {
    Batch batch = store.begin();
    LeafInfo info;
    info.num_points = static_cast<std::uint64_t>(10 * i + 1);
    batch.put_leaf(leaf_number(i), info);
    batch.put_points(leaf_number(i), Generator(1).points(info.num_points));
    batch.commit();
  }
  while (num_reads < 3) std::this_thread::yield();
  is_over = true;
  first.join();
  second.join();
  EXPECT_EQ(num_wrong, 0);
  EXPECT_EQ(store.snapshot().leaf_keys().size(), static_cast<std::size_t>(kNumLeaves));
}

TEST(Store, AnotherProcessGrowsTheMapUnderAReader) {
  const TempDir dir;
  const Signal is_open, has_grown;
  Child reader([&] {
    is_open.await();  // the writer has made the store
    StoreOptions options = kReadOnly;
    options.map_bytes = 1;
    const Store store = Store::open(dir / "s", options);
    const Snapshot before = store.snapshot();
    const bool was_empty = before.leaf_keys().empty();
    has_grown.raise();  // now grow, please
    is_open.await();
    const auto keys = store.snapshot().leaf_keys();
    return was_empty && before.leaf_keys().empty() && keys.size() == 50 &&
                   store.snapshot().points(keys[49]) == Generator(49).points(3000)
               ? 0
               : 1;
  });
  Store store = Store::open(dir / "s", kTiny);
  is_open.raise();
  has_grown.await();
  for (int i = 0; i < 50; ++i) {
    Batch batch = store.begin();
    batch.put_points(leaf_number(i), Generator(static_cast<std::uint64_t>(i)).points(3000));
    batch.put_leaf(leaf_number(i), sample_info());
    batch.commit();
  }
  is_open.raise();
  EXPECT_EQ(reader.exit_code(), 0);
}

// -- Threads and processes ------------------------------------------------------------------------

TEST(Store, SecondBatchWaitsForTheFirst) {
  const TempDir dir;
  Store store = Store::open(dir / "s", kCreate);
  std::optional<Batch> first(store.begin());
  first->put_run(sample_run());
  auto second = std::async(std::launch::async, [&] { return store.begin().run(); });
  EXPECT_EQ(second.wait_for(std::chrono::milliseconds(50)), std::future_status::timeout);
  first->commit();
  EXPECT_EQ(second.get(), sample_run());
}

TEST(Store, SecondProcessIsRefusedByName) {
  const TempDir dir;
  const Signal is_open, is_over;
  Child holder([&] {
    const Store store = Store::open(dir / "s", kCreate);
    is_open.raise();
    is_over.await();
    return 0;
  });
  is_open.await();
  expect_error([&] { Store::open(dir / "s"); }, "in use by process " + std::to_string(holder.id()));
  EXPECT_TRUE(Store::open(dir / "s", kReadOnly).snapshot().leaf_keys().empty());
  is_over.raise();
  EXPECT_EQ(holder.exit_code(), 0);
  EXPECT_NO_THROW(Store::open(dir / "s"));
}

TEST(Store, TellsWhoWrites) {
  const TempDir dir;
  const auto path = dir / "store";
  Store::open(path, kCreate);
  EXPECT_EQ(Store::open(path, kReadOnly).writer(), std::nullopt);
  Signal opened, seen;
  Child child([&] {
    const Store store = Store::open(path);
    opened.raise();
    seen.await();
    return 0;
  });
  opened.await();
  const auto writer = Store::open(path, kReadOnly).writer();
  EXPECT_EQ(writer, std::to_string(child.id()));
  seen.raise();
  EXPECT_EQ(child.exit_code(), 0);
  EXPECT_EQ(Store::open(path, kReadOnly).writer(), std::nullopt);
}

TEST(Store, FrozenStaysAsItWas) {
  const TempDir dir;
  Store store = Store::open(dir / "store", kCreate);
  const auto put = [&](int leaf) {
    Batch batch = store.begin();
    batch.put_leaf(leaf_number(leaf), {});
    batch.commit();
  };
  put(1);
  {
    const Store frozen = store.frozen();
    put(2);
    EXPECT_EQ(frozen.snapshot().leaf_keys(), std::vector{leaf_number(1)});
    EXPECT_EQ(store.snapshot().leaf_keys().size(), 2U);
    EXPECT_EQ(frozen.frozen().snapshot().leaf_keys().size(), 1U);
  }
  Store frozen = store.frozen();
  EXPECT_THROW(frozen.begin(), StoreError);
}

TEST(Store, OneEnvironmentPerProcess) {
  const TempDir dir;
  {
    Store store = Store::open(dir / "s", kCreate);
    expect_error([&] { Store::open(dir / "s"); }, "already open in this process");
    std::filesystem::create_symlink(dir / "s", dir / "alias");
    expect_error([&] { Store::open(dir / "alias"); }, "already open in this process");
    Store reader = Store::open(dir / "s", kReadOnly);
    expect_error([&] { reader.begin(); }, "reading only");
    Batch batch = store.begin();
    batch.put_run(sample_run());
    batch.commit();
    EXPECT_EQ(reader.snapshot().run(), sample_run());
  }
  EXPECT_NO_THROW(Store::open(dir / "s"));
}

TEST(Store, SnapshotsOutliveTheStore) {
  const TempDir dir;
  std::optional<Store> store(Store::open(dir / "s", kCreate));
  Batch batch = store->begin();
  batch.put_run(sample_run());
  batch.commit();
  std::optional<Snapshot> snapshot(store->snapshot());
  store.reset();
  EXPECT_EQ(snapshot->run(), sample_run());
}

TEST(Store, OpensAtItsLastCommitAfterAKill) {
  const TempDir dir;
  const Signal is_midway;
  Child writer([&] {
    Store store = Store::open(dir / "s", kTiny);
    for (int i = 0;; ++i) {
      Batch batch = store.begin();
      batch.put_leaf(leaf_number(i), sample_info());
      batch.put_points(leaf_number(i), Generator(static_cast<std::uint64_t>(i)).points(1000));
      if (i == 20) is_midway.raise();
      batch.commit();
    }
    return 0;
  });
  is_midway.await();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  kill(writer.id(), SIGKILL);
  EXPECT_TRUE(WIFSIGNALED(writer.wait()));
  Store store = Store::open(dir / "s");
  const auto keys = store.snapshot().leaf_keys();
  EXPECT_GE(keys.size(), 20u);
  for (std::size_t i = 0; i < keys.size(); ++i)
    EXPECT_EQ(store.snapshot().points(keys[i]), Generator(i).points(1000));
  EXPECT_TRUE(store.snapshot().points(leaf_number(static_cast<int>(keys.size()))).points.empty());
  Batch batch = store.begin();
  batch.put_run(sample_run());
  batch.commit();
}

// A snapshot of a killed process would keep pages from reuse for ever.
TEST(Store, ReadersOfKilledProcessesDoNotMakeTheFileGrow) {
  const TempDir dir;
  Store::open(dir / "s", kCreate);
  const Signal is_reading;
  Child reader([&] {
    const Store store = Store::open(dir / "s", kReadOnly);
    const Snapshot snapshot = store.snapshot();
    is_reading.raise();
    pause();
    return 0;
  });
  is_reading.await();
  kill(reader.id(), SIGKILL);
  reader.wait();
  Store store = Store::open(dir / "s");
  const auto rewrite = [&] {
    Batch batch = store.begin();
    batch.put_points(sample_leaf(), Generator(1).points(5000));
    batch.commit();
  };
  for (int i = 0; i < 5; ++i) rewrite();
  const auto bytes = std::filesystem::file_size(dir / "s" / "data.mdb");
  for (int i = 0; i < 50; ++i) rewrite();
  EXPECT_EQ(std::filesystem::file_size(dir / "s" / "data.mdb"), bytes);
}

// Nor do they while the writer goes on: it clears them at its next commit.
TEST(Store, ReadersKilledBesideALiveWriterDoNotMakeTheFileGrow) {
  const TempDir dir;
  const Signal has_content, is_reading;
  Child reader([&] {
    has_content.await();
    const Store store = Store::open(dir / "s", kReadOnly);
    const Snapshot snapshot = store.snapshot();
    snapshot.points(sample_leaf());
    is_reading.raise();
    pause();
    return 0;
  });
  Store store = Store::open(dir / "s", kCreate);
  const auto rewrite = [&](int times) {
    for (int i = 0; i < times; ++i) {
      Batch batch = store.begin();
      batch.put_points(sample_leaf(), Generator(1).points(5000));
      batch.commit();
    }
    return std::filesystem::file_size(dir / "s" / "data.mdb");
  };
  const auto before = rewrite(5);
  has_content.raise();
  is_reading.await();
  const auto pinned = rewrite(10);
  EXPECT_GT(pinned, before);  // what the reader sees must stay
  kill(reader.id(), SIGKILL);
  reader.wait();
  EXPECT_EQ(rewrite(50), pinned);
}

// -- Memory ---------------------------------------------------------------------------------------

// Of the store's file alone: which pages of the program are mapped is another matter.
std::uint64_t mapped_store_bytes() {
  std::ifstream maps("/proc/self/smaps");
  std::uint64_t kilobytes = 0;
  bool is_of_store = false;
  for (std::string line; std::getline(maps, line);) {
    if (line.find("data.mdb") != std::string::npos) is_of_store = true;
    if (is_of_store && line.starts_with("Rss:")) {
      kilobytes += std::stoull(line.substr(4));
      is_of_store = false;
    }
  }
  return kilobytes << 10;
}

class StoreMemory : public testing::Test {
 protected:
  static constexpr int kNumLeaves = 300;  // of some 33 MB
  static constexpr std::uint64_t kBound = std::uint64_t{2} << 20;
  // Branch pages of the trees are not accounted for, nor is what the test itself loads.
  static constexpr std::uint64_t kSlack = std::uint64_t{1} << 20;

  StoreMemory() {
    Store store = Store::open(dir_ / "s", {.create = true, .is_durable = false});
    Batch batch = store.begin();
    for (int i = 0; i < kNumLeaves; ++i) put(batch, i);
    batch.commit();
  }
  static void put(Batch& batch, int i) {
    batch.put_points(leaf_number(i), Generator(1).points(5000));
  }
  static void read(const Reader& reader, int i) {
    EXPECT_EQ(reader.points(leaf_number(i)).points.size(), 5000u);
  }

  const TempDir dir_;
};

TEST_F(StoreMemory, MappedPagesStayBelowTheirBound) {
  Store store = Store::open(dir_ / "s", {.is_durable = false, .memory_bytes = kBound});
  read(store.snapshot(), 0);
  store.release_pages();
  const std::uint64_t before = mapped_store_bytes();
  const auto expect_bounded = [&](const char* after) {
    EXPECT_LE(mapped_store_bytes(), before + kBound + kSlack) << after;
    EXPECT_LE(store.mapped_bytes(), kBound) << after;
  };
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  Generator random(seed);
  const Snapshot snapshot = store.snapshot();
  for (int i = 0; i < kNumLeaves; ++i) {
    read(snapshot, static_cast<int>(random.integer(kNumLeaves)));
    expect_bounded("reading");
  }
  Batch batch = store.begin();
  for (int i = 0; i < kNumLeaves; i += 2) put(batch, i);
  for (int i = 1; i < kNumLeaves; i += 4) batch.erase_leaf(leaf_number(i));
  expect_bounded("writing");
  batch.commit();
  expect_bounded("the commit");
  read(store.snapshot(), 0);
  EXPECT_GT(store.mapped_bytes(), 0u);
  EXPECT_GT(mapped_store_bytes(), before);
  store.release_pages();
  EXPECT_EQ(store.mapped_bytes(), 0u);
}

TEST_F(StoreMemory, MappedPagesAreFoundAgainAfterGrowth) {
  Store store =
      Store::open(dir_ / "s", {.is_durable = false, .map_bytes = 1, .memory_bytes = kBound});
  const std::uint64_t before = mapped_store_bytes();
  for (int i = kNumLeaves; i < 2 * kNumLeaves; ++i) {
    Batch batch = store.begin();
    put(batch, i);
    batch.commit();
    read(store.snapshot(), i);
    EXPECT_LE(mapped_store_bytes(), before + kBound + kSlack) << i;
  }
}

// In use on the heap.
std::uint64_t heap_bytes() {
  const struct mallinfo2 info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

TEST_F(StoreMemory, ABatchSaysWhatItTakes) {
  if (is_sanitized()) GTEST_SKIP() << kSanitized;
  Store store = Store::open(dir_ / "s", {.is_durable = false});
  encode(Generator(1).points(5000), sample_leaf());  // now this thread has its zstd contexts
  const std::uint64_t before = heap_bytes();
  Batch batch = store.begin();
  EXPECT_LT(batch.memory_bytes(), 1000u);
  for (int round = 0; round < 2; ++round)  // what is written twice counts once
    for (int i = 0; i < kNumLeaves; ++i) put(batch, i);
  for (int i = 0; i < 3000; ++i) batch.put_leaf(leaf_number(7 * i), sample_info());
  const std::uint64_t held = heap_bytes() - before;
  EXPECT_LE(held, batch.memory_bytes() * 11 / 10);
  EXPECT_GE(held, batch.memory_bytes() * 7 / 10);
  EXPECT_GT(held, std::uint64_t{20} << 20);
  const std::uint64_t commit_bytes = batch.commit_bytes();
  batch.commit();
  const std::uint64_t kept = heap_bytes() - before - held;  // LMDB's copies; the batch still lives
  EXPECT_LE(kept, commit_bytes);
  EXPECT_GE(kept, commit_bytes / 4);
}

// -- Disk -----------------------------------------------------------------------------------------

TEST(Store, FullDiskKeepsEarlierCommits) {
  const TempDir dir;
  Child child([&] {
    std::signal(SIGXFSZ, SIG_IGN);
    Store store = Store::open(dir / "s", kCreate);
    Batch first = store.begin();
    first.put_points(leaf_number(1), Generator(1).points(1000));
    first.commit();
    const rlimit limit{300000, 300000};
    setrlimit(RLIMIT_FSIZE, &limit);
    Batch second = store.begin();
    second.put_points(leaf_number(2), Generator(2).points(100000));
    try {
      second.commit();
      return 1;
    } catch (const StoreError& error) {
      if (std::string(error.what()).find("no space left") == std::string::npos) return 2;
    }
    return store.snapshot().points(leaf_number(1)) == Generator(1).points(1000) ? 0 : 3;
  });
  EXPECT_EQ(child.exit_code(), 0);
  Store store = Store::open(dir / "s");
  EXPECT_EQ(store.snapshot().points(leaf_number(1)), Generator(1).points(1000));
  EXPECT_TRUE(store.snapshot().points(leaf_number(2)).points.empty());
  Batch again = store.begin();
  again.put_points(leaf_number(2), Generator(2).points(100000));
  again.commit();
  EXPECT_EQ(store.snapshot().points(leaf_number(2)).points.size(), 100000u);
}

TEST(Store, LittleAddressSpaceIsEnough) {
  const TempDir dir;
  Child child([&] {
    const rlimit limit{std::uint64_t{4} << 30, std::uint64_t{4} << 30};
    setrlimit(RLIMIT_AS, &limit);
    Store store = Store::open(dir / "s", kCreate);  // asks for 64 GiB
    Batch batch = store.begin();
    batch.put_run(sample_run());
    batch.commit();
    return 0;
  });
  if (is_sanitized()) {  // sanitizers need the address space themselves
    child.wait();
    return;
  }
  EXPECT_EQ(child.exit_code(), 0);
  EXPECT_EQ(Store::open(dir / "s").snapshot().run(), sample_run());
}

TEST(Store, SaysWhyADirectoryIsNoStore) {
  const TempDir dir;
  expect_error([&] { Store::open(dir / "none"); }, "no such directory");
  expect_error([&] { Store::open(dir / "none" / "deeper", kCreate); }, "make the directory");
  expect_error([&] { Store::open(dir.path()); }, "no store here");
  StoreOptions both = kCreate;
  both.read_only = true;
  expect_error([&] { Store::open(dir.path(), both); }, "no store here");
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  std::ofstream(dir / "file") << "text";
  EXPECT_THROW(Store::open(dir / "file", kCreate), StoreError);
}

// Root may write anywhere, so that the child lets go of being root.
TEST(Store, SaysThatADirectoryCannotBeWritten) {
  const TempDir dir;
  Store::open(dir / "s", kCreate);
  using std::filesystem::perms;
  constexpr perms kReadAndSearch = static_cast<perms>(0555);
  std::filesystem::permissions(dir.path(), kReadAndSearch);
  std::filesystem::permissions(dir / "s", kReadAndSearch);
  for (const char* name : {"data.mdb", "lock.mdb", "writer.lock"})
    std::filesystem::permissions(dir / "s" / name, static_cast<perms>(0444));
  Child child([&] {
    if (geteuid() == 0 && setuid(65534) != 0) return 1;
    const auto is_refused = [&](const char* name, const StoreOptions& options) {
      const std::string message = error_of([&] { Store::open(dir / name, options); });
      return message.find("Permission denied") != std::string::npos &&
             message.find((dir / name).string()) != std::string::npos &&
             message.find("again") != std::string::npos;
    };
    if (!is_refused("s", {})) return 2;
    if (!is_refused("s", kReadOnly)) return 3;  // a reader has to write down what it reads
    return is_refused("new", kCreate) ? 0 : 4;
  });
  EXPECT_EQ(child.exit_code(), 0);
  std::filesystem::permissions(dir.path(), perms::owner_all);
  std::filesystem::permissions(dir / "s", perms::owner_all);
}

TEST(Store, KnowsNetworkFileSystems) {
  EXPECT_EQ(network_file_system_named(0x6969, ""), "NFS");
  EXPECT_EQ(network_file_system_named(0xFF534D42, ""), "CIFS");
  EXPECT_EQ(network_file_system_named(0x65735546, "fuse.sshfs"), "fuse.sshfs");
  EXPECT_EQ(network_file_system_named(0x65735546, "fuse.fuse-overlayfs"), std::nullopt);
  EXPECT_EQ(network_file_system_named(0xEF53, ""), std::nullopt);  // ext4
}

}  // namespace
}  // namespace locvol
