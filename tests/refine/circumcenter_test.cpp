#include "refine/circumcenter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Random;
using shapes::uniform;
using CellPoints = std::array<Point, 4>;
using Corners = std::array<Point, 3>;

// Points of a plane, moved off it by a random multiple of `height`.
CellPoints flat_cell(Random& random, double height) {
  const Point origin = shapes::uniform_in(random, shapes::kCube),
              u = shapes::uniform_in(random, shapes::kCube),
              v = shapes::uniform_in(random, shapes::kCube);
  const Point n = cross(u, v);
  CellPoints cell;
  for (Point& p : cell) {
    const double s = uniform(random, -1, 1), t = uniform(random, -1, 1);
    p = origin + s * u + t * v + height * uniform(random, -1, 1) * n;
  }
  return cell;
}

CellPoints lattice_cell(Random& random, int side) {
  std::uniform_int_distribution<int> pick(0, side);
  CellPoints cell;
  for (Point& p : cell)
    for (int axis = 0; axis < 3; ++axis) p[axis] = pick(random);
  return cell;
}

CellPoints random_cell(Random& random) {
  CellPoints cell;
  for (Point& p : cell) p = shapes::uniform_in(random, shapes::kCube);
  return cell;
}

// Of every kind: well shaped, flat to any degree, exactly flat or nearly so, on a lattice.
std::vector<CellPoints> sample_cells(unsigned seed, int num_of_each) {
  Random random(seed);
  std::vector<CellPoints> cells;
  for (int n = 0; n < num_of_each; ++n) {
    cells.push_back(random_cell(random));
    for (const double height : {1e-3, 1e-6, 1e-10, 1e-14, 1e-17, 0.0})
      cells.push_back(flat_cell(random, height));
    cells.push_back(lattice_cell(random, 3));
    cells.push_back(lattice_cell(random, 100));
    CellPoints shifted = random_cell(random);
    for (Point& p : shifted) p = 1e-3 * p + Point{1000, -2000, 500};
    cells.push_back(shifted);
  }
  return cells;
}

template <std::size_t n>
double size_of(const std::array<Point, n>& points) {
  double largest = 0;
  for (const Point& p : points)
    for (const Point& q : points) largest = std::max(largest, norm(p - q));
  return largest;
}

bool equal_bits(const Circumball& a, const Circumball& b) {
  return a.center == b.center && a.squared_radius == b.squared_radius;
}

TEST(Circumball, OfTheRegularCell) {
  const Circumball ball = circumball({Point{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}});
  EXPECT_EQ(ball.center, (Point{0, 0, 0}));
  EXPECT_DOUBLE_EQ(ball.squared_radius, 3);
}

TEST(Circumball, OfABoxCorner) {
  const Circumball ball = circumball({Point{1, 2, 3}, {5, 2, 3}, {1, 8, 3}, {1, 2, 5}});
  EXPECT_EQ(ball.center, (Point{3, 5, 4}));
  EXPECT_DOUBLE_EQ(ball.squared_radius, 4 + 9 + 1);
}

// refine/ALGORITHM.md: the cells of the BCC lattice have circumradius (√5/4) a.
TEST(Circumball, OfABccCell) {
  const Circumball ball = circumball({Point{0, 0, 0}, {2, 0, 0}, {1, 1, 1}, {1, 1, -1}});
  EXPECT_EQ(ball.center, (Point{1, 0.5, 0}));
  EXPECT_DOUBLE_EQ(std::sqrt(ball.squared_radius), std::numbers::sqrt2 * std::sqrt(2.5) / 2);
}

