// The stores of the ranks of a run: together they hold the run, or none of it.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/plan/disk_room.h"
#include "octree/shares.h"
#include "storage/store.h"

namespace locvol {

// Where a rank has its store: %r in the name is its number.
std::filesystem::path store_of_rank(const std::filesystem::path& stores, int rank);

// On this rank's machine.
int num_ranks_here(Exchange& exchange);
// For what is cut into as many parts as there are ranks, of which each has one in its own `store`,
// and in `pieces`, if that is not empty: there is as much free as on all such disks, and what other
// stores hold, as one's own, is free.
DiskOf disk_of_parts(const std::filesystem::path& store, const std::filesystem::path& pieces,
                     Exchange& exchange);

struct HeldRun {
  RunRecord run;
  int num_ranks = 1;  // that have it
  // As many ranks have the run as there are. If not, leaves have to move first: this rank gives
  // those in its `parts`.
  bool is_of_these_ranks = true;
  bool is_within_superstep = false;  // then leaves cannot move before as many ranks have ended it
  // REQUIRES: is_of_these_ranks. Others have committed a superstep that this rank has not; the
  // reverse: then this rank has to say_again() what it said in it (RankWords).
  bool is_behind = false, is_ahead = false;
  std::vector<std::filesystem::path> parts;  // of ranks_hosted()
};
// The run that all stores hold a part of, which other ranks or one process may have made; nothing,
// if there is none yet. What a move of leaves left behind is settled. Called by all ranks; the
// first ones see the stores of ranks that are no more. Throws StoreError, the same on all, with
// rank and directory: a rank has no part of the run that others have, is of another run, or older
// by more than a superstep.
std::optional<HeldRun> held_by_ranks(const std::filesystem::path& stores, Exchange& exchange);

// What a rank sees of a run that it only looks into.
struct SeenPart {
  std::filesystem::path directory;
  std::optional<Store> store;  // read only; absent: it cannot be opened, because of a `fault`
  std::string fault;
  Shares shares;
};
// Of the run in the stores, which may go on: nothing is changed, and parts are of any supersteps,
// for each is seen at a moment of its own. Damage is an error only if no part can be read. Called
// by as many ranks as the run is of. Throws StoreError, the same on all: the run is of another
// number of ranks; a rank has no part of it, or another's. While leaves of some have moved and
// those of others not yet, it waits, for five seconds at most.
SeenPart part_to_look_into(const std::filesystem::path& stores, Exchange& exchange);

// A directory for a store from which leaves are to move, and that is needed no more then.
class PassingStore {
 public:
  explicit PassingStore(std::filesystem::path directory);  // after an end, removes what there is
  PassingStore(const PassingStore&) = delete;
  PassingStore& operator=(const PassingStore&) = delete;
  ~PassingStore();
  const std::filesystem::path& directory() const { return directory_; }
  Store open() const { return Store::open(directory_, {.create = true, .is_durable = false}); }

 private:
  std::filesystem::path directory_;
};

// A store that is to take a rank's store's place when all ranks have theirs: either all do, or
// none.
class NextStore {
 public:
  // Throws StoreError: the directory has other files.
  explicit NextStore(std::filesystem::path directory);
  Store& store() { return *store_; }
  // Called by all ranks when it holds a run. `parts`: what was given away, and goes.
  void take_place(std::span<const std::filesystem::path> parts, Exchange& exchange);

 private:
  std::filesystem::path directory_;
  std::optional<Store> store_;
};

}  // namespace locvol
