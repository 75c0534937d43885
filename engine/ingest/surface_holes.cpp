#include "engine/ingest/surface_holes.h"

#include <algorithm>
#include <utility>

#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "refine/cure/near_points.h"
#include "refine/domain/cut_triangle.h"

namespace locvol {
namespace {

// What a cell has, of edges and points that it owns.
struct CellEdges {
  std::vector<EdgeFile::Pair> pairs;
  std::vector<OpenSide> open;
  std::vector<Point> at_border;  // points to which some of another cell may be near
  bool has_other_faults = false;
};

CellEdges edges_of_cell(const std::vector<Triangle>& triangles, const Box& cell, double near) {
  CellEdges found;
  const TriangleSoup soup = soup_of(triangles);
  const auto is_owned = [&](std::uint32_t v) {
    return TriangleBuckets::owns(cell, soup.vertices[v]);
  };
  EdgeTable(soup.vertices.size(), soup.triangles)
      .for_each_edge([&](std::span<const std::uint32_t> uses) {
        const std::uint32_t v = origin(soup.triangles, uses[0]),
                            w = target(soup.triangles, uses[0]);
        if (!is_owned(soup.vertices[v] < soup.vertices[w] ? v : w)) return;
        const auto id = [&](std::size_t n) {
          return static_cast<std::uint32_t>(triangles[uses[n] / 3].id);
        };
        if (uses.size() == 1)
          found.open.push_back({soup.vertices[v], soup.vertices[w], id(0)});
        else if (uses.size() == 2 && origin(soup.triangles, uses[1]) == w)
          found.pairs.push_back({id(0), id(1)});
        else
          found.has_other_faults = true;
      });
  for (const Triangle& t : triangles)
    found.has_other_faults |= owns_triangle(cell, t) && height_of(t.corners) <= near;
  for_each_near(soup.vertices, near,
                [&](std::uint32_t, std::uint32_t) { found.has_other_faults = true; });
  for (std::uint32_t v = 0; v < soup.vertices.size(); ++v) {
    const Point &p = soup.vertices[v], from_min = p - cell.min, from_max = cell.max - p;
    const double least =
        std::min({from_min.x, from_min.y, from_min.z, from_max.x, from_max.y, from_max.z});
    if (least <= 2 * near && is_owned(v)) found.at_border.push_back(p);
  }
  return found;
}

}  // namespace

void EdgeFile::append(std::span<const Pair> pairs) {
  file_.write_at(num_ * sizeof(Pair), std::as_bytes(pairs));
  num_ += pairs.size();
}

void EdgeFile::for_each(const std::function<void(std::uint32_t, std::uint32_t)>& visit) const {
  constexpr std::uint64_t kInBlock = 1 << 15;
  std::vector<Pair> block;
  for (std::uint64_t first = 0; first < num_; first += kInBlock) {
    block.resize(std::min(num_ - first, kInBlock));
    file_.read_at(first * sizeof(Pair), std::as_writable_bytes(std::span(block)));
    for (const Pair& pair : block) visit(pair.first, pair.second);
  }
}

std::uint32_t SpilledTriangles::num() const {
  std::uint64_t num = 0;
  for (const TriangleList& list : lists_) num += list.count;
  return static_cast<std::uint32_t>(num);
}

void SpilledTriangles::for_each(
    const std::function<void(std::uint32_t, const Corners&, SheetId)>& visit) const {
  for (const TriangleList& list : lists_)
    spill_.for_each(list, [&](const Triangle& t) {
      visit(static_cast<std::uint32_t>(t.id), t.corners, t.sheet);
    });
}

std::optional<std::vector<OpenSide>> SpilledTriangles::find_edges(const TriangleBuckets& buckets,
                                                                  const Box& box,
                                                                  std::uint64_t most_open,
                                                                  IngestWatch& watch,
                                                                  Workers& workers) {
  constexpr std::size_t kMostAtBorder = 1'000'000;
  const double near = snapping_distance(box);
  std::vector<OpenSide> open;
  std::vector<Point> at_border;
  bool has_other_faults = false;
  for_each_in_order(
      workers, buckets.all(),
      [&](const TriangleBucket& bucket) { return spill_.load(bucket.triangles); },
      [&](const TriangleBucket& bucket, const std::vector<Triangle>& triangles) {
        return edges_of_cell(triangles, buckets.frame().box(bucket.cell), near);
      },
      [&](const TriangleBucket& bucket, const CellEdges& cell) {
        watch.advance(bucket.triangles.count);
        has_other_faults |=
            cell.has_other_faults || open.size() > most_open || at_border.size() > kMostAtBorder;
        if (has_other_faults) return;
        edges_.append(cell.pairs);
        open.insert(open.end(), cell.open.begin(), cell.open.end());
        at_border.insert(at_border.end(), cell.at_border.begin(), cell.at_border.end());
      });
  if (!at_border.empty())
    for_each_near(at_border, near, [&](std::uint32_t, std::uint32_t) { has_other_faults = true; });
  if (has_other_faults) return std::nullopt;
  return open;
}

}  // namespace locvol
