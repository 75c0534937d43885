// SortedSpill sorts more records than memory holds: runs of them, each sorted, are merged from a
// nameless temporary file.
//
// Records come with append(), then, after finish(), go in ascending order from front() and pop().
// Memory: 8 MB; from 2,000 runs of 8 MB on, 4 KB for each.
// Errors: std::system_error, "cannot write NAME: REASON", where the disk fails or is full.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/shared/partial_file.h"

namespace locvol {

// Sorts records by their keys, std::invoke(kKey, record), which are different for all records, so
// that their order is one.
template <class Record, auto kKey = std::identity()>
class SortedSpill {
  static_assert(std::is_trivially_copyable_v<Record>);

 public:
  // The file is made in `directory`, which must exist, when it is first needed.
  explicit SortedSpill(std::filesystem::path directory) : directory_(std::move(directory)) {}

  std::uint64_t size() const { return size_; }
  void append(const Record& record) {
    if (waiting_.size() == kRunRecords) flush();
    waiting_.push_back(record);
    ++size_;
  }
  void finish() {
    if (runs_.empty()) {  // all are in memory
      sort_waiting();
      runs_.push_back({.buffer = std::move(waiting_)});
    } else {
      flush();
      waiting_ = {};
      const std::size_t num = std::max<std::size_t>(kRunRecords / runs_.size(), kLeastRecords);
      for (Run& run : runs_) load(run, num);
    }
    for (std::size_t run = 0; run < runs_.size(); ++run)
      if (!runs_[run].is_over()) order_.push_back(run);
    std::ranges::make_heap(order_, comes_later());
  }

  bool is_empty() const { return order_.empty(); }
  const Record& front() const { return runs_[order_.front()].front(); }  // REQUIRES: !is_empty()
  void pop() {
    std::ranges::pop_heap(order_, comes_later());
    Run& run = runs_[order_.back()];
    if (++run.next == run.buffer.size()) load(run, run.buffer.size());
    if (run.is_over())
      order_.pop_back();
    else
      std::ranges::push_heap(order_, comes_later());
  }

 private:
  static constexpr std::size_t kRunRecords = (std::size_t{8} << 20) / sizeof(Record);
  static constexpr std::size_t kLeastRecords = (std::size_t{4} << 10) / sizeof(Record) + 1;

  struct Run {
    std::uint64_t begin = 0, end = 0;  // of what is not in the buffer: records in the file
    std::vector<Record> buffer = {};
    std::size_t next = 0;  // in the buffer

    bool is_over() const { return next == buffer.size(); }
    const Record& front() const { return buffer[next]; }
  };

  auto comes_later() const {
    return [this](std::size_t a, std::size_t b) {
      return std::invoke(kKey, runs_[b].front()) < std::invoke(kKey, runs_[a].front());
    };
  }
  void sort_waiting() { std::ranges::sort(waiting_, {}, kKey); }
  void flush() {
    sort_waiting();
    if (!file_) file_.emplace(OpenFile::temporary(directory_ / "locvol-sort"));
    const std::uint64_t begin = size_ - waiting_.size();
    file_->write_at(begin * sizeof(Record), std::as_bytes(std::span(waiting_)));
    runs_.push_back({.begin = begin, .end = size_});
    waiting_.clear();
  }
  void load(Run& run, std::size_t num) {
    run.buffer.resize(std::min<std::uint64_t>(num, run.end - run.begin));
    run.next = 0;
    if (run.buffer.empty()) return;
    file_->read_at(run.begin * sizeof(Record), std::as_writable_bytes(std::span(run.buffer)));
    run.begin += run.buffer.size();
  }

  std::filesystem::path directory_;
  std::optional<OpenFile> file_;
  std::uint64_t size_ = 0;
  std::vector<Record> waiting_;
  std::vector<Run> runs_;
  std::vector<std::size_t> order_;  // of runs: a heap, the one with the smallest record first
};

}  // namespace locvol
