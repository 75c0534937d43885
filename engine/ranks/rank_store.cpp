#include "engine/ranks/rank_store.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <map>
#include <string>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>

#include "engine/exchange/hosted_ranks.h"
#include "engine/exchange/pack.h"
#include "storage/codec.h"

namespace locvol {

// Of a rank's store.
struct HeldPart {
  std::string directory;
  bool is_there = false;
  bool is_damaged = false;  // then nothing else is known
  std::string run;          // what makes it this run, and no other
  std::uint64_t rank = 0, num_ranks = 0, superstep = 0, num_moves = 0;
  bool is_within_superstep = false;
};
auto fields(Maybe<HeldPart> auto& part) {
  auto& [directory, is_there, is_damaged, run, rank, num_ranks, superstep, num_moves,
         is_within_superstep] = part;
  return std::tuple(Field("directory", directory), Field("is_there", is_there),
                    Field("is_damaged", is_damaged), Field("run", run), Field("rank", rank),
                    Field("num_ranks", num_ranks), Field("superstep", superstep),
                    Field("num_moves", num_moves),
                    Field("is_within_superstep", is_within_superstep));
}

namespace {

std::string host_name() {
  std::array<char, 256> host{};
  ::gethostname(host.data(), host.size() - 1);
  return host.data();
}

// Throws StoreError, the same on all ranks: two on one machine have the same directory.
void require_own_stores(const std::filesystem::path& own, Exchange& exchange) {
  std::error_code unknown;  // then as it is
  std::filesystem::path place = std::filesystem::weakly_canonical(own, unknown);
  if (unknown) place = own;
  const std::vector<std::string> places = exchange.gather(host_name() + ':' + place.string());
  for (std::size_t rank = 1; rank < places.size(); ++rank)
    for (std::size_t other = 0; other < rank; ++other)
      if (places[rank] == places[other])
        throw StoreError("ranks " + std::to_string(other) + " and " + std::to_string(rank) +
                         " would have one store, " + places[rank] +
                         ": each needs its own; %r in its name is the rank's number");
}

std::filesystem::path next_of(const std::filesystem::path& directory) {
  return directory.string() + ".next";
}

std::string identity_of(const RunRecord& run) {
  RunRecord alone;
  alone.parameters = run.parameters;
  alone.frame = run.frame;
  return encode(alone, MortonKey());
}

HeldPart part_in(const Store& store) {
  HeldPart part;
  part.directory = store.directory().string();
  const Snapshot snapshot = store.snapshot();
  const auto run = snapshot.run();
  if (!run || run->phase == Phase::kIngest) return part;
  part.is_there = true;
  part.run = identity_of(*run);
  if (const auto rank = snapshot.rank()) {
    part.rank = rank->rank;
    part.num_ranks = rank->first.size();
    part.superstep = rank->superstep;
    part.num_moves = rank->num_moves;
    part.is_within_superstep = rank->applied.has_value();
  }
  return part;
}

HeldPart part_in(const std::filesystem::path& directory) {
  if (Store::exists(directory)) return part_in(Store::open(directory, {.read_only = true}));
  HeldPart none;
  none.directory = directory.string();
  return none;
}

const HeldPart& newest_of(const std::vector<HeldPart>& parts) {
  return *std::ranges::max_element(parts, {}, [](const HeldPart& part) {
    return std::pair(part.is_there ? part.num_moves + 1 : 0, part.superstep);
  });
}

// After an end while leaves moved to as many ranks: if all have their new store, or its place is
// taken, those that are left take theirs, too. If not, the old ones count.
void settle(const std::filesystem::path& directory, Exchange& exchange) {
  const std::filesystem::path next = next_of(directory);
  const std::vector<HeldPart> held = gather_values(exchange, part_in(directory)),
                              nexts = gather_values(exchange, part_in(next));
  const HeldPart& newest = newest_of(nexts);
  const auto is_newest = [&](const HeldPart& part) {
    return part.is_there && part.num_ranks == held.size() && part.num_moves == newest.num_moves;
  };
  for (std::size_t rank = 0; rank < held.size(); ++rank)
    if (!is_newest(held[rank]) && !is_newest(nexts[rank])) return;
  if (!is_newest(nexts[static_cast<std::size_t>(exchange.rank())])) return;
  std::filesystem::remove_all(directory);
  std::filesystem::rename(next, directory);
}

// Of as many ranks as leaves last moved to, or were to.
void settle_last_move(const std::filesystem::path& stores, Exchange& exchange) {
  const std::filesystem::path own = store_of_rank(stores, exchange.rank());
  const auto num_ranks = static_cast<int>(
      newest_of(gather_all(exchange, std::vector{part_in(own), part_in(next_of(own))})).num_ranks);
  run_hosted_ranks(num_ranks, exchange,
                   [&](Exchange& hosted) { settle(store_of_rank(stores, hosted.rank()), hosted); });
}

std::string name_of(std::size_t rank, const HeldPart& part) {
  return "rank " + std::to_string(rank) + ", store " + part.directory + ": ";
}

// These throw StoreError, the same on all ranks. `parts`: those of the run's ranks, in order, and
// others.
void require_same_run(const std::vector<HeldPart>& parts, std::size_t num_ranks) {
  const auto& first = *std::ranges::find_if(parts, &HeldPart::is_there);
  for (std::size_t rank = 0; rank < parts.size(); ++rank) {
    const HeldPart& part = parts[rank];
    if (part.is_damaged) continue;
    const std::string named = name_of(rank, part);
    if (part.is_there && part.run != first.run)
      throw StoreError(named + "this is a part of another run than in " + first.directory);
    if (rank >= num_ranks) continue;
    if (!part.is_there)
      throw StoreError(named + "there is no part of the run that other ranks hold (" +
                       first.directory + "): bring it back, or force a new run on all ranks");
    if (part.num_ranks == 0 && num_ranks > 1)
      throw StoreError(named + "it has a run that one process makes: give another directory");
    if (part.rank != rank)
      throw StoreError(named + "this is the part of rank " + std::to_string(part.rank));
  }
}

void require_same_age(const std::vector<HeldPart>& parts, std::size_t num_ranks) {
  const auto of_run = std::span(parts).first(num_ranks);
  const auto& newest = *std::ranges::max_element(of_run, {}, &HeldPart::superstep);
  for (std::size_t rank = 0; rank < num_ranks; ++rank) {
    const HeldPart& part = parts[rank];
    if (part.num_moves < newest.num_moves || part.superstep + 1 < newest.superstep)
      throw StoreError(name_of(rank, part) + "this part is " +
                       std::to_string(newest.superstep - part.superstep) +
                       " supersteps older than that in " + newest.directory +
                       ": a copy of it that is as new is needed");
  }
}

SeenPart seen_in(const std::filesystem::path& directory, HeldPart& part) {
  SeenPart seen{.directory = directory, .store = {}, .fault = {}, .shares = {}};
  part = HeldPart();
  part.directory = directory.string();
  try {
    if (!Store::exists(directory)) return seen;
    seen.store = Store::open(directory, {.read_only = true});
    part = part_in(*seen.store);
  } catch (const StoreError& e) {
    part.is_damaged = true;
    seen.fault = e.what();
  }
  return seen;
}

// Leaves may have moved in some stores, and be about to in others.
bool are_of_one_move(const std::vector<HeldPart>& parts) {
  std::optional<std::uint64_t> num_moves;
  return std::ranges::all_of(parts, [&](const HeldPart& part) {
    if (part.is_there && !num_moves) num_moves = part.num_moves;
    return part.is_damaged || (part.is_there && part.num_moves == num_moves);
  });
}

// These throw StoreError, the same on all ranks, unless they can look into the run together.
void require_number_of_run(const std::filesystem::path& stores,
                           const std::vector<HeldPart>& parts) {
  for (const HeldPart& part : parts)
    if (part.num_ranks > 0 && part.num_ranks != parts.size())
      throw StoreError(stores.string() + ": the run is of " + std::to_string(part.num_ranks) +
                       " ranks, and as many have to look into it: start so many; or `locvol-mpi "
                       "resume` by these moves its leaves to them");
}

void require_one_run(const std::filesystem::path& stores, const std::vector<HeldPart>& parts) {
  if (std::ranges::none_of(parts, &HeldPart::is_there))
    throw StoreError(stores.string() + ": the stores hold no run that can be read");
  require_same_run(parts, parts.size());
  if (!are_of_one_move(parts))
    throw StoreError(stores.string() +
                     ": leaves of some ranks have moved, and those of others have not: "
                     "`locvol-mpi resume` goes on from there");
}

}  // namespace

std::filesystem::path store_of_rank(const std::filesystem::path& stores, int rank) {
  std::string name = stores.string();
  const std::string number = std::to_string(rank);
  for (auto place = name.find("%r"); place != std::string::npos;
       place = name.find("%r", place + number.size()))
    name.replace(place, 2, number);
  return name;
}

namespace {

int num_ranks_with(const std::string& name, Exchange& exchange) {
  return static_cast<int>(std::ranges::count(exchange.gather(name), name));
}

}  // namespace

int num_ranks_here(Exchange& exchange) { return num_ranks_with(host_name(), exchange); }

DiskOf disk_of_parts(const std::filesystem::path& store, const std::filesystem::path& pieces,
                     Exchange& exchange) {
  std::map<std::uint64_t, double> num_disks;
  for (const std::filesystem::path& place : {store, pieces.empty() ? store : pieces}) {
    const std::uint64_t id = disk_of(place).id;
    num_disks[id] = 1.0 * exchange.num_ranks() /
                    num_ranks_with(host_name() + ':' + std::to_string(id), exchange);
  }
  const auto held = static_cast<std::uint64_t>(bytes_held(store));
  const auto by_others = static_cast<double>(sum(exchange, held).all - held);
  return [num_disks, by_others, store_disk = disk_of(store).id](const std::filesystem::path& at) {
    Disk disk = disk_of(at);
    if (const auto own = num_disks.find(disk.id); own != num_disks.end())
      disk.free_bytes *= own->second;
    if (disk.id == store_disk) disk.free_bytes += by_others;
    return disk;
  };
}

std::optional<HeldRun> held_by_ranks(const std::filesystem::path& stores, Exchange& exchange) {
  const int num_ranks = exchange.num_ranks();
  const std::filesystem::path own = store_of_rank(stores, exchange.rank());
  require_own_stores(own, exchange);
  settle_last_move(stores, exchange);
  std::vector<HeldPart> parts = gather_values(exchange, part_in(own));
  const HeldPart newest = newest_of(parts);
  if (!newest.is_there) return std::nullopt;
  const int num_before = static_cast<int>(std::max<std::uint64_t>(1, newest.num_ranks));
  HeldRun held;
  held.num_ranks = num_before;
  std::vector<HeldPart> of_none;  // those of ranks that are no more
  for (const int rank : ranks_hosted(num_before, exchange)) {
    held.parts.push_back(store_of_rank(stores, rank));
    if (rank >= num_ranks) of_none.push_back(part_in(held.parts.back()));
  }
  // They come by rank that sees them, and go by their own.
  const std::vector<std::vector<HeldPart>> by_rank = gather_values(exchange, of_none);
  for (int rank = num_ranks; rank < num_before; ++rank)
    parts.push_back(by_rank[static_cast<std::size_t>(rank % num_ranks)].at(
        static_cast<std::size_t>(rank / num_ranks - 1)));
  require_same_run(parts, static_cast<std::size_t>(num_before));
  require_same_age(parts, static_cast<std::size_t>(num_before));
  for (const std::filesystem::path& part : held.parts)  // of a move that was not finished
    if (Store::owns(next_of(part))) std::filesystem::remove_all(next_of(part));

  const auto of_run = std::span(parts).first(static_cast<std::size_t>(num_before));
  const auto [oldest, latest] = std::ranges::minmax(of_run, {}, &HeldPart::superstep);
  std::string run;
  if (!held.parts.empty())
    run = encode(Store::open(held.parts.front(), {.read_only = true}).snapshot().run().value(),
                 MortonKey());
  held.run = decode<RunRecord>(exchange.gather(run).front(), MortonKey());
  held.is_of_these_ranks = newest.num_ranks == static_cast<std::uint64_t>(num_ranks);
  held.is_within_superstep = oldest.superstep != latest.superstep ||
                             std::ranges::any_of(of_run, &HeldPart::is_within_superstep);
  if (held.is_of_these_ranks) {
    const HeldPart& part = parts[static_cast<std::size_t>(exchange.rank())];
    held.is_behind = part.superstep != latest.superstep;
    held.is_ahead = part.superstep != oldest.superstep;
  }
  return held;
}

SeenPart part_to_look_into(const std::filesystem::path& stores, Exchange& exchange) {
  constexpr int kTries = 250;
  constexpr std::chrono::milliseconds kPause{20};
  const std::filesystem::path own = store_of_rank(stores, exchange.rank());
  require_own_stores(own, exchange);
  HeldPart part;
  SeenPart seen = seen_in(own, part);
  std::vector<HeldPart> parts = gather_values(exchange, part);
  require_number_of_run(stores, parts);
  const bool is_any = any(exchange, part.is_there || std::filesystem::exists(next_of(own)));
  for (int i = 1; is_any && !are_of_one_move(parts) && i < kTries; ++i) {
    std::this_thread::sleep_for(kPause);
    seen.store.reset();  // of a directory that another has the name of now
    seen = seen_in(own, part);
    parts = gather_values(exchange, part);
  }
  require_one_run(stores, parts);

  const auto known = std::ranges::find_if(parts, &HeldPart::is_there) - parts.begin();
  std::vector<MortonKey> first;
  if (known == exchange.rank())
    if (const auto rank = seen.store->snapshot().rank()) first = rank->first;
  first = gather_all(exchange, first);
  if (!first.empty()) seen.shares = Shares(std::move(first));
  return seen;
}

PassingStore::PassingStore(std::filesystem::path directory) : directory_(std::move(directory)) {
  std::filesystem::remove_all(directory_);
}

PassingStore::~PassingStore() {
  std::error_code ignored;
  std::filesystem::remove_all(directory_, ignored);
}

NextStore::NextStore(std::filesystem::path directory) : directory_(std::move(directory)) {
  const bool has_files =
      std::filesystem::exists(directory_) && !std::filesystem::is_empty(directory_);
  if (has_files && !Store::owns(directory_))
    throw StoreError(directory_.string() + ": it has files that are not locvol's: give another");
  std::filesystem::remove_all(next_of(directory_));
  store_.emplace(Store::open(next_of(directory_), {.create = true}));
}

void NextStore::take_place(std::span<const std::filesystem::path> parts, Exchange& exchange) {
  store_.reset();
  wait_for_all(exchange);
  for (const std::filesystem::path& part : parts) std::filesystem::remove_all(part);
  std::filesystem::remove_all(directory_);
  std::filesystem::rename(next_of(directory_), directory_);
}

}  // namespace locvol
