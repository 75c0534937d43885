#include "engine/ingest/surface_sheets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

#include "engine/ingest/sharp_edges.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "octree/disjoint_sets.h"

namespace locvol {
namespace {

// A triangle that other cells have, too.
struct SharedBySheets {
  std::uint64_t id = 0;
  std::uint32_t part = 0;  // of the cell
  bool is_turned = false;  // against the part's orientation
  bool is_last = false;    // no later cell has it
};

// What one cell knows of sheets.
struct CellSheets {
  std::vector<Triangle> triangles;  // with the numbers of their parts in place of their groups
  std::vector<SheetPart> parts;
  std::vector<SharedBySheets> shared;
  std::vector<SheetBorder> borders;
};

class SheetsOfCell {
 public:
  SheetsOfCell(std::vector<Triangle> triangles, MortonKey cell, const TriangleBuckets& buckets,
               const SharpAngle& angle, const NeedleNormals& needles, const EdgeSet& given,
               double least_width, bool has_contacts)
      : cell_(cell),
        box_(buckets.frame().box(cell)),
        buckets_(buckets),
        least_width_(least_width),
        soup_(soup_of(triangles)),
        mates_(paired_edges(soup_.vertices.size(), soup_.triangles)) {
    if (has_contacts)
      unpair_others(mates_, [&](std::uint32_t h) {
        return TriangleBuckets::meets_edge(box_, position(origin(soup_.triangles, h)),
                                           position(target(soup_.triangles, h)));
      });
    found_.triangles = std::move(triangles);
    part_sharp_edges(angle, needles, given);
  }

  CellSheets run() && {
    const std::vector<std::uint32_t> points = find_points();
    part_ribs();
    const Components components = find_components(soup_.triangles, mates_);
    found_.parts.resize(components.count);
    for (std::uint32_t t = 0; t < found_.triangles.size(); ++t)
      take(components.of_triangle[t], components.is_turned[t], found_.triangles[t]);
    for (const std::uint32_t t : points) ++found_.parts[components.of_triangle[t]].num_points;
    for (const auto& [h, g] : parted_)
      for (const auto& [of, other] : {std::pair(h, g), std::pair(g, h)})
        found_.parts[components.of_triangle[of / 3]].turn.add(
            turn_across(of, other, components.is_turned[of / 3]));
    for (const bool is_rib : {false, true}) {
      std::map<std::pair<std::uint32_t, std::uint32_t>, CompensatedSum> lengths;
      for (const auto& [h, g] : is_rib ? ribs_ : parted_) {
        const auto parts =
            std::minmax(components.of_triangle[h / 3], components.of_triangle[g / 3]);
        if (parts.first != parts.second) lengths[parts].add(length_of(h));
      }
      for (const auto& [parts, length] : lengths)
        found_.borders.push_back({parts.first, parts.second, is_rib, length});
    }
    return std::move(found_);
  }

 private:
  const Point& position(std::uint32_t v) const { return soup_.vertices[v]; }

  bool is_ours(std::uint32_t h) const {
    return TriangleBuckets::owns(
        box_, std::min(position(origin(soup_.triangles, h)), position(target(soup_.triangles, h))));
  }

  // Of the edges that sheets end at, those are noted whose triangles are of one group.
  void part_sharp_edges(const SharpAngle& angle, const NeedleNormals& needles,
                        const EdgeSet& given) {
    const std::vector<Triangle>& triangles = found_.triangles;
    std::vector<Point> normals;
    normals.reserve(triangles.size());
    for (const Triangle& t : triangles) normals.push_back(needles.normal_of(t));
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      const std::uint32_t g = mates_[h];
      if (g == kNoHalfEdge || g < h) continue;
      const bool has_one_group = triangles[h / 3].sheet == triangles[g / 3].sheet;
      if (has_one_group &&
          !angle.is_exceeded(triangles[h / 3], normals[h / 3], triangles[g / 3], normals[g / 3],
                             is_turned_across(soup_.triangles, h, g)) &&
          !given.contains(position(origin(soup_.triangles, h)),
                          position(target(soup_.triangles, h))))
        continue;
      mates_[h] = mates_[g] = kNoHalfEdge;
      has_borders_ = true;
      if (!has_one_group) continue;
      noted_.emplace_back(h, g);
      if (is_ours(h)) parted_.emplace_back(h, g);
    }
  }

