// The audit of how the cells of a star fit together, and of the boundary that they leave.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <string>

#include "engine/audit/audit_leaf.h"
#include "octree/sort_and_unite.h"
#include "refine/predicates.h"

namespace locvol {
namespace {

// Beyond it a boundary vertex is off the surface; fraction of λ, to which rounding is added.
constexpr double kOnSurface = 1e-9;
// The same of the surface between two bodies: what is closer to each other is on both.
constexpr double kBetweenBodies = 2e-6;
// What the fast distance to a needle of a triangle may be wrong by; fraction of λ.
constexpr double kFastDistanceError = 1e-6;

// Each exchange of two of them turns it round.
void sort_vertices(LocalFacet& facet) {
  auto& [a, b, c] = facet.vertices;
  const auto order = [&](LocalIndex& low, LocalIndex& high) {
    if (low <= high) return;
    std::swap(low, high);
    facet.side = -facet.side;
  };
  order(a, b);
  order(b, c);
  order(a, b);
}

// The facet of a positively oriented cell that lies across from its vertex k.
LocalFacet facet_across(const std::array<LocalIndex, 4>& cell, std::size_t k) {
  LocalFacet facet;
  for (std::size_t i = 0, j = 0; i < 4; ++i) {
    if (i != k) facet.vertices[j++] = cell[i];
  }
  // Without the last vertex, the others turn counterclockwise seen from it; each step of k towards
  // the front is an exchange of two vertices.
  facet.side = k % 2 == 1 ? 1 : -1;
  sort_vertices(facet);
  return facet;
}

// By smallest vertex first, in linear time: then only a few dozen facets at a time are left to
// sort.
std::vector<LocalFacet> sorted_by_vertices(const std::vector<LocalFacet>& facets,
                                           std::size_t num_points) {
  std::vector<std::uint32_t> ends(num_points + 1);
  for (const LocalFacet& facet : facets) ++ends[facet.vertices[0] + 1];
  for (std::size_t i = 1; i < ends.size(); ++i) ends[i] += ends[i - 1];
  const std::vector<std::uint32_t> starts = ends;
  std::vector<LocalFacet> sorted(facets.size());
  for (const LocalFacet& facet : facets) sorted[ends[facet.vertices[0]]++] = facet;
  for (std::size_t i = 0; i < num_points; ++i) {
    std::ranges::sort(
        std::span(sorted).subspan(starts[i], ends[i] - starts[i]), {},
        [](const LocalFacet& f) { return std::uint64_t{f.vertices[1]} << 32 | f.vertices[2]; });
  }
  return sorted;
}

std::vector<LocalFacet> facets_at_own_points(const AuditLeaf& leaf) {
  std::vector<LocalFacet> facets;
  facets.reserve(4 * leaf.star.size());
  const auto is_own = [&](LocalIndex i) { return leaf.is_own(i); };
  for (const LocalCell& cell : leaf.star) {
    for (std::size_t k = 0; k < 4; ++k) {
      LocalFacet facet = facet_across(cell.vertices, k);
      facet.body = cell.body;
      if (std::ranges::any_of(facet.vertices, is_own)) facets.push_back(facet);
    }
  }
  return sorted_by_vertices(facets, leaf.points.size());
}

// Calls visit(group) for each run of elements with the same key.
template <class T, class Key, class Visit>
void for_each_group(std::span<const T> sorted, Key key, Visit visit) {
  for (std::size_t first = 0; first < sorted.size();) {
    std::size_t last = first + 1;
    while (last < sorted.size() && key(sorted[last]) == key(sorted[first])) ++last;
    visit(sorted.subspan(first, last - first));
    first = last;
  }
}

// A boundary facet as its own vertex sees it: an edge of that vertex's link.
struct LinkEdge {
  LocalIndex center;
  std::array<LocalIndex, 2> ends;
  BodyId body = kOnlyBody;  // on one side of the facet, and on the other
  BodyId beyond = kNoBody;
};

std::vector<LinkEdge> link_edges(const AuditLeaf& leaf, std::span<const LocalFacet> boundary) {
  std::vector<LinkEdge> edges;
  for (const LocalFacet& facet : boundary) {
    const auto& [a, b, c] = facet.vertices;
    const BodyId body = facet.body, beyond = facet.beyond;
    if (leaf.is_own(a)) edges.push_back({a, {b, c}, body, beyond});
    if (leaf.is_own(b)) edges.push_back({b, {a, c}, body, beyond});
    if (leaf.is_own(c)) edges.push_back({c, {a, b}, body, beyond});
  }
  std::ranges::sort(edges, {}, &LinkEdge::center);
  return edges;
}

class LinkCheck {
 public:
  LinkCheck(const AuditLeaf& leaf, AuditFindings& findings) : leaf_(leaf), findings_(findings) {}

