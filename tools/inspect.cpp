// `locvol inspect`: what is in a store, as a whole, list by list or leaf by leaf. The run may go on
// meanwhile: nothing is printed while a snapshot is held. Damage is shown in its place.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "engine/inspect/leaf_report.h"
#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/run/leaf_queue.h"
#include "tools/commands.h"
#include "tools/inspect_leaf.h"
#include "tools/inspect_summary.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

// -- Lists

Json to_json(const LeafRow& row) {
  Json json = {
      {"leaf", key_text(row.key)}, {"level", row.key.level()}, {"state", state_name(row.state())}};
  if (row.info) json.update(to_json(*row.info));
  if (!row.faults.empty()) json["faults"] = to_json(row.faults);
  return json;
}

void print_leaf_head() {
  fmt::print("{:<16} {:<9}", "leaf", "state");
  for (const LeafField& field : leaf_fields()) fmt::print(" {:>10}", field.name);
  fmt::print("\n");
}

void print(const LeafRow& row) {
  fmt::print("{} {:<9}", key_text(row.key), state_name(row.state()));
  for (const LeafField& field : leaf_fields()) {
    if (row.info) fmt::print(" {:>10}", field.value(row.key, *row.info));
  }
  fmt::print("\n");
  for (const Fault& fault : row.faults) fmt::print("  {}\n", fault_text(fault));
}

Json to_json(const QueueRow& row) {
  Json json = to_json(row.entry.position);
  json["leaf"] = key_text(row.entry.leaf);
  if (!row.faults.empty()) json["faults"] = to_json(row.faults);
  return json;
}

void print_queue_head() { fmt::print("{:>6} {:>6} leaf\n", "epoch", "color"); }

void print(const QueueRow& row) {
  const auto& [epoch, color] = row.entry.position;
  fmt::print("{:>6} {:>6} {}\n", epoch, color == kNoColor ? "-" : fmt::to_string(color),
             key_text(row.entry.leaf));
  for (const Fault& fault : row.faults) fmt::print("  {}\n", fault_text(fault));
}

void print(const LeafSite& site) { fmt::print("{}\n", site_text(site)); }

void print(const LeafPoorCell& cell) { fmt::print("{}\n", poor_cell_text(cell)); }

// Faults of no row come last.
void print(const Fault& fault) { fmt::print("{}\n", fault_text(fault)); }

// Prints rows as they come, up to a limit, as text or as elements of a JSON array.
class ListPrinter {
 public:
  explicit ListPrinter(const InspectCommand& command) : limit_(command.listing.limit) {
    if (command.is_json) json_.emplace();
  }
  void head(void (*print_head)()) const {
    if (!json_) print_head();
  }
  bool is_full() const { return limit_ && num_printed_ == *limit_; }
  // False if no more is wanted.
  template <class Row>
  bool add(const Row& row) {
    if (is_full()) return false;
    ++num_printed_;
    put(row);
    return true;
  }
  template <class Row>
  void put(const Row& row) {
    if (json_)
      json_->add(to_json(row));
    else
      print(row);
  }

 private:
  std::optional<std::uint64_t> limit_;
  std::uint64_t num_printed_ = 0;
  std::optional<JsonArrayPrinter> json_;
};

// Every leaf that the listing shows, in its order. Counts faults of all leaves, shown or not.
std::uint64_t for_each_listed(const Store& store, const InspectCommand& command,
                              const std::function<bool(const LeafRow&)>& visit,
                              std::vector<Fault>& faults) {
  std::uint64_t num_faults = 0;
  const LeafListing& listing = command.listing;
  SortedLeaves sorted(listing);
  bool is_wanted = true;
  const auto take = [&](const LeafRow& row) {
    num_faults += row.faults.size();
    if (!listing.shows(row)) return true;
    if (!listing.is_streamed())
      sorted.add(row);
    else
      is_wanted = visit(row);
    return is_wanted;
  };
  scan_leaves(store, take, faults, {.reads_all = command.reads_all});
  for (const LeafRow& row : sorted.take())
    if (!visit(row)) break;
  return num_faults;
}

// Each returns how many faults it met.

std::uint64_t list_leaves(const Store& store, const InspectCommand& command) {
  std::vector<Fault> faults;
  ListPrinter out(command);
  out.head(print_leaf_head);
  const std::uint64_t num_faults = for_each_listed(
      store, command, [&](const LeafRow& row) { return out.add(row); }, faults);
  for (const Fault& fault : faults) out.put(fault);
  return num_faults + faults.size();
}

std::uint64_t list_queue(const Store& store, const InspectCommand& command) {
  std::vector<Fault> faults;
  std::uint64_t num_faults = 0;
  ListPrinter out(command);
  out.head(print_queue_head);
  const auto take = [&](const QueueRow& row) {
    num_faults += row.faults.size();
    return out.add(row);
  };
  scan_queue(store, take, faults);
  for (const Fault& fault : faults) out.put(fault);
  return num_faults + faults.size();
}

