#include "engine/ingest/surface_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "engine/ingest/body_cuts.h"
#include "engine/ingest/coordinate_step.h"
#include "engine/ingest/loose_surface.h"
#include "engine/ingest/shared_faces.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_groups.h"
#include "engine/ingest/surface_holes.h"
#include "engine/ingest/surface_repair.h"
#include "engine/ingest/surface_text.h"
#include "engine/ingest/surface_weld.h"
#include "engine/ingest/triangle_soup.h"
#include "engine/ingest/weld_trials.h"
#include "engine/plan/run_setup.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/number_text.h"
#include "engine/shared/standard_input.h"
#include "octree/sort_and_unite.h"
#include "refine/winding/inside_surface.h"

namespace locvol {
namespace {

// Around triangles without area, repaired in memory.
constexpr std::size_t kMaxPieceTriangles = 1'000'000;

// Of the largest coordinate: what is nearer was one, before it was rounded.
constexpr double kNear = 1e-11;
constexpr double kRoundedSteps = 2;  // √3, and room: both of two points may be rounded
constexpr int kMostNearRounds = 10;
constexpr std::uint64_t kFewChanges = 500;  // which may become more from round to round
// Of the longest side of the box: points at open edges that are closer become one before what is
// open is closed.
constexpr double kMostJoined = 1e-4;

// Of the box, where winding numbers still tell what is inside.
constexpr double kMostDoubt = 0.25;
// Of the box, what is surely inside of triangles that are more than sheets.
constexpr double kLeastSurelyInside = 0.01;
// What they take of so many triangles; see README.md.
std::uint64_t winding_bytes(std::uint64_t num_triangles) { return 1200 * num_triangles; }
// And where they stay on disk, but for what is around holes.
constexpr std::uint64_t kBytesOfPassing = 9, kBytesAtOpenEdge = 1000;
constexpr std::uint64_t kMostPassing = std::uint64_t{1} << 31;

// Takes a surface as read through repairs and checks. What is wrong first is told first: in an
// order in which each check may rely on those before it.
class SurfacePreparation {
 public:
  SurfacePreparation(RawSurface raw, const Frame& frame, IngestWatch& watch, Workers& workers,
                     std::uint64_t bucket_capacity, const IngestShare& share,
                     const std::optional<double>& weld, double sharp_angle, double gap,
                     const WindingLaw& winding)
      : raw_(std::move(raw)),
        watch_(watch),
        workers_(workers),
        share_(share),
        weld_(weld),
        gap_(gap),
        given_(raw_.given_bodies()),
        angle_(sharp_angle),
        winding_(winding),
        buckets_(frame, bucket_capacity, share.range()) {}

  CheckedSurface run() {
    if (weld_.value_or(0) > 0) weld_all_points();
    distribute_and_check();
    if (gives_faces_once()) part_by_regions();
    if (!weld_ && findings_.edges_that_count().border.count > 0) weld_open_edges();
    has_crossing_cut_ = crosses_as_cut();
    if (has_crossing_cut_ || (has_winding() && !encloses_something())) {
      if (!raw_.has_several_bodies) {
        take_what_is_wound_around();
        note_repairs();
        measure();
        return result();
      }
      take_what_bodies_wind_around();
    }
    check_walls();
    check_edges();
    check_orientation();
    if (!has_area()) {
      check_contacts_without_area();
      distribute(flipped_triangles(), false);
      check(scope_);
      check_edges();
      check_orientation();
    }
    check_vertices();
    close_gaps();
    join_near_bodies();
    cut_bodies();
    check_self_intersection();
    note_repairs();
    measure();
    return result();
  }

 private:
  bool has_area() const { return raw_.collinear.empty(); }

  bool has_winding() const { return winding_.inside == InsideRule::kWinding; }

  // Of bodies the triangles are needed again.
  void distribute_and_check() {
    distribute({}, !has_area() || raw_.has_several_bodies || has_winding() || is_cut());
    check(has_area() ? scope_ : CheckScope::kNeighbors);
  }

  void distribute(const TriangleChanges& changes, bool is_to_be_repaired) {
    buckets_.distribute(raw_.spill, raw_.triangles, raw_.box, changes, is_to_be_repaired, watch_);
  }

  void check(CheckScope scope) {
    const WallProbes probes(raw_.probes, raw_.box);
    findings_ = check_cells(raw_.spill, buckets_, raw_.box, probes, angle_, scope, watch_, workers_,
                            given_);
    share_.join_findings(findings_);
    drops_copies_ = findings_.drops_copies();
  }

  // Is it what is meshed without winding numbers?
  bool encloses_something() const {
    const EdgeCounts& edges = findings_.edges_that_count();
    return edges.border.count == 0 && edges.overused.count == 0 && findings_.conflicts.count == 0 &&
           findings_.num_pinched == 0 && !findings_.intersection &&
           (drops_copies_ || !findings_.first_copy);
  }

  // From curved faces of a CAD file.
  bool is_cut() const { return raw_.precision > 0; }
  // Then it is no flaw of the file. Of one body: others may cross, and are cut along each other.
  bool crosses_as_cut() const {
    const EdgeCounts& edges = findings_.edges_that_count();
    return is_cut() && winding_.inside == InsideRule::kClosed && !raw_.has_several_bodies &&
           edges.border.count == 0 && edges.overused.count == 0 && findings_.conflicts.count == 0 &&
           findings_.intersection;
  }