  // All facets at a vertex.
  void check(std::span<const LinkEdge> link) {
    const LocalIndex center = link.front().center;
    ++findings_.report().num_boundary_vertices;
    ++findings_.report().euler_characteristic;
    ends_.clear();
    for (const LinkEdge& edge : link) ends_.insert(ends_.end(), edge.ends.begin(), edge.ends.end());
    sort_and_unite(ends_);
    // Both ends see the same facets on an edge; the smaller one counts it.
    findings_.report().euler_characteristic -=
        std::ranges::count_if(ends_, [&](LocalIndex end) { return center < end; });
    bodies_.clear();
    for (const LinkEdge& edge : link)
      for (const BodyId body : {edge.body, edge.beyond})
        if (body != kNoBody) bodies_.push_back(body);
    sort_and_unite(bodies_);
    for (const BodyId body : bodies_) {
      of_body_.clear();
      std::ranges::copy_if(link, std::back_inserter(of_body_), [&](const LinkEdge& edge) {
        return edge.body == body || edge.beyond == body;
      });
      check_body(of_body_);
    }
  }

 private:
  void check_body(std::span<const LinkEdge> link) {
    const LocalIndex center = link.front().center;
    ends_.clear();
    for (const LinkEdge& edge : link) ends_.insert(ends_.end(), edge.ends.begin(), edge.ends.end());
    std::ranges::sort(ends_);
    nodes_.clear();
    bool is_each_twice = true;
    for_each_group(std::span<const LocalIndex>(ends_), std::identity(), [&](auto same) {
      nodes_.push_back(same.front());
      is_each_twice &= same.size() == 2;
      check_edge(center, same.front(), same.size());
    });
    if (is_each_twice && is_connected(link)) return;
    findings_.add(&AuditReport::num_bad_boundary_vertices,
                  "the link of this boundary vertex is not a single cycle", leaf_.key,
                  leaf_.points.position(center));
  }

  void check_edge(LocalIndex center, LocalIndex end, std::size_t num_facets) {
    if (end < center || num_facets == 2) return;
    findings_.add(&AuditReport::num_bad_boundary_edges,
                  "an edge here is in " + std::to_string(num_facets) + " boundary facets, not two",
                  leaf_.key, 0.5 * (leaf_.points.position(center) + leaf_.points.position(end)));
  }

  bool is_connected(std::span<const LinkEdge> link) const {
    UnionFind sets(nodes_.size());
    const auto place = [&](LocalIndex node) {
      return static_cast<std::size_t>(std::ranges::lower_bound(nodes_, node) - nodes_.begin());
    };
    for (const LinkEdge& edge : link) sets.unite(place(edge.ends[0]), place(edge.ends[1]));
    return sets.num_sets() == 1;
  }

