#include "engine/surface_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <tuple>

#include "engine/surface_topology.h"
#include "engine/triangle_soup.h"
#include "refine/self_intersection.h"

namespace locvol {
namespace {

// What one cell has to say.
class CellCheck {
 public:
  CellCheck(std::vector<Triangle> triangles, MortonKey cell, const TriangleBuckets& buckets,
            double middle_z, SurfaceFindings& findings, ComponentJoiner& joiner)
      : triangles_(std::move(triangles)),
        cell_(cell),
        box_(buckets.frame().box(cell)),
        buckets_(buckets),
        middle_z_(middle_z),
        findings_(findings),
        joiner_(joiner),
        soup_(soup_of(triangles_)),
        mates_(3 * triangles_.size(), kNoHalfEdge),
        is_copy_(triangles_.size()) {}

  void run(CheckScope scope) {
    pair_edges();
    count_owned();
    find_components();
    if (scope == CheckScope::kNeighbors) return;
    check_fans();
    find_intersection();
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
        .for_each_edge([&](std::span<const std::uint32_t> uses) { take_edge(uses); });
  }

  void take_edge(std::span<const std::uint32_t> uses) {
    if (uses.size() == 2 && apex(soup_.triangles, uses[0]) != apex(soup_.triangles, uses[1])) {
      pair(uses[0], uses[1]);
      return;
    }
    const bool is_ours = owner_of_edge(uses[0]);
    if (is_ours) count_flaw(findings_.edges, uses.size(), uses[0]);
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
      count_flaw(findings_.edges_without_copies, distinct_.size(), distinct_[0]);
      if (distinct_.size() < uses.size() && distinct_.size() != 2) findings_.is_copy_needed = true;
    }
    if (distinct_.size() == 2) pair(distinct_[0], distinct_[1]);
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
    note_pair(findings_.first_copy, triangles_[first], triangles_[copy]);
  }

  static void note_pair(std::optional<TrianglePair>& smallest, const Triangle& first,
                        const Triangle& second) {
    if (!smallest ||
        std::tie(first.id, second.id) < std::tie(smallest->first.id, smallest->second.id))
      smallest = {first, second};
  }

  // ---- What is counted where it is owned ----

