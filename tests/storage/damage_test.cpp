// Damage to the files of a store: an error that says so, or the same content; never a crash, never
// other content.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <lmdb.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "storage/codec.h"
#include "storage/page_check.h"
#include "storage/store.h"
#include "tests/file_bytes.h"
#include "tests/storage/child_process.h"
#include "tests/storage/samples.h"
#include "tests/storage/store_errors.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_samples;

constexpr int kNumDamagedLeaves = 12;

void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

struct LeafRecords {
  LeafInfo info;
  LeafPoints points;
  LeafCells cells;
  LeafFacets facets;
  LeafSurface surface;
  LeafUnresolved unresolved;
  QueueEntry entry;
};

const std::vector<LeafRecords>& expected_leaves() {
  static const std::vector<LeafRecords> leaves = [] {
    Generator random(5);
    std::vector<LeafRecords> made(kNumDamagedLeaves);
    for (int i = 0; i < kNumDamagedLeaves; ++i) {
      const auto size = static_cast<std::size_t>(i);
      made[size] = {random.info(),           random.points(20 + 60 * size), random.cells(300),
                    random.facets(100),      random.surface(200),           random.unresolved(3),
                    {{1, 2}, leaf_number(i)}};
    }
    return made;
  }();
  return leaves;
}

// A store with some history, so that it has free pages, and pages in use in many places.
void make_store(const std::filesystem::path& path) {
  Store store = Store::open(path, {.create = true, .is_durable = false});
  for (int round = 0; round < 3; ++round) {
    for (const LeafRecords& leaf : expected_leaves()) {
      Batch batch = store.begin();
      batch.put_run(sample_run());
      batch.put_leaf(leaf.entry.leaf, leaf.info);
      batch.put_points(leaf.entry.leaf, leaf.points);
      batch.put_cells(leaf.entry.leaf, leaf.cells);
      batch.put_facets(leaf.entry.leaf, leaf.facets);
      batch.put_surface(leaf.entry.leaf, leaf.surface);
      batch.put_unresolved(leaf.entry.leaf, leaf.unresolved);
      batch.put_queue_entry(leaf.entry);
      batch.commit();
    }
    Batch batch = store.begin();  // not needed any more: free pages
    if (round < 2) batch.erase_leaf(leaf_number(round));
    batch.commit();
  }
}

struct Reading {
  int num_same = 0, num_missing = 0, num_corrupt = 0, num_other = 0;
};

template <class Record, class Read>
void read_one(Reading& reading, const Record& expected, const Read& read) {
  try {
    const Record record = read();
    if (record == expected) {
      ++reading.num_same;
    } else {
      ++(record == Record() ? reading.num_missing : reading.num_other);
    }
  } catch (const StoreError&) {
    ++reading.num_corrupt;
  }
}

// All that make_store() wrote.
Reading read_store(const std::filesystem::path& path) {
  const Store store = Store::open(path, kReadOnly);
  const Snapshot snapshot = store.snapshot();
  Reading reading;
  read_one(reading, std::optional(sample_run()), [&] { return snapshot.run(); });
  for (const LeafRecords& leaf : expected_leaves()) {
    const MortonKey key = leaf.entry.leaf;
    read_one(reading, std::optional(leaf.info), [&] { return snapshot.leaf(key); });
    read_one(reading, leaf.points, [&] { return snapshot.points(key); });
    read_one(reading, leaf.cells, [&] { return snapshot.cells(key); });
    read_one(reading, leaf.facets, [&] { return snapshot.facets(key); });
    read_one(reading, leaf.surface, [&] { return snapshot.surface(key); });
    read_one(reading, leaf.unresolved, [&] { return snapshot.unresolved(key); });
    read_one(reading, true, [&] { return snapshot.has_queue_entry(leaf.entry); });
  }
  try {
    std::size_t num_seen = 0;
    snapshot.for_each_leaf([&](MortonKey, const LeafInfo&) { return ++num_seen < 1000; });
    snapshot.for_each_queued([&](const QueueEntry&) { return ++num_seen < 1000; });
  } catch (const StoreError&) {
  }
  return reading;
}
constexpr int kNumRecords = 1 + 7 * kNumDamagedLeaves;

class Damage : public testing::Test {
 protected:
  Damage() : path_(dir_ / "s"), data_(path_ / "data.mdb") {
    make_store(path_);
    bytes_ = bytes_of(data_);
  }

