// Surfaces made at random, good and bad.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "engine/shared/input_error.h"
#include "tests/engine/closed_shapes.h"
#include "tests/engine/ingest/surface_fixtures.h"

namespace locvol {

using Random = std::mt19937;

inline std::uint32_t below(Random& random, std::size_t n) {
  return static_cast<std::uint32_t>(random() % n);
}

inline double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

inline Point random_point(Random& random, double reach) {
  return {uniform(random, -reach, reach), uniform(random, -reach, reach),
          uniform(random, -reach, reach)};
}

// The surface of a set of unit cubes, each face two triangles. Where cubes touch at an edge or a
// vertex only, it is not manifold.
inline Polygons voxels(const std::set<std::array<int, 3>>& cubes) {
  Polygons surface;
  std::map<std::array<int, 3>, std::uint32_t> numbers;
  const auto vertex = [&](std::array<int, 3> at) {
    const auto [known, is_new] =
        numbers.try_emplace(at, static_cast<std::uint32_t>(surface.vertices.size()));
    if (is_new)
      surface.vertices.push_back(
          {static_cast<double>(at[0]), static_cast<double>(at[1]), static_cast<double>(at[2])});
    return known->second;
  };
  for (const auto& cube : cubes)
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        auto beyond = cube;
        beyond[axis] += side ? 1 : -1;
        if (cubes.contains(beyond)) continue;
        std::array<std::uint32_t, 4> corners{};
        for (int k = 0; k < 4; ++k) {
          auto at = cube;
          at[axis] += side;
          at[(axis + 1) % 3] += (k == 1 || k == 2) ? 1 : 0;
          at[(axis + 2) % 3] += k >= 2 ? 1 : 0;
          corners[static_cast<std::size_t>(k)] = vertex(at);
        }
        if (side == 0) std::swap(corners[1], corners[3]);
        surface.faces.push_back({corners[0], corners[1], corners[2]});
        surface.faces.push_back({corners[0], corners[2], corners[3]});
      }
  return surface;
}

// A walk through space, `thick` cubes wide: closed, with handles and at times with cavities.
inline Polygons random_voxels(Random& random, int num_steps, int thick) {
  std::set<std::array<int, 3>> cubes;
  std::array<int, 3> at{};
  for (int step = 0; step < num_steps; ++step) {
    for (int i = 0; i < thick; ++i)
      for (int j = 0; j < thick; ++j)
        for (int k = 0; k < thick; ++k)
          cubes.insert({thick * at[0] + i, thick * at[1] + j, thick * at[2] + k});
    at[below(random, 3)] += random() % 2 ? 1 : -1;
  }
  return voxels(cubes);
}

inline Polygons to_polygons(const testing_shapes::Shape& shape) {
  Polygons surface{shape.vertices, {}};
  for (const auto& [a, b, c] : shape.triangles) surface.faces.push_back({a, b, c});
  return surface;
}

inline Polygons rough_ball(Random& random, double radius, const Point& center) {
  Polygons ball = to_polygons(testing_shapes::sphere(1, 12 + below(random, 10), 24));
  std::uniform_real_distribution<double> rough(0.95, 1.05);
  for (Point& p : ball.vertices) p = center + rough(random) * radius * p;
  return ball;
}

// Balls in balls, side by side with others, and with tori.
inline Polygons random_balls(Random& random) {
  Polygons all;
  for (double radius = 4; radius > 0.3; radius *= 0.55)
    all.append(rough_ball(random, radius, {0.1, -0.2, 0.3}));
  for (int i = 0; i < 3; ++i) all.append(rough_ball(random, 0.2 + 0.3 * i, {7.0, 2.0 * i, -1.0}));
  const testing_shapes::Shape torus =
      testing_shapes::translated(testing_shapes::torus(2, 0.5, 24, 12), {-9, 0, 1});
  all.append(to_polygons(torus));
  return all;
}

// Each face has corners of its own, so far from where they were.
inline Polygons jittered(const Polygons& s, double reach, Random& random) {
  Polygons loose;
  for (const auto& face : s.faces) {
    auto& own = loose.faces.emplace_back();
    for (const std::uint32_t v : face) {
      own.push_back(static_cast<std::uint32_t>(loose.vertices.size()));
      loose.vertices.push_back(s.vertices[v] + random_point(random, reach));
    }
  }
  return loose;
}

