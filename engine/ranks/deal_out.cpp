#include "engine/ranks/deal_out.h"

#include <algorithm>
#include <array>
#include <tuple>
#include <utility>
#include <vector>

#include "storage/codec.h"

namespace locvol {

// A leaf with all its records, as the store's codec writes them.
struct DealtLeaf {
  MortonKey leaf;
  std::string info, points, cells, surface, unresolved, sizes;
};

}  // namespace locvol

#include "engine/exchange/pack.h"
#include "engine/ranks/rank_visits.h"

namespace locvol {

auto fields(Maybe<DealtLeaf> auto& dealt) {
  auto& [leaf, info, points, cells, surface, unresolved, sizes] = dealt;
  return std::tuple(Field("leaf", leaf), Field("info", info), Field("points", points),
                    Field("cells", cells), Field("surface", surface),
                    Field("unresolved", unresolved), Field("sizes", sizes));
}

namespace {

constexpr std::size_t kMessageBytes = std::size_t{4} << 20;

// Of the work in a leaf: nearly all of it is at the surface.
double predicted_cost(const LeafInfo& info) {
  constexpr double kInside = 0.05, kOutside = 0.001;
  return info.num_triangles > 0 ? 1 : info.is_center_inside ? kInside : kOutside;
}

Shares cut(const Reader& reader, int num_ranks) {
  std::vector<MortonKey> leaves;
  std::vector<double> costs;
  reader.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
    leaves.push_back(leaf);
    costs.push_back(predicted_cost(info));
    return true;
  });
  return Shares::of_equal_cost(leaves, costs, num_ranks);
}

DealtLeaf dealt(const Reader& reader, MortonKey leaf, LeafInfo info, Holding holding) {
  info.holding = holding;
  return {leaf,
          encode(info, leaf),
          encode(reader.points(leaf), leaf),
          encode(reader.cells(leaf), leaf),
          encode(reader.surface(leaf), leaf),
          encode(reader.unresolved(leaf), leaf),
          encode(reader.sizes(leaf), leaf)};
}

std::size_t num_bytes(const DealtLeaf& d) {
  return d.info.size() + d.points.size() + d.cells.size() + d.surface.size() + d.unresolved.size() +
         d.sizes.size();
}

void put(Batch& batch, const DealtLeaf& dealt) {
  const MortonKey leaf = dealt.leaf;
  const auto info = decode<LeafInfo>(dealt.info, leaf);
  batch.put_leaf(leaf, info);
  batch.put_points(leaf, decode<LeafPoints>(dealt.points, leaf));
  batch.put_cells(leaf, decode<LeafCells>(dealt.cells, leaf));
  batch.put_surface(leaf, decode<LeafSurface>(dealt.surface, leaf));
  batch.put_unresolved(leaf, decode<LeafUnresolved>(dealt.unresolved, leaf));
  batch.put_sizes(leaf, decode<LeafSizes>(dealt.sizes, leaf));
  if (info.queued) batch.put_queue_entry({*info.queued, leaf});
}

// Gives the first rank's leaves away, round after round.
class Dealer {
 public:
  Dealer(const Store* whole, const RunRecord& run, const Shares& shares)
      : run_(run), shares_(shares) {
    if (whole == nullptr) return;
    snapshot_.emplace(whole->snapshot());
    leaves_ = snapshot_->leaf_keys();
  }

  bool has_more() const { return next_ < leaves_.size(); }

  std::vector<std::vector<DealtLeaf>> round() {
    const auto num_ranks = static_cast<std::size_t>(shares_.num_ranks());
    std::vector<std::vector<DealtLeaf>> dealt_to(num_ranks);
    std::vector<std::size_t> bytes(num_ranks);
    for (; has_more() && std::ranges::max(bytes) < kMessageBytes; ++next_) {
      const MortonKey leaf = leaves_[next_];
      const int owner = shares_.owner_of(leaf);
      for (const int rank :
           shares_.ranks_within(run_.frame, run_.frame.box(leaf), kTouch * run_.parameters.size)) {
        const auto to = static_cast<std::size_t>(rank);
        dealt_to[to].push_back(dealt(*snapshot_, leaf, snapshot_->leaf(leaf).value(),
                                     rank == owner ? Holding::kOwn : Holding::kCopy));
        bytes[to] += num_bytes(dealt_to[to].back());
      }
    }
    return dealt_to;
  }

 private:
  const RunRecord& run_;
  const Shares& shares_;
  std::optional<Snapshot> snapshot_;
  std::vector<MortonKey> leaves_;
  std::size_t next_ = 0;
};

}  // namespace

void deal_out(const Store* whole, Store& own, Exchange& exchange) {
  std::string run_bytes, shares_bytes;
  if (whole != nullptr) {
    const Snapshot snapshot = whole->snapshot();
    run_bytes = encode(snapshot.run().value(), MortonKey());
    shares_bytes = pack(cut(snapshot, exchange.num_ranks()).first());
  }
  const auto run = decode<RunRecord>(exchange.gather(run_bytes).front(), MortonKey());
  const Shares shares(unpack<std::vector<MortonKey>>(exchange.gather(shares_bytes).front()));

  Dealer dealer(whole, run, shares);
  std::vector<MortonKey> held;
  do {
    std::vector<std::string> messages;
    for (const auto& leaves : dealer.round()) messages.push_back(pack(leaves));
    Batch batch = own.begin();
    for (const std::string& message : exchange.swap(std::move(messages)))
      for (const DealtLeaf& leaf : unpack<std::vector<DealtLeaf>>(message)) {
        put(batch, leaf);
        held.push_back(leaf.leaf);
      }
    batch.commit();
  } while (any(exchange, dealer.has_more()));

  Batch batch = own.begin();
  const LinearOctree octree = LinearOctree::coarsest_with(held);
  for (const MortonKey leaf : octree.leaves()) {
    if (std::ranges::binary_search(held, leaf)) continue;
    LeafInfo beyond;
    beyond.holding = Holding::kBeyond;
    batch.put_leaf(leaf, beyond);
  }
  batch.put_run(run);
  RankRecord rank;
  rank.first = shares.first();
  rank.rank = static_cast<std::uint32_t>(exchange.rank());
  batch.put_rank(rank);
  batch.commit();
}

void join(const Store& own, Store* whole, Exchange& exchange) {
  const Snapshot snapshot = own.snapshot();
  RunRecord run = snapshot.run().value();
  run.counts = total_counts(exchange, run.counts);
  const std::vector<MortonKey> leaves = snapshot.leaf_keys();
  auto leaf = leaves.begin();
  do {
    std::vector<DealtLeaf> of_round;
    for (std::size_t bytes = 0; leaf != leaves.end() && bytes < kMessageBytes; ++leaf) {
      const LeafInfo info = snapshot.leaf(*leaf).value();
      if (info.holding != Holding::kOwn) continue;
      of_round.push_back(dealt(snapshot, *leaf, info, Holding::kOwn));
      bytes += num_bytes(of_round.back());
    }
    std::vector<std::string> messages(static_cast<std::size_t>(exchange.num_ranks()));
    messages.front() = pack(of_round);
    const std::vector<std::string> all = exchange.swap(std::move(messages));
    if (whole == nullptr) continue;
    Batch batch = whole->begin();
    for (const std::string& message : all)
      for (const DealtLeaf& of_rank : unpack<std::vector<DealtLeaf>>(message)) put(batch, of_rank);
    batch.commit();
  } while (any(exchange, leaf != leaves.end()));
  if (whole == nullptr) return;
  Batch batch = whole->begin();
  batch.put_run(run);
  batch.commit();
}

}  // namespace locvol
