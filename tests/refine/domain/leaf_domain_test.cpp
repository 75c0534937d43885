#include "refine/domain/leaf_domain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "refine/domain/closest_point.h"
#include "refine/domain/surface_part.h"
#include "refine/domain/triangle_box.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Mesh;
using shapes::Random;
using shapes::uniform;
using shapes::uniform_in;

Mesh part_meeting(const Mesh& mesh, const Box& region) {
  Mesh part;
  for (const Triangle& t : mesh)
    if (meets(t, region)) part.push_back(t);
  return part;
}

LeafDomain whole_domain(const Mesh& mesh, double margin = 0.37) {
  const Box region = shapes::bounding_box(mesh).expanded(margin);
  return LeafDomain(whole_piece(region, mesh));
}

LeafDomain domain_over(const Mesh& mesh, const Box& region, const LeafDomain& whole) {
  return LeafDomain(
      {part_meeting(mesh, region), region, region.center(), *whole.state(region.center())});
}

// A random piece of the box, at least `least` of its extent on each axis.
Box random_part(Random& random, const Box& box, double least) {
  Box part;
  for (int axis = 0; axis < 3; ++axis) {
    const double extent = box.max[axis] - box.min[axis];
    const double size = extent * uniform(random, least, 1);
    part.min[axis] = uniform(random, box.min[axis], box.max[axis] - size);
    part.max[axis] = part.min[axis] + size;
  }
  return part;
}

// Full and empty cubes in turn and at random: edges and vertices with any number of cubes around.
bool is_full_voxel(int i, int j, int k) { return (7 * i + 5 * j * j + 3 * k * i + k * k) % 5 < 3; }

constexpr int kVoxels = 5;

// By the move of query points, a point of the lattice belongs to the cube above it.
bool is_in_voxels(const Point& p) {
  const std::array<int, 3> c{int(std::floor(p.x)), int(std::floor(p.y)), int(std::floor(p.z))};
  return std::min({c[0], c[1], c[2]}) >= 0 && std::max({c[0], c[1], c[2]}) < kVoxels &&
         is_full_voxel(c[0], c[1], c[2]);
}

struct NamedMesh {
  std::string name;
  std::function<Mesh()> make;
  friend std::ostream& operator<<(std::ostream& out, const NamedMesh& m) { return out << m.name; }
};

const std::vector<NamedMesh> kMeshes{
    {"Sphere",
     [] {
       return shapes::icosphere({0.1, 0.2, -0.3}, 1, 2);
     }},
    {"Torus", [] { return shapes::torus(1, 0.4, 24, 12); }},
    {"Box",
     [] {
       return shapes::box({{-1, -1, -1}, {1, 2, 1}});
     }},
    {"ThinPlate", [] { return shapes::thin_plate(4, 0x1p-10); }},
    {"NestedShells", [] { return shapes::nested_shells(1, 0.9, 2); }},
    {"Voxels", [] { return shapes::voxels(kVoxels, is_full_voxel); }},
};

class LeafDomainOf : public testing::TestWithParam<NamedMesh> {
 protected:
  const Mesh mesh_ = GetParam().make();
  const LeafDomain domain_ = whole_domain(mesh_);

  // Points in general position, on vertices, edges and faces, of an axis-parallel lattice that
  // shares coordinates with the mesh, and of the domain's own boundary.
  std::vector<Point> probes(Random& random, std::size_t num_of_each) const {
    std::uniform_int_distribution<std::size_t> triangle(0, mesh_.size() - 1), corner(0, 2);
    const auto vertex = [&] { return mesh_[triangle(random)].corners[corner(random)]; };
    std::vector<Point> points = shapes::random_points_on(mesh_, num_of_each, random);
    for (std::size_t n = 0; n < num_of_each; ++n) {
      points.push_back(uniform_in(random, domain_.region()));
      points.push_back(vertex());
      const auto& [a, b, c] = mesh_[triangle(random)].corners;
      points.push_back(0.5 * (a + b));
      points.push_back(0.25 * (a + b + 2.0 * c));
      const double x = vertex().x, y = vertex().y;
      points.push_back({x, y, vertex().z});
      const Point inner = uniform_in(random, domain_.region());
      points.push_back({domain_.region().min.x, inner.y, domain_.region().max.z});
      points.push_back({inner.x, vertex().y, inner.z});
    }
    return points;
  }
};

