#include "engine/ingest/surface_weld.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <compare>
#include <limits>
#include <span>

#include "engine/ingest/near_points.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_repair.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "engine/shared/sorted_spill.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

// In distances. A group that is narrow and has a point of a cell lies within two of the cell, and
// what would widen it within three.
constexpr double kTooWide = 2, kKnown = 3, kSeen = 4;
// Below that, of the octree's width, no distance joins anything.
constexpr double kLeastDistance = 1e-100;
// Of lengths; a distance asks for none among ten times its own.
constexpr double kFree = 10;

// A node of the octree with the buckets of all cells in it: one, or several that are small.
struct WeldCell {
  MortonKey node;
  std::span<const TriangleBucket> buckets;
};

std::vector<WeldCell> cells_for(const TriangleBuckets& buckets, double distance) {
  const int deepest = buckets.frame().level_of_side(kLeastWeldCell * distance);
  std::vector<WeldCell> cells;
  for (const TriangleBucket& bucket : buckets.all()) {
    if (!cells.empty() && cells.back().node.is_ancestor_or_self_of(bucket.cell)) continue;
    MortonKey node = bucket.cell;
    while (node.level() > deepest) node = node.parent();
    cells.push_back({node, buckets.under(node)});
  }
  return cells;
}

// In order of id; those that meet the cell. Nothing: there are too many.
std::optional<std::vector<Triangle>> triangles_of(const WeldCell& cell,
                                                  const TriangleSpill& spill) {
  if (cell.buckets.size() == 1) return spill.load(cell.buckets.front().triangles);
  std::vector<Triangle> triangles;
  for (const TriangleBucket& bucket : cell.buckets) {
    const std::vector<Triangle> held = spill.load(bucket.triangles);
    triangles.insert(triangles.end(), held.begin(), held.end());
    sort_and_unite(triangles, &Triangle::id);
    if (triangles.size() > kMaxWeldTriangles) return std::nullopt;
  }
  return triangles;
}

// By vertex: is it one of those that may be joined?
std::vector<bool> eligible_vertices(const TriangleSoup& soup, WeldPoints points) {
  const bool are_all = points != WeldPoints::kOfOpenEdges;
  std::vector<bool> is_eligible(soup.vertices.size(), are_all);
  if (are_all) return is_eligible;
  EdgeTable(soup.vertices.size(), soup.triangles)
      .for_each_edge([&](std::span<const std::uint32_t> uses) {
        const std::uint32_t beyond = apex(soup.triangles, uses.front());
        if (std::ranges::any_of(uses,
                                [&](std::uint32_t h) { return apex(soup.triangles, h) != beyond; }))
          return;
        is_eligible[origin(soup.triangles, uses.front())] = true;
        is_eligible[target(soup.triangles, uses.front())] = true;
      });
  return is_eligible;
}

// Of a point, the body that is given which has it; or kSeveral.
constexpr std::uint32_t kSeveral = std::numeric_limits<std::uint32_t>::max();

// By vertex.
std::vector<std::uint32_t> bodies_of(const TriangleSoup& soup, std::span<const Triangle> triangles,
                                     std::span<const std::uint32_t> given, WeldPoints points) {
  if (points != WeldPoints::kBetweenBodies) return std::vector<std::uint32_t>(soup.vertices.size());
  constexpr std::uint32_t kNone = kSeveral - 1;
  std::vector<std::uint32_t> bodies(soup.vertices.size(), kNone);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const std::uint32_t body = given_body(given, triangles[t]);
    for (const std::uint32_t v : soup.triangles[t])
      bodies[v] = bodies[v] == kNone || bodies[v] == body ? body : kSeveral;
  }
  return bodies;
}

// A point that another cell has to know.
struct Guest {
  std::uint32_t cell = 0;  // the other one's place
  Point point;
  std::uint32_t body = 0;
  friend auto operator<=>(const Guest&, const Guest&) = default;
};
using GuestSpill = SortedSpill<Guest>;

