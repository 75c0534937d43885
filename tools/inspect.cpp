// `inspect`: what is in a store, or in those of all ranks of a run, as a whole, list by list or
// leaf by leaf. The run may go on meanwhile: nothing is printed while a snapshot is held. Damage is
// shown in its place.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/exchange/merged_rows.h"
#include "engine/inspect/crease_file.h"
#include "engine/inspect/crease_table.h"
#include "engine/inspect/leaf_report.h"
#include "engine/inspect/leaf_row_fields.h"
#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/run_part.h"
#include "engine/inspect/sheet_table.h"
#include "engine/run/leaf_queue.h"
#include "engine/shared/scratch_directory.h"
#include "tools/commands.h"
#include "tools/faces.h"
#include "tools/inspect_leaf.h"
#include "tools/inspect_summary.h"
#include "tools/results.h"
#include "tools/stored_run.h"
#include "tools/tell_user.h"

namespace locvol {

// A row of a list as it is printed: text, or an element of a JSON array.
struct PrintedRow {
  RowOrder place{};
  std::string text;
  bool is_counted = true;  // for the limit

  const RowOrder& order() const { return place; }
  std::size_t num_bytes() const { return sizeof(*this) + text.size(); }
};
auto fields(Maybe<PrintedRow> auto& row) {
  auto& [place, text, is_counted] = row;
  return std::tuple(Field("place", place), Field("text", text), Field("is_counted", is_counted));
}

// A leaf whose box goes into a file.
struct BoxedLeaf {
  RowOrder place{};
  LeafRow row;

  const RowOrder& order() const { return place; }
  std::size_t num_bytes() const { return sizeof(*this); }
};
auto fields(Maybe<BoxedLeaf> auto& leaf) {
  auto& [place, row] = leaf;
  return std::tuple(Field("place", place), Field("row", row));
}

namespace {

// -- Lists

Json to_json(const LeafRow& row) {
  Json json = {
      {"leaf", key_text(row.key)}, {"level", row.key.level()}, {"state", state_name(row.state())}};
  if (row.info) json.update(to_json(*row.info));
  if (!row.faults.empty()) json["faults"] = to_json(row.faults);
  return json;
}

std::string line_of(const Fault& fault) { return fmt::format("{}\n", fault_text(fault)); }

std::string lines_of(const std::vector<Fault>& faults) {
  std::string text;
  for (const Fault& fault : faults) text += "  " + line_of(fault);
  return text;
}

std::string leaf_head() {
  std::string text = fmt::format("{:<16} {:<9}", "leaf", "state");
  for (const LeafField& field : leaf_fields()) text += fmt::format(" {:>10}", field.name);
  return text + "\n";
}

std::string line_of(const LeafRow& row) {
  std::string text = fmt::format("{} {:<9}", key_text(row.key), state_name(row.state()));
  for (const LeafField& field : leaf_fields())
    if (row.info) text += fmt::format(" {:>10}", field.value(row.key, *row.info));
  return text + "\n" + lines_of(row.faults);
}

Json to_json(const QueueRow& row) {
  Json json = to_json(row.entry.position);
  json["leaf"] = key_text(row.entry.leaf);
  if (!row.faults.empty()) json["faults"] = to_json(row.faults);
  return json;
}

std::string queue_head() { return fmt::format("{:>6} {:>6} leaf\n", "epoch", "color"); }

std::string line_of(const QueueRow& row) {
  const auto& [epoch, color] = row.entry.position;
  return fmt::format("{:>6} {:>6} {}\n", epoch, color == kNoColor ? "-" : fmt::to_string(color),
                     key_text(row.entry.leaf)) +
         lines_of(row.faults);
}

RowOrder order_of(const QueueEntry& entry) {
  return {entry.position.epoch, entry.position.color, entry.leaf.bits()};
}

std::string line_of(const LeafSite& site) { return fmt::format("{}\n", site_text(site)); }

std::string line_of(const LeafPoorCell& cell) { return fmt::format("{}\n", poor_cell_text(cell)); }

// Prints the rows of all ranks, which each adds in order, up to a limit, as text or as elements of
// a JSON array.
class ListPrinter {
 public:
  ListPrinter(const RunPart& part, const InspectCommand& command)
      : part_(part),
        is_json_(command.is_json),
        limit_(command.listing.limit),
        rows_(part.exchange, [this](const PrintedRow& row) { return print(row); }) {
    if (is_json_ && part.is_first()) json_.emplace();
  }
  ListPrinter(const ListPrinter&) = delete;
  ListPrinter& operator=(const ListPrinter&) = delete;

  void head(const std::string& text) const {
    if (!is_json_ && part_.is_first()) fmt::print("{}", text);
  }
  bool is_full() const { return limit_ && std::max(num_added_, num_printed_) == *limit_; }
  // False if no more is wanted.
  template <class Row>
  bool add(const RowOrder& order, const Row& row) {
    if (is_full()) return false;
    ++num_added_;
    return rows_.add({order, text_of(row), true});
  }
  // Shown whatever the limit.
  void put(const RowOrder& order, const std::vector<Fault>& faults) {
    for (const Fault& fault : named(part_, faults)) rows_.add({order, text_of(fault), false});
  }
  // Others may be added then, and come behind these.
  void print_all() { rows_.finish(); }
  // Faults of no row come last.
  void finish(const std::vector<Fault>& faults) {
    print_all();
    put({}, faults);
    print_all();
  }

