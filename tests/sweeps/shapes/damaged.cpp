#include "tests/sweeps/shapes/damaged.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "octree/disjoint_sets.h"

namespace locvol::sweeps {
namespace {

using Face = std::array<std::uint32_t, 3>;

double area_of_triangle(const Shape& shape, const Face& t) {
  const auto& [a, b, c] = t;
  return 0.5 *
         norm(cross(shape.vertices[b] - shape.vertices[a], shape.vertices[c] - shape.vertices[a]));
}

// Of each triangle, those beyond its edges.
std::vector<std::vector<std::uint32_t>> neighbors_of(const Shape& shape) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> first;
  std::vector<std::vector<std::uint32_t>> neighbors(shape.triangles.size());
  for (std::uint32_t t = 0; t < shape.triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto edge = std::minmax(shape.triangles[t][k], shape.triangles[t][(k + 1) % 3]);
      const auto [known, is_new] = first.emplace(edge, t);
      if (is_new) continue;
      neighbors[t].push_back(known->second);
      neighbors[known->second].push_back(t);
    }
  return neighbors;
}

// A flat patch over a hole of area A cuts off what is at most a half ball over it.
double volume_over(double area) { return area * std::sqrt(area) / (3 * std::sqrt(2 * kPi)); }

// Without some triangles.
DamagedSurface without(const Shape& sound, const std::vector<bool>& goes) {
  DamagedSurface result{sound, {sound}};
  std::erase_if(result.shape.triangles,
                [&, t = std::size_t{0}](const Face&) mutable { return goes[t++]; });
  const auto neighbors = neighbors_of(sound);
  DisjointSets holes(goes.size());
  for (std::uint32_t t = 0; t < goes.size(); ++t)
    for (const std::uint32_t other : neighbors[t])
      if (goes[t] && goes[other]) holes.unite(t, other);
  std::map<std::size_t, double> areas;
  for (std::size_t t = 0; t < goes.size(); ++t)
    if (goes[t]) areas[holes.find(t)] += area_of_triangle(sound, sound.triangles[t]);
  for (const auto& [hole, area] : areas) result.lost_volume += volume_over(area);
  return result;
}

std::optional<DamagedSurface> with_hole(const Shape& sound, std::size_t num, Dice& dice) {
  if (4 * num > sound.triangles.size()) return std::nullopt;
  const auto neighbors = neighbors_of(sound);
  std::vector<bool> goes(sound.triangles.size());
  std::vector<std::uint32_t> hole{static_cast<std::uint32_t>(dice.bits() % goes.size())};
  goes[hole[0]] = true;
  for (std::size_t i = 0; i < hole.size() && hole.size() < num; ++i)
    for (const std::uint32_t other : neighbors[hole[i]]) {
      if (goes[other] || hole.size() == num) continue;
      goes[other] = true;
      hole.push_back(other);
    }
  return without(sound, goes);
}

std::vector<bool> some_of(const Shape& shape, double share, Dice& dice) {
  std::vector<bool> chosen(shape.triangles.size());
  for (std::size_t t = 0; t < chosen.size(); ++t) chosen[t] = dice.chance(share);
  chosen[dice.bits() % chosen.size()] = true;
  return chosen;
}

DamagedSurface with_doubled(const Shape& sound, double share, Dice& dice) {
  DamagedSurface result{sound, {sound}};
  const std::vector<bool> chosen = some_of(sound, share, dice);
  for (std::size_t t = 0; t < chosen.size(); ++t)
    if (chosen[t]) result.shape.triangles.push_back(sound.triangles[t]);
  return result;
}

DamagedSurface with_flipped(const Shape& sound, double share, Dice& dice) {
  DamagedSurface result{sound, {sound}};
  const std::vector<bool> chosen = some_of(sound, share, dice);
  for (std::size_t t = 0; t < chosen.size(); ++t)
    if (chosen[t]) std::swap(result.shape.triangles[t][1], result.shape.triangles[t][2]);
  return result;
}

Point somewhere(double distance, Dice& dice) {
  const auto along = [&] { return dice.uniform(-distance, distance); };
  const double x = along(), y = along();
  return {x, y, along()};
}

// Each triangle has corners of its own, each beside the vertex that it was.
DamagedSurface unwelded(const Shape& sound, double distance, Dice& dice) {
  DamagedSurface result{{}, {sound}, distance * area_of(sound)};
  for (const Face& t : sound.triangles) {
    const auto first = static_cast<std::uint32_t>(result.shape.vertices.size());
    for (const std::uint32_t v : t)
      result.shape.vertices.push_back(sound.vertices[v] + somewhere(distance, dice));
    result.shape.triangles.push_back({first, first + 1, first + 2});
  }
  return result;
}

// Each vertex is moved by up to so much of the mean of its edges.
DamagedSurface with_noise_of_edges(const Shape& sound, double share, Dice& dice) {
  std::vector<double> sum(sound.vertices.size()), num(sound.vertices.size());
  for (const Face& t : sound.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      for (const std::size_t other : {(k + 1) % 3, (k + 2) % 3}) {
        sum[t[k]] += norm(sound.vertices[t[other]] - sound.vertices[t[k]]);
        ++num[t[k]];
      }
  DamagedSurface result{sound, {sound}};
  double moved = 0;
  for (std::size_t v = 0; v < sum.size(); ++v) {
    if (num[v] == 0) continue;
    const double distance = share * sum[v] / num[v];
    moved += num[v] * distance;
    result.shape.vertices[v] = sound.vertices[v] + somewhere(distance, dice);
  }
  result.lost_volume = moved / std::reduce(num.begin(), num.end()) * area_of(sound);
  return result;
}

DamagedSurface with_copy(const Shape& sound, double distance) {
  Shape copy = sound;
  const Point by = distance * Point{0.61, 0.53, 0.59};
  for (Point& p : copy.vertices) p = p + by;
  DamagedSurface result{sound, {sound, copy}};
  const auto first = static_cast<std::uint32_t>(sound.vertices.size());
  result.shape.vertices.insert(result.shape.vertices.end(), copy.vertices.begin(),
                               copy.vertices.end());
  for (const auto& [a, b, c] : copy.triangles)
    result.shape.triangles.push_back({a + first, b + first, c + first});
  return result;
}

}  // namespace

std::string Damage::name() const { return fmt::format("{} {:g}", kind, measure); }

std::vector<Damage> damages() {
  return {
      {"none", 0, true},        {"hole", 1, true},      {"hole", 10, true},   {"hole", 100, true},
      {"hole", 1000, true},     {"lost", 0.1, true},    {"lost", 1, true},    {"lost", 10},
      {"doubled", 1, true},     {"doubled", 100, true}, {"flipped", 1, true}, {"flipped", 50, true},
      {"unwelded", 1e-7, true}, {"unwelded", 1e-5},     {"unwelded", 1e-3},   {"noise", 0.1},
      {"noise", 0.3},           {"copies", 0.01, true}, {"copies", 0.3, true}};
}

std::optional<DamagedSurface> damaged(const Shape& sound, const Damage& damage,
                                      std::uint64_t seed) {
  Dice dice(seed);
  const Box box = box_of(sound);
  const Point sides = box.max - box.min;
  const double longest = max_norm(sides), shortest = std::min({sides.x, sides.y, sides.z});
  if (damage.kind == "none") return DamagedSurface{sound, {sound}};
  if (damage.kind == "hole")
    return with_hole(sound, static_cast<std::size_t>(damage.measure), dice);
  if (damage.kind == "lost") return without(sound, some_of(sound, damage.measure / 100, dice));
  if (damage.kind == "doubled") return with_doubled(sound, damage.measure / 100, dice);
  if (damage.kind == "flipped") return with_flipped(sound, damage.measure / 100, dice);
  if (damage.kind == "unwelded") return unwelded(sound, damage.measure * longest, dice);
  if (damage.kind == "noise") return with_noise_of_edges(sound, damage.measure, dice);
  return with_copy(sound, damage.measure * shortest);
}

}  // namespace locvol::sweeps
