#include "engine/output/edge_numbering.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <span>

#include "engine/output/near_lists.h"
#include "engine/shared/encode_in_order.h"
#include "engine/shared/leaf_name.h"
#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr std::size_t kForeignBytes = std::size_t{8} << 20;

// The edges in an ascending list whose smaller ends are from `first` to before `end`.
std::span<const MeshEdge> starting_in(std::span<const MeshEdge> edges, std::uint64_t first,
                                      std::uint64_t end) {
  const auto low = std::ranges::lower_bound(edges, first, {}, &MeshEdge::a),
             high = std::ranges::lower_bound(edges, end, {}, &MeshEdge::a);
  return {low, high};
}

// The same eight to a number, and back.
void append_packed(std::span<const std::uint8_t> bytes, std::vector<std::uint64_t>& out) {
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (i % 8 == 0) out.push_back(0);
    out.back() |= std::uint64_t{bytes[i]} << 8 * (i % 8);
  }
}
std::vector<std::uint8_t> unpacked(std::span<const std::uint64_t> values, std::uint64_t count) {
  std::vector<std::uint8_t> bytes(count);
  for (std::uint64_t i = 0; i < count; ++i)
    bytes[i] = static_cast<std::uint8_t>(values[i / 8] >> 8 * (i % 8));
  return bytes;
}

std::vector<std::uint64_t> flat(std::span<const MeshEdge> edges) {
  std::vector<std::uint64_t> values;
  values.reserve(2 * edges.size());
  for (const auto& [a, b] : edges) values.insert(values.end(), {a, b});
  return values;
}
std::vector<MeshEdge> edges_in(std::span<const std::uint64_t> values) {
  std::vector<MeshEdge> edges;
  edges.reserve(values.size() / 2);
  for (std::size_t i = 0; i + 1 < values.size(); i += 2)
    edges.push_back({values[i], values[i + 1]});
  return edges;
}

}  // namespace

// While edges are found: of each own leaf, those of its cells that are its own, and those that are
// other leaves'.
class EdgeNumbering::Lists {
 public:
  Lists(const VertexNumbering& numbering, const std::filesystem::path& output)
      : own(output), foreign(numbering, output, kForeignBytes) {}
  LeafLists<MeshEdge> own;
  NearLists<MeshEdge> foreign;
};

EdgeNumbering::EdgeNumbering(const Reader& reader, const VertexNumbering& numbering,
                             MeshWindows& windows, const std::filesystem::path& output,
                             PageRelease& pages, Workers& workers, const StopToken* stop,
                             Exchange& exchange, const std::function<void(std::uint64_t)>& on_cells)
    : numbering_(&numbering),
      first_own_(numbering.first_own()),
      end_own_(numbering.end_own()),
      listed_(output),
      core_steps_(output) {
  Lists lists(numbering, output);
  do_on_all(exchange, [&] { find_all(lists, windows, pages, workers, stop, on_cells); });
  lists.foreign.tell(reader, exchange);
  number(lists, stop, exchange);
  tell_numbers(reader, exchange);
}

EdgeNumbering::Found EdgeNumbering::find(std::size_t leaf, MeshWindows& windows) const {
  return windows.with([&](MeshWindow& window) {
    Found found;
    const auto [cells, numbers] = window.numbers.cells(leaf);
    std::vector<bool> is_of_core(numbers.size());
    for (std::size_t v = 0; v < numbers.size(); ++v)
      is_of_core[v] = numbering_->is_core(cells.vertices[v], numbers[v]);
    const CellEdges edges(cells.cells, numbers);
    const std::uint64_t first = numbering_->first_vertex(leaf),
                        end = numbering_->first_vertex(leaf + 1);
    for (std::size_t e = 0; e < edges.size(); ++e) {
      const auto& [v, w] = edges.ends()[e];
      if (is_of_core[v] && is_of_core[w]) continue;
      const MeshEdge edge = edges.edge(e);
      (first <= edge.a && edge.a < end ? found.own : found.foreign).push_back(edge);
    }
    if (numbering_->num_core_vertices(leaf) == 0) return found;
    const SiteBlock<std::int64_t>& core = *window.numbers.core_numbers(leaf);
    for_each_site(numbering_->sites(leaf), [&](const LatticeSite& site) {
      if (core[site] < 0) return;
      std::uint8_t steps = 0;
      for (std::size_t step = 0; step < kLargerNeighbors.size(); ++step)
        if (core[site + kLargerNeighbors[step]] >= 0)
          steps |= static_cast<std::uint8_t>(1U << step);
      found.core_steps.push_back(steps);
      found.num_core += static_cast<std::uint64_t>(std::popcount(steps));
    });
    if (std::ranges::all_of(found.core_steps, [](auto steps) { return steps == kAllCoreSteps; }))
      found.core_steps.clear();
    return found;
  });
}

