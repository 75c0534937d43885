#include "engine/output/edge_window.h"

#include <algorithm>
#include <memory>
#include <string>

#include "engine/shared/leaf_name.h"

namespace locvol {
namespace {

constexpr std::size_t kEdgeTableBytes = std::size_t{8} << 20, kCoreEdgeBytes = std::size_t{4} << 20;

}  // namespace

EdgeWindow::EdgeWindow(const VertexNumbering& numbering, const EdgeNumbering& edges, int num_shares)
    : numbering_(&numbering),
      edges_(&edges),
      listed_(kEdgeTableBytes / static_cast<std::size_t>(num_shares),
              [this](std::size_t leaf) { return edges_->listed(leaf); }),
      cores_(kCoreEdgeBytes / static_cast<std::size_t>(num_shares), [this](std::size_t leaf) {
        CoreTable table{edges_->core_steps(leaf), {}};
        std::uint32_t before = 0;
        for (const std::uint8_t steps : table.steps) {
          table.before.push_back(before);
          before += static_cast<std::uint32_t>(std::popcount(steps));
        }
        return table;
      }) {}

void EdgeWindow::throw_unknown(const MeshEdge& edge) const {
  const MortonKey leaf = numbering_->leaves()[numbering_->leaf_of(edge.a)];
  throw CorruptRecord(leaf_name(leaf) + ": cells have an edge at one of its points, from vertex " +
                          std::to_string(edge.a) + " to " + std::to_string(edge.b) +
                          ", that no leaf near it knows",
                      leaf);
}

const SiteBlock<CoreEdges>* EdgeWindow::core(std::size_t leaf, NumberWindow& cores) {
  if (leaf_of_core_ != leaf) {
    leaf_of_core_ = leaf;
    has_core_ = false;
    const SiteBox around = numbering_->sites(leaf).expanded(2);
    for (const std::size_t other : numbering_->neighbors(leaf)) {
      if (numbering_->num_core_vertices(other) == 0) continue;
      if (!has_core_) core_ = {around, CoreEdges{}};
      has_core_ = true;
      const auto table = cores_.get(other);
      const std::uint64_t first = edges_->first_of_core(other);
      for_each_core_site(*cores.core(other), numbering_->sites(other), around,
                         [&](const LatticeSite& site, std::uint64_t num_before) {
                           const bool has_all = table->steps.empty();
                           const std::uint64_t before = has_all
                                                            ? kLargerNeighbors.size() * num_before
                                                            : table->before[num_before];
                           core_[site] = {static_cast<std::int64_t>(first + before),
                                          has_all ? kAllCoreSteps : table->steps[num_before]};
                         });
    }
  }
  return has_core_ ? &core_ : nullptr;
}

std::int64_t EdgeWindow::core_number(std::size_t leaf, std::uint64_t id, std::uint64_t other,
                                     NumberWindow& cores) {
  const auto [from, to] = std::minmax({site_of(id), site_of(other)});
  const auto step = step_between(from, to);
  const SiteBlock<CoreEdges>* known = core(leaf, cores);
  if (!step || known == nullptr || !known->box().contains(from) || (*known)[from].first < 0)
    throw CorruptRecord(leaf_name(numbering_->leaves()[leaf]) +
                            ": an edge between two points of the core is none of the lattice",
                        numbering_->leaves()[leaf]);
  return (*known)[from].number(*step);
}

std::uint64_t EdgeWindow::number(const MeshEdge& edge) {
  const std::size_t leaf = numbering_->leaf_of(edge.a);
  const auto table = listed_.get(leaf);
  const auto found = std::ranges::lower_bound(table->values, edge);
  if (found == table->values.end() || *found != edge) throw_unknown(edge);
  return edges_->first(leaf) + static_cast<std::uint64_t>(found - table->values.begin());
}

std::vector<std::int64_t> EdgeWindow::numbers(std::size_t leaf, const LeafCells& cells,
                                              std::span<const std::int64_t> number_of_vertex,
                                              const CellEdges& edges, NumberWindow& cores) {
  std::vector<bool> is_of_core(number_of_vertex.size());
  for (std::size_t v = 0; v < number_of_vertex.size(); ++v)
    is_of_core[v] = numbering_->is_core(cells.vertices[v], number_of_vertex[v]);
  std::vector<std::int64_t> numbers;
  numbers.reserve(edges.size());
  // Edges ascend: so do the leaves that have them, and the places in their lists.
  std::shared_ptr<const LeafList<MeshEdge>> table;
  std::uint64_t end = 0, first = 0;
  std::span<const MeshEdge> rest;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto& [v, w] = edges.ends()[e];
    if (is_of_core[v] && is_of_core[w]) {
      numbers.push_back(core_number(leaf, cells.vertices[v], cells.vertices[w], cores));
      continue;
    }
    const MeshEdge edge = edges.edge(e);
    if (edge.a >= end) {
      const std::size_t owner = numbering_->leaf_of(edge.a);
      table = listed_.get(owner);
      end = numbering_->first_vertex(owner + 1);
      first = edges_->first(owner);
      rest = table->values;
    }
    std::size_t step = 1;
    for (; step < rest.size() && rest[step - 1] < edge; step *= 2) rest = rest.subspan(step);
    const auto found = std::ranges::lower_bound(rest.first(std::min(step, rest.size())), edge);
    rest = rest.subspan(static_cast<std::size_t>(found - rest.begin()));
    if (rest.empty() || rest.front() != edge) throw_unknown(edge);
    numbers.push_back(static_cast<std::int64_t>(first + (table->values.size() - rest.size())));
  }
  return numbers;
}

}  // namespace locvol