INSTANTIATE_TEST_SUITE_P(Shapes, LeafDomainOf, testing::ValuesIn(kMeshes),
                         [](const auto& instance) { return instance.param.name; });

TEST_P(LeafDomainOf, SideIsThatOfBruteForce) {
  constexpr unsigned kSeed = 21;
  Random random(kSeed);
  int num_inside = 0;
  for (const Point& p : probes(random, 300)) {
    ASSERT_EQ(is_inside(domain_, p), brute_force::is_inside(p, mesh_))
        << "seed " << kSeed << ": " << p.x << ' ' << p.y << ' ' << p.z;
    num_inside += is_inside(domain_, p);
  }
  EXPECT_GT(num_inside, 50);
}

TEST_P(LeafDomainOf, CrossingsAreThoseOfBruteForceAndTheirParityTheSides) {
  constexpr unsigned kSeed = 22;
  Random random(kSeed);
  const std::vector<Point> points = probes(random, 60);
  std::uniform_int_distribution<std::size_t> pick(0, points.size() - 1);
  std::vector<Crossing> found;
  for (int n = 0; n < 1500; ++n) {
    const Point a = points[pick(random)], b = points[pick(random)];
    domain_.crossings(a, b, found);
    ASSERT_EQ(found.size() % 2 == 1, is_inside(domain_, a) != is_inside(domain_, b))
        << "seed " << kSeed << ", n " << n;
    std::vector<std::uint64_t> ids;
    for (const Crossing& c : found) ids.push_back(c.triangle);
    std::ranges::sort(ids);
    ASSERT_EQ(ids, brute_force::crossings(a, b, mesh_)) << "seed " << kSeed << ", n " << n;
    ASSERT_EQ(domain_.is_crossed(a, b), !ids.empty()) << "seed " << kSeed << ", n " << n;
  }
}

// From one state all others follow, and with them what is on both sides of each crossing.
TEST_P(LeafDomainOf, BodiesBeforeAndAfterACrossingAreThoseOfPlacesBesideIt) {
  constexpr unsigned kSeed = 36;
  Random random(kSeed);
  std::vector<Crossing> found;
  int num_passed = 0;
  for (int n = 0; n < 2000; ++n) {
    const Point a = uniform_in(random, domain_.region()), b = uniform_in(random, domain_.region());
    domain_.crossings(a, b, found);
    double t = 0;
    std::size_t num = 0;
    const auto label_between = [&](double from, double to) {
      return domain_.label(a + 0.5 * (from + to) * (b - a));
    };
    const DomainState end =
        follow(*domain_.state(a), found, [&](const Crossing& c, BodyId before, BodyId after) {
          EXPECT_NE(before, after);
          EXPECT_EQ(c.sheet, kOnlySheet);
          const double next = ++num < found.size() ? found[num].t : 1;
          if (c.t - t > 1e-9 && next - c.t > 1e-9) {
            EXPECT_EQ(before, label_between(t, c.t)) << "seed " << kSeed << ", n " << n;
            EXPECT_EQ(after, label_between(c.t, next)) << "seed " << kSeed << ", n " << n;
            ++num_passed;
          }
          t = c.t;
        });
    ASSERT_EQ(num, found.size());
    ASSERT_EQ(end, domain_.state(b)) << "seed " << kSeed << ", n " << n;
    std::ranges::reverse(found);
    ASSERT_EQ(follow(end, found), domain_.state(a)) << "the way back, n " << n;
  }
  EXPECT_GT(num_passed, 300);
}

