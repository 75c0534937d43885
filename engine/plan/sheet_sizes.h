// Which sheets of a surface the sizes are for that a user has given by names.
#pragma once

#include <vector>

#include "storage/records.h"

namespace locvol {

// By sheet, from id 1 on: the least size that is given for its name or its group's; infinite: none.
// Empty if none is given.
std::vector<double> sizes_by_sheet(const RunParameters& parameters, const SurfaceSheets& sheets);

// Throws InputError: no sheet has a name that a size is given for, and which names there are; or
// the size asks for more cells than a run can have.
void require_sized_sheets(const RunParameters& parameters, const SurfaceSheets& sheets);

}  // namespace locvol
