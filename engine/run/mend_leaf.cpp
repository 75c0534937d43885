#include "engine/run/mend_leaf.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "engine/run/surroundings.h"
#include "engine/run/unresolved_sites.h"
#include "engine/shared/leaf_facets.h"
#include "octree/sort_and_unite.h"
#include "refine/delaunay.h"
#include "refine/leaf.h"

namespace locvol {
namespace {

constexpr std::uint64_t kBytesPerCell = 120;  // with lists of the cells at each vertex
constexpr std::uint64_t kBytesPerTriangle = 2 * sizeof(Triangle) + 60;  // with a grid of them
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr Point kUnknownPlace{kInfinity, kInfinity, kInfinity};
constexpr std::uint32_t kNotOwn = std::numeric_limits<std::uint32_t>::max();

// Those that have a vertex in a cell at the leaf's points, and their cells in the mesh, are as
// near: circumradii are below half of the reach (in paper mode there is no such bound).
double reach_of_cells(const RunView& state, MortonKey leaf) {
  return state.is_cover() ? state.reach_of(leaf, kReach) : std::numeric_limits<double>::infinity();
}
std::vector<MortonKey> leaves_around(const RunView& state, MortonKey leaf, double reach) {
  return state.octree().leaves_within(state.frame(), state.box(leaf), reach);
}

std::vector<std::uint64_t> ids_of(const LeafPoints& points) {
  std::vector<std::uint64_t> ids;
  ids.reserve(points.points.size());
  for (const MeshPoint& p : points.points) ids.push_back(p.id);
  return ids;
}

// Gathers the cells at own points.
class MendLoader {
 public:
  MendLoader(const RunView& state, MortonKey leaf)
      : state_(state),
        reach_(reach_of_cells(state, leaf)),
        own_(ids_of(state.leaves().points(leaf))) {
    for (const MortonKey other : leaves_around(state, leaf, reach_))
      if (state.leaves().info(other).num_cells > 0) take_from(other);
    sort_and_unite(others_);
    is_on_surface_.resize(own_.size() + others_.size());
    positions_.resize(is_on_surface_.size(), kUnknownPlace);
    for (const MortonKey other : leaves_around(state, leaf, reach_))
      for (const MeshPoint& p : state.leaves().points(other).points)
        if (const auto v = index_of(p.id)) {
          is_on_surface_[*v] = is_on_surface(p.kind);
          positions_[*v] = p.position;
        }
  }

  Loaded<LoadedMend> loaded() {
    Loaded<LoadedMend> loaded{.bytes = kBytesPerCell * cells_.size(), .input = {}};
    LoadedMend& result = loaded.input;
    result.reach = reach_;
    result.input.num_own = static_cast<std::uint32_t>(own_.size());
    result.input.is_on_surface = std::move(is_on_surface_);
    result.input.cells.reserve(cells_.size());
    result.input.bodies = std::move(bodies_);
    for (const auto& cell : cells_) {
      auto& corners = result.input.cells.emplace_back();
      for (std::size_t i = 0; i < 4; ++i) corners[i] = index_of(cell[i]).value();
    }
    result.ids = std::move(own_);
    result.ids.insert(result.ids.end(), others_.begin(), others_.end());
    result.origins = std::move(origins_);
    result.positions = std::move(positions_);
    return loaded;
  }

 private:
  void take_from(MortonKey leaf) {
    const LeafCells held = state_.leaves().cells(leaf);
    std::vector<bool> is_own(held.vertices.size());
    for (std::size_t i = 0; i < is_own.size(); ++i)
      is_own[i] = std::ranges::binary_search(own_, held.vertices[i]);
    LoadedMend::Origin origin{leaf, static_cast<std::uint32_t>(cells_.size()), {}};
    for (std::uint32_t place = 0; place < held.cells.size(); ++place) {
      const auto& cell = held.cells[place];
      if (std::ranges::none_of(cell, [&](std::uint32_t v) { return is_own[v]; })) continue;
      origin.places.push_back(place);
      const BodyId body = held.body_of(place);
      if (body != kOnlyBody && bodies_.empty()) bodies_.resize(cells_.size(), kOnlyBody);
      if (body != kOnlyBody || !bodies_.empty()) bodies_.push_back(body);
      auto& ids = cells_.emplace_back();
      for (std::size_t i = 0; i < 4; ++i) {
        ids[i] = held.vertices[cell[i]];
        if (!is_own[cell[i]]) others_.push_back(ids[i]);
      }
    }
    if (!origin.places.empty()) origins_.push_back(std::move(origin));
  }

  std::optional<std::uint32_t> index_of(std::uint64_t id) const {
    if (const auto own = std::ranges::lower_bound(own_, id); own != own_.end() && *own == id)
      return static_cast<std::uint32_t>(own - own_.begin());
    const auto other = std::ranges::lower_bound(others_, id);
    if (other == others_.end() || *other != id) return std::nullopt;
    return static_cast<std::uint32_t>(own_.size() + std::size_t(other - others_.begin()));
  }