  void take_what_is_wound_around() {
    share_.require_whole();
    const double gap = joined_gap();
    TriangleList list;
    TriangleWriter writer(raw_.spill, list);
    std::uint64_t id = 0;
    std::vector<Triangle> over_holes;  // come last
    const auto write = [&](const std::array<Point, 3>& corners, SheetId group) {
      if ((group & kOverHole) != 0)
        over_holes.push_back({0, corners, group & ~kOverHole});
      else
        writer.append({id++, corners, group});
    };
    if (!closes_holes_alone(gap, write)) {
      require_memory_for(raw_.num_triangles());
      const LooseSurface found = winding_surface(loose_surface(raw_.spill, raw_.triangles),
                                                 winding_.spacing, gap, wound_, watch_.stop());
      for (std::size_t t = 0; t < found.triangles.size(); ++t) {
        const auto& [a, b, c] = found.triangles[t];
        write(std::array{found.vertices[a], found.vertices[b], found.vertices[c]}, found.groups[t]);
      }
    }
    first_over_hole_ = id;
    for (Triangle& t : over_holes) {
      t.id = id++;
      writer.append(t);
    }
    writer.flush();
    if (list.count == 0)
      refuse("its triangles wind around nothing, as sheets do: close them{}", cured_by("wrap"));
    adopt(std::move(list));
    raw_.collinear.clear();
    drops_copies_ = false;
    distribute({}, false);
    check(CheckScope::kFacingAway);
    check_edges();
  }

  // Of points at open edges, for winding numbers: those that are closer become one.
  double joined_gap() const {
    return weld_ ? 0 : kMostJoined * max_norm(raw_.box.max - raw_.box.min);
  }

  // The same of each body by itself. Those that enclose something keep their triangles.
  void take_what_bodies_wind_around() {
    share_.require_whole();
    if (given_.empty())
      refuse(
          "has bodies without names, and it is not known whose triangles are amiss: give each as a "
          "file or a group{}",
          about_bodies());
    require_memory_for(raw_.num_triangles());
    std::map<std::uint32_t, std::vector<Triangle>> bodies;
    std::uint64_t next_id = 0;
    for (const TriangleList& list : raw_.triangles)
      raw_.spill.for_each(list, [&](const Triangle& t) {
        bodies[given_body(given_, t)].push_back(t);
        next_id = t.id + 1;
      });
    std::vector<Triangle> kept, found, over_holes;
    std::set<std::uint32_t> changed;
    for (const auto& [body, triangles] : bodies) {
      WindingChanges wound;
      const std::optional<std::vector<Triangle>> others = wound_around(triangles, wound);
      if (!others) {
        kept.insert(kept.end(), triangles.begin(), triangles.end());
        continue;
      }
      if (others->empty())
        refuse("the triangles of {} wind around nothing: they are sheets", name_of(body));
      changed.insert(body);
      wound_of_bodies_.emplace_back(name_of(body), wound);
      for (Triangle t : *others) {
        const bool is_over_hole = (t.sheet & kOverHole) != 0;
        t.sheet &= ~kOverHole;
        (is_over_hole ? over_holes : found).push_back(t);
      }
    }
    if (changed.empty()) return;
    std::ranges::sort(kept, {}, &Triangle::id);
    TriangleList list;
    TriangleWriter writer(raw_.spill, list);
    for (const Triangle& t : kept) writer.append(t);
    for (std::vector<Triangle>* some : {&found, &over_holes}) {
      if (some == &over_holes) first_over_hole_ = next_id;
      for (Triangle& t : *some) {
        t.id = next_id++;
        writer.append(t);
      }
    }
    writer.flush();
    std::erase_if(raw_.collinear,
                  [&](const Triangle& t) { return changed.contains(given_body(given_, t)); });
    adopt(std::move(list));
    scope_ = CheckScope::kBetweenBodies;
    distribute_and_check();
  }

  // Of one body's triangles; without ids. Nothing: they are these.
  std::optional<std::vector<Triangle>> wound_around(std::span<const Triangle> triangles,
                                                    WindingChanges& wound) const {
    const LooseSurface after = winding_surface(loose_surface(triangles), winding_.spacing,
                                               joined_gap(), wound, watch_.stop());
    std::vector<Triangle> found;
    found.reserve(after.triangles.size());
    for (std::size_t t = 0; t < after.triangles.size(); ++t) {
      const auto& [a, b, c] = after.triangles[t];
      found.push_back(
          {0, {after.vertices[a], after.vertices[b], after.vertices[c]}, after.groups[t]});
    }
    // Which way triangles face is nobody's affair but theirs.
    const auto is_same = [](const Triangle& one, const Triangle& other) {
      return one.sheet == other.sheet && std::ranges::is_permutation(one.corners, other.corners);
    };
    if (std::ranges::equal(found, triangles, is_same)) return std::nullopt;
    return found;
  }

  // Where that is all there is to do, triangles stay on disk. False: there is more, or memory is
  // too little for it.
  template <class Write>
  bool closes_holes_alone(double gap, const Write& write) {
    const SurfaceFindings& its = findings_;
    const std::uint64_t num = raw_.num_triangles(), most_open = winding_.cap / 2 / kBytesAtOpenEdge;
    if (!has_area() || raw_.has_several_bodies || its.edges.border.count == 0 ||
        its.edges.border.count > most_open || its.edges.overused.count > 0 || its.num_copies > 0 ||
        its.intersection || num * kBytesOfPassing > winding_.cap / 2 || num > kMostPassing)
      return false;
    number_triangles();
    SpilledTriangles passing(raw_.spill, raw_.triangles);
    const auto open = passing.find_edges(buckets_, raw_.box, most_open, watch_, workers_);
    return open &&
           close_holes_alone(passing, *open, winding_.spacing, gap, wound_, write, watch_.stop());
  }

  // Welded ones have the ids of those in the file, of which some are missing.
  void number_triangles() {
    if (!welded_) return;
    TriangleList list;
    TriangleWriter writer(raw_.spill, list);
    std::uint64_t id = 0;
    for (const TriangleList& before : raw_.triangles)
      raw_.spill.for_each(before, [&](Triangle t) {
        t.id = id++;
        writer.append(t);
      });
    writer.flush();
    adopt(std::move(list));
    distribute({}, true);
  }

