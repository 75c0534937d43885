// What can be known of a surface without a run.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"
#include "engine/plan/run_estimate.h"
#include "engine/shared/workers.h"
#include "storage/records.h"

namespace locvol {

struct SurveyLaw {
  std::optional<Size> weld = {};               // see Options
  double sharp_angle = 0;                      // see Options
  std::filesystem::path sharp_polylines = {};  // see Options
  bool has_sheets = false;                     // are asked for
  std::optional<Size> size = {};               // absent: default_size(), if sheets are asked for
  BodyLaw bodies = {};                         // looked for if sheets are asked for
  Size gap = {};                               // see Options
  InsideRule inside = InsideRule::kClosed;
  Size wrap_alpha = {}, wrap_offset = {};  // see Options
  std::uint64_t memory_cap = 0;
};

struct SurveyedSurface {
  SurfaceFacts facts;
  SurfaceSheets sheets;  // that a run of this size and angle would have
  std::string digest;
  bool has_sharp_edges = false;  // of which some may be noise, at some sizes

  double default_size() const { return locvol::default_size(facts, has_sharp_edges); }
};

// Reads and checks it; of it, nothing stays. Throws as read_surface() and check_surface().
SurveyedSurface survey_surface(const SurfaceSource& source, const std::filesystem::path& directory,
                               IngestWatch& watch, Workers& workers, const SurveyLaw& law);

}  // namespace locvol
