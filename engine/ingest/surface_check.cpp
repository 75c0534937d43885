#include "engine/ingest/surface_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <tuple>
#include <utility>

#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/self_intersection.h"

namespace locvol {
namespace {

void note_pair(std::optional<TrianglePair>& smallest, const TrianglePair& pair) {
  const auto ids = [](const TrianglePair& p) { return std::pair(p.first.id, p.second.id); };
  if (!smallest || ids(pair) < ids(*smallest)) smallest = pair;
}

// What a cell has of a component.
struct ComponentPart {
  SurfaceComponent sum;
  bool is_whole = true;  // no other cell has part of it
};
// A triangle that other cells may have, too.
struct SharedTriangle {
  std::uint64_t id = 0;
  Point from, to;          // its first edge
  std::uint32_t part = 0;  // of the cell
  bool is_turned = false;  // against the part's orientation
  bool is_last = false;    // no later cell has it, nor one beyond the buckets' range
};

// What one cell has to say.
struct CellReport {
  SurfaceFindings findings;  // without components
  std::vector<ComponentPart> parts;
  std::vector<SharedTriangle> shared;
  std::vector<LineHit> hits;
};

class SurfaceCellCheck {
 public:
  // `stop` may be null.
  SurfaceCellCheck(std::vector<Triangle> triangles, MortonKey cell, const TriangleBuckets& buckets,
                   const WallProbes& probes, const SharpAngle& angle, double middle_z,
                   std::span<const std::uint32_t> given, const StopToken* stop)
      : triangles_(std::move(triangles)),
        cell_(cell),
        box_(buckets.frame().box(cell)),
        buckets_(buckets),
        probes_(probes),
        angle_(angle),
        middle_z_(middle_z),
        given_(given),
        stop_(stop),
        soup_(soup_of(triangles_)),
        mates_(3 * triangles_.size(), kNoHalfEdge),
        is_copy_(triangles_.size()),
        is_doubled_(triangles_.size()) {}

  // Throws Stopped.
  CellReport run(CheckScope scope) && {
    throw_if_stopped(stop_);
    faces_away_ = scope == CheckScope::kFacingAway;
    may_meet_itself_ = scope == CheckScope::kBetweenBodies;
    pair_edges();
    count_owned();
    throw_if_stopped(stop_);
    find_components();
    if (scope != CheckScope::kNeighbors) {
      check_fans();
      if (angle_.is_given())
        report_.findings.sharp = sharp_edges_of(
            triangles_, soup_, mates_, is_turned_, angle_,
            [&](std::uint32_t h) { return owner_of_edge(h); }, is_owned_);
      look_at_pairs();
    }
    return std::move(report_);
  }

 private:
  const Point& position(std::uint32_t v) const { return soup_.vertices[v]; }
  bool is_owned(std::uint32_t v) const { return is_owned_[v]; }

  // ---- Edges ----

  void pair_edges() {
    is_owned_.resize(soup_.vertices.size());
    for (std::size_t v = 0; v < is_owned_.size(); ++v)
      is_owned_[v] = TriangleBuckets::owns(box_, soup_.vertices[v]);
    EdgeTable(soup_.vertices.size(), soup_.triangles)
        .for_each_edge([&](std::span<const std::uint32_t> uses) {
          faces_away_      ? take_edge_by_wedges(uses)
          : given_.empty() ? take_edge(uses)
                           : take_edge_of_bodies(uses);
        });
  }

  // Of each body by itself.
  void take_edge_of_bodies(std::span<const std::uint32_t> uses) {
    const auto body_of = [&](std::uint32_t h) { return given_body(given_, triangles_[h / 3]); };
    if (uses.size() == 2 && body_of(uses[0]) == body_of(uses[1])) return take_edge(uses);
    std::size_t num_bodies = 0;
    for_each_body_at(uses, body_of, of_body_, [&](std::span<const std::uint32_t> own) {
      ++num_bodies;
      if (body_of(own.front()) == body_of(own.back()) || is_whole(uses.front())) take_edge(own);
    });
    report_.findings.has_contacts |= num_bodies > 1;
    for (std::size_t i = 1; i < uses.size(); ++i)
      for (std::size_t j = 0; j < i; ++j)
        if (apex(soup_.triangles, uses[i]) == apex(soup_.triangles, uses[j]) &&
            body_of(uses[i]) != body_of(uses[j]))
          is_doubled_[uses[i] / 3] = has_doubled_ = true;
  }

