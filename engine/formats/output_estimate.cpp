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
  if (holds_boundary(output)) {
    const double facets = kFacet * n.num_boundary_facets;
    estimate.bytes_before = estimate.bytes_beside + kListedFacet * n.num_boundary_facets + facets;
    estimate.bytes_beside += facets + kId * num_boundary_vertices(n);
  }
  if (output.has_quality && output.format != MeshFormat::kVtu)
    estimate.bytes_beside += kQuality * n.num_cells;
  if (output.is_by_ranks && format.waits_for_its_place)
    estimate.bytes_beside += estimate.file_bytes;  // at most
  return estimate;
}

}  // namespace locvol
