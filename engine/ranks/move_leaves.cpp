#include "engine/ranks/move_leaves.h"

#include <algorithm>
#include <bit>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/exchange/round_budget.h"
#include "engine/plan/phases.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/run/leaf_distances.h"
#include "octree/octree.h"
#include "refine/domain/surface_part.h"
#include "storage/codec.h"

namespace locvol {

// A leaf with all its records, as the store's codec writes them.
struct MovedLeaf {
  MortonKey leaf;
  std::string info, points, cells, facets, surface, unresolved, sizes;
};
// What leaves of a store cost, and where they begin.
struct CostOfPart {
  MortonKey first;
  std::uint64_t cost = 0;
};
// A leaf with which a rank's share begins, or an earlier one's.
struct ShareBegin {
  std::uint64_t share = 0;
  MortonKey leaf;
};
// A leaf that asks for copies of all within a distance.
struct AskingLeaf {
  MortonKey leaf;
  double distance = 0;
};

}  // namespace locvol

#include "engine/exchange/pack.h"

namespace locvol {

auto fields(Maybe<MovedLeaf> auto& moved) {
  auto& [leaf, info, points, cells, facets, surface, unresolved, sizes] = moved;
  return std::tuple(Field("leaf", leaf), Field("info", info), Field("points", points),
                    Field("cells", cells), Field("facets", facets), Field("surface", surface),
                    Field("unresolved", unresolved), Field("sizes", sizes));
}
auto fields(Maybe<CostOfPart> auto& part) {
  auto& [first, cost] = part;
  return std::tuple(Field("first", first), Field("cost", cost));
}
auto fields(Maybe<ShareBegin> auto& begin) {
  auto& [share, leaf] = begin;
  return std::tuple(Field("share", share), Field("leaf", leaf));
}
auto fields(Maybe<AskingLeaf> auto& asking) {
  auto& [leaf, distance] = asking;
  return std::tuple(Field("leaf", leaf), Field("distance", distance));
}

namespace {

std::size_t at(int rank) { return static_cast<std::size_t>(rank); }

// Of what is to be done in a leaf from the run's phase on. At one size nearly all of it is at the
// surface.
double predicted_cost(const Reader& reader, MortonKey leaf, const LeafInfo& info,
                      const RunRecord& run) {
  constexpr double kInside = 0.02, kOutside = 1e-4;  // of the side of a leaf, squared
  if (are_first_points_known(run.phase)) return predicted_cost(info);
  const SizeLaw law = run.parameters.sizes();
  if (!law.is_uniform() && are_sizes_known(run.phase)) {
    SizeTotals totals;
    for (const SizeCube& cube : reader.sizes(leaf).cubes)
      totals += size_totals(law, cube, run.frame.box(cube.key));
    return totals.of_volume - totals.of_core + totals.of_area;
  }
  const double side = run.frame.side(leaf.level()) / run.parameters.size;
  const double least = (info.center.body() != kNoBody ? kInside : kOutside) * side * side;
  if (!info.has_surface()) return least;
  return least + area_in(run.frame.box(leaf), reader.surface(leaf)) /
                     (run.parameters.size * run.parameters.size);
}

// In Morton order.
template <class Visit>
void for_each_own(const Store& store, const Visit& visit) {
  store.snapshot().for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
    if (info.holding == Holding::kOwn) visit(leaf, info);
    return true;
  });
}

MovedLeaf moved(const Reader& reader, MortonKey leaf, const LeafInfo& info, bool has_cells = true) {
  return {leaf,
          encode(info, leaf),
          encode(reader.points(leaf), leaf),
          encode(has_cells ? reader.cells(leaf) : LeafCells(), leaf),
          encode(info.holding == Holding::kOwn ? reader.facets(leaf) : LeafFacets(), leaf),
          encode(reader.surface(leaf), leaf),
          encode(reader.unresolved(leaf), leaf),
          encode(reader.sizes(leaf), leaf)};
}

