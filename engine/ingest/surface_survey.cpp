#include "engine/ingest/surface_survey.h"

#include <utility>
#include <vector>

#include "engine/ingest/cad_input.h"
#include "engine/ingest/cured_surface.h"
#include "engine/ingest/polyline_edges.h"
#include "engine/ingest/polyline_file.h"
#include "engine/ingest/sheet_plan.h"
#include "engine/ingest/surface_bodies.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_sheets.h"
#include "engine/plan/run_setup.h"

namespace locvol {
namespace {

// See settle_faces(); what a survey is not asked has no influence on the faces.
void settle_faces(const SurfaceSource& source, SurveyLaw& law, const StopToken* stop) {
  MeshOptions options;
  options.size = law.size.value_or(Size{});
  options.inside = law.inside;
  settle_faces(source, options, law.memory_cap, stop);
  if (law.size) law.size = options.size;
  law.bodies.has_bodies |= options.has_bodies && !law.bodies.has_files;
}

}  // namespace

SurveyedSurface survey_surface(const SurfaceSource& given, const std::filesystem::path& directory,
                               IngestWatch& watch, Workers& workers, const SurveyLaw& asked) {
  SurveyLaw law = asked;
  const SurfaceSource source = source_to_mesh(
      given, law.inside, {law.wrap_alpha, law.wrap_offset, law.memory_cap}, directory);
  settle_faces(source, law, watch.stop());
  RawSurface raw = read_surface(source, directory, watch);
  SurveyedSurface survey;
  survey.digest = raw.digest;
  const Frame frame = frame_of(raw.box);
  const std::optional<double> weld = weld_length(law.weld, raw.box);
  const double gap = gap_length(law.gap, raw.box);
  raw.has_several_bodies = law.bodies.has_several();
  // Of a size that is not given, the surface decides; around holes something has to be taken.
  constexpr double kUsual = 0.01;
  const double spacing =
      law.size ? absolute_size(*law.size, raw.box) : kUsual * max_norm(raw.box.max - raw.box.min);
  CheckedSurface surface =
      check_surface(std::move(raw), frame, watch, workers, kBucketCapacity, IngestShare(), weld,
                    law.sharp_angle, gap, {law.inside, spacing, law.memory_cap});
  std::vector<BodyFacts> bodies;
  if (law.has_sheets) bodies = number_bodies(surface, law.bodies, watch, workers);
  find_given_edges(surface,
                   {law.sharp_polylines, survey_polylines(law.sharp_polylines, watch.stop()), weld},
                   watch, workers, IngestShare());
  survey.has_sharp_edges = surface.sharp.num_edges > 0 || surface.given.is_given();
  survey.facts = surface.facts;
  if (law.has_sheets) {
    const double size =
        law.size ? absolute_size(*law.size, surface.facts.box) : survey.default_size();
    survey.sheets = number_sheets(
        surface, SheetLaw::of_size(size, law.sharp_angle, MeshOptions{}.spacing_floor), watch,
        workers, IngestShare());
    survey.sheets.bodies = std::move(bodies);
  }
  survey.facts = std::move(surface.facts);
  return survey;
}

}  // namespace locvol