  // Reads all with `byte` at `at`, in place, and puts the old byte back.
  std::optional<Reading> read_with(std::size_t at, char byte) {
    const int file = ::open(data_.c_str(), O_WRONLY);
    EXPECT_EQ(pwrite(file, &byte, 1, static_cast<off_t>(at)), 1);
    std::optional<Reading> reading;
    try {
      reading = read_store(path_);
    } catch (const StoreError&) {
    }
    EXPECT_EQ(pwrite(file, &bytes_[at], 1, static_cast<off_t>(at)), 1);
    close(file);
    return reading;
  }

  TempDir dir_;
  std::filesystem::path path_, data_;
  std::string bytes_;
};

TEST_F(Damage, AnUndamagedStoreReadsWhole) { EXPECT_EQ(read_store(path_).num_same, kNumRecords); }

// Every byte of some stored records, in the file.
TEST_F(Damage, FlippedBytesOfRecordsAreNoticed) {
  const std::string points = encode(expected_leaves()[0].points, leaf_number(0));
  for (const std::string& record : {points, encode(sample_run(), MortonKey())}) {
    std::size_t num_harmful = 0;
    for (std::size_t at = bytes_.find(record); at != std::string::npos;
         at = bytes_.find(record, at + 1)) {
      const auto flipped = [&](std::size_t i) {
        const auto reading = read_with(at + i, static_cast<char>(~bytes_[at + i]));
        return reading.value_or(Reading());
      };
      if (flipped(0).num_same == kNumRecords) continue;  // in a free page
      for (std::size_t i = 0; i < record.size(); ++i) {
        const Reading reading = flipped(i);
        EXPECT_EQ(reading.num_same + reading.num_corrupt, kNumRecords);
        EXPECT_LE(reading.num_corrupt, 1);
        num_harmful += reading.num_corrupt > 0;
      }
    }
    EXPECT_GE(num_harmful, record.size() - 4);
  }
}

TEST_F(Damage, CorruptRecordNamesTheLeaf) {
  const std::string record = encode(expected_leaves()[0].points, leaf_number(0));
  for (std::size_t at = bytes_.find(record); at != std::string::npos;
       at = bytes_.find(record, at + 1))
    bytes_[at + 20] = static_cast<char>(~bytes_[at + 20]);
  write_bytes(data_, bytes_);
  const Store store = Store::open(path_, kReadOnly);
  try {
    store.snapshot().points(leaf_number(0));
    ADD_FAILURE() << "no CorruptRecord";
  } catch (const CorruptRecord& error) {
    EXPECT_EQ(error.leaf(), leaf_number(0));
    EXPECT_NE(std::string(error.what()).find("`points` of the leaf at level 21, key 0x"),
              std::string::npos)
        << error.what();
  }
}

// The pages of the data file with these flags, those no longer in use included.
std::vector<std::size_t> pages_with_flags(const std::string& bytes, std::uint16_t wanted) {
  std::vector<std::size_t> pages;
  for (std::size_t page = 0; page < bytes.size(); page += 4096) {
    std::uint16_t flags;
    std::memcpy(&flags, bytes.data() + page + 10, sizeof flags);
    if (flags == wanted) pages.push_back(page);
  }
  return pages;
}

// LMDB frees as many pages as the header says, from the one on that it says: 2^24 of them took
// 128 MB, and a wrong one made pages free that were in use.
TEST_F(Damage, DamagedHeadersOfOverflowPagesAreNeverFreed) {
  int num_refused = 0;
  for (const std::size_t page : pages_with_flags(bytes_, 0x04)) {
    for (const std::size_t at : {page + 1, page + 15}) {  // the page's number, the count of pages
      std::string damaged = bytes_;
      damaged[at] = static_cast<char>(damaged[at] ^ 1);
      write_bytes(data_, damaged);
      try {
        Store store = Store::open(path_);
        Batch batch = store.begin();
        for (int i = 0; i < kNumDamagedLeaves; ++i) batch.erase_leaf(leaf_number(i));
        batch.commit();
      } catch (const StoreError& error) {
        EXPECT_NE(std::string(error.what()).find("damaged overflow page"), std::string::npos)
            << error.what();
        ++num_refused;
      }
    }
  }
  EXPECT_GT(num_refused, 2 * kNumDamagedLeaves);
}

// To remove a node, LMDB moves the others by its length: one too long moved bytes beyond the page.
TEST_F(Damage, NodesThatOverlapAreRefused) {
  int num_refused = 0;
  for (const std::size_t page : pages_with_flags(bytes_, 0x02)) {
    std::uint16_t node, flags;
    std::memcpy(&node, bytes_.data() + page + 16, sizeof node);
    std::memcpy(&flags, bytes_.data() + page + node + 4, sizeof flags);
    if (flags == 0x01) continue;  // its value is on other pages
    std::string damaged = bytes_;
    damaged[page + node] =
        static_cast<char>(damaged[page + node] + 16);  // of the size of the value
    write_bytes(data_, damaged);
    try {
      EXPECT_EQ(read_store(path_).num_same, kNumRecords);  // in a free page
    } catch (const StoreError&) {
      ++num_refused;
    }
  }
  EXPECT_GT(num_refused, 5);
}

