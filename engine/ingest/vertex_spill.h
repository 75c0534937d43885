// VertexSpill keeps the numbered vertices of a surface file: the last of them in memory, the rest
// in a nameless temporary file, read through a cache of blocks.
// Memory: 25 MB at most, whatever the number of vertices.
// Errors: std::system_error where the disk fails or is full.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "engine/ingest/vertex_cache.h"
#include "engine/shared/partial_file.h"
#include "octree/geometry.h"

namespace locvol {

class VertexSpill {
 public:
  explicit VertexSpill(std::filesystem::path directory) : directory_(std::move(directory)) {}

  std::uint64_t size() const { return num_written_ + last_.size(); }
  void append(const Point& position);
  Point at(std::uint64_t vertex);  // REQUIRES: vertex < size()

 private:
  static constexpr std::size_t kBufferedBlocks = 64;

  std::filesystem::path directory_;
  std::optional<OpenFile> file_;  // of whole blocks
  std::uint64_t num_written_ = 0;
  std::vector<Point> last_;
  VertexCache cache_;
};

}  // namespace locvol
