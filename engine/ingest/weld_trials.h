// WeldTrials finds out what joining points would make of a surface that is not closed.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_weld.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/shared/workers.h"
#include "octree/geometry.h"

namespace locvol {

// What is wrong with joining these points, said of "joining them": a row of points would become
// one, or it takes too much. Empty: nothing.
std::string obstacle_to(const WeldedSurface& welded);

class WeldTrials {
 public:
  // `buckets` have the surface, whole, in `spill`; `box` is around it. The surface stays as it is.
  // `given`, which must outlive this: see check_cells()
  WeldTrials(TriangleSpill& spill, const TriangleBuckets& buckets, const Box& box,
             std::span<const std::uint32_t> given, IngestWatch& watch, Workers& workers);

  // The surface with as few points joined as close it, and those at open edges alone: points closer
  // than a tenth of all edges there but for those that are shorter than a distance, and than
  // kMostJoined of the longest side of the box. If there is none, tried() says why.
  // REQUIRES: it is not closed
  std::optional<WeldedSurface> closed_surface();
  // Sentences for the message of a surface that stays open: what was tried; and which distance
  // would close it, or what larger ones would leave, if they join any points. cure() takes time.
  std::string tried() const { return tried_; }
  std::string cure();

  static constexpr double kMostJoined = 1e-6;

 private:
  struct Trial {
    WeldedSurface surface;
    std::string flaw;
  };
  std::optional<Trial> trial(double distance, WeldPoints points, CheckScope scope);
  std::string length_that_closes(double distance, std::string& in_vain);
  std::string flaw_of(WeldedSurface& surface, CheckScope scope);

  TriangleSpill& spill_;
  const TriangleBuckets& buckets_;
  Box box_;
  std::span<const std::uint32_t> given_;
  IngestWatch& watch_;
  Workers& workers_;
  double extent_;  // the longest side of the box
  std::string tried_;
};

}  // namespace locvol