  const AuditLeaf& leaf_;
  AuditFindings& findings_;
  std::vector<LocalIndex> ends_, nodes_;
  std::vector<BodyId> bodies_;
  std::vector<LinkEdge> of_body_;
};

std::vector<Point> own_vertices(const AuditLeaf& leaf, std::span<const LocalFacet> facets) {
  std::vector<LocalIndex> indices;
  for (const LocalFacet& facet : facets) {
    for (const LocalIndex i : facet.vertices) {
      if (leaf.is_own(i)) indices.push_back(i);
    }
  }
  sort_and_unite(indices);
  std::vector<Point> positions;
  for (const LocalIndex i : indices) positions.push_back(leaf.points.position(i));
  return positions;
}

// Distances from the points to those of the triangles that come within `tolerance` of them, else
// infinity. Fast: a triangle visits only the points in its box.
std::vector<double> distances_within(const std::vector<Point>& points,
                                     std::span<const Triangle> triangles, double tolerance,
                                     double grid_side) {
  std::vector<double> distances(points.size(), std::numeric_limits<double>::infinity());
  const AuditGrid grid(points, grid_side);
  for (const Triangle& triangle : triangles) {
    const Box box = triangle.box().expanded(tolerance);
    grid.for_each_near(box, [&](std::uint32_t i, const Point& p) {
      if (box.contains(p)) distances[i] = std::min(distances[i], distance_to_triangle(p, triangle));
    });
  }
  for (double& distance : distances) {
    if (distance > tolerance) distance = std::numeric_limits<double>::infinity();
  }
  return distances;
}

// The distance to the nearest of all triangles, exact where a fast one could mislead.
double careful_distance(const Point& p, std::span<const Triangle> triangles, double fast_error) {
  std::vector<double> fast;
  double nearest = std::numeric_limits<double>::infinity();
  for (const Triangle& triangle : triangles) {
    fast.push_back(distance_to_triangle(p, triangle));
    nearest = std::min(nearest, fast.back());
  }
  double result = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (fast[i] > nearest + fast_error) continue;
    result = std::min(result, exact_distance_to_triangle(p, triangles[i]));
  }
  return result;
}

// Own vertices are in one set if facets of the boundary join them within the leaf.
UnionFind own_components(const AuditLeaf& leaf, std::span<const LocalFacet> boundary) {
  UnionFind sets(leaf.points.size());
  for (const LocalFacet& facet : boundary) {
    const auto& [a, b, c] = facet.vertices;
    for (const auto& [i, j] : {std::pair(a, b), std::pair(b, c), std::pair(a, c)}) {
      if (leaf.is_own(i) && leaf.is_own(j)) sets.unite(i, j);
    }
  }
  return sets;
}

// Each once.
std::vector<LocalFacet> listed_boundary(const AuditLeaf& leaf, AuditFindings& findings) {
  std::vector<LocalFacet> boundary;
  const std::vector<LocalFacet> facets = sorted_by_vertices(leaf.star_facets, leaf.points.size());
  for_each_group(
      std::span(facets), [](const LocalFacet& f) { return f.vertices; },
      [&](auto same) {
        boundary.push_back(same.front());
        const auto& [a, b, c] = same.front().vertices;
        if (!leaf.is_own(a)) return;
        ++findings.report().num_boundary_facets;
        ++findings.report().euler_characteristic;
        if (same.size() > 1 || a == b || b == c)
          findings.add(
              &AuditReport::num_overused_facets,
              same.size() > 1 ? "a facet here is listed twice" : "a facet here has a vertex twice",
              leaf.key, leaf.points.position(a));
      });
  return boundary;
}

}  // namespace

std::vector<LocalFacet> boundary_facets(const AuditLeaf& leaf, AuditFindings& findings) {
  if (leaf.is_surface_only) return listed_boundary(leaf, findings);
  std::vector<LocalFacet> boundary;
  const std::vector<LocalFacet> facets = facets_at_own_points(leaf);
  for_each_group(
      std::span(facets), [](const LocalFacet& f) { return f.vertices; },
      [&](auto same) {
        const LocalIndex smallest = same.front().vertices[0];
        const bool is_between =
            same.size() == 2 && same[0].side != same[1].side && same[0].body != same[1].body;
        if (same.size() == 1 || is_between) {
          LocalFacet facet = same.front();
          if (is_between) {
            facet = same[0].body > same[1].body ? same[0] : same[1];
            facet.beyond = std::min(same[0].body, same[1].body);
          }
          boundary.push_back(facet);
          if (!leaf.is_own(smallest)) return;
          ++findings.report().num_boundary_facets;
          ++findings.report().euler_characteristic;
        } else if (leaf.is_own(smallest) && (same.size() > 2 || same[0].side == same[1].side)) {
          findings.add(&AuditReport::num_overused_facets,
                       same.size() > 2 ? "a facet here is in more than two cells"
                                       : "two cells lie on the same side of a facet here",
                       leaf.key, leaf.points.position(smallest));
        }
      });
  return boundary;
}

