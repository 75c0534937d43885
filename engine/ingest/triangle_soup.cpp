#include "engine/ingest/triangle_soup.h"

#include <bit>
#include <cstddef>
#include <utility>

#include "octree/table_hash.h"

namespace locvol {
namespace {

// Finds out which corners are equal, by a hash table with open addressing.
class VertexMerger {
 public:
  explicit VertexMerger(std::size_t num_triangles)
      : slots_(std::bit_ceil(num_triangles + num_triangles / 2 + 16)) {
    vertices_.reserve(num_triangles / 2 + 16);
  }

  std::uint32_t number_of(const Point& position) {
    if (4 * (vertices_.size() + 1) > 3 * slots_.size()) grow();
    std::uint32_t& slot = slots_[slot_of(position)];
    if (slot == 0) {
      vertices_.push_back(position);
      slot = static_cast<std::uint32_t>(vertices_.size());
    }
    return slot - 1;
  }
  std::vector<Point> take_vertices() { return std::move(vertices_); }

 private:
  void grow() {
    slots_.assign(2 * slots_.size(), 0);
    for (std::size_t v = 0; v < vertices_.size(); ++v)
      slots_[slot_of(vertices_[v])] = static_cast<std::uint32_t>(v + 1);
  }

  // Where it is, or belongs.
  std::size_t slot_of(const Point& position) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t slot = TableHash()(position) & mask;
    while (slots_[slot] != 0 && vertices_[slots_[slot] - 1] != position) slot = (slot + 1) & mask;
    return slot;
  }

  std::vector<Point> vertices_;
  std::vector<std::uint32_t> slots_;  // number + 1, or 0: free
};

}  // namespace

TriangleSoup soup_of(std::span<const Triangle> triangles) {
  VertexMerger merger(triangles.size());
  TriangleSoup soup;
  soup.triangles.reserve(triangles.size());
  for (const auto& [id, corners, sheet, change] : triangles) {
    const std::uint32_t a = merger.number_of(corners[0]), b = merger.number_of(corners[1]),
                        c = merger.number_of(corners[2]);
    soup.triangles.push_back({a, b, c});
  }
  soup.vertices = merger.take_vertices();
  return soup;
}

}  // namespace locvol
