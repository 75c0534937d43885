#include "engine/formats/mesh_arrays.h"

#include <cassert>
#include <cstring>

namespace locvol {
namespace {

template <class T>
std::vector<std::byte> bytes_of(const std::vector<T>& values) {
  const auto bytes = std::as_bytes(std::span(values));
  return {bytes.begin(), bytes.end()};
}

// Takes items off pieces, in runs of any length.
class ItemReader {
 public:
  ItemReader(std::function<std::optional<MeshPiece>()> pieces, ArrayName array)
      : pieces_(std::move(pieces)), array_(array) {}

  void read(std::span<std::byte> out) {
    while (!out.empty()) {
      std::span<const std::byte> held = items().subspan(taken_);
      if (held.empty()) {
        piece_ = pieces_();
        assert(piece_.has_value());
        taken_ = 0;
        continue;
      }
      held = held.first(std::min(held.size(), out.size()));
      std::memcpy(out.data(), held.data(), held.size());
      out = out.subspan(held.size());
      taken_ += held.size();
    }
  }

 private:
  std::span<const std::byte> items() const {
    if (!piece_) return {};
    return array_ == ArrayName::kPoints ? std::as_bytes(std::span(piece_->points))
                                        : std::as_bytes(std::span(piece_->cells));
  }

  std::function<std::optional<MeshPiece>()> pieces_;
  ArrayName array_;
  std::optional<MeshPiece> piece_;
  std::size_t taken_ = 0;  // bytes
};

}  // namespace

std::vector<ArrayInfo> mesh_arrays(const MeshSource& mesh, bool has_quality) {
  const std::uint64_t num_vertices = mesh.num_vertices(), num_cells = mesh.num_cells();
  std::vector<ArrayInfo> arrays = {
      {ArrayName::kPoints, "Points", "Float64", 3, 8, num_vertices},
      {ArrayName::kConnectivity, "connectivity", "Int64", 4, 8, num_cells},
      {ArrayName::kEnds, "offsets", "Int64", 1, 8, num_cells},
      {ArrayName::kLeaf, "leaf", "UInt32", 1, 4, num_cells, true},
  };
  if (has_quality) {
    arrays.push_back(
        {ArrayName::kRadiusEdge, "radius_edge_ratio", "Float32", 1, 4, num_cells, true});
    arrays.push_back(
        {ArrayName::kDihedral, "min_dihedral_degrees", "Float32", 1, 4, num_cells, true});
  }
  arrays.push_back({ArrayName::kTypes, "types", "UInt8", 1, 1, num_cells});
  return arrays;
}

ArrayBlocks::ArrayBlocks(MeshSource& mesh, bool has_quality, const std::filesystem::path& output)
    : mesh_(mesh) {
  if (has_quality) measure(output);
}

void ArrayBlocks::measure(const std::filesystem::path& output) {
  ratios_.emplace(OpenFile::temporary(output));
  angles_.emplace(OpenFile::temporary(output));
  struct Columns {
    std::uint64_t first;
    std::vector<float> ratios, angles;
  };
  mesh_.for_each_piece(
      {.has_cells = true, .has_corners = true},
      [](const MeshPiece& piece) {
        Columns columns{piece.first_cell, {}, {}};
        for (const auto& [ratio, angle] : quality_of(piece)) {
          columns.ratios.push_back(ratio);
          columns.angles.push_back(angle);
        }
        return columns;
      },
      [&](const Columns& columns) {
        ratios_->write_at(sizeof(float) * columns.first, std::as_bytes(std::span(columns.ratios)));
        angles_->write_at(sizeof(float) * columns.first, std::as_bytes(std::span(columns.angles)));
      });
}

ArrayBlocks::NextBlock ArrayBlocks::blocks(const ArrayInfo& info, std::uint64_t block_items) {
  std::function<void(Block&, std::uint64_t)> fill = [](Block&, std::uint64_t) {};
  if (info.array == ArrayName::kPoints || info.array == ArrayName::kConnectivity) {
    const bool has_points = info.array == ArrayName::kPoints;
    const PieceParts parts = {.has_points = has_points, .has_cells = !has_points};
    fill = [items = ItemReader(mesh_.pieces(parts), info.array)](Block& block,
                                                                 std::uint64_t num_bytes) mutable {
      block.bytes.resize(num_bytes);
      items.read(block.bytes);
    };
  }
  if (info.array == ArrayName::kRadiusEdge || info.array == ArrayName::kDihedral) {
    fill = [&file = info.array == ArrayName::kDihedral ? *angles_ : *ratios_](
               Block& block, std::uint64_t num_bytes) {
      block.bytes.resize(num_bytes);
      file.read_at(sizeof(float) * block.first, block.bytes);
    };
  }
  return [=, first = std::uint64_t{0}]() mutable -> std::optional<Block> {
    Block block{first, std::min(block_items, info.num_items - first), {}};
    if (block.count == 0) return std::nullopt;
    fill(block, block.count * info.item_bytes());
    first += block.count;
    return block;
  };
}

std::vector<std::byte> ArrayBlocks::computed(ArrayName array, const Block& block) const {
  if (array == ArrayName::kLeaf) return bytes_of(mesh_.leaves_of_cells(block.first, block.count));
  if (array == ArrayName::kTypes) return std::vector(block.count, std::byte{kVtkTetra});
  const std::uint64_t first = block.first + (array == ArrayName::kEnds ? 1 : 0);
  std::vector<std::int64_t> offsets(block.count);
  for (std::uint64_t i = 0; i < block.count; ++i)
    offsets[i] = static_cast<std::int64_t>(4 * (first + i));
  return bytes_of(offsets);
}

}  // namespace locvol
