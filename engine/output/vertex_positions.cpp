#include "engine/output/vertex_positions.h"

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
  numbering_->for_each_listed(leaf, reader_->points(numbering_->leaves()[leaf]),
                              [&](const Point& p) { table.positions.push_back(p); });
  return table;
}

Point VertexPositions::of(std::uint64_t vertex) {
  const std::size_t leaf = numbering_->leaf_of(vertex);
  return tables_.get(leaf)->positions[vertex - numbering_->first_vertex(leaf)];
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
