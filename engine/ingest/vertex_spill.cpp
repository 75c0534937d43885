#include "engine/ingest/vertex_spill.h"

#include <cassert>
#include <span>

namespace locvol {

void VertexSpill::append(const Point& position) {
  last_.push_back(position);
  if (last_.size() < VertexCache::kBlockVertices * kBufferedBlocks) return;
  if (!file_) file_.emplace(OpenFile::temporary(directory_ / "locvol-vertices"));
  file_->write_at(num_written_ * sizeof(Point), std::as_bytes(std::span(last_)));
  num_written_ += last_.size();
  last_.clear();
}

Point VertexSpill::at(std::uint64_t vertex) {
  assert(vertex < size());
  if (vertex >= num_written_) return last_[vertex - num_written_];
  return cache_.at(vertex, [&](std::uint64_t number, std::span<Point> vertices) {
    file_->read_at(number * vertices.size_bytes(), std::as_writable_bytes(vertices));
  });
}

}  // namespace locvol
