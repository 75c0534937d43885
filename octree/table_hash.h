// Hashing for tables that are asked, never listed. (What decides geometry is hashed by mix().)
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

struct TableHash {
  template <class Integer, std::size_t n>
  std::size_t operator()(const std::array<Integer, n>& words) const {
    std::uint64_t hash = 0;
    for (const Integer word : words)
      hash = (std::rotl(hash, 29) ^ static_cast<std::uint64_t>(word)) * 0x9e3779b97f4a7c15;
    return hash ^ hash >> 32;
  }
  std::size_t operator()(MortonKey key) const { return (*this)(std::array{key.bits()}); }
  // Hashes a point by its bits: 0 and -0 differ.
  std::size_t operator()(const Point& p) const {
    return (*this)(std::bit_cast<std::array<std::uint64_t, 3>>(p));
  }
};

}  // namespace locvol
