// Reads a surface of any size, repairs what is unambiguous, and refuses what bounds no
// volume.
//
//   source ──read_surface()──> RawSurface ──check_surface()──> CheckedSurface
//
// Both hold their triangles in temporary files. Vertices are what their coordinates are: corners at
// one place are one vertex.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/body_cuts.h"
#include "engine/ingest/given_edges.h"
#include "engine/ingest/ingest_share.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/sharp_edges.h"
#include "engine/ingest/sheet_plan.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_ranges.h"
#include "engine/ingest/surface_source.h"
#include "engine/ingest/triangle_buckets.h"
#include "engine/ingest/triangle_spill.h"
#include "engine/ingest/wall_probes.h"
#include "engine/plan/disk_room.h"
#include "engine/plan/options.h"
#include "engine/shared/input_error.h"
#include "engine/shared/workers.h"
#include "octree/frame.h"
#include "octree/geometry.h"
#include "storage/records.h"

namespace locvol {

// How the surface of what triangles wind around is found (refine/winding), where they are no
// surface that encloses something.
struct WindingLaw {
  InsideRule inside = InsideRule::kClosed;
  double spacing = 0;     // of vertices over wide holes
  std::uint64_t cap = 0;  // of memory
};

// Of bodies, in notes.
inline constexpr std::size_t kMostToldPairs = 20;

// One of several files, each of which is a body.
struct SurfaceFile {
  std::string body, file;
  std::uint64_t first_triangle = 0;
};

// What is taken for a body.
struct BodyLaw {
  bool has_bodies = false;  // RunParameters's
  std::vector<std::string> voids = {};
  bool has_files = false;  // several
  bool has_several() const { return has_bodies || has_files; }
};
// `num_more`: files beside the first
inline BodyLaw body_law(bool has_bodies, std::vector<std::string> voids, std::size_t num_more) {
  return {.has_bodies = has_bodies, .voids = std::move(voids), .has_files = num_more > 0};
}

// What a source gives: polygons are cut into triangles, those with two equal corners are left out,
// and no coordinate is -0.0. Ids count in its order.
struct RawSurface {
  explicit RawSurface(const std::filesystem::path& directory) : spill(directory) {}

  std::uint64_t num_triangles() const {
    std::uint64_t num = 0;
    for (const TriangleList& list : triangles) num += list.count;
    return num;
  }

  std::string file;    // SurfaceSource::name
  std::string digest;  // of SurfaceSource
  Box box;
  TriangleSpill spill;
  std::vector<TriangleList> triangles;      // one after another, in order of id
  std::uint64_t num_numbered_vertices = 0;  // of formats whose faces name their vertices
  std::uint64_t num_collapsed = 0;          // triangles left out
  std::vector<Triangle> collinear;          // those without area, in order of id
  std::vector<std::string> notes;           // of what is odd in the file
  // Names of groups of triangles, in the order of their first ones: the first is that of triangles
  // with Triangle::sheet 1. Triangles of no name are a group with an empty one.
  std::vector<std::string> groups;
  std::map<std::string, Color> colors;       // of groups that have one, by name
  std::vector<WallProbe> probes;             // of all triangles
  std::vector<SurfaceFile> files;            // where there are several
  std::vector<std::uint32_t> file_of_group;  // by group
  double precision = 0;                      // see SurfaceSink
  bool has_several_bodies = false;           // is that asked for? Then sides are no material's
  bool has_pieces = false;                   // see CheckedSurface

  // Files are bodies; of one file, its groups. Empty: there is one of these, or one is asked for.
  GivenBodies given_bodies() const;
};

// Files are STL (binary, ASCII), OBJ, OFF, PLY (ASCII, both byte orders), told apart by content
// first, then by extension. Temporary files are made in `directory`, which must exist.
// Memory: 25 MB for the vertices of files that number them; 16 MB for triangles without area.
// Throws InputError, also for what is empty or cannot be told apart in double arithmetic, or is too
// much for the disk: before anything is written if the file says how much it holds;
// std::system_error where the disk fails; IngestStopped.
RawSurface read_surface(const SurfaceSource& source, const std::filesystem::path& directory,
                        IngestWatch& watch, const DiskOf& disk = disk_of);
RawSurface read_surface(const std::filesystem::path& file, const std::filesystem::path& directory,
                        IngestWatch& watch, const DiskOf& disk = disk_of);

// Reads one of `num_parts` parts of a surface, with ids, a box and counts of its own, and no
// digest. Not all that is asked of a surface is asked of a part, see require_extent(). Throws as
// SurfaceRanges::read_part(), and where triangles without area are too many; std::system_error.
RawSurface read_part_of_surface(SurfaceRanges& ranges, std::uint64_t part, std::uint64_t num_parts,
                                const std::filesystem::path& directory, IngestWatch& watch);
// Throws InputError unless double arithmetic can tell points of its box apart.
void require_extent(const RawSurface& surface);

// By what the buckets' triangles carry in place of their changes of the state: of each part of a
// surface, the change; and what its groups have become, from place `first[part]` on. Parts that
// change nothing, for the same lies on both of their sides, are no surface.
struct BodyLabels {
  struct Group {
    SheetId before = 1, now = 1;
  };
  std::vector<DomainState> changes;
  std::vector<std::uint32_t> first;  // one more at the end
  std::vector<Group> groups;

