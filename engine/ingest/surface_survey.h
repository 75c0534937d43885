// What can be known of a surface without a run.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"
#include "engine/shared/workers.h"
#include "storage/records.h"

namespace locvol {

struct SurveyLaw {
  std::optional<Size> weld = {};           // see Options
  std::optional<double> sharp_angle = {};  // absent: sheets are not asked for
  std::optional<Size> size = {};           // absent: default_size(), if sheets are asked for
};

struct SurveyedSurface {
  SurfaceFacts facts;
  SurfaceSheets sheets;  // that a run of this size and angle would have
  std::string digest;
};

// Reads and checks it; of it, nothing stays. Throws as read_surface() and check_surface().
SurveyedSurface survey_surface(const SurfaceSource& source, const std::filesystem::path& directory,
                               IngestWatch& watch, Workers& workers, const SurveyLaw& law);

}  // namespace locvol