// A corner whose point becomes another.
struct MovedCorner {
  std::uint64_t half_edge = 0;  // 3 times the triangle's id, and the corner's number
  Point to;
};
using MovedCorners = SortedSpill<MovedCorner, &MovedCorner::half_edge>;

struct KnownTriangle {
  Triangle triangle;
  bool is_copy = false;  // one with the same vertices comes before
  std::uint64_t id() const { return triangle.id; }
};
using KnownTriangles = SortedSpill<KnownTriangle, &KnownTriangle::id>;

class SurfaceWelder {
 public:
  SurfaceWelder(TriangleSpill& spill, const TriangleBuckets& buckets, WeldPoints points,
                double distance, IngestWatch& watch, Workers& workers,
                std::span<const std::uint32_t> given)
      : spill_(spill),
        buckets_(buckets),
        points_(points),
        distance_(distance),
        watch_(watch),
        workers_(workers),
        given_(given),
        cells_(cells_for(buckets, distance)) {}

  WeldedSurface run() {
    result_.distance = distance_;
    if (distance_ < kLeastDistance * buckets_.frame().side(0)) return std::move(result_);
    GuestSpill guests(spill_.directory());
    find_guests(guests);
    if (result_.is_crowded) return std::move(result_);
    guests.finish();
    MovedCorners moved(spill_.directory());
    join(guests, moved);
    if (result_.num_joined == 0) return std::move(result_);
    moved.finish();
    move(moved);
    return std::move(result_);
  }

 private:
  // ---- Which points cells tell others of ----

  void find_guests(GuestSpill& guests) {
    for_each_in_order(
        workers_, std::span<const WeldCell>(cells_),
        [&](const WeldCell& cell) {
          if (result_.is_crowded) return std::vector<Triangle>();
          auto triangles = triangles_of(cell, spill_);
          result_.is_crowded = !triangles;
          return triangles ? *std::move(triangles) : std::vector<Triangle>();
        },
        [&](const WeldCell& cell, std::vector<Triangle> triangles) {
          throw_if_stopped(watch_.stop());
          return guests_from(cell, triangles);
        },
        [&](const WeldCell& cell, const std::vector<Guest>& found) {
          for (const Guest& guest : found) guests.append(guest);
          advance(cell);
        });
  }

  // All triangles at the points near the cell's border are enough to know which of these are
  // eligible.
  std::vector<Guest> guests_from(const WeldCell& cell, std::vector<Triangle>& triangles) const {
    const Box box = buckets_.frame().box(cell.node);
    const Box inner = box.expanded(-kSeen * distance_);
    const auto is_near_border = [&](const Point& p) {
      return TriangleBuckets::owns(box, p) && !inner.contains(p);
    };
    std::erase_if(triangles, [&](const Triangle& t) {
      return std::ranges::none_of(t.corners, is_near_border);
    });
    const TriangleSoup soup = soup_of(triangles);
    const std::vector<bool> is_eligible = eligible_vertices(soup, points_);
    const std::vector<std::uint32_t> bodies = bodies_of(soup, triangles, given_, points_);
    std::vector<Guest> guests;
    for (std::size_t v = 0; v < soup.vertices.size(); ++v) {
      const Point& p = soup.vertices[v];
      if (!is_eligible[v] || !is_near_border(p)) continue;
      const Box reach = Box::around(p).expanded(kSeen * distance_);
      for_each_cell_in(reach, MortonKey::root(), [&](std::uint32_t other) {
        if (cells_[other].node != cell.node) guests.push_back({other, p, bodies[v]});
      });
    }
    return guests;
  }

