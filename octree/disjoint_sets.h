// Disjoint sets of 0 … n - 1, each named by the smallest of its members.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace locvol {

// 4 bytes a member. REQUIRES: n < 2³²
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t n = 0) { reset(n); }
  // Each is alone.
  void reset(std::size_t n) {
    parents_.resize(n);
    std::iota(parents_.begin(), parents_.end(), 0U);
  }
  std::size_t num_members() const { return parents_.size(); }
  // The name of the set that i is in.
  std::size_t find(std::size_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  void unite(std::size_t i, std::size_t j) {
    i = find(i);
    j = find(j);
    parents_[std::max(i, j)] = static_cast<std::uint32_t>(std::min(i, j));
  }

 private:
  std::vector<std::uint32_t> parents_;
};

}  // namespace locvol
