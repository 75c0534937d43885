#include "tools/leaf_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace locvol {
namespace {

constexpr std::array kFields = {
    LeafField{"level", [](MortonKey key,
                          const LeafInfo&) { return static_cast<std::uint64_t>(key.level()); }},
    LeafField{"visits",
              [](MortonKey, const LeafInfo& info) -> std::uint64_t { return info.num_visits; }},
    LeafField{"points", [](MortonKey, const LeafInfo& info) { return info.num_points; }},
    LeafField{"cells", [](MortonKey, const LeafInfo& info) { return info.num_cells; }},
    LeafField{"core_points", [](MortonKey, const LeafInfo& info) { return info.num_core_points; }},
    LeafField{"core_cells", [](MortonKey, const LeafInfo& info) { return info.num_core_cells; }},
    LeafField{"triangles", [](MortonKey, const LeafInfo& info) { return info.num_triangles; }},
    LeafField{"insertions",
              [](MortonKey, const LeafInfo& info) {
                return std::reduce(info.num_insertions.begin(), info.num_insertions.end());
              }},
    LeafField{"deletions", [](MortonKey, const LeafInfo& info) { return info.num_deletions; }},
    LeafField{"moves", [](MortonKey, const LeafInfo& info) { return info.num_moves; }},
    LeafField{"unresolved", [](MortonKey, const LeafInfo& info) { return info.num_unresolved; }},
};

std::string field_names() {
  std::string names;
  for (const LeafField& field : kFields)
    names += fmt::format("{}{}", names.empty() ? "" : ", ", field.name);
  return names;
}

const LeafField* find_field(std::string_view name) {
  const auto field = std::ranges::find(kFields, name, &LeafField::name);
  return field == kFields.end() ? nullptr : &*field;
}

std::string without_spaces(const std::string& text) {
  std::string result;
  std::ranges::copy_if(text, std::back_inserter(result), [](char c) { return c != ' '; });
  return result;
}

std::function<bool(std::uint64_t, std::uint64_t)> comparison(std::string_view sign) {
  if (sign == "<") return std::less<>();
  if (sign == "<=") return std::less_equal<>();
  if (sign == "=" || sign == "==") return std::equal_to<>();
  if (sign == "!=") return std::not_equal_to<>();
  if (sign == ">=") return std::greater_equal<>();
  if (sign == ">") return std::greater<>();
  return nullptr;
}

}  // namespace

std::span<const LeafField> leaf_fields() { return kFields; }

bool LeafCondition::holds(const LeafRow& row) const {
  return !row.info || compare(field->value(row.key, *row.info), number);
}

LeafCondition parse_condition(const std::string& text) {
  const std::string_view signs = "<>=!";
  const std::string words = without_spaces(text);
  const std::size_t begin = words.find_first_of(signs);
  const std::size_t end = words.find_last_of(signs);
  if (begin != std::string::npos) {
    LeafCondition condition;
    condition.field = find_field(std::string_view(words).substr(0, begin));
    condition.compare = comparison(std::string_view(words).substr(begin, end - begin + 1));
    const char* const last = words.data() + words.size();
    const auto [stop, error] = std::from_chars(words.data() + end + 1, last, condition.number);
    if (condition.field && condition.compare && error == std::errc() && stop == last)
      return condition;
  }
  throw std::invalid_argument(
      fmt::format("'{}' is no condition: give a field, one of < <= = != >= >, and a whole number "
                  "(visits>2); fields are {}",
                  text, field_names()));
}

const LeafField* parse_sort(const std::string& text) {
  if (text == "key") return nullptr;
  if (const LeafField* field = find_field(text)) return field;
  throw std::invalid_argument(
      fmt::format("'{}' is nothing to sort by: give key, {}", text, field_names()));
}

LeafState parse_state(const std::string& text) {
  const auto state = std::ranges::find(kLeafStates, text, state_name);
  if (state != kLeafStates.end()) return *state;
  throw std::invalid_argument(fmt::format(
      "'{}' is no state: give clean, waiting, unvisited, core, empty or damaged", text));
}

bool LeafListing::shows(const LeafRow& row) const {
  return (!state || row.state() == *state) &&
         std::ranges::all_of(conditions, [&](const auto& c) { return c.holds(row); });
}

RowOrder LeafListing::order(const LeafRow& row) const {
  const LeafField* const field = sort.value_or(nullptr);
  const std::uint64_t key = row.key.bits(), is_damaged = row.info ? 0 : 1;
  if (is_streamed()) return {key};
  if (!field || !row.info) return {is_damaged, is_reversed ? ~key : key};
  const std::uint64_t value = field->value(row.key, *row.info);
  return {is_damaged, is_reversed ? value : ~value, key};
}

void SortedLeaves::add(const LeafRow& row) {
  rows_.push_back(row);
  constexpr std::uint64_t kSlack = 1024;
  if (listing_.limit &&
      rows_.size() > 2 * std::min(*listing_.limit, ~std::uint64_t{0} / 4) + kSlack)
    keep_first();
}

std::vector<LeafRow> SortedLeaves::take() {
  keep_first();
  return std::exchange(rows_, {});
}

void SortedLeaves::keep_first() {
  std::ranges::sort(rows_, {}, [&](const LeafRow& row) { return listing_.order(row); });
  if (listing_.limit && rows_.size() > *listing_.limit) rows_.resize(*listing_.limit);
}

}  // namespace locvol
