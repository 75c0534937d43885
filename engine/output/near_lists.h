// NearLists keeps a list for each of a rank's leaves, and has those of leaves beside them: for what
// is found in one leaf and belongs to another.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/output/leaf_lists.h"
#include "engine/output/leaf_window.h"
#include "engine/output/vertex_numbering.h"

namespace locvol {

// In a nameless file. Memory: 8 bytes a leaf, 64 a leaf of another rank beside, and `window_bytes`.
// Threads: used by one at a time. Errors: std::system_error; ExchangeError
template <class T>
class NearLists {
  static_assert(sizeof(T) % sizeof(std::uint64_t) == 0);

 public:
  // The numbering must outlive it.
  NearLists(const VertexNumbering& numbering, const std::filesystem::path& neighbor,
            std::size_t window_bytes)
      : numbering_(numbering),
        lists_(neighbor),
        window_(window_bytes, [this](std::size_t list) { return lists_.list(list); }) {}
  NearLists(const NearLists&) = delete;
  NearLists& operator=(const NearLists&) = delete;

  void append(std::span<const T> of_next_leaf) { lists_.append(of_next_leaf); }
  // Once all own leaves have theirs: all ranks tell them to those within kCellReach.
  void tell(const Reader& reader, Exchange& exchange) {
    numbering_.tell_ranks_beside(
        reader, exchange, kCellReach,
        [&](std::size_t leaf) {
          const std::vector<T> list = own(leaf);
          std::vector<std::uint64_t> values(sizeof(T) / sizeof(std::uint64_t) * list.size());
          std::ranges::copy(std::as_bytes(std::span(list)),
                            std::as_writable_bytes(std::span(values)).begin());
          return values;
        },
        [&](std::size_t leaf, const std::vector<std::uint64_t>& values) {
          std::vector<T> list(values.size() * sizeof(std::uint64_t) / sizeof(T));
          std::ranges::copy(std::as_bytes(std::span(values)),
                            std::as_writable_bytes(std::span(list)).begin());
          beside_[leaf] = lists_.num_leaves();
          lists_.append(list);
        });
  }

  std::uint64_t size() const { return lists_.size(); }  // of all
  bool has_some(std::size_t leaf) const {               // REQUIRES: it is an own one, as in own()
    return lists_.length(leaf - numbering_.first_own()) > 0;
  }
  std::vector<T> own(std::size_t leaf) const {
    return lists_.list(leaf - numbering_.first_own()).values;
  }
  // Of an own leaf, or one beside; of others it is empty. Safe from many threads.
  std::vector<T> of(std::size_t leaf) const {
    const auto list = place_of(leaf);
    return list ? lists_.list(*list).values : std::vector<T>();
  }
  // Calls visit(list) for those within kCellReach of an own leaf, itself among them, that are not
  // empty; in Morton order.
  template <class Visit>
  void for_each_near(std::size_t leaf, const Visit& visit) {
    if (lists_.size() == 0) return;
    for (const std::size_t other : numbering_.near(leaf, kCellReach))
      if (const auto list = place_of(other); list && lists_.length(*list) > 0)
        visit(std::span<const T>(window_.get(*list)->values));
  }

 private:
  std::optional<std::size_t> place_of(std::size_t leaf) const {
    if (numbering_.first_own() <= leaf && leaf < numbering_.end_own())
      return leaf - numbering_.first_own();
    const auto beside = beside_.find(leaf);
    return beside == beside_.end() ? std::nullopt : std::optional(beside->second);
  }

  const VertexNumbering& numbering_;
  LeafLists<T> lists_;  // of own leaves, and then of those beside them
  std::map<std::size_t, std::size_t> beside_;
  LeafWindow<LeafList<T>> window_;
};

}  // namespace locvol
