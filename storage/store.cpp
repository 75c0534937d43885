#include "storage/store.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstring>
#include <map>
#include <string_view>
#include <utility>

#include "storage/codec.h"
#include "storage/environment.h"
#include "storage/file_system.h"

// Keys and values in the databases
// ================================
// Numbers in keys are big-endian, so that LMDB's order of bytes is their order.
//
//   meta                             "format" | "keys" | "run" |
//                                    "memory" | "timeline" | "rank"
//                                    | "words" | "sheets"         -> record;
//                                    "result", leaf u64           -> record
//   leaves                           leaf u64                       -> record
//   queue                            epoch u32 | color u32 | leaf u64 -> record
//   points, cells, surface,
//   unresolved, sizes, facets        leaf u64 | chunk number u32    -> chunk of a blob
//
// A record is the bytes of codec.h. A blob is a record of any length, cut into chunks of 4,080
// bytes, what fits an LMDB page beside its header: LMDB looks for single free pages, never for runs
// of them (measured: whole blobs of 20 to 400 KB, put p99 4.1 ms; in chunks 0.15 ms). Chunk 0
// begins with the length of the record, which gives the number of chunks; one too few or too many
// is damage:
//
//   chunk 0   | record bytes u64, little-endian | the first 4,072 bytes |
//   chunk i   | the next 4,080 bytes | ...          the last one is shorter, never empty

namespace locvol {
namespace {

constexpr std::string_view kRunKey = "run", kMemoryKey = "memory", kTimelineKey = "timeline",
                           kRankKey = "rank", kResultKey = "result", kWordsKey = "words",
                           kSheetsKey = "sheets";
constexpr std::size_t kChunkBytes = 4080;
constexpr std::size_t kLengthBytes = 8;
constexpr std::array kBlobs = {Database::kPoints,     Database::kCells, Database::kSurface,
                               Database::kUnresolved, Database::kSizes, Database::kFacets};

// -- Keys -----------------------------------------------------------------------------------------

template <std::unsigned_integral T>
void append_big_endian(std::string& bytes, T value) {
  for (std::size_t i = sizeof(T); i-- > 0;) bytes += static_cast<char>(value >> (8 * i));
}

template <std::unsigned_integral T>
T big_endian_at(std::string_view bytes, std::size_t at) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    value = static_cast<T>(value << 8 | static_cast<unsigned char>(bytes[at + i]));
  return value;
}

std::string leaf_key(MortonKey leaf) {
  std::string key;
  append_big_endian(key, leaf.bits());
  return key;
}

std::string chunk_key(std::string_view leaf, std::uint32_t chunk) {
  std::string key(leaf);
  append_big_endian(key, chunk);
  return key;
}

std::string queue_key(const QueueEntry& entry) {
  std::string key;
  append_big_endian(key, entry.position.epoch);
  append_big_endian(key, entry.position.color);
  append_big_endian(key, entry.leaf.bits());
  return key;
}

std::string hexadecimal(std::uint64_t bits) {
  std::string text = "0x";
  for (int shift = 60; shift >= 0; shift -= 4) text += "0123456789abcdef"[bits >> shift & 15];
  return text;
}

using Path = std::filesystem::path;

[[noreturn]] void report_damage(const Path& store, Database database, MortonKey leaf,
                                const std::string& what) {
  std::string where =
      "store " + store.string() + ": damaged record in database `" + name_of(database) + "`";
  if (leaf.is_valid())
    where += " of the leaf at level " + std::to_string(leaf.level()) + ", key " +
             hexadecimal(leaf.bits());
  throw CorruptRecord(where + ": " + what + kDamageCure, leaf);
}

MortonKey leaf_of_key(const Path& store, Database database, std::string_view key, std::size_t at) {
  if (key.size() != at + sizeof(std::uint64_t))
    report_damage(store, database, MortonKey(), "a key of impossible length");
  return MortonKey::from_bits(big_endian_at<std::uint64_t>(key, at));
}

template <class Record>
Record decode_in(const Path& store, Database database, std::string_view bytes, MortonKey leaf) try {
  return decode<Record>(bytes, leaf);
} catch (const DecodeError& error) {
  report_damage(store, database, leaf, error.what());
}

// -- Blobs ----------------------------------------------------------------------------------------

std::uint64_t num_chunks_of(std::uint64_t record_bytes) {
  return (kLengthBytes + record_bytes + kChunkBytes - 1) / kChunkBytes;
}

// Puts the chunks of one blob together again, and checks that they are all there and no more.
class BlobJoiner {
 public:
  explicit BlobJoiner(MortonKey leaf) : prefix_(leaf_key(leaf)) {}

