// The audit of creases, and of the edges of cells that lead from sheet to sheet.
#include "engine/audit/audit_creases.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "octree/sort_and_unite.h"
#include "refine/predicates.h"

namespace locvol {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Fractions of λ, to which rounding is added. Up to the first a point is on a crease.
constexpr double kOnCrease = 2e-6;
// What is farther from a point is no surface that it lies on; and of the sheets within, those
// count that are no farther than the nearest, but for the last fraction.
constexpr double kNearSheet = 1e-6, kOnSheet = 1e-9;
// Points that are farther apart on a crease do not follow each other: over h, where steps are at
// most 0.84. What lies between them is lost.
constexpr double kLongestWay = 1.5;

using LocalEdge = std::array<LocalIndex, 2>;

LocalEdge ascending(LocalIndex a, LocalIndex b) { return {std::min(a, b), std::max(a, b)}; }

// The fractions of a segment between which it lies in the box.
std::optional<std::array<double, 2>> part_within(const Box& box, const Point& a, const Point& b) {
  double low = 0, high = 1;
  for (const int axis : {0, 1, 2}) {
    const double way = b[axis] - a[axis];
    if (way == 0) {
      if (a[axis] < box.min[axis] || a[axis] > box.max[axis]) return std::nullopt;
      continue;
    }
    const auto [first, last] =
        std::minmax({(box.min[axis] - a[axis]) / way, (box.max[axis] - a[axis]) / way});
    low = std::max(low, first);
    high = std::min(high, last);
  }
  if (low > high) return std::nullopt;
  return std::array{low, high};
}

Point between(const Point& a, const Point& b, double fraction) { return a + fraction * (b - a); }

}  // namespace

struct AuditCreases::Link {
  std::array<std::uint32_t, 2> nodes{};  // vertices, then points between them
  Piece piece;
  double length = 0;
};

struct AuditCreases::NearSheet {
  SheetId sheet = 0;
  double distance = 0;
  Point normal;  // of any length
};

AuditCreases::AuditCreases(const AuditLeaf& leaf, const AuditLeaves& leaves,
                           const AuditRecords& records, const AuditBounds& bounds)
    : leaf_(leaf), leaves_(leaves), records_(records), bounds_(bounds), grid_({}, bounds.size) {
  if (leaf.creases.empty()) return;
  std::vector<Point> positions;
  for (LocalIndex i = 0; i < leaf.points.size(); ++i)
    if (leaf.points[i].kind == PointKind::kCrease) {
      crease_points_.push_back(i);
      positions.push_back(leaf.points.position(i));
    }
  grid_ = AuditGrid(positions, 0.5 * leaf.reach);
  for (const CreaseEdge& edge : leaf.creases)
    vertices_.insert(vertices_.end(), edge.ends.begin(), edge.ends.end());
  sort_and_unite(vertices_);
  std::vector<LocalIndex> point_at;
  const std::vector<Link> links = cut_edges(point_at);
  follow(links, point_at);
  for (const Way& way : ways_)
    if (way.ends[1] != kUnknownPoint) neighbors_.push_back(way.ends);
  std::ranges::sort(neighbors_);
}

LocalIndex AuditCreases::point_for(const Point& place) const {
  LocalIndex nearest = kUnknownPoint;
  double least = bounds_.crease_floor * bounds_.crease_floor;
  grid_.for_each_near(Box::around(place).expanded(bounds_.crease_floor),
                      [&](std::uint32_t i, const Point& p) {
                        const double squared = squared_distance(p, place);
                        if (squared > least) return;
                        if (squared == least && crease_points_[i] > nearest) return;
                        least = squared;
                        nearest = crease_points_[i];
                      });
  return nearest;
}

