// Which sheets of a surface, and which bodies, the sizes are for that a user has given by names.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "storage/records.h"

namespace locvol {

// Of the name "near 1,2,3" (or with blanks between the numbers), the place; nothing: it is a name,
// or an id ("#7").
std::optional<Point> place_meant_by(const std::string& name);

// By sheet, from id 1 on: the least size that is given for its name, its group's, or that of a body
// which it bounds; infinite: none. Empty if none is given.
std::vector<double> sizes_by_sheet(const RunParameters& parameters, const SurfaceSheets& sheets);

// By body, from id 1 on: what h is at most in all of it; infinite: nothing is asked. Empty if
// nothing is: no size is given for a body, or sizes grow beyond λ, inside of bodies, too.
std::vector<double> sizes_throughout_bodies(const RunParameters& parameters,
                                            const SurfaceSheets& sheets);

// Throws InputError: no sheet, or no body, has a name that a size is given for, and which names
// there are; or the size asks for more cells than a run can have.
void require_sized_parts(const RunParameters& parameters, const SurfaceSheets& sheets);

}  // namespace locvol
