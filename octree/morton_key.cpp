#include "octree/morton_key.h"

#include <cassert>

namespace locvol {
namespace {

// Bit i of a 21-bit number goes to bit 3 i.
std::uint64_t spread(std::uint64_t v) {
  v = (v | v << 32) & 0x001f00000000ffff;
  v = (v | v << 16) & 0x001f0000ff0000ff;
  v = (v | v << 8) & 0x100f00f00f00f00f;
  v = (v | v << 4) & 0x10c30c30c30c30c3;
  return (v | v << 2) & 0x1249249249249249;
}

// The inverse of spread(); other bits of v are ignored.
std::uint32_t compact(std::uint64_t v) {
  v &= 0x1249249249249249;
  v = (v | v >> 2) & 0x10c30c30c30c30c3;
  v = (v | v >> 4) & 0x100f00f00f00f00f;
  v = (v | v >> 8) & 0x001f0000ff0000ff;
  v = (v | v >> 16) & 0x001f00000000ffff;
  return static_cast<std::uint32_t>((v | v >> 32) & 0x1fffff);
}

}  // namespace

MortonKey MortonKey::containing(GridPoint cell, int level) {
  assert(0 <= level && level <= kMaxLevel);
  assert(cell.x >> kMaxLevel == 0 && cell.y >> kMaxLevel == 0 && cell.z >> kMaxLevel == 0);
  const std::uint64_t octants = spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2;
  const std::uint64_t marker = std::uint64_t{1} << (3 * (kMaxLevel - level));
  return MortonKey((octants << 1 & ~(marker | (marker - 1))) | marker);
}

GridPoint MortonKey::grid_min() const {
  assert(is_valid());
  const std::uint64_t octants = range_min().bits_ >> 1;
  return {compact(octants), compact(octants >> 1), compact(octants >> 2)};
}

}  // namespace locvol
