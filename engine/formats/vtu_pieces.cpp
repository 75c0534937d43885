#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/formats/mesh_arrays.h"
#include "engine/formats/outputs.h"
#include "engine/formats/vtu_header.h"
#include "engine/formats/writer.h"
#include "engine/output/mesh_chunks.h"
#include "engine/output/stored_mesh.h"
#include "engine/shared/partial_file.h"

namespace locvol {
namespace {

constexpr std::string_view kGlobalIds = "GlobalPointIds";

// The place of an array: its head is the number of its bytes.
struct PlacedArray {
  VtuSection section;
  std::string name, vtk_type;
  std::uint64_t num_components, value_bytes, num_items;
  std::uint64_t offset = 0;
  std::uint64_t bytes() const { return num_components * value_bytes * num_items; }
};

// The cells that a rank owns, and all of their vertices: its own, and then those of other ranks.
class PieceWriter {
 public:
  PieceWriter(ChunkReader& chunks, const VertexNumbering& numbering, PartialFile& file)
      : chunks_(chunks),
        file_(file),
        first_vertex_(numbering.first_vertex(numbering.first_own())),
        num_own_(numbering.first_vertex(numbering.end_own()) - first_vertex_) {}

  WriteSummary write() {
    find_foreign();
    place_arrays();
    std::uint64_t first_cell = 0;
    chunks_.for_each([&](const MeshChunk& chunk) {
      put_points(chunk);
      put_cells(chunk, first_cell);
      first_cell += chunk.cells.size();
    });
    put_foreign();
    return {num_own_ + foreign_.size(), num_cells_, bytes_, 0};
  }

 private:
  struct Foreign {
    std::uint64_t number = 0;
    MeshChunk::Vertex position{};
  };
  enum Array { kPoints, kConnectivity, kEnds, kIds, kTypes };

  bool is_own(std::uint64_t number) const {
    return number >= first_vertex_ && number - first_vertex_ < num_own_;
  }

  void find_foreign() {
    std::size_t num_known = 0;
    const auto unite = [&] {
      std::ranges::sort(foreign_, {}, &Foreign::number);
      const auto again = std::ranges::unique(foreign_, {}, &Foreign::number);
      foreign_.erase(again.begin(), again.end());
      num_known = foreign_.size();
    };
    chunks_.for_each([&](const MeshChunk& chunk) {
      num_cells_ += chunk.cells.size();
      for (std::size_t i = chunk.num_own; i < chunk.numbers.size(); ++i)
        if (!is_own(chunk.numbers[i])) foreign_.push_back({chunk.numbers[i], chunk.vertices[i]});
      if (foreign_.size() > 2 * num_known + 10000) unite();
    });
    unite();
  }

  void place_arrays() {
    const std::uint64_t num_points = num_own_ + foreign_.size();
    arrays_ = {{VtuSection::kPoints, "Points", "Float64", 3, 8, num_points},
               {VtuSection::kCells, "connectivity", "Int64", 1, 8, 4 * num_cells_},
               {VtuSection::kCells, "offsets", "Int64", 1, 8, num_cells_},
               {VtuSection::kPointData, std::string(kGlobalIds), "Int64", 1, 8, num_points},
               {VtuSection::kCells, "types", "UInt8", 1, 1, num_cells_}};
    std::vector<VtuArrayEntry> entries;
    std::uint64_t end = 0;
    for (PlacedArray& array : arrays_) {
      array.offset = end;
      entries.push_back({array.section, array.name, array.vtk_type, array.num_components,
                         array.offset, array.section == VtuSection::kPointData});
      end += 8 + array.bytes();
    }
    const std::string head = vtu_header(num_points, num_cells_, entries);
    data_ = head.size();
    bytes_ = data_ + end + kVtuFooter.size();
    file_.reserve(bytes_);
    file_.write_at(0, std::as_bytes(std::span(head)));
    for (const PlacedArray& array : arrays_) {
      const std::uint64_t count = array.bytes();
      file_.write_at(data_ + array.offset, std::as_bytes(std::span(&count, 1)));
    }
    file_.write_at(bytes_ - kVtuFooter.size(), std::as_bytes(std::span(kVtuFooter)));
  }

  template <class T>
  void put(Array which, std::uint64_t first_item, const std::vector<T>& items) {
    const PlacedArray& array = arrays_[which];
    file_.write_at(data_ + array.offset + 8 + first_item * array.num_components * array.value_bytes,
                   std::as_bytes(std::span(items)));
  }