TEST_P(LeafDomainOf, CrossingsComeInOrderAndLieOnSegmentAndTriangle) {
  constexpr unsigned kSeed = 23;
  Random random(kSeed);
  std::vector<Crossing> found;
  std::size_t num_crossings = 0;
  for (int n = 0; n < 1000; ++n) {
    const Point a = uniform_in(random, domain_.region()), b = uniform_in(random, domain_.region());
    domain_.crossings(a, b, found);
    num_crossings += found.size();
    EXPECT_TRUE(std::ranges::is_sorted(found, {}, &Crossing::t));
    for (const Crossing& c : found) {
      ASSERT_TRUE(0 <= c.t && c.t <= 1);
      EXPECT_LT(norm(c.position - (a + c.t * (b - a))), 1e-12);
      EXPECT_LT(brute_force::distance(c.position, mesh_[c.triangle]), 1e-9) << "seed " << kSeed;
    }
  }
  EXPECT_GT(num_crossings, 100u);
}

// A ray of a paper-mode dual edge may begin and end far outside.
TEST_P(LeafDomainOf, SegmentsFromOutsideTheRegionAreCrossedLikeAnyOther) {
  constexpr unsigned kSeed = 24;
  Random random(kSeed);
  const Box far = domain_.region().expanded(20);
  std::vector<Crossing> found;
  for (int n = 0; n < 1000; ++n) {
    const Point a = uniform_in(random, far);
    const Point b = n % 2 == 0
                        ? uniform_in(random, far)
                        : uniform_in(random, domain_.region()) +
                              uniform(random, 0, 5) * (uniform_in(random, domain_.region()) - a);
    domain_.crossings(a, b, found);
    std::vector<std::uint64_t> ids;
    for (const Crossing& c : found) ids.push_back(c.triangle);
    std::ranges::sort(ids);
    ASSERT_EQ(ids, brute_force::crossings(a, b, mesh_)) << "seed " << kSeed << ", n " << n;
    ASSERT_EQ(domain_.is_crossed(a, b), !ids.empty()) << "seed " << kSeed << ", n " << n;
  }
}

TEST_P(LeafDomainOf, AnswersDoNotDependOnThePieceLoaded) {
  constexpr unsigned kSeed = 25;
  Random random(kSeed);
  const std::vector<Point> points = probes(random, 80);
  std::vector<Crossing> found, expected;
  for (int round = 0; round < 6; ++round) {
    const Box region = random_part(random, domain_.region(), 0.2);
    const LeafDomain piece = domain_over(mesh_, region, domain_);
    std::vector<Point> within;
    for (const Point& p : points)
      if (region.contains(p)) within.push_back(p);
    for (int k = 0; k < 8; ++k) within.push_back(shapes::corner_of(region, k));
    for (std::size_t n = 0; n < within.size(); ++n) {
      const Point a = within[n], b = within[(n * 7 + 3) % within.size()];
      ASSERT_EQ(is_inside(piece, a), is_inside(domain_, a))
          << "seed " << kSeed << ", round " << round;
      piece.crossings(a, b, found);
      domain_.crossings(a, b, expected);
      ASSERT_EQ(found.size(), expected.size()) << "seed " << kSeed << ", round " << round;
      for (std::size_t i = 0; i < found.size(); ++i) {
        ASSERT_EQ(found[i].triangle, expected[i].triangle);
        ASSERT_EQ(found[i].position, expected[i].position) << "the same bits for all leaves";
      }
    }
  }
}

TEST_P(LeafDomainOf, OrderAndOthersDoNotMatter) {
  constexpr unsigned kSeed = 26;
  Random random(kSeed);
  const Box region = random_part(random, domain_.region(), 0.5);
  Mesh part = part_meeting(mesh_, region), shuffled = mesh_;
  std::ranges::shuffle(shuffled, random);
  for (Triangle& t : shuffled) std::ranges::shuffle(t.corners, random);
  const DomainState center = *domain_.state(region.center());
  const LeafDomain tight({part, region, region.center(), center});
  const LeafDomain loose({shuffled, region, region.center(), center});
  std::vector<Crossing> found, expected;
  for (int n = 0; n < 1000; ++n) {
    const Point a = uniform_in(random, region), b = uniform_in(random, region);
    ASSERT_EQ(is_inside(loose, a), is_inside(tight, a)) << "seed " << kSeed << ", n " << n;
    tight.crossings(a, b, expected);
    loose.crossings(a, b, found);
    ASSERT_EQ(found.size(), expected.size()) << "seed " << kSeed << ", n " << n;
    for (std::size_t i = 0; i < found.size(); ++i)
      ASSERT_EQ(found[i].triangle, expected[i].triangle) << "seed " << kSeed << ", n " << n;
  }
}

