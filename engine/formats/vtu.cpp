#include <algorithm>
#include <array>
#include <bit>
#include <string>

#include "engine/formats/deflate.h"
#include "engine/formats/formats.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/outputs.h"
#include "engine/formats/vtu_header.h"

namespace locvol {
namespace {

VtuSection section_of(const ArrayInfo& info) {
  if (info.is_cell_data) return VtuSection::kCellData;
  if (info.array == ArrayName::kPoints) return VtuSection::kPoints;
  const bool is_of_points = info.array == ArrayName::kPointIds || info.array == ArrayName::kCorner;
  return is_of_points ? VtuSection::kPointData : VtuSection::kCells;
}

// `offsets`: of the arrays, after the mark
std::string header(const std::vector<ArrayInfo>& arrays, const std::vector<std::uint64_t>& offsets,
                   const MeshCounts& counts, const std::vector<VtuField>& fields,
                   bool is_compressed) {
  std::vector<VtuArrayEntry> entries;
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    const ArrayInfo& info = arrays[i];
    const bool is_points = info.array == ArrayName::kPoints;
    entries.push_back({section_of(info), std::string(info.name), std::string(info.vtk_type),
                       is_points ? info.num_components : 1, offsets[i],
                       info.array == ArrayName::kPointIds});
  }
  return vtu_header(counts.num_vertices, num_cells(cell_kinds(counts)), entries, is_compressed,
                    fields);
}

std::vector<ArrayInfo> vtu_arrays(const MeshSource& mesh, const MeshCounts& counts,
                                  const OutputOptions& output, const IndexWidths& least) {
  const auto [connectivity, offsets] = index_widths(counts);
  return mesh_arrays(counts, output,
                     {std::max(connectivity, least.connectivity), std::max(offsets, least.offsets)},
                     mesh.part().has_value());
}

// ---- Raw: the head of an array is the number of its bytes ---------------------------------------

constexpr std::uint64_t kCountBytes = 8;

class RawArrays {
 public:
  RawArrays(MeshSource& mesh, const OutputOptions& output, PartialFile& file,
            const IndexWidths& least)
      : mesh_(mesh),
        output_(output),
        counts_(counts_of(mesh, output)),
        kinds_(cell_kinds(counts_)),
        arrays_(vtu_arrays(mesh, counts_, output, least)),
        file_(file),
        out_(file) {
    if (counts_.has_creases) corners_ = mesh.corners_by_vertex();
  }

  std::uint64_t write() {
    std::uint64_t end = 0;
    for (const ArrayInfo& array : arrays_) {
      offsets_.push_back(end);
      end += kCountBytes + array.bytes();
    }
    const std::string head = header(arrays_, offsets_, counts_, name_fields(mesh_, output_), false);
    data_ = head.size();
    const std::uint64_t bytes = data_ + end + kVtuFooter.size();
    do_on_all(mesh_.exchange(), [&] {
      if (mesh_.is_of_first_rank()) write_frame(head, bytes);
      mesh_.for_each_piece(
          {.has_points = true,
           .has_cells = true,
           .has_corners = output_.has_quality,
           .has_node_points = true},
          [&](const MeshPiece& piece) {
            write_piece(piece);
            return true;
          },
          [](bool) {});
      if (output_.has_boundary)
        encode_in_order(
            mesh_.workers(), mesh_.triangles(),
            [&](const TrianglePiece& piece) {
              write_triangles(piece);
              return true;
            },
            [](bool) {});
      if (counts_.has_creases) {
        encode_in_order(
            mesh_.workers(), mesh_.lines(),
            [&](const LinePiece& piece) {
              write_lines(piece);
              return true;
            },
            [](bool) {});
        if (mesh_.is_of_first_rank()) write_corners();
      }
    });
    return bytes;
  }

 private:
  void write_frame(const std::string& head, std::uint64_t bytes) {
    file_.reserve(bytes);
    file_.write_at(0, std::as_bytes(std::span(head)));
    for (std::size_t i = 0; i < arrays_.size(); ++i) {
      const std::uint64_t count = arrays_[i].bytes();
      file_.write_at(data_ + offsets_[i], std::as_bytes(std::span(&count, 1)));
    }
    file_.write_at(bytes - kVtuFooter.size(), std::as_bytes(std::span(kVtuFooter)));
  }

