// PartVertices numbers what the cells of one rank name, as a mesh by itself has it: vertices, or
// the nodes of second order.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "engine/output/number_range.h"

namespace locvol {

// Which vertices the cells of a rank name, by their numbers in the mesh of all.
// Memory: a bit for each own one, and 8 bytes for each of another rank.
class NamedVertices {
 public:
  // `own`: the rank's
  explicit NamedVertices(const NumberRange& own);

  // Of some cells, by any thread. Returns those of other ranks, for add_others().
  std::vector<std::uint64_t> add_own(std::span<const std::int64_t> named);
  void add_others(std::span<const std::uint64_t> others);

  // Ascending.
  std::vector<std::uint64_t> own_left_out();
  std::vector<std::uint64_t> others();

 private:
  void unite();

  NumberRange range_;
  std::vector<std::uint64_t> own_;  // 64 to a word
  std::vector<std::uint64_t> others_;
  std::size_t num_united_ = 0;
};

// Places from 0 on: the rank's own vertices that its cells name, in the order of their numbers, and
// then those of other ranks, likewise. A value. Memory: 32 bytes for each of the latter, and 8 for
// each own one that cells of other ranks alone name: these are at the border of the rank's share.
class PartVertices {
 public:
  // `positions_of`: of vertices of other ranks, which ascend
  using Position = std::array<double, 3>;
  PartVertices(
      const NumberRange& own, NamedVertices named,
      const std::function<std::vector<Position>(std::span<const std::uint64_t>)>& positions_of);

  std::uint64_t size() const { return num_own_ + others_.size(); }
  std::uint64_t num_own() const { return num_own_; }
  bool has_own(std::uint64_t number) const {
    return !std::ranges::binary_search(left_out_, number);
  }
  bool has(std::uint64_t number) const {
    return own_.first <= number && number < own_.end ? has_own(number)
                                                     : std::ranges::binary_search(others_, number);
  }
  // Of an own one; or, if it is left out, of the next one.
  std::uint64_t place_of_own(std::uint64_t number) const;
  // REQUIRES: there is one
  std::uint64_t place_of(std::uint64_t number) const;
  std::uint64_t number_of(std::uint64_t place) const;
  // The least and the largest number. REQUIRES: there is one
  std::pair<std::uint64_t, std::uint64_t> range() const;
  // Of those of other ranks, in order.
  std::span<const Position> other_positions() const { return other_positions_; }

 private:
  NumberRange own_;
  std::uint64_t num_own_;
  std::vector<std::uint64_t> left_out_, others_;
  std::vector<Position> other_positions_;
};

}  // namespace locvol
