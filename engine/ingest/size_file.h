// A file of shapes, sheets and bodies at which cells are to be smaller (`--sizes`), as text or as
// JSON.
//
//   # one shape a line: its kind, its size, and where it is
//   point  SIZE  X Y Z
//   ball   SIZE  X Y Z  RADIUS
//   box    SIZE  X Y Z  X Y Z          two opposite corners
//   line   SIZE  X Y Z  X Y Z  ...     two points or more, joined by segments
//   sheet  SIZE  NAME                  a sheet of the surface, or all sheets of a group; or #7,
//                                      its id, or near X,Y,Z, the closest to a place
//   body   SIZE  NAME                  one of several bodies
//
//   {"shapes": [{"kind": "point", "size": 0.1, "points": [[0, 0, 0]]},
//               {"kind": "ball", "size": "1%", "points": [[0, 0, 0]], "radius": 2},
//               {"kind": "box", "size": 0.1, "points": [[0, 0, 0], [1, 1, 1]]},
//               {"kind": "line", "size": 0.1, "points": [[0, 0, 0], [1, 1, 1], [2, 1, 1]]},
//               {"kind": "sheet", "size": 0.1, "name": "inlet"},
//               {"kind": "body", "size": 0.1, "name": "rotor"}]}
//
// A size is a length in the units of the coordinates, or a percentage of the smallest side of the
// surface's bounding box.
#pragma once

#include <filesystem>
#include <vector>

#include "engine/plan/options.h"

namespace locvol {

struct GivenSizes {
  std::vector<SizedShape> shapes;
  std::vector<SizedPart> sheets, bodies;
};

// Throws InputError, naming the line or the shape: a size or a radius that is not above 0 (below
// 0), no finite number, too many or too few of them, an unknown kind, no shape at all.
GivenSizes read_size_file(const std::filesystem::path& path);

}  // namespace locvol
