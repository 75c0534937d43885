// Winding numbers against sums of solid angles, and what is made of triangles that enclose nothing.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <numbers>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "refine/winding/chain.h"
#include "refine/winding/holes_alone.h"
#include "refine/winding/inside_surface.h"
#include "refine/winding/rim_ears.h"
#include "refine/winding/unfold_patch.h"
#include "refine/winding/winding_number.h"

namespace locvol {
namespace {

using Face = std::array<std::uint32_t, 3>;

LooseSurface box(const Point& low, const Point& high) {
  LooseSurface s;
  for (int k = 0; k < 8; ++k)
    s.vertices.push_back({(k & 1 ? high : low).x, (k & 2 ? high : low).y, (k & 4 ? high : low).z});
  s.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  s.groups.assign(12, 1);
  return s;
}

// Of radius 1, with 8 · 4ⁿ triangles.
LooseSurface ball(int n, const Point& center = {}) {
  LooseSurface s;
  s.vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  s.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                 {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int step = 0; step < n; ++step) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [known, is_new] =
          middles.emplace(std::minmax(a, b), static_cast<std::uint32_t>(s.vertices.size()));
      if (is_new) {
        const Point p = 0.5 * (s.vertices[a] + s.vertices[b]);
        s.vertices.push_back((1 / norm(p)) * p);
      }
      return known->second;
    };
    std::vector<Face> finer;
    for (const auto& [a, b, c] : s.triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    s.triangles = std::move(finer);
  }
  for (Point& p : s.vertices) p = p + center;
  s.groups.assign(s.triangles.size(), 1);
  return s;
}

LooseSurface both(LooseSurface one, const LooseSurface& other) {
  const auto first = static_cast<std::uint32_t>(one.vertices.size());
  one.vertices.insert(one.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (const auto& [a, b, c] : other.triangles)
    one.triangles.push_back({a + first, b + first, c + first});
  one.groups.insert(one.groups.end(), other.groups.begin(), other.groups.end());
  return one;
}

Chain chain_of(const LooseSurface& s) {
  Chain chain{s.vertices, {}};
  for (const Face& t : s.triangles) chain.triangles.push_back({t, 1, 1});
  return chain;
}

double volume_of(const LooseSurface& s) {
  double volume = 0;
  for (const auto& [a, b, c] : s.triangles)
    volume += dot(s.vertices[a], cross(s.vertices[b], s.vertices[c])) / 6;
  return volume;
}

LooseSurface wound(const LooseSurface& s, double spacing, WindingChanges& changes) {
  LooseSurface found = winding_surface(s, spacing, 0, changes, nullptr);
  EXPECT_TRUE(open_edges(chain_of(found)).empty());
  return found;
}
LooseSurface wound(const LooseSurface& s, double spacing = 0.1) {
  WindingChanges changes;
  return wound(s, spacing, changes);
}

double sum_of_angles(const Chain& chain, const Point& p) {
  double sum = 0;
  for (const ChainTriangle& t : chain.triangles) {
    const auto [a, b, c] = chain.points_of(t);
    const Point u = a - p, v = b - p, w = c - p;
    const double lu = norm(u), lv = norm(v), lw = norm(w);
    sum += t.times * 2 *
           std::atan2(dot(u, cross(v, w)),
                      lu * lv * lw + dot(u, v) * lw + dot(v, w) * lu + dot(w, u) * lv);
  }
  return sum / (4 * std::numbers::pi);
}

// ---- Numbers

TEST(WindingNumberOf, TrianglesAtRandomIsTheSumOfTheirAngles) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> at(-1, 1);
  const auto point = [&] { return Point{at(random), at(random), at(random)}; };
  for (int round = 0; round < 20; ++round) {
    Chain chain;
    for (int n = 0; n < 12; ++n) chain.vertices.push_back(point());
    std::uniform_int_distribution<std::uint32_t> vertex(0, 11);
    while (chain.triangles.size() < 20) {
      const Face t{vertex(random), vertex(random), vertex(random)};
      if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) chain.triangles.push_back({t, 1, 1});
    }
    unite_equal(chain);
    const WindingNumber number(chain);
    for (int n = 0; n < 50; ++n) {
      const Point p = 2.0 * point();
      EXPECT_NEAR(number.at(p), sum_of_angles(chain, p), 5e-3);
    }
    for (std::size_t t = 0; t < chain.triangles.size(); ++t) {
      const auto [behind, before] = number.beside(t);
      EXPECT_DOUBLE_EQ(behind - before, chain.triangles[t].times);
    }
  }
}

