#include "engine/output/vertex_positions.h"

#include <algorithm>

namespace locvol {
namespace {

constexpr std::size_t kPositionBytes = std::size_t{8} << 20;

}  // namespace

VertexPositions::VertexPositions(const Reader& reader, const VertexNumbering& numbering,
                                 int num_shares)
    : reader_(&reader),
      numbering_(&numbering),
      tables_(kPositionBytes / static_cast<std::size_t>(num_shares),
              [this](std::size_t leaf) { return load(leaf); }) {}

VertexPositions::Table VertexPositions::load(std::size_t leaf) const {
  Table table;
  table.positions.reserve(numbering_->first_core_vertex(leaf) - numbering_->first_vertex(leaf));
  const LeafPoints points = reader_->points(numbering_->leaves()[leaf]);
  numbering_->for_each_listed(leaf, points, [&](const Point& p) { table.positions.push_back(p); });
  if (!points.core.is_empty())
    for_each_row(points.core, numbering_->sites(leaf),
                 [&](const LatticeRow& row, std::uint64_t num_before) {
                   table.rows.push_back(row);
                   table.before.push_back(num_before);
                 });
  return table;
}

Point VertexPositions::of(std::uint64_t vertex) {
  if (vertex < first_ || vertex >= end_) {
    const std::size_t leaf = numbering_->leaf_of(vertex);
    last_ = tables_.get(leaf);
    first_ = numbering_->first_vertex(leaf);
    end_ = numbering_->first_vertex(leaf + 1);
  }
  const std::uint64_t place = vertex - first_;
  if (place < last_->positions.size()) return last_->positions[place];
  const std::uint64_t in_core = place - last_->positions.size();
  const auto next = std::ranges::upper_bound(last_->before, in_core);
  const auto row = static_cast<std::size_t>(next - last_->before.begin()) - 1;
  const auto& [i, j, k] = last_->rows[row].first;
  return numbering_->lattice().position(
      {i, j, k + 2 * static_cast<std::int32_t>(in_core - last_->before[row])});
}

Point VertexPositions::of(std::uint64_t vertex, std::uint64_t id) {
  return numbering_->is_core(vertex) ? numbering_->lattice().position(site_of(id)) : of(vertex);
}

std::vector<Point> VertexPositions::of(std::span<const std::uint64_t> ids,
                                       std::span<const std::int64_t> numbers) {
  std::vector<Point> positions(ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (numbers[i] >= 0) positions[i] = of(static_cast<std::uint64_t>(numbers[i]), ids[i]);
  }
  return positions;
}

}  // namespace locvol
