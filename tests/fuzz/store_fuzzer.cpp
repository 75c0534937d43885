// Damage to the data file of a small store: opening it, reading all of it and writing to it gives
// what was stored, nothing, or a StoreError; never a crash, never other content.
//
//   | what to do u8 | change ... |
//
// What to do: bit 0 asks for writing. A change begins with its kind (modulo 4) and a page:
//   0 bytes  | kind u8 | page u8 | place in the page u16 | number n u8 (modulo 16) | n bytes |
//   1 copy   | kind u8 | page u8 | page u8 |       the first one's content, onto the second
//   2 name   | kind u8 | page u8 |                 writes the page's number where it belongs
//   3 cut    | kind u8 | page u8 | bytes u16 |     ends the file in that page
// Pages and places count modulo how many there are. What bytes a store has is not part of any
// format, so an input means another damage when the codec or LMDB change.

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "storage/store.h"
#include "tests/file_bytes.h"
#include "tests/fuzz/expect.h"
#include "tests/storage/samples.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

using namespace testing_samples;
namespace fs = std::filesystem;

constexpr std::size_t kPageBytes = 4096;
constexpr StoreOptions kSmall{.is_durable = false, .map_bytes = 1 << 22};

struct LeafRecords {
  QueueEntry entry;
  LeafInfo info;
  LeafPoints points;
  LeafCells cells;
  LeafFacets facets;
  LeafSurface surface;
  LeafUnresolved unresolved;
};

// Enough for trees of two levels, values on overflow pages, and records of several chunks. Each is
// written once only, so that there is no older one which could turn up instead.
std::vector<LeafRecords> make_leaves() {
  Generator random(7);
  std::vector<LeafRecords> leaves;
  for (std::uint32_t i = 0; i < 40; ++i) {
    const std::size_t size = i < 2 ? 400 : i < 5 ? 130 : 2;
    leaves.push_back({{{1 + i % 2, i % 3}, MortonKey::containing({i, 5, 0}, 21)},
                      random.info(),
                      random.points(size),
                      random.cells(size),
                      random.facets(size / 2),
                      random.surface(size / 4),
                      random.unresolved(size / 100)});
  }
  return leaves;
}

const std::vector<LeafRecords>& expected_leaves() {
  static const std::vector<LeafRecords> leaves = make_leaves();
  return leaves;
}

void put(Batch& batch, const LeafRecords& leaf) {
  const MortonKey key = leaf.entry.leaf;
  batch.put_leaf(key, leaf.info);
  batch.put_points(key, leaf.points);
  batch.put_cells(key, leaf.cells);
  batch.put_facets(key, leaf.facets);
  batch.put_surface(key, leaf.surface);
  batch.put_unresolved(key, leaf.unresolved);
  batch.put_queue_entry(leaf.entry);
}

// The data file of a store with a history, and so with free pages.
std::string make_data_file() {
  const TempDir directory;
  {
    StoreOptions options = kSmall;
    options.create = true;
    Store store = Store::open(directory.path(), options);
    Batch first = store.begin();
    first.put_run(sample_run());
    first.commit();
    const auto& leaves = expected_leaves();
    for (std::size_t i = 0; i < leaves.size(); i += 8) {
      Batch batch = store.begin();
      for (std::size_t j = i; j < i + 8; ++j) put(batch, leaves[j]);
      batch.commit();
    }
    Batch last = store.begin();
    last.erase_leaf(leaves[1].entry.leaf);
    last.erase_leaf(leaves[20].entry.leaf);
    last.commit();
  }
  std::string bytes = bytes_of(directory.path() / "data.mdb");
  expect(bytes.size() % kPageBytes == 0 && bytes.size() < 256 * kPageBytes,
         "the store is of whole pages, numbered by a byte");
  return bytes;
}

// -- Damage --------------------------------------------------------------------------------------

// Reads the changes; what lies beyond the end of the input is 0.
class Changes {
 public:
  explicit Changes(std::string_view input) : rest_(input) {}
  bool is_at_end() const { return rest_.empty(); }
  std::size_t number(std::size_t num_bytes) {
    std::size_t value = 0;
    for (std::size_t i = 0; i < num_bytes; ++i) value |= std::size_t{byte()} << (8 * i);
    return value;
  }
  std::uint8_t byte() {
    if (rest_.empty()) return 0;
    const auto value = static_cast<std::uint8_t>(rest_[0]);
    rest_.remove_prefix(1);
    return value;
  }

