// The audit of the facets of a run of the surface alone, one by one and edge by edge. How they fit
// together around vertices, audit_boundary asks of them as of the boundary of cells.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numbers>
#include <string>
#include <tuple>
#include <vector>

#include "engine/audit/audit_leaf.h"

namespace locvol {
namespace {

struct FacetShape {
  Point center;  // of the circumcircle
  double radius = 0;
  double min_degrees = 0;
};

double angle_at(const Point& p, const Point& a, const Point& b) {
  const Point u = a - p, v = b - p;
  return std::atan2(norm(cross(u, v)), dot(u, v)) * (180 / std::numbers::pi);
}

FacetShape shape_of(const Point& a, const Point& b, const Point& c) {
  const Point u = b - a, v = c - a, normal = cross(u, v);
  const double squared = dot(normal, normal);
  const Point to_center =
      (1 / (2 * squared)) * (dot(u, u) * cross(v, normal) + dot(v, v) * cross(normal, u));
  return {a + to_center, norm(to_center),
          std::min({angle_at(a, b, c), angle_at(b, c, a), angle_at(c, a, b)})};
}

// An edge as the boundary of one body has it: up, from the smaller vertex to the larger one, or
// down.
struct BodyEdge {
  LocalIndex from, to;
  BodyId body;
  int way;
  auto key() const { return std::tuple(from, to, body); }
};

class FacetCheck {
 public:
  FacetCheck(const AuditLeaf& leaf, const AuditBounds& bounds, AuditFindings& findings)
      : leaf_(leaf), bounds_(bounds), findings_(findings), report_(findings.report()) {}

  void run(std::span<const LocalFacet> boundary) {
    for (const LocalFacet& facet : boundary) {
      if (leaf_.is_own(facet.vertices[0])) check(facet);
      add_edges(facet);
    }
    check_edges();
  }

 private:
  const Point& position(LocalIndex i) const { return leaf_.points.position(i); }

  void check(const LocalFacet& facet) {
    const Point &a = position(facet.vertices[0]), &b = position(facet.vertices[1]),
                &c = position(facet.vertices[2]);
    const FacetShape shape = shape_of(a, b, c);
    report_.min_facet_degrees = std::min(report_.min_facet_degrees, shape.min_degrees);
    report_.max_circumradius = std::max(report_.max_circumradius, shape.radius / bounds_.size);
    check_size(shape, a);
    const double volume =
        -facet.side / 6.0 * dot(a - bounds_.origin, cross(b - bounds_.origin, c - bounds_.origin));
    if (facet.body != kNoBody && facet.beyond == kNoBody) report_.volume += volume;
    add_to_body(facet.body, volume, a);
    add_to_body(facet.beyond, -volume, a);
  }

  // A surface ball through the corners is no smaller, and its center as close to the circumcenter
  // as that ball's radius, at most.
  void check_size(const FacetShape& shape, const Point& place) {
    const double bound = leaf_.sizes.at(shape.center) / (1 - bounds_.growth) * kBoundSlack;
    if (shape.radius <= bound) return;
    char text[96];
    std::snprintf(text, sizeof text, "the circumradius of a facet here is %.9g of the size",
                  shape.radius / leaf_.sizes.at(shape.center));
    findings_.add_unless_open(&AuditReport::num_large_facets, text, leaf_.key, place);
  }

  void add_to_body(BodyId body, double volume, const Point& place) {
    if (report_.body_volumes.empty() || body == kNoBody) return;
    if (body > report_.body_volumes.size())
      return findings_.add(&AuditReport::num_run_faults, "a facet is of a body that there is not",
                           leaf_.key, place);
    report_.body_volumes[body - 1] += volume;
  }

  // Of those whose smaller vertex is own.
  void add_edges(const LocalFacet& facet) {
    const auto& [a, b, c] = facet.vertices;
    const auto add = [&](LocalIndex from, LocalIndex to, int way) {
      if (!leaf_.is_own(from)) return;
      if (facet.body != kNoBody) edges_.push_back({from, to, facet.body, way});
      if (facet.beyond != kNoBody) edges_.push_back({from, to, facet.beyond, -way});
    };
    // a → b → c → a is counterclockwise from where the cell is not, if that is on the other side.
    add(a, b, -facet.side);
    add(b, c, -facet.side);
    add(a, c, facet.side);
  }

  // Edges that are not of two facets are told by check_boundary_links().
  void check_edges() {
    std::ranges::sort(edges_, {}, &BodyEdge::key);
    for (std::size_t first = 0, end = 0; first < edges_.size(); first = end) {
      int sum = 0;
      for (end = first; end < edges_.size() && edges_[end].key() == edges_[first].key(); ++end)
        sum += edges_[end].way;
      if (end - first != 2 || sum == 0) continue;
      const auto& [from, to, body, way] = edges_[first];
      findings_.add(&AuditReport::num_misoriented_edges,
                    "the two facets at an edge here do not face the same way", leaf_.key,
                    0.5 * (position(from) + position(to)));
    }
  }

  const AuditLeaf& leaf_;
  const AuditBounds& bounds_;
  AuditFindings& findings_;
  AuditReport& report_;
  std::vector<BodyEdge> edges_;
};

}  // namespace

void check_facets(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                  const AuditBounds& bounds, AuditFindings& findings) {
  FacetCheck(leaf, bounds, findings).run(boundary);
}

}  // namespace locvol
