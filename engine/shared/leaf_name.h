// How messages name a leaf.
#pragma once

#include <array>
#include <charconv>
#include <string>

#include "octree/morton_key.h"

namespace locvol {

// The key's bits in hexadecimal.
inline std::string leaf_name(MortonKey leaf) {
  std::array<char, 16> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), leaf.bits(), 16).ptr;
  return "leaf " + std::string(digits.data(), end);
}

}  // namespace locvol
