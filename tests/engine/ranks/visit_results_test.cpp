// What visits find, as other ranks get it.
#include <gtest/gtest.h>

#include "engine/exchange/exchange.h"
#include "engine/exchange/pack.h"
#include "engine/run/mend_leaf.h"

namespace locvol {
namespace {

LeafDelta sample_delta() {
  LeafDelta delta;
  delta.inserted = {{{1, 2, 3}, PointKind::kSurface, false, std::nullopt},
                    {{-0.0, 5, 1e-300}, PointKind::kVolume, true, std::vector<Point>{{7, 8, 9}}},
                    {{4, 5, 6}, PointKind::kInserted, false, std::vector<Point>{}}};
  delta.deleted = {{17, {1, 1, 1}, PointKind::kLattice}};
  delta.moved = {{18, {2, 1, 1}, PointKind::kInserted},
                 {1ULL << 62, {2, 1, 0}, PointKind::kVolume}};
  delta.left = {{3, 3, 3}};
  delta.others_gone = {{{1, 2, 3, kNewPoint | 4}, {0.5, 0.25, 0.125}}};
  delta.others_made = {{{1, 2, 3, 5}, {0.5, 0.25, 0.125}}, {{2, 3, 4, 5}, {1, 2, 3}}};
  delta.cells = {{3, 5, 9, 17, kNewPoint}, {{0, 1, 2, 3}, {1, 2, 3, 4}}};
  delta.others_facets_gone = {{{{1, 3, kNewPoint | 4}, {2, 0, 7}}, {0.5, 0.25, 0.125}}};
  delta.others_facets_made = {{{{1, 5, 3}, {}}, {0.5, 0.25, 0.125}}};
  delta.facets = {{3, 5, 9, kNewPoint}, {{{0, 1, 2}, {}}, {{0, 3, 1}, {4, 5, 6}}}};
  delta.met_core = {100, 200};
  delta.unresolved = {{3, {1, 0, 0}, 0.5}};
  delta.poor = {{{0, 1, 0}, 14.5, {{1, 2, 3}, {4, 5, 6}}}};
  delta.stats.insertions = {1, 2, 3, 4, 5, 6, 7};
  delta.stats.cells_made = 99;
  delta.is_overfull = true;
  delta.sizes = {1, 0.5, 0.25};
  return delta;
}

TEST(VisitResults, ComeBack) {
  const LeafDelta delta = sample_delta();
  EXPECT_EQ(unpack<LeafDelta>(pack(delta)), delta);
  EXPECT_EQ(unpack<LeafDelta>(pack(LeafDelta())), LeafDelta());

  const CoverPoints cover{{{1, 2, 3}, {4, 5, 6}}, {{1, -2, 3}}, {false, {{{5, 6, 7}, 8}}}};
  const auto covered = unpack<CoverPoints>(pack(cover));
  EXPECT_EQ(covered.samples, cover.samples);
  EXPECT_EQ(covered.lattice, cover.lattice);
  EXPECT_EQ(covered.core, cover.core);

  const FillPoints fill{{{1, 2, 3}}, {4, 5}};
  const auto filled = unpack<FillPoints>(pack(fill));
  EXPECT_EQ(filled.centers, fill.centers);
  EXPECT_EQ(filled.met_core, fill.met_core);

  const MortonKey leaf = MortonKey::root().child(3).child(7);
  const auto mended = unpack<MendedCells>(pack(MendedCells{.left_out = {{leaf, {1, 5, 9}}},
                                                           .others = {33, 44},
                                                           .hanging = {55},
                                                           .facets = {{1, 2, 3}, {{{0, 1, 2}, {}}}},
                                                           .reach = 0.5}));
  ASSERT_EQ(mended.left_out.size(), 1U);
  EXPECT_EQ(mended.left_out[0].leaf, leaf);
  EXPECT_EQ(mended.left_out[0].places, (std::vector<std::uint32_t>{1, 5, 9}));
  EXPECT_EQ(mended.others, (std::vector<std::uint64_t>{33, 44}));
  EXPECT_EQ(mended.hanging, (std::vector<std::uint64_t>{55}));
  EXPECT_EQ(mended.facets, (LeafFacets{{1, 2, 3}, {{{0, 1, 2}, {}}}}));
  EXPECT_EQ(mended.reach, 0.5);

  const std::vector<SizedNode> nodes = {{leaf, 0.5F}, {leaf.child(1), 0.25F}};
  EXPECT_EQ(unpack<std::vector<SizedNode>>(pack(nodes)), nodes);
  const std::vector<SizeCube> cubes = {{leaf, {1, 2, 3, 4, 5, 6, 7, 8}, 0.5F, {0, 0, 1}}};
  EXPECT_EQ(unpack<std::vector<SizeCube>>(pack(cubes)), cubes);
}

TEST(VisitResults, ThatAreCutShortAreRefused) {
  const std::string bytes = pack(sample_delta());
  for (std::size_t size = 0; size < bytes.size(); size += 7)
    EXPECT_THROW(unpack<LeafDelta>(bytes.substr(0, size)), ExchangeError) << size;
}

}  // namespace
}  // namespace locvol
