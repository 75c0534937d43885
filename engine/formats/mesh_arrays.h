// The arrays that VTK's formats are made of, in blocks of equal size: for compression.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "engine/formats/formats.h"
#include "engine/formats/vtu_header.h"
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
  kBody,  // 0: of what is no tetrahedron
  kSheet,
  kCrease,
  kCorner,  // of vertices
  kTypes,
};

inline constexpr std::uint8_t kVtkVertex = 1, kVtkLine = 3, kVtkTriangle = 5, kVtkTetra = 10,
                              kVtkQuadraticEdge = 21, kVtkQuadraticTriangle = 22,
                              kVtkQuadraticTetra = 24;
// Of what is no tetrahedron, and so is not measured.
inline constexpr float kNoQuality = std::numeric_limits<float>::quiet_NaN();
inline constexpr std::string_view kGlobalPointIds = "GlobalPointIds";

struct ArrayInfo {
  ArrayName array;
  std::string_view name, vtk_type;
  std::uint64_t num_components, value_bytes;
  std::uint64_t num_items;  // rows of num_components values
  bool is_cell_data = false;

  std::uint64_t item_bytes() const { return num_components * value_bytes; }
  std::uint64_t bytes() const { return num_items * item_bytes(); }
};

// The cells of a file, kind after kind: tetrahedra, and what is written with them of the boundary's
// facets, of edges of creases and of corners.
struct CellKind {
  std::uint8_t vtk_type;
  std::uint64_t num_vertices;  // of each, with the nodes of second order
  std::uint64_t count;
};
using CellKinds = std::array<CellKind, 4>;
inline CellKinds cell_kinds(const MeshCounts& n) {
  const bool is_second = n.order == 2;
  return {
      {{is_second ? kVtkQuadraticTetra : kVtkTetra, num_corners_of_cell(n.order), n.num_cells},
       {is_second ? kVtkQuadraticTriangle : kVtkTriangle, num_corners_of_facet(n.order),
        n.num_boundary_facets},
       {is_second ? kVtkQuadraticEdge : kVtkLine, num_corners_of_edge(n.order), n.num_crease_edges},
       {kVtkVertex, 1, n.num_corners}}};
}
inline std::uint64_t num_cells(const CellKinds& kinds) {
  std::uint64_t num = 0;
  for (const CellKind& kind : kinds) num += kind.count;
  return num;
}
// How many vertices the cells before this one have. REQUIRES: `cell` is at most the number of all
inline std::uint64_t corners_before(std::uint64_t cell, const CellKinds& kinds) {
  std::uint64_t num = 0;
  for (const CellKind& kind : kinds) {
    const std::uint64_t of_kind = std::min(cell, kind.count);
    num += kind.num_vertices * of_kind;
    cell -= of_kind;
  }
  return num;
}
// The least that hold the numbers of a mesh.
IndexWidths index_widths(const MeshCounts& n);
// What is written of a mesh with these options. All ranks call it.
MeshCounts counts_of(MeshSource& mesh, const OutputOptions& output);
// What values of `sheet` and `crease` mean that the input has names for, if they are written.
// `forbidden`: see NameRule
std::vector<VtuField> name_fields(const MeshSource& mesh, const OutputOptions& output,
                                  std::string_view forbidden = {});

// Values of eight bytes come first, then those of four, then bytes: each lies at a multiple of its
// size if the first one does, even with heads of eight bytes between them. `is_part`: with the
// vertices' numbers in the mesh of all ranks.
std::vector<ArrayInfo> mesh_arrays(const MeshCounts& n, const OutputOptions& output,
                                   const IndexWidths& widths, bool is_part = false);

// What connectivity_bytes() needs room for.
struct ConnectivityBuffer {
  std::vector<std::int32_t> narrow;
  std::vector<std::int64_t> wide;
};
// The vertices of cells, and of second order each cell's nodes after them, in values of so many
// bytes: the cells' own, or those of the buffer, which it fills. REQUIRES: they fit
template <std::size_t num_corners, std::size_t num_nodes>
std::span<const std::byte> connectivity_bytes(
    const std::vector<std::array<std::int64_t, num_corners>>& cells,
    const std::vector<std::array<std::int64_t, num_nodes>>& nodes, std::uint64_t value_bytes,
    ConnectivityBuffer& buffer) {
  const bool is_wide = value_bytes == sizeof(std::int64_t);
  if (is_wide && nodes.empty()) return std::as_bytes(std::span(cells));
  const auto filled = [&]<class Value>(std::vector<Value>& values) {
    values.resize((num_corners + (nodes.empty() ? 0 : num_nodes)) * cells.size());
    auto out = values.begin();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      for (const std::int64_t vertex : cells[i]) *out++ = static_cast<Value>(vertex);
      if (nodes.empty()) continue;
      for (const std::int64_t node : nodes[i]) *out++ = static_cast<Value>(node);
    }
    return std::as_bytes(std::span(values));
  };
  return is_wide ? filled(buffer.wide) : filled(buffer.narrow);
}
// The places where `count` cells, from `first` on, begin among the vertices of all cells.
std::vector<std::byte> offset_bytes(std::uint64_t first, std::uint64_t count,
                                    std::uint64_t value_bytes, const CellKinds& kinds);
// Of some vertices, from `first` on: `corners` are in their order.
std::vector<std::uint32_t> corners_of(std::span<const KeptCorner> corners, std::uint64_t first,
                                      std::uint64_t count);

// Blocks of a mesh's arrays. A rank's items come in one run, or in several: of its tetrahedra and,
// after those of all ranks, of its triangles, and so on. A block is of that run which has its first
// item: others tell its rank the rest.
class ArrayBlocks {
 public:
  // With the quality, all cells are measured first, which takes 8 bytes each, in nameless files
  // beside the output.
  ArrayBlocks(MeshSource& mesh, const OutputOptions& options, const std::filesystem::path& output);

  struct Block {
    std::uint64_t first = 0, count = 0;  // items
    std::vector<std::byte> bytes;        // empty: known by formula
  };
  // Those of a run of the rank's, one after another: each has `block_items` items of the array, the
  // last one of all may have fewer.
  struct Blocks {
    ArrayInfo info;
    std::function<std::optional<Block>()> next;
  };
  // Of each run. As many on all ranks, which all call it.
  std::vector<Blocks> blocks(const ArrayInfo& info, std::uint64_t block_items);

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
  struct Run {
    NumberRange own;                    // items
    ReadItems read;                     // null: all are known by formula, wherever they are
    std::vector<std::byte> after = {};  // items of its last block that others have
  };

  std::vector<Run> runs_of(const ArrayInfo& info);
  ReadItems cell_reader(const ArrayInfo& info);
  ReadItems triangle_reader(const ArrayInfo& info);
  ReadItems line_reader(const ArrayInfo& info);
  ReadItems corner_reader(const ArrayInfo& info);
  void tell_items(const ArrayInfo& info, std::uint64_t block_items, std::vector<Run>& runs);
  std::function<std::optional<Block>()> blocks_of(const ArrayInfo& info, std::uint64_t block_items,
                                                  Run run) const;
  std::vector<std::byte> computed(const ArrayInfo& info, const Block& block) const;
  void measure(const std::filesystem::path& output);

  MeshSource& mesh_;
  MeshCounts counts_;
  CellKinds kinds_;
  bool has_triangles_;
  std::vector<KeptCorner> corners_;  // by vertex, where the array is written
  std::optional<OpenFile> ratios_, angles_;
};

}  // namespace locvol
