#include "engine/formats/mesh_arrays.h"

#include <cassert>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "engine/formats/limits.h"
#include "engine/formats/outputs.h"

namespace locvol {
namespace {

template <class T>
std::vector<std::byte> bytes_of(const std::vector<T>& values) {
  const auto bytes = std::as_bytes(std::span(values));
  return {bytes.begin(), bytes.end()};
}

std::string_view vtk_int(std::uint64_t value_bytes) { return value_bytes == 4 ? "Int32" : "Int64"; }

template <class Int>
std::vector<std::byte> offsets_from(std::uint64_t first, std::uint64_t count) {
  std::vector<std::byte> bytes(count * sizeof(Int));
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto offset = static_cast<Int>(4 * (first + i));
    std::memcpy(&bytes[i * sizeof(Int)], &offset, sizeof(Int));
  }
  return bytes;
}

// Those that begin before an item.
std::uint64_t num_blocks(std::uint64_t item, std::uint64_t block_items) {
  return block_items == 0 ? 0 : (item + block_items - 1) / block_items;
}

// Takes items off pieces, in runs of any length.
class ItemReader {
 public:
  ItemReader(std::function<std::optional<MeshPiece>()> pieces, const ArrayInfo& info)
      : pieces_(std::move(pieces)), info_(info) {}

  // REQUIRES: whole items
  void read(std::span<std::byte> out) {
    while (!out.empty()) {
      if (taken_ == num_items()) {
        piece_ = pieces_();
        assert(piece_.has_value());
        taken_ = 0;
        continue;
      }
      const auto bytes = take(std::min(num_items() - taken_, out.size() / info_.item_bytes()));
      std::memcpy(out.data(), bytes.data(), bytes.size());
      out = out.subspan(bytes.size());
    }
  }

 private:
  bool is_points() const { return info_.array == ArrayName::kPoints; }
  std::size_t num_items() const {
    if (!piece_) return 0;
    return is_points() ? piece_->points.size() : piece_->cells.size();
  }
  std::span<const std::byte> take(std::size_t count) {
    const std::size_t first = std::exchange(taken_, taken_ + count);
    if (is_points()) return std::as_bytes(std::span(piece_->points).subspan(first, count));
    return connectivity_bytes(std::span(piece_->cells).subspan(first, count), info_.value_bytes,
                              narrow_);
  }

  std::function<std::optional<MeshPiece>()> pieces_;
  ArrayInfo info_;
  std::optional<MeshPiece> piece_;
  std::size_t taken_ = 0;  // items
  std::vector<NarrowCell> narrow_;
};

}  // namespace

IndexWidths index_widths(std::uint64_t num_vertices, std::uint64_t num_cells) {
  return {num_vertices <= kMaxInt32 ? 4u : 8u, num_cells <= kMaxInt32 / 4 ? 4u : 8u};
}

std::vector<ArrayInfo> mesh_arrays(std::uint64_t num_vertices, std::uint64_t num_cells,
                                   bool has_quality, const IndexWidths& widths, bool is_part) {
  std::vector<ArrayInfo> arrays = {
      {ArrayName::kPoints, "Points", "Float64", 3, 8, num_vertices},
      {ArrayName::kConnectivity, "connectivity", vtk_int(widths.connectivity), 4,
       widths.connectivity, num_cells},
      {ArrayName::kEnds, "offsets", vtk_int(widths.offsets), 1, widths.offsets, num_cells},
      {ArrayName::kLeaf, "leaf", "UInt32", 1, 4, num_cells, true},
  };
  if (is_part)
    arrays.push_back({ArrayName::kPointIds, kGlobalPointIds, "Int64", 1, 8, num_vertices});
  if (has_quality) {
    arrays.push_back(
        {ArrayName::kRadiusEdge, "radius_edge_ratio", "Float32", 1, 4, num_cells, true});
    arrays.push_back(
        {ArrayName::kDihedral, "min_dihedral_degrees", "Float32", 1, 4, num_cells, true});
  }
  arrays.push_back({ArrayName::kTypes, "types", "UInt8", 1, 1, num_cells});
  std::ranges::stable_sort(arrays, std::greater<>(), &ArrayInfo::value_bytes);
  return arrays;
}

std::span<const std::byte> connectivity_bytes(std::span<const MeshPiece::Cell> cells,
                                              std::uint64_t value_bytes,
                                              std::vector<NarrowCell>& narrow) {
  if (value_bytes == sizeof(std::int64_t)) return std::as_bytes(cells);
  narrow.resize(cells.size());
  for (std::size_t i = 0; i < cells.size(); ++i)
    for (std::size_t k = 0; k < 4; ++k) narrow[i][k] = static_cast<std::int32_t>(cells[i][k]);
  return std::as_bytes(std::span(narrow));
}

std::vector<std::byte> offset_bytes(std::uint64_t first, std::uint64_t count,
                                    std::uint64_t value_bytes) {
  return value_bytes == 4 ? offsets_from<std::int32_t>(first, count)
                          : offsets_from<std::int64_t>(first, count);
}

