// Random numbers and points for the tests of sizes.
#pragma once

#include <cstdint>
#include <random>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

inline constexpr std::uint32_t kGridSide = std::uint32_t{1} << MortonKey::kMaxLevel;
inline const Frame kFrame({-4, -4, -4}, 0x1p-18);  // a root of side 8

class RandomPlaces {
 public:
  explicit RandomPlaces(std::uint64_t seed) : random_(seed) {}

  std::uint64_t bits() { return random_(); }
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Point point(const Box& box) {
    return {uniform(box.min.x, box.max.x), uniform(box.min.y, box.max.y),
            uniform(box.min.z, box.max.z)};
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace locvol