// A point goes to the vertex that it is, or else to the nearest edge.
std::vector<AuditCreases::Link> AuditCreases::cut_edges(std::vector<LocalIndex>& point_at) {
  point_at.assign(vertices_.size(), kUnknownPoint);
  is_corner_.assign(vertices_.size(), false);
  const auto vertex_at = [&](const Point& p) {
    return static_cast<std::uint32_t>(std::ranges::lower_bound(vertices_, p) - vertices_.begin());
  };

  struct Candidate {
    LocalIndex point = 0;
    double squared = kInfinity;  // distance from the edge
    std::uint32_t edge = 0;
    double fraction = 0;  // of the edge, up to there
  };
  std::vector<Candidate> candidates;
  std::vector<Point> positions;
  for (LocalIndex i = 0; i < leaf_.points.size(); ++i) {
    if (leaf_.points[i].kind != PointKind::kCrease) continue;
    const Point& p = leaf_.points.position(i);
    const std::uint32_t vertex = vertex_at(p);
    if (vertex < vertices_.size() && vertices_[vertex] == p) {
      point_at[vertex] = i;
      continue;
    }
    candidates.push_back({.point = i});
    positions.push_back(p);
  }

  const double tolerance = kOnCrease * bounds_.size + bounds_.rounding;
  const double side = 0.5 * leaf_.reach;
  const AuditGrid grid(positions, side);
  const Box region = leaves_.box(leaf_.leaf).expanded(leaf_.reach + tolerance);
  for (std::uint32_t e = 0; e < leaf_.creases.size(); ++e) {
    const auto& [a, b] = leaf_.creases[e].ends;
    const auto part = part_within(region, a, b);
    if (!part || positions.empty()) continue;
    // Step by step, so that the boxes that it is looked for in are small.
    const double squared_length = squared_distance(a, b), share = (*part)[1] - (*part)[0];
    const double num_steps = std::max(1.0, std::ceil(share * std::sqrt(squared_length) / side));
    for (double step = 0; step < num_steps; ++step) {
      const Point from = between(a, b, (*part)[0] + step / num_steps * share);
      const Point to = between(a, b, (*part)[0] + (step + 1) / num_steps * share);
      const Box box = Box::around(from).joined(to).expanded(tolerance);
      grid.for_each_near(box, [&](std::uint32_t i, const Point& p) {
        if (!box.contains(p)) return;
        const double fraction = std::clamp(dot(p - a, b - a) / squared_length, 0.0, 1.0);
        const double squared = squared_distance(p, between(a, b, fraction));
        if (squared > tolerance * tolerance || squared >= candidates[i].squared) return;
        candidates[i] = {candidates[i].point, squared, e, fraction};
      });
    }
  }

  std::erase_if(candidates, [](const Candidate& c) { return c.squared == kInfinity; });
  std::ranges::sort(candidates, {},
                    [](const Candidate& c) { return std::tuple(c.edge, c.fraction, c.point); });
  std::vector<Link> links;
  auto next = candidates.begin();
  for (std::uint32_t e = 0; e < leaf_.creases.size(); ++e) {
    const CreaseEdge& edge = leaf_.creases[e];
    const auto& [a, b] = edge.ends;
    const std::array ends{vertex_at(a), vertex_at(b)};
    for (const std::size_t k : {0, 1})
      if (edge.is_corner[k]) is_corner_[ends[k]] = true;
    const double length = norm(b - a);
    std::uint32_t last_node = ends[0];
    double last = 0;
    const auto link_to = [&](std::uint32_t node, double fraction) {
      links.push_back({{last_node, node},
                       {between(a, b, last), fraction < 1 ? between(a, b, fraction) : b},
                       (fraction - last) * length});
      last_node = node;
      last = fraction;
    };
    for (; next != candidates.end() && next->edge == e; ++next) {
      if (next->fraction <= 0 || next->fraction >= 1) {
        point_at[ends[next->fraction > 0]] = next->point;
        continue;
      }
      link_to(static_cast<std::uint32_t>(point_at.size()), next->fraction);
      point_at.push_back(next->point);
    }
    link_to(ends[1], 1);
  }
  return links;
}