TEST(WindingNumberOf, WhatIsClosedIsWhole) {
  const WindingNumber number(chain_of(both(ball(2), box({-2, -2, -2}, {2, 2, 2}))));
  EXPECT_EQ(number.at({0, 0, 0}), 2);
  EXPECT_EQ(number.at({1, 0, 0}), 2 - (number.at({1, 0, 0}) == 1));  // a vertex: moved, one of both
  EXPECT_EQ(number.at({1.5, 0, 0}), 1);
  EXPECT_EQ(number.at({2.5, 0, 0}), 0);
}

// Coordinates are such that the place asked for often lies exactly on its triangle.
TEST(WindingNumberOf, TetrahedraOfALatticeIsOneBehindEachTriangle) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> coordinate(-4, 4);
  for (int round = 0; round < 2000; ++round) {
    LooseSurface s;
    for (int k = 0; k < 4; ++k)
      s.vertices.push_back(
          {0.5 * coordinate(random), 0.5 * coordinate(random), 0.5 * coordinate(random)});
    const auto& [a, b, c, d] =
        std::array{s.vertices[0], s.vertices[1], s.vertices[2], s.vertices[3]};
    const double volume = dot(cross(b - a, c - a), d - a);
    if (volume == 0) continue;
    s.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    if (volume < 0)
      for (Face& t : s.triangles) std::swap(t[1], t[2]);
    const WindingNumber number(chain_of(s));
    for (std::size_t t = 0; t < 4; ++t) {
      const auto [behind, before] = number.beside(t);
      EXPECT_EQ(behind, 1) << "round " << round;
      EXPECT_EQ(before, 0) << "round " << round;
    }
  }
}

TEST(WindingNumberOf, AnOpenBoxIsAHalfOnThePlaneOfItsHole) {
  LooseSurface open = box({0, 0, 0}, {1, 1, 1});
  open.triangles.resize(10);
  open.groups.resize(10);
  const WindingNumber number(chain_of(open));
  EXPECT_NEAR(number.at({1, 0.4, 0.6}), 0.5, 1e-9);
  EXPECT_GT(number.at({0.9, 0.4, 0.6}), 0.5);
  EXPECT_LT(number.at({1.1, 0.4, 0.6}), 0.5);
}

// ---- Surfaces

TEST(WindingSurface, OfWhatIsSoundIsThatItself) {
  WindingChanges changes;
  const LooseSurface ball_3 = ball(3);
  const LooseSurface found = wound(ball_3, 0.1, changes);
  EXPECT_EQ(found.triangles.size(), ball_3.triangles.size());
  EXPECT_DOUBLE_EQ(volume_of(found), volume_of(ball_3));
  EXPECT_EQ(changes.num_turned + changes.num_cut + changes.num_holes, 0u);
  EXPECT_EQ(changes.doubt, 0);
}

TEST(WindingSurface, UnitesWhatOverlaps) {
  // In general position, face in face, and with a common face.
  EXPECT_NEAR(volume_of(wound(both(box({0, 0, 0}, {2, 2, 2}), box({1, 1, 1}, {3, 3, 3})))), 15,
              1e-12);
  EXPECT_NEAR(volume_of(wound(both(box({0, 0, 0}, {2, 2, 2}), box({1, 0, 0}, {3, 2, 2})))), 12,
              1e-12);
  EXPECT_NEAR(volume_of(wound(both(box({0, 0, 0}, {2, 2, 2}), box({2, 0, 0}, {3, 2, 2})))), 12,
              1e-12);
  // One in the other is gone; faced inwards it is a cavity.
  LooseSurface inner = box({1, 1, 1}, {2, 2, 2});
  EXPECT_NEAR(volume_of(wound(both(box({0, 0, 0}, {3, 3, 3}), inner))), 27, 1e-12);
  for (Face& t : inner.triangles) std::swap(t[1], t[2]);
  EXPECT_NEAR(volume_of(wound(both(box({0, 0, 0}, {3, 3, 3}), inner))), 26, 1e-12);
}

