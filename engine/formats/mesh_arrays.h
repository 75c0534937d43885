// The arrays that VTK's formats are made of, in blocks of equal size: for compression.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/output/mesh_source.h"
#include "engine/shared/encode_in_order.h"

namespace locvol {

enum class ArrayName {
  kPoints,
  kPointIds,
  kConnectivity,
  kEnds,    // of cells among the vertices of all
  kStarts,  // the same, from 0 on: one more
  kRadiusEdge,
  kDihedral,
  kLeaf,
  kTypes,
};

inline constexpr std::uint8_t kVtkTetra = 10;
inline constexpr std::string_view kGlobalPointIds = "GlobalPointIds";

struct ArrayInfo {
  ArrayName array;
  std::string_view name, vtk_type;
  std::uint64_t num_components, value_bytes;
  std::uint64_t num_items;  // of vertices or cells: rows of num_components values
  bool is_cell_data = false;

  std::uint64_t item_bytes() const { return num_components * value_bytes; }
  std::uint64_t bytes() const { return num_items * item_bytes(); }
};

// The least that hold the numbers of a mesh.
IndexWidths index_widths(std::uint64_t num_vertices, std::uint64_t num_cells);

// Values of eight bytes come first, then those of four, then bytes: each lies at a multiple of its
// size if the first one does, even with heads of eight bytes between them. `is_part`: with the
// vertices' numbers in the mesh of all ranks.
std::vector<ArrayInfo> mesh_arrays(std::uint64_t num_vertices, std::uint64_t num_cells,
                                   bool has_quality, const IndexWidths& widths,
                                   bool is_part = false);

using NarrowCell = std::array<std::int32_t, 4>;
// The vertices of cells in values of so many bytes: the cells' own, or those of `narrow`, which it
// fills. REQUIRES: they fit
std::span<const std::byte> connectivity_bytes(std::span<const MeshPiece::Cell> cells,
                                              std::uint64_t value_bytes,
                                              std::vector<NarrowCell>& narrow);
// The places where `count` cells, from `first` on, begin among the vertices of all cells.
std::vector<std::byte> offset_bytes(std::uint64_t first, std::uint64_t count,
                                    std::uint64_t value_bytes);

// Blocks of a mesh's arrays. A block is that rank's which has its first item: others tell it the
// rest.
class ArrayBlocks {
 public:
  // `has_quality`: all cells are measured first, which takes 8 bytes each, in nameless files beside
  // the output.
  ArrayBlocks(MeshSource& mesh, bool has_quality, const std::filesystem::path& output);

  struct Block {
    std::uint64_t first = 0, count = 0;  // items
    std::vector<std::byte> bytes;        // empty: known by formula
  };
  // The rank's blocks, one after another: each has `block_items` items of the array, the last one
  // of all may have fewer. All ranks call it.
  struct Blocks {
    ArrayInfo info;
    std::function<std::optional<Block>()> next;
  };
  Blocks blocks(const ArrayInfo& info, std::uint64_t block_items);

  // Calls take(encode(bytes)) for each of them. encode on any thread, take in order.
  template <class Encode, class Take>
  void for_each(const Blocks& blocks, const Encode& encode, Take take) {
    encode_in_order(
        mesh_.workers(), blocks.next,
        [&](const Block& block) {
          return block.bytes.empty()
                     ? encode(std::span<const std::byte>(computed(blocks.info, block)))
                     : encode(std::span<const std::byte>(block.bytes));
        },
        take);
  }

 private:
  // Reads items from `first` on into what is given; those of pieces front to back alone.
  using ReadItems = std::function<void(std::uint64_t first, std::span<std::byte> out)>;

  NumberRange own_items(const ArrayInfo& info) const;
  ReadItems reader_of(const ArrayInfo& info);
  std::vector<std::byte> items_after(const ArrayInfo& info, std::uint64_t block_items,
                                     const ReadItems& read);
  std::vector<std::byte> computed(const ArrayInfo& info, const Block& block) const;
  void measure(const std::filesystem::path& output);

  MeshSource& mesh_;
  std::optional<OpenFile> ratios_, angles_;
};

}  // namespace locvol
