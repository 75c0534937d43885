#include "engine/audit/audit_grid.h"

namespace locvol {
namespace {

constexpr double kMaxPerAxis = 4096;

Box bounding_box(std::span<const Point> points) {
  if (points.empty()) return {};
  Box box = Box::around(points.front());
  for (const Point& p : points) box = box.joined(p);
  return box;
}

std::array<std::size_t, 3> buckets(const Box& box, double side) {
  std::array<std::size_t, 3> size;
  for (int axis = 0; axis < 3; ++axis) {
    const double length = box.max[axis] - box.min[axis];
    size[static_cast<std::size_t>(axis)] =
        static_cast<std::size_t>(std::min(length / side, kMaxPerAxis - 1)) + 1;
  }
  return size;
}

}  // namespace

AuditGrid::AuditGrid(std::span<const Point> points, double side)
    : box_(bounding_box(points)), side_(side) {
  size_ = buckets(box_, side_);
  while (size_[0] * size_[1] * size_[2] > 4 * points.size() + 64) {
    side_ *= 1.5;
    size_ = buckets(box_, side_);
  }
  std::vector<std::uint32_t> bucket_of(points.size());
  starts_.assign(size_[0] * size_[1] * size_[2] + 1, 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    bucket_of[i] = static_cast<std::uint32_t>(row_major(bucket(points[i])));
    ++starts_[bucket_of[i] + 1];
  }
  for (std::size_t b = 1; b < starts_.size(); ++b) starts_[b] += starts_[b - 1];
  entries_.resize(points.size());
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    entries_[next[bucket_of[i]]++] = {points[i], static_cast<std::uint32_t>(i)};
  }
}

std::array<std::size_t, 3> AuditGrid::bucket(const Point& p) const {
  std::array<std::size_t, 3> result;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    const double place = (p[axis] - box_.min[axis]) / side_;
    result[a] = static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(size_[a] - 1)));
  }
  return result;
}

}  // namespace locvol