TEST(WindingSurface, DropsDoubledAndInnerWallsAndTurnsTriangles) {
  const LooseSurface one = box({0, 0, 0}, {2, 2, 2});
  EXPECT_NEAR(volume_of(wound(both(one, one))), 8, 1e-12);
  LooseSurface wall = one;  // inside, from side to side
  wall.vertices.insert(wall.vertices.end(), {{1, 0, 0}, {1, 2, 0}, {1, 2, 2}, {1, 0, 2}});
  wall.triangles.insert(wall.triangles.end(), {{8, 9, 10}, {8, 10, 11}});
  wall.groups.assign(14, 1);
  WindingChanges changes;
  EXPECT_NEAR(volume_of(wound(wall, 0.1, changes)), 8, 1e-12);
  EXPECT_NEAR(changes.left_out_area, 4. / 28, 1e-9);
  LooseSurface turned = ball(3);
  for (std::size_t t = 0; t < turned.triangles.size(); t += 3)
    std::swap(turned.triangles[t][1], turned.triangles[t][2]);
  EXPECT_DOUBLE_EQ(volume_of(wound(turned)), volume_of(ball(3)));
}

// A flat hole closes by its plane, whatever its size; of the sphere, what a cap leaves.
TEST(WindingSurface, ClosesHoles) {
  LooseSurface open = box({0, 0, 0}, {1, 1, 1});
  open.triangles.resize(10);
  open.groups.resize(10);
  WindingChanges changes;
  for (const double spacing : {0.05, 0.3, 2.0}) {
    EXPECT_NEAR(volume_of(wound(open, spacing, changes)), 1, 1e-3);
    EXPECT_EQ(changes.num_holes, 1u);
    EXPECT_EQ(changes.largest_hole, 4u);
  }
  LooseSurface cap = ball(4);
  std::erase_if(cap.triangles, [&](const Face& t) { return cap.vertices[t[0]].z > 0.8; });
  cap.groups.resize(cap.triangles.size());
  const double whole = volume_of(ball(4)), lost = std::numbers::pi * 0.04 * (3 - 0.2) / 3;
  const double found = volume_of(wound(cap, 0.05));
  EXPECT_GT(found, whole - lost);  // it bulges
  EXPECT_LT(found, whole);
}

TEST(WindingSurface, OfDamagedBallsIsClosedAndNearTheBall) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  const auto draw = [&](double share) { return std::bernoulli_distribution(share)(random); };
  int num_closed = 0;
  for (int round = 0; round < 6; ++round) {
    LooseSurface s = ball(3);
    const double volume = volume_of(s);
    if (round % 2 == 1) s = both(s, ball(3, {1e-3, 2e-3, 3e-3}));
    std::erase_if(s.triangles, [&](const Face&) { return draw(0.03); });
    const std::size_t num = s.triangles.size();
    for (std::size_t t = 0; t < num; ++t) {
      if (draw(0.02)) s.triangles.push_back(s.triangles[t]);
      if (draw(0.05)) std::swap(s.triangles[t][1], s.triangles[t][2]);
    }
    s.groups.assign(s.triangles.size(), 1);
    WindingChanges changes;
    const LooseSurface found = winding_surface(s, 0.1, 0, changes, nullptr);
    if (!open_edges(chain_of(found)).empty()) continue;  // what rounding parts, which is refused
    ++num_closed;
    EXPECT_NEAR(volume_of(found), volume, 0.02 * volume) << round;
  }
  EXPECT_GE(num_closed, 4);
}

// One triangle of ten is missing, so that holes meet in vertices, all over.
TEST(WindingSurface, FillsManyHolesWithoutNewVertices) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  LooseSurface s = ball(4);
  const double volume = volume_of(s);
  const std::size_t num_vertices = s.vertices.size();
  std::erase_if(s.triangles, [&](const Face&) { return std::bernoulli_distribution(0.1)(random); });
  s.groups.resize(s.triangles.size());
  WindingChanges changes;
  const LooseSurface found = wound(s, 0.1, changes);
  EXPECT_NEAR(volume_of(found), volume, 0.01 * volume);
  EXPECT_GT(changes.num_holes, 50u);
  EXPECT_LE(found.vertices.size(), num_vertices + changes.num_holes / 10);
}

