#include "storage/environment.h"

#include <fcntl.h>
#include <lmdb.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <map>
#include <system_error>

#include "storage/codec.h"
#include "storage/store_error.h"

namespace locvol {
namespace {

constexpr const char* kDataName = "data.mdb";
constexpr std::string_view kFormatKey = "format";
constexpr std::string_view kKeySumsKey = "keys";
constexpr std::uint64_t kMinMapBytes = std::uint64_t{1} << 16;
constexpr unsigned kMaxReaders = 1000;  // snapshots at once, over all processes
constexpr mdb_mode_t kFileMode = 0644;

constexpr std::array<const char*, kNumDatabases> kNames = {
    "meta", "leaves", "points", "cells", "surface", "queue", "unresolved", "sizes", "facets"};

struct CloseCursor {
  void operator()(MDB_cursor* cursor) const { mdb_cursor_close(cursor); }
};
using CursorHandle = std::unique_ptr<MDB_cursor, CloseCursor>;

MDB_val to_value(std::string_view bytes) {
  return {bytes.size(), const_cast<char*>(bytes.data())};  // LMDB does not write to it
}

std::string_view to_view(const MDB_val& value) {
  return {static_cast<const char*>(value.mv_data), value.mv_size};
}

// Whole pages of the system, at least a few, as LMDB wants it.
std::uint64_t rounded_map_bytes(std::uint64_t bytes) {
  const auto page = static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  return (std::max(bytes, kMinMapBytes) + page - 1) / page * page;
}

}  // namespace

const char* name_of(Database database) { return kNames[static_cast<std::size_t>(database)]; }

void CloseEnvironment::operator()(MDB_env* environment) const { mdb_env_close(environment); }
void AbortTransaction::operator()(MDB_txn* transaction) const { mdb_txn_abort(transaction); }

// -- One environment per directory and process ----------------------------------------------------

struct Environment::Registry {
  std::mutex mutex;
  std::condition_variable has_closed;
  std::map<Id, std::weak_ptr<Environment>> open;  // an expired one is about to close
};

Environment::Registry& Environment::registry() {
  static Registry registry;
  return registry;
}

Environment::Id Environment::id_of(const std::filesystem::path& directory) {
  struct stat status;
  if (stat(directory.c_str(), &status) != 0)
    throw StoreError("store " + directory.string() +
                     ": cannot be opened: " + std::generic_category().message(errno) +
                     "; check the path and its permissions");
  return {status.st_dev, status.st_ino};
}

bool Environment::exists(const std::filesystem::path& directory) {
  const FileDescriptor data(::open((directory / kDataName).c_str(), O_RDONLY | O_CLOEXEC));
  const auto fail = [&](const std::error_code& error) {
    throw StoreError("store " + directory.string() + ": cannot read " + kDataName + ": " +
                     error.message() + "; mend that, and give the same command again");
  };
  try {
    if (data.is_open()) return has_content(data.number());
  } catch (const std::system_error& error) {
    fail(error.code());
  }
  if (errno != ENOENT && errno != ENOTDIR) fail({errno, std::generic_category()});
  return false;
}

std::shared_ptr<Environment> Environment::open(const std::filesystem::path& directory,
                                               const StoreOptions& options) {
  const Id id = id_of(directory);
  std::shared_ptr<Environment> shared;  // outlives the lock: it may be the last one to let go
  Registry& all = registry();
  std::unique_lock lock(all.mutex);
  for (auto found = all.open.find(id); found != all.open.end(); found = all.open.find(id)) {
    shared = found->second.lock();
    if (!shared) {
      all.has_closed.wait(lock);
    } else if (options.read_only) {
      return shared;
    } else {
      throw StoreError("store " + directory.string() + " is already open in this process");
    }
  }
  // make_shared() takes its memory before it constructs: were there none, ~Environment() would run
  // under the lock that it takes.
  struct Opened : Environment {
    Opened(const std::filesystem::path& d, Id i, const StoreOptions& o) : Environment(d, i, o) {}
  };
  shared = std::make_shared<Opened>(directory, id, options);
  all.open.emplace(id, shared);
  return shared;
}

Environment::Environment(const std::filesystem::path& directory, Id id, const StoreOptions& options)
    : directory_(directory), id_(id), pages_(options.memory_bytes) {
  if (const auto network = network_file_system(directory))
    throw StoreError(place() + "is on a network file system (" + *network +
                     "), where a memory-mapped database is not safe; use a local disk");
  const bool may_create = options.create && !options.read_only;
  if (!exists(directory) && !may_create) throw StoreError(place() + "there is no store here");
  if (!options.read_only) lock_ = WriterLock::acquire(directory);
  const bool has_data = exists(directory);
  // What a creation leaves that was cut short may end within the meta pages.
  if (!has_data) std::filesystem::remove(directory / kDataName);
  const FileDescriptor data(::open((directory / kDataName).c_str(), O_RDONLY | O_CLOEXEC));
  if (has_data && !data.is_open()) check(errno, "open data.mdb");
  try {
    if (has_data) check_meta_pages(data.number());
    open_map(options);
    if (has_data) {
      find_databases(data.number());
    } else {
      create_databases();
      sync_directory(directory_);
    }
  } catch (const std::system_error& error) {
    throw StoreError(place() + kDataName + ' ' + error.what() + advice(error.code().value()));
  } catch (const DamagedFile& damage) {
    throw StoreError(place() + kDataName + " is damaged, or no database: " + damage.what() +
                     kDamageCure);
  }
}

Environment::~Environment() {
  idle_.clear();
  handle_.reset();
  lock_.reset();
  Registry& all = registry();
  {
    const std::lock_guard lock(all.mutex);
    all.open.erase(id_);
  }
  all.has_closed.notify_all();
}

void Environment::check(int code, const char* what) const {
  if (code == MDB_SUCCESS) return;
  if (code == MDB_MAP_FULL) throw MapFull();
  throw StoreError(place() + "cannot " + what + ": " + mdb_strerror(code) + advice(code));
}

// What may be the matter, and what can be done. A disk or a quota that ends within a write gives
// LMDB a short write, which it reports as EIO.
std::string Environment::advice(int code) const {
  constexpr const char* kAgain = " and give the same command again: what was committed is kept";
  if (code == ENOMEM || code == EAGAIN) return std::string("; free some memory") + kAgain;
  if (code == EMFILE || code == ENFILE) return std::string("; close other files") + kAgain;
  if (code == EACCES || code == EROFS || code == EPERM)
    return std::string("; get the right to write to it") + kAgain;
  if (code != EIO && code != ENOSPC && code != EDQUOT) return {};
  std::error_code unknown;
  const auto space = std::filesystem::space(directory_, unknown);
  const std::string free =
      unknown ? "" : " (" + std::to_string(space.available >> 20) + " MB are free)";
  return (code == EIO ? ", or no space left" : "") + free + "; make room, or check the disk," +
         kAgain;
}

// -- Opening --------------------------------------------------------------------------------------

void Environment::open_map(const StoreOptions& options) {
  std::uint64_t bytes = rounded_map_bytes(options.map_bytes);
  int code = try_map(options, bytes);
  // A map takes address space, not memory, yet that may be limited too.
  for (; code == ENOMEM && bytes > kMinMapBytes; code = try_map(options, bytes))
    bytes = rounded_map_bytes(bytes / 2);
  check(code, "open the database");
  is_mapped_ = true;
  MDB_stat stat;
  check(mdb_env_stat(handle_.get(), &stat), "find out the size of a page");
  page_bytes_ = stat.ms_psize;
  clear_dead_readers();
}

// Else the pages that they read could never be used again.
void Environment::clear_dead_readers() {
  int num_dead = 0;
  check(mdb_reader_check(handle_.get(), &num_dead), "clear readers of dead processes");
}

int Environment::try_map(const StoreOptions& options, std::uint64_t map_bytes) {
  MDB_env* environment = nullptr;
  check(mdb_env_create(&environment), "make a database handle");
  handle_.reset(environment);
  check(mdb_env_set_mapsize(environment, map_bytes), "set the size of the map");
  check(mdb_env_set_maxdbs(environment, kNumDatabases), "set the number of databases");
  check(mdb_env_set_maxreaders(environment, kMaxReaders), "set the number of readers");
  // No read-ahead: leaves are read in no order of the file, and what is mapped counts in the cap.
  const unsigned flags = MDB_NOTLS | MDB_NORDAHEAD | (options.read_only ? MDB_RDONLY : 0u) |
                         (options.is_durable ? 0u : MDB_NOSYNC);
  return mdb_env_open(environment, directory_.c_str(), flags, kFileMode);
}

void Environment::find_databases(int data_file) {
  for (;;) {  // again when a live writer has committed twice in between
    TransactionHandle transaction = begin_read();
    if (const auto found = check_pages(data_file, mdb_txn_id(transaction.get()))) {
      open_databases(transaction.get(), *found);
      return check(mdb_txn_commit(transaction.release()), "keep the databases open");
    }
    retire(std::move(transaction));
  }
}

void Environment::open_databases(MDB_txn* transaction, const KeySumByName& found) {
  for (std::size_t i = 0; i < kNumDatabases; ++i) {
    if (!found.contains(kNames[i])) {
      if (i == 0) throw StoreError(place() + "is a database, but not a locvol store");
      throw DamagedFile(std::string("there is no database `") + kNames[i] + "`");
    }
    check(mdb_dbi_open(transaction, kNames[i], 0, &databases_[i]), "open a named database");
    if (i > 0) continue;
    // The format comes first: another one may have other databases.
    const auto format = meta_record<StoreFormat>(transaction, kFormatKey);
    if (format.version != StoreFormat::kCurrent)
      throw StoreError(place() + "has format " + std::to_string(format.version) +
                       ", written by another locvol; this one reads format " +
                       std::to_string(StoreFormat::kCurrent) +
                       "; go on with that one, or remove the store and begin anew");
  }
  check_key_sums(transaction, found);
}

void Environment::check_key_sums(MDB_txn* transaction, const KeySumByName& found) {
  const auto stored = meta_record<KeySums>(transaction, kKeySumsKey);
  if (stored.sums.size() != kNumDatabases) throw DamagedFile("sums of keys of other databases");
  for (std::size_t i = 0; i < kNumDatabases; ++i) {
    const std::uint64_t own = i == 0 ? key_hash(kKeySumsKey) : 0;
    if (found.at(kNames[i]) - own != stored.sums[i])
      throw DamagedFile(std::string("a key in database `") + kNames[i] + "` is not what it was");
    key_sums_[i] = stored.sums[i];
  }
}

template <class Record>
Record Environment::meta_record(MDB_txn* transaction, std::string_view name) const {
  MDB_val key = to_value(name), value;
  const int code = mdb_get(transaction, databases_[0], &key, &value);
  if (code == MDB_NOTFOUND) throw DamagedFile("the record `" + std::string(name) + "` is missing");
  check(code, "read");
  try {
    return decode<Record>(to_view(value), MortonKey());
  } catch (const DecodeError& error) {
    throw CorruptRecord(place() + "the record `" + std::string(name) +
                            "` is damaged: " + error.what() + kDamageCure,
                        MortonKey());
  }
}

void Environment::create_databases() {
  write([this](Transaction& transaction) {
    for (std::size_t i = 0; i < kNumDatabases; ++i)
      check(mdb_dbi_open(transaction.transaction_, kNames[i], MDB_CREATE, &databases_[i]),
            "make a named database");
    transaction.put(Database::kMeta, kFormatKey, encode(StoreFormat(), MortonKey()));
  });
}

// -- Transactions and the map ---------------------------------------------------------------------

Environment::Gate Environment::enter() {
  const std::lock_guard turnstile(turnstile_);
  Gate gate(gate_);
  if (!is_mapped_) throw StoreError(place() + "is closed: its map could not be grown");
  return gate;
}

TransactionHandle Environment::begin_read() {
  for (;; resize_map(0)) {
    const Gate gate = enter();
    TransactionHandle transaction = idle_transaction();
    MDB_txn* begun = transaction.get();
    const int code =
        begun ? mdb_txn_renew(begun) : mdb_txn_begin(handle_.get(), nullptr, MDB_RDONLY, &begun);
    if (code == MDB_MAP_RESIZED) continue;
    check(code, "begin to read");
    if (!transaction) {
      transaction.reset(begun);
      make_room_for_idle();
    }
    return transaction;
  }
}

TransactionHandle Environment::idle_transaction() {
  const std::lock_guard lock(idle_mutex_);
  if (idle_.empty()) return nullptr;
  TransactionHandle transaction = std::move(idle_.back());
  idle_.pop_back();
  return transaction;
}

// So that retire(), which destructors call, allocates nothing.
void Environment::make_room_for_idle() {
  const std::lock_guard lock(idle_mutex_);
  idle_.reserve(++num_transactions_);
}

void Environment::retire(TransactionHandle transaction) {
  mdb_txn_reset(transaction.get());
  const std::lock_guard lock(idle_mutex_);
  idle_.push_back(std::move(transaction));
}

Environment::View Environment::view() {
  View view(*this, begin_read());
  const Gate gate = enter();
  if (!pages_.is_located()) locate_map(view.transaction_.get());
  return view;
}

Environment::WriteTurn Environment::wait_for_write_turn() {
  write_turn_.acquire();
  return WriteTurn(this);
}

void Environment::write(const std::function<void(Transaction&)>& write) {
  while (!is_written(write)) resize_map(2 * map_bytes());
}

bool Environment::is_written(const std::function<void(Transaction&)>& write) try {
  const Gate gate = enter();
  clear_dead_readers();
  MDB_txn* begun = nullptr;
  check(mdb_txn_begin(handle_.get(), nullptr, 0, &begun), "begin to write");
  TransactionHandle handle(begun);
  if (!pages_.is_located()) locate_map(begun);
  KeySumOf key_sums{};
  {
    Transaction transaction(*this, handle.get());  // its cursors must go before LMDB's own
    write(transaction);
    transaction.finish();
    key_sums = transaction.key_sums_;
  }
  check(mdb_txn_commit(handle.release()), "commit");  // LMDB frees it either way
  key_sums_ = key_sums;
  return true;
} catch (const MapFull&) {
  return false;
}

std::uint64_t Environment::map_bytes() const {
  MDB_envinfo info;
  check(mdb_env_info(handle_.get(), &info), "find out the size of the map");
  return info.me_mapsize;
}

// LMDB unmaps before it maps. When the larger map does not fit, the old one is put back; if not
// even that works, nothing may touch the environment any more.
void Environment::resize_map(std::uint64_t bytes) {
  const std::lock_guard turnstile(turnstile_);
  const std::unique_lock gate(gate_);
  const std::uint64_t old_bytes = map_bytes();
  pages_.forget();
  const int code = mdb_env_set_mapsize(handle_.get(), bytes);
  if (code != MDB_SUCCESS)
    is_mapped_ = mdb_env_set_mapsize(handle_.get(), old_bytes) == MDB_SUCCESS;
  check(code, "grow the map");
}

std::vector<DatabaseSize> Environment::sizes() {
  const View now = view();
  const Gate gate = enter();
  std::vector<DatabaseSize> sizes;
  for (std::size_t i = 0; i < kNumDatabases; ++i) {
    MDB_stat stat;
    check(mdb_stat(now.transaction_.get(), databases_[i], &stat), "count records");
    const std::uint64_t num_pages =
        stat.ms_branch_pages + stat.ms_leaf_pages + stat.ms_overflow_pages;
    sizes.push_back({kNames[i], num_pages * stat.ms_psize, stat.ms_entries});
  }
  return sizes;
}

// LMDB does not tell where its map is. But the format record lies in a page, in the map, which
// begins with its number. REQUIRES: the transaction has not written yet, for that takes pages out
// of the map
void Environment::locate_map(MDB_txn* transaction) {
  MDB_val key = to_value(kFormatKey), value;
  const bool is_created = databases_[0] != 0;
  if (!is_created || mdb_get(transaction, databases_[0], &key, &value) != MDB_SUCCESS) return;
  const auto address = reinterpret_cast<std::uintptr_t>(value.mv_data);
  const std::uintptr_t page = address - address % page_bytes_;
  const std::uint64_t page_number = *reinterpret_cast<const std::uint64_t*>(page);
  pages_.locate(reinterpret_cast<const void*>(page - page_number * page_bytes_), map_bytes());
}

void Environment::check_before_freeing(const MDB_val& value) const {
  const auto offset = pages_.offset_of(value.mv_data);
  if (!offset) return;  // written in this transaction
  try {
    check_overflow_header(static_cast<const char*>(value.mv_data), value.mv_size, *offset,
                          page_bytes_);
  } catch (const DamagedFile& damage) {
    throw StoreError(place() + kDataName + " is damaged: " + damage.what() + kDamageCure);
  }
}

// -- View -----------------------------------------------------------------------------------------

Environment::View::~View() {
  if (transaction_) environment_.retire(std::move(transaction_));
}

std::optional<std::string> Environment::View::get(Database database, std::string_view key) const {
  const Gate gate = environment_.enter();
  MDB_val wanted = to_value(key), value;
  const unsigned handle = environment_.databases_[static_cast<std::size_t>(database)];
  const int code = mdb_get(transaction_.get(), handle, &wanted, &value);
  if (code == MDB_NOTFOUND) return std::nullopt;
  environment_.check(code, "read");
  environment_.pages_.note(value.mv_data, value.mv_size);
  return std::string(to_view(value));
}

void Environment::View::scan(Database database, std::string_view from, const Visit& visit) const {
  const Gate gate = environment_.enter();
  MDB_cursor* opened = nullptr;
  const unsigned handle = environment_.databases_[static_cast<std::size_t>(database)];
  environment_.check(mdb_cursor_open(transaction_.get(), handle, &opened), "read");
  const CursorHandle cursor(opened);
  MDB_val key = to_value(from), value;
  int code = mdb_cursor_get(opened, &key, &value, from.empty() ? MDB_FIRST : MDB_SET_RANGE);
  for (; code == MDB_SUCCESS; code = mdb_cursor_get(opened, &key, &value, MDB_NEXT)) {
    environment_.pages_.note(key.mv_data, key.mv_size);
    environment_.pages_.note(value.mv_data, value.mv_size);
    if (!visit(to_view(key), to_view(value))) return;
  }
  if (code != MDB_NOTFOUND) environment_.check(code, "read");
}

// -- Transaction ----------------------------------------------------------------------------------

struct Environment::Transaction::Cursors {
  std::array<CursorHandle, kNumDatabases> of;
};

Environment::Transaction::Transaction(Environment& environment, MDB_txn* transaction)
    : environment_(environment),
      transaction_(transaction),
      key_sums_(environment.key_sums_),
      cursors_(std::make_unique<Cursors>()) {}
Environment::Transaction::~Transaction() = default;

MDB_cursor* Environment::Transaction::cursor(Database database) {
  const auto i = static_cast<std::size_t>(database);
  if (!cursors_->of[i]) {
    MDB_cursor* opened = nullptr;
    environment_.check(mdb_cursor_open(transaction_, environment_.databases_[i], &opened), "write");
    cursors_->of[i].reset(opened);
  }
  return cursors_->of[i].get();
}

// What is found is about to be overwritten or freed, for which LMDB reads it through the map, and
// trusts it.
bool Environment::Transaction::find(Database database, MDB_val& key, MDB_val& value, bool or_next) {
  const int code =
      mdb_cursor_get(cursor(database), &key, &value, or_next ? MDB_SET_RANGE : MDB_SET_KEY);
  if (code == MDB_NOTFOUND) return false;
  environment_.check(code, "write");
  environment_.pages_.note(key.mv_data, key.mv_size);
  environment_.pages_.note(value.mv_data, value.mv_size);
  environment_.check_before_freeing(value);
  return true;
}

void Environment::Transaction::add_to_sum(Database database, std::uint64_t term) {
  key_sums_[static_cast<std::size_t>(database)] += term;
}

void Environment::Transaction::finish() {
  const std::string record = encode(KeySums{{key_sums_.begin(), key_sums_.end()}}, MortonKey());
  MDB_val key = to_value(kKeySumsKey), value = to_value(record);
  environment_.check(mdb_cursor_put(cursor(Database::kMeta), &key, &value, 0), "write");
}

void Environment::Transaction::put(Database database, std::string_view key,
                                   std::string_view value) {
  MDB_val old_key = to_value(key), old_value;
  if (!find(database, old_key, old_value, false)) add_to_sum(database, key_hash(key));
  MDB_val stored_key = to_value(key), stored_value = to_value(value);
  environment_.check(mdb_cursor_put(cursor(database), &stored_key, &stored_value, 0), "write");
}

void Environment::Transaction::erase(Database database, std::string_view first,
                                     std::string_view last) {
  for (;;) {
    MDB_val key = to_value(first), value;
    if (!find(database, key, value, true) || to_view(key) > last) return;
    add_to_sum(database, std::uint64_t{0} - key_hash(to_view(key)));
    environment_.check(mdb_cursor_del(cursor(database), 0), "write");
  }
}

}  // namespace locvol
