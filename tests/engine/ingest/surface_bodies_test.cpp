// Bodies that lie in each other, touch and overlap, against labels of voxels.
#include "engine/ingest/surface_bodies.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/surface_source.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol::voxel_bodies {
namespace {

constexpr int kSide = 4;  // of a cube of voxels
using Voxel = std::array<int, 3>;

// A box of voxels.
struct Block {
  Voxel low{}, high{};
  bool contains(const Voxel& v) const {
    for (std::size_t k = 0; k < 3; ++k)
      if (v[k] < low[k] || v[k] >= high[k]) return false;
    return true;
  }
  bool contains(const Block& other) const {
    for (std::size_t k = 0; k < 3; ++k)
      if (other.low[k] < low[k] || other.high[k] > high[k]) return false;
    return true;
  }
  friend auto operator<=>(const Block&, const Block&) = default;
};

// The unit square of the grid at `low` across an axis, in two triangles: the same for all.
std::array<std::array<Point, 3>, 2> square(Voxel low, std::size_t axis) {
  const auto at = [&](int u, int v) {
    Voxel p = low;
    p[(axis + 1) % 3] += u;
    p[(axis + 2) % 3] += v;
    return Point{double(p[0]), double(p[1]), double(p[2])};
  };
  return {{{at(0, 0), at(1, 0), at(1, 1)}, {at(0, 0), at(1, 1), at(0, 1)}}};
}

// visit(square's place, axis, voxel below, voxel above) for each of the grid.
template <class Visit>
void for_each_square(const Visit& visit) {
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (int i = 0; i <= kSide; ++i)
      for (int j = 0; j <= kSide; ++j)
        for (int k = 0; k <= kSide; ++k) {
          const Voxel above = {i, j, k};
          Voxel below = above;
          --below[axis];
          visit(above, axis, below, above);
        }
}

std::string off(const Block& block) {
  std::string corners, triangles;
  int num = 0;
  for_each_square(
      [&](const Voxel& place, std::size_t axis, const Voxel& below, const Voxel& above) {
        if (block.contains(below) == block.contains(above)) return;
        for (const auto& triangle : square(place, axis)) {
          for (const Point& p : triangle) corners += fmt::format("{} {} {}\n", p.x, p.y, p.z);
          triangles += fmt::format("3 {} {} {}\n", 3 * num, 3 * num + 1, 3 * num + 2);
          ++num;
        }
      });
  return fmt::format("OFF\n{} {} 0\n", 3 * num, num) + corners + triangles;
}

// Of a voxel: the block that it is of, from 1 on. The innermost; of those that overlap, the first.
BodyId label_of(const Voxel& voxel, const std::vector<Block>& blocks) {
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (!blocks[b].contains(voxel)) continue;
    const bool is_innermost = std::ranges::none_of(blocks, [&](const Block& other) {
      return other != blocks[b] && other.contains(voxel) && blocks[b].contains(other);
    });
    if (is_innermost) return static_cast<BodyId>(b + 1);
  }
  return kNoBody;
}

using Corners = std::array<Point, 3>;  // ascending
Corners sorted(Corners corners) {
  std::ranges::sort(corners);
  return corners;
}

struct Numbered {
  std::vector<BodyFacts> bodies;
  SurfaceFacts facts;
  std::map<Corners, std::pair<DomainState, std::array<BodyId, 2>>> triangles;
};

class SurfaceBodies : public testing::Test {
 protected:
  Numbered numbered(const std::vector<std::filesystem::path>& inputs, std::uint64_t capacity) {
    IngestWatch watch;
    Workers workers(2);
    const SurfaceSource source =
        surface_at(inputs.front(), {inputs.begin() + 1, inputs.end()}, files_.directory());
    RawSurface raw = read_surface(source, files_.directory(), watch);
    raw.has_several_bodies = true;
    const Frame frame = frame_of(raw.box);
    CheckedSurface surface = check_surface(std::move(raw), frame, watch, workers, capacity);
    Numbered result;
    result.bodies = number_bodies(surface, body_law(false, {}, inputs.size() - 1), watch, workers);
    result.facts = surface.facts;
    for (const TriangleBucket& bucket : surface.buckets.all())
      for (const Triangle& t : surface.load(bucket))
        result.triangles[sorted(t.corners)] = {t.change, surface.bodies_of_group[t.sheet - 1]};
    return result;
  }

