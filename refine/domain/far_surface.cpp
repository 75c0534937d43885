#include "refine/domain/far_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <tuple>
#include <utility>

#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

constexpr std::uint32_t kParts = 16;  // of a leaf, on each axis
constexpr int kPlaceBits = 16;
constexpr std::uint64_t kPlaceMask = (std::uint64_t{1} << kPlaceBits) - 1;
constexpr double kDetail = 0.1;  // sides of nodes, over their distance: a smooth surface is met to
                                 // 0.1%, with a corner of it to 5%

using Place = std::array<std::uint64_t, 3>;

std::uint64_t packed(const Place& place) {
  return place[0] | place[1] << kPlaceBits | place[2] << 2 * kPlaceBits;
}
Place unpacked(std::uint64_t place) {
  return {place & kPlaceMask, place >> kPlaceBits & kPlaceMask, place >> 2 * kPlaceBits};
}

// The closest to the center comes first.
auto rank_of(std::uint64_t place) {
  std::int64_t squared = 0;
  for (const std::uint64_t u : unpacked(place)) {
    const std::int64_t from_center = 2 * static_cast<std::int64_t>(u) + 1 - (1 << kPlaceBits);
    squared += from_center * from_center;
  }
  return std::pair(squared, place);
}

MortonKey ancestor(MortonKey key, int level) {
  const std::uint64_t marker = std::uint64_t{1} << 3 * (MortonKey::kMaxLevel - level);
  return MortonKey::from_bits((key.bits() & ~(2 * marker - 1)) | marker);
}

Place place_in(MortonKey above, const FarPoint& point) {
  const GridPoint low = point.node.grid_min(), low_above = above.grid_min();
  const Place place = unpacked(point.place);
  const auto shifted = [&](std::uint32_t from, std::uint32_t to, std::uint64_t u) {
    return ((std::uint64_t{from - to} << kPlaceBits) + u * point.node.grid_side()) /
           above.grid_side();
  };
  return {shifted(low.x, low_above.x, place[0]), shifted(low.y, low_above.y, place[1]),
          shifted(low.z, low_above.z, place[2])};
}

auto order_of(const FarPoint& p) { return std::pair(p.node.range_min(), p.node.level()); }

}  // namespace

void FarSurface::add(MortonKey leaf, const LeafSurface& surface) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  struct Nearest {
    Point point;
    double squared_distance = kNone;
  };
  const std::uint32_t num = std::min(kParts, leaf.grid_side());
  const int most = static_cast<int>(num) - 1;
  std::vector<Nearest> nearest(std::size_t{num} * num * num);
  const Box box = frame_.box(leaf);
  const Point step = 1.0 / num * (box.max - box.min);
  const auto place = [&](double v, int axis) {
    return static_cast<int>(
        std::clamp(std::floor((v - box.min[axis]) / step[axis]), 0.0, static_cast<double>(most)));
  };
  const auto corner_of = [&](int i, int j, int k) {
    return box.min + Point{i * step.x, j * step.y, k * step.z};
  };
  const auto index_of = [&](int i, int j, int k) {
    return (static_cast<std::size_t>(k) * num + static_cast<std::size_t>(j)) * num +
           static_cast<std::size_t>(i);
  };
  for (const Triangle& triangle : surface.triangles) {
    const Box around = triangle.box();
    if (!around.overlaps(box)) continue;
    std::array<int, 3> low{}, high{};
    for (int axis = 0; axis < 3; ++axis) {
      low[std::size_t(axis)] = place(around.min[axis], axis);
      high[std::size_t(axis)] = place(around.max[axis], axis);
    }
    for (int k = low[2]; k <= high[2]; ++k)
      for (int j = low[1]; j <= high[1]; ++j)
        for (int i = low[0]; i <= high[0]; ++i) {
          const Point corner = corner_of(i, j, k), center = corner + 0.5 * step;
          const Point q = closest_on_triangle(triangle.corners, center);
          if (!Box{corner, corner + step}.contains(q)) continue;
          const double d = squared_distance(q, center);
          Nearest& held = nearest[index_of(i, j, k)];
          if (d < held.squared_distance) held = {q, d};
        }
  }
  const GridPoint origin = leaf.grid_min();
  const std::uint32_t side = leaf.grid_side() / num;
  const int level = leaf.level() + std::countr_zero(num);
  for (int k = 0; k <= most; ++k)
    for (int j = 0; j <= most; ++j)
      for (int i = 0; i <= most; ++i) {
        const auto& [point, squared] = nearest[index_of(i, j, k)];
        if (squared == kNone) continue;
        const Point corner = corner_of(i, j, k);
        Place in_part;
        for (int axis = 0; axis < 3; ++axis)
          in_part[std::size_t(axis)] = static_cast<std::uint64_t>(
              std::clamp((point[axis] - corner[axis]) / step[axis] * (kPlaceMask + 1.0), 0.0,
                         static_cast<double>(kPlaceMask)));
        const auto at = [&](std::uint32_t from, int n) {
          return from + static_cast<std::uint32_t>(n) * side;
        };
        points_.push_back(
            {MortonKey::containing({at(origin.x, i), at(origin.y, j), at(origin.z, k)}, level),
             packed(in_part)});
      }
}