// Anywhere, LMDB's own pages included, whose keys have no checksum but the sum of all.
TEST_F(Damage, FlippedBytesAnywhereNeverCrashNorHideNorGiveOtherContent) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  std::vector<std::size_t> places;
  for (std::size_t page = 0; page < bytes_.size(); page += 4096)
    for (std::size_t i = 0; i < 24; ++i) places.push_back(page + i);
  for (std::size_t i = 0; i < 192; ++i) places.push_back(i), places.push_back(4096 + i);
  for (int i = 0; i < 2000; ++i) places.push_back(random() % bytes_.size());
  int num_refused = 0;
  for (const std::size_t at : places) {
    const auto reading = read_with(at, static_cast<char>(bytes_[at] ^ (1 << random() % 8)));
    num_refused += !reading;
    const Reading read = reading.value_or(Reading());
    EXPECT_EQ(read.num_other + read.num_missing, 0) << "byte " << at;
  }
  EXPECT_GT(num_refused, 100);
}

TEST_F(Damage, TruncatedFilesAreRefused) {
  std::size_t num_refused = 0;
  for (std::size_t length = 0; length < bytes_.size(); length += 1024) {
    write_bytes(data_, bytes_.substr(0, length));
    try {
      EXPECT_EQ(read_store(path_).num_same, kNumRecords) << length;  // only free pages are gone
    } catch (const StoreError&) {
      ++num_refused;
    }
  }
  EXPECT_GT(num_refused, bytes_.size() / 1024 / 2);
  write_bytes(data_, bytes_);
  EXPECT_EQ(read_store(path_).num_same, kNumRecords);
}

TEST_F(Damage, GarbageIsRefused) {
  std::mt19937_64 random(3);
  std::string garbage(100000, '\0');
  for (char& c : garbage) c = static_cast<char>(random());
  write_bytes(data_, garbage);
  expect_error([&] { Store::open(path_); }, "not an LMDB file");
  std::string half = bytes_;
  half.replace(2 * 4096, garbage.size() - 2 * 4096, garbage, 0, garbage.size() - 2 * 4096);
  write_bytes(data_, half);
  EXPECT_THROW(Store::open(path_), StoreError);
}

// -- Sound LMDB files that are no store of ours ---------------------------------------------------

class ForeignFile : public testing::Test {
 protected:
  ForeignFile() {
    mdb_env_create(&environment_);
    mdb_env_set_maxdbs(environment_, 9);
    EXPECT_EQ(mdb_env_open(environment_, dir_.path().c_str(), 0, 0644), 0);
    mdb_txn_begin(environment_, nullptr, 0, &transaction_);
  }
  void put(const char* database, std::string key, std::string value) {
    MDB_dbi handle = 0;
    EXPECT_EQ(mdb_dbi_open(transaction_, database, MDB_CREATE, &handle), 0);
    MDB_val k{key.size(), key.data()}, v{value.size(), value.data()};
    EXPECT_EQ(mdb_put(transaction_, handle, &k, &v, 0), 0);
    key_sums_[database] += key_hash(key);
  }
  void close() {
    EXPECT_EQ(mdb_txn_commit(transaction_), 0);
    mdb_env_close(environment_);
  }

  TempDir dir_;
  MDB_env* environment_ = nullptr;
  MDB_txn* transaction_ = nullptr;
  KeySumByName key_sums_;
};

TEST_F(ForeignFile, AnotherFormatIsRefused) {
  put("meta", "format", encode(StoreFormat{StoreFormat::kCurrent + 1}, MortonKey()));
  close();
  expect_error(
      [&] { Store::open(dir_.path()); },
      "format " + std::to_string(StoreFormat::kCurrent + 1) + ", written by another locvol");
}

TEST_F(ForeignFile, DamagedFormatIsRefused) {
  put("meta", "format", "x");
  close();
  EXPECT_THROW(Store::open(dir_.path()), CorruptRecord);
}

TEST_F(ForeignFile, AnotherProgramsDatabaseIsRefused) {
  put("users", "root", "x");
  close();
  expect_error([&] { Store::open(dir_.path()); }, "not a locvol store");
  expect_error([&] { Store::open(dir_.path(), {.create = true}); }, "not a locvol store");
}