// As they come from disk.
class PassingSurface : public PassingTriangles {
 public:
  explicit PassingSurface(const LooseSurface& s) : s_(s) {
    locvol::for_each_edge(edges_of(chain_of(s)), [&](std::span<const ChainEdge> uses) {
      if (uses.size() == 2) {
        edges_.emplace_back(uses[0].triangle, uses[1].triangle);
        return;
      }
      const Point &low = s.vertices[uses[0].low], &high = s.vertices[uses[0].high];
      open.push_back(
          {uses[0].is_upward ? low : high, uses[0].is_upward ? high : low, uses[0].triangle});
    });
  }
  std::uint32_t num() const override { return static_cast<std::uint32_t>(s_.triangles.size()); }
  void for_each(
      const std::function<void(std::uint32_t, const Corners&, SheetId)>& visit) const override {
    for (std::uint32_t t = 0; t < num(); ++t) {
      const auto& [a, b, c] = s_.triangles[t];
      visit(t, {s_.vertices[a], s_.vertices[b], s_.vertices[c]}, s_.groups[t]);
    }
  }
  void for_each_edge(
      const std::function<void(std::uint32_t, std::uint32_t)>& visit) const override {
    for (const auto& [s, t] : edges_) visit(s, t);
  }

  std::vector<OpenSide> open;

 private:
  const LooseSurface& s_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges_;
};

// Whichever way is taken, the surface is the same, to the bit.
TEST(WindingSurface, OfHolesAloneIsTheSameWithoutAllTrianglesInMemory) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  const auto uniform = [&](double from, double to) {
    return std::uniform_real_distribution(from, to)(random);
  };
  int num_closed = 0, num_others = 0;
  for (int trial = 0; trial < 40; ++trial) {
    SCOPED_TRACE(testing::Message() << "trial " << trial);
    LooseSurface s = ball(4);
    if (trial % 3 == 0) s = both(s, ball(3, {2.5, 0, 0}));
    if (trial % 4 == 0) {  // a cavity, or a ball within
      LooseSurface inner = ball(3);
      for (Point& p : inner.vertices) p = 0.4 * p;
      if (trial % 8 == 0)
        for (auto& [a, b, c] : inner.triangles) std::swap(b, c);
      s = both(s, inner);
    }
    for (Point& p : s.vertices) p = uniform(0.99, 1.01) * p;
    for (SheetId& group : s.groups) group = uniform(0, 1) < 0.5 ? 1 : 2;
    if (trial % 5 == 0)
      for (auto& [a, b, c] : s.triangles) std::swap(b, c);
    std::vector<Point> centers;
    for (int n = 0; n < 5; ++n)
      centers.push_back(
          s.vertices[std::uniform_int_distribution<std::size_t>(0, s.vertices.size() - 1)(random)]);
    const double radius = uniform(0, 0.8), lost = trial % 2 == 0 ? 0 : uniform(0, 0.1);
    LooseSurface open;  // vertices are numbered as they come, as those of a file are
    std::map<std::uint32_t, std::uint32_t> numbers;
    const auto number_of = [&](std::uint32_t v) {
      const auto [place, is_new] =
          numbers.emplace(v, static_cast<std::uint32_t>(open.vertices.size()));
      if (is_new) open.vertices.push_back(s.vertices[v]);
      return place->second;
    };
    for (std::size_t t = 0; t < s.triangles.size(); ++t) {
      const Point& p = s.vertices[s.triangles[t][0]];
      if (uniform(0, 1) < lost ||
          std::ranges::any_of(centers, [&](const Point& q) { return norm(p - q) < radius; }))
        continue;
      Face its = s.triangles[t];
      for (std::uint32_t& v : its) v = number_of(v);
      open.triangles.push_back(its);
      open.groups.push_back(s.groups[t]);
    }
    const PassingSurface passing(open);
    if (passing.open.empty()) continue;
    const double spacing = uniform(0.05, 0.5);
    LooseSurface found;
    WindingChanges changes, of_all;
    std::vector<std::array<Point, 3>> triangles, expected;
    if (!close_holes_alone(
            passing, passing.open, spacing, 0, changes,
            [&](const std::array<Point, 3>& corners, SheetId group) {
              triangles.push_back(corners);
              found.groups.push_back(group);
            },
            nullptr)) {
      ++num_others;
      EXPECT_TRUE(triangles.empty());
      continue;
    }
    ++num_closed;
    const LooseSurface all = wound(open, spacing, of_all);
    for (const auto& [a, b, c] : all.triangles)
      expected.push_back({all.vertices[a], all.vertices[b], all.vertices[c]});
    EXPECT_TRUE(triangles == expected);
    EXPECT_EQ(found.groups, all.groups);
    EXPECT_EQ(changes.num_turned, of_all.num_turned);
    EXPECT_EQ(changes.left_out_area, of_all.left_out_area);
    EXPECT_EQ(changes.num_holes, of_all.num_holes);
    EXPECT_EQ(changes.largest_hole, of_all.largest_hole);
    EXPECT_EQ(changes.closing_area, of_all.closing_area);
    EXPECT_EQ(changes.doubt, of_all.doubt);
  }
  EXPECT_GT(num_closed, 5);
  EXPECT_GT(num_others, 0);
}

