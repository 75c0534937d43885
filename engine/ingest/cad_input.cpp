#include "engine/ingest/cad_input.h"

#include <algorithm>

#include "engine/plan/run_setup.h"

namespace locvol {
namespace {

// Over λ and the deviation. With a hundredth of λ, triangles are as many as the mesh's facets where
// the surface is flat to λ/8 within λ, and the mesh's own distance from the surface is larger.
constexpr double kOfSize = 0.01, kOfDeviation = 0.2;
// Degrees: small circles have 18 edges, and no edge within a face is taken for a sharp one.
constexpr double kMostAngle = 20;
// Over the longest side of the box: λ, where none is given.
constexpr double kUsualSize = 0.01;

CadLaw law_for(double size, double deviation, double per_circle) {
  CadLaw law{kOfSize * size, kMostAngle};
  if (deviation > 0) law.deflection = std::min(law.deflection, kOfDeviation * deviation);
  if (per_circle > 0) law.angle_degrees = std::min(law.angle_degrees, 180 / per_circle);
  return law;
}

// What is flat has no percentages: it bounds no volume, which is told once it is read.
void make_length(Size& size, const Box& box) {
  const Point sides = box.max - box.min;
  if (size.is_percent && size.value > 0 && std::min({sides.x, sides.y, sides.z}) > 0)
    size = Size::length(absolute_size(size, box));
}

// What is wrapped is one body, and paper mode knows one.
bool may_have_bodies(InsideRule inside, Initialization init) {
  return inside != InsideRule::kWrap && init == Initialization::kCover;
}

double usual_size(const Box& box) { return kUsualSize * max_norm(box.max - box.min); }

}  // namespace

void settle_faces(const SurfaceSource& source, MeshOptions& options, std::uint64_t cap,
                  const StopToken* stop) {
  const auto curved = source.curved(cap, stop);
  if (!curved) return;
  make_length(options.size, curved->box);
  make_length(options.deviation, curved->box);
  const bool has_length = options.size.value > 0 && !options.size.is_percent;
  double least = has_length ? options.size.value : usual_size(curved->box);
  const auto take = [&](Size& size) {
    make_length(size, curved->box);
    if (size.value > 0 && !size.is_percent) least = std::min(least, size.value);
  };
  for (SizedPart& sheet : options.sheets) take(sheet.size);
  for (SizedPart& body : options.bodies) take(body.size);
  for (SizedShape& shape : options.shapes) take(shape.size);
  const bool has_bodies = may_have_bodies(options.inside, options.init);
  if (options.more_inputs.empty()) options.has_bodies = has_bodies && curved->num_bodies > 1;
  source.cut_faces({law_for(least, options.deviation.value, options.per_circle), has_bodies});
}

void cut_faces_for(const SurfaceSource& source, const RunParameters& run, std::uint64_t cap,
                   const StopToken* stop) {
  if (!source.curved(cap, stop)) return;
  double least = run.size;
  for (const PartSize& sheet : run.sheet_sizes) least = std::min(least, sheet.size);
  for (const PartSize& body : run.body_sizes) least = std::min(least, body.size);
  for (const SizeShape& shape : run.shapes) least = std::min(least, shape.size);
  source.cut_faces(
      {law_for(least, run.deviation, run.per_circle), may_have_bodies(run.inside, run.init)});
}

}  // namespace locvol
