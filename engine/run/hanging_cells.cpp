#include "engine/run/hanging_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "octree/sort_and_unite.h"
#include "refine/domain/surface_part.h"

namespace locvol {
namespace {

using Id = std::uint64_t;
using Ids = std::vector<Id>;  // ascending
using FacetIds = std::array<Id, 3>;

class HangingCells {
 public:
  HangingCells(const RunView& state, MortonKey leaf) : state_(state) {
    const bool is_cover = state.is_cover();
    // All cells at a vertex that is as far from the leaf are stored within the reach.
    most_ = is_cover ? state.reach_of(leaf, kReach) - state.reach_of(leaf, 2) : 0.25 * state.size();
    const double reach =
        is_cover ? state.reach_of(leaf, kReach) : std::numeric_limits<double>::infinity();
    around_ = state.octree().leaves_within(state.frame(), state.box(leaf), reach);
    for (const MortonKey other : around_)
      for (const MeshPoint& p : state.leaves().points(other).points) {
        if (is_on_surface(p.kind)) places_.emplace_back(p.id, p.position);
        if (is_on_surface(p.kind) && other == leaf) scope_.push_back(p.id);
      }
    std::ranges::sort(places_, {}, &Place::first);
    sort_and_unite(scope_);
  }

  std::vector<CellPlaces> run() {
    while (true) {
      gather();
      join();
      const Ids more = beyond_scope();
      if (more.empty()) break;
      scope_.insert(scope_.end(), more.begin(), more.end());
      sort_and_unite(scope_);
    }
    std::map<MortonKey, std::vector<std::uint32_t>> found;
    for (std::uint32_t c = 0; c < cells_.size(); ++c)
      if (hangs(root(c))) found[cells_[c].leaf].push_back(cells_[c].place);
    std::vector<CellPlaces> result;
    for (auto& [leaf, places] : found) result.push_back({leaf, std::move(places)});
    return result;
  }

 private:
  using Place = std::pair<Id, Point>;
  struct Cell {  // all of its vertices are on the surface
    MortonKey leaf;
    std::uint32_t place = 0;
    std::array<Id, 4> ids{};
  };
  struct Part {
    Ids vertices;
    bool is_alone = true;  // it is small, and no other cell has a vertex of it
    std::optional<bool> hangs;
  };

  const Point* place_of(Id id) const {
    const auto at = std::ranges::lower_bound(places_, id, {}, &Place::first);
    return at != places_.end() && at->first == id ? &at->second : nullptr;
  }

  // The cells with a vertex in scope; of those with a volume point, the other vertices.
  void gather() {
    cells_.clear();
    held_.clear();
    std::vector<bool> is_on_surface, is_in_scope;
    for (const MortonKey leaf : around_) {
      if (state_.leaves().info(leaf).num_cells == 0) continue;
      const LeafCells held = state_.leaves().cells(leaf);
      is_on_surface.clear();
      is_in_scope.clear();
      for (const Id id : held.vertices) {
        is_on_surface.push_back(place_of(id) != nullptr);
        is_in_scope.push_back(std::ranges::binary_search(scope_, id));
      }
      for (std::uint32_t place = 0; place < held.cells.size(); ++place) {
        const auto& cell = held.cells[place];
        if (std::ranges::none_of(cell, [&](std::uint32_t v) { return is_in_scope[v]; })) continue;
        const auto num = std::ranges::count_if(cell, [&](auto v) { return is_on_surface[v]; });
        if (num == 4) {
          Cell& one = cells_.emplace_back(Cell{leaf, place, {}});
          for (std::size_t i = 0; i < 4; ++i) one.ids[i] = held.vertices[cell[i]];
          std::ranges::sort(one.ids);
        } else {
          for (const std::uint32_t v : cell)
            if (is_on_surface[v]) held_.push_back(held.vertices[v]);
        }
      }
    }
    sort_and_unite(held_);
  }

