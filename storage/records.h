// What the store keeps: plain structs, one set per octree leaf and one for the run.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "octree/domain_state.h"
#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/lattice.h"
#include "octree/leaf_surface.h"
#include "octree/mesh_facet.h"
#include "octree/morton_key.h"
#include "octree/size_field.h"
#include "octree/size_nodes.h"
#include "octree/size_shapes.h"
#include "storage/run_choices.h"

namespace locvol {

inline constexpr int kNumConditions = 7;      // C1 … C7 of refine/ALGORITHM.md; index 0 is C1
inline constexpr int kNumSiteConditions = 6;  // those that may leave unresolved sites: not C7

// Where in the queue a leaf waits; the order of the queue is (epoch, color, Morton key).
struct QueuePosition {
  std::uint32_t epoch = 0;
  std::uint32_t color = 0;
  friend auto operator<=>(const QueuePosition&, const QueuePosition&) = default;
};

// Of a run that several ranks work on: what a rank's store has of a leaf.
enum class Holding : std::uint8_t {
  kOwn,    // it is the rank's: all that there is
  kCopy,   // near the rank's: its records, as its own rank has them
  kBeyond  // nothing is known of it, and what happens there does not matter to the rank
};

struct LeafInfo {
  DomainState center;  // of the center of the leaf's box, the reference point
  std::uint32_t num_visits = 0;
  std::uint64_t num_points = 0;
  std::uint64_t num_cells = 0;  // in runs of the surface alone, facets; so in RunCounts
  std::uint64_t num_triangles = 0;
  std::array<std::uint64_t, kNumConditions> num_insertions{};  // by condition, over all visits
  std::uint64_t num_deletions = 0;
  std::uint64_t num_moves = 0;  // of its points, for C7
  std::uint64_t num_unresolved = 0;
  std::optional<QueuePosition> queued;  // absent: clean
  // Points from this id on came after the last visit. 0: there was none that a later one may build
  // on, for it left something unresolved, or points near the leaf have been deleted since.
  std::uint64_t first_new_id = 0;
  // Of LatticeCore; num_points and num_cells are of what is stored one by one.
  std::uint64_t num_core_points = 0;
  std::uint64_t num_core_cells = 0;  // of core points alone, and whose smallest one is the leaf's
  std::uint64_t num_left_out = 0;    // cells, in Phase::kMend; num_cells is without them
  // Of h in the leaf, where sizes vary; 0 elsewhere, and before they are known. The last: the
  // largest on the surface (SizeRange).
  double least_size = 0, largest_size = 0, surface_size = 0;
  // The largest h where a visit of the leaf may put a point, there or around it.
  double reached_size = 0;
  Holding holding = Holding::kOwn;
  // That have the leaf, or a copy of it, ascending; empty: one alone has it.
  std::vector<std::uint32_t> ranks = {};

