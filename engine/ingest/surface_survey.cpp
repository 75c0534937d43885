#include "engine/ingest/surface_survey.h"

#include <utility>

#include "engine/ingest/sheet_plan.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_sheets.h"
#include "engine/plan/run_estimate.h"
#include "engine/plan/run_setup.h"

namespace locvol {

SurveyedSurface survey_surface(const SurfaceSource& source, const std::filesystem::path& directory,
                               IngestWatch& watch, Workers& workers, const SurveyLaw& law) {
  RawSurface raw = read_surface(source, directory, watch);
  SurveyedSurface survey;
  survey.digest = raw.digest;
  const Frame frame = frame_of(raw.box);
  const std::optional<double> weld = weld_length(law.weld, raw.box);
  CheckedSurface surface = check_surface(std::move(raw), frame, watch, workers, kBucketCapacity,
                                         IngestShare(), weld, law.sharp_angle.value_or(0));
  if (law.sharp_angle) {
    const double size =
        law.size ? absolute_size(*law.size, surface.facts.box) : default_size(surface.facts);
    survey.sheets = number_sheets(
        surface, {.sharp_angle = *law.sharp_angle, .least_area = kLeastSheetArea * size * size},
        watch, workers, IngestShare());
  }
  survey.facts = std::move(surface.facts);
  return survey;
}

}  // namespace locvol
