#include "engine/ingest/shared_faces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "engine/ingest/body_cuts.h"
#include "engine/ingest/part_joiner.h"
#include "engine/ingest/surface_components.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "engine/shared/sorted_spill.h"
#include "octree/disjoint_sets.h"
#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

constexpr std::uint32_t kUnnumbered = std::numeric_limits<std::uint32_t>::max();

// Of a triangle, what lies where its normal points to, and behind it.
enum Side : std::uint32_t { kFront = 0, kBack = 1 };
std::uint32_t side_of(std::uint32_t triangle, Side side) { return 2 * triangle + side; }

// The sides of triangles that hang together, in a cell or in all.
struct SidePart {
  SurfaceComponent sum;  // facing outwards
  void add(const SidePart& other, bool is_turned) { sum.add(other.sum, is_turned); }
};

struct SidedTriangle {
  Triangle triangle;
  std::array<std::uint32_t, 2> parts{};  // of its sides
  std::uint64_t id() const { return triangle.id; }
};
using SidedTriangles = SortedSpill<SidedTriangle, &SidedTriangle::id>;

struct SharedSide {  // of a triangle that other cells have, too
  std::uint64_t side = 0;
  std::uint32_t part = 0;
  bool is_last = false;
};

struct CellRegions {
  std::optional<FaceObstacle> obstacle;
  std::vector<SidedTriangle> owned;
  std::vector<SidePart> parts;
  std::vector<SharedSide> shared;
};

class RegionsOfCell {
 public:
  RegionsOfCell(std::vector<Triangle> triangles, const TriangleBucket& bucket,
                const TriangleBuckets& buckets, double middle_z)
      : triangles_(std::move(triangles)),
        cell_(bucket.cell),
        buckets_(buckets),
        box_(buckets.frame().box(bucket.cell)),
        middle_z_(middle_z),
        soup_(soup_of(triangles_)),
        sides_(2 * triangles_.size()) {}

  CellRegions run() && {
    EdgeTable(soup_.vertices.size(), soup_.triangles)
        .for_each_edge([&](std::span<const std::uint32_t> uses) {
          if (TriangleBuckets::meets_edge(box_, point(origin(soup_.triangles, uses[0])),
                                          point(target(soup_.triangles, uses[0]))))
            join_around(uses);
        });
    if (!found_.obstacle) list_parts();
    return std::move(found_);
  }

 private:
  const Point& point(std::uint32_t vertex) const { return soup_.vertices[vertex]; }

  // The side of its triangle that one comes to, turning left around the edge, seen against its
  // direction. `from`: where that begins
  std::uint32_t left_side(std::uint32_t h, std::uint32_t from) const {
    return side_of(h / 3, origin(soup_.triangles, h) == from ? kFront : kBack);
  }
  std::uint32_t right_side(std::uint32_t h, std::uint32_t from) const {
    return left_side(h, from) ^ 1U;
  }

  void join_around(std::span<const std::uint32_t> uses) {
    if (uses.size() == 1) return refuse(FaceObstacle::Kind::kOpen, uses[0]);
    const std::uint32_t from = origin(soup_.triangles, uses[0]);
    std::vector<std::uint32_t> order(uses.begin(), uses.end());
    if (order.size() > 2 && !put_in_order(order, from, target(soup_.triangles, uses[0]))) return;
    for (std::size_t i = 0; i < order.size(); ++i)
      sides_.unite(left_side(order[i], from), right_side(order[(i + 1) % order.size()], from));
  }