  bool has_surface() const { return num_triangles > 0; }
  bool meets_domain() const { return has_surface() || center.body() != kNoBody; }
  friend bool operator==(const LeafInfo&, const LeafInfo&) = default;
};

struct LeafPoints {
  std::vector<MeshPoint> points;  // in order of id
  LatticeCore core;               // besides, known by their places in the lattice alone
  friend bool operator==(const LeafPoints&, const LeafPoints&) = default;
};

// The cells whose smallest vertex (lexicographically) that is not of the core is an own point of
// the leaf. Cells of core points alone are not stored.
struct LeafCells {
  std::vector<std::uint64_t> vertices;              // ids, ascending
  std::vector<std::array<std::uint32_t, 4>> cells;  // indices into `vertices`, positively oriented
  // Around which the next visit is to look: core points that became explicit, vertices of cells
  // that other leaves could not improve (C7), from where inserted points moved.
  std::vector<Point> asked = {};
  std::vector<BodyId> bodies = {};  // of the cells; empty: kOnlyBody has all
  BodyId body_of(std::size_t cell) const { return bodies.empty() ? kOnlyBody : bodies[cell]; }
  friend bool operator==(const LeafCells&, const LeafCells&) = default;
};

// The facets of the mesh's boundary, and of that between bodies, whose smallest vertex is an own
// point of the leaf.
struct LeafFacets {
  std::vector<std::uint64_t> vertices;  // ids, ascending
  std::vector<MeshFacet> facets;        // ascending
  friend bool operator==(const LeafFacets&, const LeafFacets&) = default;
};

// A place where a condition could not be met (refine/ALGORITHM.md, "It ends").
struct UnresolvedSite {
  std::uint8_t condition = 0;  // 1 … 6
  Point position;
  double radius = 0;  // of the surface ball or the circumsphere
  friend bool operator==(const UnresolvedSite&, const UnresolvedSite&) = default;
};

struct LeafUnresolved {
  std::vector<UnresolvedSite> sites;
  friend bool operator==(const LeafUnresolved&, const LeafUnresolved&) = default;
};

// What h is made of in a leaf (refine/size_leaf.h).
struct LeafSizes {
  std::vector<SizeCube> cubes;  // in Morton order, all of the leaf
  // What the surface in it (refine/measure_leaf.h) and an image ask for, ascending.
  std::vector<SizedNode> nodes = {};
  friend bool operator==(const LeafSizes&, const LeafSizes&) = default;
};

// A leaf that waits, in the order of the queue.
struct QueueEntry {
  QueuePosition position;
  MortonKey leaf;
  friend auto operator<=>(const QueueEntry&, const QueueEntry&) = default;
};

// One after another. The surface is measured if sizes depend on it, and sizes if they vary. The
// first points are scattered in paper mode; in cover mode they come on creases, if there are any;
// then leaves are covered, and once all of these points are known, the holes between them filled.
// kMend comes only if sites are unresolved: then cells are left out where the boundary is no
// 2-manifold. Stores have these numbers, so what is new comes last; in which order phases come,
// engine/plan/phases.h says.
enum class Phase : std::uint8_t {
  kIngest,
  kMeasure,
  kSize,
  kScatter,
  kCover,
  kFill,
  kRefine,
  kMend,
  kDone,
  kCrease
};

// Of cells on a sheet, which has this name or is of the group with this name; or of a body's.
struct PartSize {
  std::string name;
  double size = 0;
  friend bool operator==(const PartSize&, const PartSize&) = default;
};

// What the mesh is a function of (engine/PROMISES.md, 4); a store refuses to go on under others.
struct RunParameters {
  std::string input_digest;  // hexadecimal, of the input file's bytes
  double size = 0;           // λ
  double radius_edge_bound = 2;
  double min_dihedral = 0;          // of cells, in degrees; 0: any
  double spacing_floor = 0;         // as a fraction of λ
  std::uint64_t leaf_capacity = 0;  // κ
  Initialization init = Initialization::kCover;
  std::uint64_t seed = 0;
  double growth = 0;  // of sizes from the surface inwards, over the way; 0: λ everywhere
  double max_size = std::numeric_limits<double>::infinity();
  std::vector<SizeShape> shapes = {};  // where cells are smaller than λ
  std::vector<PartSize> sheet_sizes = {}, body_sizes = {};
  // By the surface's curvature and thickness; 0: none of these (refine/measure_leaf.h).
  double per_circle = 0, deviation = 0, layers = 0;
  double min_size = 0;  // what these do not go below; 0: none is given
  // An image of sizes: a number that tells its values from others', and the least of them. Empty:
  // none.
  std::string size_image = {};
  double image_least = 0;
  // Points of the surface that lie closer to each other than this become one; 0: none. Absent:
  // those that close a surface which is not closed otherwise (engine/ingest/weld_trials.h).
  std::optional<double> weld = {};
  // Sheets end at edges where the surface turns by more degrees than this; 0: at none.
  double sharp_angle = 0;
  // Polylines whose edges are sharp, too: a number that tells them from others. Empty: none.
  std::string sharp_polylines = {};
  // Of one file: is each group that is closed by itself a body, or each shell?
  bool has_bodies = false;
  std::vector<std::string> voids = {};  // bodies that are none, but what is left of the others
  double gap = 0;  // bodies nearer than that are made to touch; 0: only what rounding parts
  bool is_surface_only = false;  // the mesh has facets alone: no cells, nothing inside
  InsideRule inside = InsideRule::kClosed;
  double wrap_alpha = 0,
         wrap_offset = 0;  // of what wraps; 0: engine/ingest/cured_surface.h decides
  // Do sizes follow the surface's shape?
  bool follows_shape() const { return per_circle > 0 || deviation > 0 || layers > 0; }
  bool is_measured() const {
    return follows_shape() || !sheet_sizes.empty() || !body_sizes.empty();
  }
  bool has_image() const { return !size_image.empty(); }
  bool has_nodes() const { return is_measured() || has_image(); }  // LeafSizes::nodes
  SizeLaw sizes() const {
    double least = follows_shape() && min_size < size ? min_size : size;
    for (const PartSize& sheet : sheet_sizes) least = sheet.size < least ? sheet.size : least;
    for (const PartSize& body : body_sizes) least = body.size < least ? body.size : least;
    for (const SizeShape& shape : shapes) least = shape.size < least ? shape.size : least;
    if (has_image() && image_least < least) least = image_least;
    return {.surface = size, .growth = growth, .most = max_size, .least = least};
  }
  friend bool operator==(const RunParameters&, const RunParameters&) = default;
};

// What messages and stores call a surface that is in no file.
inline constexpr const char* kInMemory = "surface in memory";

// Where a surface faces itself, of places that are spread evenly over its area
// (engine/ingest/wall_probes.h).
struct FacingPlaces {
  static constexpr int kStepsPerOctave = 32;
  // The distance across is 2^(step / kStepsPerOctave) or more, and less than that of the next step.
  std::int32_t step = 0;
  // Across the inside, between two sheets or in what is narrow all around; across the outside,
  // where that is closer, likewise.
  std::uint32_t num_walls = 0, num_rods = 0, num_gaps = 0, num_holes = 0;
  friend bool operator==(const FacingPlaces&, const FacingPlaces&) = default;
};
struct FacingFacts {
  std::uint64_t num_places = 0;      // with those that face nothing
  std::vector<FacingPlaces> places;  // ascending
  friend bool operator==(const FacingFacts&, const FacingFacts&) = default;
};

// What is known of the repaired input surface.
struct SurfaceFacts {
  std::string file;
  std::uint64_t num_vertices = 0;
  std::uint64_t num_triangles = 0;
  std::uint64_t num_components = 0;
  std::int64_t euler_characteristic = 0;
  double area = 0;
  double volume = 0;
  Box box;
  std::vector<std::string> notes;            // repairs that were made
  FacingFacts facing = {};                   // no places: nothing is known
  std::vector<std::string> more_files = {};  // of which each is a body, as the first is
  friend bool operator==(const SurfaceFacts&, const SurfaceFacts&) = default;
};

struct Color {
  std::uint8_t red = 0, green = 0, blue = 0;
  friend bool operator==(const Color&, const Color&) = default;
};

// A sheet of the input surface. Its name is that of its group, which ends in _1, _2, ... if the
// group is several sheets; without a name in the file, it is "sheet 7".
struct SheetFacts {
  std::string name;
  std::string group;                 // as the file calls it; empty: it has no name there
  std::uint64_t first_triangle = 0;  // the least id
  std::uint64_t num_triangles = 0;
  double area = 0;
  Point centroid;
  Box box;
  std::array<BodyId, 2> bodies = {kOnlyBody, kNoBody};  // on its sides, the larger first
  std::optional<Color> color = {};                      // that the file gives it
  friend bool operator==(const SheetFacts&, const SheetFacts&) = default;
};

// A crease of the input surface (octree/crease.h).
struct CreaseFacts {
  std::uint64_t num_edges = 0;
  double length = 0;
  std::array<std::uint32_t, 2> corners{};  // at its ends, the smaller id first; 0: it has no ends
  std::array<SheetId, 2> sheets = {1, 1};  // on its sides, the smaller first
  bool is_closed() const { return corners[0] == 0; }
  friend bool operator==(const CreaseFacts&, const CreaseFacts&) = default;
};

// A part of the domain.
struct BodyFacts {
  std::string name;
  std::uint64_t num_triangles = 0;
  std::uint64_t num_shells = 0;  // the outer one, those of its cavities, and so on
  double volume = 0;             // without what lies in it
  BodyId around = kNoBody;       // the body that it lies in
  friend bool operator==(const BodyFacts&, const BodyFacts&) = default;
};

// Element i is of the sheet, the crease or the body with id i + 1. No sheets: the surface is one,
// and has no name. No bodies: there is one, and it has no name.
struct SurfaceSheets {
  std::vector<SheetFacts> sheets;
  std::vector<CreaseFacts> creases = {};
  std::uint64_t num_corners = 0;
  std::vector<BodyFacts> bodies = {};
  // By RunParameters::sheet_sizes: the sheet that is meant by a place; 0: it is meant by a name.
  // Empty: all are.
  std::vector<SheetId> nearest = {};
  bool has_several_bodies() const { return bodies.size() > 1; }
  friend bool operator==(const SurfaceSheets&, const SurfaceSheets&) = default;
};

// Totals of a run so far, with the core's; they outlive the leaves that were split.
struct RunCounts {
  std::uint64_t num_visits = 0;
  std::uint64_t num_points = 0;
  std::uint64_t num_cells = 0;
  std::uint64_t num_unresolved = 0;
  std::array<std::uint64_t, kNumConditions> num_insertions{};  // by condition
  std::uint64_t num_deletions = 0;
  std::uint64_t num_moves = 0;
  friend bool operator==(const RunCounts&, const RunCounts&) = default;
};

struct RunRecord {
  RunParameters parameters;
  SurfaceFacts surface;
  Frame frame;
  Phase phase = Phase::kIngest;
  std::uint32_t epoch = 0;  // the open one
  std::uint64_t next_point_id = 0;
  RunCounts counts;
  SizeTotals sizes;          // where they vary, once they are known
  std::string image_file;    // of sizes; empty: none
  bool has_creases = false;  // or corners: points on these come first
  std::string sharp_file;    // of polylines whose edges are sharp; empty: none
  friend bool operator==(const RunRecord&, const RunRecord&) = default;
};

// What a visit on another rank found, until it is applied here.
struct RankResult {
  std::uint64_t first_id = 0;  // of its new points
  std::string bytes;
  friend bool operator==(const RankResult&, const RankResult&) = default;
};

// What a rank knows of a run that several work on, besides its leaves.
struct RankRecord {
  std::vector<MortonKey> first;  // where each rank's share of the leaves begins
  std::uint32_t rank = 0;
  std::uint64_t superstep = 0;  // so many have been committed; ranks are at most one apart
  // Of a color whose visits all ranks have made: what they found is being applied. Of this rank's
  // results so many have been sent to those that they matter to, if any have not. The next point of
  // this rank gets `next_id`; when all is applied, that of the run is `end_id`.
  std::optional<QueuePosition> applied;
  bool is_all_sent = false;
  std::uint64_t num_sent = 0, next_id = 0, end_id = 0;
  // How often leaves have moved to other ranks, and in which phase they last did, or were found to
  // be well where they are.
  std::uint64_t num_moves = 0;
  Phase moved_at = Phase::kIngest;
  std::uint32_t stage = 0;  // supersteps of the phase that were no visits
  friend bool operator==(const RankRecord&, const RankRecord&) = default;
};

// What a rank has said to others during its last superstep: to be said again to those that have not
// committed it.
struct RankWords {
  std::string said;
  friend bool operator==(const RankWords&, const RankWords&) = default;
};

// How the memory of the last process that worked on the run was shared out, in bytes, and what it
// took. Says nothing of the result, which is the same under any cap.
struct MemoryRecord {
  std::uint64_t cap = 0;            // on the whole process
  std::uint64_t program = 0;        // code, libraries, LMDB's mapped pages
  std::uint64_t leaves = 0;         // lists over all leaves
  std::uint64_t commits = 0;        // changes that wait for a commit, and the commit
  std::uint64_t visits = 0;         // the largest reservation that a visit has asked for
  std::uint64_t cache = 0;          // what that left to records kept decoded
  std::uint64_t peak_resident = 0;  // measured
  friend bool operator==(const MemoryRecord&, const MemoryRecord&) = default;
};

// Where a run stood at one moment of its work.
struct TimelineSample {
  std::uint64_t milliseconds = 0;  // of work, over all sittings
  std::uint64_t sitting = 0;       // which of the processes that worked on the run, from 0 on
  std::uint64_t started = 0;       // when that process began: seconds since 1970
  std::uint64_t num_threads = 0;   // of that process
  std::uint64_t memory_cap = 0;    // of that process, in bytes
  std::uint64_t resident = 0;      // bytes that it held at this moment
  Phase phase = Phase::kIngest;    // that took the time since the sample before
  std::uint64_t epoch = 0;
  std::uint64_t num_leaves = 0, num_queued = 0;
  RunCounts counts;  // of all sittings
  friend bool operator==(const TimelineSample&, const TimelineSample&) = default;
};

// How the run went, at moments in ascending order: to be looked at. Like MemoryRecord it says
// nothing of the result, and is another one for each run.
struct TimelineRecord {
  std::vector<TimelineSample> samples;
  friend bool operator==(const TimelineRecord&, const TimelineRecord&) = default;
};

}  // namespace locvol
