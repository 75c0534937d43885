#include "engine/formats/output_estimate.h"

#include <algorithm>
#include <cmath>

#include "engine/formats/limits.h"

namespace locvol {
namespace {

constexpr double kHeadBytes = 1500;        // at most
constexpr double kCellsPerCoreVertex = 6;  // of the BCC lattice

// A number from 1 to n as text, on average: all have a last digit, those from 10 on another one.
double label_bytes(double n) {
  double all = 0;
  for (double least = 1; least <= n; least *= 10) all += n - least + 1;
  return n >= 1 ? all / n : 1;
}

// The part of the numbers from low to high that lies from `from` to `to`.
double part_between(double low, double high, double from, double to) {
  if (!(high > low)) return low >= from && low <= to ? 1 : 0;
  return std::max(0.0, std::min(high, to) - std::max(low, from)) / (high - low);
}

// A number from low to high as the shortest text that reads back the same, on average: digits and a
// point, a sign, and zeros after the point; below 0.0001 an exponent is as long.
double coordinate_bytes(double low, double high) {
  constexpr double kDigits = 17.4;
  double bytes = kDigits + part_between(low, high, -HUGE_VAL, 0);
  for (const double t : {1.0, 0.1, 0.01, 0.001}) bytes += part_between(low, high, -t, t);
  return bytes;
}

// A vertex as three of them, each after a separator. `most`: bytes of one
double position_bytes(const Box& box, double separator, double most = HUGE_VAL) {
  double bytes = 0;
  for (int axis = 0; axis < 3; ++axis)
    bytes += separator + std::min(coordinate_bytes(box.min[axis], box.max[axis]), most);
  return bytes;
}

// Of one of VTK's whole numbers up to `largest`.
double index_bytes(double largest) { return largest > kMaxInt32 ? 8 : 4; }

double num_core_cells(const MeshSizes& n) { return n.num_cells - n.num_listed_cells; }
double num_listed_vertices(const MeshSizes& n) {
  return std::max(0.0, n.num_vertices - num_core_cells(n) / kCellsPerCoreVertex);
}

// Of files compressed at level 1: bytes of vertices and cells that are listed, and of a cell of the
// core with its share of the vertices, which all follow a pattern.
struct Compressed {
  double head, vertex, cell, core_cell;
  double quality_of_cell;  // that of the core's cells is the same for all

  double bytes(const MeshSizes& n, bool has_quality) const {
    const double of_cell = cell + (has_quality ? quality_of_cell : 0);
    return head + vertex * num_listed_vertices(n) + of_cell * n.num_listed_cells +
           core_cell * num_core_cells(n);
  }
};
constexpr Compressed kZlib = {0, 38, 2.7, 8.4, 6.1}, kShuffled = {14e3, 14.3, 6.8, 6.6, 5.4};

// A boundary that closes has half as many vertices as facets.
double num_boundary_vertices(const MeshSizes& n) { return 0.5 * n.num_boundary_facets; }

// Constants are bytes of values or, of text, of what stands between numbers.
double file_bytes(const OutputOptions& output, const MeshSizes& n) {
  const double v = n.num_vertices, c = n.num_cells, f = n.num_boundary_facets;
  const double vertex_label = label_bytes(v), cell_label = label_bytes(c);
  switch (output.format) {
    case MeshFormat::kVtu:
      return 24 * v + (4 * index_bytes(v) + index_bytes(4 * c) + (output.has_quality ? 13 : 5)) * c;
    case MeshFormat::kVtuZlib:
      return kZlib.bytes(n, output.has_quality);
    case MeshFormat::kVtkHdf:
      return kShuffled.bytes(n, output.has_quality);
    case MeshFormat::kMsh4:
      return 32 * v + 40 * c + 32 * f;
    case MeshFormat::kMsh2:
      return 28 * v + 28 * c + 24 * f;
    case MeshFormat::kMedit:
      return (position_bytes(n.box, 1) + 2) * v + (4 * (vertex_label + 1) + 2) * c +
             (3 * (vertex_label + 1) + 2) * f;
    case MeshFormat::kMeditBinary:
      return c > kMaxInt32 ? 32 * v + 40 * c + 32 * f : 28 * v + 20 * c + 16 * f;
    case MeshFormat::kAbaqus:
      return (vertex_label + position_bytes(n.box, 2, 20) + 1) * v +
             (cell_label + 4 * (vertex_label + 2) + 1) * c +
             (vertex_label + 2) * num_boundary_vertices(n) + (cell_label + 5) * f;
    case MeshFormat::kTetgen:
      return (vertex_label + position_bytes(n.box, 1) + 1) * v +
             (cell_label + 4 * (vertex_label + 1) + 1) * c;
    case MeshFormat::kStl:
      return 50 * f;
    case MeshFormat::kPly:
      return 24 * num_boundary_vertices(n) + 13 * f;
    case MeshFormat::kObj:
      return (2 + position_bytes(n.box, 1)) * num_boundary_vertices(n) +
             (2 + 3 * (label_bytes(num_boundary_vertices(n)) + 1)) * f;
  }
  return 0;
}

// What has no known place in a file that several processes write: see AppendedFile.
bool waits_for_its_place(MeshFormat format) {
  switch (format) {
    case MeshFormat::kVtuZlib:
    case MeshFormat::kVtkHdf:
    case MeshFormat::kMedit:
    case MeshFormat::kAbaqus:
    case MeshFormat::kTetgen:
    case MeshFormat::kObj:
      return true;
    default:
      return false;
  }
}

}  // namespace

double OutputEstimate::disk_bytes() const {
  return std::max(bytes_before, file_bytes + bytes_beside);
}

OutputEstimate estimate_output(const OutputOptions& output, const MeshSizes& n) {
  constexpr double kId = 8, kListedFacet = 40, kFacet = 48, kQuality = 8;
  if (!std::isfinite(n.num_cells)) return {HUGE_VAL, HUGE_VAL, HUGE_VAL};
  OutputEstimate estimate;
  estimate.file_bytes = kHeadBytes + file_bytes(output, n);
  estimate.bytes_beside = kId * num_listed_vertices(n);
  if (has_boundary(output.format)) {
    const double facets = kFacet * n.num_boundary_facets;
    estimate.bytes_before = estimate.bytes_beside + kListedFacet * n.num_boundary_facets + facets;
    estimate.bytes_beside += facets + kId * num_boundary_vertices(n);
  }
  if (output.has_quality && output.format != MeshFormat::kVtu)
    estimate.bytes_beside += kQuality * n.num_cells;
  if (output.is_by_ranks && waits_for_its_place(output.format))
    estimate.bytes_beside += estimate.file_bytes;  // at most
  return estimate;
}

}  // namespace locvol