  // Where several parts meet, two triangles with the inside between them go together.
  void take_edge_by_wedges(std::span<const std::uint32_t> uses) {
    if (!is_whole(uses.front())) return;
    if (uses.size() <= 2) return take_edge(uses);
    const Point &from = position(origin(soup_.triangles, uses[0])),
                &to = position(target(soup_.triangles, uses[0]));
    const Point along = to - from, side = position(apex(soup_.triangles, uses[0])) - from,
                across = cross(along, side), flat = cross(across, along);
    struct Leaf {
      double angle = 0;
      bool is_before = false;  // the inside follows it, on the way around the edge
      std::uint32_t half_edge = 0;
    };
    std::vector<Leaf> leaves;
    for (const std::uint32_t h : uses) {
      const Point its = position(apex(soup_.triangles, h)) - from;
      leaves.push_back({std::atan2(dot(its, across) / norm(across), dot(its, flat) / norm(flat)),
                        position(origin(soup_.triangles, h)) != from, h});
    }
    std::ranges::sort(leaves, {},
                      [](const Leaf& l) { return std::tuple(l.angle, l.is_before, l.half_edge); });
    std::vector<std::uint32_t> waiting;  // whose inside is to end, as brackets close
    for (std::size_t round = 0; round < 2; ++round)
      for (Leaf& leaf : leaves) {
        if (leaf.half_edge == kNoHalfEdge) continue;
        if (leaf.is_before && round == 0) {
          waiting.push_back(leaf.half_edge);
        } else if (!leaf.is_before && !waiting.empty()) {
          pair(waiting.back(), std::exchange(leaf.half_edge, kNoHalfEdge));
          waiting.pop_back();
        }
      }
    report_.findings.has_contacts = true;
    if (!owner_of_edge(uses[0])) return;
    if (uses.size() % 2 != 0 || !waiting.empty()) {
      add_flaw(report_.findings.edges.overused, uses[0]);
      add_flaw(report_.findings.edges_without_copies.overused, uses[0]);
    }
  }

  void take_edge(std::span<const std::uint32_t> uses) {
    if (uses.size() == 2 && apex(soup_.triangles, uses[0]) != apex(soup_.triangles, uses[1])) {
      pair(uses[0], uses[1]);
      return;
    }
    const bool is_ours = owner_of_edge(uses[0]);
    if (is_ours) count_flaw(report_.findings.edges, uses.size(), uses[0]);
    distinct_.clear();
    for (const std::uint32_t h : uses) {
      const auto same =
          std::ranges::find(distinct_, apex(soup_.triangles, h),
                            [&](std::uint32_t g) { return apex(soup_.triangles, g); });
      if (same == distinct_.end())
        distinct_.push_back(h);
      else
        note_copy(*same / 3, h / 3);
    }
    if (is_ours) {
      count_flaw(report_.findings.edges_without_copies, distinct_.size(), distinct_[0]);
      if (distinct_.size() < uses.size() && distinct_.size() != 2)
        report_.findings.is_copy_needed = true;
    }
    if (distinct_.size() == 2) pair(distinct_[0], distinct_[1]);
  }

  // Are all triangles at the edge here?
  bool is_whole(std::uint32_t h) const {
    return TriangleBuckets::meets_edge(box_, position(origin(soup_.triangles, h)),
                                       position(target(soup_.triangles, h)));
  }

  void pair(std::uint32_t g, std::uint32_t h) {
    mates_[g] = h;
    mates_[h] = g;
  }

  bool owner_of_edge(std::uint32_t h) const {
    const std::uint32_t v = origin(soup_.triangles, h), w = target(soup_.triangles, h);
    return is_owned(position(v) < position(w) ? v : w);
  }

  void count_flaw(EdgeCounts& edges, std::size_t num_triangles, std::uint32_t h) {
    if (num_triangles == 2) return;
    EdgeFlaws& flaws = num_triangles == 1 ? edges.border : edges.overused;
    add_flaw(flaws, h);
  }