void check_listed_facets(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                         AuditFindings& findings) {
  const std::vector<LocalIndex> vertex = leaf.points.find(leaf.facets.vertices);
  std::vector<LocalFacet> listed, expected, wrong;
  for (const auto& [vertices, labels] : leaf.facets.facets) {
    // Counterclockwise from outside, so that the cell lies where they turn clockwise.
    LocalFacet facet{{vertex[vertices[0]], vertex[vertices[1]], vertex[vertices[2]]},
                     -1,
                     labels.behind,
                     labels.before};
    sort_vertices(facet);
    const bool is_labelled = labels.behind != labels.before;
    (is_labelled && facet.vertices[2] != kUnknownPoint ? listed : wrong).push_back(facet);
  }
  for (const LocalFacet& facet : boundary)
    if (leaf.is_own(facet.vertices[0])) expected.push_back(facet);
  std::ranges::sort(listed);
  std::ranges::sort(expected);
  std::ranges::set_symmetric_difference(listed, expected, std::back_inserter(wrong));
  for (const LocalFacet& facet : wrong) {
    const LocalIndex at = facet.vertices[0];
    findings.add(&AuditReport::num_wrong_facets,
                 "a facet here is on the boundary and not listed so, or the other way round",
                 leaf.key, at == kUnknownPoint ? Point() : leaf.points.position(at));
  }
}

namespace {

// How far a place is from the surface, and from one sheet of it.
struct SheetDistance {
  Point place;
  SheetId listed = 0;
  double nearest = std::numeric_limits<double>::infinity();    // of all between the same bodies
  double of_listed = std::numeric_limits<double>::infinity();  // of that sheet's
};

// Finds the distances of places that are at most `reach` from the leaf's box. What lies on the
// surface finds it within `reach`; where a site is unresolved, facets may be farther off.
void measure_sheets(std::span<SheetDistance> sheets, double reach, const AuditLeaf& leaf,
                    const AuditLeaves& leaves, const AuditRecords& records,
                    const AuditBounds& bounds) {
  const double size = bounds.size;
  const auto part_the_same = [&](SheetId a, SheetId b) {
    const auto& bodies = bounds.bodies_of_sheets;
    const auto is_known = [&](SheetId sheet) { return 0 < sheet && sheet <= bodies.size(); };
    return !is_known(a) || !is_known(b) || bodies[a - 1] == bodies[b - 1];
  };
  std::vector<SheetDistance*> open;
  for (SheetDistance& sheet : sheets) open.push_back(&sheet);
  for (double within = reach; !open.empty(); within *= 2) {
    std::vector<Point> places;
    for (const SheetDistance* sheet : open) places.push_back(sheet->place);
    const AuditGrid grid(places, size);
    for (const std::size_t near : leaves.within(leaves.box(leaf.leaf), reach + within)) {
      const MortonKey key = leaves.key(near);
      for (const Triangle& triangle : records.of(key).surface(key).triangles) {
        const Box box = triangle.box().expanded(within);
        grid.for_each_near(box, [&](std::uint32_t i, const Point& p) {
          if (!box.contains(p)) return;
          SheetDistance& sheet = *open[i];
          if (!part_the_same(triangle.sheet, sheet.listed)) return;
          const double distance = distance_to_triangle(p, triangle);
          sheet.nearest = std::min(sheet.nearest, distance);
          if (triangle.sheet == sheet.listed) sheet.of_listed = std::min(sheet.of_listed, distance);
        });
      }
    }
    if (within >= size) return;
    std::erase_if(open, [&](const SheetDistance* sheet) { return sheet->nearest <= within; });
  }
}

}  // namespace

