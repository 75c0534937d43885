// BySheet keeps records of sheets, or of creases, in a nameless file, those of each sheet one after
// another.
#pragma once

#include <cstdint>
#include <filesystem>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/pack.h"
#include "engine/shared/partial_file.h"
#include "engine/shared/sorted_spill.h"
#include "octree/mesh_facet.h"
#include "storage/store_error.h"

namespace locvol {

// Records come with append(), and are there after finish(), which all ranks call; of a sheet they
// are in the order in which they came.
// Memory: that of SortedSpill, and 24 bytes a sheet. Errors: std::system_error; StoreError if a
// record is of an unknown sheet.
template <class Record>
class BySheet {
 public:
  // `neighbor`: beside which the file is to be.
  BySheet(const std::filesystem::path& neighbor, std::size_t num_sheets)
      : file_(OpenFile::temporary(neighbor)),
        waiting_(neighbor.has_parent_path() ? neighbor.parent_path() : "."),
        first_(num_sheets + 1) {}

  void append(SheetId sheet, const Record& record) {
    if (sheet == 0 || sheet >= first_.size())
      throw StoreError(
          "the store is damaged: what the boundary has is of a sheet or crease that is not known");
    ++first_[sheet];
    waiting_->append({sheet, waiting_->size(), record});
  }

  void finish(Exchange& exchange) {
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    waiting_->finish();
    std::vector<Record> some;
    for (std::uint64_t written = 0; !waiting_->is_empty();
         written += std::exchange(some, {}).size()) {
      for (; !waiting_->is_empty() && some.size() < kWrittenAtOnce; waiting_->pop())
        some.push_back(waiting_->front().record);
      file_.write_at(sizeof(Record) * written, std::as_bytes(std::span(some)));
    }
    waiting_.reset();
    std::vector<std::uint64_t> own;
    for (std::size_t sheet = 1; sheet < first_.size(); ++sheet)
      own.push_back(first_[sheet] - first_[sheet - 1]);
    of_ranks_.resize(own.size());
    int rank = 0;
    for (const std::vector<std::uint64_t>& of_rank : gather_values(exchange, own)) {
      for (std::size_t s = 0; s < own.size(); ++s) {
        of_ranks_[s].all += of_rank[s];
        if (rank < exchange.rank()) of_ranks_[s].before += of_rank[s];
      }
      ++rank;
    }
  }

  // Of a sheet: this rank's records, and how many all and lower ranks have.
  std::uint64_t num_own(SheetId sheet) const { return first_[sheet] - first_[sheet - 1]; }
  const SumOfRanks& of_ranks(SheetId sheet) const { return of_ranks_[sheet - 1]; }
  // Some of this rank's. REQUIRES: from + count <= num_own(sheet)
  std::vector<Record> read(SheetId sheet, std::uint64_t from, std::uint64_t count) const {
    std::vector<Record> records(count);
    file_.read_at(sizeof(Record) * (first_[sheet - 1] + from),
                  std::as_writable_bytes(std::span(records)));
    return records;
  }

 private:
  static constexpr std::size_t kWrittenAtOnce = std::size_t{1} << 14;
  struct Waiting {
    SheetId sheet = 0;
    std::uint64_t number = 0;
    Record record;
    std::pair<SheetId, std::uint64_t> key() const { return {sheet, number}; }
  };

  OpenFile file_;
  std::optional<SortedSpill<Waiting, &Waiting::key>> waiting_;
  std::vector<std::uint64_t> first_;  // of each sheet, and the end
  std::vector<SumOfRanks> of_ranks_;
};

}  // namespace locvol