void EdgeNumbering::find_all(Lists& lists, MeshWindows& windows, PageRelease& pages,
                             Workers& workers, const StopToken* stop,
                             const std::function<void(std::uint64_t)>& on_cells) {
  const std::uint64_t first_cell = numbering_->first_cell(first_own_);
  std::size_t next = first_own_;
  encode_in_order(
      workers,
      [&]() -> std::optional<std::size_t> {
        throw_if_stopped(stop);
        if (next == end_own_) return std::nullopt;
        pages.count(16 * (numbering_->first_cell(next + 1) - numbering_->first_cell(next)));
        on_cells(numbering_->first_cell(next) - first_cell);
        return next++;
      },
      [&](std::size_t leaf) { return find(leaf, windows); },
      [&](const Found& found) {
        lists.own.append(found.own);
        lists.foreign.append(found.foreign);
        core_steps_.append(found.core_steps);
        num_core_.push_back(found.num_core);
      });
}

void EdgeNumbering::number(Lists& lists, const StopToken* stop, Exchange& exchange) {
  std::uint64_t next = 0;
  do_on_all(exchange, [&] {
    for (std::size_t leaf = first_own_; leaf < end_own_; ++leaf) {
      throw_if_stopped(stop);
      std::vector<MeshEdge> edges = lists.own.list(leaf - first_own_).values;
      const std::uint64_t first = numbering_->first_vertex(leaf),
                          end = numbering_->first_vertex(leaf + 1);
      lists.foreign.for_each_near(leaf, [&](std::span<const MeshEdge> theirs) {
        const auto some = starting_in(theirs, first, end);
        edges.insert(edges.end(), some.begin(), some.end());
      });
      sort_and_unite(edges);
      listed_.append(edges);
      own_first_.push_back(next);
      next += edges.size() + num_core_[leaf - first_own_];
    }
    own_first_.push_back(next);
  });
  num_edges_ = sum(exchange, next);
  for (std::uint64_t& first : own_first_) first += numbering_->num_vertices() + num_edges_.before;
}

void EdgeNumbering::tell_numbers(const Reader& reader, Exchange& exchange) {
  numbering_->tell_ranks_beside(
      reader, exchange, kCellReach,
      [&](std::size_t leaf) {
        const LeafList<MeshEdge> edges = listed(leaf);
        const std::vector<std::uint8_t> steps = core_steps(leaf);
        std::vector<std::uint64_t> values = {first(leaf), edges.values.size(), steps.size()};
        const std::vector<std::uint64_t> ends = flat(edges.values);
        values.insert(values.end(), ends.begin(), ends.end());
        append_packed(steps, values);
        return values;
      },
      [&](std::size_t leaf, const std::vector<std::uint64_t>& values) {
        beside_[leaf] = {listed_.num_leaves(), values[0]};
        listed_.append(edges_in(std::span(values).subspan(3, 2 * values[1])));
        core_steps_.append(unpacked(std::span(values).subspan(3 + 2 * values[1]), values[2]));
      });
}

EdgeNumbering::Place EdgeNumbering::place_of(std::size_t leaf) const {
  if (first_own_ <= leaf && leaf < end_own_)
    return {leaf - first_own_, own_first_[leaf - first_own_]};
  const auto beside = beside_.find(leaf);
  if (beside == beside_.end())
    throw CorruptRecord(leaf_name(numbering_->leaves()[leaf]) + ": a cell far away has its edge",
                        numbering_->leaves()[leaf]);
  return beside->second;
}

}  // namespace locvol
