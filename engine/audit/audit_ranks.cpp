#include "engine/audit/audit_ranks.h"

#include <algorithm>
#include <array>
#include <compare>
#include <map>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "octree/sort_and_unite.h"

namespace locvol {

auto fields(Maybe<SitesOfLeaf> auto& of_leaf) {
  auto& [leaf, sites] = of_leaf;
  return std::tuple(Field("leaf", leaf), Field("sites", sites));
}

// Of a rank's component, that it has a facet at another rank's vertex.
struct ToldCrossing {
  std::uint64_t vertex = 0, label = 0;
  friend auto operator<=>(const ToldCrossing&, const ToldCrossing&) = default;
};
auto fields(Maybe<ToldCrossing> auto& crossing) {
  auto& [vertex, label] = crossing;
  return std::tuple(Field("vertex", vertex), Field("label", label));
}

// Two components that are one: this rank's, and a lower one's.
struct ComponentPair {
  std::uint64_t label = 0, rank = 0, label_there = 0;
  friend auto operator<=>(const ComponentPair&, const ComponentPair&) = default;
};
auto fields(Maybe<ComponentPair> auto& pair) {
  auto& [label, rank, label_there] = pair;
  return std::tuple(Field("label", label), Field("rank", rank), Field("label_there", label_there));
}

auto fields(Maybe<AuditReport> auto& report) {
  auto& [num_leaves, num_checked_leaves, is_surface_only, num_cells, num_vertices,
         num_boundary_facets, num_boundary_vertices, volume, surface_volume, body_volumes,
         surface_body_volumes, max_circumradius, min_facet_degrees, max_radius_edge_ratio,
         min_dihedral_degrees, max_dihedral_degrees, worst_leaf, worst_place, min_dihedral_bound,
         num_poor_cells, max_surface_distance, euler_characteristic, surface_euler_characteristic,
         num_components, surface_num_components, crease_length, lost_crease_length,
         surface_crease_length, num_unresolved, num_open, num_nonempty_circumballs,
         num_overused_facets, num_bad_boundary_edges, num_bad_boundary_vertices, num_wrong_facets,
         num_large_facets, num_misoriented_edges, num_off_surface_vertices, num_large_cells,
         num_badly_shaped_cells, num_lost_creases, num_lost_corners, num_misoriented_cells,
         num_repeated_cells, num_misplaced_cells, num_unknown_vertices, num_misplaced_points,
         num_repeated_points, num_run_faults, violations] = report;
  return std::tuple(
      Field("num_leaves", num_leaves), Field("num_checked_leaves", num_checked_leaves),
      Field("is_surface_only", is_surface_only), Field("num_cells", num_cells),
      Field("num_vertices", num_vertices), Field("num_boundary_facets", num_boundary_facets),
      Field("num_boundary_vertices", num_boundary_vertices), Field("volume", volume),
      Field("surface_volume", surface_volume), Field("body_volumes", body_volumes),
      Field("surface_body_volumes", surface_body_volumes),
      Field("max_circumradius", max_circumradius), Field("min_facet_degrees", min_facet_degrees),
      Field("max_radius_edge_ratio", max_radius_edge_ratio),
      Field("min_dihedral_degrees", min_dihedral_degrees),
      Field("max_dihedral_degrees", max_dihedral_degrees), Field("worst_leaf", worst_leaf),
      Field("worst_place", worst_place), Field("min_dihedral_bound", min_dihedral_bound),
      Field("num_poor_cells", num_poor_cells), Field("max_surface_distance", max_surface_distance),
      Field("euler_characteristic", euler_characteristic),
      Field("surface_euler_characteristic", surface_euler_characteristic),
      Field("num_components", num_components),
      Field("surface_num_components", surface_num_components),
      Field("crease_length", crease_length), Field("lost_crease_length", lost_crease_length),
      Field("surface_crease_length", surface_crease_length),
      Field("num_unresolved", num_unresolved), Field("num_open", num_open),
      Field("num_nonempty_circumballs", num_nonempty_circumballs),
      Field("num_overused_facets", num_overused_facets),
      Field("num_bad_boundary_edges", num_bad_boundary_edges),
      Field("num_bad_boundary_vertices", num_bad_boundary_vertices),
      Field("num_wrong_facets", num_wrong_facets), Field("num_large_facets", num_large_facets),
      Field("num_misoriented_edges", num_misoriented_edges),
      Field("num_off_surface_vertices", num_off_surface_vertices),
      Field("num_large_cells", num_large_cells),
      Field("num_badly_shaped_cells", num_badly_shaped_cells),
      Field("num_lost_creases", num_lost_creases), Field("num_lost_corners", num_lost_corners),
      Field("num_misoriented_cells", num_misoriented_cells),
      Field("num_repeated_cells", num_repeated_cells),
      Field("num_misplaced_cells", num_misplaced_cells),
      Field("num_unknown_vertices", num_unknown_vertices),
      Field("num_misplaced_points", num_misplaced_points),
      Field("num_repeated_points", num_repeated_points), Field("num_run_faults", num_run_faults),
      Field("violations", violations));
}

namespace {

constexpr std::array kSummed = {
    &AuditReport::num_leaves,
    &AuditReport::num_checked_leaves,
    &AuditReport::num_cells,
    &AuditReport::num_vertices,
    &AuditReport::num_boundary_facets,
    &AuditReport::num_boundary_vertices,
    &AuditReport::num_poor_cells,
    &AuditReport::num_components,
    &AuditReport::num_unresolved,
    &AuditReport::num_open,
    &AuditReport::num_nonempty_circumballs,
    &AuditReport::num_overused_facets,
    &AuditReport::num_bad_boundary_edges,
    &AuditReport::num_bad_boundary_vertices,
    &AuditReport::num_wrong_facets,
    &AuditReport::num_large_facets,
    &AuditReport::num_misoriented_edges,
    &AuditReport::num_off_surface_vertices,
    &AuditReport::num_large_cells,
    &AuditReport::num_badly_shaped_cells,
    &AuditReport::num_lost_creases,
    &AuditReport::num_lost_corners,
    &AuditReport::num_misoriented_cells,
    &AuditReport::num_repeated_cells,
    &AuditReport::num_misplaced_cells,
    &AuditReport::num_unknown_vertices,
    &AuditReport::num_misplaced_points,
    &AuditReport::num_repeated_points,
    &AuditReport::num_run_faults,
};
constexpr std::array kLargest = {
    &AuditReport::max_circumradius, &AuditReport::max_radius_edge_ratio,
    &AuditReport::max_dihedral_degrees, &AuditReport::max_surface_distance};

void add(const AuditReport& more, AuditReport& all) {
  for (const auto count : kSummed) all.*count += more.*count;
  for (const auto measure : kLargest) all.*measure = std::max(all.*measure, more.*measure);
  all.volume += more.volume;
  for (std::size_t b = 0; b < all.body_volumes.size(); ++b)
    all.body_volumes[b] += more.body_volumes[b];
  all.crease_length += more.crease_length;
  all.lost_crease_length += more.lost_crease_length;
  all.euler_characteristic += more.euler_characteristic;
  all.min_facet_degrees = std::min(all.min_facet_degrees, more.min_facet_degrees);
  if (more.min_dihedral_degrees < all.min_dihedral_degrees) {
    all.min_dihedral_degrees = more.min_dihedral_degrees;
    all.worst_leaf = more.worst_leaf;
    all.worst_place = more.worst_place;
  }
  all.violations.insert(all.violations.end(), more.violations.begin(), more.violations.end());
}

// Those of own components with lower ranks'.
std::vector<ComponentPair> joined_with_lower(std::vector<BoundaryComponents::Crossing> crossings,
                                             const AuditLeaves& leaves, const AuditRecords& records,
                                             Exchange& exchange) {
  std::vector<std::vector<ToldCrossing>> told(static_cast<std::size_t>(exchange.num_ranks()));
  std::map<std::uint64_t, std::uint64_t> label_of;  // of own vertices that lower ranks may name
  for (const auto& [own, other, leaf, label] : crossings) {
    const int owner = records.shares().owner_of(leaves.key(leaf));
    if (owner > exchange.rank())
      told[static_cast<std::size_t>(owner)].push_back({other, label});
    else
      label_of[own] = label;
  }
  for (auto& to_rank : told) sort_and_unite(to_rank);
  std::vector<ComponentPair> pairs;
  told = swap_lists(exchange, std::move(told));
  for (std::size_t rank = 0; rank < told.size(); ++rank)
    for (const auto& [vertex, label] : told[rank]) {
      const auto own = label_of.find(vertex);  // absent: its leaf was not checked
      if (own != label_of.end()) pairs.push_back({own->second, rank, label});
    }
  sort_and_unite(pairs);
  return pairs;
}

}  // namespace

std::vector<SitesOfLeaf> sites_beside(const Reader& own, const RunRecord& run, double distance,
                                      Exchange& exchange) {
  if (run.counts.num_unresolved == 0) return {};
  const Shares shares(own.rank().value().first);
  std::vector<std::vector<SitesOfLeaf>> sites(static_cast<std::size_t>(exchange.num_ranks()));
  own.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
    if (info.holding != Holding::kOwn || info.num_unresolved == 0) return true;
    SitesOfLeaf of_leaf{leaf, {}};
    for (const UnresolvedSite& site : own.unresolved(leaf).sites)
      of_leaf.sites.push_back(site.position);
    for (const int rank : shares.ranks_within(run.frame, run.frame.box(leaf), distance))
      if (rank != exchange.rank()) sites[static_cast<std::size_t>(rank)].push_back(of_leaf);
    return true;
  });
  std::vector<SitesOfLeaf> beside;
  for (auto& of_rank : swap_lists(exchange, std::move(sites)))
    std::ranges::move(of_rank, std::back_inserter(beside));
  return beside;
}

