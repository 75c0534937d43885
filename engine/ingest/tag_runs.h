// TagRuns says which vertex a node's tag means, in files where nodes have tags of any value.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

namespace locvol {

// Tags that follow one another in the file and in value are one run, of 24 bytes.
class TagRuns {
 public:
  static constexpr std::size_t kMaxRuns = 1'000'000;

  // The next vertex has this tag. False: there would be too many runs.
  bool add(std::uint64_t tag) {
    if (!runs_.empty() && runs_.back().tag + runs_.back().length == tag) {
      ++runs_.back().length;
    } else {
      if (runs_.size() == kMaxRuns) return false;
      runs_.push_back({tag, num_vertices_, 1});
    }
    ++num_vertices_;
    return true;
  }
  std::uint64_t num_vertices() const { return num_vertices_; }

  // No tag is added after this. Returns a tag that two vertices have.
  std::optional<std::uint64_t> finish() {
    std::ranges::sort(runs_, {}, &Run::tag);
    for (std::size_t i = 1; i < runs_.size(); ++i)
      if (runs_[i].tag - runs_[i - 1].tag < runs_[i - 1].length) return runs_[i].tag;
    return std::nullopt;
  }
  // The vertex, counted from 0; none has the tag.
  std::optional<std::uint64_t> vertex(std::uint64_t tag) const {
    if (last_ < runs_.size() && tag - runs_[last_].tag < runs_[last_].length)
      return runs_[last_].vertex + (tag - runs_[last_].tag);
    const auto after = std::ranges::upper_bound(runs_, tag, {}, &Run::tag);
    if (after == runs_.begin()) return std::nullopt;
    const Run& run = *(after - 1);
    if (tag - run.tag >= run.length) return std::nullopt;
    last_ = static_cast<std::size_t>(&run - runs_.data());
    return run.vertex + (tag - run.tag);
  }

 private:
  struct Run {
    std::uint64_t tag, vertex, length;
  };
  std::vector<Run> runs_;
  std::uint64_t num_vertices_ = 0;
  mutable std::size_t last_ = 0;  // which was asked for last: by one thread at a time
};

}  // namespace locvol
