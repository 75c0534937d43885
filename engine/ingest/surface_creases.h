// The creases of a surface: chains of edges where it turns sharply or its sheets meet.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "engine/ingest/crease_parts.h"
#include "engine/ingest/ingest_share.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "engine/shared/partial_file.h"
#include "engine/shared/workers.h"
#include "octree/leaf_surface.h"
#include "storage/records.h"

namespace locvol {

inline constexpr std::size_t kMaxCreases = 200'000;

struct CreaseLaw {
  double sharp_angle = 0;  // degrees; 0: there are no creases but of edges that are given
  // Edges within a sheet that hang together are noise if the diagonal of their box is less, or
  // their chains are shorter on average: a scan's are often many, in a small place, and bushy. So
  // are tips whose edges are shorter than a quarter of it, on average.
  double least_extent = 0;
  // Closer to each other on average (area of the surface over their length) creases are too many,
  // too: cells of this size cannot keep them apart.
  double least_distance = 0;
  // More creases, or corners, are noise: then there are none but of edges that are given, and a
  // note says so. More of these are refused, by InputError.
  std::size_t most = kMaxCreases;
};

// Over λ.
inline constexpr double kLeastCreaseExtent = 2, kLeastCreaseDistance = 0.05;
// What the cells of a surface's buckets have of its creases, in a nameless temporary file.
// Memory: 24 bytes a cell, 4 a part of a crease in a cell, 80 a crease and 32 a corner.
// Errors: as TriangleSpill.
class CreasesOfCells {
 public:
  explicit CreasesOfCells(std::filesystem::path directory) : directory_(std::move(directory)) {}

  // Adds creases and corners that meet the closed box of the i-th bucket's cell to its triangles.
  void add_to(std::size_t bucket, LeafSurface& surface) const;

  // ---- For those who find them
  // Of the i-th bucket. Once it has some, it may get fewer in their place.
  void put(std::size_t bucket, const CellCreases& creases);
  CellCreases load(std::size_t bucket) const;
  // What edges' parts are, and all corners, in order of name.
  void number(std::vector<CreaseId> of_part, std::vector<CreaseFacts> facts,
              std::vector<SurfaceCorner> corners);

 private:
  struct Place {
    std::uint64_t offset = 0, num_edges = 0, num_corners = 0;
  };

  std::filesystem::path directory_;
  std::optional<OpenFile> file_;
  std::uint64_t size_ = 0;
  std::vector<Place> places_;
  std::vector<CreaseId> of_part_;
  std::vector<CreaseFacts> facts_;
  std::vector<SurfaceCorner> corners_;
};

// Adds to what is known of the surface's sheets its creases: in the order of their first edges, as
// corners are in that of their first triangles. Of a surface without a hint of one nothing is
// looked at. REQUIRES: its sheets are numbered
// Memory: see CreasesOfCells; 100 bytes a part of a crease in a cell; what a cell takes for each
// thread. Throws InputError, std::system_error, Stopped.
CreasesOfCells find_creases(CheckedSurface& surface, const CreaseLaw& law, IngestWatch& watch,
                            Workers& workers, const IngestShare& share, SurfaceSheets& sheets);

}  // namespace locvol