  SurfaceFiles files_;
};

TEST_F(SurfaceBodies, AreThoseOfVoxels) {
  constexpr unsigned kSeed = 41;
  std::mt19937_64 random(kSeed);
  SCOPED_TRACE(fmt::format("seed {}", kSeed));
  const auto pick = [&](int below) { return static_cast<int>(random() % std::uint64_t(below)); };
  int num_meshed = 0, num_touching = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::vector<Block> blocks;
    const auto num = static_cast<std::size_t>(2 + pick(5));
    while (blocks.size() < num) {
      Block block;
      for (std::size_t k = 0; k < 3; ++k) {
        block.low[k] = pick(kSide);
        block.high[k] = block.low[k] + 1 + pick(kSide - block.low[k]);
      }
      if (std::ranges::find(blocks, block) == blocks.end()) blocks.push_back(block);
    }
    std::map<BodyId, int> volumes;
    std::map<Corners, std::array<BodyId, 2>> expected;
    std::set<Point> vertices;
    std::set<std::array<Point, 2>> edges;
    for_each_square(
        [&](const Voxel& place, std::size_t axis, const Voxel& below, const Voxel& above) {
          const BodyId one = label_of(below, blocks), other = label_of(above, blocks);
          if (axis == 0) ++volumes[other];
          if (one == other) return;
          for (const Corners& corners : square(place, axis)) {
            const auto [a, b, c] = sorted(corners);
            expected[{a, b, c}] = {std::max(one, other), std::min(one, other)};
            vertices.insert({a, b, c});
            edges.insert({{a, b}, {a, c}, {b, c}});
          }
        });
    std::vector<std::filesystem::path> inputs;
    for (std::size_t b = 0; b < blocks.size(); ++b)
      inputs.push_back(files_.write(fmt::format("block{}_{}.off", trial, b), off(blocks[b])));
    // What other bodies take all of is refused.
    const bool is_refused = [&] {
      for (BodyId b = 1; b <= blocks.size(); ++b)
        if (!volumes.contains(b)) return true;
      return false;
    }();
    if (is_refused) {
      EXPECT_THROW(numbered(inputs, 50'000), InputError);
      continue;
    }
    ++num_meshed;
    for (const std::uint64_t capacity : {std::uint64_t{50'000}, std::uint64_t{24}}) {
      SCOPED_TRACE(fmt::format("trial {}, capacity {}", trial, capacity));
      const Numbered found = numbered(inputs, capacity);
      ASSERT_EQ(found.bodies.size(), blocks.size());
      for (BodyId b = 1; b <= blocks.size(); ++b)
        EXPECT_NEAR(found.bodies[b - 1].volume, volumes[b], 1e-12);
      ASSERT_EQ(found.triangles.size(), expected.size());
      for (const auto& [corners, sides] : expected) {
        const auto triangle = found.triangles.find(corners);
        ASSERT_NE(triangle, found.triangles.end());
        EXPECT_EQ(triangle->second.first, DomainState::between(sides[0], sides[1]));
        EXPECT_EQ(triangle->second.second, sides);
      }
      EXPECT_EQ(found.facts.num_triangles, expected.size());
      EXPECT_EQ(found.facts.num_vertices, vertices.size());
      EXPECT_EQ(found.facts.euler_characteristic, std::int64_t(vertices.size()) -
                                                      std::int64_t(edges.size()) +
                                                      std::int64_t(expected.size()));
      EXPECT_EQ(found.facts.area, 0.5 * double(expected.size()));
    }
    num_touching += 2 * edges.size() != 3 * expected.size();
  }
  EXPECT_GT(num_meshed, 20);
  EXPECT_GT(num_touching, 15);
}

}  // namespace
}  // namespace locvol::voxel_bodies
