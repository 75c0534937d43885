#include "octree/lattice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "octree/octree.h"
#include "octree/site_block.h"

namespace locvol {
namespace {

using Random = std::mt19937_64;
using Sites = std::set<LatticeSite>;

double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

std::int32_t integer(Random& random, std::int32_t low, std::int32_t high) {
  return std::uniform_int_distribution<std::int32_t>(low, high)(random);
}

// A seed that a failure shows.
class Seeded : public testing::Test {
 protected:
  void SetUp() override { RecordProperty("seed", std::to_string(seed_)); }
  void TearDown() override {
    if (HasFailure()) ADD_FAILURE() << "seed " << seed_;
  }
  const unsigned seed_ = std::random_device()();
  Random random_{seed_};
};

class LatticeTest : public Seeded {};
class LatticeCoreTest : public Seeded {};

bool is_site(const LatticeSite& s) { return (s.i & 1) == (s.j & 1) && (s.i & 1) == (s.k & 1); }

LatticeSite random_site(Random& random, std::int32_t bound) {
  LatticeSite site;
  do {
    site = {integer(random, -bound, bound), integer(random, -bound, bound),
            integer(random, -bound, bound)};
  } while (!is_site(site));
  return site;
}

bool owns(const Box& box, const Point& p) {
  for (const int axis : {0, 1, 2})
    if (!(box.min[axis] <= p[axis] && p[axis] < box.max[axis])) return false;
  return true;
}

// ---- Sites and their ids

TEST_F(LatticeTest, SitesAndIdsInvertEachOther) {
  std::vector<LatticeSite> sites{{-kMaxSiteIndex, -kMaxSiteIndex, -kMaxSiteIndex},
                                 {kMaxSiteIndex, kMaxSiteIndex, kMaxSiteIndex},
                                 {kMaxSiteIndex, -kMaxSiteIndex, kMaxSiteIndex},
                                 {1 - kMaxSiteIndex, kMaxSiteIndex - 1, 0},
                                 {0, 0, 0}};
  for (int n = 0; n < 100'000; ++n)
    sites.push_back(random_site(random_, n % 2 ? kMaxSiteIndex : 5));
  for (const LatticeSite& site : sites) {
    ASSERT_TRUE(is_site(site));
    const std::uint64_t id = site_id(site);
    ASSERT_LT(id, kFirstOtherId);
    ASSERT_EQ(site_of(id), site);
  }
}

TEST_F(LatticeTest, IdsAreInTheOrderOfSites) {
  for (int n = 0; n < 100'000; ++n) {
    const std::int32_t bound = n % 2 ? kMaxSiteIndex : 2;
    const LatticeSite a = random_site(random_, bound), b = random_site(random_, bound);
    ASSERT_EQ(a < b, site_id(a) < site_id(b));
    ASSERT_EQ(a == b, site_id(a) == site_id(b));
  }
}

TEST_F(LatticeTest, ForEachSiteGoesThroughABoxInOrder) {
  for (int trial = 0; trial < 200; ++trial) {
    const LatticeSite low{integer(random_, -9, 9), integer(random_, -9, 9),
                          integer(random_, -9, 9)};
    const SiteBox box{low, low + LatticeSite{integer(random_, -1, 6), integer(random_, -1, 6),
                                             integer(random_, -1, 6)}};
    std::vector<LatticeSite> expected, visited;
    for (std::int32_t i = -20; i < 20; ++i)
      for (std::int32_t j = -20; j < 20; ++j)
        for (std::int32_t k = -20; k < 20; ++k)
          if (is_site({i, j, k}) && box.contains({i, j, k})) expected.push_back({i, j, k});
    for_each_site(box, [&](const LatticeSite& site) { visited.push_back(site); });
    ASSERT_EQ(visited, expected);
    ASSERT_EQ(num_sites(box), expected.size());
  }
}

TEST_F(LatticeTest, ABlockHoldsAValueForEachSite) {
  for (int trial = 0; trial < 100; ++trial) {
    const LatticeSite low{integer(random_, -9, 9), integer(random_, -9, 9),
                          integer(random_, -9, 9)};
    const SiteBox box{low, low + LatticeSite{integer(random_, 0, 6), integer(random_, 0, 6),
                                             integer(random_, 0, 6)}};
    SiteBlock<int> block(box, -1);
    int n = 0;
    for_each_site(box, [&](const LatticeSite& site) {
      ASSERT_EQ(block[site], -1);
      block[site] = n++;
    });
    n = 0;
    for_each_site(box, [&](const LatticeSite& site) { ASSERT_EQ(block[site], n++); });
  }
}

// ---- Positions

struct Scene {
  Frame frame;
  int level = 0;    // of the leaves
  double size = 1;  // λ
  Lattice lattice() const { return {frame, size, frame.side(level)}; }
  MortonKey random_leaf(Random& random) const {
    const auto step = [&] { return static_cast<std::uint32_t>(random() >> 43); };
    return MortonKey::containing({step(), step(), step()}, level);
  }
};

Scene random_scene(Random& random) {
  const double size = std::exp(uniform(random, -8, 8));
  const double far = integer(random, 0, 3) == 0 ? 1e6 : 10;
  const auto coordinate = [&] { return size * uniform(random, -far, far); };
  Box box = Box::around({coordinate(), coordinate(), coordinate()});
  box = box.joined(box.min + size * uniform(random, 1, 60) * Point{1, 0.5, 0.7});
  Scene scene;
  const double leaf_side = size * uniform(random, 4, 9);
  scene.frame = Frame::around(box, size, leaf_side);
  scene.level = scene.frame.level_of_side(leaf_side);
  scene.size = size;
  return scene;
}

// A plane of the octree beside the center of the root is one of the lattice's, but for `gap` λ.
Scene aligned_scene(Random& random, int axis, double gap) {
  constexpr std::array<double, 3> kOffset{0.1370, 0.2718, 0.3517};  // of the lattice, over λ
  Scene scene;
  scene.size = std::exp(uniform(random, -3, 3));
  scene.level = 2;
  const double half = 0.5 * kLatticeSpacing * scene.size;
  const double leaf_side = kOffset[static_cast<std::size_t>(axis)] * scene.size +
                           half * integer(random, 5, 9) + gap * scene.size;
  const Point origin = integer(random, 0, 1) * Point{uniform(random, -9, 9), 5, 7};
  scene.frame = Frame(origin, std::ldexp(leaf_side, scene.level - MortonKey::kMaxLevel));
  return scene;
}

TEST_F(LatticeTest, PositionsAreOriginPlusHalfSpacingTimesIndexAndADisplacement) {
  for (int trial = 0; trial < 50; ++trial) {
    const Scene scene = random_scene(random_);
    const Lattice lattice = scene.lattice();
    const double half = 0.5 * kLatticeSpacing * scene.size;
    EXPECT_DOUBLE_EQ(lattice.spacing(), 2 * half);
    const Point origin = lattice.undisplaced({0, 0, 0});
    const double rounding = 1e-15 * (norm(origin) + 200 * scene.size);
    for (int n = 0; n < 100; ++n) {
      const LatticeSite site = random_site(random_, 100);
      const Point exact = lattice.undisplaced(site), p = lattice.position(site);
      const Point expected = origin + half * Point{double(site.i), double(site.j), double(site.k)};
      for (const int axis : {0, 1, 2}) {
        ASSERT_NEAR(exact[axis], expected[axis], rounding);
        ASSERT_NEAR(p[axis], exact[axis], Lattice::kDisplacement * half + rounding);
      }
      ASSERT_EQ(p, scene.lattice().position(site));
    }
  }
}

TEST_F(LatticeTest, NoTwoCoordinatesOfALatticePlaneAreAlikeButNearPlanesOfTheOctree) {
  const Lattice lattice(Frame({0, 0, 0}, 64.0 / (1 << MortonKey::kMaxLevel)), 1, 4);
  std::map<double, int> coordinates;
  for_each_site({{4, -20, -20}, {5, 20, 20}},
                [&](const LatticeSite& site) { ++coordinates[lattice.position(site).x]; });
  EXPECT_GT(coordinates.size(), 390u);  // of 400 out of 65536
}

// How many sites there are in the leaf.
int expect_sites_of_leaf(const Scene& scene, MortonKey leaf) {
  const Lattice lattice = scene.lattice();
  const Box box = scene.frame.box(leaf);
  const SiteBox sites = lattice.sites_in(box);
  int num_found = 0;
  for_each_site(sites.expanded(3), [&](const LatticeSite& site) {
    num_found += sites.contains(site);
    EXPECT_EQ(sites.contains(site), owns(box, lattice.position(site)));
    EXPECT_EQ(sites.contains(site), owns(box, lattice.undisplaced(site)));
    if (scene.frame.contains(lattice.position(site))) {
      EXPECT_EQ(sites.contains(site),
                scene.frame.key_of(lattice.position(site), scene.level) == leaf);
    }
  });
  return num_found;
}

TEST_F(LatticeTest, SitesOfALeafAreThoseWithPositionsInItsBox) {
  int num_found = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const Scene scene = random_scene(random_);
    num_found += expect_sites_of_leaf(scene, scene.random_leaf(random_));
    ASSERT_FALSE(HasFailure()) << "trial " << trial;
  }
  EXPECT_GT(num_found, 60 * 20);
}

TEST_F(LatticeTest, CoordinatesNearPlanesBetweenLeavesAreNotDisplaced) {
  for (int trial = 0; trial < 60; ++trial) {
    const int axis = trial % 3;
    const double step = 0x1p-17 * 0.5 * kLatticeSpacing;  // as far as a point is moved, over λ
    const double gap = trial < 15 ? 0 : uniform(random_, -4, 4) * step;
    const Scene scene = aligned_scene(random_, axis, gap);
    int num_in_plane = 0;
    const Lattice lattice = scene.lattice();
    const double plane = scene.frame.root_box().center()[axis] + scene.frame.side(scene.level);
    for_each_site({{-12, -12, -12}, {13, 13, 13}}, [&](const LatticeSite& site) {
      const double exact = lattice.undisplaced(site)[axis];
      if (std::abs(exact - plane) > 1.5 * step * scene.size) return;
      ++num_in_plane;
      ASSERT_EQ(lattice.position(site)[axis], exact);
    });
    if (std::abs(gap) < 1.4 * step) {
      EXPECT_GT(num_in_plane, 100);
    }
    for (std::uint64_t octant = 0; octant < 64; ++octant)
      expect_sites_of_leaf(scene, MortonKey::root().child(int(octant / 8)).child(int(octant % 8)));
    ASSERT_FALSE(HasFailure()) << "trial " << trial;
  }
}

TEST_F(LatticeTest, BoxesOfLeavesTile) {
  for (int trial = 0; trial < 20; ++trial) {
    const Scene scene =
        trial % 2 ? random_scene(random_) : aligned_scene(random_, trial / 2 % 3, 0);
    LinearOctree octree = LinearOctree::uniform(2);
    octree.split(MortonKey::root().child(3).child(5));
    const Lattice lattice(scene.frame, scene.size, scene.frame.side(3));
    std::uint64_t num_in_leaves = 0;
    for (const MortonKey leaf : octree.leaves()) {
      const SiteBox sites = lattice.sites_in(scene.frame.box(leaf));
      num_in_leaves += num_sites(sites);
      for (const MortonKey other : octree.leaves()) {  // they share no site
        if (other == leaf) continue;
        const SiteBox b = lattice.sites_in(scene.frame.box(other));
        const bool is_apart = sites.high.i <= b.low.i || b.high.i <= sites.low.i ||
                              sites.high.j <= b.low.j || b.high.j <= sites.low.j ||
                              sites.high.k <= b.low.k || b.high.k <= sites.low.k;
        ASSERT_TRUE(is_apart);
      }
    }
    EXPECT_EQ(num_in_leaves, num_sites(lattice.sites_in(scene.frame.root_box())));
  }
}

TEST_F(LatticeTest, SitesWithinABallAreThoseOfBruteForce) {
  std::size_t num_found = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Scene scene = random_scene(random_);
    const Lattice lattice = scene.lattice();
    const Point q = lattice.undisplaced({0, 0, 0}) + scene.size * Point{uniform(random_, -2, 2),
                                                                        uniform(random_, -2, 2),
                                                                        uniform(random_, -2, 2)};
    const double radius = scene.size * uniform(random_, 0, 2.5);
    std::vector<LatticeSite> expected, found{{1, 1, 1}};
    for_each_site({{-9, -9, -9}, {10, 10, 10}}, [&](const LatticeSite& site) {
      if (squared_distance(lattice.position(site), q) <= radius * radius) expected.push_back(site);
    });
    lattice.sites_within(q, radius, found);
    ASSERT_EQ(found, expected) << "trial " << trial;
    num_found += found.size();
  }
  EXPECT_GT(num_found, 200u);  // about 610, give or take 70
}

// ---- Cells. All with integers: sites are as good as points.

struct Vector {
  std::int64_t x = 0, y = 0, z = 0;
};
Vector to(const LatticeSite& from, const LatticeSite& s) {
  return {s.i - from.i, s.j - from.j, s.k - from.k};
}
std::int64_t dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
std::int64_t six_volumes(const LatticeSite& o, const LatticeSite& p, const LatticeSite& q,
                         const LatticeSite& r) {
  const Vector a = to(o, p), b = to(o, q), c = to(o, r);
  return dot({a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}, c);
}

// The ball through the origin and a cell's other sites has its center at half integers: 2c solves
// 2c · s = s · s for the three sites.
LatticeSite twice_center(const LatticeCell& cell) {
  for (std::int32_t x = -4; x <= 4; ++x)
    for (std::int32_t y = -4; y <= 4; ++y)
      for (std::int32_t z = -4; z <= 4; ++z)
        if (std::ranges::all_of(cell, [&](const LatticeSite& s) {
              const Vector v = to({}, s);
              return dot({x, y, z}, v) == dot(v, v);
            }))
          return {x, y, z};
  ADD_FAILURE() << "no center";
  return {};
}

std::array<LatticeSite, 4> corners_of(const LatticeCell& cell) {
  return {LatticeSite{}, cell[0], cell[1], cell[2]};
}

std::int64_t squared(const LatticeSite& a, const LatticeSite& b) {
  const Vector v = to(a, b);
  return dot(v, v);
}

TEST(LatticeCells, ArePositivelyOrientedAndAHalfSixthOfACube) {
  // A cube of spacing a has the volume 8 in units of a/2, and each cell a^3 / 12.
  for (const LatticeCell& cell : kLatticeCells)
    EXPECT_EQ(six_volumes({}, cell[0], cell[1], cell[2]), 6 * 8 / 12);
}

TEST(LatticeCells, HaveTheOriginForTheirSmallestSite) {
  std::set<Sites> different;
  for (const LatticeCell& cell : kLatticeCells) {
    for (const LatticeSite& s : cell) {
      EXPECT_LT(LatticeSite{}, s);
      EXPECT_TRUE(is_site(s));
    }
    different.insert(Sites(cell.begin(), cell.end()));
  }
  EXPECT_EQ(different.size(), 6u);
}

TEST(LatticeCells, HaveCircumballsEmptyOfOtherSites) {
  const double radius = kLatticeCircumradius / (0.5 * kLatticeSpacing);  // in units of a/2
  for (const LatticeCell& cell : kLatticeCells) {
    const LatticeSite center = twice_center(cell);
    const std::int64_t four_squares = squared({}, center);
    EXPECT_EQ(four_squares, 5);  // (√5/4)² a² = 5/16 · 4 (a/2)²
    EXPECT_LT(std::sqrt(static_cast<double>(four_squares)) / 2, radius);
    EXPECT_GT(std::sqrt(static_cast<double>(four_squares)) / 2, 0.999 * radius);
    for_each_site({{-6, -6, -6}, {7, 7, 7}}, [&](const LatticeSite& s) {
      const LatticeSite twice{2 * s.i, 2 * s.j, 2 * s.k};
      const bool is_corner = s == LatticeSite{} || std::ranges::count(cell, s) > 0;
      const auto distance = static_cast<double>(squared(twice, center));
      EXPECT_EQ(distance <= 5, is_corner);
      // However little sites are displaced.
      if (!is_corner) {
        EXPECT_GT(distance, 1.6 * 1.6 * 5);
      }
    });
  }
}

// A point changes the cells at a site exactly if it lies in the circumball of one of all 24.
TEST_F(LatticeTest, PointsInACircumballChangeAStar) {
  constexpr double kSpacing = 0.7;
  const double radius = kLatticeCircumradius / kLatticeSpacing * kSpacing;
  std::vector<Point> centers;  // seen from the site
  for (const LatticeCell& cell : kLatticeCells) {
    const LatticeSite twice = twice_center(cell);
    for (const LatticeSite& corner : {LatticeSite{}, cell[0], cell[1], cell[2]}) {
      const auto along = [&](std::int32_t two, std::int32_t one) {
        return 0.25 * kSpacing * (two - 2 * one);
      };
      centers.push_back(
          {along(twice.i, corner.i), along(twice.j, corner.j), along(twice.k, corner.k)});
    }
  }
  ASSERT_EQ(centers.size(), 24u);
  int num_changing = 0, num_not = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const double reach = 1.1 * kLatticeStar / kLatticeSpacing * kSpacing;
    const Point offset{uniform(random_, -reach, reach), uniform(random_, -reach, reach),
                       uniform(random_, -reach, reach)};
    double nearest = 2 * reach;
    for (const Point& c : centers) nearest = std::min(nearest, norm(offset - c));
    if (std::abs(nearest - radius) < 1e-12) continue;
    ASSERT_EQ(changes_star(offset, kSpacing), nearest < radius);
    (nearest < radius ? num_changing : num_not)++;
    EXPECT_TRUE(nearest >= radius || norm(offset) < kLatticeStar / kLatticeSpacing * kSpacing);
  }
  EXPECT_GT(num_changing, 1000);
  EXPECT_GT(num_not, 1000);
}

