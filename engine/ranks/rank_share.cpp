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
auto fields(Maybe<Needle> auto& needle) {
  auto& [id, across, normal, is_turned, is_next_to_needle] = needle;
  return std::tuple(Field("id", id), Field("across", across), Field("normal", normal),
                    Field("is_turned", is_turned), Field("is_next_to_needle", is_next_to_needle));
}
auto fields(Maybe<SharpEdges> auto& sharp) {
  auto& [num_edges, num_pointed, num_needles, needles] = sharp;
  return std::tuple(Field("num_edges", num_edges), Field("num_pointed", num_pointed),
                    Field("num_needles", num_needles), Field("needles", needles));
}
auto fields(Maybe<CreasePart> auto& part) {
  auto& [first_edge, num_edges, length, num_ends, box, sheets, corners] = part;
  return std::tuple(Field("first_edge", first_edge), Field("num_edges", num_edges),
                    Field("length", length), Field("num_ends", num_ends), Field("box", box),
                    Field("sheets", sheets), Field("corners", corners));
}
auto fields(Maybe<SurfaceCorner> auto& corner) {
  auto& [name, position] = corner;
  return std::tuple(Field("name", name), Field("position", position));
}
auto fields(Maybe<SheetPart> auto& part) {
  auto& [first_triangle, group, area, num_points, turn, is_first_turned] = part;
  return std::tuple(Field("first_triangle", first_triangle), Field("group", group),
                    Field("area", area), Field("num_points", num_points), Field("turn", turn),
                    Field("is_first_turned", is_first_turned));
}
auto fields(Maybe<SheetBorder> auto& border) {
  auto& [a, b, is_rib, length] = border;
  return std::tuple(Field("a", a), Field("b", b), Field("is_rib", is_rib), Field("length", length));
}
auto fields(Maybe<SheetSums> auto& sums) {
  auto& [first_triangle, num_triangles, area, moment, box] = sums;
  return std::tuple(Field("first_triangle", first_triangle), Field("num_triangles", num_triangles),
                    Field("area", area), Field("moment", moment), Field("box", box));
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
         num_pinched, first_pinched, intersection, has_contacts, num_vertices, num_triangles, area,
         joined, sharp, sights] = findings;
  return std::tuple(Field("edges", edges), Field("edges_without_copies", edges_without_copies),
                    Field("num_copies", num_copies), Field("first_copy", first_copy),
                    Field("is_copy_needed", is_copy_needed), Field("conflicts", conflicts),
                    Field("num_pinched", num_pinched), Field("first_pinched", first_pinched),
                    Field("intersection", intersection), Field("has_contacts", has_contacts),
                    Field("num_vertices", num_vertices), Field("num_triangles", num_triangles),
                    Field("area", area), Field("joined", joined), Field("sharp", sharp),
                    Field("sights", sights));
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

// Adds the parts of all ranks. Gives by rank, the number of its first one.
template <class Part>
std::vector<std::uint32_t> add_parts(const std::vector<std::vector<Part>>& by_rank,
                                     PartJoiner<Part>& joiner) {
  std::vector<std::uint32_t> first;
  std::uint32_t num_parts = 0;
  for (const std::vector<Part>& of_rank : by_rank) {
    first.push_back(num_parts);
    for (const Part& part : of_rank) num_parts = joiner.add_part(part) + 1;
  }
  return first;
}

// `first`: of add_parts(). Gives how many links contradict others.
template <class Part>
std::uint64_t join_linked(const std::vector<ComponentLink>& links,
                          const std::vector<std::uint32_t>& first, PartJoiner<Part>& joiner) {
  const auto number_of = [&](const RankComponent& c) { return first[c.rank] + c.component; };
  std::uint64_t num_links = 0, num_conflicts = 0;
  for (const auto& [a, b, is_turned] : links) {
    joiner.join(num_links, number_of(a), false, false);
    if (!joiner.join(num_links++, number_of(b), is_turned, true)) ++num_conflicts;
  }
  return num_conflicts;
}

// Of all ranks. Gives by component of this rank its place among all.
template <class Part>
std::vector<std::uint32_t> join_parts(JoinedParts<Part>& joined, Exchange& exchange) {
  const std::vector<ComponentLink> links = gather_all(exchange, links_found(joined.open, exchange));
  PartJoiner<Part> joiner;
  const auto num_own = joined.components.size();
  const auto first = add_parts(gather_values(exchange, joined.components), joiner);
  join_linked(links, first, joiner);
  std::vector<std::uint32_t> numbers;
  joined = joiner.take(numbers);
  const auto own = numbers.begin() + first[static_cast<std::size_t>(exchange.rank())];
  return {own, own + static_cast<std::ptrdiff_t>(num_own)};
}

// Of all ranks. `by_rank`: of each one's cells, as a message
SurfaceFindings joined_findings(std::vector<std::string> by_rank,
                                const std::vector<ComponentLink>& links) {
  SurfaceFindings all;
  std::vector<std::vector<SurfaceComponent>> components;
  for (std::string& message : by_rank) {
    auto of_rank = unpack<SurfaceFindings>(std::exchange(message, {}));
    all.add(of_rank);
    components.push_back(std::move(of_rank.joined.components));
  }
  ComponentJoiner joiner;
  const auto first = add_parts(components, joiner);
  all.conflicts.count += join_linked(links, first, joiner);
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

void RankShare::join_sheets(SheetPieces& pieces) const {
  stop_.meet();
  pieces.places = join_parts(pieces.joined, exchange_);
  for (SheetBorder& border : pieces.borders) {
    border.a = pieces.places[border.a];
    border.b = pieces.places[border.b];
  }
  pieces.borders = gather_all(exchange_, pieces.borders);
}

void RankShare::join_creases(CreasePieces& pieces) const {
  stop_.meet();
  pieces.is_too_many = any(exchange_, pieces.is_too_many);
  if (pieces.is_too_many) return;
  pieces.places = join_parts(pieces.joined, exchange_);
  pieces.corners = gather_all(exchange_, pieces.corners);
}

void RankShare::join_sums(std::vector<SheetSums>& sums) const {
  stop_.meet();
  const auto by_rank = gather_values(exchange_, sums);
  sums.assign(sums.size(), {});
  for (const std::vector<SheetSums>& of_rank : by_rank)
    for (std::size_t s = 0; s < sums.size(); ++s) sums[s].add(of_rank[s]);
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

std::vector<std::string> RankShare::gather(std::string own) const {
  stop_.meet();
  return exchange_.gather(own);
}

void RankShare::let_first_speak() const {
  if (exchange_.rank() > 0) wait_for_all(exchange_);
}

}  // namespace locvol