  void add_flaw(EdgeFlaws& flaws, std::uint32_t h) {
    flaws.add(3 * triangles_[h / 3].id + h % 3, position(origin(soup_.triangles, h)),
              position(target(soup_.triangles, h)));
  }

  void note_copy(std::uint32_t first, std::uint32_t copy) {
    if (is_copy_[copy]) return;  // known by another of its edges
    is_copy_[copy] = true;
    has_copies_ = true;
    note_pair(report_.findings.first_copy, {triangles_[first], triangles_[copy]});
  }

  // ---- What is counted where it is owned ----

  void count_owned() {
    report_.findings.num_vertices +=
        static_cast<std::uint64_t>(std::ranges::count(is_owned_, std::uint8_t{1}));
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      if (!owns(t)) continue;
      if (is_copy_[t]) {
        ++report_.findings.num_copies;
        continue;
      }
      ++report_.findings.num_triangles;
      const auto& [a, b, c] = triangles_[t].corners;
      report_.findings.area.add(0.5 * norm(cross(b - a, c - a)));
    }
  }

  bool owns(std::uint32_t t) const {
    const auto& [a, b, c] = soup_.triangles[t];
    const int num_owned = is_owned_[a] + is_owned_[b] + is_owned_[c];
    if (num_owned == 0 || num_owned == 3) return num_owned == 3;
    return is_owned(std::min(
        {a, b, c}, [&](std::uint32_t v, std::uint32_t w) { return position(v) < position(w); }));
  }

  // ---- Components ----

  void find_components() {
    Components components = locvol::find_components(soup_.triangles, mates_);
    if (components.conflict != kNoHalfEdge)
      add_flaw(report_.findings.conflicts, components.conflict);
    report_.parts.resize(components.count);
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      if (is_copy_[t]) continue;
      ComponentPart& part = report_.parts[components.of_triangle[t]];
      part.sum.add_corners(triangles_[t]);
      if (owns(t)) part.sum.add_volume(triangles_[t], components.is_turned[t], middle_z_);
      if (!TriangleBuckets::reaches_out(box_, triangles_[t])) continue;
      part.is_whole = false;
      report_.shared.push_back({.id = triangles_[t].id,
                                .from = triangles_[t].corners[0],
                                .to = triangles_[t].corners[1],
                                .part = components.of_triangle[t],
                                .is_turned = components.is_turned[t],
                                .is_last = buckets_.is_last_with(cell_, triangles_[t])});
    }
    is_turned_ = std::move(components.is_turned);
  }

  // ---- Vertices and pairs ----

