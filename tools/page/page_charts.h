// The still figures of the page of `locvol report`, as SVG: they need no script.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/mesh_view.h"
#include "storage/records.h"

namespace locvol {

std::string html_text(std::string_view text);  // with &, <, > and " escaped

// Shares of the total on a logarithmic scale: the few worst cells are to be seen. `unit`: of the
// values.
std::string histogram_svg(const Histogram& histogram, std::string_view unit);
// A chart of how many leaves have each number.
std::string counts_svg(const std::map<std::uint64_t, std::uint64_t>& num_leaves_of,
                       std::string_view name);
// A chart of how many cells there are of sizes from 2 to each power to below twice that.
std::string octaves_svg(const std::map<int, std::uint64_t>& num_cells_by_octave);
// The run over its time of work: visits a second, memory, leaves that wait, cells, insertions.
// Empty unless there are two samples of different times.
std::string timeline_svg(const TimelineRecord& timeline);
// The octree and the surface cut at the middle of the model, across the axis.
std::string section_svg(const MeshView& view, const RunRecord& run, int axis);

}  // namespace locvol
