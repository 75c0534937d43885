#include "engine/ingest/coordinate_step.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace locvol {
namespace {

constexpr int kFewDigits = 6;    // as C's and C++'s streams write unless told otherwise
constexpr int kMostDigits = 12;  // doubles have 15 to 17

// Of the first digit's place.
int decade(double v) { return static_cast<int>(std::floor(std::log10(v))); }

// Is it what decimal digits, so many of them, say? REQUIRES: v > 0
bool has_digits(double v, int num_digits) {
  const int shift = num_digits - 1 - decade(v);
  const double scale = std::pow(10.0, std::abs(shift));
  const double units = shift < 0 ? v / scale : v * scale;
  constexpr double kRoundings = 4;  // of the value, of the scale and of their product
  return std::abs(units - std::nearbyint(units)) <=
         kRoundings * std::numeric_limits<double>::epsilon() * units;
}

}  // namespace

void CoordinateStep::add(const Point& p) {
  for (int axis = 0; axis < 3; ++axis) add(p[axis]);
}

void CoordinateStep::add(double coordinate) {
  const double v = std::abs(coordinate);
  largest_ = std::max(largest_, v);
  is_single_ = is_single_ && static_cast<double>(static_cast<float>(coordinate)) == coordinate;
  if (!(v >= std::numeric_limits<double>::min())) return;
  while (num_digits_ <= kMostDigits && !has_digits(v, num_digits_)) ++num_digits_;
}

double CoordinateStep::value() const {
  if (num_digits_ < kFewDigits) return 0;
  if (is_single_) return std::ldexp(1.0, std::ilogb(largest_) - 23);
  return num_digits_ > kMostDigits ? 0 : std::pow(10.0, decade(largest_) + 1 - num_digits_);
}

}  // namespace locvol