std::size_t num_bytes(const MovedLeaf& m) {
  return m.info.size() + m.points.size() + m.cells.size() + m.facets.size() + m.surface.size() +
         m.unresolved.size() + m.sizes.size();
}

void put(Batch& batch, const MovedLeaf& moved) {
  const MortonKey leaf = moved.leaf;
  const auto info = decode<LeafInfo>(moved.info, leaf);
  batch.put_leaf(leaf, info);
  batch.put_points(leaf, decode<LeafPoints>(moved.points, leaf));
  batch.put_cells(leaf, decode<LeafCells>(moved.cells, leaf));
  batch.put_facets(leaf, decode<LeafFacets>(moved.facets, leaf));
  batch.put_surface(leaf, decode<LeafSurface>(moved.surface, leaf));
  batch.put_unresolved(leaf, decode<LeafUnresolved>(moved.unresolved, leaf));
  batch.put_sizes(leaf, decode<LeafSizes>(moved.sizes, leaf));
  if (info.queued) batch.put_queue_entry({*info.queued, leaf});
}

// Messages of leaves, round after round: `next(send)` has one more leaf sent to some ranks, until
// it returns false. What comes goes into `to`, and take(leaf) hears of it.
class LeafRounds {
 public:
  explicit LeafRounds(Exchange& exchange)
      : exchange_(exchange), sent_(at(exchange.num_ranks())), budget_(exchange.num_ranks()) {}

  void send(int rank, MovedLeaf leaf) {
    budget_.add(rank, num_bytes(leaf));
    sent_[at(rank)].push_back(std::move(leaf));
  }

  template <class Next, class Take>
  void run(Store* to, const Next& next, const Take& take) {
    bool has_more = true;
    do {
      budget_.begin_round();
      while (has_more && budget_.has_room()) has_more = next();
      auto received = swap_lists(exchange_, std::exchange(sent_, Lists(sent_.size())));
      if (to == nullptr) continue;
      Batch batch = to->begin();
      for (const auto& of_rank : received)
        for (const MovedLeaf& leaf : of_rank) {
          put(batch, leaf);
          take(leaf.leaf);
        }
      batch.commit();
      to->release_pages();
    } while (any(exchange_, has_more));
  }

 private:
  using Lists = std::vector<std::vector<MovedLeaf>>;

  Exchange& exchange_;
  Lists sent_;
  RoundBudget budget_;
};

// Walks through the leaves of stores, one at a time.
class OwnLeaves {
 public:
  explicit OwnLeaves(std::span<const Store> from) : from_(from) {}

  // The next own leaf; nothing: there is none.
  std::optional<std::pair<MortonKey, LeafInfo>> next() {
    for (;; ++place_) {
      while (place_ == leaves_.size()) {
        if (store_ == from_.size()) return std::nullopt;
        snapshot_.emplace(from_[store_++].snapshot());
        leaves_ = snapshot_->leaf_keys();
        place_ = 0;
      }
      const MortonKey leaf = leaves_[place_];
      LeafInfo info = snapshot_->leaf(leaf).value();
      if (info.holding != Holding::kOwn) continue;
      ++place_;
      return std::pair(leaf, std::move(info));
    }
  }
  const Reader& reader() const { return *snapshot_; }  // of the last one

 private:
  std::span<const Store> from_;
  std::optional<Snapshot> snapshot_;
  std::vector<MortonKey> leaves_;
  std::size_t store_ = 0, place_ = 0;
};

