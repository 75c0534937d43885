#include "engine/ingest/triangle_spill.h"

#include <algorithm>
#include <cassert>
#include <type_traits>

namespace locvol {

static_assert(std::is_trivially_copyable_v<Triangle>);

void TriangleSpill::append_extent(TriangleList& list, std::span<const Triangle> triangles) {
  assert(triangles.size() <= kExtentTriangles && list.count % kExtentTriangles == 0);
  if (!file_) file_.emplace(OpenFile::temporary(directory_ / "locvol-ingest"));
  std::uint32_t extent = num_extents_;
  if (free_.empty()) {
    ++num_extents_;
  } else {
    extent = free_.back();
    free_.pop_back();
  }
  file_->write_at(std::uint64_t{extent} * sizeof(Extent), std::as_bytes(triangles));
  list.extents.push_back(extent);
  list.count += triangles.size();
}

void TriangleSpill::read_extent(const TriangleList& list, std::size_t i,
                                std::vector<Triangle>& out) const {
  const std::uint64_t before = i * kExtentTriangles;
  out.resize(std::min<std::uint64_t>(list.count - before, kExtentTriangles));
  file_->read_at(std::uint64_t{list.extents[i]} * sizeof(Extent),
                 std::as_writable_bytes(std::span(out)));
}

void TriangleSpill::release(TriangleList&& list) {
  free_.insert(free_.end(), list.extents.rbegin(), list.extents.rend());
  list = {};
}

std::vector<Triangle> TriangleSpill::load(const TriangleList& list) const {
  std::vector<Triangle> triangles, extent;
  triangles.reserve(list.count);
  for (std::size_t i = 0; i < list.extents.size(); ++i) {
    read_extent(list, i, extent);
    triangles.insert(triangles.end(), extent.begin(), extent.end());
  }
  return triangles;
}

}  // namespace locvol
