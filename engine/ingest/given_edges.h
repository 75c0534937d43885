// The edges of a surface that are sharp because the user says so, by bucket, in a nameless
// temporary file.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/shared/partial_file.h"
#include "octree/geometry.h"

namespace locvol {

using EdgeEnds = std::array<Point, 2>;  // the lexicographically smaller one first

inline EdgeEnds ends_of(const Point& a, const Point& b) {
  return a < b ? EdgeEnds{a, b} : EdgeEnds{b, a};
}

// Those of one bucket that two of its triangles meet in.
class EdgeSet {
 public:
  EdgeSet() = default;
  explicit EdgeSet(std::vector<EdgeEnds> edges)
      : edges_(std::move(edges)) {}  // REQUIRES: ascending

  bool contains(const Point& a, const Point& b) const;

 private:
  std::vector<EdgeEnds> edges_;
};

// Memory: 16 bytes a bucket. Errors: as OpenFile.
class GivenEdges {
 public:
  GivenEdges() = default;  // none are given
  // `name`: for messages; the file is made in `directory`.
  GivenEdges(std::string name, std::filesystem::path directory)
      : name_(std::move(name)), directory_(std::move(directory)) {}

  bool is_given() const { return !name_.empty(); }
  const std::string& name() const { return name_; }
  EdgeSet of_bucket(std::size_t bucket) const;

  // Adds an edge of the bucket. REQUIRES: after those of buckets before it, and its smaller ones
  void append(std::size_t bucket, const EdgeEnds& edge);
  void finish();

 private:
  struct Place {
    std::uint64_t first = 0, count = 0;
  };
  static constexpr std::size_t kBuffered = 4096;

  void flush();

  std::string name_;
  std::filesystem::path directory_;
  std::unique_ptr<OpenFile> file_;
  std::vector<Place> places_;
  std::vector<EdgeEnds> waiting_;
  std::uint64_t num_written_ = 0;
};

}  // namespace locvol