  std::size_t place(ArrayName name) const {
    return static_cast<std::size_t>(std::ranges::find(arrays_, name, &ArrayInfo::array) -
                                    arrays_.begin());
  }
  const ArrayInfo& info(ArrayName name) const { return arrays_[place(name)]; }
  PlacedFile::Part part(ArrayName name, std::uint64_t first,
                        std::span<const std::byte> bytes) const {
    return {data_ + offsets_[place(name)] + kCountBytes + first * info(name).item_bytes(), bytes};
  }
  template <class T>
  PlacedFile::Part part(ArrayName name, std::uint64_t first, const std::vector<T>& items) const {
    return part(name, first, std::as_bytes(std::span(items)));
  }

  enum Kind : std::size_t { kTetra, kTriangle, kLine, kVertex };  // of CellKinds

  // Cells of one kind.
  struct CellColumns {
    std::uint64_t first = 0;
    std::span<const std::byte> connectivity;
    std::vector<std::byte> ends;
    std::vector<std::uint8_t> types;
    std::vector<std::uint32_t> leaves;
    std::vector<BodyId> bodies;
    std::vector<SheetId> sheets;
    std::vector<CreaseId> creases;
    std::vector<float> ratios, angles;
  };
  // `first`: among those of their kind.
  CellColumns columns_of(std::size_t kind, std::uint64_t first, const auto& cells,
                         const auto& nodes, ConnectivityBuffer& buffer) const {
    for (std::size_t k = 0; k < kind; ++k) first += kinds_[k].count;
    CellColumns columns;
    columns.first = first;
    columns.connectivity =
        connectivity_bytes(cells, nodes, info(ArrayName::kConnectivity).value_bytes, buffer);
    columns.ends =
        offset_bytes(first + 1, cells.size(), info(ArrayName::kEnds).value_bytes, kinds_);
    columns.types.assign(cells.size(), kinds_[kind].vtk_type);
    if (counts_.has_bodies) columns.bodies.resize(cells.size());
    if (output_.has_boundary) columns.sheets.resize(cells.size());
    if (counts_.has_creases) columns.creases.resize(cells.size());
    if (output_.has_quality && kind > 0) {
      columns.ratios.assign(cells.size(), kNoQuality);
      columns.angles = columns.ratios;
    }
    return columns;
  }
  void add_parts(const CellColumns& columns, std::vector<PlacedFile::Part>& parts) const {
    parts.insert(parts.end(), {part(ArrayName::kConnectivity, corners_before(columns.first, kinds_),
                                    columns.connectivity),
                               part(ArrayName::kEnds, columns.first, columns.ends),
                               part(ArrayName::kLeaf, columns.first, columns.leaves),
                               part(ArrayName::kTypes, columns.first, columns.types)});
    if (counts_.has_bodies) parts.push_back(part(ArrayName::kBody, columns.first, columns.bodies));
    if (output_.has_boundary)
      parts.push_back(part(ArrayName::kSheet, columns.first, columns.sheets));
    if (counts_.has_creases)
      parts.push_back(part(ArrayName::kCrease, columns.first, columns.creases));
    if (output_.has_quality) {
      parts.push_back(part(ArrayName::kRadiusEdge, columns.first, columns.ratios));
      parts.push_back(part(ArrayName::kDihedral, columns.first, columns.angles));
    }
  }

  void write_piece(const MeshPiece& piece) {
    ConnectivityBuffer buffer;
    CellColumns columns = columns_of(kTetra, piece.first_cell, piece.cells, piece.nodes, buffer);
    columns.leaves = leaves_of(piece);
    if (counts_.has_bodies) columns.bodies = piece.bodies;
    std::vector<std::int64_t> numbers, node_numbers;
    std::vector<std::uint32_t> corners, node_corners;
    std::vector<PlacedFile::Part> parts = {
        part(ArrayName::kPoints, piece.first_vertex, piece.points)};
    if (!piece.node_points.empty())
      parts.push_back(part(ArrayName::kPoints, piece.first_node, piece.node_points));
    if (mesh_.part()) {
      numbers = mesh_.numbers_of(piece.first_vertex, piece.points.size());
      parts.push_back(part(ArrayName::kPointIds, piece.first_vertex, numbers));
      node_numbers = mesh_.numbers_of(piece.first_node, piece.node_points.size());
      parts.push_back(part(ArrayName::kPointIds, piece.first_node, node_numbers));
    }
    if (counts_.has_creases) {
      corners = corners_of(corners_, piece.first_vertex, piece.points.size());
      parts.push_back(part(ArrayName::kCorner, piece.first_vertex, corners));
      node_corners = corners_of(corners_, piece.first_node, piece.node_points.size());
      parts.push_back(part(ArrayName::kCorner, piece.first_node, node_corners));
    }
    if (output_.has_quality)
      for (const auto& [ratio, angle] : quality_of(piece)) {
        columns.ratios.push_back(ratio);
        columns.angles.push_back(angle);
      }
    add_parts(columns, parts);
    out_.write(parts);
  }