// All own leaves go to the ranks that owner_of() tells. Returns those that came, in Morton order.
template <class OwnerOf>
std::vector<MortonKey> move_own(std::span<const Store> from, const OwnerOf& owner_of, Store* to,
                                Exchange& exchange) {
  std::vector<MortonKey> held;
  OwnLeaves leaves(from);
  LeafRounds rounds(exchange);
  const auto next = [&] {
    auto leaf = leaves.next();
    if (!leaf) return false;
    auto& [key, info] = *leaf;
    info.ranks.clear();
    rounds.send(owner_of(key), moved(leaves.reader(), key, info));
    return true;
  };
  rounds.run(to, next, [&](MortonKey leaf) { held.push_back(leaf); });
  std::ranges::sort(held);
  return held;
}

// Each gets copies of leaves near its own. Those are within the distance of either that a visit may
// touch: so what a leaf's cells have vertices in is there, and whose cells have vertices in it.
class CopyDealer {
 public:
  CopyDealer(Store& own, const RunRecord& run, const Shares& shares, std::vector<MortonKey> leaves,
             Exchange& exchange)
      : own_(own), run_(run), shares_(shares), leaves_(std::move(leaves)), exchange_(exchange) {}

  // Returns all leaves that the rank then has, in Morton order.
  std::vector<MortonKey> run() {
    find_holders();
    put_holders();
    std::vector<MortonKey> held = leaves_;
    const Snapshot snapshot = own_.snapshot();
    LeafRounds rounds(exchange_);
    auto leaf = holders_.begin();
    const auto next = [&] {
      if (leaf == holders_.end()) return false;
      const auto& [key, ranks] = *leaf++;
      LeafInfo info = snapshot.leaf(key).value();
      info.holding = Holding::kCopy;
      // Of cells a copy has those that are to be mended.
      const bool has_cells = run_.phase == Phase::kMend;
      if (!has_cells) info.num_cells = info.num_left_out = 0;
      info.num_core_cells = 0;
      const MovedLeaf copy = moved(snapshot, key, info, has_cells);
      for (const std::uint32_t rank : ranks)
        if (static_cast<int>(rank) != exchange_.rank()) rounds.send(static_cast<int>(rank), copy);
      return true;
    };
    rounds.run(&own_, next, [&](MortonKey copy) { held.push_back(copy); });
    std::ranges::sort(held);
    return held;
  }

 private:
  void find_holders() {
    std::vector<std::vector<AskingLeaf>> asking(at(exchange_.num_ranks()));
    own_.snapshot().for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
      const double distance = touch_distance(run_, info);
      for (const int rank : shares_.ranks_within(run_.frame, run_.frame.box(leaf), distance))
        if (rank != exchange_.rank()) {
          asking[at(rank)].push_back({leaf, distance});
          add_holder(leaf, rank);
        }
      return true;
    });
    const LinearOctree octree = LinearOctree::coarsest_with(leaves_);
    asking = swap_lists(exchange_, std::move(asking));
    for (int rank = 0; rank < exchange_.num_ranks(); ++rank)
      for (const auto& [leaf, distance] : asking[at(rank)])
        for (const MortonKey near :
             octree.leaves_within(run_.frame, run_.frame.box(leaf), distance))
          if (std::ranges::binary_search(leaves_, near)) add_holder(near, rank);
  }

  void add_holder(MortonKey leaf, int rank) {
    holders_[leaf].insert(
        {static_cast<std::uint32_t>(exchange_.rank()), static_cast<std::uint32_t>(rank)});
  }

  void put_holders() {
    Batch batch = own_.begin();
    for (const auto& [leaf, ranks] : holders_) {
      LeafInfo info = batch.leaf(leaf).value();
      info.ranks.assign(ranks.begin(), ranks.end());
      batch.put_leaf(leaf, info);
    }
    batch.commit();
  }

  Store& own_;
  const RunRecord& run_;
  const Shares& shares_;
  std::vector<MortonKey> leaves_;  // own
  Exchange& exchange_;
  std::map<MortonKey, std::set<std::uint32_t>> holders_;  // of own that others have, too
};

