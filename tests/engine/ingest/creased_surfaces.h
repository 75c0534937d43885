// The creases of a surface that is taken in, as the leaves of a run would have them.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/ingest/polyline_edges.h"
#include "engine/ingest/polyline_file.h"
#include "engine/ingest/surface_creases.h"
#include "engine/ingest/surface_sheets.h"
#include "refine/domain/surface_part.h"

namespace locvol {

struct Creased {
  SurfaceSheets sheets;
  LeafSurface surface;  // all of it
  std::vector<std::string> notes;
};

struct CreaseTrial {
  double sharp_angle = 40, least_area = 0, least_extent = 0, least_distance = 0;
  std::uint64_t bucket_capacity = kBucketCapacity;
  int num_threads = 1;
  std::size_t most = kMaxCreases;
  std::filesystem::path polylines = {};  // whose edges are sharp, too
  std::string digest = {};               // of these; empty: as they are
  WindingLaw winding = {};
  double least_width = 0;
};

// Each cell has to have just the edges and corners that meet it.
inline void expect_in_cells(const LeafSurface& all, const Box& cell, const LeafSurface& held) {
  LeafSurface expected{held.triangles};
  append_creases(cell, all, expected);
  EXPECT_EQ(held, expected);
}

inline Creased creases_in(const std::filesystem::path& file, const CreaseTrial& trial = {}) {
  IngestWatch watch;
  Workers workers(trial.num_threads);
  RawSurface raw = read_surface(file, std::filesystem::temp_directory_path(), watch);
  const Frame frame = frame_of(raw.box);
  CheckedSurface surface =
      check_surface(std::move(raw), frame, watch, workers, trial.bucket_capacity, IngestShare(),
                    std::nullopt, trial.sharp_angle, 0, trial.winding);
  const std::string digest =
      trial.digest.empty() ? survey_polylines(trial.polylines) : trial.digest;
  find_given_edges(surface, {trial.polylines, digest}, watch, workers, IngestShare());
  Creased found;
  found.sheets = number_sheets(surface, {trial.sharp_angle, trial.least_area, trial.least_width},
                               watch, workers, IngestShare());
  const CreasesOfCells creases = find_creases(
      surface, {trial.sharp_angle, trial.least_extent, trial.least_distance, trial.most}, watch,
      workers, IngestShare(), found.sheets);
  std::vector<LeafSurface> of_cells;
  const auto buckets = surface.buckets.all();
  for (std::size_t i = 0; i < buckets.size(); ++i) {
    LeafSurface& held = of_cells.emplace_back(LeafSurface{surface.load(buckets[i])});
    creases.add_to(i, held);
    found.surface.append(held);
  }
  found.surface.unite();
  for (std::size_t i = 0; i < buckets.size(); ++i)
    expect_in_cells(found.surface, frame.box(buckets[i].cell), of_cells[i]);
  found.notes = surface.facts.notes;
  return found;
}

}  // namespace locvol
