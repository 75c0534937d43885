// What a leaf costs: put and get of 20,000 points and 60,000 cells, in time and in bytes.
//
// The points are those of a BCC lattice, shaken: coordinates as random as those of a surface
// sample, with the true connectivity of a Delaunay mesh. `shuffled`: ids in random order, the worst
// case.
#include <benchmark/benchmark.h>
#include <stdlib.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "storage/codec.h"
#include "storage/store.h"

namespace locvol {
namespace {

constexpr std::size_t kNumPoints = 20000, kNumCells = 60000;

struct Leaf {
  LeafPoints points;
  LeafCells cells;
};

using Index = std::array<int, 3>;  // of a lattice point: all even or all odd

// The four cells around the lattice edge from p to p + 2 along `axis`.
std::vector<std::array<Index, 4>> cells_at(const Index& p, std::size_t axis) {
  const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
  Index q = p;
  q[axis] += 2;
  constexpr int kTurns[5][2] = {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}, {1, 1}};
  const auto center = [&](const int(&turn)[2]) {
    Index c = p;
    c[axis] += 1, c[u] += turn[0], c[v] += turn[1];
    return c;
  };
  std::vector<std::array<Index, 4>> cells;
  for (int i = 0; i < 4; ++i) cells.push_back({p, q, center(kTurns[i]), center(kTurns[i + 1])});
  return cells;
}

Leaf make_leaf(bool is_shuffled) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> shake(-0.2, 0.2);
  Leaf leaf;
  std::map<Index, std::uint32_t> numbers;
  for (int i = 0; leaf.points.points.size() < kNumPoints; ++i)
    for (int j = i % 2; j < 44; j += 2)
      for (int k = i % 2; k < 44 && leaf.points.points.size() < kNumPoints; k += 2) {
        numbers[{i, j, k}] = static_cast<std::uint32_t>(leaf.points.points.size());
        leaf.points.points.push_back({leaf.points.points.size() + 1000000,
                                      {i + shake(random), j + shake(random), k + shake(random)},
                                      PointKind::kVolume});
      }
  std::vector<std::uint32_t> rename(kNumPoints);
  std::iota(rename.begin(), rename.end(), 0u);
  if (is_shuffled) std::ranges::shuffle(rename, random);
  for (const MeshPoint& point : leaf.points.points) leaf.cells.vertices.push_back(point.id);
  for (const auto& [index, number] : numbers)
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (const auto& cell : cells_at(index, axis)) {
        if (leaf.cells.cells.size() == kNumCells) return leaf;
        if (!std::ranges::all_of(cell, [&](const Index& c) { return numbers.contains(c); }))
          continue;
        auto& corners = leaf.cells.cells.emplace_back();
        for (std::size_t c = 0; c < 4; ++c) corners[c] = rename[numbers[cell[c]]];
      }
  return leaf;
}

class TempStore {
 public:
  TempStore() {
    std::string name = (std::filesystem::temp_directory_path() / "locvol-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TempStore() { std::filesystem::remove_all(path_); }
  Store open() const { return Store::open(path_ / "s", {.create = true}); }

 private:
  std::filesystem::path path_;
};

// Bytes in memory, as structs.
constexpr auto kLeafBytes =
    static_cast<std::int64_t>(kNumPoints * sizeof(MeshPoint) + kNumPoints * sizeof(std::uint64_t) +
                              kNumCells * sizeof(std::array<int, 4>));

void report(benchmark::State& state, const Leaf& leaf) {
  const auto size = [](const std::string& bytes) { return static_cast<double>(bytes.size()); };
  state.counters["bytes/point"] = size(encode(leaf.points, MortonKey::root())) / kNumPoints;
  state.counters["bytes/cell"] = size(encode(leaf.cells, MortonKey::root())) / kNumCells;
  state.SetBytesProcessed(state.iterations() * kLeafBytes);
}

void BM_EncodeLeaf(benchmark::State& state) {
  const Leaf leaf = make_leaf(state.range(0) != 0);
  for (auto _ : state) {
    benchmark::DoNotOptimize(encode(leaf.points, MortonKey::root()));
    benchmark::DoNotOptimize(encode(leaf.cells, MortonKey::root()));
  }
  report(state, leaf);
}

void BM_DecodeLeaf(benchmark::State& state) {
  const Leaf leaf = make_leaf(state.range(0) != 0);
  const std::string points = encode(leaf.points, MortonKey::root());
  const std::string cells = encode(leaf.cells, MortonKey::root());
  for (auto _ : state) {
    benchmark::DoNotOptimize(decode<LeafPoints>(points, MortonKey::root()));
    benchmark::DoNotOptimize(decode<LeafCells>(cells, MortonKey::root()));
  }
  report(state, leaf);
}

// Durably, one leaf to a batch, over 64 leaves again and again.
void BM_PutLeaf(benchmark::State& state) {
  const Leaf leaf = make_leaf(state.range(0) != 0);
  const TempStore directory;
  Store store = directory.open();
  std::uint32_t number = 0;
  for (auto _ : state) {
    const MortonKey key = MortonKey::containing({number++ % 64, 0, 0}, MortonKey::kMaxLevel);
    Batch batch = store.begin();
    batch.put_points(key, leaf.points);
    batch.put_cells(key, leaf.cells);
    batch.commit();
  }
  report(state, leaf);
}

void BM_GetLeaf(benchmark::State& state) {
  const Leaf leaf = make_leaf(state.range(0) != 0);
  const TempStore directory;
  Store store = directory.open();
  Batch batch = store.begin();
  batch.put_points(MortonKey::root(), leaf.points);
  batch.put_cells(MortonKey::root(), leaf.cells);
  batch.commit();
  for (auto _ : state) {
    const Snapshot snapshot = store.snapshot();
    benchmark::DoNotOptimize(snapshot.points(MortonKey::root()));
    benchmark::DoNotOptimize(snapshot.cells(MortonKey::root()));
  }
  report(state, leaf);
}

BENCHMARK(BM_EncodeLeaf)->ArgName("shuffled")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_DecodeLeaf)->ArgName("shuffled")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_PutLeaf)->ArgName("shuffled")->Arg(0)->Unit(benchmark::kMillisecond);
BENCHMARK(BM_GetLeaf)->ArgName("shuffled")->Arg(0)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace locvol

BENCHMARK_MAIN();