  void apply_to(std::vector<Triangle>& triangles) const;
};

// A closed 2-manifold without self-intersections, each edge in exactly two triangles; of several
// bodies, each by itself. Triangles keep the order of their corners: nothing relies on it, sides
// are found by parity.
struct CheckedSurface {
  CheckedSurface(TriangleSpill the_spill, TriangleBuckets the_buckets)
      : spill(std::move(the_spill)), buckets(std::move(the_buckets)) {}

  // The triangles that meet the bucket's box, in order of id.
  std::vector<Triangle> load(const TriangleBucket& bucket) const;
  // What these triangles are of, one by one. Empty: there are no strips.
  std::vector<SheetPiece> pieces_of(const TriangleBucket& bucket) const;
  std::size_t number_of(const TriangleBucket& bucket) const {
    return static_cast<std::size_t>(&bucket - buckets.all().data());
  }
  EdgeSet given_in(const TriangleBucket& bucket) const {
    return given.of_bucket(number_of(bucket));
  }

  // Of a triangle with this id, the number in the file.
  std::uint64_t number_in_file(std::uint64_t id) const {
    return locvol::number_in_file(id, has_pieces);
  }

  SurfaceFacts facts;
  bool has_pieces = false;          // bodies were cut along each other: ids are those of pieces
  std::vector<std::string> groups;  // see RawSurface
  std::map<std::string, Color> colors;
  SharpEdges sharp;
  std::uint64_t first_over_hole = SharpAngle::kNoHoles;  // see SharpAngle
  TriangleSpill spill;
  TriangleBuckets buckets;
  // By what the buckets' triangles carry, the sheets that load() gives them. Empty: their groups.
  std::vector<SheetId> sheets;
  std::vector<SheetPiece> pieces;  // likewise, if there are strips
  GivenEdges given;                // that are sharp, whatever their angle
  bool has_copies = false;    // the buckets hold triangles more than once, which load() leaves out
  bool has_contacts = false;  // bodies have triangles, edges or vertices in common
  GivenBodies given_bodies;   // see RawSurface; by groups before number_bodies()
  std::vector<SurfaceFile> files;                      // see RawSurface
  std::vector<std::uint32_t> file_of_group;            // likewise; of groups before number_bodies()
  std::vector<std::array<BodyId, 2>> bodies_of_group;  // by group; empty: the only one behind all
  std::optional<BodyLabels> labels;  // what load() makes of the buckets' triangles
};

// The bucket's capacity decides how the work is cut, never its result.
inline constexpr std::uint64_t kBucketCapacity = 50'000;

// REQUIRES: the frame contains the surface
// Memory: some 300 bytes a triangle of one bucket for each thread, 16 MB while triangles are
// distributed, and 60 bytes a component. A bucket outgrows its capacity where more triangles than
// that meet in a point. Throws InputError, std::system_error, IngestStopped.
// Of several processes each gives the triangles that meet its share's cells, and gets these in
// buckets; all that is known of the surface is known to each. REQUIRES: then nothing is to be
// repaired
// By winding numbers, all triangles are in memory where they enclose nothing, unless that is more
// than the law's cap: then OverBudget is thrown.
// `weld`, `sharp_angle`, `gap`: see RunParameters. At an angle of 0, CheckedSurface::sharp has
// none.
CheckedSurface check_surface(RawSurface raw, const Frame& frame, IngestWatch& watch,
                             Workers& workers, std::uint64_t bucket_capacity = kBucketCapacity,
                             const IngestShare& share = IngestShare(),
                             const std::optional<double>& weld = std::nullopt,
                             double sharp_angle = 0, double gap = 0,
                             const WindingLaw& winding = {});

// A frame for a surface that is checked only.
Frame frame_of(const Box& surface);

}  // namespace locvol
