// Cells of second order: a tetrahedron with a node at the middle of each edge, or off it. Where its
// map from the straight cell is one to one.
#pragma once

#include <array>
#include <cstdint>

#include "engine/output/mesh_edge.h"
#include "octree/geometry.h"

namespace locvol {

// The determinant of the map's derivative, over that of the straight cell, is at least this in all
// of a cell whose nodes are off the middle.
inline constexpr double kLeastJacobian = 0.2;

// How far each node is off the middle of its edge, in the order of kCellEdges.
using NodeShifts = std::array<Point, 6>;

// A lower bound of that quotient: the least coefficient of the determinant, a polynomial of third
// degree, in Bernstein form. It is 1 if no node is off. REQUIRES: positively oriented
double least_jacobian(const std::array<Point, 4>& corners, const NodeShifts& shifts);

// Of the nodes that are off the middle, some that may stay so: with any of them back in the middle,
// least_jacobian() is kLeastJacobian or more. So who takes nodes back need not ask again about
// cells that allow them. As many as can be; a bit each, in the order of kCellEdges.
std::uint8_t allowed_nodes(const std::array<Point, 4>& corners, const NodeShifts& shifts);

}  // namespace locvol
