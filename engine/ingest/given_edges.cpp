#include "engine/ingest/given_edges.h"

#include <algorithm>

namespace locvol {

bool EdgeSet::contains(const Point& a, const Point& b) const {
  return !edges_.empty() && std::ranges::binary_search(edges_, ends_of(a, b));
}

EdgeSet GivenEdges::of_bucket(std::size_t bucket) const {
  if (bucket >= places_.size() || places_[bucket].count == 0) return {};
  std::vector<EdgeEnds> edges(places_[bucket].count);
  file_->read_at(places_[bucket].first * sizeof(EdgeEnds),
                 std::as_writable_bytes(std::span(edges)));
  return EdgeSet(std::move(edges));
}

void GivenEdges::append(std::size_t bucket, const EdgeEnds& edge) {
  if (bucket >= places_.size()) places_.resize(bucket + 1);
  Place& place = places_[bucket];
  if (place.count++ == 0) place.first = num_written_ + waiting_.size();
  waiting_.push_back(edge);
  if (waiting_.size() == kBuffered) flush();
}

void GivenEdges::finish() {
  flush();
  waiting_ = {};
}

void GivenEdges::flush() {
  if (waiting_.empty()) return;
  if (!file_) file_ = std::make_unique<OpenFile>(OpenFile::temporary(directory_ / "locvol-edges"));
  file_->write_at(num_written_ * sizeof(EdgeEnds), std::as_bytes(std::span(waiting_)));
  num_written_ += waiting_.size();
  waiting_.clear();
}

}  // namespace locvol