// What is left of a creation that was killed halfway.
TEST_F(ForeignFile, AnEmptyEnvironmentBecomesAStore) {
  close();
  EXPECT_FALSE(Store::exists(dir_.path()));
  EXPECT_TRUE(Store::owns(dir_.path()));
  expect_error([&] { Store::open(dir_.path()); }, "there is no store here");
  expect_error([&] { Store::open(dir_.path(), kReadOnly); }, "there is no store here");
  EXPECT_TRUE(Store::open(dir_.path(), {.create = true}).snapshot().leaf_keys().empty());
}

// And within the first write, at any length.
TEST(Creation, GoesOnWhereItWasCutShort) {
  const TempDir dir;
  Store::open(dir / "s", {.create = true});
  const std::string whole = bytes_of(dir / "s" / "data.mdb").substr(0, 8192);
  for (std::size_t length = 0; length < whole.size(); length += 512) {
    const TempDir cut;
    write_bytes(cut / "data.mdb", whole.substr(0, length));
    write_bytes(cut / "writer.lock", "1");
    EXPECT_FALSE(Store::exists(cut.path())) << length;
    EXPECT_TRUE(Store::owns(cut.path())) << length;
    EXPECT_TRUE(Store::open(cut.path(), {.create = true}).snapshot().leaf_keys().empty()) << length;
    EXPECT_TRUE(Store::exists(cut.path())) << length;
  }
}

TEST(Creation, OwnsNothingElse) {
  const TempDir dir;
  EXPECT_FALSE(Store::owns(dir / "none"));
  EXPECT_TRUE(Store::owns(dir.path()));  // a creation may be killed after its first step
  Store::open(dir.path(), {.create = true});
  EXPECT_TRUE(Store::owns(dir.path()));
  write_bytes(dir / "notes.txt", "mine");
  EXPECT_FALSE(Store::owns(dir.path()));
}

// Keys and chunks that no Batch writes.
class ForeignRecords : public ForeignFile {
 protected:
  ForeignRecords() {
    put("meta", "format", encode(StoreFormat(), MortonKey()));
    for (const char* name : kNames) {
      MDB_dbi handle = 0;
      EXPECT_EQ(mdb_dbi_open(transaction_, name, MDB_CREATE, &handle), 0);
    }
  }
  void close() {
    KeySums keys;
    for (const char* name : kNames) keys.sums.push_back(key_sums_[name]);
    put("meta", "keys", encode(keys, MortonKey()));
    ForeignFile::close();
  }
  static std::string chunk_key(char chunk) {  // of the root
    return std::string("\x80\0\0\0\0\0\0\0\0\0\0", 11).replace(0, 1, 1, '\x80') + chunk;
  }
  static std::string chunk(std::uint64_t length, const std::string& bytes) {
    std::string chunk(8, '\0');
    std::memcpy(chunk.data(), &length, 8);
    return chunk + bytes;
  }
  void expect_corrupt_points() {
    close();
    const Store store = Store::open(dir_.path());
    EXPECT_THROW(store.snapshot().points(MortonKey::root()), CorruptRecord);
  }
  static constexpr const char* kNames[] = {"meta",  "leaves",     "points", "cells", "surface",
                                           "queue", "unresolved", "sizes",  "facets"};
  const std::string record_ = encode(sample_points(), MortonKey::root());
};

TEST_F(ForeignRecords, AnExtraChunkIsNoticed) {
  put("points", chunk_key(0), chunk(record_.size(), record_));
  put("points", chunk_key(1), "x");
  expect_corrupt_points();
}

TEST_F(ForeignRecords, AMissingFirstChunkIsNoticed) {
  put("points", chunk_key(1), "x");
  expect_corrupt_points();
}

TEST_F(ForeignRecords, AWrongLengthIsNoticed) {
  put("points", chunk_key(0), chunk(std::uint64_t{1} << 60, record_));
  expect_corrupt_points();
}

TEST_F(ForeignRecords, AFirstChunkCutShortIsNoticed) {
  put("points", chunk_key(0), "x");
  expect_corrupt_points();
}

TEST_F(ForeignRecords, AnotherLeafsRecordIsNoticed) {
  const std::string other = encode(sample_points(), sample_leaf());
  put("points", chunk_key(0), chunk(other.size(), other));
  expect_corrupt_points();
}

TEST_F(ForeignRecords, AQueueEntryOfAnotherPlaceIsNoticed) {
  const QueueEntry entry{{1, 2}, MortonKey::root()};
  put("queue", std::string(7, '\0') + '\x09' + std::string("\x80\0\0\0\0\0\0\0", 8),
      encode(entry, entry.leaf));
  close();
  const Store store = Store::open(dir_.path());
  EXPECT_THROW(store.snapshot().for_each_queued([](const QueueEntry&) { return true; }),
               CorruptRecord);
}

}  // namespace
}  // namespace locvol