  // As one turns left around the edge, from the first on. False: two lie on each other.
  bool put_in_order(std::vector<std::uint32_t>& order, std::uint32_t from, std::uint32_t to) {
    const Point &u = point(from), &v = point(to), &r = point(apex(soup_.triangles, order[0]));
    Point aside = u;  // not in the plane of the edge and the first
    for (int axis = 0; axis < 3 && orientation(u, v, r, aside) == 0; ++axis) {
      aside = u;
      aside[axis] += norm(v - u);
    }
    const int side_of_first = orientation(u, v, aside, r);
    struct Place {
      int quarter = 0;  // 0: as the first; 1: to its left; 2: opposite; 3: to its right
      std::uint32_t half_edge = 0;
    };
    std::vector<Place> places;
    for (const std::uint32_t h : order) {
      const Point& p = point(apex(soup_.triangles, h));
      const int turn = orientation(u, v, r, p);
      const bool is_opposite = turn == 0 && orientation(u, v, aside, p) != side_of_first;
      places.push_back({turn > 0 ? 1 : turn < 0 ? 3 : is_opposite ? 2 : 0, h});
    }
    const auto turn_between = [&](const Place& a, const Place& b) {
      return orientation(u, v, point(apex(soup_.triangles, a.half_edge)),
                         point(apex(soup_.triangles, b.half_edge)));
    };
    std::ranges::sort(places, [&](const Place& a, const Place& b) {
      if (a.quarter != b.quarter) return a.quarter < b.quarter;
      if (a.quarter % 2 == 0) return a.half_edge < b.half_edge;
      const int turn = turn_between(a, b);
      return turn != 0 ? turn > 0 : a.half_edge < b.half_edge;
    });
    for (std::size_t i = 0; i < places.size(); ++i) {
      if (i > 0 && places[i].quarter == places[i - 1].quarter &&
          (places[i].quarter % 2 == 0 || turn_between(places[i - 1], places[i]) == 0)) {
        refuse(FaceObstacle::Kind::kFold, std::max(places[i - 1].half_edge, places[i].half_edge));
        return false;
      }
      order[i] = places[i].half_edge;
    }
    return true;
  }

  void refuse(FaceObstacle::Kind kind, std::uint32_t h) {
    const Triangle& triangle = triangles_[h / 3];
    if (!found_.obstacle || triangle.id < found_.obstacle->triangle.id)
      found_.obstacle = {kind, triangle};
  }

  void list_parts() {
    std::vector<std::uint32_t> number(sides_.num_members(), kUnnumbered);
    const auto part_of = [&](std::uint32_t side) {
      std::uint32_t& part = number[sides_.find(side)];
      if (part == kUnnumbered) {
        part = static_cast<std::uint32_t>(found_.parts.size());
        found_.parts.emplace_back();
      }
      return part;
    };
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      const Triangle& triangle = triangles_[t];
      const std::array parts = {part_of(side_of(t, kFront)), part_of(side_of(t, kBack))};
      if (owns_triangle(box_, triangle)) {
        for (const Side side : {kFront, kBack})
          found_.parts[parts[side]].sum.add_volume(triangle, side == kFront, middle_z_);
        found_.owned.push_back({triangle, parts});
      }
      if (!TriangleBuckets::reaches_out(box_, triangle)) continue;
      const bool is_last = buckets_.is_last_with(cell_, triangle);
      for (const Side side : {kFront, kBack})
        found_.shared.push_back({2 * triangle.id + side, parts[side], is_last});
    }
  }

  std::vector<Triangle> triangles_;
  MortonKey cell_;
  const TriangleBuckets& buckets_;
  Box box_;
  double middle_z_;
  TriangleSoup soup_;
  DisjointSets sides_;
  CellRegions found_;
};

class FacesOfRegions {
 public:
  FacesOfRegions(TriangleSpill& spill, const TriangleBuckets& buckets,
                 std::span<const std::uint32_t> given, const Box& box, bool has_pieces,
                 IngestWatch& watch, Workers& workers)
      : spill_(spill),
        buckets_(buckets),
        given_(given),
        middle_z_(box.center().z),
        has_pieces_(has_pieces),
        watch_(watch),
        workers_(workers),
        triangles_(spill.directory()) {}

  RegionFaces run() {
    find_parts();
    if (result_.obstacle) return std::move(result_);
    triangles_.finish();
    JoinedParts<SidePart> joined = joiner_.take(numbers_);
    walls_ = std::move(joined.components);
    regions_.assign(walls_.size(), kUnnumbered);
    write();
    if (!result_.obstacle) return std::move(result_);
    spill_.release(std::move(result_.triangles));
    return {.obstacle = result_.obstacle};
  }

 private:
  void find_parts() {
    for_each_in_order(
        workers_, buckets_.all(),
        [&](const TriangleBucket& bucket) {
          std::vector<Triangle> triangles = spill_.load(bucket.triangles);
          drop_copies(triangles);
          return triangles;
        },
        [&](const TriangleBucket& bucket, std::vector<Triangle> triangles) {
          throw_if_stopped(watch_.stop());
          return RegionsOfCell(std::move(triangles), bucket, buckets_, middle_z_).run();
        },
        [&](const TriangleBucket& bucket, CellRegions& cell) {
          if (cell.obstacle) refuse(cell.obstacle->kind, cell.obstacle->triangle);
          const std::uint32_t first = num_parts_;
          for (const SidePart& part : cell.parts) num_parts_ = joiner_.add_part(part) + 1;
          for (const auto& [side, part, is_last] : cell.shared)
            joiner_.join(side, first + part, false, is_last);
          for (SidedTriangle& sided : cell.owned) {
            for (std::uint32_t& part : sided.parts) part += first;
            triangles_.append(sided);
          }
          watch_.advance(bucket.triangles.count);
        });
  }

