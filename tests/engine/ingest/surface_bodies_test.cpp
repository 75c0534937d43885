// Bodies that lie in each other, touch and overlap, against labels of voxels.
#include "engine/ingest/surface_bodies.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
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

// Different ones. `pick`: a number below another, at random.
std::vector<Block> random_blocks(std::size_t num, const std::function<int(int)>& pick) {
  std::vector<Block> blocks;
  while (blocks.size() < num) {
    Block block;
    for (std::size_t k = 0; k < 3; ++k) {
      block.low[k] = pick(kSide);
      block.high[k] = block.low[k] + 1 + pick(kSide - block.low[k]);
    }
    if (std::ranges::find(blocks, block) == blocks.end()) blocks.push_back(block);
  }
  return blocks;
}

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

// The block as a box of two triangles a face, whatever lies beside it; with its corners moved.
std::string plain_off(const Block& block, const std::function<Point(const Point&)>& moved) {
  std::string text = "OFF\n8 12 0\n";
  for (int k = 0; k < 8; ++k) {
    const auto at = [&](std::size_t axis) {
      return double((k >> axis & 1 ? block.high : block.low)[axis]);
    };
    const Point p = moved({at(0), at(1), at(2)});
    text += fmt::format("{} {} {}\n", p.x, p.y, p.z);
  }
  for (const char* triangle : {"0 2 3", "0 3 1", "4 5 7", "4 7 6", "0 1 5", "0 5 4", "2 6 7",
                               "2 7 3", "0 4 6", "0 6 2", "1 3 7", "1 7 5"})
    text += fmt::format("3 {}\n", triangle);
  return text;
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
    result.bodies =
        number_bodies(surface, body_law(inputs.size() == 1, {}, inputs.size() - 1), watch, workers);
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
    const std::vector<Block> blocks = random_blocks(static_cast<std::size_t>(2 + pick(5)), pick);
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

// One file without names, each face between two regions once, turned at random.
TEST_F(SurfaceBodies, AreTheRegionsWhereFacesStandOnce) {
  constexpr unsigned kSeed = 43;
  std::mt19937_64 random(kSeed);
  SCOPED_TRACE(fmt::format("seed {}", kSeed));
  const auto pick = [&](int below) { return static_cast<int>(random() % std::uint64_t(below)); };
  int num_meshed = 0, num_shared = 0;
  for (int trial = 0; trial < 80; ++trial) {
    const std::vector<Block> blocks = random_blocks(static_cast<std::size_t>(2 + pick(3)), pick);
    // What hangs together by faces is a region, and 0 what goes on outside.
    std::map<Voxel, int> region_of;
    std::vector<double> volumes;
    const auto flood = [&](const Voxel& first, int region) {
      std::vector<Voxel> open = {first};
      double volume = 0;
      while (!open.empty()) {
        const Voxel v = open.back();
        open.pop_back();
        if (std::ranges::any_of(v, [](int c) { return c < -1 || c > kSide; }) ||
            label_of(v, blocks) != label_of(first, blocks) ||
            !region_of.try_emplace(v, region).second)
          continue;
        ++volume;
        for (std::size_t axis = 0; axis < 3; ++axis)
          for (const int step : {-1, 1}) {
            open.push_back(v);
            open.back()[axis] += step;
          }
      }
      return volume;
    };
    flood({-1, -1, -1}, 0);
    for (int n = 0; n < kSide * kSide * kSide; ++n) {
      const Voxel v = {n % kSide, n / kSide % kSide, n / (kSide * kSide)};
      if (!region_of.contains(v)) volumes.push_back(flood(v, static_cast<int>(volumes.size()) + 1));
    }
    std::map<Corners, std::array<int, 2>> expected;
    std::string corners, triangles;
    for_each_square(
        [&](const Voxel& place, std::size_t axis, const Voxel& below, const Voxel& above) {
          if (region_of[below] == region_of[above]) return;
          for (auto triangle : square(place, axis)) {
            if (pick(2) == 0) std::swap(triangle[0], triangle[1]);
            const std::size_t first = 3 * expected.size();
            expected[sorted(triangle)] = {region_of[below], region_of[above]};
            for (const Point& p : triangle) corners += fmt::format("{} {} {}\n", p.x, p.y, p.z);
            triangles += fmt::format("3 {} {} {}\n", first, first + 1, first + 2);
          }
        });
    const auto file = files_.write(
        fmt::format("regions{}.off", trial),
        fmt::format("OFF\n{} {} 0\n", 3 * expected.size(), expected.size()) + corners + triangles);
    for (const std::uint64_t capacity : {std::uint64_t{50'000}, std::uint64_t{24}}) {
      SCOPED_TRACE(fmt::format("trial {}, capacity {}", trial, capacity));
      Numbered found;
      try {
        found = numbered({file}, capacity);
      } catch (const InputError& e) {  // of one that touches itself in an edge or a vertex
        EXPECT_NE(std::string(e.what()).find("manifold"), std::string::npos) << e.what();
        break;
      }
      ++num_meshed;
      std::vector<double> found_volumes, all = volumes;
      for (const BodyFacts& body : found.bodies) found_volumes.push_back(body.volume);
      std::ranges::sort(found_volumes);
      std::ranges::sort(all);
      ASSERT_EQ(found_volumes.size(), all.size());
      for (std::size_t b = 0; b < all.size(); ++b) EXPECT_NEAR(found_volumes[b], all[b], 1e-12);
      ASSERT_EQ(found.triangles.size(), expected.size());
      std::map<int, std::set<BodyId>> bodies;  // that all faces of a region have
      for (const auto& [place, regions] : expected) {
        const auto [change, sides] = found.triangles.at(place);
        EXPECT_EQ(change, DomainState::between(sides[0], sides[1]));
        const std::set<BodyId> both = {sides[0], sides[1]};
        ASSERT_EQ(both.size(), 2U);
        for (const int region : regions) {
          std::set<BodyId>& its = bodies.try_emplace(region, both).first->second;
          std::erase_if(its, [&](BodyId body) { return !both.contains(body); });
        }
        num_shared += regions[0] > 0 && regions[1] > 0;
      }
      EXPECT_TRUE(bodies[0].contains(kNoBody));
      for (const auto& [region, its] : bodies) EXPECT_FALSE(its.empty()) << region;
    }
  }
  EXPECT_GT(num_meshed, 60);
  EXPECT_GT(num_shared, 500);
}

// Faces that lie in each other, cross and have other triangulations; with coordinates as they come,
// of thirds that are rounded in several ways, and turned, so that no two faces are of one plane.
TEST_F(SurfaceBodies, AreCutAlongEachOther) {
  constexpr unsigned kSeed = 43;
  std::mt19937_64 random(kSeed);
  SCOPED_TRACE(fmt::format("seed {}", kSeed));
  const auto pick = [&](int below) { return static_cast<int>(random() % std::uint64_t(below)); };
  // A turn about (1, 2, 2) / 3 by an angle of 1.
  const auto turned = [](const Point& p) {
    const Point axis{1.0 / 3, 2.0 / 3, 2.0 / 3};
    return std::cos(1.0) * p + std::sin(1.0) * cross(axis, p) +
           ((1 - std::cos(1.0)) * dot(axis, p)) * axis;
  };
  int num_cut = 0;
  for (int trial = 0; trial < 24; ++trial) {
    const std::vector<Block> blocks = random_blocks(static_cast<std::size_t>(2 + pick(4)), pick);
    std::map<BodyId, int> volumes;
    for_each_square([&](const Voxel&, std::size_t axis, const Voxel&, const Voxel& above) {
      if (axis == 0) ++volumes[label_of(above, blocks)];
    });
    const bool is_refused = [&] {
      for (BodyId b = 1; b <= blocks.size(); ++b)
        if (!volumes.contains(b)) return true;
      return false;
    }();
    for (int way = 0; way < 3; ++way) {
      SCOPED_TRACE(fmt::format("trial {}, way {}", trial, way));
      const double scale = way == 0 ? 1 : 1.0 / 3;
      std::vector<std::filesystem::path> inputs;
      for (std::size_t b = 0; b < blocks.size(); ++b) {
        // Each from a corner of its own: sums of thirds.
        const Point low{blocks[b].low[0] / 3.0, blocks[b].low[1] / 3.0, blocks[b].low[2] / 3.0};
        const auto moved = [&](const Point& p) {
          if (way == 0) return p;
          const Point third =
              low + Point{(p.x - blocks[b].low[0]) / 3, (p.y - blocks[b].low[1]) / 3,
                          (p.z - blocks[b].low[2]) / 3};
          return way == 1 ? third : turned(third);
        };
        inputs.push_back(files_.write(fmt::format("block{}_{}_{}.off", trial, way, b),
                                      plain_off(blocks[b], moved)));
      }
      if (is_refused) {
        EXPECT_THROW(numbered(inputs, 50'000), InputError);
        continue;
      }
      const Numbered found = numbered(inputs, 50'000);
      ASSERT_EQ(found.bodies.size(), blocks.size());
      for (BodyId b = 1; b <= blocks.size(); ++b)
        EXPECT_NEAR(found.bodies[b - 1].volume, volumes[b] * scale * scale * scale, 1e-10);
      num_cut += std::ranges::any_of(found.facts.notes, [](const std::string& note) {
        return note.find("cross, or lie on each other: cut") != note.npos;
      });
      // However the surface is cut into cells.
      const Numbered of_small_cells = numbered(inputs, 24);
      EXPECT_EQ(found.triangles, of_small_cells.triangles);
      EXPECT_EQ(found.facts.notes, of_small_cells.facts.notes);
    }
  }
  EXPECT_GT(num_cut, 24);
}

// What two turned boxes have in common, by cutting one of them at the other's faces.
double common_volume(const std::array<Point, 8>& one, const std::array<Point, 8>& other) {
  using Cell = std::array<Point, 4>;
  const auto volume = [](const Cell& c) {
    return std::abs(dot(c[1] - c[0], cross(c[2] - c[0], c[3] - c[0]))) / 6;
  };
  std::vector<Cell> cells;
  for (const auto& [i, j] : {std::pair(1, 3), {3, 2}, {2, 6}, {6, 4}, {4, 5}, {5, 1}})
    cells.push_back({other[0], other[std::size_t(i)], other[std::size_t(j)], other[7]});
  for (const auto& [a, b] : {std::pair(0, 1), {1, 0}, {0, 2}, {2, 0}, {0, 4}, {4, 0}}) {
    const Point in = one[std::size_t(b)] - one[std::size_t(a)];
    const auto depth = [&](const Point& p) { return dot(p - one[std::size_t(a)], in); };
    std::vector<Cell> kept;
    for (Cell c : cells) {
      std::ranges::sort(c, std::ranges::greater(), depth);
      const auto num =
          static_cast<std::size_t>(std::ranges::count_if(c, [&](auto& p) { return depth(p) > 0; }));
      const auto at = [&](std::size_t i, std::size_t j) {
        const double u = depth(c[i]), v = depth(c[j]);
        return c[i] + (u / (u - v)) * (c[j] - c[i]);
      };
      if (num == 4) kept.push_back(c);
      if (num == 1) kept.push_back({c[0], at(0, 1), at(0, 2), at(0, 3)});
      if (num == 3) {
        const Point p = at(0, 3), q = at(1, 3), r = at(2, 3);
        kept.insert(kept.end(), {{c[0], c[1], c[2], p}, {c[1], c[2], p, q}, {c[2], p, q, r}});
      }
      if (num == 2) {
        const Point p = at(0, 2), q = at(0, 3), r = at(1, 2), s = at(1, 3);
        kept.insert(kept.end(), {{c[0], p, q, c[1]}, {c[1], p, q, r}, {c[1], q, r, s}});
      }
    }
    cells = kept;
  }
  double sum = 0;
  for (const Cell& c : cells) sum += volume(c);
  return sum;
}

TEST_F(SurfaceBodies, OverlapInWhatTwoTurnedBoxesHaveInCommon) {
  constexpr unsigned kSeed = 47;
  std::mt19937_64 random(kSeed);
  SCOPED_TRACE(fmt::format("seed {}", kSeed));
  std::uniform_real_distribution<double> side(0.5, 2), about(-0.6, 0.6);
  std::normal_distribution<double> normal;
  const auto unit = [&] {
    const Point p{normal(random), normal(random), normal(random)};
    return (1 / norm(p)) * p;
  };
  int num_overlapping = 0;
  for (int trial = 0; trial < 40; ++trial) {
    SCOPED_TRACE(fmt::format("trial {}", trial));
    std::array<std::array<Point, 8>, 2> boxes;
    std::vector<std::filesystem::path> inputs;
    std::array<double, 2> volumes{};
    for (std::size_t b = 0; b < 2; ++b) {
      const Point u = unit(), across = cross(u, unit()), v = (1 / norm(across)) * across,
                  w = cross(u, v), center{about(random), about(random), about(random)};
      const double x = side(random), y = side(random), z = side(random);
      volumes[b] = x * y * z;
      const auto moved = [&](const Point& p) {
        return center + ((p.x - 0.5) * x) * u + ((p.y - 0.5) * y) * v + ((p.z - 0.5) * z) * w;
      };
      for (std::size_t k = 0; k < 8; ++k)
        boxes[b][k] = moved({double(k & 1), double(k >> 1 & 1), double(k >> 2)});
      inputs.push_back(files_.write(fmt::format("box{}_{}.off", trial, b),
                                    plain_off({.low = {0, 0, 0}, .high = {1, 1, 1}}, moved)));
    }
    const double common = common_volume(boxes[0], boxes[1]);
    if (common > 0.999 * std::min(volumes[0], volumes[1])) continue;  // it lies in the other
    const Numbered found = numbered(inputs, 50'000);
    EXPECT_NEAR(found.bodies[0].volume, volumes[0], 1e-12);
    EXPECT_NEAR(found.bodies[1].volume, volumes[1] - common, 1e-12);
    num_overlapping += common > 0;
    if (common > 0) {
      EXPECT_NE(found.facts.notes.back().find("overlap"), std::string::npos);
    }
    EXPECT_EQ(found.triangles, numbered(inputs, 12).triangles);
  }
  EXPECT_GT(num_overlapping, 25);
}

// Pins stand on a plate of two triangles a face: each of these meets all of them.
TEST_F(SurfaceBodies, TheNoteOfAPairTellsAPlaceOfBoth) {
  const auto as_it_is = [](const Point& p) { return p; };
  const Block plate{.low = {0, 0, 0}, .high = {30, 30, 1}};
  std::vector<Block> pins;
  for (const auto& [x, y] : {std::pair(3, 1), {20, 4}, {9, 25}, {28, 28}})
    pins.push_back({.low = {x, y, 1}, .high = {x + 1, y + 1, 3}});
  std::vector inputs{files_.write("plate.off", plain_off(plate, as_it_is))};
  for (std::size_t n = 0; n < pins.size(); ++n)
    inputs.push_back(files_.write(fmt::format("pin{}.off", n), plain_off(pins[n], as_it_is)));
  const Numbered found = numbered(inputs, 50'000);
  for (std::size_t n = 0; n < pins.size(); ++n) {
    const std::string begin = fmt::format("plate and pin{} cross, or lie on each other", n);
    const auto note = std::ranges::find_if(
        found.facts.notes, [&](const std::string& text) { return text.starts_with(begin); });
    ASSERT_NE(note, found.facts.notes.end()) << begin;
    const auto place = note->find("the first at (");
    ASSERT_NE(place, note->npos) << *note;
    Point p;
    ASSERT_EQ(std::sscanf(note->c_str() + place, "the first at (%lf, %lf, %lf)", &p.x, &p.y, &p.z),
              3);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_GE(p[int(axis)], pins[n].low[axis]) << *note;
      EXPECT_LE(p[int(axis)], pins[n].high[axis]) << *note;
    }
  }
}

TEST_F(SurfaceBodies, ThatAreTooManyForATriangleAreRefused) {
  // A plate of two triangles, and needles of a body through one of them.
  const Block plate{.low = {0, 0, 0}, .high = {4, 4, 1}};
  std::string corners, triangles;
  constexpr int kNum = 72;  // of each, 8 triangles cross a face of the plate
  int num = 0;
  for (int i = 0; i < kNum; ++i)
    for (int j = 0; j <= i; ++j, ++num) {
      const Point low{0.5 + 0.04 * i, 0.25 + 0.04 * j, 0.5};
      for (int k = 0; k < 8; ++k)
        corners += fmt::format("{} {} {}\n", low.x + (k & 1 ? 0.02 : 0), low.y + (k & 2 ? 0.02 : 0),
                               k & 4 ? 1.5 : 0.5);
      for (const auto& [a, b, c] : std::vector<std::array<int, 3>>{{0, 2, 3},
                                                                   {0, 3, 1},
                                                                   {4, 5, 7},
                                                                   {4, 7, 6},
                                                                   {0, 1, 5},
                                                                   {0, 5, 4},
                                                                   {2, 6, 7},
                                                                   {2, 7, 3},
                                                                   {0, 4, 6},
                                                                   {0, 6, 2},
                                                                   {1, 3, 7},
                                                                   {1, 7, 5}})
        triangles += fmt::format("3 {} {} {}\n", 8 * num + a, 8 * num + b, 8 * num + c);
    }
  const auto inputs =
      std::vector{files_.write("plate.off", plain_off(plate, [](const Point& p) { return p; })),
                  files_.write("needles.off", fmt::format("OFF\n{} {} 0\n", 8 * num, 12 * num) +
                                                  corners + triangles)};
  try {
    numbered(inputs, 50'000);
    ADD_FAILURE() << "not refused";
  } catch (const InputError& e) {
    const std::string what = e.what();
    for (const char* word :
         {"of plate is met by", "other bodies", "20000 at most", "smaller triangles"})
      EXPECT_NE(what.find(word), std::string::npos) << what;
  }
}

}  // namespace
}  // namespace locvol::voxel_bodies