  void check_fans() {
    std::vector<std::uint32_t> num_triangles(soup_.vertices.size());
    std::vector<std::uint32_t> outgoing(soup_.vertices.size(), kNoHalfEdge);
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      if (is_copy_[h / 3]) continue;
      ++num_triangles[origin(soup_.triangles, h)];
      outgoing[origin(soup_.triangles, h)] = h;
    }
    for (std::uint32_t v = 0; v < outgoing.size(); ++v) {
      if (!is_owned(v)) continue;
      const std::uint32_t fan = fan_around(soup_.triangles, mates_, outgoing[v]);
      if (fan == 0 || fan == num_triangles[v]) continue;
      if (faces_away_) {
        report_.findings.has_contacts = true;
        continue;
      }
      if (!is_pinched(v)) continue;
      if (report_.findings.num_pinched++ == 0 || position(v) < report_.findings.first_pinched)
        report_.findings.first_pinched = position(v);
    }
  }

  // Of a vertex with several fans: does one body have two of them?
  bool is_pinched(std::uint32_t v) {
    if (given_.empty()) return true;
    if (first_at_.empty()) list_half_edges();
    seen_at_.resize(triangles_.size(), kNoHalfEdge);
    std::vector<std::uint32_t> bodies;  // with fans, each once a fan
    for (std::uint32_t n = first_at_[v]; n < first_at_[v + 1]; ++n) {
      const std::uint32_t h = at_vertex_[n];
      if (is_copy_[h / 3] || seen_at_[h / 3] == v) continue;
      of_fan_.clear();
      const bool is_closed = for_each_in_fan(soup_.triangles, mates_, h, [&](std::uint32_t t) {
        seen_at_[t] = v;
        of_fan_.push_back(given_body(given_, triangles_[t]));
      });
      if (!is_closed) return false;  // an open edge, which is told
      sort_and_unite(of_fan_);
      bodies.insert(bodies.end(), of_fan_.begin(), of_fan_.end());
    }
    report_.findings.has_contacts = true;
    std::ranges::sort(bodies);
    return std::ranges::adjacent_find(bodies) != bodies.end();
  }

  // By their origins.
  void list_half_edges() {
    first_at_.resize(soup_.vertices.size() + 1);
    const auto num = static_cast<std::uint32_t>(mates_.size());
    for (std::uint32_t h = 0; h < num; ++h) ++first_at_[origin(soup_.triangles, h) + 1];
    std::partial_sum(first_at_.begin(), first_at_.end(), first_at_.begin());
    at_vertex_.resize(num);
    std::vector<std::uint32_t> next = first_at_;
    for (std::uint32_t h = 0; h < num; ++h) at_vertex_[next[origin(soup_.triangles, h)]++] = h;
  }

  // Triangles that meet, and those that face each other.
  void look_at_pairs() {
    if (has_copies_ || has_doubled_) {
      std::size_t kept = 0;
      for (std::size_t t = 0; t < triangles_.size(); ++t) {
        if (is_copy_[t] || is_doubled_[t]) continue;
        triangles_[kept] = triangles_[t];
        soup_.triangles[kept++] = soup_.triangles[t];
      }
      soup_.triangles.resize(kept);
    }
    const TriangleTree tree(soup_.vertices, soup_.triangles, box_);
    if (faces_away_) {
      report_.hits = probes_.hits_in(box_, tree, soup_.vertices, soup_.triangles);
      return;
    }
    const auto note = [&](std::uint32_t s, std::uint32_t t) {
      note_pair(report_.findings.intersection,
                {triangles_[std::min(s, t)], triangles_[std::max(s, t)]});
    };
    if (may_meet_itself_) {
      const auto are_of_two_bodies = [&](std::uint32_t s, std::uint32_t t) {
        return given_body(given_, triangles_[s]) != given_body(given_, triangles_[t]);
      };
      for_each_intersection(soup_.vertices, soup_.triangles, tree, are_of_two_bodies, note, stop_);
    } else if (const auto pair =
                   find_self_intersection(soup_.vertices, soup_.triangles, tree, stop_)) {
      note(pair->first, pair->second);
    }
    throw_if_stopped(stop_);
    report_.hits = probes_.hits_in(box_, tree, soup_.vertices, soup_.triangles);
  }

  std::vector<Triangle> triangles_;
  MortonKey cell_;
  Box box_;
  const TriangleBuckets& buckets_;
  const WallProbes& probes_;
  const SharpAngle& angle_;
  double middle_z_;
  std::span<const std::uint32_t> given_;
  const StopToken* stop_;
  bool faces_away_ = false, may_meet_itself_ = false;
  TriangleSoup soup_;
  Mates mates_;  // without copies
  std::vector<bool> is_copy_;
  bool has_copies_ = false;
  std::vector<bool> is_doubled_;  // a triangle of another body lies there, too, and comes first
  bool has_doubled_ = false;
  std::vector<std::uint8_t> is_owned_;  // by vertex
  std::vector<bool> is_turned_;         // by triangle, see Components
  std::vector<std::uint32_t> distinct_, of_body_, of_fan_;
  std::vector<std::uint32_t> first_at_, at_vertex_;  // of a vertex, its half-edges
  std::vector<std::uint32_t> seen_at_;               // of triangles, the last vertex with their fan
  CellReport report_;
};

}  // namespace

void EdgeFlaws::add(std::uint64_t number, const Point& origin, const Point& target) {
  ++count;
  if (number > half_edge) return;
  half_edge = number;
  from = origin;
  to = target;
}

void EdgeFlaws::add(const EdgeFlaws& others) {
  if (others.half_edge < half_edge) {
    half_edge = others.half_edge;
    from = others.from;
    to = others.to;
  }
  count += others.count;
}