// Of all cells at the origin: as many as fill the space around it, and each neighbor in some.
TEST(LatticeCells, ASiteHas24CellsAnd14Neighbors) {
  Sites neighbors;
  std::set<Sites> cells;
  for (const LatticeCell& cell : kLatticeCells)
    for (const LatticeSite& corner : corners_of(cell)) {
      Sites moved;
      for (const LatticeSite& s : corners_of(cell))
        moved.insert({s.i - corner.i, s.j - corner.j, s.k - corner.k});
      neighbors.insert(moved.begin(), moved.end());
      cells.insert(moved);
    }
  neighbors.erase(LatticeSite{});
  EXPECT_EQ(cells.size(), 24u);
  EXPECT_TRUE(std::ranges::equal(neighbors, kLatticeNeighbors));
}

// Six to a site, with a volume of 1/12 of the cube that has two sites: it is enough that no facet
// is in other than two cells, on different sides.
TEST(LatticeCells, AtASiteAreThoseOfWhichItIsACorner) {
  const auto sorted = [](std::array<LatticeSite, 4> cell) {
    std::ranges::sort(cell);
    return cell;
  };
  std::set<std::array<LatticeSite, 4>> expected, found;
  for (const LatticeCell& cell : kLatticeCells)
    for (const LatticeSite& corner : {LatticeSite{}, cell[0], cell[1], cell[2]}) {
      const LatticeSite back{-corner.i, -corner.j, -corner.k};
      expected.insert(sorted({back, cell[0] + back, cell[1] + back, cell[2] + back}));
    }
  for (const auto& [a, b, c] : kCellsAtSite) {
    const LatticeCell cell{kLatticeNeighbors[a], kLatticeNeighbors[b], kLatticeNeighbors[c]};
    found.insert(sorted({LatticeSite{}, cell[0], cell[1], cell[2]}));
    const auto vector = [](const LatticeSite& s) {
      return Point{double(s.i), double(s.j), double(s.k)};
    };
    EXPECT_EQ(dot(cross(vector(cell[0]), vector(cell[1])), vector(cell[2])), 4);
  }
  EXPECT_EQ(expected.size(), 24U);
  EXPECT_EQ(found, expected);
}