void check_sheets(const AuditLeaf& leaf, const AuditLeaves& leaves, const AuditRecords& records,
                  const AuditBounds& bounds, AuditFindings& findings) {
  std::vector<SheetDistance> sheets;
  double reach = kOnSurface * bounds.size;
  const std::vector<LocalIndex> vertex = leaf.points.find(leaf.facets.vertices);
  for (const auto& [vertices, labels] : leaf.facets.facets) {
    const std::array<LocalIndex, 3> v{vertex[vertices[0]], vertex[vertices[1]],
                                      vertex[vertices[2]]};
    if (std::ranges::find(v, kUnknownPoint) != v.end()) continue;  // wrong, which is told
    const Point &a = leaf.points.position(v[0]), &b = leaf.points.position(v[1]),
                &c = leaf.points.position(v[2]);
    const Point centroid = 1.0 / 3 * (a + b + c);
    if (bounds.has_bodies()) {
      const std::array<BodyId, 2> bodies = {labels.behind, labels.before};
      if (labels.sheet == 0 || labels.sheet > bounds.bodies_of_sheets.size() ||
          bounds.bodies_of_sheets[labels.sheet - 1] != bodies)
        findings.add_unless_open(&AuditReport::num_wrong_facets,
                                 "a facet here is not between the bodies that its sheet parts",
                                 leaf.key, centroid);
    }
    sheets.push_back({.place = centroid, .listed = labels.sheet});
    reach = std::max(reach, norm(centroid - a));
  }
  if (bounds.has_sheets) measure_sheets(sheets, reach, leaf, leaves, records, bounds);
  for (const SheetDistance& sheet : sheets) {
    const bool is_right = bounds.has_sheets
                              ? sheet.of_listed <= sheet.nearest + kFastDistanceError * bounds.size
                              : sheet.listed == kOnlySheet;
    if (!is_right)
      findings.add(&AuditReport::num_wrong_facets,
                   "a facet here is not of the sheet that its centroid is closest to", leaf.key,
                   sheet.place);
  }
}

void check_boundary_links(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                          AuditFindings& findings) {
  const std::vector<LinkEdge> edges = link_edges(leaf, boundary);
  LinkCheck check(leaf, findings);
  for_each_group(
      std::span(edges), [](const LinkEdge& e) { return e.center; },
      [&](auto link) { check.check(link); });
}

void check_boundary_on_surface(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                               const AuditLeaves& leaves, const AuditRecords& records,
                               const AuditBounds& bounds, AuditFindings& findings) {
  const std::vector<Point> vertices = own_vertices(leaf, boundary);
  if (vertices.empty()) return;
  const double tolerance = kOnSurface * bounds.size + bounds.rounding;
  std::vector<Triangle> triangles = records.own().surface(leaf.key).triangles;
  std::vector<double> distances = distances_within(vertices, triangles, tolerance, bounds.size);

  // The others lie on a triangle that misses the leaf's box by a rounding error, or on a needle, or
  // off the surface.
  const bool is_all_near =
      std::ranges::all_of(distances, [](double d) { return std::isfinite(d); });
  if (!is_all_near) {
    for (const std::size_t neighbor : leaves.within(leaves.box(leaf.leaf), tolerance)) {
      if (neighbor == leaf.leaf) continue;
      const MortonKey key = leaves.key(neighbor);
      const auto more = records.of(key).surface(key).triangles;
      triangles.insert(triangles.end(), more.begin(), more.end());
    }
  }
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    if (!std::isfinite(distances[i])) {
      distances[i] = careful_distance(vertices[i], triangles, kFastDistanceError * bounds.size);
    }
    double& largest = findings.report().max_surface_distance;
    largest = std::max(largest, distances[i] / bounds.size);
    if (distances[i] <= tolerance) continue;
    char text[96];
    std::snprintf(text, sizeof text, "this boundary vertex is %.3g of the size off the surface",
                  distances[i] / bounds.size);
    findings.add_unless_open(&AuditReport::num_off_surface_vertices, text, leaf.key, vertices[i]);
  }
}