  void require_memory_for(std::uint64_t num_triangles) const {
    const std::uint64_t bytes = winding_bytes(num_triangles);
    if (bytes <= winding_.cap) return;
    throw OverBudget(
        fmt::format("{}: to find what its triangles wind around may take {} MiB of memory, but the "
                    "cap is {} MiB; raise it, by --memory {}M",
                    raw_.file, (bytes >> 20) + 1, winding_.cap >> 20, (bytes >> 20) + 1),
        bytes);
  }

  void weld_all_points() {
    share_.require_whole();
    distribute({}, true);
    WeldedSurface welded =
        welded_surface(raw_.spill, buckets_, WeldPoints::kAll, *weld_, watch_, workers_);
    const std::string obstacle = obstacle_to(welded);
    if (!obstacle.empty())
      refuse("joining points that are closer than {} (--weld) {}; give less", decimal(*weld_),
             obstacle);
    if (welded.num_joined > 0) adopt(std::move(welded));
  }

  void weld_open_edges() {
    share_.require_whole();
    WeldTrials trials(raw_.spill, buckets_, raw_.box, given_, watch_, workers_);
    if (auto closed = trials.closed_surface()) {
      adopt(*std::move(closed));
      return distribute_and_check();
    }
    tried_ = trials.tried();
    const std::string cure = trials.cure();
    if (!cure.empty()) tried_ += "; " + cure;
  }

  void adopt(WeldedSurface welded) {
    adopt(std::exchange(welded.triangles, {}));
    raw_.collinear = std::exchange(welded.collinear, {});
    raw_.num_collapsed += welded.num_collapsed;
    welded_ = std::move(welded);
  }

  void adopt(TriangleList triangles) {
    for (TriangleList& list : raw_.triangles) raw_.spill.release(std::move(list));
    raw_.triangles = {std::move(triangles)};
    // Places of before lie beside their own triangles now, as if walls were there.
    ProbePicker probes;
    for (const TriangleList& list : raw_.triangles)
      raw_.spill.for_each(list, [&](const Triangle& triangle) { probes.add(triangle); });
    raw_.probes = probes.take();
  }

  // Where both sides of a wall became one, what was between them would count as inside.
  void check_walls() const {
    if (!welded_ || findings_.num_copies <= welded_->num_copies) return;
    refuse("joining points that are closer than {} (--weld) lays {} on {}; give less",
           decimal(welded_->distance), text(findings_.first_copy->second),
           text(findings_.first_copy->first));
  }

  void check_edges() const {
    const EdgeCounts& edges = findings_.edges_that_count();
    if (edges.border.count > 0)
      refuse("is not closed: {}, for example that from {}; close the holes{}{}",
             counted(edges.border.count, "edge belongs to one triangle only",
                     "edges belong to one triangle only"),
             shown(edges.border), cured_by(has_only_holes() ? "repair" : "wrap"),
             tried_.empty() ? "" : ". " + tried_);
    if (edges.overused.count > 0)
      refuse(
          "is not manifold: {}, for example that from {}; separate the parts that touch there, or "
          "remove inner and doubled faces{}{}",
          counted(edges.overused.count, "edge belongs to more than two triangles",
                  "edges belong to more than two triangles"),
          shown(edges.overused), cured_by("wrap"), about_bodies());
  }

  void check_orientation() const {
    if (findings_.conflicts.count > 0)
      refuse("is not orientable, as a Klein bottle is, at the edge from {}; it has no inside{}",
             shown(findings_.conflicts), cured_by("wrap"));
  }

  // A flip is of one body's triangles, and would lay them across those of another.
  void check_contacts_without_area() const {
    if (findings_.has_contacts)
      refuse(
          "has {} without area, for example {}, and bodies that touch: there is no unambiguous "
          "repair; remove degenerate faces",
          counted(raw_.collinear.size(), "triangle", "triangles"), text(raw_.collinear.front()));
  }

  // Flips edges of triangles without area, in the piece of the surface around them, which grows
  // until it holds all that the flips must see.
  TriangleChanges flipped_triangles() {
    std::set<Point> whole;  // vertices with all their triangles in the piece
    for (const Triangle& t : raw_.collinear) whole.insert(t.corners.begin(), t.corners.end());
    for (;;) {
      throw_if_stopped(watch_.stop());
      const std::vector<Triangle> piece = triangles_around(whole);
      TriangleSoup soup = soup_of(piece);
      std::vector<bool> is_whole(soup.vertices.size());
      for (std::size_t v = 0; v < is_whole.size(); ++v)
        is_whole[v] = whole.contains(soup.vertices[v]);
      const FlipResult flips = flip_collinear_triangles(soup, is_whole, collinear_in(piece));
      for (const std::uint32_t v : flips.beyond) whole.insert(soup.vertices[v]);
      if (!flips.beyond.empty()) continue;
      const auto triangle = [&](std::uint32_t t) -> Triangle {
        const auto& [a, b, c] = soup.triangles[t];
        return {piece[t].id,
                {soup.vertices[a], soup.vertices[b], soup.vertices[c]},
                piece[flips.taken_from[t]].sheet};
      };
      if (flips.remaining)
        refuse(
            "{} has no area, its corners lie on a line, and there is no unambiguous repair; remove "
            "degenerate faces",
            text(triangle(*flips.remaining)));
      TriangleChanges changes;
      std::ranges::transform(flips.changed, std::back_inserter(changes), triangle);
      if (drops_copies_) change_copies(piece, triangles_around(whole, true), changes);
      return changes;
    }
  }

  // Copies change as the first of them does, so that they remain copies. `with_copies`: the piece
  // and the copies of its triangles.
  static void change_copies(const std::vector<Triangle>& piece,
                            const std::vector<Triangle>& with_copies, TriangleChanges& changes) {
    const auto vertices_of = [](Triangle t) {
      std::ranges::sort(t.corners);
      return t.corners;
    };
    std::map<std::array<Point, 3>, std::array<Point, 3>> changed_corners;
    for (const Triangle& change : changes) {
      const auto before = std::ranges::lower_bound(piece, change.id, {}, &Triangle::id);
      changed_corners[vertices_of(*before)] = change.corners;
    }
    for (const Triangle& t : with_copies) {
      if (std::ranges::binary_search(piece, t.id, {}, &Triangle::id)) continue;
      const auto changed = changed_corners.find(vertices_of(t));
      if (changed != changed_corners.end()) changes.push_back({t.id, changed->second});
    }
    std::ranges::sort(changes, {}, &Triangle::id);
  }