// Of a finished run: others may improve them yet.
void list_poor_cells(const Store& store, ListPrinter& out, std::vector<Fault>& faults) {
  const auto is_done = read_around(faults, [&] { return run_of(store).phase == Phase::kDone; });
  if (!is_done.value_or(false)) return;
  read_around(faults, [&] {
    for_each_poor_cell(store, [&](const LeafPoorCell& cell) { return out.add(cell); });
    return true;
  });
}

std::uint64_t list_unresolved(const Store& store, const InspectCommand& command) {
  std::vector<Fault> faults;
  std::uint64_t num_faults = 0;
  ListPrinter out(command);
  const auto take = [&](const LeafRow& row) {
    num_faults += row.faults.size();
    for (const Fault& fault : row.faults) out.put(fault);
    for (const UnresolvedSite& site : row.unresolved.sites)
      if (!out.add(LeafSite{row.key, site})) return false;
    return true;
  };
  scan_leaves(store, take, faults, {.reads_unresolved = true});
  if (num_faults == 0 && faults.empty() && !out.is_full()) list_poor_cells(store, out, faults);
  for (const Fault& fault : faults) out.put(fault);
  return num_faults + faults.size();
}

// -- Files to look at

void print_written(const InspectCommand& command, std::string_view what, std::uint64_t num,
                   std::uint64_t bytes, const std::vector<Fault>& faults) {
  const std::string file = command.vtu.string();
  if (command.is_json) {
    print_json({{"file", file},
                {fmt::format("num_{}", what), num},
                {"bytes", bytes},
                {"faults", to_json(faults)}});
    return;
  }
  fmt::print("{}: {} {}, {}\n", file, num, what, bytes_text(bytes));
  for (const Fault& fault : faults) fmt::print("{}\n", fault_text(fault));
}

std::uint64_t write_cells(const Store& store, const InspectCommand& command) {
  const auto [num_cells, bytes, faults] = write_leaf(store, *command.leaf, command.vtu);
  print_written(command, "cells", num_cells, bytes, faults);
  return faults.size();
}

std::uint64_t write_boxes(const Store& store, const InspectCommand& command) {
  const Frame frame = run_of(store).frame;
  std::vector<LeafRow> rows;
  std::vector<Fault> faults;
  const auto take = [&](const LeafRow& row) {
    if (command.listing.limit && rows.size() == *command.listing.limit) return false;
    rows.push_back(row);
    return true;
  };
  for_each_listed(store, command, take, faults);
  for (const LeafRow& row : rows) faults.insert(faults.end(), row.faults.begin(), row.faults.end());
  const std::uint64_t bytes = write_leaves_vtu(rows, frame, command.vtu);
  print_written(command, "leaves", rows.size(), bytes, faults);
  return faults.size();
}

std::uint64_t inspect_sizes(const Store& store, const InspectCommand& command) {
  const RunRecord run = run_of(store);
  if (!run.sizes.are_known())
    throw InputError(fmt::format(
        "the store {}: sizes {}", command.store.string(),
        run.parameters.sizes().is_uniform() ? "do not vary in this run" : "are not known yet"));
  if (!command.vtu.empty()) {
    const auto [num_cubes, bytes] = write_sizes_vtu(store.snapshot(), command.vtu);
    print_written(command, "cubes", num_cubes, bytes, {});
    return 0;
  }
  const SizeReport report = report_sizes(store.snapshot());
  if (command.is_json)
    print_json(to_json(report));
  else
    fmt::print("{}", sizes_text(report));
  return 0;
}

std::uint64_t inspect(const Store& store, const InspectCommand& command) {
  if (command.lists_sizes) return inspect_sizes(store, command);
  if (!command.vtu.empty())
    return command.leaf ? write_cells(store, command) : write_boxes(store, command);
  if (command.leaf)
    return inspect_leaf(store, *command.leaf, command.listing.limit, command.is_json);
  if (command.lists_leaves) return list_leaves(store, command);
  if (command.lists_queue) return list_queue(store, command);
  if (command.lists_unresolved) return list_unresolved(store, command);
  return inspect_summary(store, command.reads_all, command.is_json);
}

}  // namespace

int run_inspect(const InspectCommand& command) {
  if (!command.vtu.empty()) require_writable(command.vtu);
  const Store store = open_to_read(command.store);
  std::vector<Fault> faults;
  read_around(faults, [&] { return run_of(store); });  // refuses a store without a run
  for (const Fault& fault : faults) fmt::print(stderr, "locvol: error: {}\n", fault.message);
  const std::uint64_t num_faults = std::max<std::uint64_t>(faults.size(), inspect(store, command));
  if (num_faults == 0) return kExitDone;
  fmt::print(stderr, "locvol: error: the store {} is damaged in {} place{}\n",
             store.directory().string(), num_faults, num_faults == 1 ? "" : "s");
  return kExitError;
}

}  // namespace locvol