TEST_F(LatticeTest, TheNearestSiteIsThatOfBruteForce) {
  for (int trial = 0; trial < 50; ++trial) {
    const Scene scene = random_scene(random_);
    const Lattice lattice = scene.lattice();
    for (int n = 0; n < 50; ++n) {
      const auto step = [&] { return uniform(random_, -1, 1) * scene.size; };
      const Point q = lattice.undisplaced(random_site(random_, 50)) + Point{step(), step(), step()};
      const LatticeSite nearest = lattice.nearest(q);
      ASSERT_TRUE(is_site(nearest));
      const double distance = norm(lattice.undisplaced(nearest) - q);
      EXPECT_LE(distance, kLatticeCircumradius * scene.size);
      std::vector<LatticeSite> within;
      lattice.sites_within(q, distance - 1e-4 * scene.size, within);
      EXPECT_TRUE(within.empty());
    }
  }
}

TEST(LatticeCells, FillSpace) {
  std::map<Sites, std::vector<std::int64_t>> sides;  // of a facet: of the fourth corners
  const SiteBox box{{-4, -4, -4}, {5, 5, 5}};
  for_each_core_cell(
      box, [](const LatticeSite&) { return true; },
      [&](const LatticeSite& site, const LatticeCell& cell) {
        std::array<LatticeSite, 4> corners = corners_of(cell);
        for (LatticeSite& s : corners) s = s + site;
        for (std::size_t n = 0; n < 4; ++n) {
          Sites facet(corners.begin(), corners.end());
          facet.erase(corners[n]);
          const std::vector<LatticeSite> f(facet.begin(), facet.end());
          sides[facet].push_back(six_volumes(f[0], f[1], f[2], corners[n]));
        }
      });
  int num_inner = 0;
  for (const auto& [facet, volumes] : sides) {
    EXPECT_LE(volumes.size(), 2u);
    if (!std::ranges::all_of(facet, [](const LatticeSite& s) {
          return SiteBox{{-2, -2, -2}, {3, 3, 3}}.contains(s);
        }))
      continue;
    ++num_inner;
    ASSERT_EQ(volumes.size(), 2u);
    EXPECT_LT(volumes[0] * volumes[1], 0);
  }
  EXPECT_GT(num_inner, 100);
}