  template <class Visit>
  void for_each_cell_in(const Box& reach, MortonKey node, const Visit& visit) const {
    if (!buckets_.frame().box(node).overlaps(reach)) return;
    const auto first = std::ranges::lower_bound(
        cells_, node.range_min(), {}, [](const WeldCell& c) { return c.node.range_max(); });
    if (first == cells_.end() || node.range_max() < first->node.range_min()) return;
    if (first->node.is_ancestor_or_self_of(node))
      return visit(static_cast<std::uint32_t>(first - cells_.begin()));
    for (int octant = 0; octant < 8; ++octant) for_each_cell_in(reach, node.child(octant), visit);
  }

  // ---- Which points become which ----

  struct Loaded {
    std::vector<Triangle> triangles;
    std::vector<Guest> guests;
  };
  struct Joined {
    std::vector<MovedCorner> corners;
    std::uint64_t num_points = 0;
    double width = 0;
    std::optional<Point> too_wide;
  };

  void join(GuestSpill& guests, MovedCorners& moved) {
    for_each_in_order(
        workers_, std::span<const WeldCell>(cells_),
        [&](const WeldCell& cell) {
          Loaded loaded{triangles_of(cell, spill_).value(), {}};
          loaded.guests = guests_of(cell, loaded.triangles, guests);
          return loaded;
        },
        [&](const WeldCell& cell, const Loaded& loaded) {
          throw_if_stopped(watch_.stop());
          return joined(cell, loaded);
        },
        [&](const WeldCell& cell, const Joined& found) {
          for (const MovedCorner& corner : found.corners) moved.append(corner);
          result_.num_joined += found.num_points;
          result_.width = std::max(result_.width, found.width);
          if (found.too_wide && (!result_.too_wide || *found.too_wide < *result_.too_wide))
            result_.too_wide = found.too_wide;
          advance(cell);
        });
  }

  // Those near points of the cell: others cannot matter, and there may be any number.
  std::vector<Guest> guests_of(const WeldCell& cell, const std::vector<Triangle>& triangles,
                               GuestSpill& all) const {
    const auto number = static_cast<std::uint32_t>(&cell - cells_.data());
    std::vector<Guest> guests;
    if (all.is_empty() || all.front().cell != number) return guests;
    const std::vector<GridCube> cubes = cubes_seen(cell, triangles);
    for (; !all.is_empty() && all.front().cell == number; all.pop()) {
      const Guest& guest = all.front();
      if (std::ranges::binary_search(cubes, cube_of(guest.point, cube_side())))
        guests.push_back(guest);
    }
    return guests;
  }

  // No shorter than what a point sees, to both sides.
  double cube_side() const { return 2 * grid_side_up_to(2 * kSeen * distance_); }

  // Those that lie within kSeen of points of the cell near its border; ascending.
  std::vector<GridCube> cubes_seen(const WeldCell& cell,
                                   const std::vector<Triangle>& triangles) const {
    const Box box = buckets_.frame().box(cell.node);
    const double reach = kSeen * distance_;
    const Box inner = box.expanded(-reach);
    std::vector<GridCube> cubes;
    for (const Triangle& t : triangles)
      for (const Point& p : t.corners) {
        if (!TriangleBuckets::owns(box, p) || inner.contains(p)) continue;
        const Box seen = Box::around(p).expanded(reach);
        for (int corner = 0; corner < 8; ++corner)
          cubes.push_back(
              cube_of({corner & 1 ? seen.max.x : seen.min.x, corner & 2 ? seen.max.y : seen.min.y,
                       corner & 4 ? seen.max.z : seen.min.z},
                      cube_side()));
      }
    sort_and_unite(cubes);
    return cubes;
  }

