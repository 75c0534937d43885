// Random numbers that are a function of their seed alone, whatever the standard library.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "octree/mix.h"

namespace locvol::sweeps {

class Dice {
 public:
  explicit Dice(std::uint64_t seed) : state_(seed), rounding_(integer(0, 3)) {}
  // Independent of those of other numbers.
  Dice(std::uint64_t seed, std::uint64_t number) : Dice(Dice(seed).bits() ^ Dice(~number).bits()) {}

  std::uint64_t bits() {  // SplitMix64
    return mix(std::exchange(state_, state_ + 0x9e3779b97f4a7c15));
  }
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(bits() >> 11) * 0x1p-53);
  }
  // As likely between 1 and 10 as between 10 and 100.
  double log_uniform(double low, double high) {
    return low * std::exp(uniform(0, std::log(high / low)));
  }
  int integer(int low, int high) {  // both included
    return low + static_cast<int>(bits() % static_cast<std::uint64_t>(high - low + 1));
  }
  bool chance(double probability) { return uniform(0, 1) < probability; }
  template <typename T, std::size_t n>
  T one_of(const std::array<T, n>& values) {
    return values[bits() % n];
  }

  // A length as people type it: of one kind in all of a case, that is tenths, eighths, powers of
  // two, or any. Decimal fractions are exact: the double nearest to them.
  double length(double low, double high) {
    const double value = log_uniform(low, high);
    if (rounding_ == 0) return value;
    if (rounding_ == 1) return std::exp2(std::round(std::log2(value)));
    double parts = rounding_ == 2 ? 8 : 10;  // of a unit
    while (value * parts < 1) parts *= rounding_ == 2 ? 2 : 10;
    return std::round(value * parts) / parts;
  }

 private:
  std::uint64_t state_;
  int rounding_;
};

}  // namespace locvol::sweeps