  // All triangles with a corner among `vertices`, in order of id.
  std::vector<Triangle> triangles_around(const std::set<Point>& vertices,
                                         bool has_copies = false) const {
    std::vector<MortonKey> owners;
    for (const Point& p : vertices)
      owners.push_back(buckets_.under(buckets_.frame().key_of(p)).front().cell);
    sort_and_unite(owners);

    std::vector<Triangle> piece;
    for (const MortonKey owner : owners) {
      const TriangleBucket& bucket = buckets_.under(owner).front();
      const auto held = has_copies ? raw_.spill.load(bucket.triangles) : load(bucket);
      std::ranges::copy_if(held, std::back_inserter(piece), [&](const Triangle& t) {
        return std::ranges::any_of(t.corners, [&](const Point& p) { return vertices.contains(p); });
      });
      if (piece.size() > kMaxPieceTriangles)
        refuse(
            "has {} without area, and more than {} triangles around them; remove degenerate faces",
            counted(raw_.collinear.size(), "triangle", "triangles"), kMaxPieceTriangles);
    }
    sort_and_unite(piece, &Triangle::id);
    return piece;
  }

  std::vector<std::uint32_t> collinear_in(const std::vector<Triangle>& piece) const {
    std::vector<std::uint32_t> numbers;
    for (const Triangle& t : raw_.collinear) {
      const auto place = std::ranges::lower_bound(piece, t.id, {}, &Triangle::id);
      if (place != piece.end() && place->id == t.id)  // not there: a copy that was dropped
        numbers.push_back(static_cast<std::uint32_t>(place - piece.begin()));
    }
    return numbers;
  }

  std::vector<Triangle> load(const TriangleBucket& bucket) const {
    std::vector<Triangle> triangles = raw_.spill.load(bucket.triangles);
    if (drops_copies_) drop_copies(triangles, given_);
    return triangles;
  }

  void check_vertices() const {
    if (findings_.num_pinched > 0)
      refuse("is not manifold: {}, for example {}; separate the parts that touch there{}",
             counted(findings_.num_pinched, "vertex joins two parts that share no edge there",
                     "vertices join parts that share no edge there"),
             text(findings_.first_pinched), cured_by("wrap"));
  }

  // Are there edges of several bodies where a body has not two triangles?
  bool gives_faces_once() const {
    const EdgeCounts& edges = findings_.edges_that_count();
    return raw_.has_several_bodies && has_area() &&
           edges.overused.count + (given_.empty() ? 0 : edges.border.count) > 0;
  }

  // Faces between two bodies may stand once. Then what they enclose are the bodies, and each gets
  // the faces around it. What encloses nothing is left as it is, to be refused.
  void part_by_regions() {
    share_.require_whole();
    RegionFaces faces =
        faces_of_regions(raw_.spill, buckets_, given_, raw_.box, raw_.has_pieces, watch_, workers_);
    if (faces.obstacle && faces.obstacle->kind == FaceObstacle::Kind::kWithin && !has_winding())
      refuse("{} has the same body on both of its sides; leave it out",
             shown(faces.obstacle->triangle));
    if (faces.obstacle || faces.given_body.size() < 2)
      return raw_.spill.release(std::move(faces.triangles));
    std::vector<SurfaceFile> regions;
    for (const std::optional<std::uint32_t>& given : faces.given_body)
      regions.push_back({given && !given_.empty() ? name_of(*given) : std::string(), raw_.file, 0});
    std::vector<std::string> groups;
    for (const SheetId before : faces.group_before) groups.push_back(raw_.groups[before - 1]);
    raw_.files = std::move(regions);
    raw_.groups = std::move(groups);
    raw_.file_of_group = std::move(faces.region_of_group);
    raw_.notes.push_back(
        fmt::format("{} between two bodies stand once: what they and the others enclose are {}",
                    counted(faces.num_shared, "triangle", "triangles"),
                    counted(raw_.files.size(), "body", "bodies")));
    adopt(std::move(faces.triangles));
    raw_.has_pieces = true;
    given_ = raw_.given_bodies();
    distribute_and_check();
  }

  // Bodies nearer than a gap are made to touch. Their triangles are needed again.
  void close_gaps() {
    if (gap_ == 0) return;
    if (!raw_.has_several_bodies)
      refuse("is one body, and --gap is what may be between bodies: give --bodies, or more files");
    if (given_.empty())
      refuse(
          "has bodies without names, which --gap cannot tell apart: give each as a file or a "
          "group");
    if (!has_area())
      refuse(
          "has {} without area, for example {}, beside which --gap brings no bodies together; "
          "remove degenerate faces",
          counted(raw_.collinear.size(), "triangle", "triangles"), text(raw_.collinear.front()));
    share_.require_whole();
    bring_together(gap_, Nearness::kGap);
    distribute_and_check();
    const EdgeCounts& edges = findings_.edges_that_count();
    if (edges.border.count + edges.overused.count > 0)
      refuse_gap(fmt::format("leaves a body that is not closed, at the edge from {}",
                             shown(edges.border.count > 0 ? edges.border : edges.overused)));
    if (findings_.num_pinched > 0)
      refuse_gap(
          fmt::format("makes parts of a body meet in a vertex, {}", text(findings_.first_pinched)));
  }

  [[noreturn]] void refuse_gap(const std::string& what) const {
    refuse("bringing together what is nearer than {} of another body (--gap) {}; give less",
           decimal(gap_), what);
  }