// From links to ways: on through vertices without a point that just two edges share.
void AuditCreases::follow(std::span<const Link> links, std::span<const LocalIndex> point_at) {
  constexpr auto kNone = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> num_at(point_at.size());
  std::vector<std::array<std::uint32_t, 2>> links_at(point_at.size(), {kNone, kNone});
  for (std::uint32_t l = 0; l < links.size(); ++l)
    for (const std::uint32_t node : links[l].nodes)
      if (const std::uint32_t n = num_at[node]++; n < 2) links_at[node][n] = l;
  const auto goes_on = [&](std::uint32_t node) {
    return point_at[node] == kUnknownPoint && num_at[node] == 2 && !is_corner_[node];
  };

  std::vector<bool> is_done(links.size());
  const auto walk = [&](std::uint32_t l, std::uint32_t from) {
    Way way{.ends = {}, .first_piece = static_cast<std::uint32_t>(pieces_.size())};
    const LocalIndex start = goes_on(from) ? kUnknownPoint : point_at[from];
    while (true) {
      is_done[l] = true;
      pieces_.push_back(links[l].piece);
      way.length += links[l].length;
      from = links[l].nodes[links[l].nodes[0] == from];
      if (!goes_on(from)) break;
      l = links_at[from][links_at[from][0] == l];
      if (is_done[l]) break;  // closed, and without a point
    }
    way.num_pieces = static_cast<std::uint32_t>(pieces_.size()) - way.first_piece;
    way.ends = ascending(start, point_at[from]);
    ways_.push_back(way);
  };
  for (std::uint32_t l = 0; l < links.size(); ++l)
    for (const std::uint32_t node : links[l].nodes)
      if (!is_done[l] && !goes_on(node)) walk(l, node);
  for (std::uint32_t l = 0; l < links.size(); ++l)
    if (!is_done[l]) walk(l, links[l].nodes[0]);
}

// No looser than what refinement takes for the sheets of a point: with more sheets, two would be
// taken to have one in common that refinement knows to have none.
std::vector<std::vector<AuditCreases::NearSheet>> AuditCreases::sheets_at(
    std::span<const LocalIndex> vertices) const {
  std::vector<Point> positions;
  for (const LocalIndex i : vertices) positions.push_back(leaf_.points.position(i));
  std::vector<std::vector<NearSheet>> near(vertices.size());
  Box all = Box::around(positions.front());
  for (const Point& p : positions) all = all.joined(p);
  const double tolerance = kNearSheet * bounds_.size + bounds_.rounding;
  const AuditGrid grid(positions, 0.5 * leaf_.reach);
  for (const std::size_t beside : leaves_.within(leaves_.box(leaf_.leaf), leaf_.reach)) {
    if (leaves_.box(beside).squared_distance(all) > tolerance * tolerance) continue;
    const MortonKey key = leaves_.key(beside);
    for (const Triangle& triangle : records_.of(key).surface(key).triangles) {
      const Box box = triangle.box().expanded(tolerance);
      grid.for_each_near(box, [&](std::uint32_t i, const Point& p) {
        if (!box.contains(p)) return;
        const double distance = distance_to_triangle(p, triangle);
        if (distance > tolerance) return;
        const auto& [a, b, c] = triangle.corners;
        near[i].push_back({triangle.sheet, distance, cross(b - a, c - a)});
      });
    }
  }
  for (std::vector<NearSheet>& sheets : near) {
    if (sheets.empty()) continue;
    const double farthest = std::ranges::min(sheets, {}, &NearSheet::distance).distance +
                            kOnSheet * bounds_.size + bounds_.rounding;
    std::erase_if(sheets, [&](const NearSheet& sheet) { return sheet.distance > farthest; });
  }
  return near;
}

bool AuditCreases::leads_across(std::span<const NearSheet> from, std::span<const NearSheet> to,
                                bool is_on_crease) {
  bool has_common = false;
  for (const NearSheet& one : from)
    for (const NearSheet& other : to) {
      if (one.sheet != other.sheet) continue;
      has_common = true;
      if (!is_on_crease && dot(one.normal, other.normal) < 0) return true;
    }
  return !has_common;
}