TEST_P(LeafDomainOf, ReferenceMayLieAnywhereWithinTheRegion) {
  constexpr unsigned kSeed = 27;
  Random random(kSeed);
  const std::vector<Point> points = probes(random, 40);
  for (std::size_t n = 0; n < points.size(); n += 57) {
    const LeafDomain other({mesh_, domain_.region(), points[n], *domain_.state(points[n])});
    for (const Point& p : points)
      ASSERT_EQ(is_inside(other, p), is_inside(domain_, p)) << "seed " << kSeed << ", n " << n;
  }
}

TEST_P(LeafDomainOf, FinenessDecidesNoAnswer) {
  constexpr unsigned kSeed = 29;
  Random random(kSeed);
  const std::vector<Point> points = probes(random, 40);
  std::vector<Crossing> found, expected;
  for (const GridFineness& fineness :
       {GridFineness{0.02, 1}, GridFineness{0.3, 12}, GridFineness{2, 200}}) {
    const LeafDomain other({mesh_, domain_.region(), domain_.region().min, {}, fineness});
    for (std::size_t n = 0; n < points.size(); ++n) {
      const Point a = points[n], b = points[(n * 7 + 3) % points.size()];
      ASSERT_EQ(is_inside(other, a), is_inside(domain_, a)) << "seed " << kSeed << ", n " << n;
      ASSERT_EQ(other.locate(a).distance_bound, other.distance_bound(a));
      ASSERT_LE(other.distance_bound(a), brute_force::distance(a, mesh_));
      ASSERT_EQ(other.is_near(a, 0.1), domain_.is_near(a, 0.1)) << "seed " << kSeed << ", n " << n;
      other.crossings(a, b, found);
      domain_.crossings(a, b, expected);
      ASSERT_TRUE(std::ranges::equal(found, expected, {}, &Crossing::triangle, &Crossing::triangle))
          << "seed " << kSeed << ", n " << n;
    }
  }
}

TEST_P(LeafDomainOf, DistanceBoundIsALowerBound) {
  constexpr unsigned kSeed = 28;
  Random random(kSeed);
  int num_positive = 0;
  for (int n = 0; n < 1500; ++n) {
    const Point p = uniform_in(random, domain_.region().expanded(n % 3 == 0 ? 2 : 0));
    const double bound = domain_.distance_bound(p);
    ASSERT_LE(bound, brute_force::distance(p, mesh_)) << "seed " << kSeed << ", n " << n;
    ASSERT_GE(bound, 0);
    num_positive += bound > 0;
  }
  EXPECT_GT(num_positive, 100);
}

TEST_P(LeafDomainOf, IsNearIsThatOfBruteForce) {
  constexpr unsigned kSeed = 29;
  Random random(kSeed);
  std::array<int, 2> count{};
  for (int n = 0; n < 1500; ++n) {
    const Point p = uniform_in(random, domain_.region());
    const double truth = brute_force::distance(p, mesh_);
    for (const double factor : {1e-3, 0.5, 1 - 1e-9, 1 + 1e-9, 1.5, 100.0}) {
      if (truth < 1e-6) continue;  // too close for a factor to tell
      const bool is_near = domain_.is_near(p, factor * truth);
      ASSERT_EQ(is_near, factor > 1) << "seed " << kSeed << ", n " << n << ", factor " << factor;
      ++count[is_near];
    }
  }
  EXPECT_GT(std::min(count[0], count[1]), 1000);
}