  // Takes one entry, in key order; false when it is not of this blob any more.
  bool take(std::string_view key, std::string_view value) {
    if (!key.starts_with(prefix_)) return false;
    if (key != chunk_key(prefix_, num_chunks_) || value.empty() || value.size() > kChunkBytes)
      throw DecodeError("chunks that do not follow one another");
    if (num_chunks_++ == 0) value = without_length(value);
    bytes_ += value;
    return true;
  }

  // The record; empty if there is none.
  std::string finish() {
    if (num_chunks_ == 0) return {};
    if (bytes_.size() != record_bytes_ || num_chunks_ != num_chunks_of(record_bytes_))
      throw DecodeError("chunks are missing or left over");
    return std::move(bytes_);
  }

 private:
  std::string_view without_length(std::string_view chunk) {
    if (chunk.size() <= kLengthBytes) throw DecodeError("a first chunk cut short");
    std::memcpy(&record_bytes_, chunk.data(), kLengthBytes);
    return chunk.substr(kLengthBytes);
  }

  std::string prefix_;
  std::string bytes_;
  std::uint64_t record_bytes_ = 0;
  std::uint32_t num_chunks_ = 0;
};

void write_blob(Environment::Transaction& transaction, Database database, std::string_view leaf,
                std::string_view record) {
  static_assert(std::endian::native == std::endian::little);
  const std::uint64_t record_bytes = record.size();
  std::string first(reinterpret_cast<const char*>(&record_bytes), kLengthBytes);
  first += record.substr(0, kChunkBytes - kLengthBytes);
  transaction.put(database, chunk_key(leaf, 0), first);
  std::uint32_t chunk = 1;
  for (std::size_t at = kChunkBytes - kLengthBytes; at < record.size(); at += kChunkBytes, ++chunk)
    transaction.put(database, chunk_key(leaf, chunk), record.substr(at, kChunkBytes));
  transaction.erase(database, chunk_key(leaf, chunk), chunk_key(leaf, ~std::uint32_t{0}));
}

bool is_blob(Database database) { return std::ranges::find(kBlobs, database) != kBlobs.end(); }

// What a batch has written: records by key (a blob's, whole, by leaf), or that they are erased.
using PendingRecords = std::map<std::string, std::optional<std::string>, std::less<>>;
using Pending = std::array<PendingRecords, kNumDatabases>;

// A pending record's node in the map, its key and the heap's own headers.
constexpr std::uint64_t kPendingBytes = 160;

// The pages that writing a record changes, at most: the tree's pages down to it, and its chunks,
// whose keys fill a page of the tree for every hundred of them.
std::uint64_t page_bytes_of(Database database, std::uint64_t record_bytes) {
  constexpr std::uint64_t kPageBytes = 4096 + 64, kChangedPages = 2;
  const std::uint64_t num_chunks = is_blob(database) ? num_chunks_of(record_bytes) : 0;
  return (kChangedPages + num_chunks + num_chunks / 100) * kPageBytes;
}

void write_pending(Environment::Transaction& transaction, Database database,
                   const PendingRecords& records) {
  for (const auto& [key, record] : records) {
    if (!is_blob(database)) {
      record ? transaction.put(database, key, *record) : transaction.erase(database, key, key);
    } else if (record) {
      write_blob(transaction, database, key, *record);
    } else {
      transaction.erase(database, chunk_key(key, 0), chunk_key(key, ~std::uint32_t{0}));
    }
  }
}

}  // namespace

// -- Reader ---------------------------------------------------------------------------------------

// Of a Snapshot, and of a Batch, whose pending records go before the stored ones.
struct Reader::Impl {
  std::shared_ptr<Environment> environment;
  Environment::WriteTurn turn;              // null in a Snapshot
  std::shared_ptr<Environment::View> view;  // null when a Batch is over
  Pending pending;
  std::uint64_t bytes_written = 0;
  std::uint64_t memory_bytes = 0;  // of what is pending
  std::uint64_t commit_bytes = 0;

  struct Entries {
    std::map<std::string, std::string> records;
    bool is_last = true;
    std::string next;  // where to go on, if not the last
  };
  using Visit = std::function<bool(const std::string& key, const std::string& record)>;