void check_between_bodies(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                          const AuditLeaves& leaves, const AuditRecords& records,
                          const AuditBounds& bounds, AuditFindings& findings) {
  if (!bounds.has_bodies()) return;
  std::map<std::array<BodyId, 2>, std::vector<LocalFacet>> by_bodies;
  for (const LocalFacet& facet : boundary)
    by_bodies[{std::max(facet.body, facet.beyond), std::min(facet.body, facet.beyond)}].push_back(
        facet);
  const double tolerance = kBetweenBodies * bounds.size + bounds.rounding;
  std::vector<Triangle> all;
  for (const std::size_t near : leaves.within(leaves.box(leaf.leaf), tolerance)) {
    const MortonKey key = leaves.key(near);
    const auto more = records.of(key).surface(key).triangles;
    all.insert(all.end(), more.begin(), more.end());
  }
  for (const auto& [bodies, facets] : by_bodies) {
    std::vector<Triangle> between;
    std::ranges::copy_if(all, std::back_inserter(between), [&](const Triangle& t) {
      return 0 < t.sheet && t.sheet <= bounds.bodies_of_sheets.size() &&
             bounds.bodies_of_sheets[t.sheet - 1] == bodies;
    });
    const std::vector<Point> vertices = own_vertices(leaf, facets);
    const std::vector<double> distances =
        distances_within(vertices, between, tolerance, bounds.size);
    for (std::size_t i = 0; i < vertices.size(); ++i)
      if (std::isinf(distances[i]) &&
          careful_distance(vertices[i], between, kFastDistanceError * bounds.size) > tolerance)
        findings.add_unless_open(&AuditReport::num_wrong_facets,
                                 "this vertex has a facet between bodies that the surface does not "
                                 "part there",
                                 leaf.key, vertices[i]);
  }
}

UnionFind::UnionFind(std::size_t n) {
  for (std::size_t i = 0; i < n; ++i) add();
}

std::size_t UnionFind::add() {
  parents_.push_back(parents_.size());
  ++num_sets_;
  return parents_.size() - 1;
}

std::size_t UnionFind::find(std::size_t i) {
  while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
  return i;
}

void UnionFind::unite(std::size_t i, std::size_t j) {
  i = find(i);
  j = find(j);
  if (i == j) return;
  parents_[std::max(i, j)] = std::min(i, j);
  --num_sets_;
}

void BoundaryComponents::add(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                             const AuditLeaves& leaves) {
  forget_before(leaf.leaf);
  UnionFind local = own_components(leaf, boundary);
  std::unordered_map<std::size_t, std::size_t> label_of_set;
  const auto label = [&](LocalIndex own) {
    const auto [place, is_new] = label_of_set.try_emplace(local.find(own));
    if (is_new) place->second = labels_.add();
    return place->second;
  };
  std::map<LocalIndex, std::uint32_t> last_leaf;  // that an own vertex shares a facet with
  for (const LocalFacet& facet : boundary) {
    for (const LocalIndex own : facet.vertices) {
      if (!leaf.is_own(own)) continue;
      const std::size_t here = label(own);
      for (const LocalIndex other : facet.vertices) {
        const LocalPoint& point = leaf.points[other];
        if (!records_->is_own(leaves.key(point.leaf))) {
          crossings_.push_back({leaf.points[own].id, point.id, point.leaf, here});
        } else if (point.leaf > leaf.leaf) {
          last_leaf[own] = std::max(last_leaf[own], point.leaf);
        } else if (point.leaf < leaf.leaf) {
          const auto seam = seams_.find(point.id);
          if (seam != seams_.end()) labels_.unite(here, seam->second);
        }
      }
    }
  }
  for (const auto& [own, last] : last_leaf) {
    seams_.insert_or_assign(leaf.points[own].id, label(own));
    expiry_[last].push_back(leaf.points[own].id);
  }
}

std::vector<BoundaryComponents::Crossing> BoundaryComponents::crossings() {
  for (Crossing& crossing : crossings_) crossing.label = labels_.find(crossing.label);
  return std::move(crossings_);
}

void BoundaryComponents::forget_before(std::uint32_t leaf) {
  while (!expiry_.empty() && expiry_.begin()->first < leaf) {
    for (const std::uint64_t id : expiry_.begin()->second) seams_.erase(id);
    expiry_.erase(expiry_.begin());
  }
}

}  // namespace locvol