 private:
  template <class Row>
  std::string text_of(Row row) const {
    if constexpr (requires { row.faults; }) row.faults = named(part_, std::move(row.faults));
    return is_json_ ? json_line(to_json(row)) : line_of(row);
  }

  bool print(const PrintedRow& row) {
    if (row.is_counted && limit_ && num_printed_ == *limit_) return false;
    num_printed_ += row.is_counted ? 1 : 0;
    if (json_)
      json_->add(row.text);
    else
      fmt::print("{}", row.text);
    return true;
  }

  const RunPart& part_;
  bool is_json_;
  std::optional<std::uint64_t> limit_;
  std::uint64_t num_added_ = 0, num_printed_ = 0;  // by this rank; by the first one, of all
  std::optional<JsonArrayPrinter> json_;
  MergedRows<PrintedRow> rows_;
};

// Every leaf of the part that the listing shows, in its order. Counts faults of all leaves, shown
// or not.
std::uint64_t for_each_listed(const RunPart& part, const InspectCommand& command,
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
  scan_leaves(part, take, faults, {.reads_all = command.reads_all});
  for (const LeafRow& row : sorted.take())
    if (!visit(row)) break;
  return num_faults;
}

// Each returns how many faults this rank met.

std::uint64_t list_leaves(const RunPart& part, const InspectCommand& command) {
  std::vector<Fault> faults;
  ListPrinter out(part, command);
  out.head(leaf_head());
  const auto add = [&](const LeafRow& row) { return out.add(command.listing.order(row), row); };
  const std::uint64_t num_faults = for_each_listed(part, command, add, faults);
  out.finish(faults);
  return num_faults + faults.size();
}

std::uint64_t list_queue(const RunPart& part, const InspectCommand& command) {
  std::vector<Fault> faults;
  std::uint64_t num_faults = 0;
  ListPrinter out(part, command);
  out.head(queue_head());
  const auto take = [&](const QueueRow& row) {
    num_faults += row.faults.size();
    return out.add(order_of(row.entry), row);
  };
  scan_queue(part, take, faults);
  out.finish(faults);
  return num_faults + faults.size();
}

// Of a finished run: others may improve them yet.
void list_poor_cells(const RunPart& part, ListPrinter& out, std::vector<Fault>& faults) {
  const auto is_done =
      read_around(faults, [&] { return !part.store || run_of(*part.store).phase == Phase::kDone; });
  if (any(part.exchange, !is_done.value_or(false)) || !part.store) return;
  read_around(faults, [&] {
    for_each_poor_cell(*part.store,
                       [&](const LeafPoorCell& cell) { return out.add({cell.leaf.bits()}, cell); });
    return true;
  });
}

std::uint64_t list_unresolved(const RunPart& part, const InspectCommand& command) {
  std::vector<Fault> faults;
  std::uint64_t num_faults = 0;
  ListPrinter out(part, command);
  const auto take = [&](const LeafRow& row) {
    num_faults += row.faults.size();
    const RowOrder order = {row.key.bits()};
    out.put(order, row.faults);
    for (const UnresolvedSite& site : row.unresolved.sites)
      if (!out.add(order, LeafSite{row.key, site})) return false;
    return true;
  };
  scan_leaves(part, take, faults, {.reads_unresolved = true});
  out.print_all();
  if (!any(part.exchange, num_faults > 0 || !faults.empty() || out.is_full()))
    list_poor_cells(part, out, faults);
  out.finish(faults);
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

std::uint64_t write_cells(const RunPart& part, const InspectCommand& command) {
  const WrittenLeaf written = write_leaf(part, *command.leaf, command.vtu);
  if (part.is_first())
    print_written(command, "cells", written.num_cells, written.bytes, written.faults);
  return written.num_own_faults;
}

std::uint64_t write_boxes(const RunPart& part, const InspectCommand& command) {
  const Frame frame = run_of(part).frame;
  const auto is_full = [&](std::uint64_t num) {
    return command.listing.limit && num == *command.listing.limit;
  };
  std::vector<LeafRow> rows;  // of all ranks
  MergedRows<BoxedLeaf> boxes(part.exchange, [&](BoxedLeaf&& leaf) {
    if (is_full(rows.size())) return false;
    rows.push_back(std::move(leaf.row));
    return true;
  });
  std::vector<Fault> own_faults, faults_of_rows;
  std::uint64_t num_added = 0;
  const auto take = [&](const LeafRow& row) {
    if (is_full(num_added)) return false;
    ++num_added;
    faults_of_rows.insert(faults_of_rows.end(), row.faults.begin(), row.faults.end());
    return boxes.add({command.listing.order(row), row});
  };
  for_each_listed(part, command, take, own_faults);
  boxes.finish();
  own_faults.insert(own_faults.end(), faults_of_rows.begin(), faults_of_rows.end());
  const std::vector<Fault> faults = gather_named(part, own_faults);
  if (part.is_first())
    print_written(command, "leaves", rows.size(), write_leaves_vtu(rows, frame, command.vtu),
                  faults);
  return own_faults.size();
}

std::uint64_t inspect_sizes(const RunPart& part, const InspectCommand& command) {
  const RunRecord run = run_of(part);
  if (!run.sizes.are_known())
    throw InputError(fmt::format(
        "the store {}: sizes {}", command.store.string(),
        run.parameters.sizes().is_uniform() ? "do not vary in this run" : "are not known yet"));
  if (!command.vtu.empty()) {
    const auto [num_cubes, bytes] = write_sizes_vtu(part, run, command.vtu);
    if (part.is_first()) print_written(command, "cubes", num_cubes, bytes, {});
    return 0;
  }
  const SizeReport report = report_sizes(part, run);
  if (!part.is_first()) return 0;
  if (command.is_json)
    print_json(to_json(report));
  else
    fmt::print("{}", sizes_text(report));
  return 0;
}

std::uint64_t inspect_faces(const RunPart& part, const InspectCommand& command) {
  constexpr std::uint64_t kMostRows = 100;
  check_on_all(part.exchange, [&] {
    if (!part.store) throw StoreError(part.name() + "the store cannot be opened");
  });
  const SheetTable table = sheet_table(*part.store, temporary_directory() / "faces", nullptr,
                                       part.is_of_ranks() ? part.exchange : alone());
  if (!part.is_first()) return 0;
  if (command.is_json)
    print_json(to_json(table));
  else
    fmt::print("{}", sheet_table_text(table, command.listing.limit.value_or(kMostRows)));
  return 0;
}

std::uint64_t inspect_creases(const RunPart& part, const InspectCommand& command) {
  const RunRecord run = run_of(part);
  if (!command.vtu.empty()) {
    const auto [num_edges, num_corners, bytes] = write_creases_vtu(part, run, command.vtu);
    if (part.is_first()) print_written(command, "edges", num_edges, bytes, {});
    return 0;
  }
  std::optional<CreaseTable> kept;
  if (run.phase == Phase::kDone && !any(part.exchange, !part.store))
    kept = crease_table(*part.store, nullptr, part.is_of_ranks() ? part.exchange : alone());
  if (!part.is_first() || !part.store) return 0;  // each knows all
  const SurfaceSheets sheets = part.store->snapshot().sheets();
  if (!command.is_json) {
    fmt::print("{}", crease_list_text(sheets, command.listing.limit, kept ? &*kept : nullptr));
    return 0;
  }
  Json json = {{"creases", creases_json(sheets)}, {"num_corners", sheets.num_corners}};
  if (kept) add_kept_creases(sheets, *kept, json);
  print_json(json);
  return 0;
}

std::uint64_t inspect(const RunPart& part, const InspectCommand& command) {
  if (command.lists_creases) return inspect_creases(part, command);
  if (command.lists_sizes) return inspect_sizes(part, command);
  if (command.lists_faces) return inspect_faces(part, command);
  if (!command.vtu.empty())
    return command.leaf ? write_cells(part, command) : write_boxes(part, command);
  if (command.leaf)
    return inspect_leaf(part, *command.leaf, command.listing.limit, command.is_json);
  if (command.lists_leaves) return list_leaves(part, command);
  if (command.lists_queue) return list_queue(part, command);
  if (command.lists_unresolved) return list_unresolved(part, command);
  return inspect_summary(part, command.reads_all, command.is_json);
}

// Called by all ranks; `faults`: what was found when it was opened. Returns the exit code.
int tell_inspected(const RunPart& part, std::vector<Fault> faults, const InspectCommand& command,
                   std::string_view program) {
  if (part.store) read_around(faults, [&] { return run_of(*part.store); });
  for (const Fault& fault : gather_named(part, faults))
    if (part.is_first()) tell_user("{}: error: {}\n", program, fault.message);
  const std::uint64_t num_faults = std::max<std::uint64_t>(faults.size(), inspect(part, command));
  std::string damage;
  if (num_faults > 0)
    damage =
        fmt::format("{}: error: {}the store {} is damaged in {} place{}\n", program, part.name(),
                    part.directory.string(), num_faults, num_faults == 1 ? "" : "s");
  int code = kExitDone;
  for (const std::string& of_rank : part.exchange.gather(damage)) {
    if (!of_rank.empty()) code = kExitError;
    if (part.is_first()) tell_user("{}", of_rank);
  }
  return code;
}

}  // namespace

int run_inspect(const InspectCommand& command) {
  if (!command.vtu.empty()) require_writable(command.vtu);
  return tell_inspected(whole_run(open_to_read(command.store)), {}, command, "locvol");
}

int run_inspect_as_rank(const InspectCommand& command, Exchange& exchange) {
  if (exchange.rank() == 0 && !command.vtu.empty()) require_writable(command.vtu);
  std::vector<Fault> faults;
  const RunPart part = part_of_rank(command.store, exchange, faults);
  return tell_inspected(part, std::move(faults), command, "locvol-mpi");
}

}  // namespace locvol
