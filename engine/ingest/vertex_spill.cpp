#include "engine/ingest/vertex_spill.h"

#include <cassert>
#include <span>

namespace locvol {

void VertexSpill::append(const Point& position) {
  last_.push_back(position);
  if (last_.size() < kBlockVertices * kBufferedBlocks) return;
  if (!file_) file_.emplace(OpenFile::temporary(directory_ / "locvol-vertices"));
  file_->write_at(num_written_ * sizeof(Point), std::as_bytes(std::span(last_)));
  num_written_ += last_.size();
  last_.clear();
}

Point VertexSpill::at(std::uint64_t vertex) {
  assert(vertex < size());
  if (vertex >= num_written_) return last_[vertex - num_written_];
  if (cache_.empty()) cache_.resize(kCachedBlocks);
  const std::uint64_t number = vertex / kBlockVertices;
  Block& block = cache_[number % kCachedBlocks];
  if (block.number != number) {
    file_->read_at(number * kBlockVertices * sizeof(Point),
                   std::as_writable_bytes(std::span(block.vertices)));
    block.number = number;
  }
  return block.vertices[vertex % kBlockVertices];
}

}  // namespace locvol