  double length_of(std::uint32_t h) const {
    return norm(position(target(soup_.triangles, h)) - position(origin(soup_.triangles, h)));
  }

  // Edges as short as strips are narrow, between two vertices at sharp edges. Whoever owns a vertex
  // knows whether it is at one, and if it is not, the cell has the edge's triangles as one part;
  // others leave that to it.
  void part_ribs() {
    std::vector<bool> is_at_edge(soup_.vertices.size());
    for (const auto& [h, g] : noted_)
      is_at_edge[origin(soup_.triangles, h)] = is_at_edge[target(soup_.triangles, h)] = true;
    const auto is_free = [&](std::uint32_t v) {
      return !is_at_edge[v] && TriangleBuckets::owns(box_, position(v));
    };
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      const std::uint32_t g = mates_[h];
      if (g == kNoHalfEdge || g < h || length_of(h) > least_width_ ||
          is_free(origin(soup_.triangles, h)) || is_free(target(soup_.triangles, h)))
        continue;
      mates_[h] = mates_[g] = kNoHalfEdge;
      if (is_ours(h)) ribs_.emplace_back(h, g);
    }
  }

  // The edge's length, if the triangle beyond rises to the side that this one faces; else less it.
  double turn_across(std::uint32_t h, std::uint32_t beyond, bool is_turned) const {
    const Point &p = position(origin(soup_.triangles, h)),
                &q = position(target(soup_.triangles, h)), &a = position(apex(soup_.triangles, h)),
                &b = position(apex(soup_.triangles, beyond));
    const bool rises = dot(cross(q - p, a - p), b - p) > 0;
    return rises != is_turned ? norm(q - p) : -norm(q - p);
  }

  // A triangle of each: where borders meet at a vertex, by the sum of the angles between them.
  std::vector<std::uint32_t> find_points() const {
    std::vector<std::uint32_t> points;
    if (!has_borders_) return points;
    std::vector<bool> is_at_border(soup_.vertices.size());
    for (std::uint32_t h = 0; h < mates_.size(); ++h)
      if (mates_[h] == kNoHalfEdge)
        for (const std::uint32_t v : {origin(soup_.triangles, h), target(soup_.triangles, h)})
          is_at_border[v] = TriangleBuckets::owns(box_, position(v));
    DisjointSets fans(mates_.size());  // of corners
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      const std::uint32_t g = mates_[h];
      if (g == kNoHalfEdge || g < h) continue;
      for (const std::uint32_t corner : {h, next_half_edge(h)})
        for (const std::uint32_t beyond : {g, next_half_edge(g)})
          if (origin(soup_.triangles, corner) == origin(soup_.triangles, beyond))
            fans.unite(corner, beyond);
    }
    std::map<std::size_t, double> angles;  // of fans
    for (std::uint32_t h = 0; h < mates_.size(); ++h) {
      const std::uint32_t v = origin(soup_.triangles, h);
      if (!is_at_border[v]) continue;
      const Point one = position(target(soup_.triangles, h)) - position(v),
                  other = position(apex(soup_.triangles, h)) - position(v);
      angles[fans.find(h)] += std::atan2(norm(cross(one, other)), dot(one, other));
    }
    constexpr double kPointed = kPointedAngle * std::numbers::pi / 180;
    for (const auto& [corner, angle] : angles)
      if (angle < kPointed) points.push_back(static_cast<std::uint32_t>(corner / 3));
    return points;
  }

  void take(std::uint32_t part, bool is_turned, Triangle& triangle) {
    SheetPart sum;
    sum.first_triangle = triangle.id;
    sum.is_first_turned = is_turned;
    if (owns_triangle(box_, triangle)) {
      const auto& [a, b, c] = triangle.corners;
      sum.area.add(0.5 * norm(cross(b - a, c - a)));
    }
    found_.parts[part].group = std::exchange(triangle.sheet, part);
    found_.parts[part].add(sum, false);
    if (TriangleBuckets::reaches_out(box_, triangle))
      found_.shared.push_back(
          {triangle.id, part, is_turned, buckets_.is_last_with(cell_, triangle)});
  }

  MortonKey cell_;
  Box box_;
  const TriangleBuckets& buckets_;
  double least_width_;
  TriangleSoup soup_;
  Mates mates_;  // but across edges that sheets end at, and in the end ribs
  bool has_borders_ = false;
  // Sharp edges within a group, those of them that are the cell's own, and ribs that are.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> noted_, parted_, ribs_;
  CellSheets found_;
};