// A comb: unit squares in a row, and teeth on those of even places. The pockets between teeth fill,
// and beside the last one half of a square.
TEST(CloseNotches, FillsThePocketsOfAComb) {
  Chain comb;
  for (std::uint32_t y = 0; y < 3; ++y)
    for (std::uint32_t x = 0; x < 11; ++x)
      comb.vertices.push_back({static_cast<double>(x), static_cast<double>(y), 0});
  const auto add_square = [&](std::uint32_t x, std::uint32_t y) {
    const std::uint32_t a = x + 11 * y, b = a + 1, c = a + 12, d = a + 11;
    comb.triangles.push_back({{a, b, c}, 1, 7});
    comb.triangles.push_back({{a, c, d}, 1, 7});
  };
  for (std::uint32_t x = 0; x < 10; ++x) {
    add_square(x, 0);
    if (x % 2 == 0) add_square(x, 1);
  }
  const std::size_t num_before = comb.triangles.size();
  EXPECT_EQ(close_notches(comb), 9U);
  EXPECT_EQ(comb.triangles.size(), num_before + 9);
  EXPECT_DOUBLE_EQ(comb.area(), 10 + 5 + 4 + 0.5);
  for (const ChainTriangle& t : comb.triangles) {
    EXPECT_GT(comb.normal_of(t).z, 0);
    EXPECT_EQ(t.group & ~kOverHole, 7U);
    EXPECT_EQ((t.group & kOverHole) != 0, &t >= &comb.triangles[num_before]);
  }
  EXPECT_EQ(close_notches(comb), 0U);
}

// Its lid would stand at right angles on its walls.
TEST(CloseNotches, PutsNoLidOnABox) {
  Chain open_box = chain_of(box({0, 0, 0}, {1, 1, 1}));
  open_box.triangles.erase(open_box.triangles.begin() + 2, open_box.triangles.begin() + 4);
  ASSERT_EQ(open_edges(open_box).size(), 4U);
  EXPECT_EQ(close_notches(open_box), 0U);
}

// Of balls that lack triangles at random: each ear takes the place of one open edge by two, faces
// outwards, and edges stay in two triangles at most that have them in opposite ways.
TEST(CloseNotches, GoOnAlongTheSurface) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937_64 random(seed);
  std::size_t num_all = 0;
  for (int trial = 0; trial < 20; ++trial) {
    Chain chain = chain_of(ball(3));
    std::erase_if(chain.triangles, [&](const ChainTriangle& t) {
      return chain.vertices[t.corners[0]].z > 0.3 && random() % 4 != 0;
    });
    const std::size_t num_open = open_edges(chain).size(), num_before = chain.triangles.size();
    const std::size_t num = close_notches(chain);
    num_all += num;
    EXPECT_EQ(open_edges(chain).size(), num_open - num);
    for (std::size_t n = num_before; n < chain.triangles.size(); ++n) {
      const auto [a, b, c] = chain.points_of(chain.triangles[n]);
      EXPECT_GT(dot(chain.normal_of(chain.triangles[n]), a + b + c), 0);
    }
    for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
      ASSERT_LE(uses.size(), 2U);
      if (uses.size() == 2) {
        EXPECT_NE(uses[0].is_upward, uses[1].is_upward);
      }
    });
  }
  EXPECT_GT(num_all, 100U);
}

