#include "engine/ranks/rank_share.h"

#include <algorithm>
#include <boost/serialization/utility.hpp>
#include <compare>
#include <cstdint>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/plan/octree_plan.h"
#include "octree/sort_and_unite.h"

namespace locvol {

// A rank's component that a triangle is in.
struct RankComponent {
  std::uint32_t rank = 0, component = 0;
  friend auto operator<=>(const RankComponent&, const RankComponent&) = default;
};
// Two that are one, for they have a triangle in common.
struct ComponentLink {
  RankComponent a, b;
  bool is_turned = false;  // against each other
  friend auto operator<=>(const ComponentLink&, const ComponentLink&) = default;
};

auto fields(Maybe<EdgeFlaws> auto& flaws) {
  auto& [count, half_edge, from, to] = flaws;
  return std::tuple(Field("count", count), Field("half_edge", half_edge), Field("from", from),
                    Field("to", to));
}
auto fields(Maybe<EdgeCounts> auto& counts) {
  auto& [border, overused] = counts;
  return std::tuple(Field("border", border), Field("overused", overused));
}
auto fields(Maybe<SurfaceComponent> auto& component) {
  auto& [top, six_volume, six_volume_error, num_triangles, num_turned] = component;
  return std::tuple(Field("top", top), Field("six_volume", six_volume),
                    Field("six_volume_error", six_volume_error),
                    Field("num_triangles", num_triangles), Field("num_turned", num_turned));
}
auto fields(Maybe<OpenTriangle> auto& triangle) {
  auto& [id, component, is_turned] = triangle;
  return std::tuple(Field("id", id), Field("component", component), Field("is_turned", is_turned));
}
auto fields(Maybe<JoinedComponents> auto& joined) {
  auto& [components, open] = joined;
  return std::tuple(Field("components", components), Field("open", open));
}
auto fields(Maybe<LineSight> auto& sight) {
  auto [ahead, facing_ahead, behind, facing_behind, is_odd] = LineSight::members(sight);
  return std::tuple(Field("ahead", ahead), Field("facing_ahead", facing_ahead),
                    Field("behind", behind), Field("facing_behind", facing_behind),
                    Field("is_odd", is_odd));
}
auto fields(Maybe<SurfaceFindings> auto& findings) {
  auto& [edges, edges_without_copies, num_copies, first_copy, is_copy_needed, conflicts,
         num_pinched, first_pinched, intersection, num_vertices, num_triangles, area, joined,
         sights] = findings;
  return std::tuple(Field("edges", edges), Field("edges_without_copies", edges_without_copies),
                    Field("num_copies", num_copies), Field("first_copy", first_copy),
                    Field("is_copy_needed", is_copy_needed), Field("conflicts", conflicts),
                    Field("num_pinched", num_pinched), Field("first_pinched", first_pinched),
                    Field("intersection", intersection), Field("num_vertices", num_vertices),
                    Field("num_triangles", num_triangles), Field("area", area),
                    Field("joined", joined), Field("sights", sights));
}
auto fields(Maybe<RankComponent> auto& of_rank) {
  auto& [rank, component] = of_rank;
  return std::tuple(Field("rank", rank), Field("component", component));
}
auto fields(Maybe<ComponentLink> auto& link) {
  auto& [a, b, is_turned] = link;
  return std::tuple(Field("a", a), Field("b", b), Field("is_turned", is_turned));
}

namespace {

// Each of all ranks' links on one of them: a triangle's number says to whom it is told.
std::vector<ComponentLink> links_found(const std::vector<OpenTriangle>& open, Exchange& exchange) {
  const auto num_ranks = static_cast<std::size_t>(exchange.num_ranks());
  std::vector<std::vector<OpenTriangle>> by_rank(num_ranks);
  for (const OpenTriangle& triangle : open) by_rank[triangle.id % num_ranks].push_back(triangle);
  by_rank = swap_lists(exchange, std::move(by_rank));

  struct Place {
    std::uint64_t triangle;
    RankComponent component;
    bool is_turned;
    auto operator<=>(const Place&) const = default;
  };
  std::vector<Place> places;
  for (std::uint32_t rank = 0; rank < num_ranks; ++rank)
    for (const auto& [id, component, is_turned] : by_rank[rank])
      places.push_back({id, {rank, component}, is_turned});
  std::ranges::sort(places);
  std::vector<ComponentLink> links;
  for (std::size_t i = 1; i < places.size(); ++i) {
    const Place &a = places[i - 1], &b = places[i];
    if (a.triangle == b.triangle)
      links.push_back({a.component, b.component, a.is_turned != b.is_turned});
  }
  sort_and_unite(links);
  return links;
}

// Of all ranks. `by_rank`: of each one's cells, as a message
SurfaceFindings joined_findings(std::vector<std::string> by_rank,
                                const std::vector<ComponentLink>& links) {
  SurfaceFindings all;
  ComponentJoiner joiner;
  std::vector<std::uint32_t> first;  // by rank, its first component's number
  std::uint32_t num_components = 0;
  for (std::string& message : by_rank) {
    const auto of_rank = unpack<SurfaceFindings>(std::exchange(message, {}));
    all.add(of_rank);
    first.push_back(num_components);
    for (const SurfaceComponent& component : of_rank.joined.components)
      num_components = joiner.add_part(component) + 1;
  }
  const auto number_of = [&](const RankComponent& c) { return first[c.rank] + c.component; };
  std::uint64_t num_links = 0;
  for (const auto& [a, b, is_turned] : links) {
    joiner.join(num_links, number_of(a), false, false);
    if (!joiner.join(num_links++, number_of(b), is_turned, true)) ++all.conflicts.count;
  }
  all.joined = joiner.take();
  return all;
}

// Which component, or which edge, comes first depends on where each has been looked at.
bool needs_one_process(const SurfaceFindings& findings) {
  return findings.num_copies > 0 || findings.conflicts.count > 0 ||
         !std::ranges::all_of(findings.joined.components, &SurfaceComponent::has_certain_volume);
}

}  // namespace

void RankShare::join_findings(SurfaceFindings& findings) const {
  stop_.meet();
  const std::vector<ComponentLink> links =
      gather_all(exchange_, links_found(std::exchange(findings.joined.open, {}), exchange_));
  findings = joined_findings(exchange_.gather(pack(findings)), links);
  if (needs_one_process(findings)) throw NeedsOneProcess();
}

void RankShare::join_parities(std::vector<bool>& parities) const {
  stop_.meet();
  const std::vector<std::vector<bool>> by_rank = gather_values(exchange_, parities);
  parities.assign(parities.size(), false);
  for (const std::vector<bool>& of_rank : by_rank)
    for (std::size_t i = 0; i < parities.size(); ++i) parities[i] = parities[i] != of_rank[i];
}

// First each rank has those of its share, so that none has more than are allowed.
void RankShare::join_cells(std::optional<std::vector<MortonKey>>& cells) const {
  stop_.meet();
  if (any(exchange_, !cells)) return cells.reset();
  std::vector<std::vector<MortonKey>> by_rank(static_cast<std::size_t>(exchange_.num_ranks()));
  for (const MortonKey cell : *cells)
    by_rank[static_cast<std::size_t>(shares_.owner_of(cell))].push_back(cell);
  by_rank = swap_lists(exchange_, std::move(by_rank));
  cells->clear();
  for (const auto& of_rank : by_rank) cells->insert(cells->end(), of_rank.begin(), of_rank.end());
  sort_and_unite(*cells);
  if (sum(exchange_, cells->size()).all > kMaxStartLeaves) return cells.reset();
  cells = gather_all(exchange_, *cells);
}

void RankShare::join_leaves(CutLeaves& leaves) const {
  stop_.meet();
  leaves = {gather_all(exchange_, leaves.keys), gather_all(exchange_, leaves.corners)};
}

void RankShare::let_first_speak() const {
  if (exchange_.rank() > 0) wait_for_all(exchange_);
}

}  // namespace locvol