TEST(LatticeCells, OfLargerNeighborsAreTheSame) {
  EXPECT_TRUE(std::ranges::is_sorted(kLargerNeighbors));
  Sites larger;
  for (std::size_t n = 0; n < 6; ++n)
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(kLargerNeighbors[kCellsOfLargerNeighbors[n][i]], kLatticeCells[n][i]);
      larger.insert(kLatticeCells[n][i]);
    }
  EXPECT_TRUE(std::ranges::equal(larger, kLargerNeighbors));
}

// ---- The core of a leaf, against a set of sites

const SiteBox kBox{{-3, 2, -5}, {6, 9, 8}};

LatticeCore core_of(const Sites& sites) {
  LatticeCore core;
  for (const LatticeSite& site : sites) add_row({site, 1}, core);
  return core;
}

Sites sites_of(const LatticeCore& core, const SiteBox& box) {
  Sites sites;
  std::uint64_t num_before = 0;
  for_each_row(core, box, [&](LatticeRow row, std::uint64_t num) {
    EXPECT_EQ(num, num_before);
    num_before += row.count;
    for (; row.count > 0; --row.count, row.first.k += 2)
      EXPECT_TRUE(sites.insert(sites.end(), row.first) != sites.end());
  });
  EXPECT_EQ(sites.size(), num_before);
  return sites;
}

