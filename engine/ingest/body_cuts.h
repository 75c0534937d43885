// Cuts the triangles of different bodies along each other, so that they meet in vertices, edges and
// whole triangles alone.
//
// A cell finds which triangles meet in it. Each triangle is then cut by itself, along all that meet
// it: neighbors agree on their edges, and triangles that lie on each other on their pieces, for new
// points are functions of exact places alone (refine/domain/cut_triangle).
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/shared/workers.h"
#include "octree/geometry.h"

namespace locvol {

// Where bodies are cut along each other, ids count pieces: the number in the file, times this, and
// the piece's.
inline constexpr std::uint64_t kMostPieces = std::uint64_t{1} << 20;
inline std::uint64_t number_in_file(std::uint64_t id, bool has_pieces) {
  return has_pieces ? id / kMostPieces : id;
}

// Two of the bodies that are given, by their places, which have triangles that meet.
struct MeetingBodies {
  std::uint32_t one = 0, other = 0;  // one < other
  friend auto operator<=>(const MeetingBodies&, const MeetingBodies&) = default;
};
struct Meeting {
  std::array<std::uint64_t, 2> num_cut{};  // triangles of each
  std::optional<Point> place;              // a new vertex of the first that has one on both
};

// Why a triangle cannot be cut.
struct CutObstacle {
  enum class Kind {
    kMany,  // more than kMostCutters meet it, or it would become more than kMostPieces
    kThin,  // a piece of it would be thinner than rounding can tell, or the other one lies on it so
  };
  Kind kind = Kind::kMany;
  Triangle triangle;        // or the piece of it
  std::uint32_t other = 0;  // a body that is given, which meets it
  std::uint64_t num_cutters = 0;
  double width = 0;
};

// What is nearer than a distance is made the same, instead of cut (refine/domain/cut_triangle).
struct NearLaw {
  double distance = 0;       // 0: it is cut
  bool has_needles = false;  // triangles lower than that go, whatever they meet
};

struct CutSurface {
  TriangleList triangles = {};          // in order of id
  std::uint64_t num_cut = 0;            // triangles that became others; 0: all else is empty
  double widest = 0;                    // how far a new vertex is from the triangle that got it
  std::optional<CutObstacle> obstacle;  // to the first that has one: nothing is done
  std::map<MeetingBodies, Meeting> meetings = {};
};

// So many may meet one triangle.
inline constexpr std::uint64_t kMostCutters = 20'000;
// Of the largest coordinate: what is thinner comes from rounding.
inline constexpr double kLeastWidth = 1e-12;

// `buckets` have the surface, whole, in `spill`, with copies if `has_copies`; `box` is around it.
// `given`, not empty: see given_body(). Those that are closed together alone are one here, and not
// cut along each other. Afterwards ids are those of pieces, as they are before if
// `has_pieces`. If things are to be near, buckets are of a margin as wide. Memory: 24 MB, what a
// cell takes for each thread, and 4 KB for each that meets the triangles that are cut at once: up
// to kMostCutters for each thread. Throws std::system_error, Stopped.
CutSurface cut_bodies(TriangleSpill& spill, const TriangleBuckets& buckets, bool has_copies,
                      std::span<const std::uint32_t> given, const Box& box, bool has_pieces,
                      const NearLaw& near, IngestWatch& watch, Workers& workers);

}  // namespace locvol
