#include "engine/ingest/triangle_buckets.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

#include "refine/domain/triangle_box.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMaxFanOut = 512;

// A cell all of whose triangles would be found again in one part of it, and most in others too.
constexpr double kCrowded = 0.75, kSpread = 2;

struct CellRange {
  std::uint32_t first = 0, last = 0;
  std::uint32_t count() const { return last - first + 1; }
};

// The cells of one level below a node, as far as a box reaches.
class CellGrid {
 public:
  CellGrid(const Frame& frame, MortonKey node, int level, const Box& box)
      : level_(level), step_(std::uint32_t{1} << (MortonKey::kMaxLevel - level)) {
    const GridPoint low = node.grid_min();
    const std::array<std::uint32_t, 3> lows{low.x, low.y, low.z};
    const std::uint32_t count = node.grid_side() / step_;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      // Only positions inside the box' reach are listed: a needle's node may have millions.
      const auto position = [&](std::uint32_t i) {
        const std::uint32_t g = lows[axis] + i * step_;
        return frame.position({g, g, g})[static_cast<int>(axis)];
      };
      const double from = box.min[static_cast<int>(axis)], to = box.max[static_cast<int>(axis)];
      const std::uint32_t first =
          lower(count, [&](std::uint32_t i) { return position(i + 1) >= from; });
      const std::uint32_t end = lower(count, [&](std::uint32_t i) { return position(i) > to; });
      base_[axis] = lows[axis] + first * step_;
      num_[axis] = end - first;
      bounds_[axis].clear();
      if (num_[axis] > kMaxFanOut) continue;  // too many for a pass
      for (std::uint32_t i = first; i <= end; ++i) bounds_[axis].push_back(position(i));
    }
  }

  std::uint64_t size() const { return std::uint64_t{num_[0]} * num_[1] * num_[2]; }

  // The cells whose closed extent meets [low, high] on one axis, as far as the grid reaches.
  CellRange range(std::size_t axis, double low, double high) const {
    const std::vector<double>& bounds = bounds_[axis];
    const std::uint32_t last = num_[axis] - 1;
    const double cell = bounds[1] - bounds[0];
    const auto guess = [&](double v) {
      const double i = std::floor((v - bounds[0]) / cell);
      return i <= 0 ? 0 : i >= last ? last : static_cast<std::uint32_t>(i);
    };
    CellRange range{guess(low), guess(high)};
    while (range.first > 0 && bounds[range.first] >= low) --range.first;
    while (range.first < last && bounds[range.first + 1] < low) ++range.first;
    while (range.last > 0 && bounds[range.last] > high) --range.last;
    while (range.last < last && bounds[range.last + 1] <= high) ++range.last;
    return range;
  }
  std::size_t index(std::uint32_t i, std::uint32_t j, std::uint32_t k) const {
    return (std::size_t{k} * num_[1] + j) * num_[0] + i;
  }
  Box box(std::uint32_t i, std::uint32_t j, std::uint32_t k) const {
    return {{bounds_[0][i], bounds_[1][j], bounds_[2][k]},
            {bounds_[0][i + 1], bounds_[1][j + 1], bounds_[2][k + 1]}};
  }
  MortonKey key(std::size_t index) const {
    const auto i = static_cast<std::uint32_t>(index % num_[0]);
    const auto j = static_cast<std::uint32_t>(index / num_[0] % num_[1]);
    const auto k = static_cast<std::uint32_t>(index / num_[0] / num_[1]);
    return MortonKey::containing({base_[0] + i * step_, base_[1] + j * step_, base_[2] + k * step_},
                                 level_);
  }

 private:
  // The first i for which it holds, or count.
  template <class Holds>
  static std::uint32_t lower(std::uint32_t count, const Holds& holds) {
    std::uint32_t low = 0, high = count;
    while (low < high) {
      const std::uint32_t middle = low + (high - low) / 2;
      if (holds(middle))
        high = middle;
      else
        low = middle + 1;
    }
    return low;
  }

  int level_;
  std::uint32_t step_;
  std::array<std::uint32_t, 3> base_{}, num_{};
  std::array<std::vector<double>, 3> bounds_;
};

