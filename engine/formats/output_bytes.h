// What numbers take in a file, on average, as text or compressed: for estimates.
#pragma once

#include <algorithm>
#include <cmath>

#include "engine/formats/limits.h"
#include "engine/formats/mesh_sizes.h"
#include "engine/formats/output_options.h"

namespace locvol {

inline constexpr double kCellsPerCoreVertex = 6;  // of the BCC lattice

// A number from 1 to n as text, on average: all have a last digit, those from 10 on another one.
inline double label_bytes(double n) {
  double all = 0;
  for (double least = 1; least <= n; least *= 10) all += n - least + 1;
  return n >= 1 ? all / n : 1;
}

// The part of the numbers from low to high that lies from `from` to `to`.
inline double part_between(double low, double high, double from, double to) {
  if (!(high > low)) return low >= from && low <= to ? 1 : 0;
  return std::max(0.0, std::min(high, to) - std::max(low, from)) / (high - low);
}

// A number from low to high as the shortest text that reads back the same, on average: digits and a
// point, a sign, and zeros after the point; below 0.0001 an exponent is as long.
inline double coordinate_bytes(double low, double high) {
  constexpr double kDigits = 17.4;
  double bytes = kDigits + part_between(low, high, -HUGE_VAL, 0);
  for (const double t : {1.0, 0.1, 0.01, 0.001}) bytes += part_between(low, high, -t, t);
  return bytes;
}

// A vertex as three of them, each after a separator. `most`: bytes of one
inline double position_bytes(const Box& box, double separator, double most = HUGE_VAL) {
  double bytes = 0;
  for (int axis = 0; axis < 3; ++axis)
    bytes += separator + std::min(coordinate_bytes(box.min[axis], box.max[axis]), most);
  return bytes;
}

// Of one of VTK's whole numbers up to `largest`.
inline double index_bytes(double largest) { return largest > kMaxInt32 ? 8 : 4; }

// What second order has more of.
inline double num_points(const MeshSizes& n, const OutputOptions& output) {
  return n.num_vertices + (output.order == 2 ? n.num_nodes() : 0);
}
inline double corners_of_cell(const OutputOptions& output) {
  return static_cast<double>(num_corners_of_cell(output.order));
}
inline double corners_of_facet(const OutputOptions& output) {
  return static_cast<double>(num_corners_of_facet(output.order));
}

inline double num_core_cells(const MeshSizes& n) { return n.num_cells - n.num_listed_cells; }
inline double num_listed_vertices(const MeshSizes& n) {
  return std::max(0.0, n.num_vertices - num_core_cells(n) / kCellsPerCoreVertex);
}

// Of files compressed at level 1: bytes of vertices and cells that are listed, and of a cell of the
// core with its share of the vertices, which all follow a pattern.
struct Compressed {
  double head, vertex, cell, core_cell;
  double quality_of_cell;  // that of the core's cells is the same for all
  double facet;
  // Of second order, with the nodes: of a listed cell, of one of the core, and of a facet more.
  double second_of_cell, second_of_core_cell, second_of_facet;

  double bytes(const MeshSizes& n, const OutputOptions& output) const {
    const bool is_second = output.order == 2;
    const double of_cell =
        cell + (output.has_quality ? quality_of_cell : 0) + (is_second ? second_of_cell : 0);
    const double of_core_cell = core_cell + (is_second ? second_of_core_cell : 0);
    const double of_facet = facet + (is_second ? second_of_facet : 0);
    return head + vertex * num_listed_vertices(n) + of_cell * n.num_listed_cells +
           of_core_cell * num_core_cells(n) +
           (output.has_boundary ? of_facet : 0) * n.num_boundary_facets;
  }
};
inline constexpr Compressed kZlib = {0, 38, 2.7, 8.4, 6.1, 6.5, 36.8, 31.3, 6.4},
                            kShuffled = {14e3, 14.3, 6.8, 6.6, 5.4, 4.2, 33.2, 28.8, 4.1};

// The number of a vertex or node, on average over the corners of cells: those of vertices are
// shorter.
inline double label_bytes_of_points(const MeshSizes& n, const OutputOptions& output) {
  const double of_vertices = label_bytes(n.num_vertices);
  if (output.order == 1 || !(n.num_nodes() > 0)) return of_vertices;
  const double all = num_points(n, output);
  const double of_nodes = (all * label_bytes(all) - n.num_vertices * of_vertices) / n.num_nodes();
  return 0.4 * of_vertices + 0.6 * of_nodes;
}

// Those that are not of two vertices of the core: there, a vertex has half of its 14.
inline double num_listed_edges(const MeshSizes& n) {
  return std::max(0.0, n.num_nodes() - 7 * num_core_cells(n) / kCellsPerCoreVertex);
}

// A boundary that closes has half as many vertices as facets, and three edges to two.
inline double num_boundary_edges(const MeshSizes& n) { return 1.5 * n.num_boundary_facets; }
inline double num_boundary_vertices(const MeshSizes& n) { return 0.5 * n.num_boundary_facets; }

}  // namespace locvol