// At the distance, and on the surface.
TEST_P(LeafDomainOf, ClosestPointIsThatOfBruteForce) {
  constexpr unsigned kSeed = 36;
  Random random(kSeed);
  for (int n = 0; n < 1500; ++n) {
    const Point p = uniform_in(random, domain_.region());
    const double truth = brute_force::distance(p, mesh_);
    ASSERT_FALSE(domain_.closest_to(p, (1 - 1e-9) * truth)) << "seed " << kSeed << ", n " << n;
    for (const double factor : {1 + 1e-9, 1.5, 100.0}) {
      if (truth < 1e-6) continue;  // too close for a factor to tell
      const auto closest = domain_.closest_to(p, factor * truth);
      ASSERT_TRUE(closest) << "seed " << kSeed << ", n " << n << ", factor " << factor;
      EXPECT_NEAR(norm(closest->position - p), truth, 1e-12);
      EXPECT_LT(brute_force::distance(closest->position, mesh_), 1e-12);
    }
  }
}

TEST_P(LeafDomainOf, TrianglesNearAreAllThatAreCloserEachOnce) {
  constexpr unsigned kSeed = 31;
  Random random(kSeed);
  std::uniform_real_distribution<double> fraction(0, 0.3);
  const Box& region = domain_.region();
  const double length = norm(region.max - region.min);
  const LeafDomain fine({mesh_, region, region.min, {}, {length / 300, 4}});
  std::vector<Triangle> near;
  int num_near = 0;
  for (int n = 0; n < 200; ++n) {
    const double distance = fraction(random) * length;
    const Point p = uniform_in(random, region);
    for (const LeafDomain* domain : {&domain_, &fine}) {
      domain->triangles_near(p, distance, near);
      ASSERT_EQ(std::ranges::adjacent_find(near, std::greater_equal(), &Triangle::id), near.end());
      for (const Triangle& t : near) ASSERT_LT(t.box().squared_distance(p), distance * distance);
      for (const Triangle& t : mesh_) {
        if (!(brute_force::distance(p, t) < distance - 1e-9 * length)) continue;
        ASSERT_TRUE(std::ranges::binary_search(near, t.id, {}, &Triangle::id))
            << "seed " << kSeed << ", n " << n << ", triangle " << t.id;
        ++num_near;
      }
    }
  }
  EXPECT_GT(num_near, 1000);
}

TEST_P(LeafDomainOf, CentersToCornersAreDifferencesOfStates) {
  constexpr unsigned kSeed = 30;
  Random random(kSeed);
  const std::vector<Point> points = probes(random, 40);
  std::uniform_int_distribution<std::size_t> pick(0, points.size() - 1);
  int num_odd = 0;
  for (int n = 0; n < 400; ++n) {  // corners in general position and on the surface's features
    const Box box = n % 4 == 0 ? random_part(random, domain_.region(), 0.1)
                               : Box::around(points[pick(random)]).joined(points[pick(random)]);
    const CornerStates corners = center_to_corners(box, {part_meeting(mesh_, box)});
    const auto center = domain_.state(box.center());
    for (int k = 0; k < 8; ++k) {
      const auto corner = domain_.state(shapes::corner_of(box, k));
      ASSERT_EQ(center->crossed(corners[k]), corner)
          << "seed " << kSeed << ", n " << n << ", k " << k;
      num_odd += corner != center;
    }
  }
  EXPECT_GT(num_odd, 100);
}

// ---- Closed forms

TEST(LeafDomain, SphereHasTheClosedFormsSides) {
  const Point center{0.5, -0.25, 2};
  const Mesh mesh = shapes::icosphere(center, 1, 4);  // its chords are less than 0.003 deep
  const LeafDomain domain = whole_domain(mesh);
  Random random(31);
  for (int n = 0; n < 20000; ++n) {
    const Point p = uniform_in(random, domain.region());
    const double r = norm(p - center);
    if (0.995 < r && r < 1.001) continue;
    ASSERT_EQ(is_inside(domain, p), r < 1);
  }
}

TEST(LeafDomain, TorusHasTheClosedFormsSides) {
  const LeafDomain domain = whole_domain(shapes::torus(2, 0.7, 120, 60));
  Random random(32);
  for (int n = 0; n < 20000; ++n) {
    const Point p = uniform_in(random, domain.region());
    const double r = std::hypot(std::hypot(p.x, p.y) - 2, p.z);
    if (0.69 < r && r < 0.71) continue;
    ASSERT_EQ(is_inside(domain, p), r < 0.7);
  }
}

