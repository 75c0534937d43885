#include "engine/vertex_positions.h"

namespace locvol {
namespace {

constexpr std::size_t kTableBytes = std::size_t{8} << 20;

}  // namespace

VertexPositions::VertexPositions(const Reader& reader, const VertexNumbering& numbering)
    : reader_(&reader),
      numbering_(&numbering),
      tables_(kTableBytes, [this](std::size_t leaf) { return load(leaf); }) {}

VertexPositions::Table VertexPositions::load(std::size_t leaf) const {
  const std::vector<std::uint64_t> used = numbering_->used_ids(leaf);
  Table table;
  table.positions.reserve(used.size());
  auto next = used.begin();
  for (const MeshPoint& point : reader_->points(numbering_->leaves()[leaf]).points) {
    if (next == used.end() || point.id != *next) continue;
    table.positions.push_back(point.position);
    ++next;
  }
  return table;
}

Point VertexPositions::of(std::uint64_t vertex) {
  const std::size_t leaf = numbering_->leaf_of(vertex);
  return tables_.get(leaf)->positions[vertex - numbering_->first_vertex(leaf)];
}

std::vector<Point> VertexPositions::of(std::span<const std::uint64_t> ids,
                                       std::span<const std::int64_t> numbers) {
  std::vector<Point> positions(ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (numbers[i] < 0) continue;
    const auto vertex = static_cast<std::uint64_t>(numbers[i]);
    positions[i] =
        numbering_->is_core(vertex) ? numbering_->lattice().position(site_of(ids[i])) : of(vertex);
  }
  return positions;
}

}  // namespace locvol
