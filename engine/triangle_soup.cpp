#include "engine/triangle_soup.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "engine/polygon_triangulation.h"
#include "engine/surface_input.h"

namespace locvol {
namespace {

std::uint64_t mixed(std::uint64_t x) {
  x ^= x >> 32;
  x *= 0xd6e8feb86659fd93;
  x ^= x >> 32;
  x *= 0xd6e8feb86659fd93;
  return x ^ x >> 32;
}

std::uint64_t hash_of(const Point& p) {
  return mixed(mixed(mixed(std::bit_cast<std::uint64_t>(p.x)) + std::bit_cast<std::uint64_t>(p.y)) +
               std::bit_cast<std::uint64_t>(p.z));
}

}  // namespace

void SurfaceBuilder::expect(std::uint64_t num_vertices, std::uint64_t num_polygons) {
  soup_.vertices.reserve(std::min<std::uint64_t>(num_vertices, 0xffffffff));
  soup_.triangles.reserve(std::min(num_polygons, kMaxTriangles));
}

void SurfaceBuilder::vertex(const Point& position) {
  numbers_.push_back(merged({position.x + 0.0, position.y + 0.0, position.z + 0.0}));  // no -0.0
}

void SurfaceBuilder::polygon(std::span<const std::uint64_t> corners, const FilePlace& place) {
  if (corners.size() < 3)
    refuse(place, fmt::format("a face has {} corners; remove it, or correct it to at least 3",
                              corners.size()));
  if (corners.size() > kMaxPolygonCorners)
    refuse(place, fmt::format("a face has {} corners, more than {}; cut it into triangles",
                              corners.size(), kMaxPolygonCorners));
  if (std::all_of(corners.begin(), corners.end(),
                  [&](std::uint64_t c) { return c < numbers_.size(); })) {
    add(corners, place);
  } else {
    deferred_corners_.insert(deferred_corners_.end(), corners.begin(), corners.end());
    deferred_.push_back({place, deferred_corners_.size()});
  }
}

TriangleSoup SurfaceBuilder::finish() {
  std::size_t begin = 0;
  for (const Deferred& polygon : deferred_) {
    const std::span corners(deferred_corners_.data() + begin, polygon.end - begin);
    for (const std::uint64_t c : corners)
      if (c >= numbers_.size())
        refuse(polygon.place,
               fmt::format("a face names vertex {} (counted from 0), but there are only "
                           "{}; the file is damaged",
                           c, numbers_.size()));
    add(corners, polygon.place);
    begin = polygon.end;
  }
  soup_.num_merged_points = numbers_.size() - soup_.vertices.size();
  return std::exchange(soup_, {});
}

void SurfaceBuilder::add(std::span<const std::uint64_t> corners, const FilePlace& place) {
  if (corners.size() == 3) {
    add_triangle(numbers_[corners[0]], numbers_[corners[1]], numbers_[corners[2]]);
    return;
  }
  ring_.clear();
  for (const std::uint64_t c : corners)
    if (ring_.empty() || ring_.back() != numbers_[c]) ring_.push_back(numbers_[c]);
  while (ring_.size() > 1 && ring_.front() == ring_.back()) ring_.pop_back();
  if (ring_.size() < 3) {  // kept as the degenerate triangle that it is, to be counted and dropped
    add_triangle(ring_[0], ring_[0], ring_[0]);
    return;
  }
  ring_points_.clear();
  for (const std::uint32_t v : ring_) ring_points_.push_back(soup_.vertices[v]);
  if (!triangulate_polygon(ring_points_, ring_triangles_))
    refuse(place,
           fmt::format("a face with {} corners crosses itself, seen along its normal; cut it "
                       "into triangles",
                       corners.size()));
  ++soup_.num_cut_polygons;
  for (const auto& [a, b, c] : ring_triangles_) add_triangle(ring_[a], ring_[b], ring_[c]);
}

void SurfaceBuilder::add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  if (soup_.triangles.size() == kMaxTriangles)
    throw InputError(fmt::format("{}: has more than {} triangles; simplify it or cut it into parts",
                                 file_.string(), kMaxTriangles));
  soup_.triangles.push_back({a, b, c});
}

std::uint32_t SurfaceBuilder::merged(const Point& position) {
  if (4 * (soup_.vertices.size() + 1) > 3 * slots_.size()) grow_slots();
  std::uint32_t& slot = slots_[slot_of(position)];
  if (slot == 0) {
    if (soup_.vertices.size() == std::numeric_limits<std::uint32_t>::max() - 1)
      throw InputError(
          fmt::format("{}: has more than {} vertices; simplify it or cut it into parts",
                      file_.string(), soup_.vertices.size()));
    soup_.vertices.push_back(position);
    slot = static_cast<std::uint32_t>(soup_.vertices.size());
  }
  return slot - 1;
}

void SurfaceBuilder::grow_slots() {
  slots_.assign(std::max<std::size_t>(2 * slots_.size(), 1024), 0);
  for (std::size_t v = 0; v < soup_.vertices.size(); ++v)
    slots_[slot_of(soup_.vertices[v])] = static_cast<std::uint32_t>(v + 1);
}

std::size_t SurfaceBuilder::slot_of(const Point& position) const {
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = hash_of(position) & mask;
  while (slots_[slot] != 0 && soup_.vertices[slots_[slot] - 1] != position)
    slot = (slot + 1) & mask;
  return slot;
}

void SurfaceBuilder::refuse(const FilePlace& place, const std::string& what) const {
  throw InputError(fmt::format("{}: {}: {}", file_.string(), to_string(place), what));
}

}  // namespace locvol