// A stump with an arrowhead on top, whose lid has the diagonal that is outside of it: one half is
// folded back.
Chain stump_with_folded_lid() {
  Chain chain;
  chain.vertices = {{0, 0, 0},    {4, 0, 0},   {1, 1, 0},  {0, 4, 0},
                    {-1, -1, -1}, {7, -1, -1}, {2, 2, -1}, {-1, 7, -1}};
  for (std::uint32_t k = 0; k < 4; ++k) {
    const std::uint32_t next = (k + 1) % 4;
    chain.triangles.push_back({{next, k, k + 4}, 1, 7});
    chain.triangles.push_back({{next, k + 4, next + 4}, 1, 7});
  }
  chain.triangles.push_back({{4, 6, 5}, 1, 7});
  chain.triangles.push_back({{4, 7, 6}, 1, 7});
  chain.triangles.push_back({{0, 1, 3}, 1, 7 | kOverHole});
  chain.triangles.push_back({{1, 2, 3}, 1, 7 | kOverHole});
  return chain;
}

TEST(UnfoldPatch, TurnsTheEdgeOfAFold) {
  Chain stump = stump_with_folded_lid();
  ASSERT_TRUE(open_edges(stump).empty());
  ASSERT_LT(stump.normal_of(stump.triangles.back()).z, 0);
  EXPECT_EQ(unfold_patch(stump), 1U);
  EXPECT_TRUE(open_edges(stump).empty());
  for (const std::size_t t : {10U, 11U}) EXPECT_GT(stump.normal_of(stump.triangles[t]).z, 0);
  EXPECT_EQ(unfold_patch(stump), 0U);
}

TEST(UnfoldPatch, LeavesWhatWasThere) {
  Chain stump = stump_with_folded_lid();
  stump.triangles.back().group = 7;
  EXPECT_EQ(unfold_patch(stump), 0U);
  Chain lid = stump_with_folded_lid();  // with two other corners that have an edge already
  lid.triangles.push_back({{0, 2, 4}, 1, 7});
  EXPECT_EQ(unfold_patch(lid), 0U);
}

// Of balls whose vertices are moved along them, so that triangles are folded back: what is closed
// stays so, and each turn takes a fold away.
TEST(UnfoldPatch, KeepsWhatIsClosed) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> by(-0.25, 0.25);
  const auto num_folded = [](const Chain& chain) {
    std::size_t num = 0;
    for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
      const Point a = chain.normal_of(chain.triangles[uses[0].triangle]),
                  b = chain.normal_of(chain.triangles[uses[1].triangle]);
      num += dot(a, b) < -std::sqrt(0.5) * norm(a) * norm(b);
    });
    return num;
  };
  std::size_t num_turned = 0;
  for (int trial = 0; trial < 20; ++trial) {
    Chain chain = chain_of(ball(2));
    for (Point& p : chain.vertices) {
      const Point q = p + Point{by(random), by(random), by(random)};
      p = (1 / norm(q)) * q;
    }
    for (ChainTriangle& t : chain.triangles) t.group |= kOverHole;
    const std::size_t num_triangles = chain.triangles.size();
    const std::size_t num_before = num_folded(chain);
    const std::size_t num = unfold_patch(chain);
    num_turned += num;
    EXPECT_EQ(chain.triangles.size(), num_triangles);
    EXPECT_LE(num_folded(chain) + num, num_before);
    for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
      ASSERT_EQ(uses.size(), 2U);
      EXPECT_NE(uses[0].is_upward, uses[1].is_upward);
    });
  }
  EXPECT_GT(num_turned, 0U);
}