std::vector<bool> AuditCreases::lead_across(std::span<const LocalEdge> edges) const {
  std::vector<bool> result(edges.size());
  std::vector<LocalIndex> vertices;
  const auto kind = [&](LocalIndex i) { return leaf_.points[i].kind; };
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const auto& [a, b] = edges[i];
    if (!is_on_surface(kind(a)) || !is_on_surface(kind(b))) continue;
    if (kind(a) == PointKind::kCrease && kind(b) == PointKind::kCrease)
      result[i] = !std::ranges::binary_search(neighbors_, ascending(a, b));
    if (!result[i]) vertices.insert(vertices.end(), {a, b});
  }
  if (vertices.empty()) return result;
  sort_and_unite(vertices);
  const std::vector<std::vector<NearSheet>> sheets = sheets_at(vertices);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const auto place = [&](LocalIndex v) {
      const auto found = std::ranges::lower_bound(vertices, v);
      return found != vertices.end() && *found == v ? &sheets[std::size_t(found - vertices.begin())]
                                                    : nullptr;
    };
    const auto *one = place(edges[i][0]), *other = place(edges[i][1]);
    if (result[i] || one == nullptr || other == nullptr || one->empty() || other->empty()) continue;
    result[i] = leads_across(
        *one, *other,
        kind(edges[i][0]) == PointKind::kCrease || kind(edges[i][1]) == PointKind::kCrease);
  }
  return result;
}

namespace {

class CreaseCheck {
 public:
  CreaseCheck(const AuditLeaf& leaf, const AuditCreases& creases, const Box& box,
              const AuditBounds& bounds, AuditFindings& findings)
      : leaf_(leaf), creases_(creases), box_(box), bounds_(bounds), findings_(findings) {
    find_corners();
    read_star();
  }

  void run() {
    for (const AuditCreases::Way& way : creases_.ways()) {
      const LocalEdge ends = ends_of(way);
      const auto& [a, b] = ends;
      const double longest = kLongestWay / kCellReach * leaf_.reach;
      if (b != kUnknownPoint && a != b && way.length <= longest)
        check_between(ends, way.length);
      else if (way.length >= 3 * bounds_.crease_floor)
        add_lost(way);
    }
    check_corners();
  }

 private:
  // Of a point: on a crease, or at an own corner; in a cell.
  enum Mark : std::uint8_t { kOnCreaseMark = 1, kCornerMark = 2, kUsedMark = 4 };

  // A corner of nothing but short ways is told apart from no other.
  void find_corners() {
    std::vector<Point> of_short, of_long;
    for (const AuditCreases::Way& way : creases_.ways())
      for (const AuditCreases::Piece& piece : creases_.pieces(way)) {
        std::vector<Point>& ends = way.length < 3 * bounds_.crease_floor ? of_short : of_long;
        ends.insert(ends.end(), piece.begin(), piece.end());
      }
    sort_and_unite(of_short);
    sort_and_unite(of_long);
    for (const CornerPoint& corner : leaf_.corners) corners_.push_back(corner.position);
    for (const CreaseEdge& edge : leaf_.creases)
      for (const std::size_t k : {0, 1})
        if (edge.is_corner[k]) corners_.push_back(edge.ends[k]);
    std::erase_if(corners_, [&](const Point& p) {
      return !is_in_leaf(box_, p) ||
             (std::ranges::binary_search(of_short, p) && !std::ranges::binary_search(of_long, p));
    });
    sort_and_unite(corners_);
  }

  void read_star() {
    marks_.resize(leaf_.points.size());
    for (LocalIndex i = 0; i < marks_.size(); ++i)
      if (leaf_.points[i].kind == PointKind::kCrease) marks_[i] |= kOnCreaseMark;
    for (const Point& corner : corners_)
      if (const LocalIndex i = leaf_.points.at(corner); i != kUnknownPoint)
        marks_[i] |= kCornerMark;
    for (const LocalCell& cell : leaf_.star) read(cell.vertices);
    for (const LocalFacet& facet : leaf_.star_facets) read(facet.vertices);
    sort_and_unite(edges_);
  }