  const PendingRecords& pending_in(Database database) const {
    return pending[static_cast<std::size_t>(database)];
  }
  void put(Database database, std::string key, std::optional<std::string> record);
  std::optional<std::string> find(Database database, const std::string& key) const;
  std::optional<std::string> find_blob(Database database, MortonKey leaf) const;
  template <class Record>
  Record list(Database database, MortonKey leaf) const;
  template <class Record>
  void put_list(Database database, MortonKey leaf, const Record& record);
  static constexpr std::size_t kStride = 64;
  void for_each(Database database, const Visit& visit, std::string from = {},
                std::size_t stride = kStride) const;
  Entries entries_from(Database database, const std::string& from, std::size_t stride) const;
};

void Reader::Impl::put(Database database, std::string key, std::optional<std::string> record) {
  assert(view && "the batch is over");
  const std::uint64_t record_bytes = record ? record->size() : 0;
  PendingRecords& records = pending[static_cast<std::size_t>(database)];
  const auto [place, is_new] = records.try_emplace(std::move(key));
  std::optional<std::string>& held = place->second;
  if (is_new) memory_bytes += kPendingBytes;
  memory_bytes += record_bytes - (held ? held->size() : 0);  // modulo 2^64, as it should be
  bytes_written += record_bytes;
  commit_bytes += page_bytes_of(database, record_bytes);
  held = std::move(record);
}

std::optional<std::string> Reader::Impl::find(Database database, const std::string& key) const {
  assert(view && "the batch is over");
  const PendingRecords& records = pending_in(database);
  const auto written = records.find(key);
  return written != records.end() ? written->second : view->get(database, key);
}

std::optional<std::string> Reader::Impl::find_blob(Database database, MortonKey leaf) const try {
  assert(view && "the batch is over");
  const PendingRecords& records = pending_in(database);
  const std::string key = leaf_key(leaf);
  const auto written = records.find(key);
  if (written != records.end()) return written->second;
  BlobJoiner blob(leaf);
  view->scan(database, key, [&](auto chunk, auto value) { return blob.take(chunk, value); });
  std::string record = blob.finish();
  if (record.empty()) return std::nullopt;
  return record;
} catch (const DecodeError& error) {
  report_damage(environment->directory(), database, leaf, error.what());
}

// An empty list is stored as nothing at all.
template <class Record>
Record Reader::Impl::list(Database database, MortonKey leaf) const {
  const std::optional<std::string> bytes = find_blob(database, leaf);
  return bytes ? decode_in<Record>(environment->directory(), database, *bytes, leaf) : Record();
}

template <class Record>
void Reader::Impl::put_list(Database database, MortonKey leaf, const Record& record) {
  const bool is_empty = record == Record();
  put(database, leaf_key(leaf), is_empty ? std::nullopt : std::optional(encode(record, leaf)));
}

// Visits some entries at a time, with no call into LMDB under way meanwhile: the visitor may read,
// write and commit.
void Reader::Impl::for_each(Database database, const Visit& visit, std::string from,
                            std::size_t stride) const {
  for (bool is_last = false; !is_last;) {
    const Entries entries = entries_from(database, from, stride);
    for (const auto& [key, record] : entries.records)
      if (!visit(key, record)) return;
    is_last = entries.is_last;
    from = entries.next;
  }
}

// Some entries from key `from` on, pending over stored.
Reader::Impl::Entries Reader::Impl::entries_from(Database database, const std::string& from,
                                                 std::size_t stride) const {
  assert(view && "the batch is over");
  Entries entries;
  view->scan(database, from, [&](std::string_view key, std::string_view record) {
    entries.records.emplace(key, record);
    entries.is_last = entries.records.size() < stride;
    entries.next = std::string(key) + '\0';  // the least key above
    return entries.is_last;
  });
  const PendingRecords& records = pending_in(database);
  const auto end = entries.is_last ? records.end() : records.lower_bound(entries.next);
  for (auto written = records.lower_bound(from); written != end; ++written) {
    if (written->second) {
      entries.records.insert_or_assign(written->first, *written->second);
    } else {
      entries.records.erase(written->first);
    }
  }
  return entries;
}

Reader::Reader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Reader::Reader(Reader&&) noexcept = default;
Reader::~Reader() = default;

