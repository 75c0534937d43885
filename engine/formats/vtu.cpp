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
  return info.array == ArrayName::kPointIds ? VtuSection::kPointData : VtuSection::kCells;
}

// `offsets`: of the arrays, after the mark
std::string header(const std::vector<ArrayInfo>& arrays, const std::vector<std::uint64_t>& offsets,
                   const MeshSource& mesh, bool is_compressed) {
  std::vector<VtuArrayEntry> entries;
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    const ArrayInfo& info = arrays[i];
    const bool is_points = info.array == ArrayName::kPoints;
    entries.push_back({section_of(info), std::string(info.name), std::string(info.vtk_type),
                       is_points ? info.num_components : 1, offsets[i],
                       info.array == ArrayName::kPointIds});
  }
  return vtu_header(mesh.num_vertices(), mesh.num_cells(), entries, is_compressed);
}

std::vector<ArrayInfo> vtu_arrays(const MeshSource& mesh, bool has_quality,
                                  const IndexWidths& least) {
  const std::uint64_t num_vertices = mesh.num_vertices(), num_cells = mesh.num_cells();
  const auto [connectivity, offsets] = index_widths(num_vertices, num_cells);
  return mesh_arrays(num_vertices, num_cells, has_quality,
                     {std::max(connectivity, least.connectivity), std::max(offsets, least.offsets)},
                     mesh.part().has_value());
}

// ---- Raw: the head of an array is the number of its bytes ---------------------------------------

constexpr std::uint64_t kCountBytes = 8;

class RawArrays {
 public:
  RawArrays(MeshSource& mesh, bool has_quality, PartialFile& file, const IndexWidths& least)
      : mesh_(mesh), arrays_(vtu_arrays(mesh, has_quality, least)), file_(file), out_(file) {}

  std::uint64_t write() {
    std::uint64_t end = 0;
    for (const ArrayInfo& array : arrays_) {
      offsets_.push_back(end);
      end += kCountBytes + array.bytes();
    }
    const std::string head = header(arrays_, offsets_, mesh_, false);
    data_ = head.size();
    const std::uint64_t bytes = data_ + end + kVtuFooter.size();
    const bool has_quality = place(ArrayName::kRadiusEdge) < arrays_.size();
    do_on_all(mesh_.exchange(), [&] {
      if (mesh_.is_of_first_rank()) write_frame(head, bytes);
      mesh_.for_each_piece(
          {.has_points = true, .has_cells = true, .has_corners = has_quality},
          [&](const MeshPiece& piece) {
            write_piece(piece, has_quality);
            return true;
          },
          [](bool) {});
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

  void write_piece(const MeshPiece& piece, bool has_quality) {
    const std::uint64_t num_cells = piece.cells.size(), first_cell = piece.first_cell;
    std::vector<NarrowCell> narrow;
    const auto connectivity =
        connectivity_bytes(piece.cells, info(ArrayName::kConnectivity).value_bytes, narrow);
    const std::vector<std::byte> ends =
        offset_bytes(first_cell + 1, num_cells, info(ArrayName::kEnds).value_bytes);
    const std::vector<std::uint8_t> types(num_cells, kVtkTetra);
    const std::vector<std::uint32_t> leaves = leaves_of(piece);
    std::vector<std::int64_t> numbers;
    std::vector<float> ratios, angles;
    std::vector<PlacedFile::Part> parts = {
        part(ArrayName::kPoints, piece.first_vertex, piece.points),
        part(ArrayName::kConnectivity, first_cell, connectivity),
        part(ArrayName::kEnds, first_cell, ends), part(ArrayName::kLeaf, first_cell, leaves),
        part(ArrayName::kTypes, first_cell, types)};
    if (mesh_.part()) {
      numbers = mesh_.numbers_of(piece.first_vertex, piece.points.size());
      parts.push_back(part(ArrayName::kPointIds, piece.first_vertex, numbers));
    }
    if (has_quality) {
      for (const auto& [ratio, angle] : quality_of(piece)) {
        ratios.push_back(ratio);
        angles.push_back(angle);
      }
      parts.push_back(part(ArrayName::kRadiusEdge, first_cell, ratios));
      parts.push_back(part(ArrayName::kDihedral, first_cell, angles));
    }
    out_.write(parts);
  }

  MeshSource& mesh_;
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
  const auto blocks = arrays.blocks(array, block_items);
  std::vector<std::uint64_t> sizes;
  out.append_run([&](const auto& append) {
    arrays.for_each(blocks, deflated, [&](const std::vector<std::byte>& block) {
      sizes.push_back(block.size());
      append.put(block);
    });
  });
  const auto bytes = std::as_bytes(std::span(sizes));
  before.append_run([&](const auto& append) { append.put(bytes); }, bytes.size());
  offset = out.size();
}

}  // namespace

std::uint64_t write_vtu(MeshSource& mesh, bool has_quality, PartialFile& file,
                        const IndexWidths& least) {
  return RawArrays(mesh, has_quality, file, least).write();
}

std::uint64_t write_compressed_vtu(MeshSource& mesh, bool has_quality, PartialFile& file,
                                   const IndexWidths& least) {
  const std::vector<ArrayInfo> arrays = vtu_arrays(mesh, has_quality, least);
  std::vector<std::uint64_t> offsets(arrays.size());
  const std::uint64_t data = header(arrays, offsets, mesh, true).size();
  ArrayBlocks blocks(mesh, has_quality, file.name());
  std::uint64_t end = data;
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    offsets[i] = end - data;
    write_compressed(arrays[i], blocks, mesh.exchange(), file, end);
  }
  AppendedFile(file, mesh.exchange()).append(header(arrays, offsets, mesh, true));
  AppendedFile foot(file, mesh.exchange(), end);
  foot.append(kVtuFooter);
  return foot.size();
}

}  // namespace locvol
