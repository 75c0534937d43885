#include "engine/ingest/cell_creases.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "octree/mix.h"
#include "refine/domain/triangle_box.h"

namespace locvol {
namespace {

double length_of(const CreaseEdge& edge) { return norm(edge.ends[1] - edge.ends[0]); }

// Edges of a cell that hang together at vertices. Parts are numbered from 1 on, in the order of
// their first edges.
class EdgesOfCell {
 public:
  EdgesOfCell(MortonKey cell, const TriangleBuckets& buckets)
      : cell_(cell), box_(buckets.frame().box(cell)), buckets_(buckets) {}

  const Box& box() const { return box_; }
  bool owns(const Point& p) const { return TriangleBuckets::owns(box_, p); }
  bool reaches_out(const CreaseEdge& edge) const {
    return TriangleBuckets::reaches_out(box_, edge.as_triangle());
  }

  // Puts each of the edges in a part, with those that have one of the vertices in common where they
  // are joined: `is_joined(edge, end)`.
  template <class IsJoined>
  std::vector<CreasePart> join(std::span<CellEdge*> edges, const IsJoined& is_joined) const {
    PartJoiner<CreasePart> joiner;
    for (CellEdge* edge : edges) {
      CreasePart part{
          .first_edge = edge->name, .box = edge->edge.box(), .sheets = edge->edge.sheets};
      if (owns(edge->edge.ends[0])) {
        part.num_edges = 1;
        part.length.add(length_of(edge->edge));
      }
      for (std::size_t end = 0; end < 2; ++end)
        part.num_ends += edge->edge.is_corner[end] && owns(edge->edge.ends[end]);
      const std::uint32_t number = joiner.add_part(part);
      for (std::size_t end = 0; end < 2; ++end)
        if (is_joined(*edge, end)) joiner.join(edge->end_names[end], number, false, false);
    }
    std::vector<std::uint32_t> numbers;
    std::vector<CreasePart> parts = joiner.take(numbers).components;
    for (std::size_t e = 0; e < edges.size(); ++e) edges[e]->edge.crease = 1 + numbers[e];
    return parts;
  }

  std::vector<SharedEdge> shared(std::span<const CellEdge> edges) const {
    std::vector<SharedEdge> shared;
    for (const auto& [edge, name, end_names, is_given, junction] : edges)
      if (edge.crease != kNoPart && reaches_out(edge))
        shared.push_back({name, edge.crease, buckets_.is_last_with(cell_, edge.as_triangle())});
    return shared;
  }

 private:
  MortonKey cell_;
  Box box_;
  const TriangleBuckets& buckets_;
};

// Finds the edges and tips among the triangles of a cell.
class EdgeFinder {
 public:
  EdgeFinder(std::vector<Triangle> triangles, std::span<const SheetPiece> pieces, const Box& box,
             const SharpAngle& angle, const NeedleNormals& needles, const EdgeSet& given,
             bool has_contacts, double least_extent)
      : triangles_(std::move(triangles)),
        pieces_(pieces),
        box_(box),
        angle_(angle),
        given_(given),
        has_contacts_(has_contacts),
        least_at_tip_(0.25 * least_extent),
        soup_(soup_of(triangles_)),
        mates_(paired_edges(soup_.vertices.size(), soup_.triangles)),
        names_(soup_.vertices.size(), kNoName),
        has_tip_(soup_.vertices.size(), true) {
    normals_.reserve(triangles_.size());
    for (const Triangle& t : triangles_) normals_.push_back(needles.normal_of(t));
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      SurfaceName& name = names_[origin(soup_.triangles, h)];
      name = std::min(name, name_of(h));
    }
    if (has_contacts)
      unpair_others(mates_, [&](std::uint32_t h) {
        return TriangleBuckets::meets_edge(box_, position(origin(soup_.triangles, h)),
                                           position(target(soup_.triangles, h)));
      });
  }

  CellCreases run() && {
    CellCreases found;
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      if (const std::uint32_t g = mates_[h]; g != kNoHalfEdge && h < g) look_at(h, g, found);
      if (angle_.is_over_hole(triangles_[h / 3])) has_tip_[origin(soup_.triangles, h)] = false;
    }
    if (has_contacts_)
      EdgeTable(soup_.vertices.size(), soup_.triangles)
          .for_each_edge([&](std::span<const std::uint32_t> uses) {
            if (uses.size() > 2) take_junction(uses, found);
          });
    std::ranges::sort(found.edges, {}, &CellEdge::name);
    find_tips(found);
    return found;
  }