Sites all_sites(const SiteBox& box) {
  Sites sites;
  for_each_site(box, [&](const LatticeSite& site) { sites.insert(site); });
  return sites;
}

Sites random_sites(Random& random, const SiteBox& box) {
  const double share = uniform(random, 0, 1.2);
  Sites sites = all_sites(box);
  std::erase_if(sites, [&](const LatticeSite&) { return uniform(random, 0, 1) > share; });
  return sites;
}

SiteBox random_box(Random& random) {
  const LatticeSite low{integer(random, -9, 9), integer(random, -9, 9), integer(random, -9, 9)};
  return {low,
          low + LatticeSite{integer(random, 0, 6), integer(random, 0, 6), integer(random, 0, 9)}};
}

TEST_F(LatticeCoreTest, HoldsTheSitesThatWereAdded) {
  for (int trial = 0; trial < 200; ++trial) {
    const SiteBox box = random_box(random_);
    const Sites sites = random_sites(random_, box);
    const LatticeCore core = core_of(sites);
    EXPECT_NO_THROW(check_core(core, box));
    EXPECT_EQ(core.is_empty(), sites.empty());
    ASSERT_EQ(sites_of(core, box), sites);
    EXPECT_EQ(num_points(core, box), sites.size());
    // As few rows as can be: one for each site without one two below.
    EXPECT_EQ(core.rows.size(),
              static_cast<std::size_t>(std::ranges::count_if(sites, [&](const LatticeSite& s) {
                return !sites.contains({s.i, s.j, s.k - 2});
              })));
  }
}