  void put_points(const MeshChunk& chunk) {
    const std::uint64_t first = chunk.first_vertex - first_vertex_;
    const auto own = static_cast<std::ptrdiff_t>(chunk.num_own);
    put(kPoints, first,
        std::vector<MeshChunk::Vertex>(chunk.vertices.begin(), chunk.vertices.begin() + own));
    put(kIds, first, std::vector<std::int64_t>(chunk.numbers.begin(), chunk.numbers.begin() + own));
  }

  void put_foreign() {
    std::vector<MeshChunk::Vertex> positions;
    std::vector<std::int64_t> numbers;
    for (const auto& [number, position] : foreign_) {
      positions.push_back(position);
      numbers.push_back(static_cast<std::int64_t>(number));
    }
    put(kPoints, num_own_, positions);
    put(kIds, num_own_, numbers);
  }

  std::int64_t place_of(std::uint64_t number) const {
    if (is_own(number)) return static_cast<std::int64_t>(number - first_vertex_);
    const auto place = std::ranges::lower_bound(foreign_, number, {}, &Foreign::number);
    return static_cast<std::int64_t>(num_own_) + (place - foreign_.begin());
  }

  void put_cells(const MeshChunk& chunk, std::uint64_t first_cell) {
    std::vector<std::int64_t> places, connectivity;
    for (const std::uint64_t number : chunk.numbers) places.push_back(place_of(number));
    for (const MeshChunk::Cell& cell : chunk.cells)
      for (const std::uint32_t v : cell) connectivity.push_back(places[v]);
    put(kConnectivity, 4 * first_cell, connectivity);
    put(kEnds, first_cell, offset_bytes(first_cell + 1, chunk.cells.size(), 8));
    put(kTypes, first_cell, std::vector<std::uint8_t>(chunk.cells.size(), kVtkTetra));
  }

  ChunkReader& chunks_;
  PartialFile& file_;
  std::uint64_t first_vertex_, num_own_;
  std::uint64_t num_cells_ = 0, data_ = 0, bytes_ = 0;
  std::vector<Foreign> foreign_;  // ascending
  std::vector<PlacedArray> arrays_;
};

std::filesystem::path with_end(const std::filesystem::path& file, const std::string& end) {
  return file.parent_path() / (file.stem().string() + end);
}

std::string index_of_pieces(const std::filesystem::path& file, int num_ranks) {
  Text text;
  text.add(
      "<?xml version=\"1.0\"?>\n"
      "<VTKFile type=\"PUnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
      "header_type=\"UInt64\">\n  <PUnstructuredGrid GhostLevel=\"0\">\n    <PPoints>\n"
      "      <PDataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"/>\n"
      "    </PPoints>\n    <PPointData GlobalIds=\"");
  text.add(kGlobalIds).add("\">\n      <PDataArray type=\"Int64\" Name=\"").add(kGlobalIds);
  text.add("\"/>\n    </PPointData>\n");
  for (int rank = 0; rank < num_ranks; ++rank)
    text.add("    <Piece Source=\"").add(piece_of(file, rank).filename().string()).add("\"/>\n");
  return text.add("  </PUnstructuredGrid>\n</VTKFile>\n").text();
}

}  // namespace

std::filesystem::path piece_of(const std::filesystem::path& file, int rank) {
  return with_end(file, fmt::format("-{}.vtu", rank));
}

std::filesystem::path index_of_pieces(const std::filesystem::path& file) {
  return with_end(file, ".pvtu");
}

WriteSummary write_piece_as_rank(const Store& store, const std::filesystem::path& file,
                                 Exchange& exchange) {
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = finished_run(store, snapshot);
  PageRelease pages(store);
  const std::filesystem::path piece = piece_of(file, exchange.rank());
  const VertexNumbering numbering(snapshot, run, piece, pages, nullptr, &exchange);
  ChunkReader chunks(snapshot, numbering, pages);
  WriteSummary own;
  {
    PartialFile out(piece);
    own = PieceWriter(chunks, numbering, out).write();
    out.publish();
  }
  wait_for_all(exchange);
  if (exchange.rank() == 0) {
    PartialFile out(index_of_pieces(file));
    const std::string text = index_of_pieces(file, exchange.num_ranks());
    out.write_at(0, std::as_bytes(std::span(text)));
    out.publish();
  }
  wait_for_all(exchange);
  const std::vector<std::uint64_t> all = sums(exchange, std::array{own.num_cells, own.bytes});
  return {numbering.num_vertices(), all[0], all[1], 0};
}

}  // namespace locvol