  const RunView& state_;
  double reach_;
  std::vector<std::uint64_t> own_, others_;
  std::vector<bool> is_on_surface_;
  std::vector<Point> positions_;
  std::vector<std::array<std::uint64_t, 4>> cells_;
  std::vector<BodyId> bodies_;  // of these; empty: one has all
  std::vector<LoadedMend::Origin> origins_;
};

// Without the cells at the places, and the vertices that only they had.
LeafCells without(const LeafCells& held, const std::vector<std::uint32_t>& places) {
  LeafCells left;
  std::vector<std::uint32_t> new_index(held.vertices.size(), kNotOwn);
  std::vector<bool> is_used(held.vertices.size());
  for (std::uint32_t place = 0; place < held.cells.size(); ++place) {
    if (std::ranges::binary_search(places, place)) continue;
    left.cells.push_back(held.cells[place]);
    if (!held.bodies.empty()) left.bodies.push_back(held.bodies[place]);
    for (const std::uint32_t v : held.cells[place]) is_used[v] = true;
  }
  for (std::size_t v = 0; v < is_used.size(); ++v) {
    if (!is_used[v]) continue;
    new_index[v] = static_cast<std::uint32_t>(left.vertices.size());
    left.vertices.push_back(held.vertices[v]);
  }
  for (auto& cell : left.cells)
    for (std::uint32_t& v : cell) v = new_index[v];
  return left;
}

// The facets that the leaf lists, of its cells as they were loaded: those that one cell has, or two
// of different bodies. A core point has all of its cells in the mesh, and in one body.
LeafFacets boundary_facets(const LoadedMend& loaded) {
  const auto place_of = [&](std::uint64_t id) {
    const auto end_own = loaded.ids.begin() + loaded.input.num_own;
    const auto own = std::lower_bound(loaded.ids.begin(), end_own, id);
    const auto found =
        own != end_own && *own == id ? own : std::lower_bound(end_own, loaded.ids.end(), id);
    return loaded.positions[static_cast<std::size_t>(found - loaded.ids.begin())];
  };
  const auto& cells = loaded.input.cells;
  std::vector<ListedFacet> facets;
  for (std::uint32_t c = 0; c < cells.size(); ++c)
    for (std::uint32_t across = 0; across < 4; ++across) {
      const ListedFacet facet = listed_facet(cells[c], c, across);
      const auto smallest = std::ranges::min(facet.vertices, {},
                                             [&](std::uint32_t v) { return loaded.positions[v]; });
      const bool is_core = std::ranges::any_of(
          facet.vertices, [&](std::uint32_t v) { return loaded.positions[v] == kUnknownPlace; });
      if (smallest < loaded.input.num_own && !is_core) facets.push_back(facet);
    }
  const auto body_of = [&](const ListedFacet& facet) {
    const auto& bodies = loaded.input.bodies;
    return bodies.empty() ? kOnlyBody : bodies[facet.side.cell];
  };
  std::vector<std::array<std::uint64_t, 3>> names;
  std::vector<FacetLabels> labels;
  for_each_facet(facets, loaded.ids.size(), [&](std::span<const ListedFacet> same) {
    const ListedFacet &one = same.front(), &other = same.back();
    const BodyId of_one = body_of(one), of_other = same.size() == 1 ? kNoBody : body_of(other);
    if (of_one == of_other) return;
    const auto& [cell, across] = of_one > of_other ? one.side : other.side;
    labels.push_back({.behind = std::max(of_one, of_other), .before = std::min(of_one, of_other)});
    auto& name = names.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) name[k] = loaded.ids[cells[cell][kFacets[across][k]]];
  });
  const LeafDomain domain(loaded.domain);
  LeafFacets result;
  result.vertices = distinct_vertices(names);
  for (std::size_t n = 0; n < names.size(); ++n) {
    const auto& name = names[n];
    MeshFacet& facet = result.facets.emplace_back();
    facet.labels = labels[n];
    std::ranges::transform(name, facet.vertices.begin(), [&](std::uint64_t id) {
      return static_cast<std::uint32_t>(std::ranges::lower_bound(result.vertices, id) -
                                        result.vertices.begin());
    });
    facet.vertices = smallest_first(facet.vertices);
    facet.labels.sheet =
        domain.sheet_of_facet({place_of(name[0]), place_of(name[1]), place_of(name[2])},
                              facet.labels.behind, facet.labels.before);
  }
  std::ranges::sort(result.facets);
  return result;
}

// What the leaf's facets are near to.
DomainPiece domain_around(const RunView& state, MortonKey leaf) {
  const Surroundings around(state);
  DomainPiece piece = state.is_cover() ? around.domain(leaf, around.surface_reach(leaf), {})
                                       : around.whole_domain({});
  std::vector<Triangle>& triangles = piece.triangles;
  const bool has_several = std::ranges::adjacent_find(triangles, std::ranges::not_equal_to(),
                                                      &Triangle::sheet) != triangles.end();
  if (!has_several && !triangles.empty()) triangles.resize(1);
  return piece;
}

// Without the facets of cells that hung on nothing.
void forget_facets_at(RunState& state, MortonKey leaf, const std::vector<std::uint64_t>& hanging) {
  LeafFacets held = state.leaves().facets(leaf);
  FacetList list{std::move(held.vertices), std::move(held.facets)};
  const auto num_before = list.facets.size();
  std::erase_if(list.facets, [&](const MeshFacet& facet) {
    return std::ranges::binary_search(hanging, list.vertices[facet.vertices[0]]);
  });
  if (list.facets.size() == num_before) return;
  drop_unused_vertices(list);
  state.records().put_facets(leaf, {std::move(list.vertices), std::move(list.facets)});
}

}  // namespace

