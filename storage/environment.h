// Environment is one LMDB environment: named databases of byte strings in key order, and what a
// careful user of LMDB takes care of. environment.cpp is the only home of LMDB.
//
// Map growth: LMDB may move its memory map when no call is under way. So every read is one call
//     that copies what it finds while it holds the gate shared, and growing holds it alone;
//     between two calls a read transaction has no pointer into the map. A View keeps its state
//     across growth.
// Threads: all members may be called from many threads; a View by one at a time; write() by the
//     holder of the write turn.
// Processes: not across fork().
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <semaphore>
#include <shared_mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "storage/file_system.h"
#include "storage/mapped_pages.h"
#include "storage/page_check.h"
#include "storage/store_options.h"

struct MDB_cursor;
struct MDB_env;
struct MDB_txn;
struct MDB_val;

namespace locvol {

enum class Database : std::uint8_t {
  kMeta,
  kLeaves,
  kPoints,
  kCells,
  kSurface,
  kQueue,
  kUnresolved,
  kSizes,
  kFacets
};
inline constexpr std::size_t kNumDatabases = 9;
const char* name_of(Database database);

struct CloseEnvironment {
  void operator()(MDB_env* environment) const;
};
struct AbortTransaction {
  void operator()(MDB_txn* transaction) const;
};
using EnvironmentHandle = std::unique_ptr<MDB_env, CloseEnvironment>;
using TransactionHandle = std::unique_ptr<MDB_txn, AbortTransaction>;

class Environment {
 public:
  class View;
  class Transaction;
  struct GiveBackTurn {
    void operator()(Environment* environment) const { environment->write_turn_.release(); }
  };
  // Held by who may write, one at a time; may be given back by any thread.
  using WriteTurn = std::unique_ptr<Environment, GiveBackTurn>;

  static bool exists(const std::filesystem::path& directory);  // as Store::exists()
  // Opens the one environment that a directory has in a process: a second read-only open shares the
  // first one's. Throws StoreError as Store::open() does.
  static std::shared_ptr<Environment> open(const std::filesystem::path& directory,
                                           const StoreOptions& options);
  ~Environment();
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;

  const std::filesystem::path& directory() const { return directory_; }
  View view();                      // of the last commit
  WriteTurn wait_for_write_turn();  // REQUIRES: opened for writing
  // Runs `write` in a transaction and commits it, durably. When the map is full it grows the map
  // and starts again, so `write` must do the same each time. REQUIRES: the caller has the turn
  void write(const std::function<void(Transaction&)>& write);
  std::vector<DatabaseSize> sizes();
  void release_pages() { pages_.release(); }                     // as Store::release_pages()
  std::uint64_t mapped_bytes() const { return pages_.bytes(); }  // as Store::mapped_bytes()

 private:
  using Id = std::pair<std::uint64_t, std::uint64_t>;  // device and inode of the directory
  struct Registry;
  struct MapFull {};
  using Gate = std::shared_lock<std::shared_mutex>;

  Environment(const std::filesystem::path& directory, Id id, const StoreOptions& options);
  static Registry& registry();
  static Id id_of(const std::filesystem::path& directory);
  std::string place() const { return "store " + directory_.string() + ": "; }
  // Throws StoreError unless the code is MDB_SUCCESS; MapFull, for write() to catch.
  void check(int code, const char* what) const;
  std::string advice(int code) const;

  void open_map(const StoreOptions& options);
  void clear_dead_readers();
  int try_map(const StoreOptions& options, std::uint64_t map_bytes);
  void find_databases(int data_file);
  void open_databases(MDB_txn* transaction, const KeySumByName& found);
  void check_key_sums(MDB_txn* transaction, const KeySumByName& found);
  void create_databases();
  template <class Record>
  Record meta_record(MDB_txn* transaction, std::string_view name) const;

  Gate enter();
  TransactionHandle begin_read();
  TransactionHandle idle_transaction();  // or null
  void make_room_for_idle();
  void retire(TransactionHandle transaction);
  bool is_written(const std::function<void(Transaction&)>& write);  // false: the map is full
  void resize_map(std::uint64_t map_bytes);  // 0: to what another process made it
  std::uint64_t map_bytes() const;
  void locate_map(MDB_txn* transaction);
  void check_before_freeing(const MDB_val& value) const;

  const std::filesystem::path directory_;
  const Id id_;
  std::optional<WriterLock> lock_;
  EnvironmentHandle handle_;
  std::array<unsigned, kNumDatabases> databases_{};
  std::uint32_t page_bytes_ = 0;
  using KeySumOf = std::array<std::uint64_t, kNumDatabases>;
  KeySumOf key_sums_{};  // as of the last commit, for who has the write turn

  std::mutex turnstile_;  // before the gate, so that readers that keep coming let growth in
  std::shared_mutex gate_;
  bool is_mapped_ = false;  // guarded by the gate; false after a growth that failed for good
  MappedPages pages_;
  std::mutex idle_mutex_;
  std::vector<TransactionHandle> idle_;  // read transactions, reset, to be renewed
  std::size_t num_transactions_ = 0;     // idle and in use
  std::binary_semaphore write_turn_{1};
};

// A read transaction: the environment as one commit left it. The environment must outlive it.
class Environment::View {
 public:
  View(View&&) noexcept = default;
  ~View();

  std::optional<std::string> get(Database database, std::string_view key) const;
  // Entries from `from` on, in key order, until `visit` returns false; it must copy what it keeps,
  // and must not use the environment.
  using Visit = std::function<bool(std::string_view key, std::string_view value)>;
  void scan(Database database, std::string_view from, const Visit& visit) const;

 private:
  friend class Environment;
  View(Environment& environment, TransactionHandle transaction)
      : environment_(environment), transaction_(std::move(transaction)) {}

  Environment& environment_;
  TransactionHandle transaction_;
};

// A write transaction, for the time of one call of write().
class Environment::Transaction {
 public:
  void put(Database database, std::string_view key, std::string_view value);
  void erase(Database database, std::string_view first, std::string_view last);  // both included

 private:
  friend class Environment;
  struct Cursors;
  Transaction(Environment& environment, MDB_txn* transaction);
  ~Transaction();
  MDB_cursor* cursor(Database database);
  bool find(Database database, MDB_val& key, MDB_val& value, bool or_next);
  void add_to_sum(Database database, std::uint64_t term);
  void finish();  // after the last put() and erase()

  Environment& environment_;
  MDB_txn* transaction_;
  KeySumOf key_sums_;  // as of now
  std::unique_ptr<Cursors> cursors_;
};

}  // namespace locvol
