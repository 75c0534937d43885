#include "refine/domain/fragment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "refine/cover_leaf.h"
#include "tests/refine/lattice_points.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

double squared_distance_to(const std::vector<Point>& points, const Point& q) {
  double least = std::numeric_limits<double>::infinity();
  for (const Point& p : points) least = std::min(least, squared_distance(p, q));
  return least;
}

// One sample of a torus moves, by little or much. Where it is said that all stay covered and
// hidden, no point of the surface around tells otherwise; and where not, it is not by much.
TEST(IsCoveredWithout, AgreesWithPointsOfTheSurface) {
  constexpr double kSize = 0.25, kRadius = kSampleRadius * kSize;
  const shapes::Mesh torus = shapes::torus(1, 0.4, 48, 20);
  const Box region = shapes::bounding_box(torus).expanded(4 * kSize);
  const DomainPiece piece{torus, region, region.min, {}};
  const Lattice lattice = lattice_around(region, kSize);
  const CoverPoints cover = cover_leaf({kSize, 1, lattice, region, piece, {}});
  const LeafDomain domain(piece);
  std::vector<Point> hidden;
  for (const LatticeSite& site : lattice_sites(cover, lattice.sites_in(region)))
    hidden.push_back(lattice.position(site));
  ASSERT_GT(hidden.size(), 20u);
  constexpr unsigned kSeed = 23;
  shapes::Random random(kSeed);
  const std::vector<Point> on_surface = shapes::random_points_on(torus, 200'000, random);
  std::size_t num_covered = 0, num_bare = 0, num_refused = 0;
  for (std::size_t n = 0; n < cover.samples.size(); ++n) {
    std::vector<Point> samples = cover.samples;
    const Point before = samples[n];
    const double step = (n % 4 == 0 ? 0.1 : n % 4 == 1 ? 0.4 : n % 4 == 2 ? 0.7 : 3) * kSize;
    const Point away = shapes::uniform_in(random, {{-1, -1, -1}, {1, 1, 1}});
    samples[n] = domain.closest_to(before + (step / norm(away)) * away, 4).value().position;
    const bool is_covered = is_covered_without(domain, before, {kRadius, kRadius}, samples, hidden);
    bool is_bare = false;
    for (const Point& p : on_surface) {
      if (squared_distance(p, before) > kRadius * kRadius) continue;
      const double nearest = squared_distance_to(samples, p);
      is_bare |= nearest > kRadius * kRadius || nearest >= squared_distance_to(hidden, p);
    }
    EXPECT_FALSE(is_covered && is_bare) << "seed " << kSeed << ", sample " << n;
    num_covered += is_covered;
    num_bare += is_bare;
    num_refused += !is_covered && !is_bare;
  }
  EXPECT_GT(num_covered, 50u);
  EXPECT_GT(num_bare, 50u);
  EXPECT_LT(num_refused, 0.15 * double(cover.samples.size()));
}

}  // namespace
}  // namespace locvol
