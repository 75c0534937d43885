// Domains of several bodies: shells in shells and beside each other, each between two bodies.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "octree/mix.h"
#include "refine/domain/leaf_domain.h"
#include "refine/domain/surface_part.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Mesh;
using shapes::Random;

constexpr std::uint64_t kSeedOfBodies = 20261128;

struct Shell {
  Mesh mesh;
  BodyId inside = kNoBody, outside = kNoBody;
};

// What lies in more comes later.
BodyId body_of(const Point& p, const std::vector<Shell>& shells) {
  BodyId body = kNoBody;
  for (const Shell& shell : shells)
    if (brute_force::is_inside(p, shell.mesh)) body = shell.inside;
  return body;
}

// Every other triangle faces inwards: nobody relies on how they turn.
Mesh surface_of(const std::vector<Shell>& shells) {
  Mesh all;
  for (const Shell& shell : shells)
    for (Triangle t : shell.mesh) {
      t.id = all.size();
      t.change = DomainState::between(shell.inside, shell.outside);
      if (mix(t.id) % 2 == 0) std::swap(t.corners[0], t.corners[1]);
      all.push_back(t);
    }
  return all;
}

// 3 in 7 in the largest, a cavity in that, 5 in the cavity, and 2 beside.
std::vector<Shell> shells() {
  constexpr BodyId kLargest = DomainState::kMostBody;
  return {{shapes::icosphere({0, 0, 0}, 1, 2), kLargest, kNoBody},
          {shapes::icosphere({0.3, 0, 0}, 0.5, 2), 7, kLargest},
          {shapes::box({{0.1, -0.2, -0.2}, {0.5, 0.2, 0.2}}), 3, 7},
          {shapes::icosphere({-0.5, 0, 0}, 0.25, 1), kNoBody, kLargest},
          {shapes::box({{-0.6, -0.1, -0.1}, {-0.4, 0.1, 0.1}}), 5, kNoBody},
          {shapes::icosphere({2, 0, 0}, 0.6, 2), 2, kNoBody}};
}

class SeveralBodies : public testing::Test {
 protected:
  const std::vector<Shell> shells_ = shells();
  const Mesh surface_ = surface_of(shells_);
  const Box region_{{-1.3, -1.3, -1.3}, {2.8, 1.3, 1.3}};
};

TEST_F(SeveralBodies, LabelsAreThoseOfTheShellsAround) {
  const LeafDomain domain({.triangles = surface_,
                           .region = region_,
                           .reference = region_.min,
                           .reference_state = {},
                           .is_whole = true});
  EXPECT_EQ(domain.only_body(), std::nullopt);
  Random random(kSeedOfBodies);
  for (int n = 0; n < 3000; ++n) {
    const Point p = shapes::uniform_in(random, region_);
    EXPECT_EQ(domain.label(p), body_of(p, shells_)) << "seed " << kSeedOfBodies << ", n " << n;
  }
}

TEST_F(SeveralBodies, WaysLeadFromBodyToBody) {
  const LeafDomain domain({.triangles = surface_,
                           .region = region_,
                           .reference = region_.center(),
                           .reference_state = DomainState::in(body_of(region_.center(), shells_))});
  Random random(kSeedOfBodies);
  std::vector<Crossing> found;
  for (int n = 0; n < 2000; ++n) {
    const Point a = shapes::uniform_in(random, region_), b = shapes::uniform_in(random, region_);
    domain.crossings(a, b, found);
    BodyId last = body_of(a, shells_);
    const DomainState end =
        follow(*domain.state(a), found, [&](const Crossing&, BodyId before, BodyId after) {
          EXPECT_EQ(before, last) << "seed " << kSeedOfBodies << ", n " << n;
          EXPECT_NE(before, after) << "each shell parts two bodies";
          last = after;
        });
    EXPECT_EQ(end.body(), body_of(b, shells_)) << "seed " << kSeedOfBodies << ", n " << n;
    EXPECT_EQ(last, end.body());
  }
}

TEST_F(SeveralBodies, PiecesAgreeWithTheWhole) {
  Random random(kSeedOfBodies);
  for (int n = 0; n < 40; ++n) {
    const Point low = shapes::uniform_in(random, region_);
    const Box part{low, low + Point{0.3, 0.4, 0.5}};
    DomainPiece piece{.triangles = {},
                      .region = part,
                      .reference = part.center(),
                      .reference_state = DomainState::in(body_of(part.center(), shells_))};
    piece.add({surface_});
    const LeafDomain domain(piece);
    for (int i = 0; i < 20; ++i) {
      const Point p = shapes::uniform_in(random, part);
      const BodyId expected = body_of(p, shells_);
      EXPECT_EQ(domain.label(p), expected) << "seed " << kSeedOfBodies << ", n " << n;
      if (domain.only_body() && expected != kNoBody) {
        EXPECT_EQ(domain.only_body(), expected) << "seed " << kSeedOfBodies << ", n " << n;
      }
    }
    const CornerStates corners = center_to_corners(part, {surface_});
    for (int k = 0; k < 8; ++k) {
      const Point corner{(k & 1 ? part.max : part.min).x, (k & 2 ? part.max : part.min).y,
                         (k & 4 ? part.max : part.min).z};
      EXPECT_EQ(piece.reference_state.crossed(corners[k]).body(), body_of(corner, shells_))
          << "seed " << kSeedOfBodies << ", n " << n;
    }
  }
}

TEST(DomainStates, AddUpInAnyOrder) {
  Random random(kSeedOfBodies);
  for (int n = 0; n < 1000; ++n) {
    const auto body = [&] { return static_cast<BodyId>(random() % (DomainState::kMostBody + 1)); };
    const BodyId a = body(), b = body(), c = body();
    const DomainState ab = DomainState::between(a, b), bc = DomainState::between(b, c);
    EXPECT_EQ(DomainState::in(a).crossed(ab).crossed(bc), DomainState::in(c));
    EXPECT_EQ(DomainState::in(a).crossed(bc).crossed(ab), DomainState::in(c));
    EXPECT_EQ(DomainState::in(c).crossed(bc).body(), b) << "from both sides alike";
    EXPECT_EQ(DomainState::between(a, b), DomainState::between(b, a));
  }
}

// Not so with the numbers of the bodies alone: 3 and 0 would be as 1 and 2.
TEST(DomainStates, TellWhichBodiesAChangeParts) {
  constexpr BodyId kNum = 2000;
  std::vector<std::uint32_t> changes;
  for (BodyId a = 0; a < kNum; ++a)
    for (BodyId b = 0; b < a; ++b) {
      const DomainState change = DomainState::between(a, b);
      changes.push_back(DomainState::member(change));
    }
  for (BodyId a = DomainState::kMostBody; a > DomainState::kMostBody - kNum; --a)
    for (BodyId b = 0; b < 300; ++b) {
      const DomainState change = DomainState::between(a, b);
      changes.push_back(DomainState::member(change));
    }
  std::ranges::sort(changes);
  EXPECT_EQ(std::ranges::adjacent_find(changes), changes.end());
  EXPECT_NE(changes.front(), 0u);
}

// One body is a parity, and nothing that has it takes more bytes than that.
TEST(DomainStates, OfOneBodyIsOneBit) {
  const DomainState in = DomainState::in(kOnlyBody), change = DomainState::between(0, kOnlyBody);
  EXPECT_EQ(DomainState::member(in), 1u);
  EXPECT_EQ(DomainState::member(change), 1u);
  EXPECT_EQ(in.crossed(change), DomainState());
}

}  // namespace
}  // namespace locvol