  Joined joined(const WeldCell& cell, const Loaded& loaded) const {
    const Box box = buckets_.frame().box(cell.node);
    const TriangleSoup soup = soup_of(loaded.triangles);
    const std::vector<bool> is_eligible = eligible_vertices(soup, points_);
    const std::vector<std::uint32_t> bodies = bodies_of(soup, loaded.triangles, given_, points_);
    std::vector<Guest> known_points = loaded.guests;
    for (std::size_t v = 0; v < soup.vertices.size(); ++v)
      if (is_eligible[v] && TriangleBuckets::owns(box, soup.vertices[v]))
        known_points.push_back({0, soup.vertices[v], bodies[v]});
    std::ranges::sort(known_points, {}, &Guest::point);
    std::vector<Point> points;
    points.reserve(known_points.size());
    for (const Guest& known : known_points) points.push_back(known.point);

    const PointGroups near = near_groups(points, distance_);
    std::vector<bool> is_of_several(near.groups.size(), points_ != WeldPoints::kBetweenBodies);
    for (std::size_t p = 0; p < points.size(); ++p) {
      const std::uint32_t group = near.of_point[p], body = known_points[p].body;
      if (body == kSeveral || body != known_points[near.groups[group].first].body)
        is_of_several[group] = true;
    }
    const Box known = box.expanded(kKnown * distance_);
    const auto is_narrow = [&](const PointGroup& group) {
      return known.contains(group.box.min) && known.contains(group.box.max) &&
             group.width() < kTooWide * distance_;
    };
    Joined result;
    std::vector<std::pair<Point, Point>> moves;  // ascending
    for (std::size_t p = 0; p < points.size(); ++p) {
      const PointGroup& group = near.groups[near.of_point[p]];
      if (group.count == 1 || !is_of_several[near.of_point[p]] ||
          !TriangleBuckets::owns(box, points[p]))
        continue;
      if (!is_narrow(group)) {
        if (!result.too_wide) result.too_wide = points[p];
        continue;
      }
      result.width = std::max(result.width, group.width());
      if (group.first != p) moves.emplace_back(points[p], points[group.first]);
    }
    result.num_points = moves.size();
    if (moves.empty()) return result;
    for (const Triangle& t : loaded.triangles)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto move =
            std::ranges::lower_bound(moves, t.corners[k], {}, &std::pair<Point, Point>::first);
        if (move != moves.end() && move->first == t.corners[k])
          result.corners.push_back({3 * t.id + k, move->second});
      }
    return result;
  }

  // ---- The surface with other corners ----

  void move(MovedCorners& moved) {
    KnownTriangles known(spill_.directory());
    for_each_in_order(
        workers_, buckets_.all(),
        [&](const TriangleBucket& bucket) { return spill_.load(bucket.triangles); },
        [&](const TriangleBucket& bucket, const std::vector<Triangle>& triangles) {
          throw_if_stopped(watch_.stop());
          return owned(bucket, triangles);
        },
        [&](const TriangleBucket& bucket, const std::vector<KnownTriangle>& triangles) {
          for (const KnownTriangle& triangle : triangles) known.append(triangle);
          watch_.advance(bucket.triangles.count);
        });
    known.finish();
    TriangleWriter writer(spill_, result_.triangles);
    for (; !known.is_empty(); known.pop()) {
      KnownTriangle next = known.front();
      for (; !moved.is_empty() && moved.front().half_edge / 3 == next.triangle.id; moved.pop())
        next.triangle.corners[moved.front().half_edge % 3] = moved.front().to;
      add(next, writer);
      watch_.advance();
    }
    assert(moved.is_empty());
    writer.flush();
  }

  // Each triangle is of the cell that owns its smallest corner, where its copies are, too.
  std::vector<KnownTriangle> owned(const TriangleBucket& bucket,
                                   const std::vector<Triangle>& triangles) const {
    const Box box = buckets_.frame().box(bucket.cell);
    std::vector<KnownTriangle> owned;
    for (const Triangle& t : triangles)
      if (owns_triangle(box, t)) owned.push_back({t, true});
    std::vector<Triangle> distinct;
    distinct.reserve(owned.size());
    for (const KnownTriangle& t : owned) distinct.push_back(t.triangle);
    drop_copies(distinct);
    auto first = distinct.begin();
    for (KnownTriangle& t : owned) {
      if (first == distinct.end() || first->id != t.triangle.id) continue;
      t.is_copy = false;
      ++first;
    }
    return owned;
  }

  void add(const KnownTriangle& known, TriangleWriter& writer) {
    const Triangle& triangle = known.triangle;
    const auto& [a, b, c] = triangle.corners;
    if (a == b || b == c || c == a) {
      ++result_.num_collapsed;
      return;
    }
    if (known.is_copy) ++result_.num_copies;
    if (result_.collinear.size() <= kMaxCollinear && are_collinear(a, b, c))
      result_.collinear.push_back(triangle);
    writer.append(triangle);
  }

  void advance(const WeldCell& cell) {
    for (const TriangleBucket& bucket : cell.buckets) watch_.advance(bucket.triangles.count);
  }

  TriangleSpill& spill_;
  const TriangleBuckets& buckets_;
  WeldPoints points_;
  double distance_;
  IngestWatch& watch_;
  Workers& workers_;
  std::span<const std::uint32_t> given_;
  std::vector<WeldCell> cells_;  // in Morton order
  WeldedSurface result_;
};

}  // namespace

