// BoxTree finds which of many boxes are near a place: a binary tree over them. Internal to refine/.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "octree/geometry.h"

namespace locvol {

class BoxTree {
 public:
  BoxTree() = default;
  explicit BoxTree(std::vector<Box> boxes) : boxes_(std::move(boxes)), order_(boxes_.size()) {
    std::iota(order_.begin(), order_.end(), 0U);
    if (boxes_.empty()) return;
    nodes_.resize(2 * std::bit_ceil((boxes_.size() + kInLeaf - 1) / kInLeaf));
    build(0, 0, boxes_.size());
    std::vector<Box> ordered;
    ordered.reserve(boxes_.size());
    for (const std::uint32_t n : order_) ordered.push_back(boxes_[n]);
    boxes_.swap(ordered);
  }

  // Calls visit(n) for boxes closer to p than √squared, the nearer ones rather first. visit() may
  // make `squared` smaller on the way.
  template <class Visit>
  void for_each_within(const Point& p, double& squared, const Visit& visit) const {
    if (!boxes_.empty() && nodes_[0].squared_distance(p) < squared)
      descend(0, 0, boxes_.size(), p, squared, visit);
  }
  std::size_t bytes() const {
    return (boxes_.capacity() + nodes_.capacity()) * sizeof(Box) +
           order_.capacity() * sizeof(std::uint32_t);
  }

 private:
  static constexpr std::size_t kInLeaf = 4;

  // Halves at the middle of the longest side, by the boxes' centers. Node n has 2n + 1 and 2n + 2.
  void build(std::size_t node, std::size_t first, std::size_t end) {
    Box all = boxes_[order_[first]];
    for (std::size_t n = first; n < end; ++n) all = all.joined(boxes_[order_[n]]);
    nodes_[node] = all;
    if (end - first <= kInLeaf) return;
    const Point sides = all.max - all.min;
    const int axis = sides.x >= sides.y && sides.x >= sides.z ? 0 : sides.y >= sides.z ? 1 : 2;
    const std::size_t middle = middle_of(first, end);
    const auto at = [&](std::size_t n) { return order_.begin() + static_cast<std::ptrdiff_t>(n); };
    std::nth_element(at(first), at(middle), at(end), [&](std::uint32_t a, std::uint32_t b) {
      const double x = boxes_[a].center()[axis], y = boxes_[b].center()[axis];
      return x != y ? x < y : a < b;
    });
    build(2 * node + 1, first, middle);
    build(2 * node + 2, middle, end);
  }
  static std::size_t middle_of(std::size_t first, std::size_t end) {
    return first + (end - first + 1) / 2;
  }

  // REQUIRES: the node is closer than √squared
  template <class Visit>
  void descend(std::size_t node, std::size_t first, std::size_t end, const Point& p,
               double& squared, const Visit& visit) const {
    if (end - first <= kInLeaf) {
      for (std::size_t n = first; n < end; ++n)
        if (boxes_[n].squared_distance(p) < squared) visit(order_[n]);
      return;
    }
    const std::size_t middle = middle_of(first, end), low = 2 * node + 1, high = low + 1;
    const double of_low = nodes_[low].squared_distance(p),
                 of_high = nodes_[high].squared_distance(p);
    const bool is_low_first = of_low <= of_high;
    if (is_low_first && of_low < squared) descend(low, first, middle, p, squared, visit);
    if (of_high < squared) descend(high, middle, end, p, squared, visit);
    if (!is_low_first && of_low < squared) descend(low, first, middle, p, squared, visit);
  }

  std::vector<Box> boxes_;  // in the tree's order; nodes have ranges of them
  std::vector<std::uint32_t> order_;
  std::vector<Box> nodes_;
};

}  // namespace locvol
