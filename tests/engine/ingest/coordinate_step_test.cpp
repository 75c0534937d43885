#include "engine/ingest/coordinate_step.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

namespace locvol {
namespace {

// Of points in a cube, each coordinate as `round` leaves it.
template <class Round>
double step_of(double from, double to, const Round& round, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> coordinate(from, to);
  CoordinateStep step;
  for (int i = 0; i < 100; ++i)
    step.add({round(coordinate(random)), round(coordinate(random)), round(coordinate(random))});
  return step.value();
}

TEST(CoordinateStep, IsAUnitOfTheLastPlaceThatIsWritten) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  for (int digits = 6; digits <= 12; ++digits) {
    const auto written = [&](double v) { return std::stod(fmt::format("{:.{}g}", v, digits)); };
    for (const double scale : {1e-6, 1.0, 1e3, 1e9}) {
      const double step = step_of(-9.9 * scale, 9.9 * scale, written, seed);
      EXPECT_NEAR(step / scale, std::pow(10.0, 1 - digits), 1e-9 * step) << digits << ' ' << scale;
    }
  }
  const auto in_micrometers = [](double v) { return std::stod(fmt::format("{:.6f}", v)); };
  EXPECT_NEAR(step_of(-200, 200, in_micrometers, seed), 1e-6, 1e-15);
}

TEST(CoordinateStep, IsThatOfSinglePrecision) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  const auto single = [](double v) { return static_cast<double>(static_cast<float>(v)); };
  EXPECT_EQ(step_of(2.5, 3.9, single, seed), std::ldexp(1.0, -22));
  EXPECT_EQ(step_of(-1000, -600, single, seed), std::ldexp(1.0, -14));
}

TEST(CoordinateStep, IsNoneWhereNothingIsRounded) {
  const std::uint64_t seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  EXPECT_EQ(step_of(
                -1, 1, [](double v) { return v; }, seed),
            0);
  EXPECT_EQ(step_of(
                -1, 1, [](double v) { return std::round(v * 100) / 8; }, seed),
            0);
  EXPECT_EQ(step_of(
                -1, 1, [](double) { return 0.0; }, seed),
            0);
  EXPECT_EQ(CoordinateStep().value(), 0);
}

}  // namespace
}  // namespace locvol