  void write_triangles(const TrianglePiece& piece) {
    ConnectivityBuffer buffer;
    CellColumns columns = columns_of(kTriangle, piece.first, piece.triangles, piece.nodes, buffer);
    columns.leaves = piece.leaves;
    columns.sheets = piece.sheets;
    write_cells(columns);
  }

  void write_lines(const LinePiece& piece) {
    ConnectivityBuffer buffer;
    CellColumns columns = columns_of(kLine, piece.first, piece.lines, piece.nodes, buffer);
    columns.leaves = piece.leaves;
    columns.creases = piece.creases;
    write_cells(columns);
  }

  void write_corners() {
    std::vector<std::array<std::int64_t, 1>> vertices;
    std::vector<std::uint32_t> leaves;
    for (const KeptCorner& corner : mesh_.corners()) {
      vertices.push_back({static_cast<std::int64_t>(corner.vertex)});
      leaves.push_back(static_cast<std::uint32_t>(corner.leaf));
    }
    ConnectivityBuffer buffer;
    CellColumns columns = columns_of(kVertex, 0, vertices, decltype(vertices)(), buffer);
    columns.leaves = leaves;
    write_cells(columns);
  }

  void write_cells(const CellColumns& columns) {
    std::vector<PlacedFile::Part> parts;
    add_parts(columns, parts);
    out_.write(parts);
  }

  MeshSource& mesh_;
  OutputOptions output_;
  MeshCounts counts_;
  CellKinds kinds_;
  std::vector<KeptCorner> corners_;  // by vertex
  std::vector<ArrayInfo> arrays_;
  std::vector<std::uint64_t> offsets_;
  std::uint64_t data_ = 0;  // where the arrays begin
  PartialFile& file_;
  PlacedFile out_;
};

// ---- Compressed: the head of an array says how large its blocks are -----------------------------

constexpr std::uint64_t kBlockBytes = std::uint64_t{1} << 20;

// The number of blocks, the bytes of each before compression, those of the last one if it is
// shorter, and then of each block after compression.
void write_compressed(const ArrayInfo& array, ArrayBlocks& arrays, Exchange& exchange,
                      PartialFile& file, std::uint64_t& offset) {
  const std::uint64_t block_items = kBlockBytes / std::bit_ceil(array.item_bytes());
  const std::uint64_t num_blocks = (array.num_items + block_items - 1) / block_items;
  const std::array<std::uint64_t, 3> head = {num_blocks, block_items * array.item_bytes(),
                                             array.num_items % block_items * array.item_bytes()};
  AppendedFile before(file, exchange, offset);
  before.append(std::as_bytes(std::span(head)));
  AppendedFile out(file, exchange, before.size() + 8 * num_blocks);
  for (const auto& blocks : arrays.blocks(array, block_items)) {
    std::vector<std::uint64_t> sizes;
    out.append_run([&](const auto& append) {
      arrays.for_each(blocks, deflated, [&](const std::vector<std::byte>& block) {
        sizes.push_back(block.size());
        append.put(block);
      });
    });
    const auto bytes = std::as_bytes(std::span(sizes));
    before.append_run([&](const auto& append) { append.put(bytes); }, bytes.size());
  }
  offset = out.size();
}

}  // namespace

std::uint64_t write_vtu(MeshSource& mesh, const OutputOptions& output, PartialFile& file,
                        const IndexWidths& least) {
  return RawArrays(mesh, output, file, least).write();
}

std::uint64_t write_compressed_vtu(MeshSource& mesh, const OutputOptions& output, PartialFile& file,
                                   const IndexWidths& least) {
  const MeshCounts counts = counts_of(mesh, output);
  const std::vector<ArrayInfo> arrays = vtu_arrays(mesh, counts, output, least);
  std::vector<std::uint64_t> offsets(arrays.size());
  const std::vector<VtuField> fields = name_fields(mesh, output);
  const std::uint64_t data = header(arrays, offsets, counts, fields, true).size();
  ArrayBlocks blocks(mesh, output, file.name());
  std::uint64_t end = data;
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    offsets[i] = end - data;
    write_compressed(arrays[i], blocks, mesh.exchange(), file, end);
  }
  AppendedFile(file, mesh.exchange()).append(header(arrays, offsets, counts, fields, true));
  AppendedFile foot(file, mesh.exchange(), end);
  foot.append(kVtuFooter);
  return foot.size();
}

}  // namespace locvol
