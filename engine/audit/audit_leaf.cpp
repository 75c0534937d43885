#include "engine/audit/audit_leaf.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "engine/shared/lattice_of_run.h"
#include "engine/shared/leaf_name.h"
#include "octree/sort_and_unite.h"
#include "refine/predicates.h"

namespace locvol {
namespace {

constexpr std::size_t kBorderBytes = std::size_t{64} << 20;
constexpr std::uint64_t kDescribedPerKind = 3;

bool is_finite(const Point& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

bool owns(const Box& box, const Point& p) {  // half-open
  return box.min.x <= p.x && p.x < box.max.x && box.min.y <= p.y && p.y < box.max.y &&
         box.min.z <= p.z && p.z < box.max.z;
}

// Appends the cells that have an own point to the star, turned to positive orientation.
// `bodies`: of the cells; none: the only one
void append_star(std::span<const std::array<std::uint32_t, 4>> cells,
                 std::span<const BodyId> bodies, std::span<const LocalIndex> table,
                 AuditLeaf& here) {
  for (std::size_t n = 0; n < cells.size(); ++n) {
    const auto& cell = cells[n];
    std::array<LocalIndex, 4> v = {table[cell[0]], table[cell[1]], table[cell[2]], table[cell[3]]};
    const auto is_known = [](LocalIndex i) { return i != kUnknownPoint; };
    if (!std::ranges::all_of(v, is_known)) continue;
    if (std::ranges::none_of(v, [&](LocalIndex i) { return here.is_own(i); })) continue;
    const LocalPoints& p = here.points;
    const int sign =
        exact_orientation(p.position(v[0]), p.position(v[1]), p.position(v[2]), p.position(v[3]));
    if (sign == 0) continue;
    if (sign < 0) std::swap(v[2], v[3]);
    here.star.push_back({v, bodies.empty() ? kOnlyBody : bodies[n]});
  }
}

// Appends the facets that have an own point. As they are listed, they turn counterclockwise from
// outside.
void append_facets(const LeafFacets& listed, AuditLeaf& here) {
  const std::vector<LocalIndex> table = here.points.find(listed.vertices);
  for (const auto& [vertices, labels] : listed.facets) {
    std::array<LocalIndex, 3> v = {table[vertices[0]], table[vertices[1]], table[vertices[2]]};
    if (std::ranges::find(v, kUnknownPoint) != v.end()) continue;
    if (std::ranges::none_of(v, [&](LocalIndex i) { return here.is_own(i); })) continue;
    std::ranges::rotate(v, std::ranges::min_element(v));
    const bool is_turned = v[1] > v[2];
    if (is_turned) std::swap(v[1], v[2]);
    here.star_facets.push_back({v, is_turned ? 1 : -1, labels.behind, labels.before});
  }
}

void report_misplaced(const LeafPoints& points, const Box& box, MortonKey key,
                      AuditFindings& findings) {
  for (const MeshPoint& point : points.points) {
    if (owns(box, point.position)) continue;
    findings.add(&AuditReport::num_misplaced_points,
                 "point " + std::to_string(point.id) + " lies outside its leaf's box", key,
                 point.position);
  }
}

// Of two leaves with the same point, the first one reports it.
void report_repeated(const AuditLeaf& here, AuditFindings& findings) {
  for (const auto& [i, j] : here.points.repetitions()) {
    if (std::min(here.points[i].leaf, here.points[j].leaf) != here.leaf) continue;
    findings.add(&AuditReport::num_repeated_points,
                 "points " + std::to_string(here.points[i].id) + " and " +
                     std::to_string(here.points[j].id) + " have the same id or position",
                 here.key, here.points.position(i));
  }
}

}  // namespace

void AuditFindings::add(std::uint64_t AuditReport::*count, std::string_view what, MortonKey leaf,
                        const Point& place) {
  if (++(report_->*count) > kDescribedPerKind) return;
  char where[128];
  std::snprintf(where, sizeof where, ", at (%.17g, %.17g, %.17g): ", place.x, place.y, place.z);
  report_->violations.push_back(leaf_name(leaf).append(where).append(what));
}

void AuditFindings::add_unless_open(std::uint64_t AuditReport::*count, std::string_view what,
                                    MortonKey leaf, const Point& place) {
  const double squared = site_distance_ * site_distance_;
  if (std::ranges::any_of(
          sites_, [&](const Point& site) { return squared_distance(site, place) <= squared; }))
    ++report_->num_open;
  else
    add(count, what, leaf, place);
}

void AuditFindings::set_sites(std::vector<Point> sites, double distance) {
  sites_ = std::move(sites);
  site_distance_ = distance;
}

void AuditFindings::add_fault(const std::string& what) {
  if (++report_->num_run_faults <= kDescribedPerKind) report_->violations.push_back(what);
}

// The ranges of descendants touch without a gap; ranges end on keys of the deepest level, whose
// lowest bit is their mark, so that the next such key is two further on.
bool AuditLeaves::tile_the_root() const {
  if (keys_.empty() || !std::ranges::all_of(keys_, &MortonKey::is_valid)) return false;
  for (std::size_t i = 1; i < keys_.size(); ++i) {
    if (keys_[i].range_min().bits() != keys_[i - 1].range_max().bits() + 2) return false;
  }
  return keys_.front().range_min() == MortonKey::root().range_min() &&
         keys_.back().range_max() == MortonKey::root().range_max();
}

std::vector<std::size_t> AuditLeaves::within(const Box& box, double distance) const {
  std::vector<std::size_t> found;
  collect(MortonKey::root(), keys_, box, distance * distance, found);
  return found;
}

void AuditLeaves::collect(MortonKey node, std::span<const MortonKey> below, const Box& box,
                          double squared, std::vector<std::size_t>& found) const {
  if (frame_.box(node).squared_distance(box) > squared) return;
  if (below.front() == node) {
    found.push_back(static_cast<std::size_t>(below.data() - keys_.data()));
    return;
  }
  for (int octant = 0; octant < 8; ++octant) {
    const MortonKey child = node.child(octant);
    const auto end = std::ranges::upper_bound(below, child.range_max());
    const auto count = static_cast<std::size_t>(end - below.begin());
    collect(child, below.first(count), box, squared, found);
    below = below.subspan(count);
  }
}

LocalPoints::LocalPoints(std::vector<LocalPoint> points) : points_(std::move(points)) {
  std::ranges::sort(points_, [](const LocalPoint& a, const LocalPoint& b) {
    if (a.position != b.position) return a.position < b.position;
    return std::pair(a.id, a.leaf) < std::pair(b.id, b.leaf);
  });
  by_id_.reserve(points_.size());
  for (std::size_t i = 0; i < points_.size(); ++i) {
    by_id_.push_back({points_[i].id, static_cast<LocalIndex>(i)});
  }
  std::ranges::sort(by_id_);
}

std::vector<LocalIndex> LocalPoints::find(std::span<const std::uint64_t> ids) const {
  std::vector<LocalIndex> found(ids.size(), kUnknownPoint);
  auto place = by_id_.begin();
  for (std::size_t i = 0; i < ids.size(); ++i) {
    // The ids of a record ascend, so the search goes on from the last place; if they do not, anew.
    const bool is_ascending = i > 0 && ids[i - 1] <= ids[i];
    place = std::ranges::lower_bound(is_ascending ? place : by_id_.begin(), by_id_.end(), ids[i],
                                     {}, &Name::id);
    if (place != by_id_.end() && place->id == ids[i]) found[i] = place->index;
  }
  return found;
}

LocalIndex LocalPoints::at(const Point& position) const {
  const auto place = std::ranges::lower_bound(points_, position, {}, &LocalPoint::position);
  if (place == points_.end() || place->position != position) return kUnknownPoint;
  return static_cast<LocalIndex>(place - points_.begin());
}

std::vector<std::array<LocalIndex, 2>> LocalPoints::repetitions() const {
  std::vector<std::array<LocalIndex, 2>> pairs;
  for (std::size_t i = 1; i < points_.size(); ++i) {
    if (by_id_[i - 1].id == by_id_[i].id) pairs.push_back({by_id_[i - 1].index, by_id_[i].index});
    if (points_[i - 1].position == points_[i].position && points_[i - 1].id != points_[i].id) {
      pairs.push_back({static_cast<LocalIndex>(i - 1), static_cast<LocalIndex>(i)});
    }
  }
  return pairs;
}

AuditLoader::AuditLoader(const Store& store, const AuditRecords& records, const AuditLeaves& leaves,
                         const RunRecord& run)
    : records_(&records),
      leaves_(&leaves),
      lattice_(lattice_of(run)),
      law_(run.parameters.sizes()),
      frame_(run.frame),
      scale_(records.own(), run),
      has_creases_(keeps_creases(run)),
      is_surface_only_(run.parameters.is_surface_only),
      pages_(store),
      pages_beside_(records.store_beside() != nullptr ? *records.store_beside() : store),
      borders_(kBorderBytes, [this](std::size_t leaf) { return load_border(leaf); }) {}

std::optional<AuditLeaf> AuditLoader::load(std::size_t leaf, AuditFindings& findings) {
  AuditLeaf here;
  here.leaf = static_cast<std::uint32_t>(leaf);
  here.key = leaves_->key(leaf);
  const Reader& reader = records_->own();
  here.cells = reader.cells(here.key);
  here.facets = reader.facets(here.key);
  const LeafPoints own = reader.points(here.key);
  if (has_creases_) {
    LeafSurface surface = reader.surface(here.key);
    here.creases = std::move(surface.creases);
    here.corners = std::move(surface.corners);
  }
  if (own.points.empty() && own.core.is_empty() && here.cells.cells.empty() &&
      here.facets.facets.empty() && here.creases.empty() && here.corners.empty())
    return std::nullopt;
  const Box box = leaves_->box(leaf);
  report_misplaced(own, box, here.key, findings);

  std::vector<LocalPoint> points;
  try {
    points = core_points(leaf, own.core);
  } catch (const std::invalid_argument& e) {
    findings.add(&AuditReport::num_misplaced_points, e.what(), here.key, box.center());
  }
  for (const MeshPoint& p : own.points) {
    if (is_finite(p.position)) points.push_back({p.position, p.id, here.leaf, false, p.kind});
  }
  const double reach = here.reach = this->reach(leaf);
  std::vector<std::size_t> neighbors = leaves_->within(box, reach);
  std::erase(neighbors, leaf);
  std::vector<std::shared_ptr<const Border>> borders;
  for (const std::size_t neighbor : neighbors) {
    borders.push_back(borders_.get(neighbor));
    for (const LocalPoint& p : borders.back()->points) {
      if (box.squared_distance(p.position) <= reach * reach) points.push_back(p);
    }
    const auto& creases = borders.back()->creases;
    here.creases.insert(here.creases.end(), creases.begin(), creases.end());
  }
  sort_and_unite(here.creases, &CreaseEdge::ends);
  here.sizes = {law_, frame_};
  if (!law_.is_uniform()) here.sizes.add(reader.sizes(here.key).cubes);
  for (const auto& border : borders) here.sizes.add(border->cubes);
  here.points = LocalPoints(std::move(points));
  report_repeated(here, findings);

  here.cell_vertex = here.points.find(here.cells.vertices);
  append_star(here.cells.cells, here.cells.bodies, here.cell_vertex, here);
  for (const auto& border : borders) {
    append_star(border->cells, border->bodies, here.points.find(border->vertices), here);
  }
  add_core_cells(here);
  here.is_surface_only = is_surface_only_;
  if (!is_surface_only_) return here;
  append_facets(here.facets, here);
  for (const auto& border : borders) append_facets(border->facets, here);
  return here;
}

std::vector<LocalPoint> AuditLoader::core_points(std::size_t leaf, const LatticeCore& core) const {
  std::vector<LocalPoint> points;
  const auto number = static_cast<std::uint32_t>(leaf);
  const SiteBox sites = lattice_.sites_in(leaves_->box(leaf));
  check_core(core, sites);
  for_each_row(core, sites, [&](const LatticeRow& row, std::uint64_t) {
    LatticeSite site = row.first;
    for (std::uint32_t n = 0; n < row.count; ++n, site.k += 2)
      points.push_back({.position = lattice_.position(site),
                        .id = site_id(site),
                        .leaf = number,
                        .is_core = true,
                        .body = row.body});
  });
  return points;
}

// The cells of the lattice are the edges along an axis (of length a), each with two neighboring
// ones of the four sites around its middle. A cell has two such edges; it is found from the one
// with its smallest site.
void AuditLoader::add_core_cells(AuditLeaf& here) const {
  std::unordered_map<std::uint64_t, LocalIndex> core;  // asked, never listed
  for (LocalIndex i = 0; i < here.points.size(); ++i)
    if (here.points[i].is_core) core.emplace(here.points[i].id, i);
  if (core.empty()) return;
  const auto find = [&](const LatticeSite& site) {
    const auto found = core.find(site_id(site));
    return found == core.end() ? kUnknownPoint : found->second;
  };
  const auto first = static_cast<std::uint32_t>(here.cells.vertices.size());
  for (LocalIndex i = 0; i < here.points.size(); ++i) {
    here.cells.vertices.push_back(here.points[i].id);
    here.cell_vertex.push_back(i);
  }
  for (LocalIndex i = 0; i < here.points.size(); ++i) {
    if (!here.points[i].is_core) continue;
    const LatticeSite site = site_of(here.points[i].id);
    const auto step = [&](int axis, std::int32_t along, std::int32_t u, std::int32_t v) {
      return site + (axis == 0   ? LatticeSite{along, u, v}
                     : axis == 1 ? LatticeSite{v, along, u}
                                 : LatticeSite{u, v, along});
    };
    constexpr std::array<std::array<std::int32_t, 2>, 4> kAround{
        {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}}};
    for (int axis = 0; axis < 3; ++axis)
      for (std::size_t n = 0; n < 4; ++n) {
        const auto [u, v] = kAround[n];
        const auto [w, x] = kAround[(n + 1) % 4];
        const LatticeSite a = step(axis, 1, u, v), b = step(axis, 1, w, x);
        if (a < site || b < site) continue;
        const std::array corners{i, find(step(axis, 2, 0, 0)), find(a), find(b)};
        if (std::ranges::find(corners, kUnknownPoint) != corners.end()) continue;
        const std::array cell{first + corners[0], first + corners[1], first + corners[2],
                              first + corners[3]};
        const BodyId body = here.points[i].body;
        if (here.is_own(i)) {
          // Listed ones have bodies if one of them has another than the only one.
          if (body != kOnlyBody && here.cells.bodies.empty())
            here.cells.bodies.resize(here.cells.cells.size(), kOnlyBody);
          if (body != kOnlyBody || !here.cells.bodies.empty()) here.cells.bodies.push_back(body);
          here.cells.cells.push_back(cell);
        }
        append_star({&cell, 1}, {&body, 1}, here.cell_vertex, here);
      }
  }
}

AuditLoader::Border AuditLoader::load_border(std::size_t leaf) {
  const MortonKey key = leaves_->key(leaf);
  const Reader& reader = records_->of(key);
  const LeafPoints points = reader.points(key);
  LeafCells cells = reader.cells(key);
  PageRelease& pages = records_->is_own(key) ? pages_ : pages_beside_;
  pages.count(points.points.size() * sizeof(MeshPoint) + cells.cells.size() * 16);

  Border border;
  // May be inside out: contains nothing. Where sizes vary, others may reach farther in.
  const Box box = leaves_->box(leaf);
  const Box inner = law_.is_uniform() ? box.expanded(-reach(leaf)) : Box{box.max, box.min};
  std::vector<std::uint64_t> own;
  try {
    border.points = core_points(leaf, points.core);
  } catch (const std::invalid_argument&) {  // reported by its own leaf
  }
  for (const LocalPoint& p : border.points) own.push_back(p.id);
  std::erase_if(border.points, [&](const LocalPoint& p) { return inner.contains(p.position); });
  for (const MeshPoint& p : points.points) {
    own.push_back(p.id);
    if (is_finite(p.position) && !inner.contains(p.position)) {
      border.points.push_back({p.position, p.id, static_cast<std::uint32_t>(leaf), false, p.kind});
    }
  }
  std::ranges::sort(own);
  std::vector<bool> is_foreign;
  for (const std::uint64_t id : cells.vertices) {
    is_foreign.push_back(!std::ranges::binary_search(own, id));
  }
  for (std::size_t i = 0; i < cells.cells.size(); ++i) {
    const auto& cell = cells.cells[i];
    if (std::ranges::any_of(cell, [&](std::uint32_t v) { return is_foreign[v]; })) {
      border.cells.push_back(cell);
      if (!cells.bodies.empty()) border.bodies.push_back(cells.bodies[i]);
    }
  }
  if (is_surface_only_) {
    border.facets = reader.facets(key);
    is_foreign.clear();
    for (const std::uint64_t id : border.facets.vertices)
      is_foreign.push_back(!std::ranges::binary_search(own, id));
    std::erase_if(border.facets.facets, [&](const MeshFacet& facet) {
      return std::ranges::none_of(facet.vertices, [&](std::uint32_t v) { return is_foreign[v]; });
    });
  }
  border.vertices = std::move(cells.vertices);
  if (!law_.is_uniform()) border.cubes = reader.sizes(key).cubes;
  if (has_creases_) border.creases = reader.surface(key).creases;
  return border;
}

}  // namespace locvol