  void count_owned() {
    findings_.num_vertices +=
        static_cast<std::uint64_t>(std::ranges::count(is_owned_, std::uint8_t{1}));
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      if (!owns(t)) continue;
      if (is_copy_[t]) {
        ++findings_.num_copies;
        continue;
      }
      ++findings_.num_triangles;
      const auto& [a, b, c] = triangles_[t].corners;
      findings_.area.add(0.5 * norm(cross(b - a, c - a)));
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
    const Components components = locvol::find_components(soup_.triangles, mates_);
    if (components.conflict != kNoHalfEdge) add_flaw(findings_.conflicts, components.conflict);
    std::vector<SurfaceComponent> sums(components.count);
    std::vector<std::uint32_t> parts(components.count, kWhole);
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      if (is_copy_[t]) continue;
      SurfaceComponent& sum = sums[components.of_triangle[t]];
      add_to(sum, t, components.is_turned[t]);
      if (reaches_out(t)) parts[components.of_triangle[t]] = kPart;
    }
    for (std::size_t c = 0; c < sums.size(); ++c) {
      if (std::isinf(sums[c].top.z)) continue;  // a copy
      if (parts[c] == kWhole)
        joiner_.add_whole(sums[c]);
      else
        parts[c] = joiner_.add_part(sums[c]);
    }
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      if (is_copy_[t] || !reaches_out(t)) continue;
      const bool is_last = buckets_.last_met_by(triangles_[t]) == cell_;
      if (!joiner_.join(triangles_[t].id, parts[components.of_triangle[t]], components.is_turned[t],
                        is_last))
        add_flaw(findings_.conflicts, 3 * t);
    }
  }

  // Lies the triangle on the cell's boundary, or beyond?
  bool reaches_out(std::uint32_t t) const {
    const Box b = triangles_[t].box();
    return b.min.x <= box_.min.x || b.min.y <= box_.min.y || b.min.z <= box_.min.z ||
           b.max.x >= box_.max.x || b.max.y >= box_.max.y || b.max.z >= box_.max.z;
  }

  // The volume between a triangle and the plane z = middle_z_; only its difference from the other
  // triangles' matters, and its value to the last bit does not depend on the cells.
  void add_to(SurfaceComponent& sum, std::uint32_t t, bool is_turned) {
    const auto& [a, b, c] = triangles_[t].corners;
    for (const Point& p : triangles_[t].corners)
      if (is_above(p, sum.top)) sum.top = p;
    if (!owns(t)) return;
    ++sum.num_triangles;
    if (is_turned) ++sum.num_turned;
    const Point u = b - a, v = c - a;
    const double za = a.z - middle_z_, zb = b.z - middle_z_, zc = c.z - middle_z_;
    const double term = (za + zb + zc) * (u.x * v.y - u.y * v.x);
    sum.six_volume.add(is_turned ? -term : term);
    sum.six_volume_error += 16 * std::numeric_limits<double>::epsilon() *
                            (std::abs(za) + std::abs(zb) + std::abs(zc)) *
                            (std::abs(u.x * v.y) + std::abs(u.y * v.x));
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
      if (findings_.num_pinched++ == 0 || position(v) < findings_.first_pinched)
        findings_.first_pinched = position(v);
    }
  }

  void find_intersection() {
    if (has_copies_) {
      std::size_t kept = 0;
      for (std::size_t t = 0; t < triangles_.size(); ++t) {
        if (is_copy_[t]) continue;
        triangles_[kept] = triangles_[t];
        soup_.triangles[kept++] = soup_.triangles[t];
      }
      soup_.triangles.resize(kept);
    }
    const auto pair = find_self_intersection(soup_.vertices, soup_.triangles, box_);
    if (pair) note_pair(findings_.intersection, triangles_[pair->first], triangles_[pair->second]);
  }

  static constexpr std::uint32_t kWhole = 0xffffffff, kPart = 0xfffffffe;

  std::vector<Triangle> triangles_;
  MortonKey cell_;
  Box box_;
  const TriangleBuckets& buckets_;
  double middle_z_;
  SurfaceFindings& findings_;
  ComponentJoiner& joiner_;
  TriangleSoup soup_;
  Mates mates_;  // without copies
  std::vector<bool> is_copy_;
  bool has_copies_ = false;
  std::vector<std::uint8_t> is_owned_;  // by vertex
  std::vector<std::uint32_t> distinct_;
};

}  // namespace

void EdgeFlaws::add(std::uint64_t number, const Point& origin, const Point& target) {
  ++count;
  if (number > half_edge) return;
  half_edge = number;
  from = origin;
  to = target;
}

SurfaceFindings check_cells(const TriangleSpill& spill, const TriangleBuckets& buckets,
                            const Box& box, CheckScope scope, IngestWatch& watch) {
  SurfaceFindings findings;
  ComponentJoiner joiner;
  for (const TriangleBucket& bucket : buckets.all()) {
    CellCheck(spill.load(bucket.triangles), bucket.cell, buckets, box.center().z, findings, joiner)
        .run(scope);
    watch.advance(bucket.triangles.count);
  }
  findings.components = joiner.take_components();
  return findings;
}

void drop_copies(std::vector<Triangle>& triangles) {
  std::vector<std::pair<std::array<Point, 3>, std::uint32_t>> sorted(triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    sorted[t] = {triangles[t].corners, t};
    std::ranges::sort(sorted[t].first);
  }
  std::ranges::sort(sorted);
  std::vector<bool> is_copy(triangles.size());
  for (std::size_t i = 1; i < sorted.size(); ++i)
    is_copy[sorted[i].second] = sorted[i].first == sorted[i - 1].first;
  std::size_t kept = 0;
  for (std::size_t t = 0; t < triangles.size(); ++t)
    if (!is_copy[t]) triangles[kept++] = triangles[t];
  triangles.resize(kept);
}

bool owns_triangle(const Box& cell, const Triangle& triangle) {
  return TriangleBuckets::owns(cell, std::ranges::min(triangle.corners));
}

}  // namespace locvol