  // What rounding alone parts, of bodies, is made the same: cut along each other it would be dust.
  void join_near_bodies() {
    if (given_.empty() || !has_area()) return;
    if (gap_ == 0) precision_ = std::max(kRoundedSteps * coordinate_step(), raw_.precision);
    if (precision_ > 0) share_.require_whole();
    const bool is_joined = precision_ > 0 && bring_together(precision_, Nearness::kPrecision);
    const double near = kNear * std::max(max_norm(raw_.box.min), max_norm(raw_.box.max));
    if (bring_together(near, Nearness::kArithmetic) || is_joined) return check_again();
    for (TriangleList& list : raw_.triangles) raw_.spill.release(std::move(list));
    raw_.triangles.clear();
  }

  // The largest of those that bodies have.
  double coordinate_step() const {
    std::map<std::uint32_t, CoordinateStep> steps;
    for (const TriangleList& list : raw_.triangles)
      raw_.spill.for_each(list, [&](const Triangle& t) {
        CoordinateStep& step = steps[given_body(given_, t)];
        for (const Point& p : t.corners) step.add(p);
      });
    double largest = 0;
    for (const auto& [body, step] : steps) largest = std::max(largest, step.value());
    return largest;
  }

  // What bodies may be parted by: what was computed in several ways, coordinates that were rounded
  // when they were written or are meant no more precisely, or a gap that the user does not mean.
  enum class Nearness { kArithmetic, kPrecision, kGap };

  // Until nothing of two bodies is nearer than the distance, but is the same. Returns whether
  // something has changed.
  bool bring_together(double distance, Nearness nearness) {
    const bool is_arithmetic = nearness == Nearness::kArithmetic;
    bool is_changed = false;
    std::uint64_t most = std::numeric_limits<std::uint64_t>::max();  // each time fewer, to end
    for (int round = 0; round < kMostNearRounds; ++round) {
      const std::uint64_t num_changed =
          imprint_bodies({.distance = distance, .has_needles = is_changed}, !is_arithmetic);
      // What lies on each other but for the distance needs no vertices, but to be joined.
      if (num_changed == 0 && (is_arithmetic || round > 0)) break;
      is_changed = is_changed || num_changed > 0;
      distribute({}, true);
      WeldedSurface welded = welded_surface(
          raw_.spill, buckets_, is_arithmetic ? WeldPoints::kAll : WeldPoints::kBetweenBodies,
          distance, watch_, workers_, given_);
      const std::string obstacle = welded.num_joined > 0 ? obstacle_to(welded) : std::string();
      if (nearness == Nearness::kGap && !obstacle.empty()) refuse_gap(obstacle);
      if (welded.num_joined > 0 && obstacle.empty()) {
        if (!is_arithmetic) {
          num_joined_bodies_ += welded.num_joined;
          widest_gap_ = std::max(widest_gap_, welded.width);
        }
        adopt(std::move(welded.triangles));
        is_changed = true;
      } else {
        raw_.spill.release(std::move(welded.triangles));
      }
      if (num_changed > std::max(most, kFewChanges)) break;
      most = num_changed;
    }
    return is_changed;
  }

  // Returns how many triangles have changed.
  std::uint64_t imprint_bodies(const NearLaw& near, bool is_told) {
    TriangleBuckets buckets = buckets_.empty_ones();
    buckets.distribute(raw_.spill, raw_.triangles, raw_.box, {}, true, watch_, near.distance);
    CutSurface cut = locvol::cut_bodies(raw_.spill, buckets, drops_copies_, given_, raw_.box,
                                        raw_.has_pieces, near, watch_, workers_);
    buckets.release(raw_.spill);
    if (cut.obstacle) refuse_to_cut(*cut.obstacle);
    if (cut.num_cut == 0) return 0;
    share_.require_whole();
    add_meetings(cut.meetings);
    adopt(std::move(cut.triangles));
    raw_.has_pieces = true;
    if (is_told) {
      num_brought_ += cut.num_cut;
      widest_gap_ = std::max(widest_gap_, cut.widest);
    }
    return cut.num_cut;
  }

  void add_meetings(const std::map<MeetingBodies, Meeting>& found) {
    for (const auto& [bodies, more] : found) {
      Meeting& meeting = meetings_[bodies];
      for (std::size_t k = 0; k < 2; ++k) meeting.num_cut[k] += more.num_cut[k];
      if (!meeting.place) meeting.place = more.place;
    }
  }

  void check_again() {
    num_copies_ += drops_copies_ ? findings_.num_copies : 0;
    distribute({}, false);
    check(scope_);
    check_edges();
    check_orientation();
    check_vertices();
  }

  // Bodies that cross, or lie on each other with other triangles, get vertices and edges where they
  // do.
  void cut_bodies() {
    if (!findings_.intersection) return;
    const auto& [first, second] = *findings_.intersection;
    if (given_body(given_, first) == given_body(given_, second)) return;
    share_.require_whole();
    CutSurface cut = locvol::cut_bodies(raw_.spill, buckets_, drops_copies_, given_, raw_.box,
                                        raw_.has_pieces, {}, watch_, workers_);
    if (cut.obstacle) refuse_to_cut(*cut.obstacle);
    if (cut.num_cut == 0) return;
    add_meetings(cut.meetings);
    adopt(std::move(cut.triangles));
    raw_.has_pieces = true;
    check_again();
  }

  [[noreturn]] void refuse_to_cut(const CutObstacle& obstacle) const {
    const Triangle& triangle = obstacle.triangle;
    const std::string name = name_of(given_body(given_, triangle));
    if (obstacle.kind == CutObstacle::Kind::kMany)
      refuse(
          "{} of {} is met by {} of other bodies, and can be cut along {} at most; give it smaller "
          "triangles",
          text(triangle), name, counted(obstacle.num_cutters, "triangle", "triangles"),
          kMostCutters);
    refuse(
        "the bodies {} and {} nearly lie on each other: at {} only {} is between them, which comes "
        "from rounding; let faces that touch have the same vertices, join corners that are nearly "
        "one with --weld LENGTH, or move the bodies apart",
        name, name_of(obstacle.other), text(triangle), rounded(obstacle.width));
  }

