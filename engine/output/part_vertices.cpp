#include "engine/output/part_vertices.h"

#include <atomic>

#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr std::uint64_t kBits = 64;                       // of a word
constexpr std::size_t kNewOthers = std::size_t{1} << 17;  // before they are united again

std::uint64_t bit(std::uint64_t place) { return std::uint64_t{1} << place % kBits; }

}  // namespace

NamedVertices::NamedVertices(const NumberRange& own)
    : range_(own), own_((own.size() + kBits - 1) / kBits) {}

std::vector<std::uint64_t> NamedVertices::add_own(std::span<const std::int64_t> named) {
  std::vector<std::uint64_t> others;
  for (const std::int64_t vertex : named) {
    const auto number = static_cast<std::uint64_t>(vertex);
    if (number < range_.first || number >= range_.end) {
      others.push_back(number);
      continue;
    }
    const std::uint64_t place = number - range_.first;
    const std::atomic_ref word(own_[place / kBits]);
    if ((word.load(std::memory_order_relaxed) & bit(place)) == 0)
      word.fetch_or(bit(place), std::memory_order_relaxed);
  }
  return others;
}

void NamedVertices::add_others(std::span<const std::uint64_t> others) {
  others_.insert(others_.end(), others.begin(), others.end());
  if (others_.size() > 2 * num_united_ + kNewOthers) unite();
}

void NamedVertices::unite() {
  sort_and_unite(others_);
  num_united_ = others_.size();
}

std::vector<std::uint64_t> NamedVertices::own_left_out() {
  std::vector<std::uint64_t> left_out;
  for (std::uint64_t place = 0; place < range_.size(); ++place)
    if ((own_[place / kBits] & bit(place)) == 0) left_out.push_back(range_.first + place);
  return left_out;
}

std::vector<std::uint64_t> NamedVertices::others() {
  unite();
  return others_;
}

PartVertices::PartVertices(
    const NumberRange& own, NamedVertices named,
    const std::function<std::vector<Position>(std::span<const std::uint64_t>)>& positions_of)
    : own_(own),
      left_out_(named.own_left_out()),
      others_(named.others()),
      other_positions_(positions_of(others_)) {
  num_own_ = own_.size() - left_out_.size();
}

std::uint64_t PartVertices::place_of_own(std::uint64_t number) const {
  const auto next = std::ranges::lower_bound(left_out_, number);
  return number - own_.first - static_cast<std::uint64_t>(next - left_out_.begin());
}

std::uint64_t PartVertices::place_of(std::uint64_t number) const {
  if (own_.first <= number && number < own_.end) return place_of_own(number);
  const auto other = std::ranges::lower_bound(others_, number);
  return num_own_ + static_cast<std::uint64_t>(other - others_.begin());
}

std::uint64_t PartVertices::number_of(std::uint64_t place) const {
  if (place >= num_own_) return others_[place - num_own_];
  // Those that are left out before it have places up to its own.
  const auto next = std::ranges::upper_bound(
      left_out_, place, {}, [&](std::uint64_t number) { return place_of_own(number); });
  return own_.first + place + static_cast<std::uint64_t>(next - left_out_.begin());
}

std::pair<std::uint64_t, std::uint64_t> PartVertices::range() const {
  if (num_own_ == 0) return {others_.front(), others_.back()};
  const std::uint64_t first = number_of(0), last = number_of(num_own_ - 1);
  if (others_.empty()) return {first, last};
  return {std::min(first, others_.front()), std::max(last, others_.back())};
}

}  // namespace locvol