void EdgeCounts::add(const EdgeCounts& others) {
  border.add(others.border);
  overused.add(others.overused);
}

void SurfaceFindings::add(const SurfaceFindings& others) {
  edges.add(others.edges);
  edges_without_copies.add(others.edges_without_copies);
  num_copies += others.num_copies;
  if (others.first_copy) note_pair(first_copy, *others.first_copy);
  is_copy_needed |= others.is_copy_needed;
  conflicts.add(others.conflicts);
  if (others.num_pinched > 0 && (num_pinched == 0 || others.first_pinched < first_pinched))
    first_pinched = others.first_pinched;
  num_pinched += others.num_pinched;
  has_contacts |= others.has_contacts;
  if (others.intersection) note_pair(intersection, *others.intersection);
  num_vertices += others.num_vertices;
  num_triangles += others.num_triangles;
  area.add(others.area);
  sharp.add(others.sharp);
  locvol::add(sights, others.sights);
}

namespace {

// All that is known of the surface, cell after cell.
struct SurfaceSummary {
  SurfaceFindings findings;
  ComponentJoiner joiner;

  void add(const CellReport& cell) {
    findings.add(cell.findings);
    for (const LineHit& hit : cell.hits) findings.sights[hit.line].add(hit);
    // Of an open surface nothing else matters, and each of its triangles may be a component.
    if (findings.edges.border.count > 0) {
      joiner = {};
      return;
    }
    std::vector<std::uint32_t> numbers(cell.parts.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      const auto& [sum, is_whole] = cell.parts[i];
      if (std::isinf(sum.top.z)) continue;  // a copy
      if (is_whole)
        joiner.add_whole(sum);
      else
        numbers[i] = joiner.add_part(sum);
    }
    for (const SharedTriangle& t : cell.shared)
      if (!joiner.join(t.id, numbers[t.part], t.is_turned, t.is_last))
        findings.conflicts.add(3 * t.id, t.from, t.to);
  }
};

}  // namespace

SurfaceFindings check_cells(const TriangleSpill& spill, const TriangleBuckets& buckets,
                            const Box& box, const WallProbes& probes, const SharpAngle& angle,
                            CheckScope scope, IngestWatch& watch, Workers& workers,
                            std::span<const std::uint32_t> given) {
  SurfaceSummary surface;
  surface.findings.sights.resize(probes.num_lines());
  for_each_in_order(
      workers, buckets.all(),
      [&](const TriangleBucket& bucket) { return spill.load(bucket.triangles); },
      [&](const TriangleBucket& bucket, std::vector<Triangle> triangles) {
        return SurfaceCellCheck(std::move(triangles), bucket.cell, buckets, probes, angle,
                                box.center().z, given, watch.stop())
            .run(scope);
      },
      [&](const TriangleBucket& bucket, const CellReport& report) {
        surface.add(report);
        watch.advance(bucket.triangles.count);
      });
  surface.findings.joined = surface.joiner.take();
  return std::move(surface.findings);
}

void drop_copies(std::vector<Triangle>& triangles, std::span<const std::uint32_t> given) {
  struct Place {
    std::array<Point, 3> corners;
    std::uint32_t body = 0, triangle = 0;
    auto operator<=>(const Place&) const = default;
  };
  std::vector<Place> sorted(triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    sorted[t] = {triangles[t].corners, given_body(given, triangles[t]), t};
    std::ranges::sort(sorted[t].corners);
  }
  std::ranges::sort(sorted);
  std::vector<bool> is_copy(triangles.size());
  for (std::size_t i = 1; i < sorted.size(); ++i)
    is_copy[sorted[i].triangle] =
        sorted[i].corners == sorted[i - 1].corners && sorted[i].body == sorted[i - 1].body;
  std::size_t kept = 0;
  for (std::size_t t = 0; t < triangles.size(); ++t)
    if (!is_copy[t]) triangles[kept++] = triangles[t];
  triangles.resize(kept);
}

bool owns_triangle(const Box& cell, const Triangle& triangle) {
  return TriangleBuckets::owns(cell, std::ranges::min(triangle.corners));
}

}  // namespace locvol