 private:
  SurfaceName name_of(std::uint32_t h) const { return 3 * triangles_[h / 3].id + h % 3; }
  const Point& position(std::uint32_t v) const { return soup_.vertices[v]; }

  void look_at(std::uint32_t h, std::uint32_t g, CellCreases& found) {
    const SheetId one = triangles_[h / 3].sheet, other = triangles_[g / 3].sheet;
    std::uint32_t v = origin(soup_.triangles, h), w = target(soup_.triangles, h);
    const bool is_given = given_.contains(position(v), position(w));
    const bool is_by_angle =
        angle_.is_given() &&
        (one != other ||
         angle_.is_exceeded(triangles_[h / 3], normals_[h / 3], triangles_[g / 3], normals_[g / 3],
                            is_turned_across(soup_.triangles, h, g)));
    if (!is_given && !is_by_angle) return;
    has_tip_[v] = has_tip_[w] = false;
    if (!is_given && !pieces_.empty() && pieces_[h / 3].is_beside_strip(pieces_[g / 3])) return;
    if (position(w) < position(v)) std::swap(v, w);
    const CellEdge edge{.edge = {.ends = {position(v), position(w)},
                                 .sheets = {std::min(one, other), std::max(one, other)},
                                 .crease = kNoPart},
                        .name = std::min(name_of(h), name_of(g)),
                        .end_names = {names_[v], names_[w]},
                        .is_given = is_given};
    if (touches(edge.edge, box_)) found.edges.push_back(edge);
  }

  // Of an edge that is not in the closed cell, some triangles may be missing.
  void take_junction(std::span<const std::uint32_t> uses, CellCreases& found) {
    std::uint32_t v = origin(soup_.triangles, uses[0]), w = target(soup_.triangles, uses[0]);
    has_tip_[v] = has_tip_[w] = false;
    if (position(w) < position(v)) std::swap(v, w);
    SurfaceName name = kNoName;
    std::vector<SheetId> sheets;
    for (const std::uint32_t h : uses) {
      name = std::min(name, name_of(h));
      sheets.push_back(triangles_[h / 3].sheet);
    }
    std::ranges::sort(sheets);
    std::uint64_t junction = mix(sheets.size());
    for (const SheetId sheet : sheets) junction = mix(junction ^ sheet);
    const CellEdge edge{.edge = {.ends = {position(v), position(w)},
                                 .sheets = {sheets.front(), sheets.back()},
                                 .crease = kNoPart},
                        .name = name,
                        .end_names = {names_[v], names_[w]},
                        .is_given = true,
                        .junction = junction};
    if (touches(edge.edge, box_)) found.edges.push_back(edge);
  }

  // The mean of the normals at a vertex, by angle, as their triangles turn in the cell.
  void find_tips(CellCreases& found) const {
    struct Lean {
      Point sum;
      double angle = 0, length = 0, num_sides = 0;  // of triangles at the vertex
    };
    std::vector<Lean> leans(soup_.vertices.size());
    const Components components = find_components(soup_.triangles, mates_);
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      const std::uint32_t v = origin(soup_.triangles, h);
      if (!has_tip_[v] || !box_.contains(position(v))) continue;
      const Point one = position(target(soup_.triangles, h)) - position(v),
                  other = position(apex(soup_.triangles, h)) - position(v);
      const double angle = std::atan2(norm(cross(one, other)), dot(one, other));
      leans[v].angle += angle;
      leans[v].length += norm(one) + norm(other);
      leans[v].num_sides += 2;
      leans[v].sum =
          leans[v].sum + (components.is_turned[h / 3] ? -angle : angle) * normals_[h / 3];
    }
    for (std::uint32_t v = 0; v < leans.size(); ++v)
      if (leans[v].angle > 0 && leans[v].length >= least_at_tip_ * leans[v].num_sides &&
          angle_.is_exceeded(norm(leans[v].sum) / leans[v].angle))
        found.corners.push_back({names_[v], position(v)});
  }

  std::vector<Triangle> triangles_;
  std::span<const SheetPiece> pieces_;  // of these; or empty
  const Box& box_;
  const SharpAngle& angle_;
  const EdgeSet& given_;
  const bool has_contacts_;
  const double least_at_tip_;
  TriangleSoup soup_;
  Mates mates_;
  std::vector<SurfaceName> names_;  // of vertices
  std::vector<bool> has_tip_;       // of vertices: not those of edges that are found, or at holes
  std::vector<Point> normals_;
};