// Wide, but not so far from the level that it has to be followed.
TEST(WindingSurface, FillsAWideHoleWithTrianglesBetweenItsEdges) {
  LooseSurface cap = ball(4);
  std::erase_if(cap.triangles, [&](const Face& t) { return cap.vertices[t[0]].z > 0.9; });
  cap.groups.resize(cap.triangles.size());
  const LooseSurface found = wound(cap, 0.05);
  EXPECT_LE(found.vertices.size(), ball(4).vertices.size());
  const double volume = volume_of(ball(4));
  EXPECT_LT(volume_of(found), volume);
  EXPECT_GT(volume_of(found), 0.97 * volume);
}

// Its two sides would make two halves of it, if each were closed by itself.
TEST(WindingSurface, ClosesACrackAllAround) {
  LooseSurface s = ball(4);
  const double volume = volume_of(s);
  std::erase_if(s.triangles, [&](const Face& t) {
    double low = 1, high = -1;
    for (const std::uint32_t v : t) {
      low = std::min(low, s.vertices[v].z);
      high = std::max(high, s.vertices[v].z);
    }
    return low < 0.02 && high > 0.02;
  });
  s.groups.resize(s.triangles.size());
  const LooseSurface found = wound(s, 0.05);
  EXPECT_NEAR(volume_of(found), volume, 0.02 * volume);
  double largest = 0;  // of triangles across the inside there would be some
  for (const auto& [a, b, c] : found.triangles)
    for (const std::uint32_t v : {a, b, c})
      largest = std::max(largest, 1 - norm(found.vertices[v]));
  EXPECT_LT(largest, 0.1);
}

// Points of each triangle beside those of its neighbors.
LooseSurface apart(const LooseSurface& s, double distance, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> by(-distance, distance);
  LooseSurface result;
  for (const Face& t : s.triangles) {
    const auto first = static_cast<std::uint32_t>(result.vertices.size());
    for (const std::uint32_t v : t) {
      const double x = by(random), y = by(random);
      result.vertices.push_back(s.vertices[v] + Point{x, y, by(random)});
    }
    result.triangles.push_back({first, first + 1, first + 2});
    result.groups.push_back(1);
  }
  return result;
}

TEST(WindingSurface, JoinsPointsAtOpenEdges) {
  const LooseSurface sound = ball(3), loose = apart(sound, 1e-5, 3);
  WindingChanges changes;
  const LooseSurface found = winding_surface(loose, 0.1, 1e-4, changes, nullptr);
  EXPECT_EQ(found.vertices.size(), sound.vertices.size());
  EXPECT_EQ(found.triangles.size(), sound.triangles.size());
  EXPECT_EQ(changes.num_joined, loose.vertices.size() - sound.vertices.size());
  EXPECT_GT(changes.largest_move, 0);
  EXPECT_LT(changes.largest_move, 4e-5);
  EXPECT_FALSE(changes.is_level);
}

TEST(WindingSurface, OfTrianglesWithoutNeighborsIsTheLevel) {
  const double volume = volume_of(ball(4));
  WindingChanges changes;
  const LooseSurface found = wound(apart(ball(4), 5e-3, 3), 0.2, changes);
  EXPECT_TRUE(changes.is_level);
  EXPECT_NEAR(volume_of(found), volume, 0.03 * volume);
  EXPECT_LT(found.triangles.size(), ball(4).triangles.size());
  EXPECT_FALSE(wound(ball(4), 0.1, changes).triangles.empty());
  EXPECT_FALSE(changes.is_level);
}

