// MortonKey names one octree node in 64 bits: the child octants from the root down (3 bits each),
// then a 1, then zeros. Two properties follow, and storage/ relies on both:
//   - integer order is Morton order (a parent sorts between its children 3 and 4);
//   - the descendants of a node fill one unbroken range, [range_min(), range_max()].
// Octant bits: 1 = upper half in x, 2 = in y, 4 = in z.
// A value type: copy it freely.
#pragma once

#include <bit>
#include <cassert>
#include <compare>
#include <cstdint>

namespace locvol {

// A corner of the finest octree grid: integers from 0 to 2^21 on each axis, both ends included.
struct GridPoint {
  std::uint32_t x = 0, y = 0, z = 0;
  friend bool operator==(const GridPoint&, const GridPoint&) = default;
};

class MortonKey {
 public:
  static constexpr int kMaxLevel = 21;  // the root is level 0
  constexpr MortonKey() = default;      // not valid
  static constexpr MortonKey root() { return MortonKey(std::uint64_t{1} << (3 * kMaxLevel)); }
  static constexpr MortonKey from_bits(std::uint64_t bits) { return MortonKey(bits); }
  // The node of `level` whose half-open box holds the grid cell with its lower corner at `cell`.
  // REQUIRES: 0 <= level <= kMaxLevel, coordinates below 2^21
  static MortonKey containing(GridPoint cell, int level);

  constexpr std::uint64_t bits() const { return bits_; }
  constexpr bool is_valid() const { return bits_ != 0 && std::countr_zero(bits_) % 3 == 0; }
  constexpr int level() const { return kMaxLevel - std::countr_zero(bits_) / 3; }
  constexpr MortonKey child(int octant) const;  // REQUIRES: level() < kMaxLevel, 0 <= octant < 8
  constexpr MortonKey parent() const;           // REQUIRES: level() > 0
  constexpr int octant() const;                 // in its parent; REQUIRES: level() > 0
  constexpr bool is_ancestor_or_self_of(MortonKey other) const {
    return range_min() <= other && other <= range_max();
  }
  constexpr MortonKey range_min() const { return MortonKey(bits_ - (marker() - 1)); }
  constexpr MortonKey range_max() const { return MortonKey(bits_ + (marker() - 1)); }
  GridPoint grid_min() const;  // lower corner on the finest grid
  constexpr std::uint32_t grid_side() const { return std::uint32_t{1} << (kMaxLevel - level()); }
  friend constexpr auto operator<=>(MortonKey, MortonKey) = default;

 private:
  explicit constexpr MortonKey(std::uint64_t bits) : bits_(bits) {}
  constexpr std::uint64_t marker() const { return bits_ & -bits_; }  // the lowest 1
  std::uint64_t bits_ = 0;
};

// A node with its marker at bit k has its own octant in bits k+1 to k+3, above the marker; a child
// puts its octant in bits k-2 to k and its marker at k-3.
constexpr MortonKey MortonKey::child(int octant) const {
  assert(is_valid() && level() < kMaxLevel && 0 <= octant && octant < 8);
  const std::uint64_t m = marker();
  return MortonKey((bits_ ^ m) | ((m >> 2) * static_cast<std::uint64_t>(octant)) | (m >> 3));
}

constexpr MortonKey MortonKey::parent() const {
  assert(is_valid() && level() > 0);
  const std::uint64_t parent_marker = marker() << 3;
  return MortonKey((bits_ & ~(parent_marker | (parent_marker - 1))) | parent_marker);
}

constexpr int MortonKey::octant() const {
  assert(is_valid() && level() > 0);
  return static_cast<int>((bits_ >> (std::countr_zero(bits_) + 1)) & 7);
}

}  // namespace locvol
