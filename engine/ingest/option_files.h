// The files that a run's options name.
#pragma once

#include "engine/plan/options.h"
#include "octree/geometry.h"
#include "octree/stop.h"
#include "storage/records.h"

namespace locvol {

// Reads all of them, and finds what tells them from others. `box`: around the surface. Throws
// InputError as survey_size_image() and read_polylines(), Stopped.
FilesOfOptions survey_files(const MeshOptions& options, const Box& box,
                            const StopToken* stop = nullptr);
// The same of a run that has begun.
FilesOfOptions survey_files(const RunRecord& run, const StopToken* stop = nullptr);

}  // namespace locvol