  // Of a cell, or of a facet.
  void read(std::span<const LocalIndex> v) {
    if (std::ranges::all_of(v, [&](LocalIndex i) { return marks_[i] == 0; })) return;
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (marks_[v[i]] == 0) continue;
      marks_[v[i]] |= kUsedMark;
      for (std::size_t j = i + 1; j < v.size(); ++j)
        if (marks_[v[i]] & marks_[v[j]] & kOnCreaseMark) edges_.push_back(ascending(v[i], v[j]));
    }
  }

  void add_loss(double length, const Point& place) {
    findings_.report().lost_crease_length += length;
    findings_.add_unless_open(&AuditReport::num_lost_creases,
                              "a crease is no edge of the mesh here", leaf_.key, place);
  }

  // An end without a point may be one with another.
  LocalEdge ends_of(const AuditCreases::Way& way) const {
    if (way.ends[1] != kUnknownPoint) return way.ends;
    const auto pieces = creases_.pieces(way);
    // Pieces are in a row, and may be turned.
    const auto end_of = [&](const AuditCreases::Piece& last, const AuditCreases::Piece& before) {
      const bool is_first = last[0] != before[0] && last[0] != before[1];
      return creases_.point_for(last[is_first ? 0 : 1]);
    };
    if (pieces.size() == 1)
      return ascending(creases_.point_for(pieces[0][0]), creases_.point_for(pieces[0][1]));
    return ascending(end_of(pieces.front(), pieces[1]),
                     end_of(pieces.back(), pieces[pieces.size() - 2]));
  }

  // Of points that follow each other, the leaf of the smaller one tells.
  void check_between(const LocalEdge& ends, double length) {
    const auto& [a, b] = ends;
    if (!leaf_.is_own(a)) return;
    findings_.report().crease_length += length;
    if (std::ranges::binary_search(edges_, ends)) return;
    add_loss(length, between(leaf_.points.position(a), leaf_.points.position(b), 0.5));
  }

  // What lies between no two points: each leaf tells of its own part.
  void add_lost(const AuditCreases::Way& way) {
    double length = 0;
    std::optional<Point> place;
    for (const auto& [a, b] : creases_.pieces(way)) {
      const auto part = part_within(box_, a, b);
      if (!part || (*part)[0] == (*part)[1]) continue;
      const Point middle = between(a, b, 0.5 * ((*part)[0] + (*part)[1]));
      if (!is_in_leaf(box_, middle)) continue;
      length += ((*part)[1] - (*part)[0]) * norm(b - a);
      if (!place) place = middle;
    }
    if (!place) return;
    findings_.report().crease_length += length;
    add_loss(length, *place);
  }

  void check_corners() {
    for (const Point& corner : corners_) {
      const LocalIndex i = leaf_.points.at(corner);
      if (i == kUnknownPoint && creases_.point_for(corner) != kUnknownPoint) continue;
      if (i != kUnknownPoint && leaf_.is_own(i) && marks_[i] & kUsedMark) continue;
      findings_.add_unless_open(&AuditReport::num_lost_corners,
                                i == kUnknownPoint ? "a corner is no point of the mesh here"
                                                   : "a corner is in no cell here",
                                leaf_.key, corner);
    }
  }

  const AuditLeaf& leaf_;
  const AuditCreases& creases_;
  const Box& box_;
  const AuditBounds& bounds_;
  AuditFindings& findings_;
  std::vector<Point> corners_;       // own
  std::vector<std::uint8_t> marks_;  // of points
  std::vector<LocalEdge> edges_;     // of the star, between points on creases
};

}  // namespace

void check_creases(const AuditLeaf& leaf, const AuditCreases& creases, const Box& box,
                   const AuditBounds& bounds, AuditFindings& findings) {
  if (leaf.creases.empty() && leaf.corners.empty()) return;
  CreaseCheck(leaf, creases, box, bounds, findings).run();
}

}  // namespace locvol
