#include "engine/inspect/size_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "engine/exchange/merged_rows.h"
#include "engine/inspect/vtu_file.h"
#include "engine/plan/run_estimate.h"
#include "octree/size_field.h"

namespace locvol {

struct SeenCube {
  MortonKey key, leaf;
  double size = 0, distance = 0;  // at its center

  RowOrder order() const { return {key.bits()}; }
  std::size_t num_bytes() const { return sizeof(*this); }
};
auto fields(Maybe<SeenCube> auto& cube) {
  auto& [key, leaf, size, distance] = cube;
  return std::tuple(Field("key", key), Field("leaf", leaf), Field("size", size),
                    Field("distance", distance));
}
auto fields(Maybe<SizeOctave> auto& octave) {
  auto& [least, volume, num_cells] = octave;
  return std::tuple(Field("least", least), Field("volume", volume), Field("num_cells", num_cells));
}
auto fields(Maybe<SizeReport> auto& report) {
  auto& [num_cubes, least, most, octaves] = report;
  return std::tuple(Field("num_cubes", num_cubes), Field("least", least), Field("most", most),
                    Field("octaves", octaves));
}

namespace {

// Of the part's leaves, in Morton order.
template <class Visit>
void for_each_cube(const RunPart& part, const RunRecord& run, const Visit& visit) {
  const SizeLaw law = run.parameters.sizes();
  if (law.is_uniform() || !part.store) return;
  const Snapshot snapshot = part.store->snapshot();
  for (const MortonKey leaf : snapshot.leaf_keys()) {
    if (!part.has(leaf)) continue;
    for (const SizeCube& cube : snapshot.sizes(leaf).cubes) {
      const Box box = run.frame.box(cube.key);
      if (is_outside(cube, box.max.x - box.min.x)) continue;
      const Point center = box.center();
      visit(cube, SeenCube{cube.key, leaf, size_in(law, cube, box, center),
                           interpolated(cube.distance, box, center) - cube.excess});
    }
  }
}

SizeReport empty_report() {
  return {
      .num_cubes = 0, .least = std::numeric_limits<double>::infinity(), .most = 0, .octaves = {}};
}

SizeReport own_report(const RunPart& part, const RunRecord& run) {
  SizeReport report = empty_report();
  std::map<int, SizeOctave> octaves;
  for_each_cube(part, run, [&](const SizeCube& cube, const SeenCube& seen) {
    ++report.num_cubes;
    report.least = std::min(report.least, seen.size);
    report.most = std::max(report.most, seen.size);
    const Box box = run.frame.box(cube.key);
    const SizeTotals sum = size_totals(run.parameters.sizes(), cube, box);
    const int exponent = std::ilogb(seen.size);
    SizeOctave& octave = octaves[exponent];
    octave.least = std::ldexp(1.0, exponent);
    octave.num_cells += graded_num_cells(sum);
    octave.volume += sum.of_volume * std::pow(seen.size, 3);
  });
  for (const auto& [exponent, octave] : octaves)
    if (octave.num_cells > 0) report.octaves.push_back(octave);
  return report;
}

void add(const SizeReport& more, SizeReport& all) {
  all.num_cubes += more.num_cubes;
  all.least = std::min(all.least, more.least);
  all.most = std::max(all.most, more.most);
  for (const SizeOctave& octave : more.octaves) {
    auto place = std::ranges::lower_bound(all.octaves, octave.least, {}, &SizeOctave::least);
    if (place == all.octaves.end() || place->least != octave.least)
      place = all.octaves.insert(place, {.least = octave.least});
    place->volume += octave.volume;
    place->num_cells += octave.num_cells;
  }
}

// On the first rank those of all, in Morton order; on others none.
std::vector<SeenCube> gathered_cubes(const RunPart& part, const RunRecord& run) {
  std::vector<SeenCube> all;
  MergedRows<SeenCube> rows(part.exchange, [&](const SeenCube& cube) {
    all.push_back(cube);
    return true;
  });
  for_each_cube(part, run, [&](const SizeCube&, const SeenCube& cube) { rows.add(cube); });
  rows.finish();
  return all;
}

}  // namespace

SizeReport report_sizes(const RunPart& part, const RunRecord& run) {
  SizeReport all = empty_report();
  for (const SizeReport& of_rank : gather_values(part.exchange, own_report(part, run)))
    add(of_rank, all);
  return all.num_cubes > 0 ? all : SizeReport{};
}

WrittenSizes write_sizes_vtu(const RunPart& part, const RunRecord& run,
                             const std::filesystem::path& file) {
  const std::vector<SeenCube> cubes = gathered_cubes(part, run);
  if (!part.is_first()) return {};
  VtuGrid grid =
      grid_of_boxes(cubes.size(), [&](std::size_t i) { return run.frame.box(cubes[i].key); });
  const auto add = [&](const char* name, auto value) {
    grid.cell_data.push_back(
        vtu_array(name, cubes.size(), [&cubes, value](std::size_t i) { return value(cubes[i]); }));
  };
  add("size", [](const SeenCube& cube) { return cube.size; });
  add("distance", [](const SeenCube& cube) { return cube.distance; });
  add("level", [](const SeenCube& cube) { return std::int64_t{cube.key.level()}; });
  add("leaf", [](const SeenCube& cube) { return cube.leaf.bits(); });
  return {cubes.size(), write_vtu_grid(grid, file)};
}

}  // namespace locvol