  void check_self_intersection() const {
    auto pair = findings_.intersection;
    if (!drops_copies_ && findings_.first_copy) {
      const auto ids = [](const TrianglePair& p) { return std::pair(p.first.id, p.second.id); };
      if (!pair || ids(*findings_.first_copy) < ids(*pair)) pair = findings_.first_copy;
    }
    if (!pair) return;
    const std::uint32_t one = given_body(given_, pair->first),
                        other = given_body(given_, pair->second);
    if (one != other)
      refuse("the bodies {} and {} cross, or lie on each other: {} meets {}{}", name_of(one),
             name_of(other), shown(pair->first), shown(pair->second), about_bodies());
    refuse(
        "intersects itself: {} meets {}; repair the surface there, or unite the overlapping "
        "parts{}{}",
        shown(pair->first), shown(pair->second), cured_by("wrap"), about_bodies());
  }

  // By its number in the file.
  std::string shown(Triangle triangle) const {
    triangle.id = number_in_file(triangle.id, raw_.has_pieces);
    return text(triangle);
  }
  std::string shown(EdgeFlaws flaws) const {
    flaws.half_edge = 3 * number_in_file(flaws.half_edge / 3, raw_.has_pieces);
    return text(flaws);
  }

  // Of one that is given.
  std::string name_of(std::uint32_t body) const {
    return raw_.files.size() > 1 ? raw_.files[body].body : shown_name(raw_.groups[body]);
  }

  // Are holes all that is wrong with it? Where more triangles share an edge, some cells have two of
  // them alone, so that what is found of the orientation depends on the cells.
  bool has_only_holes() const {
    return !is_mostly_open() && !is_overused() && findings_.conflicts.count == 0;
  }
  bool is_overused() const { return findings_.edges_without_copies.overused.count > 0; }
  bool is_orientable() const { return is_overused() || findings_.conflicts.count == 0; }

  // Then it is made of sheets, or of triangles without neighbors, more than of parts with holes.
  bool is_mostly_open() const {
    constexpr double kMostOpen = 0.25;  // of the corners of triangles
    return static_cast<double>(findings_.edges_that_count().border.count) >
           kMostOpen * 3 * static_cast<double>(findings_.num_triangles);
  }

  // How the command makes a surface of it that can be meshed. It takes one file.
  std::string cured_by(std::string_view command) const {
    const bool is_file = raw_.file != kInMemory && raw_.file != kStandardInput;
    if (winding_.inside == InsideRule::kWrap) return ", or give another --wrap-alpha";
    if (raw_.has_several_bodies)
      return has_winding() || given_.empty()
                 ? ""
                 : ", or mesh what the triangles of each body wind around: --inside winding";
    if (!is_file || !raw_.files.empty()) return "";
    constexpr std::string_view kPlain =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._+-/";
    std::string file = raw_.file;
    if (file.find_first_not_of(kPlain) != file.npos) {
      std::string quoted = "'";
      for (const char c : file) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
      file = quoted + "'";
    }
    const auto cure = [&](std::string_view name) {
      return fmt::format(", or {} it: locvol {} {} -o {}.ply", name, name, file,
                         name == "wrap" ? "wrapped" : "repaired");
    };
    if (has_winding())
      return cure("wrap") + (wound_.doubt > 0
                                 ? fmt::format(" (by winding numbers, {} of the box is in doubt)",
                                               percent(wound_.doubt))
                                 : "");
    constexpr std::string_view kWinding =
        ", or mesh what its triangles wind around: --inside winding";
    const std::optional<WindingDoubt> doubt = doubt_of_winding();
    // What is mostly open has little inside.
    if (!doubt)
      return fmt::format("{}{}", cure(command),
                         is_mostly_open() || !is_orientable() ? "" : kWinding);
    if (doubt->is_nothing) return cure("wrap");
    const bool is_sheet = is_mostly_open() || doubt->inside < kLeastSurelyInside;
    const bool is_doubtful = doubt->share > kMostDoubt;
    if (is_doubtful && is_sheet)
      return fmt::format("{} (by winding numbers, {} of the box would be in doubt)", cure("wrap"),
                         percent(doubt->share));
    return fmt::format("{}{} ({} of the box is in doubt){}",
                       command == "repair" ? cure(command) : "", kWinding, percent(doubt->share),
                       is_doubtful ? cure("wrap") : "");
  }

  // Of what winding numbers would tell. Nothing: it would take more memory than the cap, or this is
  // a part of the surface.
  std::optional<WindingDoubt> doubt_of_winding() const {
    if (!share_.range().is_all() || winding_bytes(findings_.num_triangles) > winding_.cap)
      return std::nullopt;
    std::vector<Triangle> triangles;
    for (const TriangleBucket& bucket : buckets_.all()) {
      const Box cell = buckets_.frame().box(bucket.cell);
      for (const Triangle& t : raw_.spill.load(bucket.triangles))
        if (owns_triangle(cell, t)) triangles.push_back(t);
    }
    std::ranges::sort(triangles, {}, &Triangle::id);
    TriangleSoup soup = soup_of(triangles);
    return winding_doubt({std::move(soup.vertices), std::move(soup.triangles), {}}, watch_.stop());
  }

  std::string about_bodies() const {
    if (!raw_.has_several_bodies) return "";
    return given_.empty()
               ? ". Shells of one file without names may lie in each other and beside each other; "
                 "to have bodies that touch, give each as a file or a named group"
               : ". Bodies may lie in each other and beside each other, and touch where they have "
                 "the same triangles, edges or vertices: cut their faces alike, and join corners "
                 "that are nearly one with --weld LENGTH; or move them apart";
  }

