// TriangleBuckets cuts space into cells that few enough triangles meet to be worked on in memory.
//
// The cells are octree nodes; each has a bucket, with every triangle that meets its closed box,
// decided exactly. So whatever a cell must know is in its bucket:
//   - a cell owns the vertices in its half-open box; all triangles at a vertex are in the bucket of
//     its owner, and with them its edges to larger vertices (in lexicographic order);
//   - where two triangles meet, some bucket has both.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/triangle_spill.h"
#include "octree/frame.h"
#include "octree/key_range.h"
#include "octree/morton_key.h"

namespace locvol {

// Triangles that take the place of those with the same ids, in order of id.
using TriangleChanges = std::vector<Triangle>;

struct TriangleBucket {
  MortonKey cell;
  TriangleList triangles;  // in order of id
};

class TriangleBuckets {
 public:
  // Has the cells in `range` alone. REQUIRES: the frame contains all triangles, and if the range is
  // not all, more than a grid step around them
  TriangleBuckets(const Frame& frame, std::uint64_t capacity, const KeyRange& range = {})
      : frame_(frame), capacity_(capacity), range_(range) {}

  // Puts the triangles of `all`, which are lists one after another in order of id, into the buckets
  // of cells as large as `capacity` allows. Cells that more triangles meet are cut again, in passes
  // over their triangles that each write to up to 512 lists; not where that cannot help, as at a
  // point where all of them meet. `box` is around all of them. `keeps_all`: `all` is needed again.
  // `margin`: a cell gets what is as near as that, too; what is asked of cells below knows nothing
  // of it. Memory: 16 MB while it runs.
  void distribute(TriangleSpill& spill, std::vector<TriangleList>& all, const Box& box,
                  const TriangleChanges& changes, bool keeps_all, IngestWatch& watch,
                  double margin = 0);

  TriangleBuckets empty_ones() const { return {frame_, capacity_, range_}; }  // for other triangles
  void release(TriangleSpill& spill);  // then there are no cells
  // Gives the i-th bucket these triangles instead of its own.
  void replace(TriangleSpill& spill, std::size_t i, std::span<const Triangle> triangles);

  const Frame& frame() const { return frame_; }
  std::span<const TriangleBucket> all() const { return buckets_; }  // in Morton order
  // The buckets of the cells under `node`, or the one whose cell contains it.
  std::span<const TriangleBucket> under(MortonKey node) const;
  // Tells whether the cell with this box owns the point.
  static bool owns(const Box& cell, const Point& p) {
    return cell.min.x <= p.x && p.x < cell.max.x && cell.min.y <= p.y && p.y < cell.max.y &&
           cell.min.z <= p.z && p.z < cell.max.z;
  }
  // The last cell, in Morton order, that the triangle meets. REQUIRES: it is in a bucket
  MortonKey last_met_by(const Triangle& triangle) const;
  // Tells whether no later cell has the triangle, nor one beyond the range. REQUIRES: the cell does
  bool is_last_with(MortonKey cell, const Triangle& triangle) const {
    return !reaches_beyond_range(triangle) && last_met_by(triangle) == cell;
  }
  // Tells whether the triangle may meet cells that are not in the range.
  bool reaches_beyond_range(const Triangle& triangle) const;
  // Does the closed cell meet the edge? Then all triangles at the edge are in its bucket.
  static bool meets_edge(const Box& cell, const Point& a, const Point& b);
  // Tells whether the triangle lies on the cell's boundary, or beyond.
  static bool reaches_out(const Box& cell, const Triangle& triangle) {
    const Box b = triangle.box();
    return b.min.x <= cell.min.x || b.min.y <= cell.min.y || b.min.z <= cell.min.z ||
           b.max.x >= cell.max.x || b.max.y >= cell.max.y || b.max.z >= cell.max.z;
  }

 private:
  Frame frame_;
  std::uint64_t capacity_;
  KeyRange range_;
  std::vector<TriangleBucket> buckets_;
};

}  // namespace locvol
