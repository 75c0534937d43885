// Families that are unions of boxes.
#include <algorithm>
#include <array>
#include <vector>

#include "tests/sweeps/shapes/blocks.h"
#include "tests/sweeps/shapes/families.h"

namespace locvol::sweeps {
namespace {

// Planes at distances of which some may be tiny.
std::vector<double> random_planes(int num_cells, Dice& dice) {
  std::vector<double> planes = {0};
  const double least = dice.one_of(std::array{1.0, 0.5, 0.1, 0.01});
  for (int i = 0; i < num_cells; ++i) planes.push_back(planes.back() + dice.length(least, 4));
  return planes;
}

void sort_out_copies(std::vector<double>& values) {
  std::ranges::sort(values);
  const auto copies = std::ranges::unique(values);
  values.erase(copies.begin(), copies.end());
}

std::size_t index_of(const std::vector<double>& planes, double value) {
  return static_cast<std::size_t>(std::ranges::lower_bound(planes, value) - planes.begin());
}

// Struts and the gaps between them, by turns.
std::vector<double> strut_planes(int num_gaps, double strut, double gap) {
  std::vector<double> planes = {0, strut};
  for (int i = 0; i < num_gaps; ++i) {
    planes.push_back(planes.back() + gap);
    planes.push_back(planes.back() + strut);
  }
  return planes;
}

}  // namespace

Solid make_box(Dice& dice) {
  const bool is_cube = dice.chance(0.3);
  const double side = dice.length(1, 4);
  const double least = dice.one_of(std::array{1.0, 0.1, 0.01});
  const auto length = [&] { return is_cube ? side : dice.length(least, 4); };
  Blocks blocks({{{0, length()}, {0, length()}, {0, length()}}});
  blocks.set(0, 0, 0, true);
  Solid solid = blocks.solid();
  solid.genus = 0;
  solid.num_components = 1;
  return solid;
}

Solid make_stack(Dice& dice) {
  const int num_boxes = dice.integer(2, 6);
  std::vector<Box> boxes;
  std::array<std::vector<double>, 3> planes;
  for (int i = 0; i < num_boxes; ++i) {
    // Often flush with the last one, which often hides the seam.
    Box box;
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_flush = i > 0 && dice.chance(0.4);
      box.min[axis] = is_flush ? boxes.back().min[axis] : dice.length(0.1, 3);
      box.max[axis] = box.min[axis] + dice.length(0.2, 4);
      auto& on_axis = planes[static_cast<std::size_t>(axis)];
      on_axis.insert(on_axis.end(), {box.min[axis], box.max[axis]});
    }
    boxes.push_back(box);
  }
  for (auto& on_axis : planes) sort_out_copies(on_axis);
  Blocks blocks(planes);
  for (const Box& box : boxes)
    blocks.fill({index_of(planes[0], box.min.x), index_of(planes[1], box.min.y),
                 index_of(planes[2], box.min.z)},
                {index_of(planes[0], box.max.x), index_of(planes[1], box.max.y),
                 index_of(planes[2], box.max.z)});
  return blocks.solid();
}

Solid make_blocks(Dice& dice) {
  const auto cells = [&] { return random_planes(dice.integer(2, 5), dice); };
  Blocks blocks({cells(), cells(), cells()});
  const double share = dice.uniform(0.3, 0.8);
  const auto [nx, ny, nz] = blocks.size();
  for (std::size_t k = 0; k < nz; ++k)
    for (std::size_t j = 0; j < ny; ++j)
      for (std::size_t i = 0; i < nx; ++i) blocks.set(i, j, k, dice.chance(share));
  blocks.set(0, 0, 0, true);
  return blocks.solid();
}

Solid make_frame(Dice& dice) {
  const double strut = dice.length(0.05, 0.5), gap = dice.length(0.5, 2);
  const int nx = dice.integer(1, 3), ny = dice.integer(1, 3), nz = dice.integer(0, 2);
  Blocks blocks(
      {strut_planes(nx, strut, gap), strut_planes(ny, strut, gap), strut_planes(nz, strut, gap)});
  const auto size = blocks.size();
  for (std::size_t k = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j)
      for (std::size_t i = 0; i < size[0]; ++i)
        blocks.set(i, j, k, i % 2 + j % 2 + k % 2 <= 1);  // a node or an edge of the grid
  Solid solid = blocks.solid();
  const int num_nodes = (nx + 1) * (ny + 1) * (nz + 1);
  const int num_struts =
      nx * (ny + 1) * (nz + 1) + (nx + 1) * ny * (nz + 1) + (nx + 1) * (ny + 1) * nz;
  solid.genus = num_struts - num_nodes + 1;
  solid.num_components = 1;
  return solid;
}

Solid make_hollow(Dice& dice) {
  const double wall = dice.length(0.02, 0.5);
  const auto planes = [&] {
    const double inside = dice.length(1, 4);
    return std::vector{0.0, wall, wall + inside, wall + inside + wall};
  };
  Blocks blocks({planes(), planes(), planes()});
  blocks.fill({0, 0, 0}, {3, 3, 3});
  blocks.set(1, 1, 1, false);
  const int num_windows = dice.integer(0, 3);
  if (num_windows > 0) blocks.set(1, 1, 2, false);
  if (num_windows > 1) blocks.set(1, 2, 1, false);
  if (num_windows > 2) blocks.set(0, 1, 1, false);
  Solid solid = blocks.solid();
  solid.num_components = num_windows == 0 ? 2 : 1;
  solid.genus = std::max(num_windows - 1, 0);
  return solid;
}

}  // namespace locvol::sweeps