void EdgeLengths::add(double length) {
  const auto [known, is_new] =
      ranges_.try_emplace(std::bit_cast<std::uint64_t>(length) >> 50, length, length);
  auto& [shortest, longest] = known->second;
  shortest = std::min(shortest, length);
  longest = std::max(longest, length);
}

void EdgeLengths::add(const EdgeLengths& others) {
  for (const auto& [place, range] : others.ranges_) add(range.first), add(range.second);
}

std::optional<double> EdgeLengths::next_distance(double above, double least, double most) const {
  double longest_below = least;
  const auto between = [&](double shortest_above) -> std::optional<double> {
    const double distance = std::min(shortest_above / kFree, most);
    if (distance > longest_below && distance > above) return distance;
    return std::nullopt;
  };
  for (const auto& [place, range] : ranges_) {
    if (const auto distance = between(range.first)) return distance;
    longest_below = std::max(longest_below, range.second);
  }
  return between(std::numeric_limits<double>::infinity());
}

double EdgeLengths::shortest_above(double least) const {
  for (const auto& [place, range] : ranges_)
    if (range.first > least) return range.first;
  return std::numeric_limits<double>::infinity();
}

EdgeLengths edge_lengths(const TriangleSpill& spill, const TriangleBuckets& buckets,
                         WeldPoints points, IngestWatch& watch, Workers& workers) {
  EdgeLengths all;
  for_each_in_order(
      workers, buckets.all(),
      [&](const TriangleBucket& bucket) { return spill.load(bucket.triangles); },
      [&](const TriangleBucket& bucket, const std::vector<Triangle>& triangles) {
        throw_if_stopped(watch.stop());
        const Box box = buckets.frame().box(bucket.cell);
        const TriangleSoup soup = soup_of(triangles);
        std::vector<bool> is_met = eligible_vertices(soup, points);
        for (std::size_t v = 0; v < is_met.size(); ++v)
          is_met[v] = is_met[v] && TriangleBuckets::owns(box, soup.vertices[v]);
        EdgeLengths lengths;
        for (const TriangleCorners& t : soup.triangles)
          for (std::size_t k = 0; k < 3; ++k)
            if (is_met[t[k]] || is_met[t[(k + 1) % 3]])
              lengths.add(distance_between(soup.vertices[t[k]], soup.vertices[t[(k + 1) % 3]]));
        return lengths;
      },
      [&](const TriangleBucket& bucket, const EdgeLengths& lengths) {
        all.add(lengths);
        watch.advance(bucket.triangles.count);
      });
  return all;
}

WeldedSurface welded_surface(TriangleSpill& spill, const TriangleBuckets& buckets,
                             WeldPoints points, double distance, IngestWatch& watch,
                             Workers& workers, std::span<const std::uint32_t> given) {
  return SurfaceWelder(spill, buckets, points, distance, watch, workers, given).run();
}

}  // namespace locvol