TEST_F(LatticeCoreTest, PiecesOfRowsMakeUpTheBox) {
  for (int trial = 0; trial < 200; ++trial) {
    const SiteBox box = random_box(random_);
    Sites seen;
    LatticeCore core;
    for_each_piece(box, [&](const LatticeRow& rest) {
      EXPECT_FALSE(box.contains(rest.first + LatticeSite{0, 0, 2 * std::int32_t(rest.count)}));
      const LatticeRow piece{
          rest.first, static_cast<std::uint32_t>(integer(random_, 1, std::int32_t(rest.count)))};
      add_row(piece, core);
      for (std::int32_t n = 0; n < std::int32_t(piece.count); ++n)
        EXPECT_TRUE(seen.insert(piece.first + LatticeSite{0, 0, 2 * n}).second);
      return piece.count;
    });
    ASSERT_EQ(seen, all_sites(box));
    ASSERT_EQ(core, core_of(seen));  // pieces of one row are joined
  }
}

TEST_F(LatticeCoreTest, ThatIsWholeHoldsAllSitesOfTheBox) {
  const LatticeCore whole{.is_whole = true, .rows = {}};
  for (int trial = 0; trial < 100; ++trial) {
    const SiteBox box = random_box(random_);
    ASSERT_EQ(sites_of(whole, box), all_sites(box));
    EXPECT_EQ(num_points(whole, box), all_sites(box).size());
    EXPECT_NO_THROW(check_core(whole, box));
  }
  EXPECT_FALSE(whole.is_empty());
}