  void note_repairs() {
    notes_ = raw_.notes;
    if (has_crossing_cut_)
      notes_.push_back(
          "facets that were cut from its curved faces cross: what they wind around is meshed; a "
          "smaller --size cuts them finer");
    const std::uint64_t num_joined = welded_ ? welded_->num_joined : 0;
    // Of bodies that touch, each may have its own.
    if (!findings_.has_contacts && raw_.num_numbered_vertices > findings_.num_vertices + num_joined)
      note("left out {} of no face, or at the same place as another",
           raw_.num_numbered_vertices - findings_.num_vertices - num_joined, "vertex", "vertices");
    note("joined {} with others up to " + joined_text(), num_joined, "point", "points");
    note("dropped {} with two equal corners", raw_.num_collapsed, "triangle", "triangles");
    note("dropped {} that repeated another",
         num_copies_ + (drops_copies_ ? findings_.num_copies : 0), "triangle", "triangles");
    note("flipped an edge of {} without area", raw_.collinear.size(), "triangle", "triangles");
    if (num_brought_ + num_joined_bodies_ > 0)
      notes_.push_back(fmt::format(
          "brought bodies together that were nearer than {} ({}): {} became one with those of "
          "others, and {} took their vertices, up to {} away",
          gap_ > 0 ? decimal(gap_) : rounded(precision_),
          gap_ > 0 ? "--gap" : "which is how precise coordinates are",
          counted(num_joined_bodies_, "point", "points"),
          counted(num_brought_, "triangle", "triangles"), rounded(widest_gap_)));
    note_winding();
    note_meetings();
  }

  void note_winding() {
    note_winding("by winding numbers", wound_);
    std::size_t num_told = 0;
    for (const auto& [body, wound] : wound_of_bodies_)
      if (num_told++ < kMostToldPairs) note_winding("by winding numbers of " + body, wound);
    if (wound_of_bodies_.size() > kMostToldPairs)
      note("by winding numbers {} changed, too", wound_of_bodies_.size() - kMostToldPairs,
           "more body", "more bodies");
  }
  void note_winding(const std::string& how, const WindingChanges& wound) {
    if (wound.num_joined + wound.num_turned + wound.num_cut + wound.num_holes == 0 &&
        wound.left_out_area == 0)
      return;
    note(how + ": joined {} with others up to " + rounded(wound.largest_move) + " away",
         wound.num_joined, "point", "points");
    note(how + ": turned {}", wound.num_turned, "triangle", "triangles");
    note(how + ": cut {} along others", wound.num_cut, "triangle", "triangles");
    if (wound.left_out_area >= 1e-9)
      notes_.push_back(fmt::format("{}: left out {} of the area, with the same on both sides", how,
                                   percent(wound.left_out_area)));
    if (wound.num_holes > 0)
      notes_.push_back(fmt::format("{}: closed {}, the largest of {}; that is {} of the area", how,
                                   counted(wound.num_holes, "hole", "holes"),
                                   counted(wound.largest_hole, "edge", "edges"),
                                   percent(wound.closing_area)));
    if (wound.is_level)
      notes_.push_back(how +
                       ": most of its triangles have no neighbors: the surface is where the "
                       "number is 1/2, at places λ apart");
    if (wound.doubt > 0)
      notes_.push_back(fmt::format("{}: in doubt is {} of the box", how, percent(wound.doubt)));
  }
  static std::string percent(double share) { return fmt::format("{:.3g}%", 100 * share); }

  void note_meetings() {
    std::size_t num_told = 0;
    for (const auto& [bodies, meeting] : meetings_) {
      if (num_told++ == kMostToldPairs) break;
      notes_.push_back(fmt::format(
          "{} and {} cross, or lie on each other: cut {} of {} and {} of {}{}", name_of(bodies.one),
          name_of(bodies.other), counted(meeting.num_cut[0], "triangle", "triangles"),
          name_of(bodies.one), meeting.num_cut[1], name_of(bodies.other),
          meeting.place ? fmt::format(", the first at {}", text(*meeting.place)) : ""));
    }
    if (meetings_.size() > kMostToldPairs)
      note("so do {} of bodies", meetings_.size() - kMostToldPairs, "more pair", "more pairs");
  }

  // The volume is that of the material: less in cavities. Orientation is the file's own affair; the
  // user may want to know.
  void measure() {
    const std::vector<SurfaceComponent>& components = findings_.joined.components;
    const std::vector<bool> is_cavity = cavities();
    CompensatedSum volume;
    std::uint64_t num_turned = 0;
    for (std::size_t c = 0; c < components.size(); ++c) {
      // Of what winding numbers part, some may be as thin as rounding.
      if (!components[c].has_certain_volume() && !has_winding())
        refuse("bounds no volume, to within rounding errors{}",
               components.size() == 1
                   ? ""
                   : fmt::format(", in its component up to {}", text(components[c].top)));
      const double enclosed = std::abs(components[c].volume());
      volume.add(is_cavity[c] ? -enclosed : enclosed);
      const bool is_wrong = (components[c].volume() < 0) != is_cavity[c];
      num_turned += is_wrong ? components[c].num_triangles - components[c].num_turned
                             : components[c].num_turned;
    }
    volume_ = volume.value();
    if (!raw_.has_several_bodies)  // else the material may be on both sides
      note("{} toward the material, where others face away; sides are found without that",
           num_turned, "triangle faces", "triangles face");
  }

  std::vector<bool> cavities() {
    if (findings_.joined.components.size() < 2) return {false};
    Nesting nesting(findings_.joined.components);
    for (const TriangleBucket& bucket : buckets_.all()) {
      const Box cell = buckets_.frame().box(bucket.cell);
      for (const Triangle& t : load(bucket))
        if (owns_triangle(cell, t)) nesting.add(t);
      watch_.advance(bucket.triangles.count);
    }
    std::vector<bool> cavities = nesting.cavities();
    share_.join_parities(cavities);
    return cavities;
  }