// On its boundary too: the move makes the box half-open.
TEST(LeafDomain, BoxIsHalfOpen) {
  const LeafDomain domain = whole_domain(shapes::box({{0, 0, 0}, {4, 4, 4}}), 1);
  for (int x = -1; x <= 5; ++x)
    for (int y = -1; y <= 5; ++y)
      for (int z = -1; z <= 5; ++z)
        EXPECT_EQ(is_inside(domain, {double(x), double(y), double(z)}),
                  std::min({x, y, z}) >= 0 && std::max({x, y, z}) < 4)
            << x << ' ' << y << ' ' << z;
}

TEST(LeafDomain, VoxelsAreHalfOpen) {
  const LeafDomain domain = whole_domain(shapes::voxels(kVoxels, is_full_voxel), 1);
  for (int x = -1; x <= 2 * kVoxels + 1; ++x)
    for (int y = -1; y <= 2 * kVoxels + 1; ++y)
      for (int z = -1; z <= 2 * kVoxels + 1; ++z) {
        const Point p{0.5 * x, 0.5 * y, 0.5 * z};
        ASSERT_EQ(is_inside(domain, p), is_in_voxels(p)) << p.x << ' ' << p.y << ' ' << p.z;
      }
}

// Along lattice lines, planes and diagonals.
TEST(LeafDomain, LatticeSegmentsCrossVoxelsByParity) {
  const LeafDomain domain = whole_domain(shapes::voxels(kVoxels, is_full_voxel), 1);
  constexpr unsigned kSeed = 33;
  Random random(kSeed);
  std::uniform_int_distribution<int> pick(-1, kVoxels);
  std::vector<Crossing> found;
  for (int n = 0; n < 4000; ++n) {
    Point a{double(pick(random)), double(pick(random)), double(pick(random))}, b = a;
    for (int axis = n % 3; axis >= 0; --axis) b[(axis + n) % 3] = pick(random);
    domain.crossings(a, b, found);
    ASSERT_EQ(found.size() % 2 == 1, is_in_voxels(a) != is_in_voxels(b))
        << "seed " << kSeed << ", n " << n;
  }
}

TEST(LeafDomain, WithoutTrianglesIsAllOnOneSide) {
  for (const BodyId body : {kNoBody, kOnlyBody}) {
    const LeafDomain domain({{}, {{0, 0, 0}, {1, 2, 3}}, {0.5, 0.5, 0.5}, DomainState::in(body)});
    EXPECT_EQ(domain.label({0.9, 0.1, 2.9}), body);
    EXPECT_FALSE(domain.has_surface());
    EXPECT_FALSE(domain.only_sheet());
    EXPECT_FALSE(domain.is_near({0.5, 0.5, 0.5}, 100));
    EXPECT_FALSE(domain.closest_to({0.5, 0.5, 0.5}, 100));
    std::vector<Crossing> found{{}};
    domain.crossings({0, 0, 0}, {1, 1, 1}, found);
    EXPECT_TRUE(found.empty());
  }
}

// A part of the domain knows nothing beyond its region; all of it knows that nothing is there.
TEST(LeafDomain, WhatIsNotLoadedIsNotOutside) {
  const Mesh mesh = shapes::box({{0, 0, 0}, {4, 4, 4}});
  const Box region{{-1, -1, -1}, {2, 2, 2}}, all{{-1, -1, -1}, {5, 5, 5}};
  const LeafDomain part(piece_around(region, mesh)), whole(whole_piece(all, mesh));
  const Point inside{1, 1, 1}, outside{-0.5, 1, 1}, inside_beyond{3, 3, 3}, beyond{9, 9, 9};
  EXPECT_EQ(part.label(inside), kOnlyBody);
  EXPECT_EQ(part.label(outside), kNoBody);
  for (const Point& p : {inside_beyond, beyond}) {
    EXPECT_EQ(part.label(p), std::nullopt);
    EXPECT_EQ(part.state(p), std::nullopt);
    EXPECT_FALSE(is_in_body(part.label(p))) << "but who asks for bodies alone finds none";
  }
  EXPECT_EQ(whole.label(inside_beyond), kOnlyBody);
  EXPECT_EQ(whole.label(beyond), kNoBody);
  EXPECT_EQ(whole.state(beyond), DomainState());
}