TEST_F(LatticeCoreTest, ClippedHoldsTheSitesInTheBox) {
  for (int trial = 0; trial < 200; ++trial) {
    const SiteBox box = random_box(random_);
    SiteBox part;
    part.low = {integer(random_, box.low.i, box.high.i), integer(random_, box.low.j, box.high.j),
                integer(random_, box.low.k, box.high.k)};
    part.high = {integer(random_, part.low.i, box.high.i), integer(random_, part.low.j, box.high.j),
                 integer(random_, part.low.k, box.high.k)};
    Sites sites = random_sites(random_, box);
    const LatticeCore core = clipped(core_of(sites), part);
    std::erase_if(sites, [&](const LatticeSite& s) { return !part.contains(s); });
    ASSERT_EQ(sites_of(core, part), sites);
    ASSERT_EQ(core, core_of(sites));
    EXPECT_TRUE(clipped({.is_whole = true, .rows = {}}, part).is_whole);
  }
}

TEST_F(LatticeCoreTest, WithoutASiteHoldsTheOthers) {
  for (int trial = 0; trial < 200; ++trial) {
    const SiteBox box = random_box(random_);
    const bool is_whole = trial % 4 == 0;
    Sites sites = is_whole ? all_sites(box) : random_sites(random_, box);
    LatticeCore core = is_whole ? LatticeCore{.is_whole = true, .rows = {}} : core_of(sites);
    while (!sites.empty()) {
      const auto gone = std::next(sites.begin(),
                                  integer(random_, 0, static_cast<std::int32_t>(sites.size()) - 1));
      core = without(core, box, *gone);
      sites.erase(gone);
      EXPECT_NO_THROW(check_core(core, box));
      ASSERT_EQ(sites_of(core, box), sites);
      ASSERT_EQ(core, core_of(sites));
    }
    EXPECT_EQ(num_points(core, box), 0u);
  }
}