 private:
  std::string_view rest_;
};

void make_change(Changes& changes, std::string& file) {
  const std::size_t num_pages = file.size() / kPageBytes;
  if (num_pages == 0) return static_cast<void>(changes.byte());
  const std::size_t kind = changes.byte() % 4;
  const std::uint64_t page = changes.byte() % num_pages;
  const std::size_t begin = page * kPageBytes;
  if (kind == 0) {
    std::size_t at = begin + changes.number(2) % kPageBytes;
    for (std::size_t n = changes.byte() % 16; n > 0; --n) {
      const std::uint8_t byte = changes.byte();
      if (at < file.size()) file[at++] = static_cast<char>(byte);
    }
  } else if (kind == 1) {
    const std::size_t onto = changes.byte() % num_pages * kPageBytes;
    std::memmove(file.data() + onto, file.data() + begin, kPageBytes);
  } else if (kind == 2) {
    std::memcpy(file.data() + begin, &page, sizeof page);
  } else {
    file.resize(begin + changes.number(2) % kPageBytes);
  }
}

// -- What comes back -----------------------------------------------------------------------------

template <class Record, class Read>
void expect_stored_or_nothing(const Record& stored, const Read& read) {
  try {
    const Record record = read();
    expect(record == stored || record == Record(), "what is read was stored");
  } catch (const StoreError&) {
  }
}

void expect_stored_or_nothing(const Reader& reader) {
  expect_stored_or_nothing(std::optional(sample_run()), [&] { return reader.run(); });
  for (const LeafRecords& leaf : expected_leaves()) {
    const MortonKey key = leaf.entry.leaf;
    expect_stored_or_nothing(std::optional(leaf.info), [&] { return reader.leaf(key); });
    expect_stored_or_nothing(leaf.points, [&] { return reader.points(key); });
    expect_stored_or_nothing(leaf.cells, [&] { return reader.cells(key); });
    expect_stored_or_nothing(leaf.facets, [&] { return reader.facets(key); });
    expect_stored_or_nothing(leaf.surface, [&] { return reader.surface(key); });
    expect_stored_or_nothing(leaf.unresolved, [&] { return reader.unresolved(key); });
    expect_stored_or_nothing(true, [&] { return reader.has_queue_entry(leaf.entry); });
  }
  try {
    std::size_t num_seen = 0;
    reader.for_each_leaf([&](MortonKey, const LeafInfo&) { return ++num_seen < 1000; });
    reader.for_each_queued([&](const QueueEntry&) { return ++num_seen < 1000; });
    expect(num_seen < 1000, "there are no more entries than were stored");
  } catch (const StoreError&) {
  }
}

void read_all(const fs::path& directory) try {
  StoreOptions options = kSmall;
  options.read_only = true;
  const Store store = Store::open(directory, options);
  expect_stored_or_nothing(store.snapshot());
  store.sizes();
  store.release_pages();
} catch (const StoreError&) {
}

// Takes free pages, and gives back others: of leaves erased and written anew.
void write_some(const fs::path& directory) try {
  Store store = Store::open(directory, kSmall);
  for (std::size_t round = 0; round < 3; ++round) {
    Batch batch = store.begin();
    for (std::size_t i = round; i < expected_leaves().size(); i += 7) {
      const LeafRecords& leaf = expected_leaves()[i];
      batch.erase_leaf(leaf.entry.leaf);
      if (i % 2 == 0) put(batch, leaf);
    }
    batch.commit();
  }
} catch (const StoreError&) {
}

void use_damaged(std::string_view input) {
  static const std::string sound = make_data_file();
  static const TempDir directory;
  std::string file = sound;
  Changes changes(input);
  const bool writes = (changes.byte() & 1) != 0;
  while (!changes.is_at_end()) make_change(changes, file);
  std::ofstream(directory / "data.mdb", std::ios::binary) << file;
  read_all(directory.path());
  if (!writes) return;
  write_some(directory.path());
  read_all(directory.path());
}

}  // namespace
}  // namespace locvol

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  locvol::use_damaged({reinterpret_cast<const char*>(data), size});
  return 0;
}