std::optional<RunRecord> Reader::run() const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kRunKey));
  if (!bytes) return std::nullopt;
  return decode_in<RunRecord>(impl_->environment->directory(), Database::kMeta, *bytes,
                              MortonKey());
}

std::optional<MemoryRecord> Reader::memory() const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kMemoryKey));
  if (!bytes) return std::nullopt;
  return decode_in<MemoryRecord>(impl_->environment->directory(), Database::kMeta, *bytes,
                                 MortonKey());
}

std::optional<RankRecord> Reader::rank() const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kRankKey));
  if (!bytes) return std::nullopt;
  return decode_in<RankRecord>(impl_->environment->directory(), Database::kMeta, *bytes,
                               MortonKey());
}

RankWords Reader::words() const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kWordsKey));
  if (!bytes) return {};
  return decode_in<RankWords>(impl_->environment->directory(), Database::kMeta, *bytes,
                              MortonKey());
}

SurfaceSheets Reader::sheets() const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kSheetsKey));
  if (!bytes) return {};
  return decode_in<SurfaceSheets>(impl_->environment->directory(), Database::kMeta, *bytes,
                                  MortonKey());
}

std::vector<MortonKey> Reader::result_keys() const {
  std::vector<MortonKey> keys;
  const auto take = [&](const std::string& key, const std::string&) {
    if (!key.starts_with(kResultKey)) return false;
    keys.push_back(
        leaf_of_key(impl_->environment->directory(), Database::kMeta, key, kResultKey.size()));
    return true;
  };
  impl_->for_each(Database::kMeta, take, std::string(kResultKey), 1);
  return keys;
}

std::optional<RankResult> Reader::result(MortonKey key) const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kResultKey) + leaf_key(key));
  if (!bytes) return std::nullopt;
  return decode_in<RankResult>(impl_->environment->directory(), Database::kMeta, *bytes, key);
}

TimelineRecord Reader::timeline() const {
  const auto bytes = impl_->find(Database::kMeta, std::string(kTimelineKey));
  if (!bytes) return {};
  return decode_in<TimelineRecord>(impl_->environment->directory(), Database::kMeta, *bytes,
                                   MortonKey());
}

std::optional<LeafInfo> Reader::leaf(MortonKey key) const {
  const auto bytes = impl_->find(Database::kLeaves, leaf_key(key));
  if (!bytes) return std::nullopt;
  return decode_in<LeafInfo>(impl_->environment->directory(), Database::kLeaves, *bytes, key);
}

LeafPoints Reader::points(MortonKey key) const {
  return impl_->list<LeafPoints>(Database::kPoints, key);
}

LeafCells Reader::cells(MortonKey key) const {
  return impl_->list<LeafCells>(Database::kCells, key);
}

LeafFacets Reader::facets(MortonKey key) const {
  return impl_->list<LeafFacets>(Database::kFacets, key);
}

LeafSurface Reader::surface(MortonKey key) const {
  return impl_->list<LeafSurface>(Database::kSurface, key);
}

LeafUnresolved Reader::unresolved(MortonKey key) const {
  return impl_->list<LeafUnresolved>(Database::kUnresolved, key);
}

LeafSizes Reader::sizes(MortonKey key) const {
  return impl_->list<LeafSizes>(Database::kSizes, key);
}

std::vector<MortonKey> Reader::leaf_keys() const {
  std::vector<MortonKey> keys;
  impl_->for_each(Database::kLeaves, [&](const std::string& key, const std::string&) {
    keys.push_back(leaf_of_key(impl_->environment->directory(), Database::kLeaves, key, 0));
    return true;
  });
  return keys;
}

std::vector<MortonKey> Reader::leaf_keys(MortonKey from, std::size_t max) const {
  std::vector<MortonKey> keys;
  const auto take = [&](const std::string& key, const std::string&) {
    keys.push_back(leaf_of_key(impl_->environment->directory(), Database::kLeaves, key, 0));
    return keys.size() < max;
  };
  if (max > 0)
    impl_->for_each(Database::kLeaves, take, leaf_key(from), std::min(max, Impl::kStride));
  return keys;
}

void Reader::for_each_leaf(const std::function<bool(MortonKey, const LeafInfo&)>& visit) const {
  impl_->for_each(Database::kLeaves, [&](const std::string& key, const std::string& record) {
    const MortonKey leaf = leaf_of_key(impl_->environment->directory(), Database::kLeaves, key, 0);
    return visit(leaf, decode_in<LeafInfo>(impl_->environment->directory(), Database::kLeaves,
                                           record, leaf));
  });
}