// Says of the ends in the closed cell which are corners, and adds these.
void find_corners(const Box& box, CellCreases& creases) {
  static const double least_cosine = std::cos(kCreaseTurn * std::numbers::pi / 180);
  struct End {
    SurfaceName vertex;
    std::uint32_t edge, end;
    auto operator<=>(const End&) const = default;
  };
  std::vector<End> ends;
  for (std::uint32_t e = 0; e < creases.edges.size(); ++e)
    for (const std::uint32_t end : {0U, 1U})
      if (box.contains(creases.edges[e].edge.ends[end]))
        ends.push_back({creases.edges[e].end_names[end], e, end});
  std::ranges::sort(ends);
  const auto way_out = [&](const End& at) {
    const auto& from = creases.edges[at.edge].edge.ends;
    const Point way = from[1 - at.end] - from[at.end];
    return 1 / norm(way) * way;
  };
  for (auto first = ends.begin(); first != ends.end();) {
    const auto end =
        std::find_if(first, ends.end(), [&](const End& e) { return e.vertex != first->vertex; });
    const bool goes_on =
        end - first == 2 && -dot(way_out(first[0]), way_out(first[1])) >= least_cosine &&
        creases.edges[first[0].edge].junction == creases.edges[first[1].edge].junction;
    if (!goes_on) {
      creases.corners.push_back({first->vertex, creases.edges[first->edge].edge.ends[first->end]});
      for (auto at = first; at != end; ++at) creases.edges[at->edge].edge.is_corner[at->end] = true;
    }
    first = end;
  }
}

}  // namespace

CellParts edges_of_cell(std::vector<Triangle> triangles, std::span<const SheetPiece> pieces,
                        MortonKey cell, const TriangleBuckets& buckets, const SharpAngle& angle,
                        const NeedleNormals& needles, const EdgeSet& given, bool has_contacts,
                        double least_extent) {
  const EdgesOfCell of_cell(cell, buckets);
  CellParts found;
  found.creases = EdgeFinder(std::move(triangles), pieces, of_cell.box(), angle, needles, given,
                             has_contacts, least_extent)
                      .run();
  std::vector<CellEdge>& edges = found.creases.edges;
  // Corners so far tell noise.
  const std::vector<SurfaceCorner> tips = found.creases.corners;
  find_corners(of_cell.box(), found.creases);
  found.creases.corners = tips;
  const auto within_sheets = [&] {
    std::vector<CellEdge*> some;
    for (CellEdge& edge : edges)
      if (edge.edge.is_within_sheet() && !edge.is_given) some.push_back(&edge);
    return some;
  };
  const auto join = [&] {
    auto some = within_sheets();
    return of_cell.join(some, [](const CellEdge&, std::size_t) { return true; });
  };
  const std::vector<CreasePart> parts = join();
  std::vector<bool> is_noise(1 + parts.size());
  for (std::size_t p = 0; p < parts.size(); ++p) is_noise[1 + p] = parts[p].is_noise(least_extent);
  for (const CellEdge& edge : edges)
    if (of_cell.reaches_out(edge.edge)) is_noise[edge.edge.crease] = false;
  std::erase_if(edges, [&](const CellEdge& edge) { return is_noise[edge.edge.crease]; });
  found.parts = join();
  for (CellEdge& edge : edges) edge.edge.is_corner = {};
  found.shared = of_cell.shared(edges);
  return found;
}

CellParts chains_of_cell(CellCreases creases, MortonKey cell, const TriangleBuckets& buckets) {
  const EdgesOfCell of_cell(cell, buckets);
  CellParts found;
  found.creases = std::move(creases);
  find_corners(of_cell.box(), found.creases);
  std::vector<CellEdge*> edges;
  for (CellEdge& edge : found.creases.edges) edges.push_back(&edge);
  found.parts = of_cell.join(edges, [&](const CellEdge& edge, std::size_t end) {
    return of_cell.box().contains(edge.edge.ends[end]) && !edge.edge.is_corner[end];
  });
  for (const auto& [edge, name, end_names, is_given, junction] : found.creases.edges)
    for (std::size_t end = 0; end < 2; ++end)
      if (edge.is_corner[end] && of_cell.owns(edge.ends[end]))
        found.parts[edge.crease - 1].add_corner(end_names[end]);
  found.shared = of_cell.shared(found.creases.edges);
  std::ranges::copy_if(found.creases.corners, std::back_inserter(found.owned),
                       [&](const SurfaceCorner& corner) { return of_cell.owns(corner.position); });
  return found;
}

}  // namespace locvol
