// Creases: points along them, samples of sheets that keep off them, and meshes that have them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <ostream>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "octree/frame.h"
#include "octree/lattice.h"
#include "refine/cell_shape.h"
#include "refine/cover_leaf.h"
#include "refine/crease_graph.h"
#include "refine/crease_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/forced_angles.h"
#include "refine/mirror.h"
#include "refine/refine_leaf.h"
#include "refine/tip_ring.h"
#include "tests/refine/creased_shapes.h"

namespace locvol {
namespace {

using namespace creased_shapes;
using Segment = std::array<Point, 2>;  // the smaller end first

Segment segment(const Point& a, const Point& b) { return {std::min(a, b), std::max(a, b)}; }

std::vector<Point> points_on(const Creased& shape, double size, const Box& box,
                             const std::vector<Point>& nearby = {}) {
  CreaseInput input{.size = size, .box = box, .domain = {}, .nearby = nearby};
  input.domain = shape.piece(shape.box().expanded(4 * size));
  return crease_leaf(std::move(input)).positions;
}

// Of points on the creases, those that follow each other, with the way between them.
std::map<Segment, double> segments_between(const Creased& shape, const std::vector<Point>& points) {
  const LeafDomain domain(shape.piece(shape.box().expanded(1)));
  CreaseGraph graph(domain);
  for (const Point& p : points) EXPECT_TRUE(graph.add(p, 1e-9));
  std::map<Segment, double> segments;
  std::vector<CreaseGraph::Neighbor> neighbors;
  for (CreaseGraph::Index i = 0; i < graph.num_points(); ++i) {
    graph.neighbors(i, neighbors);
    for (const CreaseGraph::Neighbor& n : neighbors) {
      EXPECT_NE(n.point, CreaseGraph::kNone);
      segments[segment(graph.point(i), graph.point(n.point))] = n.along;
    }
  }
  return segments;
}

double sum_of_ways(const std::map<Segment, double>& segments) {
  double sum = 0;
  for (const auto& [ends, way] : segments) sum += way;
  return sum;
}

// ---- Points along creases

TEST(CreaseGraph, KnowsWhichPointsFollowEachOther) {
  const Creased shape = cube(2);
  const LeafDomain domain(shape.piece(shape.box().expanded(1)));
  CreaseGraph graph(domain);
  const auto corner = graph.add({-1, -1, 0}, 1e-9), near = graph.add({-0.5, -1, 0}, 1e-9),
             far = graph.add({0.25, -1, 0}, 1e-9);
  EXPECT_FALSE(graph.add({0, 0, 0}, 1e-9));
  std::vector<CreaseGraph::Neighbor> neighbors;
  graph.neighbors(*near, neighbors);
  std::set<CreaseGraph::Index> found;
  for (const auto& n : neighbors) found.insert(n.point);
  EXPECT_EQ(found, (std::set{*corner, *far}));
  EXPECT_DOUBLE_EQ(graph.ball_radius(*near), kCreaseBall * 0.75);
  graph.neighbors(*corner, neighbors);
  EXPECT_EQ(neighbors.size(), 3U);
  std::vector<SheetId> sheets;
  graph.sheets(*corner, sheets);
  EXPECT_EQ(sheets.size(), 3U);
  graph.sheets(*near, sheets);
  EXPECT_EQ(sheets.size(), 2U);
  // A point between two comes between them.
  const auto between = graph.add({0, -1, 0}, 1e-9);
  graph.neighbors(*near, neighbors);
  EXPECT_TRUE(std::ranges::any_of(neighbors, [&](const auto& n) { return n.point == *between; }));
  EXPECT_DOUBLE_EQ(graph.ball_radius(*near), kCreaseBall * 0.5);
}

TEST(CreaseLeaf, StepsAreAsLongAsTheyMayBe) {
  for (const double size : {0.07, 0.2, 0.55, 0.9, 3.0}) {
    SCOPED_TRACE(size);
    const Creased shape = cube(2);
    const std::vector<Point> points = points_on(shape, size, shape.box().expanded(0.1));
    for (const Point& corner : {Point{-1, -1, 0}, {1, 1, 2}, {-1, 1, 2}})
      EXPECT_EQ(std::ranges::count(points, corner), 1);
    const auto segments = segments_between(shape, points);
    EXPECT_NEAR(sum_of_ways(segments), 24, 1e-9);
    const double least = 2 / std::ceil(2 / (kCreaseStep * size) + 1);
    for (const auto& [ends, way] : segments) {
      EXPECT_LE(way, 1.021 * kCreaseStep * size);
      EXPECT_GE(way, 0.99 * least);
    }
  }
}

TEST(CreaseLeaf, LeavesContinueEachOther) {
  const Creased shape = cube(2);
  const double size = 0.13;
  std::vector<Point> points;
  // Eight leaves, none of whose faces has a crease in it.
  for (int octant = 0; octant < 8; ++octant) {
    Box leaf{{-1.5, -1.5, -0.5}, {0.1, 0.2, 0.9}};
    for (const int axis : {0, 1, 2})
      if (octant >> axis & 1) {
        leaf.min[axis] = leaf.max[axis];
        leaf.max[axis] = 2.5;
      }
    const std::vector<Point> more = points_on(shape, size, leaf, points);
    for (const Point& p : more) EXPECT_TRUE(is_in_leaf(leaf, p));
    points.insert(points.end(), more.begin(), more.end());
  }
  const auto segments = segments_between(shape, points);
  EXPECT_NEAR(sum_of_ways(segments), 24, 1e-9);
  for (const auto& [ends, way] : segments) {
    EXPECT_LE(way, 1.021 * kCreaseStep * size);
    EXPECT_GE(way, 0.3 * kCreaseStep * size);
  }
}

// A hole far below the size has points enough to be round.
TEST(CreaseLeaf, StepsTurnByNoMoreThanTheyMay) {
  for (const int num_sides : {12, 48, 300}) {
    const Creased shape = cylinder(0.01, 1, num_sides);
    const auto segments = segments_between(shape, points_on(shape, 0.3, shape.box().expanded(0.1)));
    EXPECT_NEAR(sum_of_ways(segments), shape.length(), 1e-9);
    for (const auto& [ends, way] : segments) EXPECT_LE(way, 1.03 * 0.01 * kMostTurn * kPi / 180);
    EXPECT_GE(segments.size(), 2U * 8);
  }
}

// A round crease starts in the middle of an edge, and comes to that across from it.
TEST(CreaseLeaf, PointsInTheMiddleOfEdgesAreThereOnce) {
  for (const int num_sides : {8, 16, 24, 32}) {
    SCOPED_TRACE(num_sides);
    std::vector<Point> polygon;
    for (int i = 0; i < num_sides; ++i) {
      const double angle = (i + 0.5) * 2 * kPi / num_sides;  // in single precision: symmetric
      polygon.push_back({static_cast<float>(0.3 * std::cos(angle)),
                         static_cast<float>(0.3 * std::sin(angle)), 0});
    }
    const Creased shape = prism(polygon, 0.15);
    std::vector<Point> points = points_on(shape, 0.29, shape.box().expanded(0.1));
    std::ranges::sort(points);
    EXPECT_GE(points.size(), 2U * 8);
    EXPECT_EQ(std::ranges::adjacent_find(points), points.end());
  }
}

TEST(CreaseLeaf, StepsGrowFromShortCreases) {
  // A corner is cut off by a face as narrow as a hundredth of the size.
  const Creased shape = prism({{1, -1, 0}, {1, 0.99, 0}, {0.99, 1, 0}, {-1, 1, 0}, {-1, -1, 0}}, 2);
  const auto segments = segments_between(shape, points_on(shape, 1, shape.box().expanded(0.1)));
  EXPECT_NEAR(sum_of_ways(segments), shape.length(), 1e-9);
  std::map<Point, std::vector<double>> ways;
  for (const auto& [ends, way] : segments)
    for (const Point& p : ends) ways[p].push_back(way);
  for (const auto& [p, of_point] : ways) {
    const auto [least, most] = std::ranges::minmax(of_point);
    EXPECT_LE(most, 2.1 * least);
  }
}

// A tetrahedron with a corner at the origin, whose creases have these directions, and which is so
// large that nothing else is near.
Creased corner_of(const std::array<Point, 3>& ways) {
  std::array<Point, 3> far;
  for (std::size_t i = 0; i < 3; ++i) far[i] = (10 / norm(ways[i])) * ways[i];
  if (dot(far[0], cross(far[1], far[2])) < 0) std::swap(far[1], far[2]);
  const Point o;
  return creased({{o, far[1], far[0]}, {o, far[2], far[1]}, {o, far[0], far[2]}, far});
}

// Cells between an acute corner and the first points on its three creases have their circumcenters
// between these.
TEST(CreaseLeaf, CellsAtAcuteCornersHaveTheirCentersBetweenTheCreases) {
  const auto seed = std::random_device{}();
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> angle(25, 55), lean(50, 130);
  std::size_t num_unlike = 0, num_between = 0, num_left = 0, num = 0;
  for (int n = 0; n < 600; ++n) {
    // Two creases at an acute angle, and one that leans to them by angles of its own.
    const double within = angle(random) * kPi / 180, a = lean(random) * kPi / 180,
                 b = lean(random) * kPi / 180;
    const double x = std::cos(a), y = (std::cos(b) - x * std::cos(within)) / std::sin(within);
    if (x * x + y * y > 0.7) continue;
    std::array<Point, 3> ways{Point{1, 0, 0}, Point{std::cos(within), std::sin(within), 0},
                              Point{x, y, std::sqrt(1 - x * x - y * y)}};
    const Creased shape = corner_of(ways);
    if (shape.creases.size() != 6) continue;  // two faces are nearly in a plane
    ++num;
    std::array<Point, 3> first;  // on each crease
    std::vector<Point> beside;   // on none
    for (const Point& p : points_on(shape, 1, shape.box().expanded(0.1))) {
      if (norm(p) == 0 || norm(p) > kCreaseStep + 1e-9) continue;
      bool is_on_crease = false;
      for (std::size_t i = 0; i < 3; ++i)
        if (norm(cross(p, ways[i])) < 1e-9) first[i] = p, is_on_crease = true;
      if (!is_on_crease) beside.push_back(p);
    }
    std::array<double, 3> length;
    for (std::size_t i = 0; i < 3; ++i) {
      length[i] = norm(first[i]);
      EXPECT_GE(length[i], 0.74 * kCreaseStep);
    }
    // Of the ball through the corner and three points, the center as a sum of the creases.
    const auto least_weight = [&](const std::array<Point, 3>& p) {
      const Point c = (0.5 / dot(p[0], cross(p[1], p[2]))) *
                      (dot(p[0], p[0]) * cross(p[1], p[2]) + dot(p[1], p[1]) * cross(p[2], p[0]) +
                       dot(p[2], p[2]) * cross(p[0], p[1]));
      double least = 1;
      for (std::size_t i = 0; i < 3; ++i) {
        const Point across = cross(ways[(i + 1) % 3], ways[(i + 2) % 3]);
        least = std::min(least, dot(c, across) / dot(ways[i], across));
      }
      return least;
    };
    ASSERT_LE(beside.size(), 1U);
    if (!beside.empty()) {
      ++num_between;
      std::size_t from = 0;  // the crease that is not of its face
      for (std::size_t i = 0; i < 3; ++i) {
        const Point face = cross(ways[(i + 1) % 3], ways[(i + 2) % 3]);
        if (std::abs(dot(beside[0], face)) < 1e-9) from = i;
      }
      EXPECT_NEAR(norm(beside[0]), length[0], 1e-9);
      for (const std::size_t k : {1, 2})
        EXPECT_GT(least_weight({first[from], first[(from + k) % 3], beside[0]}), 0) << n;
    } else if (least_weight(first) > 0) {
      num_unlike += std::ranges::max(length) > std::ranges::min(length) + 1e-9;
    } else {
      ++num_left;  // too far aside
    }
  }
  EXPECT_GT(num_between, num / 10);
  EXPECT_GT(num_unlike, 0U);  // about one in 35
  EXPECT_LT(num_left, num / 5);
}

// ---- What is close is one

TEST(CreaseGraph, CornersCloserThanTheFloorAreOne) {
  // A corner of a box is cut off by a face as wide as this.
  for (const double width : {1e-9, 0.01, 0.03}) {
    SCOPED_TRACE(width);
    const Creased shape =
        prism({{1, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {1 - width, -1, 0}, {1, -1 + width, 0}}, 1);
    DomainPiece piece = shape.piece(shape.box().expanded(1));
    piece.crease_floor = 0.02;
    const LeafDomain domain(std::move(piece));
    const CreaseGraph graph(domain);
    std::size_t num_fixed = 0, num_left_out = 0;
    for (CreaseGraph::Vertex v = 0; v < graph.num_vertices(); ++v) num_fixed += graph.is_fixed(v);
    for (CreaseGraph::Edge e = 0; e < graph.edges().size(); ++e)
      num_left_out += graph.is_left_out(e);
    const bool is_one = width < 0.02 / std::sqrt(2);
    EXPECT_EQ(num_fixed, is_one ? 8U : 10U);
    EXPECT_EQ(num_left_out, is_one ? 2U : 0U);
    // It has the edges of both.
    const auto one = graph.vertex_at({1 - width, -1, 0}),
               other = graph.vertex_at({1, -1 + width, 0});
    ASSERT_TRUE(one && other);
    EXPECT_EQ(*one == *other, is_one);
    EXPECT_EQ(graph.edges_at(*one).size(), is_one ? 4U : 3U);
  }
}

TEST(CreaseGraph, LeavesOutCreasesThatComeBackAtOnce) {
  const Creased shape = cylinder(0.001, 1, 12);
  DomainPiece piece = shape.piece(shape.box().expanded(1));
  const LeafDomain as_it_is(piece);
  piece.crease_floor = 0.01;
  const LeafDomain domain(std::move(piece));
  const CreaseGraph all(as_it_is), graph(domain);
  ASSERT_EQ(graph.edges().size(), 24U);
  for (CreaseGraph::Edge e = 0; e < 24; ++e) {
    EXPECT_FALSE(all.is_left_out(e));
    EXPECT_TRUE(graph.is_left_out(e));
  }
}

// ---- Mirrors

TEST(Mirrors, LieAcrossTheEdge) {
  for (const double degrees : {20.0, 45.0, 60.0, 85.0}) {
    const Creased shape = bar(degrees, 3);
    const LeafDomain domain(shape.piece(shape.box().expanded(1)));
    const double half = 0.5 * degrees * kPi / 180;
    const Point tip{-0.5, 0, 1.5};
    const double along = 0.4;
    const Point p = tip + along * Point{std::cos(half), -std::sin(half), 0};
    const auto here = domain.closest_to(p, 1);
    std::vector<MirrorPoint> mirrors;
    mirrors_of(domain, p, 0.5, 1, mirrors);
    ASSERT_EQ(mirrors.size(), 1U);
    const Point expected = tip + along * Point{std::cos(half), std::sin(half), 0};
    EXPECT_LT(norm(mirrors.front().position - expected), 1e-12);
    EXPECT_NE(mirrors.front().side.sheet, here->side.sheet);
  }
  // Not of a sheet that turns by less, nor of one that is far.
  const Creased shape = cube(2);
  const LeafDomain domain(shape.piece(shape.box().expanded(1)));
  std::vector<MirrorPoint> mirrors;
  mirrors_of(domain, {0.9, 0, 0}, 0.6, 1, mirrors);
  EXPECT_TRUE(mirrors.empty());
}

// Of the sheet itself, where it faces itself: across the wall, and a little aside, so that it is
// not in a circle with its point and two others.
TEST(Mirrors, AcrossAWallAreALittleAside) {
  constexpr double kReach = 0.5;
  for (const double width : {0.05, 0.15, 0.3, 0.45}) {
    Creased shape = prism({{1, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {1, -1, 0}}, width);
    for (Triangle& t : shape.triangles) t.sheet = 1;
    const LeafDomain domain(shape.piece(shape.box().expanded(1)));
    std::vector<MirrorPoint> across;
    const auto mirror_of = [&](const Point& p) {
      mirrors_of(domain, p, kReach, 1, across);
      return across.size() == 1 ? across.front().position : Point{};
    };
    const Point p{0.1, 0.2, 0}, q{-0.3, 0.1, 0}, mirror = mirror_of(p);
    EXPECT_NEAR(mirror.z, width, 1e-12);
    const Point aside = mirror - p - Point{0, 0, width};
    EXPECT_GT(norm(aside), 0.01 * width * width / kReach);
    EXPECT_LT(norm(aside), 0.1 * width * width / kReach);
    EXPECT_LT(norm(mirror_of(q) - q - (mirror - p)), 1e-12) << "in a plane with others";
    EXPECT_LT(norm(mirror_of(mirror) - p), 1e-12);
    mirrors_of(domain, p, 0.9 * width, 1, across);
    EXPECT_TRUE(across.empty());
  }
}

std::vector<Point> orbit_of(const LeafDomain& domain, const Point& p, double reach) {
  std::vector<Point> places;
  for_each_in_orbit(domain, p, reach, 2 * reach, [&](const MirrorPoint& mirror, const Point&) {
    places.push_back(mirror.position);
    return true;
  });
  return places;
}

bool has(const std::vector<Point>& places, const Point& p) {
  return std::ranges::any_of(places, [&](const Point& q) { return norm(p - q) < 1e-12; });
}

// A point below an acute edge at a gap: its mirror on the face above has one across the gap.
TEST(Mirrors, OfMirrorsAreOnFurtherSides) {
  Creased both = bar(60, 3);
  const Point tip{-0.5, 0, 1.5};
  const double gap = 0.1, half = std::numbers::pi / 6;
  const Point out{-std::sin(half), std::cos(half), 0};  // of the upper face
  // The other bar is this one's image beyond the gap.
  const auto image = [&](const Point& p) {
    const double off = dot(p - tip, out) - 0.5 * gap;
    return p - 2 * off * out;
  };
  const std::size_t num = both.triangles.size();
  for (std::size_t i = 0; i < num; ++i) {
    Triangle t = both.triangles[i];
    t.id += num;
    t.sheet += 100;
    for (Point& corner : t.corners) corner = image(corner);
    std::swap(t.corners[0], t.corners[1]);
    both.triangles.push_back(t);
  }
  const LeafDomain domain(both.piece(both.box().expanded(2)));
  const double along = 0.3;
  const Point below = tip + along * Point{std::cos(half), -std::sin(half), 0},
              above = tip + along * Point{std::cos(half), std::sin(half), 0};
  const std::vector<Point> places = orbit_of(domain, below, 0.35);
  EXPECT_TRUE(has(places, above));
  EXPECT_TRUE(has(places, image(above)));
  EXPECT_FALSE(has(places, below));
}

// The bodies 1, 2, and so on, with each common triangle once, and a sheet for each pair of planes.
Creased touching(const std::vector<Creased>& bodies) {
  Creased all;
  std::map<std::array<Point, 3>, std::size_t> places;
  for (std::size_t b = 0; b < bodies.size(); ++b)
    for (const Triangle& t : bodies[b].triangles) {
      if (norm(normal_of(t.corners)) == 0) continue;
      std::array<Point, 3> corners = t.corners;
      std::ranges::sort(corners);
      const auto body = DomainState::in(static_cast<BodyId>(b + 1));
      const auto [known, is_new] = places.try_emplace(corners, all.triangles.size());
      if (!is_new) {
        all.triangles[known->second].change = all.triangles[known->second].change.crossed(body);
        continue;
      }
      all.triangles.push_back(t);
      all.triangles.back().id = known->second;
      all.triangles.back().sheet = static_cast<SheetId>(100 * b) + t.sheet;
      all.triangles.back().change = body;
    }
  return all;
}

// Whichever way its sheets are given: of layers each has the mirror straight above or below.
TEST(Mirrors, GoThroughAStackOfBodies) {
  constexpr double kThickness = 0.3;
  constexpr int kNumPlates = 6;
  const std::vector<Point> square = {{2, 2, 0}, {-2, 2, 0}, {-2, -2, 0}, {2, -2, 0}};
  std::vector<Creased> plates;
  for (int i = 0; i < kNumPlates; ++i) {
    Creased plate = prism(square, kThickness);
    for (Triangle& t : plate.triangles)
      for (Point& p : t.corners) p.z = kThickness * (i + (p.z > 0 ? 1 : 0));
    plates.push_back(std::move(plate));
  }
  const Creased stack = touching(plates);
  const LeafDomain domain(stack.piece(stack.box().expanded(1)));
  for (const int from : {0, 2, 6}) {
    const auto at = [&](int layer) { return Point{0.3, 0.1, kThickness * layer}; };
    const std::vector<Point> places = orbit_of(domain, at(from), 0.4);
    EXPECT_EQ(places.size(), std::size_t{kNumPlates});
    for (int layer = 0; layer <= kNumPlates; ++layer)
      EXPECT_EQ(has(places, at(layer)), layer != from) << layer << " seen from " << from;
  }
}

// Wedges around the z axis: half-planes between them, first, and round about what closes them.
Creased pie(int num) {
  const auto at = [&](int i, double z) {
    const double angle = 2 * kPi * i / num;
    return Point{2 * std::cos(angle), 2 * std::sin(angle), z};
  };
  Creased all;
  SheetId sheet = 0;
  const auto add_quad = [&](const std::array<Point, 4>& q, DomainState change) {
    ++sheet;
    all.triangles.push_back({all.triangles.size(), {q[0], q[1], q[2]}, sheet, change});
    all.triangles.push_back({all.triangles.size(), {q[0], q[2], q[3]}, sheet, change});
  };
  constexpr double kHeight = 3;
  for (int i = 0; i < num; ++i) {
    const auto before = static_cast<BodyId>((i + num - 1) % num + 1);
    const auto behind = static_cast<BodyId>(i + 1);
    add_quad({Point{}, {0, 0, kHeight}, at(i, kHeight), at(i, 0)},
             DomainState::between(before, behind));
    add_quad({at(i, 0), at(i + 1, 0), at(i + 1, kHeight), at(i, kHeight)}, DomainState::in(behind));
    for (const double z : {0.0, kHeight})
      all.triangles.push_back({all.triangles.size(),
                               {Point{0, 0, z}, at(i, z), at(i + 1, z)},
                               ++sheet,
                               DomainState::in(behind)});
  }
  return all;
}

// Around a crease it comes back to where it began.
TEST(Mirrors, GoAroundACreaseOfSeveralBodies) {
  for (const int num : {5, 8, 12}) {
    const auto at = [&](int i) {
      constexpr double kRadius = 0.5;
      const double angle = 2 * kPi * i / num;
      return Point{kRadius * std::cos(angle), kRadius * std::sin(angle), 1.4};
    };
    const Creased shape = pie(num);
    const LeafDomain domain(shape.piece(shape.box().expanded(1)));
    const std::vector<Point> places = orbit_of(domain, at(1), 0.6);
    EXPECT_EQ(places.size(), static_cast<std::size_t>(num - 1));
    for (int i = 0; i < num; ++i) EXPECT_EQ(has(places, at(i)), i != 1) << i << " of " << num;
  }
}

// At a right angle there is none, however its normals are rounded.
TEST(Mirrors, AreNotAtRightAngles) {
  for (const double turn : {0.1, 0.7, 1.3, 2.9}) {
    const Creased shape = bar(90, 3);
    Creased turned = shape;
    for (Triangle& t : turned.triangles)
      for (Point& p : t.corners)
        p = {std::cos(turn) * p.x - std::sin(turn) * p.y,
             std::sin(turn) * p.x + std::cos(turn) * p.y, p.z};
    const LeafDomain domain(turned.piece(turned.box().expanded(1)));
    const double half = kPi / 4 - turn;  // of the lower face, seen from the tip
    const Point tip{-0.5 * std::cos(turn), -0.5 * std::sin(turn), 1.5};
    std::vector<MirrorPoint> mirrors;
    mirrors_of(domain, tip + 0.3 * Point{std::cos(half), -std::sin(half), 0}, 0.4, 1, mirrors);
    EXPECT_TRUE(mirrors.empty()) << turn;
  }
}

// ---- Meshes of one leaf

// With edges of 38 and 105 degrees, and acute corners.
Creased leaning_wedge(const Point& aside) {
  return prism({{1, -0.25, 0}, {0, 0.52, 0}, {-1, -0.25, 0}}, 2, aside);
}

// Square.
Creased plate(double side, double width) {
  const double half = 0.5 * side;
  return prism({{half, half, 0}, {-half, half, 0}, {-half, -half, 0}, {half, -half, 0}}, width);
}

struct Case {
  std::string name;
  std::function<Creased()> make;
  double size;
  bool is_plane = true;     // all of its faces are
  double least_angle = 15;  // of cells; less where none can be moved
  friend std::ostream& operator<<(std::ostream& out, const Case& c) {
    return out << c.name << " at " << c.size;
  }
};

class CreasedMesh : public testing::TestWithParam<Case> {
 protected:
  void SetUp() override {
    shape_ = GetParam().make();
    const double size = GetParam().size;
    const Box box = shape_.box();
    const Point sides = box.max - box.min;
    const double side = max_norm(sides) + 2 * size;
    const Frame frame = Frame::around(box, 0.5 * size, side);
    const Lattice lattice(frame, size, side);
    leaf_ = frame.box(MortonKey::root());
    const DomainPiece piece = shape_.piece(leaf_.expanded(4 * size));
    const std::vector<Point> on_creases = points_on(shape_, size, leaf_);
    CoverInput cover;
    cover.size = size;
    cover.lattice = lattice;
    cover.box = leaf_;
    cover.domain = piece;
    cover.crease_points = on_creases;
    cover.are_sides_apart = true;
    const CoverPoints first = cover_leaf(cover);
    std::vector<MeshPoint>& points = input_.own;
    for (const LatticeSite& site : first.lattice) points.push_back(lattice.point(site));
    const SiteBox sites = lattice.sites_in(leaf_);
    for_each_core_site(first.core, sites, sites, [&](const LatticeSite& site, std::uint64_t) {
      points.push_back(lattice.point(site));
    });
    std::ranges::sort(points, {}, &MeshPoint::id);
    std::uint64_t id = kFirstOtherId;
    for (const Point& p : on_creases) points.push_back({id++, p, PointKind::kCrease});
    for (const Point& p : first.samples) points.push_back({id++, p, PointKind::kSurface});
    const FillPoints fill = fill_leaf({size, leaf_, points, {}, piece});
    for (const Point& p : fill.centers) points.push_back({id++, p, PointKind::kVolume});
    input_.criteria = Criteria::of_cover(size, 2, 0.02, 15);
    input_.box = leaf_;
    input_.domain = piece;
    for (const MeshPoint& p : points)
      if (p.kind == PointKind::kCrease) input_.crease_points.push_back(p);
    input_.are_sides_apart = true;
    delta_ = refine_leaf(input_);
    for (const MeshPoint& p : points) positions_[p.id] = p.position;
    for (std::size_t i = 0; i < delta_.inserted.size(); ++i)
      positions_[kNewPoint | i] = delta_.inserted[i].position;
  }

  // Without those beside corners, which lie on faces.
  std::vector<Point> crease_points() const {
    std::vector<Point> points;
    for (const MeshPoint& p : input_.crease_points)
      if (std::ranges::find(delta_.moved, p.id, &MeshPoint::id) == delta_.moved.end())
        points.push_back(p.position);
    for (const InsertedPoint& p : delta_.inserted)
      if (p.kind == PointKind::kCrease) points.push_back(p.position);
    const LeafDomain domain(shape_.piece(leaf_.expanded(1)));
    std::erase_if(points, [&](const Point& p) { return !domain.closest_on_crease(p, 1e-9); });
    return points;
  }
  std::array<Point, 3> corners(const MeshFacet& facet) const {
    std::array<Point, 3> corners;
    for (std::size_t k = 0; k < 3; ++k)
      corners[k] = positions_.at(delta_.facets.vertices[facet.vertices[k]]);
    return corners;
  }

  Creased shape_;
  Box leaf_;
  LeafInput input_;
  LeafDelta delta_;
  std::map<VertexRef, Point> positions_;
};

TEST_P(CreasedMesh, HasAllCreases) {
  EXPECT_TRUE(delta_.unresolved.empty());
  if (GetParam().least_angle == 15) {
    EXPECT_TRUE(delta_.poor.empty());
  }
  // Each edge of the boundary has two facets, and so has each segment of a crease.
  std::map<Segment, int> num_facets;
  for (const MeshFacet& facet : delta_.facets.facets) {
    const auto [a, b, c] = corners(facet);
    for (const Segment& edge : {segment(a, b), segment(b, c), segment(c, a)}) ++num_facets[edge];
  }
  for (const auto& [edge, num] : num_facets) EXPECT_EQ(num, 2);
  const auto segments = segments_between(shape_, crease_points());
  EXPECT_NEAR(sum_of_ways(segments), shape_.length(), 1e-9 * shape_.length());
  for (const auto& [ends, way] : segments) EXPECT_EQ(num_facets.count(ends), 1U);
  for (const CreaseEdge& edge : shape_.creases)
    for (const std::size_t k : {0, 1})
      if (edge.is_corner[k]) {
        EXPECT_EQ(std::ranges::count(crease_points(), edge.ends[k]), 1);
      }
}

TEST_P(CreasedMesh, HasNoFacetAcross) {
  const LeafDomain domain(shape_.piece(leaf_.expanded(1)));
  CreaseGraph graph(domain);
  std::map<Point, std::vector<SheetId>> of_creases;
  for (const Point& p : crease_points()) graph.sheets(*graph.add(p, 1e-9), of_creases[p]);
  for (const MeshFacet& facet : delta_.facets.facets) {
    std::map<SheetId, int> shared;
    for (const Point& p : corners(facet)) {
      if (const auto found = of_creases.find(p); found != of_creases.end())
        for (const SheetId sheet : found->second) ++shared[sheet];
      else
        ++shared[domain.closest_to(p, 1)->side.sheet];
    }
    EXPECT_TRUE(std::ranges::any_of(shared, [](const auto& s) { return s.second == 3; }));
    EXPECT_EQ(shared[facet.labels.sheet], 3);
  }
}

TEST_P(CreasedMesh, HasTheVolumeAndAngles) {
  double volume = 0;
  for (std::size_t i = 0; i < delta_.cells.size(); ++i) {
    std::array<Point, 4> c;
    for (std::size_t k = 0; k < 4; ++k) c[k] = positions_.at(delta_.cells.refs(i)[k]);
    volume += dot(c[1] - c[0], cross(c[2] - c[0], c[3] - c[0])) / 6;
    EXPECT_LE(largest_cosine(c), std::cos((GetParam().least_angle - 0.001) * kPi / 180));
  }
  EXPECT_NEAR(volume, shape_.volume, (GetParam().is_plane ? 1e-10 : 0.02) * shape_.volume);
}

INSTANTIATE_TEST_SUITE_P(
    Shapes, CreasedMesh,
    testing::Values(Case{"Cube", [] { return cube(2); }, 0.3},
                    Case{"Cube", [] { return cube(2); }, 0.81},
                    Case{"Cross", [] { return cross_bar(2); }, 0.2},
                    Case{"Bar90", [] { return bar(90, 2); }, 0.15},
                    Case{"Bar60", [] { return bar(60, 2); }, 0.15},
                    Case{"Bar45", [] { return bar(45, 2); }, 0.15},
                    Case{"Bar120", [] { return bar(120, 2); }, 0.15},
                    Case{"Plate", [] { return plate(2, 0.1); }, 0.3, true, 6},
                    Case{"PlateOf0.28Sizes", [] { return plate(2, 0.056); }, 0.2, true, 3},
                    Case{"PlateOf0.4Sizes", [] { return plate(2, 0.08); }, 0.2, true, 3},
                    Case{"PlateOf0.6Sizes", [] { return plate(2, 0.12); }, 0.2},
                    Case{"Disk", [] { return cylinder(0.5, 0.07, 48); }, 0.15, false},
                    Case{"LeaningWedge",
                         [] {
                           return leaning_wedge({0, 1.5, 0});
                         },
                         0.3},
                    Case{"LeaningWedge",
                         [] {
                           return leaning_wedge({1.5, 1.5, 0});
                         },
                         0.3},
                    Case{"LeaningWedge",
                         [] {
                           return leaning_wedge({0.7, 1.5, 0});
                         },
                         0.2},
                    Case{"Cylinder", [] { return cylinder(0.5, 1, 60); }, 0.15, false}));

// ---- Tips of cones

// Around z, with its tip at the origin, upwards or (a pit) downwards from it.
Creased cone(double degrees, double height, bool is_pit = false) {
  constexpr int kNumSides = 37;
  const double radius = height * std::tan(0.5 * degrees * kPi / 180);
  std::vector<std::array<Point, 3>> soup;
  const auto rim = [&](int i) {
    const double angle = 2 * kPi * i / kNumSides;
    return Point{radius * std::cos(angle), radius * std::sin(angle), -height};
  };
  for (int i = 0; i < kNumSides; ++i) {
    const Point a = rim(i), b = rim(i + 1 == kNumSides ? 0 : i + 1), base = {0, 0, -height};
    soup.push_back({Point{}, a, b});
    soup.push_back({base, b, a});
    if (is_pit)
      for (std::size_t t = soup.size() - 2; t < soup.size(); ++t) std::swap(soup[t][1], soup[t][2]);
  }
  return creased(soup);
}

std::vector<Point> ring_of(const Creased& shape, double most) {
  return ring_around_tip(LeafDomain(shape.piece(shape.box().expanded(1))), {}, most, 0.01);
}

// A spindle is alike on both sides: where its rings are as far from one tip as from the other, they
// are one.
TEST(TipRing, IsNotThatOfAnotherTip) {
  const Point other{0, 0, -4};
  Creased spindle = cone(30, 2);
  std::erase_if(spindle.triangles, [](const Triangle& t) { return t.corners[0] != Point{}; });
  for (std::size_t i = 0, num = spindle.triangles.size(); i < num; ++i) {
    Triangle t = spindle.triangles[i];
    t.id += num;
    for (Point& p : t.corners) p.z = other.z - p.z;
    std::swap(t.corners[1], t.corners[2]);
    spindle.triangles.push_back(t);
  }
  spindle.creases.clear();
  DomainPiece piece = spindle.piece(spindle.box().expanded(1));
  piece.corners = {{.position = other, .corner = 1}, {.position = {}, .corner = 2}};
  const LeafDomain domain(std::move(piece));
  const std::vector<Point> here = ring_around_tip(domain, {}, 5, 0.01),
                           there = ring_around_tip(domain, other, 5, 0.01);
  ASSERT_EQ(here.size(), 5U);
  ASSERT_EQ(there.size(), 5U);
  for (const Point& p : here)
    for (const Point& q : there) EXPECT_GT(norm(p - q), 0.1);
}

TEST(TipRing, IsOnTheConeAtOneDistanceAndAtEqualAngles) {
  for (const double degrees : {3.0, 20.0, 60.0, 120.0})
    for (const bool is_pit : {false, true}) {
      const std::vector<Point> ring = ring_of(cone(degrees, 4, is_pit), 0.84);
      ASSERT_EQ(ring.size(), 5U) << degrees;
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const Point &p = ring[i], &next = ring[(i + 1) % ring.size()];
        EXPECT_NEAR(norm(p), 0.84, 1e-12);
        // Sides of the cone's polygon are within 0.4% of its circle.
        EXPECT_NEAR(std::hypot(p.x, p.y), 0.84 * std::sin(0.5 * degrees * kPi / 180), 4e-3);
        const double cosine =
            (p.x * next.x + p.y * next.y) / (std::hypot(p.x, p.y) * std::hypot(next.x, next.y));
        EXPECT_NEAR(std::acos(cosine), 2 * kPi / 5, 1e-4);
      }
    }
}

TEST(TipRing, KeepsHalfWayToTheNearestCrease) {
  const std::vector<Point> ring = ring_of(cone(40, 1), 0.84);
  ASSERT_EQ(ring.size(), 5U);
  EXPECT_NEAR(norm(ring[0]), 0.5 / std::cos(20 * kPi / 180), 0.01);  // the rim's distance, halved
  EXPECT_TRUE(ring_of(cone(40, 0.01), 0.84).empty());                // no room
}

TEST(TipRing, IsSoSmallThatItMeetsTheConeAlone) {
  Creased both = cone(30, 4);
  Creased other = cone(30, 4);
  for (Triangle& t : other.triangles) {
    t.id += both.triangles.size();
    for (Point& p : t.corners) p = p + Point{0.3, 0, 0.1};  // a tip beside the tip
    both.triangles.push_back(t);
  }
  both.creases.clear();
  const std::vector<Point> ring = ring_of(both, 0.84);
  ASSERT_EQ(ring.size(), 5U);
  EXPECT_LT(norm(ring[0]), 0.3);
}

// ---- Angles that the surface forces

ForcedAngles angles_of(const Creased& shape, double size) {
  return {shape.piece(shape.box().expanded(size)), size, 15};
}

// A cell with an edge on that of the bar, and one corner on each side, a part of `size` from it.
std::array<Point, 4> cell_at_edge(double degrees, double size) {
  const double half = 0.5 * degrees * kPi / 180;
  const Point tip{-0.5, 0, 0.5};
  const auto on_side = [&](double angle) {
    return tip + size * Point{std::cos(angle), std::sin(angle), 0.5};
  };
  return {tip, tip + Point{0, 0, size}, on_side(half), on_side(-half)};
}

TEST(ForcedAngles, AreThoseAtCreasesSharperThan30Degrees) {
  for (const double degrees : {8.0, 20.0, 29.0, 31.0, 60.0})
    EXPECT_EQ(angles_of(bar(degrees, 1), 0.2).are_forced(cell_at_edge(degrees, 0.2)), degrees < 30)
        << degrees;
}

TEST(ForcedAngles, AreNotThoseBesideGrooves) {
  // The bar's complement in a box: inside and outside change places.
  std::vector<std::array<Point, 3>> soup;
  for (const Triangle& t : bar(20, 1).triangles)
    soup.push_back({t.corners[0], t.corners[2], t.corners[1]});
  EXPECT_FALSE(angles_of(creased(soup), 0.2).are_forced(cell_at_edge(20, 0.2)));
}

TEST(ForcedAngles, AreThoseOfWallsWithRoomForOneLayer) {
  const auto across = [](double thickness, const Point& fourth) {
    const Creased plate = prism({{3, 3, 0}, {-3, 3, 0}, {-3, -3, 0}, {3, -3, 0}}, thickness);
    const std::array<Point, 4> cell{{{0, 0, 0}, {1, 0, 0}, {0.5, 0.8, 0}, fourth}};
    return angles_of(plate, 1).are_forced(cell);
  };
  const double most = 0.866 * std::tan(15 * kPi / 180);  // of the longest edge, nearly 1
  EXPECT_TRUE(across(0.9 * most, {0.5, 0.3, 0.9 * most}));
  EXPECT_FALSE(across(1.1 * most, {0.5, 0.3, 1.1 * most}));
  EXPECT_FALSE(across(0.9 * most, {0.5, 0.3, 0.4 * most}));  // not from side to side
}

}  // namespace
}  // namespace locvol
