#include "refine/fill_leaf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "refine/cover_leaf.h"
#include "refine/domain/surface_part.h"
#include "refine/size_leaf.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using namespace shapes;

// First points of one leaf that has all of a surface, with sizes that grow away from it.
class GradedFill : public testing::TestWithParam<Mesh> {
 protected:
  GradedFill() {
    FarSurface far(frame_);
    far.add(MortonKey::root(), part_in(box_, {mesh_}));
    far.finish();
    const double distance = kExactDistance * kSize;
    sizes_.cubes = size_leaf({.law = sizes_.law,
                              .exact_distance = distance,
                              .frame = frame_,
                              .leaf = MortonKey::root(),
                              .domain = whole_piece(box_.expanded(distance), mesh_)},
                             far);
    const Lattice lattice = Lattice::of_cubes(frame_);
    const CoverPoints cover = cover_leaf({.size = kSize,
                                          .seed = 1,
                                          .lattice = lattice,
                                          .box = box_,
                                          .domain = domain(),
                                          .nearby_samples = {},
                                          .sizes = sizes_});
    FillInput input{.size = kSize, .box = box_, .points = {}, .core = {}, .domain = domain()};
    input.sizes = sizes_;
    for (const LatticeSite& site : cover.lattice)
      input.points.push_back({site_id(site), lattice.position(site), PointKind::kLattice});
    for (const Point& p : cover.samples)
      input.points.push_back({kFirstOtherId + input.points.size(), p, PointKind::kSurface});
    for (const MeshPoint& p : input.points) points_.push_back(p.position);
    num_first_ = points_.size();
    const FillPoints found = fill_leaf(std::move(input));
    points_.insert(points_.end(), found.centers.begin(), found.centers.end());
  }
  DomainPiece domain() const { return whole_piece(box_.expanded(kCoreDepth * kSize), mesh_); }
  double nearest(const Point& p, std::size_t num_points) const {
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < num_points; ++n)
      least = std::min(least, squared_distance(p, points_[n]));
    return std::sqrt(least);
  }

  static constexpr double kSize = 0.13;
  const Mesh mesh_ = GetParam();
  const Frame frame_ = Frame::around(bounding_box(mesh_), kSize, 3);
  const Box box_ = frame_.root_box();
  SizeCubes sizes_{{.surface = kSize, .growth = 0.2}, frame_, {}};
  std::vector<Point> points_;  // the first, and those that fill holes
  std::size_t num_first_ = 0;
};

TEST_P(GradedFill, CentersAreInsideAndAsFarFromAllPointsAsTheSizeThere) {
  const SizeField field(sizes_);
  ASSERT_GT(points_.size(), num_first_ + 100);
  for (std::size_t n = num_first_; n < points_.size(); ++n) {
    EXPECT_TRUE(brute_force::is_inside(points_[n], mesh_));
    EXPECT_GE(brute_force::distance(points_[n], mesh_), kLeastLatticeDepth * kSize * (1 - 1e-12));
    EXPECT_GE(nearest(points_[n], n), field.at(points_[n]) * (1 - 1e-12));
  }
}

// Where a place is farther than h from all points, C5 has to put one.
TEST_P(GradedFill, FewHolesAreLeft) {
  const auto seed = std::random_device()();
  Random random(seed);
  const SizeField field(sizes_);
  int num_before = 0, num_after = 0;
  for (int n = 0; n < 10000; ++n) {
    const Point p = uniform_in(random, bounding_box(mesh_));
    if (!brute_force::is_inside(p, mesh_) || brute_force::distance(p, mesh_) < kSize) continue;
    num_before += nearest(p, num_first_) > field.at(p);
    num_after += nearest(p, points_.size()) > field.at(p);
  }
  EXPECT_GT(num_before, 500) << "seed " << seed;
  EXPECT_LE(num_after, num_before / 100) << "seed " << seed;
}

INSTANTIATE_TEST_SUITE_P(Shapes, GradedFill,
                         testing::Values(icosphere({0, 0, 0}, 1, 3), torus(1, 0.6, 40, 24)));

}  // namespace
}  // namespace locvol
