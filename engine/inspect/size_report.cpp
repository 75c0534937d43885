#include "engine/inspect/size_report.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "engine/inspect/vtu_file.h"
#include "engine/plan/run_estimate.h"
#include "octree/size_field.h"

namespace locvol {
namespace {

struct Cube {
  MortonKey key, leaf;
  double size, distance;  // at its center
};

// In Morton order.
template <class Visit>
void for_each_cube(const Reader& reader, const RunRecord& run, const Visit& visit) {
  const SizeLaw law = run.parameters.sizes();
  if (law.is_uniform()) return;
  for (const MortonKey leaf : reader.leaf_keys())
    for (const SizeCube& cube : reader.sizes(leaf).cubes) {
      const Box box = run.frame.box(cube.key);
      if (is_outside(cube, box.max.x - box.min.x)) continue;
      const Point center = box.center();
      visit(cube, Cube{cube.key, leaf, size_in(law, cube, box, center),
                       interpolated(cube.distance, box, center) - cube.excess});
    }
}

}  // namespace

SizeReport report_sizes(const Reader& reader) {
  SizeReport report;
  report.least = std::numeric_limits<double>::infinity();
  const auto run = reader.run();
  if (!run) return {};
  std::map<int, SizeOctave> octaves;
  for_each_cube(reader, *run, [&](const SizeCube& cube, const Cube& known) {
    ++report.num_cubes;
    report.least = std::min(report.least, known.size);
    report.most = std::max(report.most, known.size);
    const Box box = run->frame.box(cube.key);
    const SizeTotals sum = size_totals(run->parameters.sizes(), cube, box);
    const int exponent = std::ilogb(known.size);
    SizeOctave& octave = octaves[exponent];
    octave.least = std::ldexp(1.0, exponent);
    octave.num_cells += graded_num_cells(sum);
    octave.volume += sum.of_volume * std::pow(known.size, 3);
  });
  if (report.num_cubes == 0) return {};
  for (const auto& [exponent, octave] : octaves)
    if (octave.num_cells > 0) report.octaves.push_back(octave);
  return report;
}

WrittenSizes write_sizes_vtu(const Reader& reader, const std::filesystem::path& file) {
  std::vector<Cube> cubes;
  const auto run = reader.run();
  if (run)
    for_each_cube(reader, *run, [&](const SizeCube&, const Cube& cube) { cubes.push_back(cube); });
  VtuGrid grid =
      grid_of_boxes(cubes.size(), [&](std::size_t i) { return run->frame.box(cubes[i].key); });
  const auto add = [&](const char* name, auto value) {
    grid.cell_data.push_back(
        vtu_array(name, cubes.size(), [&cubes, value](std::size_t i) { return value(cubes[i]); }));
  };
  add("size", [](const Cube& cube) { return cube.size; });
  add("distance", [](const Cube& cube) { return cube.distance; });
  add("level", [](const Cube& cube) { return std::int64_t{cube.key.level()}; });
  add("leaf", [](const Cube& cube) { return cube.leaf.bits(); });
  return {cubes.size(), write_vtu_grid(grid, file)};
}

}  // namespace locvol
