// VertexPositions finds where vertices of the output lie, from the records near them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "engine/output/leaf_window.h"
#include "engine/output/vertex_numbering.h"
#include "octree/geometry.h"
#include "storage/store.h"

namespace locvol {

// Memory: 8 MB, divided by `num_shares`, for the leaves last asked for. Errors: StoreError.
class VertexPositions {
 public:
  // Both must outlive this object.
  VertexPositions(const Reader& reader, const VertexNumbering& numbering, int num_shares = 1);

  Point of(std::uint64_t vertex);
  // The same; one of the core is known as a lattice point by its id.
  Point of(std::uint64_t vertex, std::uint64_t id);
  // Of points by their ids and numbers. What has no number (-1) is at the origin.
  std::vector<Point> of(std::span<const std::uint64_t> ids, std::span<const std::int64_t> numbers);

 private:
  struct Table {
    std::vector<Point> positions;  // of a leaf's vertices but those of the core
    // The core's, and how many of its points come before each.
    std::vector<LatticeRow> rows;
    std::vector<std::uint64_t> before;
    std::size_t bytes() const {
      return sizeof *this + sizeof(Point) * positions.capacity() +
             sizeof(LatticeRow) * rows.capacity() + 8 * before.capacity();
    }
  };

  Table load(std::size_t leaf) const;

  const Reader* reader_;
  const VertexNumbering* numbering_;
  LeafWindow<Table> tables_;
  // The last one that was asked for, and which vertices it has.
  std::shared_ptr<const Table> last_;
  std::uint64_t first_ = 0, end_ = 0;
};

}  // namespace locvol
