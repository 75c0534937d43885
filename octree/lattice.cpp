#include "octree/lattice.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "octree/mix.h"

namespace locvol {
namespace {

// Where a fraction of λ keeps the lattice off the planes of the octree and of most models.
constexpr Point kOffset{0.1370, 0.2718, 0.3517};

constexpr int kSiteLevel = 20;  // of the octree: its positions are sites of a lattice of cubes

}  // namespace

// The centers of these balls are the corners of the site's Voronoi cell, a truncated octahedron:
// all permutations of a (±1/2, ±1/4, 0). By symmetry one of them is the nearest.
bool changes_star(const Point& offset, double spacing) {
  std::array<double, 3> v{std::abs(offset.x), std::abs(offset.y), std::abs(offset.z)};
  std::ranges::sort(v, std::ranges::greater());
  const Point from_corner{v[0] - 0.5 * spacing, v[1] - 0.25 * spacing, v[2]};
  const double radius = kLatticeCircumradius / kLatticeSpacing * spacing;
  return dot(from_corner, from_corner) < radius * radius;
}

void add_row(const LatticeRow& row, LatticeCore& core) {
  if (!core.rows.empty()) {
    auto& [first, count, body] = core.rows.back();
    if (body == row.body && first.i == row.first.i && first.j == row.first.j &&
        first.k + 2 * static_cast<std::int64_t>(count) == row.first.k) {
      count += row.count;
      return;
    }
  }
  core.rows.push_back(row);
}

void check_core(const LatticeCore& core, const SiteBox& sites) {
  const LatticeRow* previous = nullptr;
  for (const LatticeRow& row : core.rows) {
    const auto& [i, j, k] = row.first;
    const bool is_of_lattice = ((i ^ j) & 1) == 0 && ((i ^ k) & 1) == 0;
    if (!is_of_lattice || row.count == 0 || !sites.contains(row.first) ||
        row.count > static_cast<std::uint32_t>(sites.high.k - k + 1) / 2)
      throw std::invalid_argument("a row of the core is not of the leaf's lattice points");
    if (previous && !(previous->first < row.first &&
                      (previous->first.i != i || previous->first.j != j ||
                       previous->first.k + 2 * static_cast<std::int64_t>(previous->count) <= k)))
      throw std::invalid_argument("the rows of the core are not in order");
    previous = &row;
  }
}

std::uint64_t num_sites(const SiteBox& box) {
  // Even and odd numbers from low to high.
  const auto count = [](std::int32_t low, std::int32_t high, std::int32_t parity) {
    const std::int32_t first = first_of_parity(low, parity);
    return first < high ? static_cast<std::uint64_t>(high - first + 1) / 2 : 0;
  };
  std::uint64_t sum = 0;
  for (const std::int32_t parity : {0, 1})
    sum += count(box.low.i, box.high.i, parity) * count(box.low.j, box.high.j, parity) *
           count(box.low.k, box.high.k, parity);
  return sum;
}

LatticeCore clipped(const LatticeCore& core, const SiteBox& box) {
  if (core.is_whole) return core;
  LatticeCore result;
  for (const auto& [first, count, body] : core.rows) {
    const auto& [i, j, k] = first;
    const std::int32_t low = std::max(k, first_of_parity(box.low.k, k));
    const std::int32_t high = std::min(k + 2 * static_cast<std::int32_t>(count), box.high.k);
    if (low < high && box.contains({i, j, low}))
      result.rows.push_back({{i, j, low}, static_cast<std::uint32_t>(high - low + 1) / 2, body});
  }
  return result;
}

LatticeCore without(const LatticeCore& core, const SiteBox& sites, const LatticeSite& site) {
  LatticeCore result;
  for_each_row(core, sites, [&](const LatticeRow& row, std::uint64_t) {
    const auto& [i, j, k] = row.first;
    const std::int32_t end = k + 2 * static_cast<std::int32_t>(row.count);
    if (i != site.i || j != site.j || site.k < k || site.k >= end) {
      result.rows.push_back(row);
      return;
    }
    if (k < site.k)
      result.rows.push_back({row.first, static_cast<std::uint32_t>(site.k - k) / 2, row.body});
    if (site.k + 2 < end)
      result.rows.push_back(
          {{i, j, site.k + 2}, static_cast<std::uint32_t>(end - site.k) / 2 - 1, row.body});
  });
  return result;
}

std::uint64_t num_points(const LatticeCore& core, const SiteBox& sites) {
  if (core.is_whole) return num_sites(sites);
  std::uint64_t sum = 0;
  for (const LatticeRow& row : core.rows) sum += row.count;
  return sum;
}

Lattice::Lattice(const Frame& frame, double size, double min_leaf_side)
    : origin_(frame.root_box().center() + size * kOffset),
      grid_origin_(frame.origin()),
      half_(0.5 * kLatticeSpacing * size),
      grid_side_(frame.side(frame.level_of_side(min_leaf_side))) {}

Lattice Lattice::of_cubes(const Frame& frame) {
  Lattice lattice;
  lattice.origin_ = lattice.grid_origin_ = frame.origin();
  lattice.half_ = frame.side(kSiteLevel);
  lattice.grid_side_ = frame.side(0);
  lattice.is_of_cubes_ = true;
  return lattice;
}

double Lattice::coordinate(int axis, std::int32_t index, std::uint64_t noise) const {
  const double exact = origin_[axis] + half_ * index;
  const double step = static_cast<double>(noise & 0xffff) - 0x1p15;  // -2^15 … 2^15 - 1
  const double place = (exact - grid_origin_[axis]) / grid_side_;
  constexpr double kRounding = 0x1.8p52;  // added and taken away, leaves the nearest integer
  const double from_plane = std::abs(place - ((place + kRounding) - kRounding)) * grid_side_;
  if (from_plane <= 2 * kDisplacement * half_) return exact;
  return origin_[axis] + half_ * (index + kDisplacement * 0x1p-15 * step);
}

Point Lattice::position(const LatticeSite& site) const {
  if (is_of_cubes_) return undisplaced(site);
  const auto bits = [](std::int32_t v) { return static_cast<std::uint64_t>(std::int64_t{v}); };
  const std::uint64_t noise = mix(mix(mix(bits(site.i)) ^ bits(site.j)) ^ bits(site.k));
  return {coordinate(0, site.i, noise), coordinate(1, site.j, noise >> 16),
          coordinate(2, site.k, noise >> 32)};
}

MeshPoint Lattice::point(const LatticeSite& site) const {
  return {id(site), position(site), PointKind::kLattice};
}

std::uint64_t Lattice::id(const LatticeSite& s) const {
  if (!is_of_cubes_) return site_id(s);
  const auto bits = [](std::int32_t v) {
    assert(0 <= v && v <= kMaxSiteIndex);
    return static_cast<std::uint64_t>(v);
  };
  return bits(s.i) << 40 | bits(s.j) << 20 | bits(s.k);
}

LatticeSite Lattice::site(std::uint64_t id) const {
  if (!is_of_cubes_) return site_of(id);
  const auto index = [&](int shift) {
    return static_cast<std::int32_t>(id >> shift & std::uint64_t{kMaxSiteIndex});
  };
  return {index(40), index(20), index(0)};
}

Point Lattice::undisplaced(const LatticeSite& site) const {
  return {origin_.x + half_ * site.i, origin_.y + half_ * site.j, origin_.z + half_ * site.k};
}

// Even and odd sites make up a cubic lattice each.
LatticeSite Lattice::nearest(const Point& q) const {
  const Point u = (1 / half_) * (q - origin_);
  const Point even{2 * std::floor(0.5 * u.x + 0.5), 2 * std::floor(0.5 * u.y + 0.5),
                   2 * std::floor(0.5 * u.z + 0.5)};
  const Point odd{2 * std::floor(0.5 * u.x) + 1, 2 * std::floor(0.5 * u.y) + 1,
                  2 * std::floor(0.5 * u.z) + 1};
  const Point& site = squared_distance(u, even) <= squared_distance(u, odd) ? even : odd;
  return {static_cast<std::int32_t>(site.x), static_cast<std::int32_t>(site.y),
          static_cast<std::int32_t>(site.z)};
}

std::int32_t Lattice::first_index_from(int axis, double bound) const {
  auto index = static_cast<std::int32_t>(std::floor((bound - origin_[axis]) / half_)) - 1;
  while (origin_[axis] + half_ * index < bound) ++index;
  return index;
}

SiteBox Lattice::sites_in(const Box& box) const {
  const auto corner = [&](const Point& p) {
    return LatticeSite{first_index_from(0, p.x), first_index_from(1, p.y),
                       first_index_from(2, p.z)};
  };
  return {corner(box.min), corner(box.max)};
}

void Lattice::sites_within(const Point& q, double radius, std::vector<LatticeSite>& out) const {
  out.clear();
  for_each_site(sites_in(Box::around(q).expanded(radius + kDisplacement * half_)),
                [&](const LatticeSite& site) {
                  if (squared_distance(position(site), q) <= radius * radius) out.push_back(site);
                });
}

std::uint64_t site_id(const LatticeSite& site) {
  const auto shifted = [](std::int32_t v) {
    assert(-kMaxSiteIndex <= v && v <= kMaxSiteIndex);
    return static_cast<std::uint64_t>(v + (1 << 20));
  };
  // The last bit of j and k is that of i.
  return shifted(site.i) << 40 | shifted(site.j) >> 1 << 20 | shifted(site.k) >> 1;
}

LatticeSite site_of(std::uint64_t id) {
  assert(id < kFirstOtherId);
  const std::uint64_t mask = (1 << 20) - 1;
  const std::uint64_t i = id >> 40, parity = i & 1;
  const auto index = [](std::uint64_t shifted) {
    return static_cast<std::int32_t>(shifted) - (1 << 20);
  };
  return {index(i), index((id >> 20 & mask) << 1 | parity), index((id & mask) << 1 | parity)};
}

}  // namespace locvol