inline void shuffle(Polygons& s, Random& random) {
  std::ranges::shuffle(s.faces, random);
  for (auto& f : s.faces) {
    std::ranges::rotate(f, f.begin() + below(random, f.size()));
    if (random() % 2) std::swap(f[0], f[1]);
  }
}

// Puts a vertex on an edge of the face and a flat triangle between the face and its neighbor.
inline void add_flat_triangle(Polygons& s, std::size_t face) {
  const std::uint32_t a = s.faces[face][0], b = s.faces[face][1], c = s.faces[face][2];
  const auto m = static_cast<std::uint32_t>(s.vertices.size());
  s.vertices.push_back(0.5 * (s.vertices[a] + s.vertices[b]));  // exact for voxels
  s.faces[face] = {a, m, c};
  s.faces.push_back({m, b, c});
  s.faces.push_back({a, b, m});
}

struct Judgement {
  std::string refusal;
  SurfaceFacts facts;
  std::vector<Triangle> triangles;
  friend bool operator==(const Judgement&, const Judgement&) = default;
};

inline Judgement judge(const std::filesystem::path& file, std::uint64_t capacity) {
  try {
    const InputSurface s = read_whole_surface(file, capacity);
    return {{}, s.facts, s.pieces};
  } catch (const InputError& error) {
    return {error.what(), {}, {}};
  }
}

// A walk may touch itself, and most do: drawn until one does not.
inline Polygons manifold_voxels(Random& random, const SurfaceFiles& files) {
  for (;;) {
    Polygons solid = random_voxels(random, 40, 3);
    const auto file = files.write("solid.off", to_off(solid));
    if (judge(file, 1'000'000).refusal.empty()) return solid;
  }
}

struct Sample {
  std::string name;
  Polygons surface;
};

inline std::vector<Sample> random_samples(Random& random, const SurfaceFiles& files) {
  std::vector<Sample> samples;
  const auto add = [&](const std::string& name, Polygons s) -> Polygons& {
    shuffle(s, random);
    samples.push_back({name, std::move(s)});
    return samples.back().surface;
  };
  add("balls", random_balls(random));
  add("voxels", random_voxels(random, 60, 3));
  add("thin voxels", random_voxels(random, 40, 1));
  const auto solid = [&] { return manifold_voxels(random, files); };
  {
    Polygons& s = add("flat triangles", solid());
    for (int i = 0; i < 20; ++i) add_flat_triangle(s, below(random, s.faces.size()));
  }
  {
    Polygons& s = add("copies", solid());
    const std::size_t n = s.faces.size();
    for (int i = 0; i < 10; ++i) s.faces.push_back(s.faces[below(random, n)]);
    shuffle(s, random);
  }
  {
    Polygons& s = add("copies of flat triangles", solid());
    add_flat_triangle(s, below(random, s.faces.size()));
    s.faces.push_back(s.faces.back());
    s.faces.push_back(s.faces[below(random, s.faces.size())]);
  }
  {
    Polygons& s = add("holes", random_balls(random));
    for (int i = 0; i < 3; ++i) s.faces.erase(s.faces.begin() + below(random, s.faces.size()));
  }
  {
    Polygons& s = add("fins", random_balls(random));
    for (int i = 0; i < 3; ++i) {
      const auto& f = s.faces[below(random, s.faces.size())];
      s.faces.push_back({f[0], f[1], below(random, s.vertices.size())});
    }
  }
  {
    Polygons s = random_balls(random);
    s.append(rough_ball(random, 2, {3.5, 0, 0}));
    add("overlap", std::move(s));
  }
  {
    Polygons s = random_balls(random);
    for (Polygons ball = rough_ball(random, 1, {-3, 9, 0}); s.faces.size() % 2 == 0;) {
      ball.append(ball);  // the same ball twice
      s.append(ball);
      break;
    }
    add("a ball twice", std::move(s));
  }
  {
    Polygons s = rough_ball(random, 1, {0, 0, 0}), other = rough_ball(random, 1, {0, 0, 20});
    other.vertices.front() = s.vertices.back();  // pole to pole
    s.append(other);
    add("pinched", std::move(s));
  }
  return samples;
}

}  // namespace locvol
