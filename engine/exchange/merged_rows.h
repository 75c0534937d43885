// MergedRows brings rows, which each rank has in order, to the first rank in the order of all.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/pack.h"

namespace locvol {

// Rows come in ascending order; those of one order by rank.
using RowOrder = std::array<std::uint64_t, 3>;

// Row: has fields(), order() and num_bytes(). All ranks add their rows, in order, and finish. A
// rank that has as many as go into a message waits until the first one asks for them.
// Memory: kBytes and a row on each rank, and that for each rank on the first one.
template <class Row>
class MergedRows {
 public:
  // Called on the first rank alone; returns false if no more is wanted.
  using Visit = std::function<bool(Row&&)>;
  MergedRows(Exchange& exchange, Visit visit) : exchange_(exchange), visit_(std::move(visit)) {
    begin();
  }

  // False if no more is wanted.
  bool add(Row row) {
    if (is_over_) return false;
    if (num_ranks() == 1) return !(is_over_ = !visit_(std::move(row)));
    num_bytes_ += row.num_bytes();
    rows_.push_back(std::move(row));
    while (num_bytes_ >= kBytes && !is_over_) take_part();
    return !is_over_;
  }
  // Returns when all that is wanted of all ranks' has been visited; others may be added then.
  void finish() {
    while (!is_over_ && num_ranks() > 1) take_part();
    begin();
  }

 private:
  static constexpr std::size_t kBytes = std::size_t{1} << 17;
  static constexpr char kWanted = '1', kNotWanted = '0';

  // Rows that another rank has sent to the first one, which has not visited them.
  struct Source {
    std::vector<Row> rows;
    std::size_t place = 0;
  };

  std::size_t num_ranks() const { return static_cast<std::size_t>(exchange_.num_ranks()); }

  void begin() {
    is_over_ = false;
    num_bytes_ = 0;
    rows_.clear();
    if (exchange_.rank() == 0) wanted_.assign(num_ranks(), kWanted);
    sources_.assign(wanted_.size(), {});
    heads_.clear();
  }

  // The first rank says whose rows it has none of, and these send what they have, or if that is
  // nothing, have no more.
  void take_part() {
    const std::string wanted = exchange_.gather(wanted_).front();
    is_over_ = wanted.empty();
    if (is_over_) return;
    std::vector<std::vector<Row>> rows(num_ranks());
    if (wanted[static_cast<std::size_t>(exchange_.rank())] == kWanted) {
      rows.front() = std::exchange(rows_, {});
      num_bytes_ = 0;
    }
    rows = swap_lists(exchange_, std::move(rows));
    if (exchange_.rank() == 0) merge(std::move(rows));
  }

  // Visits rows until there are none of a rank that may have more.
  void merge(std::vector<std::vector<Row>> rows) {
    for (std::size_t rank = 0; rank < rows.size(); ++rank) {
      if (wanted_[rank] == kWanted) sources_[rank] = {std::move(rows[rank])};
      if (wanted_[rank] == kWanted && !sources_[rank].rows.empty()) put_head(rank);
      wanted_[rank] = kNotWanted;
    }
    while (!heads_.empty()) {
      const std::size_t rank = heads_.extract(heads_.begin()).value().second;
      Source& source = sources_[rank];
      if (!visit_(std::move(source.rows[source.place++]))) break;
      if (source.place == source.rows.size()) {
        wanted_[rank] = kWanted;
        return;
      }
      put_head(rank);
    }
    wanted_.clear();
  }

  void put_head(std::size_t rank) {
    const Source& source = sources_[rank];
    heads_.emplace(source.rows[source.place].order(), rank);
  }

  Exchange& exchange_;
  Visit visit_;
  bool is_over_ = false;
  std::vector<Row> rows_;  // to be sent
  std::size_t num_bytes_ = 0;
  // The first rank's wishes, by rank; empty: it wants no more.
  std::string wanted_;
  std::vector<Source> sources_;
  std::set<std::pair<RowOrder, std::size_t>> heads_;  // of sources: the next row's order, and rank
};

}  // namespace locvol
