#include "engine/inspect/run_part.h"

#include <utility>

#include "engine/exchange/pack.h"
#include "engine/inspect/leaf_row_fields.h"
#include "engine/ranks/rank_store.h"

namespace locvol {
namespace {

// Visits the part's own rows.
template <class Row, class LeafOf>
auto own_rows(const RunPart& part, const std::function<bool(const Row&)>& visit,
              std::vector<Fault>& faults, const LeafOf& leaf_of) {
  return [&part, &visit, &faults, leaf_of](const Row& row) {
    if (part.has(leaf_of(row))) return visit(row);
    faults.insert(faults.end(), row.faults.begin(), row.faults.end());
    return true;
  };
}

}  // namespace

std::string RunPart::name() const {
  if (!is_of_ranks()) return {};
  return "rank " + std::to_string(exchange.rank()) + ": ";
}

RunPart whole_run(Store store) {
  const std::filesystem::path directory = store.directory();
  return {alone(), directory, std::move(store), {}};
}

RunPart part_of_rank(const std::filesystem::path& stores, Exchange& exchange,
                     std::vector<Fault>& faults) {
  SeenPart seen = part_to_look_into(stores, exchange);
  if (seen.store)
    read_around(faults, [&] { return seen.store->snapshot().rank(); });
  else
    faults.push_back({MortonKey(), seen.fault});
  return {exchange, std::move(seen.directory), std::move(seen.store), std::move(seen.shares)};
}

void scan_leaves(const RunPart& part, const std::function<bool(const LeafRow&)>& visit,
                 std::vector<Fault>& faults, const ScanOptions& options) {
  if (!part.store) return;
  const auto take =
      own_rows<LeafRow>(part, visit, faults, [](const LeafRow& row) { return row.key; });
  scan_leaves(*part.store, take, faults, options);
}

void scan_queue(const RunPart& part, const std::function<bool(const QueueRow&)>& visit,
                std::vector<Fault>& faults) {
  if (!part.store) return;
  const auto take =
      own_rows<QueueRow>(part, visit, faults, [](const QueueRow& row) { return row.entry.leaf; });
  scan_queue(*part.store, take, faults);
}

std::vector<Fault> named(const RunPart& part, std::vector<Fault> faults) {
  for (Fault& fault : faults) fault.message.insert(0, part.name());
  return faults;
}

std::vector<Fault> gather_named(const RunPart& part, const std::vector<Fault>& faults) {
  return gather_all(part.exchange, named(part, faults));
}

}  // namespace locvol
