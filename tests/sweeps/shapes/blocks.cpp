#include "tests/sweeps/shapes/blocks.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace locvol::sweeps {
namespace {

using Cell = std::array<std::size_t, 3>;

// Octants of a vertex, as bits; neighbors differ in one axis, that is one bit of their number.
bool is_connected(unsigned octants) {
  if (octants == 0) return true;
  unsigned reached = octants & (~octants + 1);  // the first of them
  for (unsigned before = 0; reached != before;) {
    before = reached;
    for (unsigned octant = 0; octant < 8; ++octant)
      if ((before >> octant & 1) != 0)
        for (const unsigned axis : {1U, 2U, 4U}) reached |= (1U << (octant ^ axis)) & octants;
  }
  return reached == octants;
}

template <typename Visit>
void for_each(const Cell& size, const Visit& visit) {
  for (std::size_t k = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j)
      for (std::size_t i = 0; i < size[0]; ++i) visit(Cell{i, j, k});
}

}  // namespace

Blocks::Blocks(std::array<std::vector<double>, 3> planes)
    : planes_(std::move(planes)),
      size_({planes_[0].size() - 1, planes_[1].size() - 1, planes_[2].size() - 1}),
      full_(size_[0] * size_[1] * size_[2]) {}

void Blocks::fill(const Cell& from, const Cell& to, bool is_full) {
  for_each({to[0] - from[0], to[1] - from[1], to[2] - from[2]}, [&](const Cell& cell) {
    set(from[0] + cell[0], from[1] + cell[1], from[2] + cell[2], is_full);
  });
}

// The surface is a disk around a vertex if the full octants hang together by faces, and the empty
// ones do. Otherwise the first empty one is filled; the last that can be are those of the grid, a
// box. Returns whether one was.
bool Blocks::make_manifold_at(const Cell& vertex) {
  unsigned full = 0;
  Cell first_empty = size_;
  for (unsigned octant = 0; octant < 8; ++octant) {
    Cell cell = vertex;  // beyond the grid where the difference wraps around, too
    for (std::size_t axis = 0; axis < 3; ++axis) cell[axis] -= 1 - (octant >> axis & 1);
    if (cell[0] >= size_[0] || cell[1] >= size_[1] || cell[2] >= size_[2]) continue;
    if (is_full(cell[0], cell[1], cell[2]))
      full |= 1U << octant;
    else if (first_empty == size_)
      first_empty = cell;
  }
  if (is_connected(full) && is_connected(~full & 0xff)) return false;
  set(first_empty[0], first_empty[1], first_empty[2], true);
  return true;
}

double Blocks::width(int axis, std::size_t cell) const {
  const auto& planes = planes_[static_cast<std::size_t>(axis)];
  return planes[cell + 1] - planes[cell];
}

void Blocks::add_face(ShapeBuilder& builder, const Cell& cell, std::size_t axis,
                      bool is_upper) const {
  const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
  const auto corner = [&](std::size_t du, std::size_t dv) {
    Point p;
    p[static_cast<int>(axis)] = planes_[axis][cell[axis] + (is_upper ? 1 : 0)];
    p[static_cast<int>(u)] = planes_[u][cell[u] + du];
    p[static_cast<int>(v)] = planes_[v][cell[v] + dv];
    return p;
  };
  if (is_upper)
    builder.quad(corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1));
  else
    builder.quad(corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0));
}

Solid Blocks::solid() {
  const Cell vertices = {size_[0] + 1, size_[1] + 1, size_[2] + 1};
  for (bool is_changed = true; is_changed;) {
    is_changed = false;
    for_each(vertices, [&](const Cell& vertex) { is_changed |= make_manifold_at(vertex); });
  }
  ShapeBuilder builder;
  double volume = 0, thickness = HUGE_VAL;
  for_each(size_, [&](const Cell& cell) {
    thickness = std::min({thickness, width(0, cell[0]), width(1, cell[1]), width(2, cell[2])});
    if (!is_full(cell[0], cell[1], cell[2])) return;
    volume += width(0, cell[0]) * width(1, cell[1]) * width(2, cell[2]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      Cell lower = cell, upper = cell;
      --lower[axis];
      ++upper[axis];
      if (cell[axis] == 0 || !is_full(lower[0], lower[1], lower[2]))
        add_face(builder, cell, axis, false);
      if (upper[axis] == size_[axis] || !is_full(upper[0], upper[1], upper[2]))
        add_face(builder, cell, axis, true);
    }
  });
  return {.shape = builder.take(), .thickness = thickness, .volume = volume};
}

}  // namespace locvol::sweeps
