#include "engine/ingest/option_files.h"

#include <filesystem>

#include "engine/ingest/image_sizes.h"
#include "engine/ingest/polyline_file.h"

namespace locvol {
namespace {

FilesOfOptions survey(const std::filesystem::path& image, const std::filesystem::path& polylines,
                      const Box& box, const StopToken* stop) {
  return {.image = survey_size_image(image, box, stop),
          .sharp_polylines = survey_polylines(polylines, stop)};
}

}  // namespace

FilesOfOptions survey_files(const MeshOptions& options, const Box& box, const StopToken* stop) {
  return survey(options.size_image, options.sharp_polylines, box, stop);
}

FilesOfOptions survey_files(const RunRecord& run, const StopToken* stop) {
  return survey(run.image_file, run.sharp_file, run.surface.box, stop);
}

}  // namespace locvol