void FarSurface::finish() {
  std::ranges::sort(points_, {}, &FarPoint::node);
  const std::size_t num_parts = points_.size();
  int deepest = 0;
  for (const FarPoint& point : points_) deepest = std::max(deepest, point.node.level());
  for (int level = 0; level < deepest; ++level)
    for (std::size_t i = 0; i < num_parts;) {
      if (points_[i].node.level() <= level) {
        ++i;
        continue;
      }
      const MortonKey above = ancestor(points_[i].node, level);
      std::uint64_t best = packed(place_in(above, points_[i]));
      for (++i; i < num_parts && above.is_ancestor_or_self_of(points_[i].node); ++i)
        best = std::min(best, packed(place_in(above, points_[i])),
                        [](auto a, auto b) { return rank_of(a) < rank_of(b); });
      points_.push_back({above, best});
    }
  put_in_order();
}

void FarSurface::put_in_order() {
  std::ranges::sort(points_, {},
                    [](const FarPoint& p) { return std::pair(order_of(p), rank_of(p.place)); });
  const auto repeated = std::ranges::unique(points_, {}, &FarPoint::node);
  points_.erase(repeated.begin(), repeated.end());
}

void FarSurface::add_told(std::span<const FarPoint> points) {
  points_.insert(points_.end(), points.begin(), points.end());
  put_in_order();
}

template <class Visit>
void FarSurface::descend(std::span<const Box> places, const Visit& visit) const {
  for (auto point = points_.begin(); point != points_.end();) {
    const Box box = frame_.box(point->node);
    double squared = std::numeric_limits<double>::infinity();
    for (const Box& place : places) squared = std::min(squared, place.squared_distance(box));
    const double side = frame_.side(point->node.level());
    const bool is_enough = side * side <= kDetail * kDetail * squared;
    const auto next = std::next(point);
    const bool has_parts = next != points_.end() && point->node.is_ancestor_or_self_of(next->node);
    visit(*point, is_enough || !has_parts);
    point = !is_enough
                ? next
                : std::ranges::upper_bound(next, points_.end(), point->node.range_max(), {},
                                           [](const FarPoint& p) { return p.node.range_min(); });
  }
}

std::vector<FarPoint> FarSurface::seen_from(std::span<const Box> places) const {
  std::vector<FarPoint> seen;
  descend(places, [&](const FarPoint& point, bool) { seen.push_back(point); });
  return seen;
}

FarPoints FarSurface::around(const Box& places) const {
  FarPoints near;
  descend({&places, 1}, [&](const FarPoint& point, bool is_enough) {
    if (!is_enough) return;
    const double side = frame_.side(point.node.level());
    const Point low = frame_.box(point.node).min;
    const Place place = unpacked(point.place);
    const auto at = [&](std::uint64_t u) {
      return (static_cast<double>(u) + 0.5) * side / (kPlaceMask + 1.0);
    };
    near.points_.push_back({low + Point{at(place[0]), at(place[1]), at(place[2])}, side});
  });
  near.finish();
  return near;
}

// In Morton order neighbors follow one another.
void FarPoints::finish() {
  constexpr std::size_t kInGroup = 16;
  std::vector<Box> boxes;
  for (std::size_t first = 0; first < points_.size(); first += kInGroup) {
    const Group group{first, std::min(points_.size(), first + kInGroup)};
    Box box = Box::around(points_[first].position);
    for (std::size_t i = first; i < group.end; ++i) box = box.joined(points_[i].position);
    groups_.push_back(group);
    boxes.push_back(box);
  }
  tree_ = BoxTree(std::move(boxes));
}

double FarPoints::distance(const Point& p, double bound) const {
  double squared = bound * bound;
  double side = 0;
  tree_.for_each_within(p, squared, [&](std::uint32_t n) {
    for (std::size_t i = groups_[n].first; i < groups_[n].end; ++i)
      if (const double d = squared_distance(points_[i].position, p); d < squared)
        squared = d, side = points_[i].side;
  });
  if (!(squared < bound * bound)) return bound;
  // The surface is closer than its points: a plane, by a third of a node's diagonal aside.
  const double distance = std::sqrt(squared);
  return distance - std::min(0.125 * side * side / distance, 0.5 * distance);
}

}  // namespace locvol
