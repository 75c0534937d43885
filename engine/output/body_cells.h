// How many cells each body of a mesh has, and in which leaves.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "octree/body_id.h"

namespace locvol {

// Cells of a body are numbered leaf by leaf, as all cells are; of several ranks, those of lower
// ones come first. Memory: 16 bytes for each leaf and each body that it has cells of.
class BodyCells {
 public:
  explicit BodyCells(std::size_t num_bodies) : num_own_(num_bodies) {}

  // Leaf after leaf: the bodies of its cells.
  void append_leaf(std::span<const BodyId> cells) {
    std::map<BodyId, std::uint64_t> num;
    for (const BodyId body : cells) ++num[body];
    first_.push_back(in_leaves_.size());
    for (const auto& [body, count] : num) {
      in_leaves_.push_back({body, num_own_.at(body - 1)});
      num_own_[body - 1] += count;
    }
  }
  std::span<const std::uint64_t> num_own() const { return num_own_; }  // by body
  void set_ranks(std::vector<std::uint64_t> all, std::vector<std::uint64_t> before) {
    all_ = std::move(all);
    before_ = std::move(before);
  }

  std::uint64_t num_of(BodyId body) const { return all_[body - 1]; }  // of all ranks
  // The place of a leaf's first cell of the body among all of that. `leaf`: in the order of
  // append_leaf(). REQUIRES: the leaf has such a cell
  std::uint64_t place(std::size_t leaf, BodyId body) const {
    std::size_t n = first_[leaf];
    while (in_leaves_[n].body != body) ++n;
    return before_[body - 1] + in_leaves_[n].num_before;
  }

 private:
  struct InLeaf {
    BodyId body = kNoBody;
    std::uint64_t num_before = 0;  // of the body, in leaves before
  };
  std::vector<InLeaf> in_leaves_;
  std::vector<std::size_t> first_;                     // of a leaf
  std::vector<std::uint64_t> num_own_, all_, before_;  // by body
};

}  // namespace locvol