  void refuse(FaceObstacle::Kind kind, const Triangle& triangle) {
    if (!result_.obstacle || triangle.id < result_.obstacle->triangle.id)
      result_.obstacle = {kind, triangle};
  }

  void write() {
    TriangleWriter writer(spill_, result_.triangles);
    for (; !triangles_.is_empty() && !result_.obstacle; triangles_.pop()) {
      const auto& [triangle, parts] = triangles_.front();
      const std::array walls = {numbers_[parts[kFront]], numbers_[parts[kBack]]};
      for (const std::uint32_t wall : walls)
        if (!walls_[wall].sum.has_certain_volume())
          return refuse(FaceObstacle::Kind::kThin, triangle);
      if (walls[kFront] == walls[kBack]) return refuse(FaceObstacle::Kind::kWithin, triangle);
      const bool has_front = is_outer(walls[kFront]), has_back = is_outer(walls[kBack]);
      if (has_front && has_back) ++result_.num_shared;
      const std::uint64_t in_file = number_in_file(triangle.id, has_pieces_);
      if (in_file != std::exchange(last_in_file_, in_file)) num_pieces_ = 0;
      for (const std::uint32_t wall : walls) {
        if (!is_outer(wall)) continue;
        Triangle copy = triangle;
        copy.id = kMostPieces * in_file + num_pieces_++;
        const std::uint32_t region = region_of(wall);
        copy.sheet = group_of(triangle.sheet, region);
        if (has_front != has_back) note_given(region, given_body(given_, triangle));
        writer.append(copy);
      }
      watch_.advance();
    }
    writer.flush();
    for (std::optional<std::uint32_t>& own : result_.given_body)
      if (own == kUnnumbered) own.reset();
  }

  bool is_outer(std::uint32_t wall) const { return walls_[wall].sum.volume() > 0; }

  std::uint32_t region_of(std::uint32_t wall) {
    std::uint32_t& region = regions_[wall];
    if (region == kUnnumbered) {
      region = static_cast<std::uint32_t>(result_.given_body.size());
      result_.given_body.emplace_back();
    }
    return region;
  }

  SheetId group_of(SheetId before, std::uint32_t region) {
    const auto [group, is_new] =
        groups_.try_emplace({before, region}, static_cast<SheetId>(groups_.size() + 1));
    if (is_new) {
      result_.group_before.push_back(before);
      result_.region_of_group.push_back(region);
    }
    return group->second;
  }

  void note_given(std::uint32_t region, std::uint32_t body) {
    std::optional<std::uint32_t>& own = result_.given_body[region];
    own = !own || own == body ? body : kUnnumbered;
  }

  TriangleSpill& spill_;
  const TriangleBuckets& buckets_;
  std::span<const std::uint32_t> given_;
  double middle_z_;
  bool has_pieces_;
  IngestWatch& watch_;
  Workers& workers_;
  PartJoiner<SidePart> joiner_;
  std::uint32_t num_parts_ = 0;
  SidedTriangles triangles_;
  std::vector<std::uint32_t> numbers_;  // by part, its place among walls
  std::vector<SidePart> walls_;         // what the sides in all cells hang together as
  std::vector<std::uint32_t> regions_;  // of walls that are the outer ones of a region
  std::map<std::pair<SheetId, std::uint32_t>, SheetId> groups_;
  std::uint64_t last_in_file_ = std::numeric_limits<std::uint64_t>::max(), num_pieces_ = 0;
  RegionFaces result_;
};

}  // namespace

RegionFaces faces_of_regions(TriangleSpill& spill, const TriangleBuckets& buckets,
                             std::span<const std::uint32_t> given, const Box& box, bool has_pieces,
                             IngestWatch& watch, Workers& workers) {
  return FacesOfRegions(spill, buckets, given, box, has_pieces, watch, workers).run();
}

}  // namespace locvol