std::uint64_t num_joined_components(BoundaryComponents& own, const AuditLeaves& leaves,
                                    const AuditRecords& records, Exchange& exchange) {
  using Component = std::pair<std::uint64_t, std::uint64_t>;  // rank, label
  std::vector<std::pair<Component, Component>> pairs;
  std::vector<Component> components;
  std::uint64_t rank = 0;
  for (const auto& of_rank :
       gather_values(exchange, joined_with_lower(own.crossings(), leaves, records, exchange))) {
    for (const auto& [label, rank_there, label_there] : of_rank) {
      pairs.push_back({{rank, label}, {rank_there, label_there}});
      components.insert(components.end(), {pairs.back().first, pairs.back().second});
    }
    ++rank;
  }
  sort_and_unite(components);
  const auto place = [&](const Component& component) {
    return static_cast<std::size_t>(std::ranges::lower_bound(components, component) -
                                    components.begin());
  };
  UnionFind sets(components.size());
  for (const auto& [one, other] : pairs) sets.unite(place(one), place(other));
  return components.size() - sets.num_sets();
}

AuditReport together(const AuditReport& own, Exchange& exchange) {
  const std::vector<AuditReport> of_ranks = gather_values(exchange, own);
  AuditReport all = of_ranks.front();
  for (std::size_t rank = 1; rank < of_ranks.size(); ++rank) add(of_ranks[rank], all);
  return all;
}

}  // namespace locvol
