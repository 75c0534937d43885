#include "engine/inspect/leaf_scan.h"

#include <stdexcept>
#include <utility>

#include "engine/shared/lattice_of_run.h"
#include "engine/shared/leaf_name.h"

namespace locvol {
namespace {

constexpr std::size_t kPieceLeaves = 1024;    // some milliseconds
constexpr std::size_t kFullPieceLeaves = 16;  // with all their records

// The least key above `key`; invalid after the last.
MortonKey after(MortonKey key) { return MortonKey::from_bits(key.bits() + 1); }

void expect_count(LeafRow& row, const char* what, std::uint64_t found, std::uint64_t counted) {
  if (found == counted) return;
  row.faults.push_back({row.key, leaf_name(row.key) + ": its record holds " +
                                     std::to_string(found) + " " + what + ", but it counts " +
                                     std::to_string(counted)});
}

void check_core_points(const LatticeCore& core, const RunRecord& run, LeafRow& row) {
  const SiteBox sites = lattice_of(run).sites_in(run.frame.box(row.key));
  try {
    check_core(core, sites);
    expect_count(row, "core points", num_points(core, sites), row.info->num_core_points);
  } catch (const std::invalid_argument& e) {
    row.faults.push_back({row.key, leaf_name(row.key) + ": " + e.what()});
  }
}

// Reads every record of the leaf, and compares with what the leaf counts.
void read_all(const Reader& reader, const std::optional<RunRecord>& run, LeafRow& row) {
  const MortonKey key = row.key;
  const auto points = read_around(row.faults, [&] { return reader.points(key); });
  const auto cells = read_around(row.faults, [&] { return reader.cells(key); });
  const auto surface = read_around(row.faults, [&] { return reader.surface(key); });
  if (!row.info) return;
  const LeafInfo& info = *row.info;
  if (points) expect_count(row, "points", points->points.size(), info.num_points);
  if (points && run) check_core_points(points->core, *run, row);
  if (cells) expect_count(row, "cells", cells->cells.size(), info.num_cells);
  if (surface) expect_count(row, "triangles", surface->size(), info.num_triangles);
}

LeafRow read_row(const Reader& reader, const std::optional<RunRecord>& run, MortonKey key,
                 const ScanOptions& options) {
  LeafRow row{.key = key, .info = {}, .unresolved = {}, .faults = {}};
  row.info = read_around(row.faults, [&] { return reader.leaf(key); }).value_or(std::nullopt);
  if (options.reads_all) read_all(reader, run, row);
  if (options.reads_all || options.reads_unresolved) {
    const auto unresolved = read_around(row.faults, [&] { return reader.unresolved(key); });
    if (unresolved) row.unresolved = *unresolved;
    if (unresolved && row.info)
      expect_count(row, "unresolved sites", unresolved->sites.size(), row.info->num_unresolved);
  }
  return row;
}

struct Piece {
  std::vector<LeafRow> rows;
  std::optional<MortonKey> next;  // where to go on; nothing at the end
};

Piece read_piece(const Reader& reader, MortonKey from, std::vector<Fault>& faults,
                 const ScanOptions& options) {
  const std::size_t max = options.reads_all ? kFullPieceLeaves : kPieceLeaves;
  const std::vector<MortonKey> keys = reader.leaf_keys(from, max);
  std::optional<RunRecord> run;  // whoever shows the run reports its damage
  if (options.reads_all) {
    std::vector<Fault> ignored;
    run = read_around(ignored, [&] { return reader.run(); }).value_or(std::nullopt);
  }
  Piece piece;
  MortonKey next = from;
  for (const MortonKey key : keys) {
    if (key < next) {
      faults.push_back({key, leaf_name(key) + ": lies within another leaf"});
      continue;
    }
    next = after(key);
    if (!key.is_valid()) {
      faults.push_back({MortonKey(), leaf_name(key) + ": this is no key of a leaf"});
      continue;
    }
    piece.rows.push_back(read_row(reader, run, key, options));
    // What its children are, if it is split before the next piece, has been shown. But a damaged
    // record may have a damaged key.
    if (piece.rows.back().info) next = after(key.range_max());
  }
  if (keys.size() == max && next != MortonKey()) piece.next = next;
  return piece;
}

std::vector<QueueRow> read_queue_piece(const Reader& reader, const QueueEntry& from) {
  std::vector<QueueRow> rows;
  for (const QueueEntry& entry : reader.queue_keys(from, kPieceLeaves)) {
    QueueRow row{.entry = entry, .faults = {}};
    read_around(row.faults, [&] { return reader.has_queue_entry(entry); });
    rows.push_back(std::move(row));
  }
  return rows;
}

void collect_within(const Reader& reader, const Frame& frame, MortonKey node, const Box& box,
                    double squared, std::vector<MortonKey>& found) {
  if (frame.box(node).squared_distance(box) > squared) return;
  const auto first = reader.leaf_keys(node.range_min(), 1);
  if (first.empty() || first[0] > node.range_max()) return;
  if (first[0] == node) return found.push_back(node);
  if (node.level() == MortonKey::kMaxLevel) return;
  for (int octant = 0; octant < 8; ++octant)
    collect_within(reader, frame, node.child(octant), box, squared, found);
}

}  // namespace

std::string_view state_name(LeafState state) {
  switch (state) {
    case LeafState::kDamaged:
      return "damaged";
    case LeafState::kEmpty:
      return "empty";
    case LeafState::kCore:
      return "core";
    case LeafState::kUnvisited:
      return "unvisited";
    case LeafState::kWaiting:
      return "waiting";
    case LeafState::kClean:
      return "clean";
  }
  return "unknown";
}

LeafState LeafRow::state() const {
  if (!info || !faults.empty()) return LeafState::kDamaged;
  if (info->num_points == 0 && !info->queued)
    return info->num_core_points == 0 ? LeafState::kEmpty : LeafState::kCore;
  if (info->num_visits == 0) return LeafState::kUnvisited;
  return info->queued ? LeafState::kWaiting : LeafState::kClean;
}

void scan_leaves(const Store& store, const std::function<bool(const LeafRow&)>& visit,
                 std::vector<Fault>& faults, const ScanOptions& options) {
  for (std::optional<MortonKey> from = MortonKey(); from;) {
    const auto piece =
        read_around(faults, [&] { return read_piece(store.snapshot(), *from, faults, options); });
    if (!piece) return;  // a key that cannot be passed
    if (options.reads_all) store.release_pages();
    for (const LeafRow& row : piece->rows)
      if (!visit(row)) return;
    from = piece->next;
  }
}

void scan_queue(const Store& store, const std::function<bool(const QueueRow&)>& visit,
                std::vector<Fault>& faults) {
  QueueEntry from;
  for (bool is_last = false; !is_last;) {
    const auto rows = read_around(faults, [&] { return read_queue_piece(store.snapshot(), from); });
    if (!rows) return;
    is_last = rows->size() < kPieceLeaves;
    if (!is_last) from = {rows->back().entry.position, after(rows->back().entry.leaf)};
    for (const QueueRow& row : *rows)
      if (!visit(row)) return;
  }
}

std::optional<MortonKey> leaf_holding(const Reader& reader, const Frame& frame, const Point& p) {
  if (!frame.contains(p)) return std::nullopt;
  for (int level = 0; level <= MortonKey::kMaxLevel; ++level) {
    const MortonKey node = frame.key_of(p, level);
    const auto first = reader.leaf_keys(node, 1);
    if (!first.empty() && first[0] == node) return node;
  }
  return std::nullopt;
}

std::vector<MortonKey> stored_leaves_within(const Reader& reader, const Frame& frame,
                                            const Box& box, double distance) {
  std::vector<MortonKey> found;
  collect_within(reader, frame, MortonKey::root(), box, distance * distance, found);
  return found;
}

}  // namespace locvol