ArrayBlocks::ArrayBlocks(MeshSource& mesh, bool has_quality, const std::filesystem::path& output)
    : mesh_(mesh) {
  if (has_quality) do_on_all(mesh.exchange(), [&] { measure(output); });
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

// Of offsets from 0 on, the last one, which is no cell's, is the last rank's.
NumberRange ArrayBlocks::own_items(const ArrayInfo& info) const {
  if (info.array == ArrayName::kPoints || info.array == ArrayName::kPointIds)
    return mesh_.own_vertices();
  NumberRange own = mesh_.own_cells();
  const Exchange& exchange = mesh_.exchange();
  const bool is_last = exchange.rank() + 1 == exchange.num_ranks();
  if (info.array != ArrayName::kStarts || !is_last) return own;
  return {own.size() > 0 ? own.first : mesh_.num_cells(), mesh_.num_cells() + 1};
}

// Null: all are known by formula, wherever they are.
ArrayBlocks::ReadItems ArrayBlocks::reader_of(const ArrayInfo& info) {
  switch (info.array) {
    case ArrayName::kPoints:
    case ArrayName::kConnectivity: {
      const bool has_points = info.array == ArrayName::kPoints;
      const PieceParts parts = {.has_points = has_points, .has_cells = !has_points};
      return [items = std::make_shared<ItemReader>(mesh_.pieces(parts), info)](
                 std::uint64_t, std::span<std::byte> out) { items->read(out); };
    }
    case ArrayName::kRadiusEdge:
    case ArrayName::kDihedral:
      return [&file = info.array == ArrayName::kDihedral ? *angles_ : *ratios_](
                 std::uint64_t first, std::span<std::byte> out) {
        file.read_at(sizeof(float) * first, out);
      };
    case ArrayName::kLeaf:
      return [this](std::uint64_t first, std::span<std::byte> out) {
        const auto leaves = mesh_.leaves_of_cells(first, out.size() / sizeof(std::uint32_t));
        if (!out.empty()) std::memcpy(out.data(), leaves.data(), out.size());
      };
    default:
      return nullptr;
  }
}

// All ranks call it: each tells its items before its first block to the rank whose block has them.
// Gives those of the rank's last block that others have.
std::vector<std::byte> ArrayBlocks::items_after(const ArrayInfo& info, std::uint64_t block_items,
                                                const ReadItems& read) {
  Exchange& exchange = mesh_.exchange();
  const NumberRange own = own_items(info);
  const std::vector<std::uint64_t> firsts = gather_numbers(exchange, own.first),
                                   ends = gather_numbers(exchange, own.end);
  const std::uint64_t first_block = block_items * num_blocks(own.first, block_items);
  std::vector<std::string> told(firsts.size());
  do_on_all(exchange, [&] {
    if (own.size() == 0 || own.first == first_block) return;
    const std::uint64_t start = first_block - block_items;
    std::size_t rank = 0;
    while (!(firsts[rank] <= start && start < ends[rank])) ++rank;
    told[rank].resize((std::min(first_block, own.end) - own.first) * info.item_bytes());
    read(own.first, std::as_writable_bytes(std::span(told[rank])));
  });
  std::vector<std::byte> after;
  for (const std::string& items : exchange.swap(std::move(told))) {
    const auto bytes = std::as_bytes(std::span(items));
    after.insert(after.end(), bytes.begin(), bytes.end());
  }
  return after;
}

ArrayBlocks::Blocks ArrayBlocks::blocks(const ArrayInfo& info, std::uint64_t block_items) {
  if (info.num_items == 0) return {info, [] { return std::nullopt; }};
  const NumberRange own = own_items(info);
  const ReadItems read = reader_of(info);
  std::vector<std::byte> after;
  if (read) after = items_after(info, block_items, read);
  const std::uint64_t first = block_items * num_blocks(own.first, block_items),
                      end =
                          std::min(info.num_items, block_items * num_blocks(own.end, block_items));
  const auto next_block = [=, next = first]() mutable -> std::optional<Block> {
    if (next >= end) return std::nullopt;
    Block block{next, std::min(block_items, end - next), {}};
    next += block.count;
    const std::uint64_t num_own = std::min(next, own.end) - block.first;
    if (!read || (info.array == ArrayName::kLeaf && num_own == block.count)) return block;
    block.bytes.resize(block.count * info.item_bytes());
    const auto of_own = std::span(block.bytes).first(num_own * info.item_bytes());
    read(block.first, of_own);
    if (num_own == block.count) return block;
    if (after.size() != block.bytes.size() - of_own.size())
      throw ExchangeError("ranks disagree on who has which items: this is a bug of locvol");
    std::ranges::copy(after, block.bytes.begin() + static_cast<std::ptrdiff_t>(of_own.size()));
    return block;
  };
  return {info, next_block};
}

std::vector<std::byte> ArrayBlocks::computed(const ArrayInfo& info, const Block& block) const {
  if (info.array == ArrayName::kLeaf)
    return bytes_of(mesh_.leaves_of_cells(block.first, block.count));
  if (info.array == ArrayName::kPointIds)
    return bytes_of(mesh_.numbers_of(block.first, block.count));
  if (info.array == ArrayName::kTypes) return std::vector(block.count, std::byte{kVtkTetra});
  const std::uint64_t first = block.first + (info.array == ArrayName::kEnds ? 1 : 0);
  return offset_bytes(first, block.count, info.value_bytes);
}

}  // namespace locvol
