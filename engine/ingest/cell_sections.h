// Cells as VTK's files have them: lists of corners, and where each cell ends in it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "engine/ingest/input_file.h"
#include "engine/ingest/surface_sink.h"

namespace locvol {

// Cells of one kind, in the order of the file.
struct CellSection {
  enum class Kind { kOther, kPolygons, kStrips };

  Kind kind = Kind::kOther;  // cells that are no polygons count among the groups, and are left out
  std::uint64_t num_cells = 0;
  std::uint64_t num_corners = 0;  // of all of them
  // The next one's number of corners, and then each of them. kOther has neither.
  std::function<std::uint64_t()> next_length;
  std::function<std::uint64_t()> next_corner;
};

// Gives polygons, and the triangles of strips, to the sink. Corners count from `first_vertex` on,
// cells of polygons and strips from `first_face` on, for messages. `next_group` gives the integer
// of each cell that tells its group, of all kinds; null: there are none. A group is called after it
// and `group_name`. Throws InputError.
void give_cells(const InputFile& file, const CellSection& section, std::uint64_t first_vertex,
                std::uint64_t first_face, const std::function<std::int64_t()>& next_group,
                const std::string& group_name, SurfaceSink& sink);

}  // namespace locvol
