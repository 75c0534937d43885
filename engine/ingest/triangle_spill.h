// TriangleSpill keeps lists of triangles in one nameless temporary file.
//
// The file is cut into extents of equal size. A list is the extents it has filled, in order; those
// of a list that is no longer needed are used again. Nothing is left behind, however the process
// ends.
// Memory: 4 bytes an extent of 400 triangles, and one extent for each writer.
// Errors: std::system_error, "cannot write NAME: REASON", where the disk fails or is full.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "engine/shared/partial_file.h"
#include "octree/geometry.h"

namespace locvol {

struct TriangleList {
  std::vector<std::uint32_t> extents;  // all are full but the last
  std::uint64_t count = 0;
};

class TriangleSpill {
 public:
  static constexpr std::size_t kExtentTriangles = 400;

  // The file is made in `directory`, which must exist, when it is first needed.
  explicit TriangleSpill(std::filesystem::path directory) : directory_(std::move(directory)) {}

  // Makes one more extent of the list. REQUIRES: the list's last extent is full
  void append_extent(TriangleList& list, std::span<const Triangle> triangles);
  // The triangles of extent number i of the list.
  void read_extent(const TriangleList& list, std::size_t i, std::vector<Triangle>& out) const;
  void release(TriangleList&& list);  // its extents may be used again
  const std::filesystem::path& directory() const { return directory_; }
  std::uint64_t bytes() const { return std::uint64_t{num_extents_} * sizeof(Extent); }

  template <class Visit>
  void for_each(const TriangleList& list, const Visit& visit) const {
    std::vector<Triangle> extent;
    for (std::size_t i = 0; i < list.extents.size(); ++i) {
      read_extent(list, i, extent);
      for (const Triangle& triangle : extent) visit(triangle);
    }
  }
  std::vector<Triangle> load(const TriangleList& list) const;

 private:
  using Extent = std::array<Triangle, kExtentTriangles>;

  std::filesystem::path directory_;
  std::optional<OpenFile> file_;
  std::uint32_t num_extents_ = 0;
  std::vector<std::uint32_t> free_;
};

// Appends to a list, an extent at a time. The list is complete after flush().
class TriangleWriter {
 public:
  TriangleWriter(TriangleSpill& spill, TriangleList& list) : spill_(&spill), list_(&list) {
    waiting_.reserve(TriangleSpill::kExtentTriangles);
  }
  void append(const Triangle& triangle) {
    waiting_.push_back(triangle);
    if (waiting_.size() == TriangleSpill::kExtentTriangles) flush();
  }
  void flush() {
    if (!waiting_.empty()) spill_->append_extent(*list_, waiting_);
    waiting_.clear();
  }

 private:
  TriangleSpill* spill_;
  TriangleList* list_;
  std::vector<Triangle> waiting_;
};

}  // namespace locvol
