// Which leaves a listing shows, and in what order.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/exchange/merged_rows.h"
#include "engine/inspect/leaf_scan.h"

namespace locvol {

// The states in the order that tables have.
inline constexpr std::array kLeafStates = {LeafState::kClean,     LeafState::kWaiting,
                                           LeafState::kUnvisited, LeafState::kCore,
                                           LeafState::kEmpty,     LeafState::kDamaged};

// A number that every leaf has: what a listing shows, sorts by and asks for.
struct LeafField {
  std::string_view name;
  std::uint64_t (*value)(MortonKey key, const LeafInfo& info);
};
std::span<const LeafField> leaf_fields();

// "visits>2": a field, one of < <= = != >= >, a whole number.
struct LeafCondition {
  const LeafField* field = nullptr;
  std::function<bool(std::uint64_t, std::uint64_t)> compare;
  std::uint64_t number = 0;
  bool holds(const LeafRow& row) const;  // of a leaf whose record is damaged: always
};

// Each parser throws std::invalid_argument with what can be given instead.
LeafCondition parse_condition(const std::string& text);
const LeafField* parse_sort(const std::string& text);  // null: "key"
LeafState parse_state(const std::string& text);

struct LeafListing {
  std::vector<LeafCondition> conditions;  // all must hold
  std::optional<LeafState> state;
  std::optional<const LeafField*> sort;  // null: by key
  bool is_reversed = false;
  std::optional<std::uint64_t> limit;

  bool shows(const LeafRow& row) const;
  // Leaves come from scan_leaves() in Morton order, so no leaf has to wait for others.
  bool is_streamed() const { return !is_reversed && !sort.value_or(nullptr); }
  // Counts descend, keys ascend, unless reversed. Among equals, by key. Damaged leaves come last,
  // but in their place where leaves are streamed.
  RowOrder order(const LeafRow& row) const;
};

// Keeps the first `limit` leaves in the order of a listing; memory is bounded by that number.
class SortedLeaves {
 public:
  explicit SortedLeaves(const LeafListing& listing) : listing_(listing) {}
  void add(const LeafRow& row);
  std::vector<LeafRow> take();  // in order

 private:
  void keep_first();

  const LeafListing& listing_;
  std::vector<LeafRow> rows_;
};

}  // namespace locvol
