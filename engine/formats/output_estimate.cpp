#include "engine/formats/output_estimate.h"

#include <algorithm>
#include <cmath>

#include "engine/formats/output_bytes.h"

namespace locvol {
namespace {

constexpr double kHeadBytes = 1500;  // at most

}  // namespace

double OutputEstimate::disk_bytes() const {
  return std::max(bytes_before, file_bytes + bytes_beside);
}

OutputEstimate estimate_output(const OutputOptions& output, const MeshSizes& n) {
  constexpr double kId = 8, kListedFacet = 40, kFacet = 48, kQuality = 8;
  if (!std::isfinite(n.num_cells)) return {HUGE_VAL, HUGE_VAL, HUGE_VAL};
  OutputEstimate estimate;
  const FormatInfo& format = info_of(output.format);
  estimate.file_bytes = kHeadBytes + format.bytes(n, output);
  estimate.bytes_beside = kId * num_listed_vertices(n);
  const bool is_second = output.order == 2;
  if (is_second) {
    // While edges are found, also those of each leaf's cells, its own and others' apart.
    constexpr double kEdge = 16, kFoundEdge = 40;
    estimate.bytes_before = estimate.bytes_beside + kFoundEdge * num_listed_edges(n);
    estimate.bytes_beside += kEdge * num_listed_edges(n);
  }
  if (is_second || holds_boundary(output)) {
    const double f = n.num_boundary_facets, facets = kFacet * f;
    // Of second order, the facets' edges, and nodes off the middle; then these are kept.
    constexpr double kFacetEdges = 96, kNodes = 40, kKeptNodes = 48;
    const double nodes = is_second ? kNodes * num_boundary_edges(n) : 0;
    estimate.bytes_before =
        std::max(estimate.bytes_before,
                 estimate.bytes_beside + facets +
                     std::max(kListedFacet * f, is_second ? kFacetEdges * f + nodes : 0));
    estimate.bytes_beside += facets;
    if (is_second) estimate.bytes_beside += kKeptNodes * num_boundary_edges(n);
    if (holds_boundary(output)) estimate.bytes_beside += kId * num_boundary_vertices(n);
  }
  if (output.has_quality && output.format != MeshFormat::kVtu)
    estimate.bytes_beside += kQuality * n.num_cells;
  if (output.is_by_ranks && format.waits_for_its_place)
    estimate.bytes_beside += estimate.file_bytes;  // at most
  return estimate;
}

}  // namespace locvol