namespace {

QueueEntry decode_queue_entry(const Path& store, const std::string& key,
                              const std::string& record) {
  const MortonKey leaf = leaf_of_key(store, Database::kQueue, key, 2 * sizeof(std::uint32_t));
  const auto entry = decode_in<QueueEntry>(store, Database::kQueue, record, leaf);
  if (queue_key(entry) != key)
    report_damage(store, Database::kQueue, leaf, "a record of another place in the queue");
  return entry;
}

}  // namespace

void Reader::for_each_queued(const std::function<bool(const QueueEntry&)>& visit) const {
  impl_->for_each(Database::kQueue, [&](const std::string& key, const std::string& record) {
    return visit(decode_queue_entry(impl_->environment->directory(), key, record));
  });
}

std::vector<QueueEntry> Reader::queue_keys(const QueueEntry& from, std::size_t max) const {
  std::vector<QueueEntry> entries;
  const auto take = [&](const std::string& key, const std::string&) {
    const MortonKey leaf = leaf_of_key(impl_->environment->directory(), Database::kQueue, key,
                                       2 * sizeof(std::uint32_t));
    entries.push_back(
        {{big_endian_at<std::uint32_t>(key, 0), big_endian_at<std::uint32_t>(key, 4)}, leaf});
    return entries.size() < max;
  };
  if (max > 0) impl_->for_each(Database::kQueue, take, queue_key(from));
  return entries;
}

bool Reader::has_queue_entry(const QueueEntry& entry) const {
  const std::string key = queue_key(entry);
  const auto bytes = impl_->find(Database::kQueue, key);
  if (bytes) decode_queue_entry(impl_->environment->directory(), key, *bytes);
  return bytes.has_value();
}

// -- Snapshot and Batch ---------------------------------------------------------------------------

Snapshot::Snapshot(std::unique_ptr<Impl> impl) : Reader(std::move(impl)) {}
Snapshot::Snapshot(Snapshot&&) noexcept = default;
Snapshot::~Snapshot() = default;

Batch::Batch(std::unique_ptr<Impl> impl) : Reader(std::move(impl)) {}
Batch::Batch(Batch&&) noexcept = default;
Batch::~Batch() = default;

void Batch::put_run(const RunRecord& run) {
  impl_->put(Database::kMeta, std::string(kRunKey), encode(run, MortonKey()));
}

void Batch::put_memory(const MemoryRecord& memory) {
  impl_->put(Database::kMeta, std::string(kMemoryKey), encode(memory, MortonKey()));
}

void Batch::put_rank(const RankRecord& rank) {
  impl_->put(Database::kMeta, std::string(kRankKey), encode(rank, MortonKey()));
}

void Batch::put_sheets(const SurfaceSheets& sheets) {
  impl_->put(Database::kMeta, std::string(kSheetsKey), encode(sheets, MortonKey()));
}

void Batch::put_words(const RankWords& words) {
  impl_->put(Database::kMeta, std::string(kWordsKey), encode(words, MortonKey()));
}

void Batch::put_result(MortonKey key, const RankResult& result) {
  impl_->put(Database::kMeta, std::string(kResultKey) + leaf_key(key), encode(result, key));
}

void Batch::erase_result(MortonKey key) {
  impl_->put(Database::kMeta, std::string(kResultKey) + leaf_key(key), std::nullopt);
}

void Batch::put_timeline(const TimelineRecord& timeline) {
  impl_->put(Database::kMeta, std::string(kTimelineKey), encode(timeline, MortonKey()));
}

void Batch::put_leaf(MortonKey key, const LeafInfo& info) {
  assert(key.is_valid());
  impl_->put(Database::kLeaves, leaf_key(key), encode(info, key));
}

void Batch::put_points(MortonKey key, const LeafPoints& points) {
  impl_->put_list(Database::kPoints, key, points);
}

void Batch::put_cells(MortonKey key, const LeafCells& cells) {
  assert(!cells.cells.empty() || cells.vertices.empty());
  impl_->put_list(Database::kCells, key, cells);
}

void Batch::put_facets(MortonKey key, const LeafFacets& facets) {
  impl_->put_list(Database::kFacets, key, facets);
}

