// What formats call the sheets, creases and corners of a mesh.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "storage/records.h"

namespace locvol {

struct NameRule {
  std::size_t most_bytes = 255;
  std::string_view forbidden = {};  // characters that become underscores
  // Letters of ASCII, digits and underscores alone, a letter first; case does not tell names apart.
  bool is_identifier = false;
  std::vector<std::string> taken = {};  // by others
};

// By sheet, all different: a name that is taken ends in _2, _3, ... A mesh that is one sheet
// without a name has "boundary".
std::vector<std::string> names_of_sheets(const SurfaceSheets& sheets, const NameRule& rule);

// Has the sheet's group a name in the file?
bool has_name(const SurfaceSheets& sheets, SheetId sheet);

// By crease: "inlet/wall" between two sheets whose groups have names in the file, of several
// between the same two "inlet/wall_1", "inlet/wall_2", ...; other ones are "crease 12", by id.
std::vector<std::string> crease_names(const SurfaceSheets& sheets);

// Of all, by id, with none twice. Corners are "corner 5"; a single body is "volume".
struct MeshNames {
  std::vector<std::string> bodies, sheets, creases, corners;
};
// Bodies are named first. `has_creases`: else without the last two.
MeshNames names_of_mesh(const SurfaceSheets& sheets, bool has_creases, const NameRule& rule);

}  // namespace locvol
