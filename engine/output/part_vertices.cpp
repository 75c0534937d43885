#include "engine/output/part_vertices.h"

#include <atomic>

#include "engine/shared/leaf_name.h"
#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr std::uint64_t kBits = 64;                       // of a word
constexpr std::size_t kNewOthers = std::size_t{1} << 17;  // before they are united again

std::uint64_t bit(std::uint64_t place) { return std::uint64_t{1} << place % kBits; }

}  // namespace

NamedVertices::NamedVertices(const VertexNumbering& numbering)
    : first_own_(numbering.first_vertex(numbering.first_own())),
      end_own_(numbering.first_vertex(numbering.end_own())),
      own_((end_own_ - first_own_ + kBits - 1) / kBits) {}

std::vector<std::uint64_t> NamedVertices::add_own(
    std::span<const std::array<std::int64_t, 4>> cells) {
  std::vector<std::uint64_t> others;
  for (const auto& cell : cells)
    for (const std::int64_t vertex : cell) {
      const auto number = static_cast<std::uint64_t>(vertex);
      if (number < first_own_ || number >= end_own_) {
        others.push_back(number);
        continue;
      }
      const std::uint64_t place = number - first_own_;
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
  for (std::uint64_t place = 0; place < end_own_ - first_own_; ++place)
    if ((own_[place / kBits] & bit(place)) == 0) left_out.push_back(first_own_ + place);
  return left_out;
}

std::vector<std::uint64_t> NamedVertices::others() {
  unite();
  return others_;
}

PartVertices::PartVertices(const Reader& reader, const VertexNumbering& numbering,
                           NamedVertices named)
    : first_own_(numbering.first_vertex(numbering.first_own())),
      end_own_(numbering.first_vertex(numbering.end_own())),
      left_out_(named.own_left_out()),
      others_(named.others()) {
  num_own_ = end_own_ - first_own_ - left_out_.size();
  other_positions_.reserve(others_.size());
  for (auto other = others_.begin(); other != others_.end();) {
    const std::size_t leaf = numbering.leaf_of(*other);
    const auto first = other;
    std::uint64_t number = numbering.first_vertex(leaf);
    numbering.for_each_vertex(reader, leaf, [&](const Point& p) {
      if (other == others_.end() || *other != number++) return;
      other_positions_.push_back({p.x, p.y, p.z});
      ++other;
    });
    const MortonKey key = numbering.leaves()[leaf];
    if (other == first)
      throw CorruptRecord(leaf_name(key) + ": it has fewer vertices than its rank has told", key);
  }
}

std::uint64_t PartVertices::place_of_own(std::uint64_t number) const {
  const auto next = std::ranges::lower_bound(left_out_, number);
  return number - first_own_ - static_cast<std::uint64_t>(next - left_out_.begin());
}

std::uint64_t PartVertices::place_of(std::uint64_t number) const {
  if (first_own_ <= number && number < end_own_) return place_of_own(number);
  const auto other = std::ranges::lower_bound(others_, number);
  return num_own_ + static_cast<std::uint64_t>(other - others_.begin());
}

std::uint64_t PartVertices::number_of(std::uint64_t place) const {
  if (place >= num_own_) return others_[place - num_own_];
  // Those that are left out before it have places up to its own.
  const auto next = std::ranges::upper_bound(
      left_out_, place, {}, [&](std::uint64_t number) { return place_of_own(number); });
  return first_own_ + place + static_cast<std::uint64_t>(next - left_out_.begin());
}

std::pair<std::uint64_t, std::uint64_t> PartVertices::range() const {
  if (num_own_ == 0) return {others_.front(), others_.back()};
  const std::uint64_t first = number_of(0), last = number_of(num_own_ - 1);
  if (others_.empty()) return {first, last};
  return {std::min(first, others_.front()), std::max(last, others_.back())};
}

}  // namespace locvol