void Batch::put_surface(MortonKey key, const LeafSurface& surface) {
  impl_->put_list(Database::kSurface, key, surface);
}

void Batch::put_unresolved(MortonKey key, const LeafUnresolved& unresolved) {
  impl_->put_list(Database::kUnresolved, key, unresolved);
}

void Batch::put_sizes(MortonKey key, const LeafSizes& sizes) {
  impl_->put_list(Database::kSizes, key, sizes);
}

void Batch::erase_leaf(MortonKey key) {
  impl_->put(Database::kLeaves, leaf_key(key), std::nullopt);
  for (const Database database : kBlobs) impl_->put(database, leaf_key(key), std::nullopt);
}

void Batch::put_queue_entry(const QueueEntry& entry) {
  assert(entry.leaf.is_valid());
  impl_->put(Database::kQueue, queue_key(entry), encode(entry, entry.leaf));
}

void Batch::erase_queue_entry(const QueueEntry& entry) {
  impl_->put(Database::kQueue, queue_key(entry), std::nullopt);
}

std::uint64_t Batch::bytes_written() const { return impl_->bytes_written; }
std::uint64_t Batch::memory_bytes() const { return impl_->memory_bytes; }
std::uint64_t Batch::commit_bytes() const { return impl_->commit_bytes; }

void Batch::commit() {
  assert(impl_->view && "the batch is over");
  impl_->view.reset();  // or the pages that the last commit freed could not be used
  impl_->environment->write([this](Environment::Transaction& transaction) {
    for (std::size_t i = 0; i < kNumDatabases; ++i)
      write_pending(transaction, static_cast<Database>(i), impl_->pending[i]);
  });
  impl_->turn.reset();
}

// -- Store ----------------------------------------------------------------------------------------

struct Store::Impl {
  std::shared_ptr<Environment> environment;
  bool is_read_only = false;
  std::shared_ptr<Environment::View> moment;  // null: the store as it is at each time
};

Store::Store(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Store::Store(Store&&) noexcept = default;
Store& Store::operator=(Store&&) noexcept = default;
Store::~Store() = default;

Store Store::open(const std::filesystem::path& directory, const StoreOptions& options) {
  std::error_code unknown;
  if (!std::filesystem::exists(directory, unknown)) {
    if (!options.create || options.read_only)
      throw StoreError("store " + directory.string() + ": there is no such directory");
    make_directory(directory);
  }
  return Store(std::make_unique<Impl>(
      Impl{Environment::open(directory, options), options.read_only, nullptr}));
}

bool Store::exists(const std::filesystem::path& directory) {
  return Environment::exists(directory);
}

bool Store::owns(const std::filesystem::path& directory) {
  constexpr std::array kNames = {"data.mdb", "lock.mdb", "writer.lock"};
  std::error_code unknown;
  for (const auto& entry : std::filesystem::directory_iterator(directory, unknown))
    if (std::ranges::find(kNames, entry.path().filename()) == kNames.end()) return false;
  return !unknown;
}

Snapshot Store::snapshot() const {
  auto impl = std::make_unique<Snapshot::Impl>();
  impl->environment = impl_->environment;
  impl->view = impl_->moment;
  if (!impl->view) impl->view = std::make_shared<Environment::View>(impl_->environment->view());
  return Snapshot(std::move(impl));
}

Store Store::frozen() const {
  auto moment = impl_->moment;
  if (!moment) moment = std::make_shared<Environment::View>(impl_->environment->view());
  return Store(std::make_unique<Impl>(Impl{impl_->environment, true, std::move(moment)}));
}

std::optional<std::string> Store::writer() const { return WriterLock::holder(directory()); }

Batch Store::begin() {
  if (impl_->is_read_only)
    throw StoreError("store " + directory().string() + ": is open for reading only");
  auto impl = std::make_unique<Batch::Impl>();
  impl->environment = impl_->environment;
  impl->turn = impl_->environment->wait_for_write_turn();
  impl->view = std::make_shared<Environment::View>(impl_->environment->view());
  return Batch(std::move(impl));
}

std::vector<DatabaseSize> Store::sizes() const { return impl_->environment->sizes(); }
std::uint64_t Store::mapped_bytes() const { return impl_->environment->mapped_bytes(); }
void Store::release_pages() const { impl_->environment->release_pages(); }
const std::filesystem::path& Store::directory() const { return impl_->environment->directory(); }

}  // namespace locvol
