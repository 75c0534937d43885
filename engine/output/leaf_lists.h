// LeafLists keeps a list for each leaf, of which memory needs not hold all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <type_traits>
#include <vector>

#include "engine/shared/partial_file.h"

namespace locvol {

template <class T>
struct LeafList {
  std::vector<T> values;
  std::size_t bytes() const { return sizeof *this + sizeof(T) * values.capacity(); }
};

// One after another in a nameless file. Memory: 8 bytes a leaf.
// Errors: std::system_error
template <class T>
class LeafLists {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  // `neighbor`: beside which the file is to be.
  explicit LeafLists(const std::filesystem::path& neighbor)
      : file_(OpenFile::temporary(neighbor)) {}
  void append(std::span<const T> list) {
    file_.write_at(sizeof(T) * size(), std::as_bytes(list));
    first_.push_back(size() + list.size());
  }
  std::uint64_t size() const { return first_.back(); }  // of all
  std::size_t num_leaves() const { return first_.size() - 1; }
  std::uint64_t first(std::size_t leaf) const { return first_[leaf]; }
  std::uint64_t length(std::size_t leaf) const { return first_[leaf + 1] - first_[leaf]; }
  LeafList<T> list(std::size_t leaf) const { return {read(first_[leaf], length(leaf))}; }
  std::vector<T> read(std::uint64_t from, std::uint64_t count) const {
    std::vector<T> values(count);
    file_.read_at(sizeof(T) * from, std::as_writable_bytes(std::span(values)));
    return values;
  }

 private:
  OpenFile file_;
  std::vector<std::uint64_t> first_{0};  // of each leaf, and the end
};

}  // namespace locvol