TEST(LeafDomain, TellsTheSheetOfWhatIsClosest) {
  const LeafDomain domain = whole_domain(shapes::box({{0, 0, 0}, {4, 4, 4}}), 1);
  EXPECT_EQ(domain.only_sheet(), kOnlySheet);
  const auto closest = domain.closest_to({2, 1, 0.25}, 1);
  ASSERT_TRUE(closest);
  EXPECT_EQ(closest->position, (Point{2, 1, 0}));
  EXPECT_EQ(closest->side.sheet, kOnlySheet);
}

// Two sides of a plate face each other, two sides of an edge of 90 degrees do not.
TEST(LeafDomain, FoldsFaceEachOther) {
  const LeafDomain plate = whole_domain(shapes::thin_plate(4, 0.1), 1);
  const Box box = plate.region();
  const Point on_face{box.center().x, box.center().y, box.max.z - 1};
  EXPECT_TRUE(plate.is_fold(on_face, 0.2));
  EXPECT_FALSE(plate.is_fold(on_face, 0.05));
  const LeafDomain cube = whole_domain(shapes::box({{0, 0, 0}, {4, 4, 4}}), 1);
  EXPECT_FALSE(cube.is_fold({0, 0, 2}, 0.5));
}

// A tiny region that a huge triangle's plane cuts through the corners of the domain's grid, and
// points at those corners: the rounding errors of the plane go with the triangle's size, not the
// region's.
TEST(LeafDomain, SmallRegionOfAHugeTriangle) {
  constexpr unsigned kSeed = 34;
  Random random(kSeed);
  const Box region{{-1, -1, -1}, {1, 1, 1}};
  const Point reference{0.9, 0.9, 0.9};
  for (const double scale : {1e3, 1e6, 1e9})
    for (int round = 0; round < 20; ++round) {
      const Point a = uniform(random, 0.5, 1) * Point{scale, -scale, 0};
      const Point b = uniform(random, 0.5, 1) * Point{-0.3 * scale, -0.7 * scale, scale};
      const Point c = -1.0 * (a + b), d{-scale, -scale, -scale};
      const Mesh mesh = shapes::numbered({{a, b, c}, {a, d, b}, {b, d, c}, {c, d, a}});
      const LeafDomain domain({part_meeting(mesh, region), region, reference,
                               state_if(brute_force::is_inside(reference, mesh))});
      std::uniform_int_distribution<int> pick(-24, 24);
      for (int n = 0; n < 30; ++n) {
        const double x = pick(random) / 24.0, y = pick(random) / 24.0;
        for (const double off : {0.0, 1e-13, 1e-10, 1e-7, -1e-13, -1e-10, -1e-7}) {
          const Point p = Point{x, y, -(x + y)} + Point{off, off, off};
          if (!region.contains(p)) continue;
          ASSERT_EQ(is_inside(domain, p), brute_force::is_inside(p, mesh))
              << "seed " << kSeed << ", scale " << scale << ", round " << round << ", off " << off;
        }
      }
    }
}

// ---- Triangles and boxes

TEST(Meets, IsNeverFalseForATriangleWithAPointInTheBox) {
  constexpr unsigned kSeed = 35;
  Random random(kSeed);
  const Box space{{-1, -1, -1}, {1, 1, 1}};
  int num_true = 0;
  for (int n = 0; n < 20000; ++n) {
    Triangle t{0,
               {uniform_in(random, space), uniform_in(random, space), uniform_in(random, space)}};
    if (n % 3 == 0) t.corners[2] = t.corners[0] + 1e-7 * t.corners[2];  // a needle
    if (n % 5 == 0) t.corners[1].z = t.corners[2].z = t.corners[0].z;   // level
    const Box box = random_part(random, space, 0.01);
    const bool is_met = meets(t, box);
    num_true += is_met;
    for (const Point& p : shapes::random_points_on({t}, 10, random))
      if (box.expanded(-1e-15).contains(p)) {  // the point is rounded
        ASSERT_TRUE(is_met) << "seed " << kSeed << ", n " << n;
      }
  }
  EXPECT_GT(num_true, 500);
}

