// A visit that is asked to stop ends at that question, wherever it stands, and can be made again.
#include "octree/stop.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "refine/cover_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/refine_leaf.h"
#include "tests/refine/lattice_points.h"
#include "tests/refine/shapes.h"
#include "tests/stops_at.h"

namespace locvol {
namespace {

// One leaf, with the first points of cover mode but for those on one side, so that there is work
// for each kind of visit.
class StopTest : public testing::Test {
 protected:
  LeafDomain leaf_domain(const StopToken* stop = nullptr) const {
    return LeafDomain(domain(), stop);
  }
  DomainPiece domain() const { return {mesh_, region_, region_.min, {}}; }
  CoverInput cover() const {
    return {.size = kSize,
            .seed = 7,
            .lattice = lattice_,
            .box = region_,
            .domain = domain(),
            .nearby_samples = {}};
  }
  FillInput fill() const {
    return {.size = kSize, .box = region_, .points = points_, .core = {}, .domain = domain()};
  }
  LeafInput refinement() const {
    LeafInput input;
    input.criteria = Criteria::of_paper(kSize, 2, 1e-3);
    input.box = region_;
    input.own = points_;
    input.domain = domain();
    return input;
  }

  // Makes the visit once for each question that it asks, and stops it there. Then it must come out
  // as ever.
  template <class Visit, class IsSame>
  void expect_stops_anywhere(const Visit& visit, const IsSame& is_same) {
    const StopsAt never(StopsAt::kNever);
    const auto expected = visit(&never);
    ASSERT_GT(never.num_asked(), 2U);
    const std::uint64_t step = 1 + never.num_asked() / 50;
    for (std::uint64_t question = 1; question <= never.num_asked(); question += step) {
      const StopsAt stop(question);
      EXPECT_THROW(visit(&stop), Stopped) << "at question " << question;
      EXPECT_EQ(stop.num_asked(), question) << "it went on";
    }
    EXPECT_TRUE(is_same(visit(nullptr), expected));
  }

  static constexpr double kSize = 0.06;
  shapes::Mesh mesh_ = shapes::torus(1, 0.4, 60, 30);
  Box region_ = shapes::bounding_box(mesh_).expanded(0.31);
  Lattice lattice_ = lattice_around(region_, kSize);
  std::vector<MeshPoint> points_ = first_points();

 private:
  std::vector<MeshPoint> first_points() const {
    const CoverPoints found = cover_leaf(cover());
    std::vector<MeshPoint> points;
    for (const Point& p : found.samples) points.push_back({0, p, PointKind::kSurface});
    for (const Point& p : positions(lattice_, lattice_sites(found, lattice_.sites_in(region_))))
      if (p.x < 0.9) points.push_back({0, p, PointKind::kLattice});
    for (std::size_t i = 0; i < points.size(); ++i) points[i].id = kFirstOtherId + i;
    return points;
  }
};

TEST_F(StopTest, EndsTheBuildingOfAPatch) {
  expect_stops_anywhere([&](const StopToken* stop) { return leaf_domain(stop); },
                        [](const LeafDomain& a, const LeafDomain& b) {
                          return a.triangles().size() == b.triangles().size();
                        });
}

TEST_F(StopTest, EndsTheCoverOfALeaf) {
  expect_stops_anywhere([&](const StopToken* stop) { return cover_leaf(cover(), stop); },
                        [](const CoverPoints& a, const CoverPoints& b) {
                          return a.samples == b.samples && a.lattice == b.lattice;
                        });
}

TEST_F(StopTest, EndsTheSearchForHoles) {
  expect_stops_anywhere(
      [&](const StopToken* stop) { return fill_leaf(fill(), stop); },
      [](const FillPoints& a, const FillPoints& b) { return a.centers == b.centers; });
}

TEST_F(StopTest, EndsTheRefinementOfALeaf) {
  std::uint64_t num_steps = 0;
  expect_stops_anywhere(
      [&](const StopToken* stop) {
        const auto count = [&](const RefineStep&) { ++num_steps; };
        return refine_leaf(refinement(), {.on_step = count, .stop = stop});
      },
      std::equal_to());
  EXPECT_GT(num_steps, 1000U) << "it was to stop among insertions, too";
}

// A visit of the part of a leaf that has changed, and what that is not enough for.
TEST_F(StopTest, EndsAVisitInPart) {
  const LeafDelta first = refine_leaf(refinement());
  LeafInput again = refinement();
  again.last_visit = LastVisit{kFirstOtherId + points_.size(), {}};
  for (std::size_t i = 0; i < first.inserted.size(); ++i)
    if (!first.inserted[i].is_deleted)
      again.own.push_back(
          {kFirstOtherId + points_.size() + i, first.inserted[i].position, first.inserted[i].kind});
  again.last_visit->first_new_id = again.own.back().id;
  expect_stops_anywhere([&](const StopToken* stop) { return refine_leaf(again, {.stop = stop}); },
                        std::equal_to());
}

}  // namespace
}  // namespace locvol
