// find_self_intersection() against all pairs, decided in integers.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <ctime>
#include <optional>
#include <random>
#include <vector>

#include "refine/domain/exact_predicates.h"
#include "refine/domain/self_intersection.h"
#include "tests/integer_vector.h"

namespace locvol {
namespace {

using namespace integer_vectors;
using Corners = std::array<std::uint32_t, 3>;

std::int64_t side(const Vector& a, const Vector& b, const Vector& c, const Vector& d) {
  return dot(cross(b - a, c - a), d - a);
}

// Is p, in the plane of abc, on the triangle?
bool is_on(const Vector& p, const Vector& a, const Vector& b, const Vector& c) {
  const Vector n = cross(b - a, c - a);
  return dot(n, cross(b - a, p - a)) >= 0 && dot(n, cross(c - b, p - b)) >= 0 &&
         dot(n, cross(a - c, p - c)) >= 0;
}

// Do the segments pq and rs, in a plane with normal n, meet?
bool meet(const Vector& p, const Vector& q, const Vector& r, const Vector& s, const Vector& n) {
  const auto turn = [&](const Vector& a, const Vector& b, const Vector& c) {
    const std::int64_t v = dot(n, cross(b - a, c - a));
    return (v > 0) - (v < 0);
  };
  const auto within = [](const Vector& a, const Vector& b, const Vector& c) {  // collinear
    return dot(a - c, b - c) <= 0;
  };
  const int a = turn(p, q, r), b = turn(p, q, s), c = turn(r, s, p), d = turn(r, s, q);
  if (a != b && c != d && a * b <= 0 && c * d <= 0) return true;
  return (a == 0 && within(p, q, r)) || (b == 0 && within(p, q, s)) ||
         (c == 0 && within(r, s, p)) || (d == 0 && within(r, s, q));
}

bool segment_meets(const Vector& p, const Vector& q, const Vector& a, const Vector& b,
                   const Vector& c) {
  const std::int64_t sp = side(a, b, c, p), sq = side(a, b, c, q);
  if ((sp > 0 && sq > 0) || (sp < 0 && sq < 0)) return false;
  if (sp == 0 && sq == 0) {
    const Vector n = cross(b - a, c - a);
    return is_on(p, a, b, c) || is_on(q, a, b, c) || meet(p, q, a, b, n) || meet(p, q, b, c, n) ||
           meet(p, q, c, a, n);
  }
  const auto sign = [](std::int64_t v) { return (v > 0) - (v < 0); };
  const int x = sign(side(p, q, a, b)), y = sign(side(p, q, b, c)), z = sign(side(p, q, c, a));
  return (x >= 0 && y >= 0 && z >= 0) || (x <= 0 && y <= 0 && z <= 0);
}

bool intersect(const std::vector<Vector>& points, Corners s, Corners t) {
  std::vector<std::uint32_t> shared;
  for (const auto v : s)
    if (std::find(t.begin(), t.end(), v) != t.end()) shared.push_back(v);
  const auto at = [&](std::uint32_t v) { return points[v]; };
  if (shared.size() == 3) return true;
  if (shared.size() == 2) {
    const auto apex = [&](const Corners& u) {
      return at(*std::find_if(u.begin(), u.end(),
                              [&](auto v) { return v != shared[0] && v != shared[1]; }));
    };
    const Vector u = at(shared[0]), v = at(shared[1]), a = apex(s), b = apex(t);
    return side(u, v, a, b) == 0 && dot(cross(v - u, a - u), cross(v - u, b - u)) > 0;
  }
  for (int swap = 0; swap < 2; ++swap, std::swap(s, t))
    for (std::size_t k = 0; k < 3; ++k) {
      const auto p = s[k], q = s[(k + 1) % 3];
      if (!shared.empty() && (p == shared[0] || q == shared[0])) continue;
      if (segment_meets(at(p), at(q), at(t[0]), at(t[1]), at(t[2]))) return true;
    }
  return false;
}

std::optional<IntersectingPair> brute_force(const std::vector<Vector>& points,
                                            const std::vector<Corners>& triangles) {
  for (std::uint32_t i = 0; i < triangles.size(); ++i)
    for (std::uint32_t j = i + 1; j < triangles.size(); ++j)
      if (intersect(points, triangles[i], triangles[j])) return IntersectingPair{i, j};
  return std::nullopt;
}

// A linear map with an integer matrix keeps all incidences and takes them out of the coordinate
// planes; a power of two as factor keeps the doubles exact.
std::vector<Point> skewed(const std::vector<Vector>& points, double factor) {
  std::vector<Point> result;
  for (const auto& [x, y, z] : points)
    result.push_back({factor * static_cast<double>(7919 * x + 104 * y - 333 * z),
                      factor * static_cast<double>(-515 * x + 6007 * y + 41 * z),
                      factor * static_cast<double>(11 * x + 271 * y + 5003 * z)});
  return result;
}

struct Soup {
  std::vector<Vector> points;
  std::vector<Corners> triangles;
};

// Different points on a grid, not all on a line.
std::vector<Vector> random_points(std::mt19937& random, int extent, std::size_t count) {
  for (;;) {
    std::vector<Vector> points;
    while (points.size() < count) {
      Vector p;
      for (auto& c : p) c = static_cast<int>(random() % static_cast<unsigned>(extent));
      if (std::find(points.begin(), points.end(), p) == points.end()) points.push_back(p);
    }
    for (const Vector& p : points)
      if (cross(points[1] - points[0], p - points[0]) != Vector{}) return points;
  }
}

Soup random_soup(std::mt19937& random, int extent, std::size_t num_points,
                 std::size_t num_triangles) {
  Soup soup{random_points(random, extent, num_points), {}};
  while (soup.triangles.size() < num_triangles) {
    Corners t;
    for (auto& v : t) v = static_cast<std::uint32_t>(random() % num_points);
    const Vector n =
        cross(soup.points[t[1]] - soup.points[t[0]], soup.points[t[2]] - soup.points[t[0]]);
    if (dot(n, n) != 0) soup.triangles.push_back(t);
  }
  return soup;
}

std::optional<IntersectingPair> found_in(const std::vector<Point>& vertices,
                                         const std::vector<Corners>& triangles) {
  return find_self_intersection(vertices, triangles, TriangleTree(vertices, triangles));
}

TEST(SelfIntersection, AgreesWithIntegersOnPairs) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  int num_intersecting = 0;
  constexpr int kRounds = 60000;
  for (int round = 0; round < kRounds; ++round) {
    const Soup soup = random_soup(random, 2 + round % 5, 4 + random() % 3, 2);
    const auto expected = brute_force(soup.points, soup.triangles);
    num_intersecting += expected.has_value();
    for (const double factor : {1.0, 0x1p-140})
      ASSERT_EQ(found_in(skewed(soup.points, factor), soup.triangles), expected)
          << "round " << round;
  }
  EXPECT_GT(num_intersecting, kRounds / 20);
  EXPECT_LT(num_intersecting, kRounds * 19 / 20);
}

TEST(SelfIntersection, FindsTheSmallestPairOfMany) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  for (int round = 0; round < 300; ++round) {
    // Small triangles scattered in a large cube, so that the first pair comes late, if at all.
    Soup soup;
    for (std::uint32_t t = 0; t < 200; ++t) {
      Vector corner;
      for (auto& c : corner) c = static_cast<int>(random() % 60);
      Soup one = random_soup(random, 6, 3, 1);
      for (Vector& p : one.points)
        for (std::size_t k = 0; k < 3; ++k) p[k] += corner[k];
      soup.points.insert(soup.points.end(), one.points.begin(), one.points.end());
      soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    }
    ASSERT_EQ(found_in(skewed(soup.points, 1), soup.triangles),
              brute_force(soup.points, soup.triangles));
  }
}

