// A surface on disk of which holes are to be closed, as refine/winding asks for it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/shared/partial_file.h"
#include "engine/shared/workers.h"
#include "refine/winding/holes_alone.h"

namespace locvol {

// Pairs of triangles that have an edge in common, in a nameless temporary file. Throws
// std::system_error where the disk fails.
class EdgeFile {
 public:
  struct Pair {
    std::uint32_t first = 0, second = 0;
  };
  explicit EdgeFile(const std::filesystem::path& directory)
      : file_(OpenFile::temporary(directory / "locvol-edges")) {}

  void append(std::span<const Pair> pairs);
  void for_each(const std::function<void(std::uint32_t, std::uint32_t)>& visit) const;

 private:
  OpenFile file_;
  std::uint64_t num_ = 0;
};

// REQUIRES: ids count from 0 on, in the order of the lists
class SpilledTriangles : public PassingTriangles {
 public:
  SpilledTriangles(const TriangleSpill& spill, std::span<const TriangleList> lists)
      : spill_(spill), lists_(lists), edges_(spill.directory()) {}

  // Finds its edges, and those that are open, in the cells that have these triangles. None: there
  // is something else wrong than holes, or points are so near that they would be snapped.
  // `most_open`: more than so many open edges are also too many. Throws as TriangleSpill, Stopped.
  std::optional<std::vector<OpenSide>> find_edges(const TriangleBuckets& buckets, const Box& box,
                                                  std::uint64_t most_open, IngestWatch& watch,
                                                  Workers& workers);

  std::uint32_t num() const override;
  void for_each(
      const std::function<void(std::uint32_t, const Corners&, SheetId)>& visit) const override;
  void for_each_edge(
      const std::function<void(std::uint32_t, std::uint32_t)>& visit) const override {
    edges_.for_each(visit);
  }

 private:
  const TriangleSpill& spill_;
  std::span<const TriangleList> lists_;
  EdgeFile edges_;
};

}  // namespace locvol