  CheckedSurface result() {
    CheckedSurface surface(std::move(raw_.spill), std::move(buckets_));
    surface.has_copies = drops_copies_;
    surface.has_pieces = raw_.has_pieces;
    surface.has_contacts = findings_.has_contacts;
    surface.given_bodies = given_;
    surface.groups = std::move(raw_.groups);
    surface.colors = std::move(raw_.colors);
    surface.files = std::move(raw_.files);
    surface.file_of_group = std::move(raw_.file_of_group);
    surface.sharp = std::move(findings_.sharp);
    if (!raw_.has_pieces) surface.first_over_hole = first_over_hole_;
    surface.facts = {.file = raw_.file,
                     .num_vertices = findings_.num_vertices,
                     .num_triangles = findings_.num_triangles,
                     .num_components = findings_.joined.components.size(),
                     .euler_characteristic = static_cast<std::int64_t>(findings_.num_vertices) -
                                             static_cast<std::int64_t>(findings_.num_triangles / 2),
                     .area = findings_.area.value(),
                     .volume = volume_,
                     .box = raw_.box,
                     .notes = std::move(notes_),
                     .facing = facing_facts(findings_.sights)};
    return surface;
  }

  void note(std::string_view pattern, std::uint64_t count, std::string_view one,
            std::string_view many) {
    if (count > 0) notes_.push_back(fmt::format(fmt::runtime(pattern), counted(count, one, many)));
  }

  // Of points that were joined, how.
  std::string joined_text() const {
    if (!welded_) return {};
    return fmt::format("{} away, of those closer than {}{}", rounded(welded_->width),
                       rounded(welded_->distance),
                       weld_ ? " (--weld)" : "; else it is not closed (--weld 0 leaves them)");
  }

  template <typename... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> pattern, Args&&... args) const {
    std::string what = fmt::format(pattern, std::forward<Args>(args)...);
    if (welded_)
      what += fmt::format(". So it is with {} joined to others, up to {}",
                          counted(welded_->num_joined, "point", "points"), joined_text());
    share_.refuse(fmt::format("{}: {}", raw_.file, what));
  }

  RawSurface raw_;
  IngestWatch& watch_;
  Workers& workers_;
  const IngestShare& share_;
  std::optional<double> weld_;
  double gap_;
  GivenBodies given_;
  SharpAngle angle_;
  WindingLaw winding_;
  WindingChanges wound_;
  std::vector<std::pair<std::string, WindingChanges>> wound_of_bodies_;  // by name: those changed
  std::uint64_t first_over_hole_ = SharpAngle::kNoHoles;                 // triangle
  TriangleBuckets buckets_;
  SurfaceFindings findings_;
  CheckScope scope_ = CheckScope::kAll;
  bool drops_copies_ = false;
  std::optional<WeldedSurface> welded_;  // without its triangles
  std::string tried_;                    // to close it
  std::map<MeetingBodies, Meeting> meetings_;
  std::uint64_t num_copies_ = 0;  // that were dropped before bodies were cut
  bool has_crossing_cut_ = false;
  double precision_ = 0;  // of coordinates, where bodies touch
  // Where bodies were nearer than gap_, or than coordinates tell: triangles that took vertices,
  // points that became others, and how far these were away.
  std::uint64_t num_brought_ = 0, num_joined_bodies_ = 0;
  double widest_gap_ = 0;
  double volume_ = 0;
  std::vector<std::string> notes_;
};

}  // namespace

void BodyLabels::apply_to(std::vector<Triangle>& triangles) const {
  std::erase_if(triangles, [&](const Triangle& triangle) {
    return changes[triangle.change.number()] == DomainState();
  });
  for (Triangle& triangle : triangles) {
    const std::uint32_t part = triangle.change.number();
    triangle.change = changes[part];
    const std::span own(groups.data() + first[part], groups.data() + first[part + 1]);
    triangle.sheet = std::ranges::find(own, triangle.sheet, &Group::before)->now;
  }
}

GivenBodies RawSurface::given_bodies() const {
  if (!has_several_bodies) return {};
  if (files.size() > 1) return file_of_group;
  if (groups.size() == 1) return {};
  GivenBodies given(groups.size());
  std::iota(given.begin(), given.end(), std::uint32_t{0});
  return given;
}

std::vector<Triangle> CheckedSurface::load(const TriangleBucket& bucket) const {
  std::vector<Triangle> triangles = spill.load(bucket.triangles);
  if (has_copies) drop_copies(triangles, given_bodies);
  if (labels) labels->apply_to(triangles);
  if (!sheets.empty())
    for (Triangle& triangle : triangles) triangle.sheet = sheets[triangle.sheet];
  return triangles;
}

// What is of parts has neither copies nor labels.
std::vector<SheetPiece> CheckedSurface::pieces_of(const TriangleBucket& bucket) const {
  std::vector<SheetPiece> found;
  if (pieces.empty()) return found;
  for (const Triangle& triangle : spill.load(bucket.triangles))
    found.push_back(pieces[triangle.sheet]);
  return found;
}

CheckedSurface check_surface(RawSurface raw, const Frame& frame, IngestWatch& watch,
                             Workers& workers, std::uint64_t bucket_capacity,
                             const IngestShare& share, const std::optional<double>& weld,
                             double sharp_angle, double gap, const WindingLaw& winding) {
  return SurfacePreparation(std::move(raw), frame, watch, workers, bucket_capacity, share, weld,
                            sharp_angle, gap, winding)
      .run();
}

Frame frame_of(const Box& surface) {
  const Point sides = surface.max - surface.min;
  for (double leaf_side = std::max({sides.x, sides.y, sides.z});; leaf_side *= 2) {
    try {
      return Frame::around(surface, 0, leaf_side);
    } catch (const std::invalid_argument&) {
      // Its grid would be finer than the coordinates so far from the origin: a wider one is not.
    }
  }
}

}  // namespace locvol