// A part of a cell while it is cut.
struct Part {
  explicit Part(TriangleSpill& spill, const Box& around)
      : list(std::make_unique<TriangleList>()), writer(spill, *list), box(around) {}

  std::unique_ptr<TriangleList> list;
  TriangleWriter writer;
  Box box;  // around what is in the cell
};

class Distribution {
 public:
  Distribution(TriangleSpill& spill, const Frame& frame, std::uint64_t capacity,
               const KeyRange& range, IngestWatch& watch, double margin)
      : spill_(spill),
        frame_(frame),
        capacity_(capacity),
        range_(range),
        watch_(watch),
        margin_(margin) {}

  struct Cell {
    MortonKey key;
    std::vector<TriangleList> lists;  // one after another, in order of id
    Box box;                          // around what is in the cell
    bool is_final = false;            // cutting it again cannot help

    std::uint64_t num_triangles() const {
      std::uint64_t num = 0;
      for (const TriangleList& list : lists) num += list.count;
      return num;
    }
  };

  // `lists` are released unless `keeps`.
  void cut(Cell cell, const TriangleChanges& changes, bool keeps,
           std::vector<TriangleBucket>& buckets) {
    const bool is_small =
        range_.contains(cell.key) && (cell.num_triangles() <= capacity_ || cell.is_final ||
                                      cell.key.level() == MortonKey::kMaxLevel);
    // Lists that must be kept, or changed, cannot become buckets themselves, and several not one.
    if (is_small && !keeps && changes.empty() && cell.lists.size() == 1) {
      buckets.push_back({cell.key, std::move(cell.lists.front())});
      return;
    }
    const int level = is_small ? cell.key.level() : level_below(cell);
    for (Cell& part : parts_of(cell, level, changes, keeps)) {
      if (is_small)
        buckets.push_back({part.key, std::move(part.lists.front())});
      else
        cut(std::move(part), {}, false, buckets);
    }
  }

 private:
  // Deep enough that a surface fills its parts with less than the capacity, as far as one pass
  // reaches. Of n cells around a surface it meets about n^(2/3).
  int level_below(const Cell& cell) const {
    const double wanted =
        static_cast<double>(cell.num_triangles()) / static_cast<double>(capacity_);
    int level = cell.key.level() + 1;
    for (; level < MortonKey::kMaxLevel; ++level) {
      const auto num_parts =
          static_cast<double>(CellGrid(frame_, cell.key, level, cell.box).size());
      if (std::pow(num_parts, 2.0 / 3) >= wanted) break;
      if (CellGrid(frame_, cell.key, level + 1, cell.box).size() > kMaxFanOut) break;
    }
    return level;
  }

  std::vector<Cell> parts_of(Cell& cell, int level, const TriangleChanges& changes, bool keeps) {
    const CellGrid grid(frame_, cell.key, level, cell.box);
    std::vector<bool> is_ours(grid.size());
    for (std::size_t i = 0; i < is_ours.size(); ++i) is_ours[i] = range_.overlaps(grid.key(i));
    std::vector<std::optional<Part>> parts(grid.size());
    auto change = changes.begin();
    const auto put = [&](const Triangle& t) {
      while (change != changes.end() && change->id < t.id) ++change;
      place(change != changes.end() && change->id == t.id ? *change : t, grid, is_ours, parts);
      watch_.advance();
    };
    const std::uint64_t count = cell.num_triangles();
    for (TriangleList& list : cell.lists) {
      spill_.for_each(list, put);
      if (!keeps) spill_.release(std::move(list));
    }

    std::uint64_t total = 0;
    for (auto& part : parts)
      if (part) {
        part->writer.flush();
        total += part->list->count;
      }
    std::vector<Cell> cells;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      if (!parts[i]) continue;
      const bool is_final =
          static_cast<double>(parts[i]->list->count) > kCrowded * static_cast<double>(count) &&
          static_cast<double>(total) > kSpread * static_cast<double>(count);
      cells.push_back({grid.key(i), {std::move(*parts[i]->list)}, parts[i]->box, is_final});
    }
    std::ranges::sort(cells, {}, &Cell::key);
    return cells;
  }

  void place(const Triangle& t, const CellGrid& grid, const std::vector<bool>& is_ours,
             std::vector<std::optional<Part>>& parts) {
    const Box box = margin_ > 0 ? t.box().expanded(margin_) : t.box();
    const CellRange x = grid.range(0, box.min.x, box.max.x),
                    y = grid.range(1, box.min.y, box.max.y),
                    z = grid.range(2, box.min.z, box.max.z);
    const bool is_in_one = x.count() == 1 && y.count() == 1 && z.count() == 1;
    for (std::uint32_t k = z.first; k <= z.last; ++k)
      for (std::uint32_t j = y.first; j <= y.last; ++j)
        for (std::uint32_t i = x.first; i <= x.last; ++i) {
          if (!is_ours[grid.index(i, j, k)]) continue;
          const Box cell = grid.box(i, j, k);
          if (is_in_one ? !box.overlaps(cell)
                        : !touches(t, margin_ > 0 ? cell.expanded(margin_) : cell))
            continue;
          auto& part = parts[grid.index(i, j, k)];
          if (part)
            part->box = part->box.joined(box.common(cell));
          else
            part.emplace(spill_, box.common(cell));
          part->writer.append(t);
        }
  }

  TriangleSpill& spill_;
  const Frame& frame_;
  std::uint64_t capacity_;
  const KeyRange& range_;
  IngestWatch& watch_;
  double margin_;
};

}  // namespace