// By what the buckets' triangles carry, the sheets; and what is known of these.
struct Numbered {
  std::vector<SheetId> sheets;
  std::vector<SheetPiece> pieces;  // if there are strips
  std::vector<SheetFacts> facts;
  std::uint64_t num_too_many = 0;
};

// Each group is one, whatever hangs together. Of several bodies there may be more than kMaxSheets,
// for a group is cut where bodies change.
Numbered sheets_of_groups(const CheckedSurface& surface) {
  const std::vector<std::string>& groups = surface.groups;
  std::vector<SheetPart> parts(groups.size());
  for (std::size_t i = 0; i < parts.size(); ++i) {
    parts[i].first_triangle = i;
    parts[i].group = static_cast<SheetId>(i + 1);
  }
  SheetPlan plan = plan_sheets(parts, {}, groups, {}, surface.bodies_of_group, parts.size());
  plan.of_part.insert(plan.of_part.begin(), 0);  // no triangle carries a 0
  return {std::move(plan.of_part), {}, std::move(plan.sheets), 0};
}

// The buckets' triangles then carry the numbers of their parts.
Numbered sheets_of_parts(CheckedSurface& surface, const SheetLaw& law, IngestWatch& watch,
                         Workers& workers, const IngestShare& share) {
  const SharpAngle angle(law.sharp_angle, surface.first_over_hole);
  const NeedleNormals needles(surface.sharp.needles);
  PartJoiner<SheetPart> joiner;
  SheetPieces pieces;
  std::vector<SheetId> group_of;
  std::size_t place = 0;
  for_each_in_order(
      workers, surface.buckets.all(),
      [&](const TriangleBucket& bucket) {
        return std::pair(surface.load(bucket), surface.given_in(bucket));
      },
      [&](const TriangleBucket& bucket, std::pair<std::vector<Triangle>, EdgeSet> loaded) {
        throw_if_stopped(watch.stop());
        return SheetsOfCell(std::move(loaded.first), bucket.cell, surface.buckets, angle, needles,
                            loaded.second, law.least_width, surface.has_contacts)
            .run();
      },
      [&](const TriangleBucket&, CellSheets& cell) {
        std::uint32_t first = 0;
        for (std::size_t i = 0; i < cell.parts.size(); ++i) {
          const std::uint32_t number = joiner.add_part(cell.parts[i]);
          if (i == 0) first = number;
          group_of.push_back(cell.parts[i].group);
        }
        for (const auto& [id, part, is_turned, is_last] : cell.shared)
          joiner.join(id, first + part, is_turned, is_last);
        for (const auto& [a, b, is_rib, length] : cell.borders)
          pieces.borders.push_back({first + a, first + b, is_rib, length});
        for (Triangle& triangle : cell.triangles) triangle.sheet += first;
        surface.buckets.replace(surface.spill, place++, cell.triangles);
        watch.advance(cell.triangles.size());
      });
  surface.has_copies = false;
  surface.labels.reset();
  std::vector<std::uint32_t> numbers;
  pieces.joined = joiner.take(numbers);
  for (SheetBorder& border : pieces.borders) {
    border.a = numbers[border.a];
    border.b = numbers[border.b];
  }
  pieces.places.resize(pieces.joined.components.size());
  std::iota(pieces.places.begin(), pieces.places.end(), std::uint32_t{0});
  share.join_sheets(pieces);

  SheetPlan plan = plan_sheets(pieces.joined.components, pieces.borders, surface.groups, law,
                               surface.bodies_of_group);
  if (plan.num_too_many > 0) {
    Numbered numbered = sheets_of_groups(surface);
    numbered.sheets = std::move(group_of);
    numbered.num_too_many = plan.num_too_many;
    return numbered;
  }
  Numbered numbered{{}, {}, std::move(plan.sheets), 0};
  for (const std::uint32_t number : numbers) {
    const std::uint32_t part = pieces.places[number];
    numbered.sheets.push_back(plan.of_part[part]);
    if (!plan.pieces.empty()) numbered.pieces.push_back(plan.pieces[part]);
  }
  return numbered;
}

