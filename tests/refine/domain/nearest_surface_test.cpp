#include "refine/domain/nearest_surface.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using namespace shapes;

// Far from the origin, where planes are rounded more.
TEST(NearestSurface, IsAsFarAsTheNearestTriangle) {
  const auto seed = std::random_device()();
  Random random(seed);
  for (const Point& origin : {Point{0, 0, 0}, Point{100, -300, 50}}) {
    Mesh mesh = torus(1, 0.4, 30, 15);
    for (Triangle& t : mesh)
      for (Point& p : t.corners) p = p + origin;
    const Box around = bounding_box(mesh).expanded(1);
    const LeafDomain domain(whole_piece(around, mesh));
    const NearestSurface surface(domain);
    NearestSurface::Known known;
    for (int n = 0; n < 500; ++n) {
      const Point p = uniform_in(random, around);
      const double expected = brute_force::distance(p, mesh);
      EXPECT_NEAR(surface.distance(p, known), expected, 1e-9) << "seed " << seed;
      NearestSurface::Known bounded{known.triangle, 1.5 * expected};
      EXPECT_NEAR(surface.distance(p, bounded), expected, 1e-9) << "seed " << seed;
    }
  }
}

// A triangle without area has no plane.
TEST(NearestSurface, SeesFlatTriangles) {
  DomainPiece piece{
      .triangles = {}, .region = {{-1, -1, -1}, {2, 2, 2}}, .reference = {-1, -1, -1}};
  piece.triangles.push_back({0, {{{0, 0, 0}, {0.5, 0, 0}, {1, 0, 0}}}});
  piece.triangles.push_back({1, {{{0, 2, 0}, {0, 2, 0}, {0, 2, 0}}}});
  const LeafDomain domain(piece);
  const NearestSurface surface(domain);
  NearestSurface::Known known;
  EXPECT_DOUBLE_EQ(surface.distance({0.25, 0.5, 0}, known), 0.5);
  EXPECT_DOUBLE_EQ(surface.distance({0, 1.75, 0}, known), 0.25);
}

}  // namespace
}  // namespace locvol