// Integer corners and weights i/4 make the touching point exact; the box has it on its boundary.
TEST(Meets, IsTrueForATriangleThatTouches) {
  constexpr unsigned kSeed = 36;
  Random random(kSeed);
  std::uniform_int_distribution<int> pick(-50, 50), weight(0, 4), way(-1, 1), size(1, 20);
  for (int n = 0; n < 20000; ++n) {
    Triangle t;
    for (Point& p : t.corners)
      p = {double(pick(random)), double(pick(random)), double(pick(random))};
    const int i = weight(random), j = std::min(weight(random), 4 - i);
    const Point on = 0.25 * (double(i) * t.corners[0] + double(j) * t.corners[1] +
                             double(4 - i - j) * t.corners[2]);
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
      const int w = way(random);
      box.min[axis] = on[axis] - (w <= 0 ? size(random) : 0);
      box.max[axis] = on[axis] + (w >= 0 ? size(random) : 0);
    }
    ASSERT_TRUE(meets(t, box)) << "seed " << kSeed << ", n " << n;
  }
}

TEST(Meets, IsFalseForATriangleClearlyBesideTheBox) {
  const Box box{{0, 0, 0}, {1, 1, 1}};
  EXPECT_FALSE(meets({0, {Point{2, 0, 0}, {3, 0, 0}, {2, 1, 0}}}, box)) << "beyond a face";
  EXPECT_FALSE(meets({0, {Point{3.1, 0, 0}, {0, 3.1, 0}, {0, 0, 3.1}}}, box)) << "beyond a corner";
  EXPECT_TRUE(meets({0, {Point{2.9, 0, 0}, {0, 2.9, 0}, {0, 0, 2.9}}}, box));
}

TEST(LeafDomain, FindsTheClosestPlaceOnACrease) {
  Random random(7);
  const Box region{{0, 0, 0}, {1, 1, 1}};
  const auto point = [&] { return uniform_in(random, region); };
  DomainPiece piece{.triangles = {}, .region = region, .reference = region.min};
  Point last = point();
  for (int i = 0; i < 500; ++i) {  // chains, so that edges share their ends
    const Point next = i % 20 == 0 ? point() : last + 0.1 * (point() - last);
    piece.creases.push_back({.ends = {std::min(last, next), std::max(last, next)}});
    last = next;
  }
  piece.unite();
  const LeafDomain domain(piece);
  ASSERT_TRUE(std::ranges::equal(domain.creases(), piece.creases));
  for (int i = 0; i < 1000; ++i) {
    const Point p = i % 4 == 0 ? piece.creases[static_cast<std::size_t>(i) / 4].ends[i % 8 / 4]
                               : uniform_in(random, region.expanded(0.5));
    const double distance = uniform(random, 0, 0.3);
    std::optional<CreasePoint> expected;
    std::vector<std::size_t> near;
    for (std::size_t e = 0; e < piece.creases.size(); ++e) {
      const auto& [a, b] = piece.creases[e].ends;
      const Point q = closest_on_segment(a, b, p);
      if (piece.creases[e].box().squared_distance(p) < distance * distance) near.push_back(e);
      if (squared_distance(p, q) < distance * distance &&
          (!expected || squared_distance(p, q) < squared_distance(p, expected->position)))
        expected = {q, e};
    }
    const auto found = domain.closest_on_crease(p, distance);
    ASSERT_EQ(found.has_value(), expected.has_value());
    if (found) {
      EXPECT_EQ(found->position, expected->position);
      EXPECT_EQ(found->edge, expected->edge);
    }
    std::vector<std::size_t> met;
    domain.for_each_crease_near(p, distance, [&](std::size_t edge) { met.push_back(edge); });
    std::ranges::sort(met);
    EXPECT_EQ(met, near);
  }
}

}  // namespace
}  // namespace locvol