TEST(Circumball, OfAFlatCellIsInfinite) {
  EXPECT_EQ(circumball({Point{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}).squared_radius,
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(circumball({Point{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {5, 5, 5}}).squared_radius,
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(circumball({Point{1, 2, 3}, {1, 2, 3}, {4, 0, 1}, {0, 7, 1}}).squared_radius,
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(circumball({Point{1, 2, 3}, {1, 2, 3}, {1, 2, 3}, {1, 2, 3}}).squared_radius,
            std::numeric_limits<double>::infinity());
}

TEST(Circumball, IsTheSameForAllOrdersOfTheVertices) {
  constexpr unsigned kSeed = 11;
  for (CellPoints cell : sample_cells(kSeed, 200)) {
    std::ranges::sort(cell);
    const Circumball ball = circumball(cell);
    while (std::ranges::next_permutation(cell).found)
      ASSERT_TRUE(equal_bits(circumball(cell), ball)) << "seed " << kSeed;
  }
}

// The header promises 10⁻¹¹ of the cell's size before rounding. A center far away has the relative
// precision of a double.
TEST(Circumball, AgreesWithRationals) {
  constexpr unsigned kSeed = 12;
  int num_flat = 0, num_far = 0;
  for (const CellPoints& cell : sample_cells(kSeed, 400)) {
    const Circumball ball = circumball(cell);
    const auto truth = brute_force::circumball(cell);
    if (!truth) {
      ASSERT_EQ(ball.squared_radius, std::numeric_limits<double>::infinity()) << "seed " << kSeed;
      ++num_flat;
      continue;
    }
    const double rounding = 4e-16 * (norm(truth->center) + truth->radius);
    ASSERT_LE(norm(ball.center - truth->center), 1e-10 * size_of(cell) + rounding)
        << "seed " << kSeed << ", radius " << truth->radius;
    ASSERT_NEAR(std::sqrt(ball.squared_radius) / truth->radius, 1, 1e-10) << "seed " << kSeed;
    num_far += truth->radius > 1e6 * size_of(cell);
  }
  EXPECT_GT(num_flat, 50);
  EXPECT_GT(num_far, 100);
}

// Powers of two change no significant bit, so neither may the branch that is taken.
TEST(Circumball, ScalesByPowersOfTwo) {
  constexpr unsigned kSeed = 13;
  for (const CellPoints& cell : sample_cells(kSeed, 100))
    for (const double factor : {0x1p-30, 0.5, 2.0, 0x1p30}) {
      CellPoints scaled = cell;
      for (Point& p : scaled) p = factor * p;
      const Circumball small = circumball(cell), large = circumball(scaled);
      ASSERT_TRUE(
          equal_bits(large, {factor * small.center, factor * factor * small.squared_radius}))
          << "seed " << kSeed << ", factor " << factor;
    }
}

// What is not larger than asked for comes out as ever, and most flat cells that are cost no more.
TEST(Circumball, MayBeInfiniteWhereItIsLargerThanAskedFor) {
  constexpr unsigned kSeed = 14;
  int num_given_up = 0;
  for (const CellPoints& cell : sample_cells(kSeed, 400)) {
    const Circumball ball = circumball(cell);
    const double radius = std::sqrt(ball.squared_radius);
    for (const double most : {0.5 * radius, (1 - 1e-9) * radius, (1 + 1e-9) * radius, 2 * radius,
                              0.1 * size_of(cell), 10 * size_of(cell)}) {
      const Circumball bounded = circumball(cell, most);
      if (equal_bits(bounded, ball)) continue;
      ASSERT_EQ(bounded.squared_radius, std::numeric_limits<double>::infinity())
          << "seed " << kSeed;
      ASSERT_GT(radius, most) << "seed " << kSeed;
      ++num_given_up;
    }
  }
  EXPECT_GT(num_given_up, 2000);
}

// ---- Axis of a triangle

TEST(AxisOf, ClosedForms) {
  const Axis right = axis_of({Point{0, 0, 1}, {4, 0, 1}, {0, 2, 1}});
  EXPECT_EQ(right.center, (Point{2, 1, 1}));
  EXPECT_DOUBLE_EQ(right.squared_radius, 5);
  EXPECT_EQ(right.direction, (Point{0, 0, -1})) << "sorted: (0,0,1), (0,2,1), (4,0,1)";
  EXPECT_EQ(axis_of({Point{0, 0, 0}, {1, 2, 3}, {2, 4, 6}}).squared_radius,
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(axis_of({Point{1, 2, 3}, {1, 2, 3}, {2, 4, 7}}).squared_radius,
            std::numeric_limits<double>::infinity());
}

TEST(AxisOf, IsTheSameForAllOrdersOfTheCorners) {
  constexpr unsigned kSeed = 14;
  for (const CellPoints& cell : sample_cells(kSeed, 100)) {
    Corners corners{cell[0], cell[1], cell[2]};
    std::ranges::sort(corners);
    const Axis axis = axis_of(corners);
    while (std::ranges::next_permutation(corners).found) {
      const Axis other = axis_of(corners);
      ASSERT_EQ(other.center, axis.center) << "seed " << kSeed;
      ASSERT_EQ(other.direction, axis.direction) << "seed " << kSeed;
      ASSERT_EQ(other.squared_radius, axis.squared_radius) << "seed " << kSeed;
    }
  }
}

TEST(AxisOf, AgreesWithRationals) {
  constexpr unsigned kSeed = 15;
  Random random(kSeed);
  for (int n = 0; n < 2000; ++n) {
    const CellPoints cell = n % 2 == 0 ? random_cell(random) : lattice_cell(random, 5);
    const Corners corners{cell[0], cell[1], cell[2]};
    const Axis axis = axis_of(corners);
    const auto truth = brute_force::circumball(corners);
    if (!truth) {
      ASSERT_EQ(axis.squared_radius, std::numeric_limits<double>::infinity())
          << "seed " << kSeed << ", n " << n;
      continue;
    }
    if (truth->radius > 1e3 * size_of(corners)) continue;  // its precision is not promised
    ASSERT_LE(norm(axis.center - truth->center), 1e-10 * size_of(corners))
        << "seed " << kSeed << ", n " << n;
    ASSERT_NEAR(std::sqrt(axis.squared_radius) / truth->radius, 1, 1e-10);
    ASSERT_NEAR(norm(axis.direction), 1, 1e-14);
    for (const Point& p : corners)
      ASSERT_NEAR(dot(axis.direction, p - axis.center), 0, 1e-10 * truth->radius);
    Corners sorted = corners;
    std::ranges::sort(sorted);
    ASSERT_EQ(brute_force::orientation(sorted[0], sorted[1], sorted[2], sorted[0] + axis.direction),
              1)
        << "right-handed; seed " << kSeed << ", n " << n;
  }
}

// ---- The smallest ball of a triangle

TEST(IsOutsideSmallestBall, IsExactForNearlyCocircularPoints) {
  constexpr unsigned kSeed = 16;
  Random random(kSeed);
  int num_outside = 0, num_changed = 0;  // by rounding, had the axis decided
  for (int n = 0; n < 20000; ++n) {
    const Point center = 1e3 * shapes::uniform_in(random, shapes::kCube);
    const Point u = shapes::uniform_in(random, shapes::kCube);
    const Point across = cross(u, shapes::uniform_in(random, shapes::kCube));
    const Point v = norm(u) / norm(across) * across;
    CellPoints cell;
    for (Point& p : cell) {
      const double angle = uniform(random, 0, 2 * std::numbers::pi);
      p = center + std::cos(angle) * u + std::sin(angle) * v;
    }
    const Corners corners{cell[0], cell[1], cell[2]};
    const Axis axis = axis_of(corners);
    if (!std::isfinite(axis.squared_radius)) continue;
    const bool is_outside = is_outside_smallest_ball(corners, cell[3]);
    ASSERT_EQ(is_outside, brute_force::side_of_smallest_ball(corners, cell[3]) < 0)
        << "seed " << kSeed << ", n " << n;
    num_outside += is_outside;
    num_changed += is_outside != (norm(cell[3] - axis.center) > std::sqrt(axis.squared_radius));
  }
  EXPECT_GT(num_outside, 5000);
  EXPECT_GT(num_changed, 100) << "such points show nothing";
}

TEST(IsOutsideSmallestBall, ClosedForms) {
  const Corners corners{Point{0, 0, 1}, {4, 0, 1}, {0, 2, 1}};
  EXPECT_TRUE(is_outside_smallest_ball(corners, {2, 1, 4}));
  EXPECT_FALSE(is_outside_smallest_ball(corners, {2, 1, 3}));
  EXPECT_FALSE(is_outside_smallest_ball(corners, {4, 2, 1})) << "on the sphere";
}

}  // namespace
}  // namespace locvol