TEST_F(LatticeCoreTest, SitesOfAPartComeWithTheirPlaces) {
  for (int trial = 0; trial < 200; ++trial) {
    const SiteBox box = random_box(random_);
    const SiteBox part{box.low + LatticeSite{integer(random_, -2, 2), integer(random_, -2, 2),
                                             integer(random_, -2, 2)},
                       box.high + LatticeSite{integer(random_, -2, 2), integer(random_, -2, 2),
                                              integer(random_, -2, 2)}};
    const bool is_whole = trial % 4 == 0;
    const Sites sites = is_whole ? all_sites(box) : random_sites(random_, box);
    std::vector<std::pair<LatticeSite, std::uint64_t>> expected, found;
    std::uint64_t place = 0;
    for (const LatticeSite& site : sites) {
      if (part.contains(site)) expected.push_back({site, place});
      ++place;
    }
    for_each_core_site(is_whole ? LatticeCore{.is_whole = true, .rows = {}} : core_of(sites), box,
                       part, [&](const LatticeSite& site, std::uint64_t num_before) {
                         found.push_back({site, num_before});
                       });
    ASSERT_EQ(found, expected);
  }
}

struct DamagedCore {
  const char* name;
  std::vector<LatticeRow> rows;
  friend void PrintTo(const DamagedCore& core, std::ostream* out) { *out << core.name; }
};

class CheckCore : public testing::TestWithParam<DamagedCore> {};

TEST_P(CheckCore, RefusesDamage) {
  EXPECT_THROW(check_core({.is_whole = false, .rows = GetParam().rows}, kBox),
               std::invalid_argument);
}

// In kBox, rows with even i and j have k = -4 … 6, those with odd ones k = -5 … 7.
INSTANTIATE_TEST_SUITE_P(
    Damage, CheckCore,
    testing::Values(DamagedCore{"Below", {{{-4, 2, 0}, 1}}}, DamagedCore{"Above", {{{6, 2, 0}, 1}}},
                    DamagedCore{"Before", {{{0, 0, 0}, 1}}},
                    DamagedCore{"Behind", {{{1, 9, 1}, 1}}},
                    DamagedCore{"BeginsTooSoon", {{{0, 2, -6}, 2}}},
                    DamagedCore{"BeginsTooLate", {{{0, 2, 8}, 1}}},
                    DamagedCore{"EndsTooLate", {{{0, 2, -4}, 7}}},
                    DamagedCore{"EndsTooLateByOverflow", {{{0, 2, -4}, 0x80000000}}},
                    DamagedCore{"EndsFarTooLate", {{{0, 2, -4}, 0xffffffff}}},
                    DamagedCore{"OddEndsTooLate", {{{1, 3, -5}, 8}}},
                    DamagedCore{"OfNothing", {{{0, 2, 0}, 0}}},
                    DamagedCore{"WrongParityOfJ", {{{0, 3, 0}, 1}}},
                    DamagedCore{"WrongParityOfK", {{{1, 3, 0}, 1}}},
                    DamagedCore{"Repeated", {{{0, 2, 0}, 1}, {{0, 2, 0}, 1}}},
                    DamagedCore{"Overlapping", {{{0, 2, 0}, 2}, {{0, 2, 2}, 1}}},
                    DamagedCore{"OutOfOrderInARow", {{{0, 2, 4}, 1}, {{0, 2, 0}, 1}}},
                    DamagedCore{"OutOfOrderInJ", {{{0, 4, 0}, 1}, {{0, 2, 0}, 1}}},
                    DamagedCore{"OutOfOrderInI", {{{2, 2, 0}, 1}, {{0, 2, 0}, 1}}},
                    DamagedCore{"LaterRow", {{{0, 2, 0}, 1}, {{0, 2, 4}, 1}, {{0, 4, 6}, 2}}}),
    [](const auto& instance) { return std::string(instance.param.name); });

TEST(CheckCoreOf, AcceptsTheLongestRows) {
  EXPECT_NO_THROW(
      check_core({.is_whole = false, .rows = {{{0, 2, -4}, 6}, {{1, 3, -5}, 7}}}, kBox));
  EXPECT_NO_THROW(check_core({.is_whole = false, .rows = {}}, {}));
}

}  // namespace
}  // namespace locvol
