// What a run has to settle before the faces of a CAD file are cut into triangles for it.
#pragma once

#include <cstdint>

#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"

namespace locvol {

// Of a source with curved faces: makes lengths of the sizes in `options` that are percentages and
// that faces are cut by, so that triangles and sizes are a function of the same numbers; lets each
// of several bodies be one; and settles how faces are cut. A size of 0 is one that is to be chosen.
// Nothing of a source of triangles. `cap`: on the memory of the process. Throws InputError,
// OverBudget, Stopped.
void settle_faces(const SurfaceSource& source, MeshOptions& options, std::uint64_t cap,
                  const StopToken* stop);
// As they were for a run that began: settle_faces() gave its parameters.
void cut_faces_for(const SurfaceSource& source, const RunParameters& run, std::uint64_t cap,
                   const StopToken* stop);

}  // namespace locvol