// What the run's totals have of the leaf.
RunCounts counts_in(const LeafInfo& info) {
  RunCounts counts;
  counts.num_visits = info.num_visits;
  counts.num_points = info.num_points + info.num_core_points;
  counts.num_cells = info.num_cells + info.num_core_cells;
  counts.num_unresolved = info.num_unresolved;
  counts.num_deletions = info.num_deletions;
  counts.num_moves = info.num_moves;
  counts.num_insertions = info.num_insertions;
  return counts;
}

// The run, with the counts of all that the stores hold.
RunRecord run_in(std::span<const Store> from, Exchange& exchange) {
  RunCounts counts;
  std::string first;
  for (const Store& store : from) {
    const RunRecord run = store.snapshot().run().value();
    counts = sum_of(counts, run.counts);
    if (first.empty()) first = encode(run, MortonKey());
  }
  auto run = decode<RunRecord>(exchange.gather(first).front(), MortonKey());
  run.counts = total_counts(exchange, counts);
  return run;
}

SurfaceSheets sheets_in(std::span<const Store> from, Exchange& exchange) {
  std::string first;
  if (exchange.rank() == 0) first = encode(from.front().snapshot().sheets(), MortonKey());
  return decode<SurfaceSheets>(exchange.gather(first).front(), MortonKey());
}

// Visits of leaves that were split since are the first rank's.
RunCounts own_counts(const Store& own, const RunCounts& all, Exchange& exchange) {
  RunCounts counts;
  for_each_own(own,
               [&](MortonKey, const LeafInfo& info) { counts = sum_of(counts, counts_in(info)); });
  const RunCounts known = total_counts(exchange, counts);
  return exchange.rank() == 0 ? sum_of(counts, difference(all, known)) : counts;
}

void put_timeline(Batch& batch, std::span<const Store> from) {
  if (from.empty()) return;
  const Snapshot snapshot = from.front().snapshot();
  batch.put_timeline(snapshot.timeline());
  if (const auto memory = snapshot.memory()) batch.put_memory(*memory);
}

}  // namespace

double predicted_cost(const LeafInfo& info) {
  constexpr double kAny = 1e-3;
  return kAny + static_cast<double>(info.num_points);
}

void move_leaves(std::span<const Store> from, const Shares& shares, Store& own,
                 Exchange& exchange) {
  RunRecord run = run_in(from, exchange);
  std::uint64_t superstep = 0, num_moves = 0;
  for (const Store& store : from)
    if (const auto rank = store.snapshot().rank()) {
      superstep = std::max(superstep, rank->superstep);
      num_moves = std::max(num_moves, rank->num_moves);
    }
  superstep = std::ranges::max(gather_numbers(exchange, superstep));
  num_moves = std::ranges::max(gather_numbers(exchange, num_moves));

  std::vector<MortonKey> held = move_own(
      from, [&](MortonKey leaf) { return shares.owner_of(leaf); }, &own, exchange);
  held = CopyDealer(own, run, shares, std::move(held), exchange).run();

  run.counts = own_counts(own, run.counts, exchange);
  const SurfaceSheets sheets = sheets_in(from, exchange);
  Batch batch = own.begin();
  batch.put_sheets(sheets);
  const LinearOctree octree = LinearOctree::coarsest_with(held);
  for (const MortonKey leaf : octree.leaves()) {
    if (std::ranges::binary_search(held, leaf)) continue;
    LeafInfo beyond;
    beyond.holding = Holding::kBeyond;
    batch.put_leaf(leaf, beyond);
  }
  batch.put_run(run);
  put_timeline(batch, from);
  RankRecord rank;
  rank.first = shares.first();
  rank.rank = static_cast<std::uint32_t>(exchange.rank());
  rank.superstep = superstep + 1;
  rank.num_moves = num_moves + 1;
  rank.moved_at = run.phase;
  batch.put_rank(rank);
  batch.commit();
}