TEST(WindingSurface, ItsDoubtIsThatOfTheWholeBoxAroundASheet) {
  EXPECT_EQ(winding_doubt(ball(3), nullptr).share, 0);
  LooseSurface open = ball(3);
  open.triangles.pop_back();
  WindingChanges changes;
  wound(open, 0.1, changes);
  EXPECT_GT(winding_doubt(open, nullptr).share, 0);
  EXPECT_EQ(winding_doubt(open, nullptr).share, changes.doubt);
  EXPECT_NEAR(winding_doubt(open, nullptr).inside, std::numbers::pi / 6, 0.02);
  for (Face& t : open.triangles) std::swap(t[1], t[2]);
  EXPECT_NEAR(winding_doubt(open, nullptr).inside, std::numbers::pi / 6, 0.02);
  LooseSurface half = ball(3);
  std::erase_if(half.triangles, [&](const Face& t) { return half.vertices[t[0]].z < 0.3; });
  half.groups.resize(half.triangles.size());
  EXPECT_GT(winding_doubt(half, nullptr).share, 0.5);
  LooseSurface square = box({0, 0, 0}, {1, 1, 1});
  square.triangles.resize(2);
  square.groups.resize(2);
  EXPECT_EQ(winding_doubt(square, nullptr).inside, 0);
  EXPECT_FALSE(winding_doubt(square, nullptr).is_nothing);
  square.triangles.push_back({0, 1, 2});
  square.triangles.push_back({1, 3, 2});
  EXPECT_TRUE(winding_doubt(square, nullptr).is_nothing);
}

// Glued at a triangle that both have.
TEST(WindingSurface, OfTwoTetrahedraIsTheSameInAnyOrder) {
  LooseSurface s;
  s.vertices = {{1, 0, 0}, {-0.5, 0.8660254, 0}, {-0.5, -0.8660254, 0}, {0, 0, 1}, {0, 0, -1}};
  s.triangles = {{3, 0, 1}, {3, 1, 2}, {3, 2, 0}, {2, 1, 0},
                 {4, 1, 0}, {4, 2, 1}, {4, 0, 2}, {2, 0, 1}};
  s.groups.assign(8, 1);
  std::mt19937 random(3);
  for (int round = 0; round < 50; ++round) {
    std::ranges::shuffle(s.triangles, random);
    const LooseSurface found = wound(s);
    EXPECT_EQ(found.triangles.size(), 6u);
    double volume = 0;
    for (const auto& [a, b, c] : found.triangles)
      volume += dot(found.vertices[a], cross(found.vertices[b], found.vertices[c])) / 6;
    EXPECT_NEAR(volume, 0.8660254, 1e-12);
  }
}

TEST(WindingSurface, OfSheetsIsNothing) {
  LooseSurface square;
  square.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  square.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 2, 1}, {0, 3, 2}};  // both sides
  square.groups.assign(4, 1);
  EXPECT_TRUE(wound(square).triangles.empty());
}

TEST(WindingSurface, KeepsGroups) {
  LooseSurface open = box({0, 0, 0}, {1, 1, 1});
  open.triangles.resize(10);
  open.groups = {1, 1, 2, 2, 3, 3, 4, 4, 5, 5};
  for (const SheetId group : wound(open, 0.2).groups) {
    EXPECT_GE(group, 1u);
    EXPECT_LE(group, 5u);
  }
}

// The area of triangles that are told to be over holes.
double area_over_holes(const LooseSurface& s) {
  double area = 0;
  for (std::size_t t = 0; t < s.triangles.size(); ++t) {
    const auto& [a, b, c] = s.triangles[t];
    if ((s.groups[t] & kOverHole) != 0)
      area += 0.5 * norm(cross(s.vertices[b] - s.vertices[a], s.vertices[c] - s.vertices[a]));
  }
  return area;
}

// A face that is missing leaves its edges in a plane; two leave a rim that is bent.
TEST(WindingSurface, TellsWhatIsOverWideHolesWithBentRims) {
  LooseSurface open = box({0, 0, 0}, {1, 1, 1});
  open.triangles.resize(10);
  open.groups.resize(10);
  EXPECT_EQ(area_over_holes(wound(open, 0.2)), 0);
  open = box({0, 0, 0}, {1, 1, 1});
  open.triangles.erase(open.triangles.begin() + 6, open.triangles.begin() + 8);
  open.triangles.resize(8);
  open.groups.resize(8);
  EXPECT_EQ(area_over_holes(wound(open, 0.4)), 0);
  const LooseSurface found = wound(open, 0.2);
  EXPECT_NEAR(area_over_holes(found), chain_of(found).area() - 4, 1e-9);
}

}  // namespace
}  // namespace locvol