  // Cells that share facets are of one part.
  void join() {
    parents_.resize(cells_.size());
    std::iota(parents_.begin(), parents_.end(), 0U);
    std::vector<std::pair<FacetIds, std::uint32_t>> facets;
    for (std::uint32_t c = 0; c < cells_.size(); ++c) {
      const auto& [i, j, k, l] = cells_[c].ids;
      for (const FacetIds& facet : {FacetIds{i, j, k}, {i, j, l}, {i, k, l}, {j, k, l}})
        facets.emplace_back(facet, c);
    }
    std::ranges::sort(facets);
    for (std::size_t n = 1; n < facets.size(); ++n)
      if (facets[n].first == facets[n - 1].first)
        parents_[root(facets[n].second)] = root(facets[n - 1].second);
    parts_.clear();
    for (std::uint32_t c = 0; c < cells_.size(); ++c) {
      Ids& vertices = parts_[root(c)].vertices;
      vertices.insert(vertices.end(), cells_[c].ids.begin(), cells_[c].ids.end());
    }
    std::vector<std::pair<Id, std::uint32_t>> vertices;
    for (std::uint32_t c = 0; c < cells_.size(); ++c)
      for (const Id id : cells_[c].ids) vertices.emplace_back(id, root(c));
    sort_and_unite(vertices);
    for (std::size_t n = 0; n < vertices.size(); ++n) {
      const auto& [id, first] = vertices[n];
      const bool is_again = n > 0 && vertices[n - 1].first == id;
      if (is_again) parts_[vertices[n - 1].second].is_alone = false;
      if (is_again || std::ranges::binary_search(held_, id)) parts_[first].is_alone = false;
    }
    for (auto& [first, part] : parts_) {
      sort_and_unite(part.vertices);
      part.is_alone = part.is_alone && is_small(part.vertices);
    }
  }

  bool is_small(const Ids& vertices) const {
    for (std::size_t n = 0; n < vertices.size(); ++n)
      for (std::size_t k = 0; k < n; ++k)
        if (squared_distance(*place_of(vertices[k]), *place_of(vertices[n])) > most_ * most_)
          return false;
    return true;
  }

  // Vertices of small parts that may have more cells.
  Ids beyond_scope() const {
    Ids more;
    for (const auto& [first, part] : parts_)
      if (part.is_alone)
        std::ranges::set_difference(part.vertices, scope_, std::back_inserter(more));
    sort_and_unite(more);
    return more;
  }

  bool hangs(std::uint32_t first) {
    Part& part = parts_.at(first);
    if (!part.is_alone) return false;
    if (!part.hangs) part.hangs = is_beside_others(part) && is_part_of_surface(part);
    return *part.hangs;
  }

  bool is_beside_others(const Part& part) const {
    const double near = 4 * most_;
    const Point& p = *place_of(part.vertices.front());
    const auto is_near = [&](Id id) { return squared_distance(p, *place_of(id)) < near * near; };
    return std::ranges::any_of(held_, is_near) ||
           std::ranges::any_of(parts_, [&](const auto& other) {
             return !other.second.is_alone && std::ranges::any_of(other.second.vertices, is_near);
           });
  }

  // Whether the surface at its vertices leads on, away from it.
  bool is_part_of_surface(const Part& part) {
    const Point& p = *place_of(part.vertices.front());
    const double far = 2 * most_;
    LeafSurface near;
    for (const MortonKey leaf : around_) append_near(p, far, state_.leaves().surface(leaf), near);
    return leads_on(p, far, near);
  }

  std::uint32_t root(std::uint32_t c) {
    while (parents_[c] != c) c = parents_[c] = parents_[parents_[c]];
    return c;
  }

  const RunView& state_;
  double most_ = 0;  // how large such a part is
  std::vector<MortonKey> around_;
  std::vector<Place> places_;  // of points on the surface, by id
  Ids scope_;                  // vertices all of whose cells are looked at
  std::vector<Cell> cells_;
  Ids held_;  // vertices of cells with a volume point
  std::vector<std::uint32_t> parents_;
  std::map<std::uint32_t, Part> parts_;  // by their root
};

}  // namespace

std::vector<CellPlaces> hanging_cells(const RunView& state, MortonKey leaf) {
  return HangingCells(state, leaf).run();
}

}  // namespace locvol