void tell_leaves_beside(const Store& own, Store& beside, Exchange& exchange) {
  OwnLeaves leaves({&own, 1});
  LeafRounds rounds(exchange);
  const auto next = [&] {
    const auto leaf = leaves.next();
    if (!leaf) return false;
    const auto& [key, info] = *leaf;
    if (info.ranks.empty()) return true;
    const MovedLeaf told = moved(leaves.reader(), key, info);
    for (const std::uint32_t rank : info.ranks)
      if (static_cast<int>(rank) != exchange.rank()) rounds.send(static_cast<int>(rank), told);
    return true;
  };
  rounds.run(&beside, next, [](MortonKey) {});
}

void join_leaves(std::span<const Store> from, Store* whole, Exchange& exchange) {
  const RunRecord run = run_in(from, exchange);
  move_own(
      from, [](MortonKey) { return 0; }, whole, exchange);
  const SurfaceSheets sheets = sheets_in(from, exchange);
  if (whole == nullptr) return;
  Batch batch = whole->begin();
  batch.put_sheets(sheets);
  batch.put_run(run);
  put_timeline(batch, from);
  batch.commit();
}

Shares equal_shares(std::span<const Store> from, Exchange& exchange) {
  // In whole steps, so that sums do not depend on their order.
  struct LeafCost {
    MortonKey leaf;
    std::uint64_t cost = 0;
  };
  std::vector<std::vector<LeafCost>> costs;  // of each store
  std::vector<CostOfPart> own_parts;
  for (const Store& store : from) {
    constexpr double kSteps = 1 << 10;
    const Snapshot snapshot = store.snapshot();
    const RunRecord run = snapshot.run().value();
    auto& of_store = costs.emplace_back();
    CostOfPart part;
    for_each_own(store, [&](MortonKey leaf, const LeafInfo& info) {
      const double cost = predicted_cost(snapshot, leaf, info, run);
      of_store.push_back({leaf, 1 + static_cast<std::uint64_t>(kSteps * cost)});
      part.cost += of_store.back().cost;
    });
    if (of_store.empty()) continue;
    part.first = of_store.front().leaf.range_min();
    own_parts.push_back(part);
  }
  const std::vector<CostOfPart> parts = gather_all(exchange, own_parts);
  double all = 0;
  for (const CostOfPart& part : parts) all += static_cast<double>(part.cost);

  // The leaf's middle decides. Who has the leaf with which a share begins, says so.
  const auto num_ranks = at(exchange.num_ranks());
  std::vector<ShareBegin> own_begins;
  for (const auto& of_store : costs) {
    std::uint64_t before = 0;
    for (const CostOfPart& part : parts)
      if (!of_store.empty() && part.first < of_store.front().leaf.range_min()) before += part.cost;
    std::optional<std::uint64_t> last;
    for (const auto& [leaf, cost] : of_store) {
      const double middle = static_cast<double>(before) + 0.5 * static_cast<double>(cost);
      const std::uint64_t share = std::min<std::uint64_t>(
          num_ranks - 1, std::uint64_t(middle / all * static_cast<double>(num_ranks)));
      if (last != share) own_begins.push_back({share, leaf.range_min()});
      last = share;
      before += cost;
    }
  }
  std::vector<MortonKey> first(num_ranks, MortonKey::root().range_max());
  for (const auto& [share, leaf] : gather_all(exchange, own_begins))
    for (std::size_t rank = 0; rank <= share; ++rank) first[rank] = std::min(first[rank], leaf);
  first.front() = MortonKey::root();
  return Shares(std::move(first));
}

double imbalance(double own_cost, Exchange& exchange) {
  double most = 0, all = 0;
  for (const std::uint64_t bits :
       gather_numbers(exchange, std::bit_cast<std::uint64_t>(own_cost))) {
    most = std::max(most, std::bit_cast<double>(bits));
    all += std::bit_cast<double>(bits);
  }
  return all > 0 ? most * exchange.num_ranks() / all : 1;
}

}  // namespace locvol