void measure_sheets(const CheckedSurface& surface, IngestWatch& watch, const IngestShare& share,
                    std::vector<SheetFacts>& facts) {
  std::vector<SheetSums> sums(facts.size());
  for (const TriangleBucket& bucket : surface.buckets.all()) {
    const Box cell = surface.buckets.frame().box(bucket.cell);
    for (const Triangle& t : surface.load(bucket))
      if (owns_triangle(cell, t)) sums[t.sheet - 1].add(t);
    watch.advance(bucket.triangles.count);
  }
  share.join_sums(sums);
  for (std::size_t s = 0; s < facts.size(); ++s) sums[s].put_into(facts[s]);
}

// Those that have no triangles any more, for points of all have been joined.
void drop_empty(Numbered& numbered) {
  std::vector<SheetId> numbers(numbered.facts.size() + 1);
  SheetId num_kept = 0;
  for (std::size_t s = 0; s < numbered.facts.size(); ++s)
    if (numbered.facts[s].num_triangles > 0) numbers[s + 1] = ++num_kept;
  std::erase_if(numbered.facts, [](const SheetFacts& sheet) { return sheet.num_triangles == 0; });
  for (SheetId& sheet : numbered.sheets) sheet = numbers[sheet];
}

}  // namespace

void SheetSums::add(const Triangle& triangle) {
  const auto& [a, b, c] = triangle.corners;
  const double its_area = 0.5 * norm(cross(b - a, c - a));
  box = num_triangles == 0 ? triangle.box() : box.joined(triangle.box());
  first_triangle = std::min(first_triangle, triangle.id);
  ++num_triangles;
  area.add(its_area);
  for (int axis = 0; axis < 3; ++axis)
    moment[static_cast<std::size_t>(axis)].add(its_area * (a[axis] + b[axis] + c[axis]));
}

void SheetSums::add(const SheetSums& others) {
  if (others.num_triangles == 0) return;
  box = num_triangles == 0 ? others.box : box.joined(others.box);
  first_triangle = std::min(first_triangle, others.first_triangle);
  num_triangles += others.num_triangles;
  area.add(others.area);
  for (std::size_t axis = 0; axis < 3; ++axis) moment[axis].add(others.moment[axis]);
}

void SheetSums::put_into(SheetFacts& facts) const {
  facts.first_triangle = first_triangle;
  facts.num_triangles = num_triangles;
  facts.area = area.value();
  facts.box = box;
  for (int axis = 0; axis < 3 && facts.area > 0; ++axis)
    facts.centroid[axis] = moment[static_cast<std::size_t>(axis)].value() / (3 * facts.area);
}

SurfaceSheets number_sheets(CheckedSurface& surface, const SheetLaw& law, IngestWatch& watch,
                            Workers& workers, const IngestShare& share) {
  const bool has_names = surface.groups.size() > 1 || !surface.groups.front().empty();
  const bool is_angle_given = law.sharp_angle > 0;
  const bool has_given = surface.given.is_given();
  const std::uint64_t num_components = surface.facts.num_components;
  if (!has_names && !has_given &&
      !(is_angle_given && (surface.sharp.num_edges > 0 || num_components > 1)))
    return {};
  // Edges that are given are none, however many others there are.
  const bool is_edge_noise = is_angle_given && surface.sharp.num_edges > kMaxSharpEdges;
  const bool is_noise = (is_edge_noise && !has_given) || num_components > kMaxSheets;
  SheetLaw some = law;
  if (is_edge_noise) some.sharp_angle = 0;
  Numbered numbered = (is_angle_given || has_given) && !is_noise
                          ? sheets_of_parts(surface, some, watch, workers, share)
                          : sheets_of_groups(surface);
  if ((is_angle_given || has_given) && (is_noise || is_edge_noise || numbered.num_too_many > 0))
    surface.facts.notes.push_back(fmt::format(
        "took no sheets from sharp edges{}, for there would be more than {}",
        is_edge_noise && has_given && numbered.num_too_many == 0 ? " that are not given" : "",
        kMaxSheets));
  surface.sheets = numbered.sheets;
  measure_sheets(surface, watch, share, numbered.facts);
  drop_empty(numbered);
  surface.sheets = std::move(numbered.sheets);
  surface.pieces = std::move(numbered.pieces);
  for (SheetFacts& sheet : numbered.facts) {
    sheet.first_triangle = surface.number_in_file(sheet.first_triangle);
    if (const auto color = surface.colors.find(sheet.group); color != surface.colors.end())
      sheet.color = color->second;
  }
  if (numbered.facts.size() == 1 && numbered.facts.front().group.empty()) return {};
  return {std::move(numbered.facts)};
}

}  // namespace locvol