void TriangleBuckets::distribute(TriangleSpill& spill, std::vector<TriangleList>& all,
                                 const Box& box, const TriangleChanges& changes, bool keeps_all,
                                 IngestWatch& watch, double margin) {
  release(spill);
  Distribution::Cell root{MortonKey::root(), keeps_all ? all : std::move(all),
                          margin > 0 ? box.expanded(margin) : box};
  Distribution(spill, frame_, capacity_, range_, watch, margin)
      .cut(std::move(root), changes, keeps_all, buckets_);
}

void TriangleBuckets::release(TriangleSpill& spill) {
  for (TriangleBucket& bucket : buckets_) spill.release(std::move(bucket.triangles));
  buckets_.clear();
}

void TriangleBuckets::replace(TriangleSpill& spill, std::size_t i,
                              std::span<const Triangle> triangles) {
  spill.release(std::exchange(buckets_[i].triangles, {}));
  TriangleWriter writer(spill, buckets_[i].triangles);
  for (const Triangle& triangle : triangles) writer.append(triangle);
  writer.flush();
}

std::span<const TriangleBucket> TriangleBuckets::under(MortonKey node) const {
  const auto first = std::ranges::lower_bound(
      buckets_, node.range_min(), {}, [](const TriangleBucket& b) { return b.cell.range_max(); });
  if (first != buckets_.end() && first->cell.is_ancestor_or_self_of(node))
    return {first, first + 1};
  const auto end =
      std::ranges::upper_bound(first, buckets_.end(), node.range_max(), {}, &TriangleBucket::cell);
  return {first, end};
}

MortonKey TriangleBuckets::last_met_by(const Triangle& triangle) const {
  MortonKey node = MortonKey::root();
  for (;;) {
    const auto below = under(node);
    assert(!below.empty());
    if (below.front().cell.is_ancestor_or_self_of(node)) return below.front().cell;
    int octant = 7;
    while (octant > 0 && !(touches(triangle, frame_.box(node.child(octant))) &&
                           !under(node.child(octant)).empty()))
      --octant;
    node = node.child(octant);
  }
}

bool TriangleBuckets::meets_edge(const Box& cell, const Point& a, const Point& b) {
  return cell.contains(a) || cell.contains(b) || touches(CreaseEdge{.ends = {a, b}}, cell);
}

// Keys of points in a box lie between those of its corners.
bool TriangleBuckets::reaches_beyond_range(const Triangle& triangle) const {
  if (range_.is_all()) return false;
  const Box reach = triangle.box().expanded(frame_.unit());  // cells are closed
  return !range_.contains(frame_.key_of(reach.min)) || !range_.contains(frame_.key_of(reach.max));
}

}  // namespace locvol