Loaded<LoadedMend> load_mend(const RunView& state, MortonKey leaf) {
  Loaded<LoadedMend> loaded = MendLoader(state, leaf).loaded();
  loaded.input.hanging = hanging_cells(state, leaf);
  for (const auto& [home, places] : loaded.input.hanging) {
    const LeafCells held = state.leaves().cells(home);
    for (const std::uint32_t place : places)
      for (const std::uint32_t v : held.cells[place])
        loaded.input.hanging_ids.push_back(held.vertices[v]);
  }
  sort_and_unite(loaded.input.hanging_ids);
  loaded.input.domain = domain_around(state, leaf);
  loaded.bytes += kBytesPerTriangle * loaded.input.domain.triangles.size();
  return loaded;
}

MendedCells mended_cells(const LoadedMend& loaded) {
  MendedCells result;
  result.reach = loaded.reach;
  const std::vector<std::uint32_t> left_out = mend_boundary(loaded.input);
  std::map<MortonKey, std::vector<std::uint32_t>> places;
  for (const auto& [leaf, hanging] : loaded.hanging) places[leaf] = hanging;
  auto origin = loaded.origins.begin();
  for (const std::uint32_t c : left_out) {
    while (c - origin->first >= origin->places.size()) ++origin;
    places[origin->leaf].push_back(origin->places[c - origin->first]);
    for (const std::uint32_t v : loaded.input.cells[c])
      if (v >= loaded.input.num_own) result.others.push_back(loaded.ids[v]);
  }
  for (auto& [leaf, left] : places) {
    sort_and_unite(left);
    result.left_out.push_back({leaf, std::move(left)});
  }
  sort_and_unite(result.others);
  result.hanging = loaded.hanging_ids;
  if (result.left_out.empty()) result.facets = boundary_facets(loaded);
  return result;
}

void apply_mend(RunState& state, MortonKey leaf, const MendedCells& cells) {
  state.queue().dequeue(leaf);
  if (cells.left_out.empty()) return state.records().put_facets(leaf, cells.facets);
  for (const auto& [home, places] : cells.left_out)
    state.records().leave_out_cells(home, without(state.leaves().cells(home), places));
  state.queue().enqueue(leaf);  // what hangs on nothing now is seen when the leaf is loaded
  for (const MortonKey other : leaves_around(state, leaf, cells.reach)) {
    if (!cells.hanging.empty() && state.is_own(other))
      forget_facets_at(state, other, cells.hanging);
    if (other == leaf || state.leaves().info(other).num_points == 0) continue;
    const auto& points = state.leaves().points(other).points;
    if (std::ranges::any_of(cells.others, [&](std::uint64_t id) {
          return std::ranges::binary_search(points, id, {}, &MeshPoint::id);
        }))
      state.queue().enqueue(other);
  }
}

void enqueue_for_mending(RunState& state) {
  for (const MortonKey leaf : state.octree().leaves()) {
    if (state.leaves().info(leaf).num_unresolved > 0) state.queue().enqueue(leaf);
    state.leaves().trim();
  }
}

std::vector<MortonKey> merge_sites(RunState& state) {
  std::vector<MortonKey> changed;
  const double size = state.size();
  for (const MortonKey leaf : state.octree().leaves()) {
    state.leaves().trim();
    if (state.leaves().info(leaf).num_unresolved == 0 || !state.is_own(leaf)) continue;
    // A visit's sites lie within its reach of its leaf.
    const double distance = state.is_cover() ? 2 * state.reach_of(leaf, kReach) + size
                                             : std::numeric_limits<double>::infinity();
    std::vector<UnresolvedSite> kept;
    for (const MortonKey other :
         state.octree().leaves_within(state.frame(), state.box(leaf), distance)) {
      if (other >= leaf) break;
      if (state.leaves().info(other).num_unresolved == 0) continue;
      const auto sites = state.leaves().unresolved(other).sites;
      kept.insert(kept.end(), sites.begin(), sites.end());
    }
    LeafUnresolved own = state.leaves().unresolved(leaf);
    const auto num_before = own.sites.size();
    own.sites = thinned(own.sites, kept, size);
    if (own.sites.size() == num_before) continue;
    state.records().put_unresolved(leaf, std::move(own));
    changed.push_back(leaf);
  }
  return changed;
}

}  // namespace locvol