TEST(SelfIntersection, ManyCoplanarTrianglesTakeNoTime) {
  // A grid in a skew plane: every neighbor is coplanar, where exact predicates are slowest.
  constexpr std::uint32_t kSide = 300;
  std::vector<Vector> points;
  std::vector<Corners> triangles;
  for (std::uint32_t i = 0; i <= kSide; ++i)
    for (std::uint32_t j = 0; j <= kSide; ++j) points.push_back({i, j, 0});
  for (std::uint32_t i = 0; i < kSide; ++i)
    for (std::uint32_t j = 0; j < kSide; ++j) {
      const std::uint32_t a = i * (kSide + 1) + j, b = a + kSide + 1;
      triangles.push_back({a, b, b + 1});
      triangles.push_back({a, b + 1, a + 1});
    }
  const auto started = std::clock();
  EXPECT_EQ(found_in(skewed(points, 1), triangles), std::nullopt);
  EXPECT_LT(static_cast<double>(std::clock() - started) / CLOCKS_PER_SEC, 20);
}

TEST(ExactPredicates, AgreeWithIntegers) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  const auto sign = [](std::int64_t v) { return (v > 0) - (v < 0); };
  for (int round = 0; round < 20000; ++round) {
    std::array<Vector, 4> v;
    std::array<Point, 4> p;
    for (std::size_t i = 0; i < 4; ++i) {
      for (auto& c : v[i]) c = static_cast<int>(random() % 4);
      // Powers of two keep the signs, and reach far below and above 1.
      p[i] = {static_cast<double>(v[i][0]), 0x1p-60 * static_cast<double>(v[i][1]),
              0x1p99 * static_cast<double>(v[i][2])};
    }
    const auto& [a, b, c, d] = p;
    EXPECT_EQ(orientation(a, b, c, d), sign(side(v[0], v[1], v[2], v[3])));
    const Vector n = cross(v[1] - v[0], v[2] - v[0]);
    EXPECT_EQ(are_collinear(a, b, c), dot(n, n) == 0);
    for (std::size_t axis = 0; axis < 3; ++axis)
      EXPECT_EQ(orientation_along(static_cast<int>(axis), a, b, c), sign(n[axis]));
  }
}

}  // namespace
}  // namespace locvol
