#include "engine/formats/mesh_arrays.h"

#include <cassert>
#include <cstring>
#include <functional>
#include <memory>
#include <ranges>
#include <string>
#include <utility>

#include "engine/formats/limits.h"
#include "engine/formats/outputs.h"
#include "engine/formats/sheet_names.h"

namespace locvol {
namespace {

template <class T>
std::vector<std::byte> bytes_of(const std::vector<T>& values) {
  const auto bytes = std::as_bytes(std::span(values));
  return {bytes.begin(), bytes.end()};
}

std::string_view vtk_int(std::uint64_t value_bytes) { return value_bytes == 4 ? "Int32" : "Int64"; }

template <class Int>
std::vector<std::byte> offsets_from(std::uint64_t first, std::uint64_t count,
                                    const CellKinds& kinds) {
  std::vector<std::byte> bytes(count * sizeof(Int));
  std::uint64_t i = 0, before = corners_before(first, kinds), end = 0;
  const auto put = [&] {
    const auto offset = static_cast<Int>(before);
    std::memcpy(&bytes[i * sizeof(Int)], &offset, sizeof(Int));
  };
  for (const CellKind& kind : kinds) {
    end += kind.count;
    for (; i < count && first + i < end; ++i, before += kind.num_vertices) put();
  }
  if (i < count) put();  // where all end
  return bytes;
}

// Those that begin before an item.
std::uint64_t num_blocks(std::uint64_t item, std::uint64_t block_items) {
  return block_items == 0 ? 0 : (item + block_items - 1) / block_items;
}

// Takes bytes off pieces, in runs of any length: encode(piece) gives those of a piece.
template <class Piece, class Encode>
auto bytes_of_pieces(std::function<std::optional<Piece>()> pieces, Encode encode) {
  struct State {
    std::function<std::optional<Piece>()> pieces;
    Encode encode;
    std::vector<std::byte> bytes = {};
    std::size_t taken = 0;
  };
  return [state = std::make_shared<State>(State{std::move(pieces), std::move(encode)})](
             std::uint64_t, std::span<std::byte> out) {
    while (!out.empty()) {
      if (state->taken == state->bytes.size()) {
        const std::optional<Piece> piece = state->pieces();
        assert(piece.has_value());
        const auto bytes = state->encode(*piece);
        state->bytes.assign(bytes.begin(), bytes.end());
        state->taken = 0;
        continue;
      }
      const std::size_t count = std::min(state->bytes.size() - state->taken, out.size());
      std::memcpy(out.data(), state->bytes.data() + state->taken, count);
      state->taken += count;
      out = out.subspan(count);
    }
  };
}

using ReadItems = std::function<void(std::uint64_t first, std::span<std::byte> out)>;

ReadItems zeros() {
  return [](std::uint64_t, std::span<std::byte> out) { std::ranges::fill(out, std::byte{0}); };
}

ReadItems no_qualities() {
  return [](std::uint64_t, std::span<std::byte> out) {
    const std::vector<float> values(out.size() / sizeof(float), kNoQuality);
    if (!out.empty()) std::memcpy(out.data(), values.data(), out.size());
  };
}

// Of facets or edges as cells. `pieces()`: begins to read them; `label`: the array of `labels`, for
// which the other cells of a file have 0
template <class Piece>
ReadItems labeled_reader(const ArrayInfo& info, const auto& pieces, auto Piece::*cells,
                         ArrayName label, auto Piece::*labels) {
  const auto column = [&](auto Piece::*values) -> ReadItems {
    return bytes_of_pieces<Piece>(
        pieces(), [values](const Piece& piece) { return std::as_bytes(std::span(piece.*values)); });
  };
  switch (info.array) {
    case ArrayName::kConnectivity:
      return bytes_of_pieces<Piece>(
          pieces(), [cells, width = info.value_bytes,
                     buffer = ConnectivityBuffer()](const Piece& piece) mutable {
            return connectivity_bytes(piece.*cells, piece.nodes, width, buffer);
          });
    case ArrayName::kLeaf:
      return column(&Piece::leaves);
    case ArrayName::kBody:
      return zeros();
    case ArrayName::kSheet:
    case ArrayName::kCrease:
      return info.array == label ? column(labels) : zeros();
    case ArrayName::kRadiusEdge:
    case ArrayName::kDihedral:
      return no_qualities();
    default:
      return nullptr;
  }
}

}  // namespace

IndexWidths index_widths(const MeshCounts& n) {
  const CellKinds kinds = cell_kinds(n);
  const std::uint64_t num_corners = corners_before(num_cells(kinds), kinds);
  return {n.num_vertices <= kMaxInt32 ? 4u : 8u, num_corners <= kMaxInt32 ? 4u : 8u};
}

MeshCounts counts_of(MeshSource& mesh, const OutputOptions& output) {
  MeshCounts counts{mesh.num_points(), mesh.num_cells(), 0, 0, mesh.order()};
  counts.has_bodies = mesh.has_bodies();
  if (!output.has_boundary) return counts;
  counts.num_boundary_facets = mesh.num_boundary_facets();
  add_creases(mesh, counts);
  return counts;
}

std::vector<VtuField> name_fields(const MeshSource& mesh, const OutputOptions& output,
                                  std::string_view forbidden) {
  std::vector<VtuField> fields;
  const SurfaceSheets& all = mesh.sheets();
  const MeshNames names = names_of_mesh(all, mesh.has_creases(), {.forbidden = forbidden});
  if (mesh.has_bodies())
    for (BodyId body = 1; body <= names.bodies.size(); ++body)
      fields.push_back({names.bodies[body - 1], body, 3});
  if (!output.has_boundary) return fields;
  for (SheetId sheet = 1; sheet <= all.sheets.size(); ++sheet)
    if (has_name(all, sheet)) fields.push_back({names.sheets[sheet - 1], sheet, 2});
  for (CreaseId crease = 1; crease <= names.creases.size(); ++crease) {
    const auto& [a, b] = all.creases[crease - 1].sheets;
    if (has_name(all, a) && has_name(all, b))
      fields.push_back({names.creases[crease - 1], crease, 1});
  }
  return fields;
}

std::vector<ArrayInfo> mesh_arrays(const MeshCounts& n, const OutputOptions& output,
                                   const IndexWidths& widths, bool is_part) {
  const CellKinds kinds = cell_kinds(n);
  const std::uint64_t num_cells = locvol::num_cells(kinds);
  std::vector<ArrayInfo> arrays = {
      {ArrayName::kPoints, "Points", "Float64", 3, 8, n.num_vertices},
      {ArrayName::kConnectivity, "connectivity", vtk_int(widths.connectivity), 1,
       widths.connectivity, corners_before(num_cells, kinds)},
      {ArrayName::kEnds, "offsets", vtk_int(widths.offsets), 1, widths.offsets, num_cells},
      {ArrayName::kLeaf, "leaf", "UInt32", 1, 4, num_cells, true},
  };
  if (is_part)
    arrays.push_back({ArrayName::kPointIds, kGlobalPointIds, "Int64", 1, 8, n.num_vertices});
  if (n.has_bodies) arrays.push_back({ArrayName::kBody, "body", "UInt32", 1, 4, num_cells, true});
  if (output.has_boundary)
    arrays.push_back({ArrayName::kSheet, "sheet", "UInt32", 1, 4, num_cells, true});
  if (n.has_creases) {
    arrays.push_back({ArrayName::kCrease, "crease", "UInt32", 1, 4, num_cells, true});
    arrays.push_back({ArrayName::kCorner, "corner", "UInt32", 1, 4, n.num_vertices});
  }
  if (output.has_quality) {
    arrays.push_back(
        {ArrayName::kRadiusEdge, "radius_edge_ratio", "Float32", 1, 4, num_cells, true});
    arrays.push_back(
        {ArrayName::kDihedral, "min_dihedral_degrees", "Float32", 1, 4, num_cells, true});
  }
  arrays.push_back({ArrayName::kTypes, "types", "UInt8", 1, 1, num_cells});
  std::ranges::stable_sort(arrays, std::greater<>(), &ArrayInfo::value_bytes);
  return arrays;
}

std::vector<std::byte> offset_bytes(std::uint64_t first, std::uint64_t count,
                                    std::uint64_t value_bytes, const CellKinds& kinds) {
  return value_bytes == 4 ? offsets_from<std::int32_t>(first, count, kinds)
                          : offsets_from<std::int64_t>(first, count, kinds);
}

std::vector<std::uint32_t> corners_of(std::span<const KeptCorner> corners, std::uint64_t first,
                                      std::uint64_t count) {
  std::vector<std::uint32_t> ids(count);
  for (auto corner = std::ranges::lower_bound(corners, first, {}, &KeptCorner::vertex);
       corner != corners.end() && corner->vertex < first + count; ++corner)
    ids[corner->vertex - first] = static_cast<std::uint32_t>(corner->corner);
  return ids;
}

ArrayBlocks::ArrayBlocks(MeshSource& mesh, const OutputOptions& options,
                         const std::filesystem::path& output)
    : mesh_(mesh),
      counts_(counts_of(mesh, options)),
      kinds_(cell_kinds(counts_)),
      has_triangles_(options.has_boundary) {
  if (counts_.has_creases) corners_ = mesh.corners_by_vertex();
  if (options.has_quality) do_on_all(mesh.exchange(), [&] { measure(output); });
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
std::vector<ArrayBlocks::Run> ArrayBlocks::runs_of(const ArrayInfo& info) {
  if (info.array == ArrayName::kPointIds || info.array == ArrayName::kCorner) {
    std::vector<Run> runs = {{mesh_.own_vertices(), nullptr}};
    if (mesh_.order() == 2) runs.push_back({mesh_.own_nodes(), nullptr});
    return runs;
  }
  if (info.array == ArrayName::kPoints) {
    const auto reader = [&](const PieceParts& parts, auto MeshPiece::*points) -> ReadItems {
      return bytes_of_pieces<MeshPiece>(mesh_.pieces(parts), [points](const MeshPiece& piece) {
        return std::as_bytes(std::span(piece.*points));
      });
    };
    std::vector<Run> runs = {
        {mesh_.own_vertices(), reader({.has_points = true}, &MeshPiece::points)}};
    if (mesh_.order() == 2)
      runs.push_back(
          {mesh_.own_nodes(), reader({.has_node_points = true}, &MeshPiece::node_points)});
    return runs;
  }
  std::vector<Run> runs = {{mesh_.own_cells(), cell_reader(info)}};
  std::uint64_t before = counts_.num_cells;  // of other kinds
  const auto add_run = [&](const NumberRange& own, ReadItems read, std::uint64_t num_all) {
    runs.push_back({{before + own.first, before + own.end}, std::move(read)});
    before += num_all;
  };
  if (has_triangles_)
    add_run(mesh_.own_triangles(), triangle_reader(info), counts_.num_boundary_facets);
  if (counts_.has_creases) {
    add_run(mesh_.own_lines(), line_reader(info), counts_.num_crease_edges);
    // All of them are known to all ranks.
    add_run({mesh_.is_of_first_rank() ? 0 : counts_.num_corners, counts_.num_corners},
            corner_reader(info), counts_.num_corners);
  }
  if (info.array == ArrayName::kConnectivity)
    for (auto& [first, end] : std::views::transform(runs, &Run::own)) {
      first = corners_before(first, kinds_);
      end = corners_before(end, kinds_);
    }
  const Exchange& exchange = mesh_.exchange();
  if (info.array == ArrayName::kStarts && exchange.rank() + 1 == exchange.num_ranks()) {
    NumberRange& last = runs.back().own;
    last = {last.size() > 0 ? last.first : info.num_items - 1, info.num_items};
  }
  return runs;
}

ArrayBlocks::ReadItems ArrayBlocks::cell_reader(const ArrayInfo& info) {
  switch (info.array) {
    case ArrayName::kConnectivity:
      return bytes_of_pieces<MeshPiece>(
          mesh_.pieces({.has_cells = true}),
          [width = info.value_bytes,
           buffer = ConnectivityBuffer()](const MeshPiece& piece) mutable {
            return connectivity_bytes(piece.cells, piece.nodes, width, buffer);
          });
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
    case ArrayName::kBody:
      return bytes_of_pieces<MeshPiece>(
          mesh_.pieces({.has_cells = true}),
          [](const MeshPiece& piece) { return std::as_bytes(std::span(piece.bodies)); });
    case ArrayName::kSheet:
    case ArrayName::kCrease:
      return zeros();
    default:
      return nullptr;
  }
}

ArrayBlocks::ReadItems ArrayBlocks::triangle_reader(const ArrayInfo& info) {
  return labeled_reader<TrianglePiece>(
      info, [this] { return mesh_.triangles(); }, &TrianglePiece::triangles, ArrayName::kSheet,
      &TrianglePiece::sheets);
}

ArrayBlocks::ReadItems ArrayBlocks::line_reader(const ArrayInfo& info) {
  return labeled_reader<LinePiece>(
      info, [this] { return mesh_.lines(); }, &LinePiece::lines, ArrayName::kCrease,
      &LinePiece::creases);
}

ArrayBlocks::ReadItems ArrayBlocks::corner_reader(const ArrayInfo& info) {
  const auto read = [](std::vector<std::byte> bytes) -> ReadItems {
    return [bytes = std::move(bytes), taken = std::size_t{0}](std::uint64_t,
                                                              std::span<std::byte> out) mutable {
      if (!out.empty()) std::memcpy(out.data(), bytes.data() + taken, out.size());
      taken += out.size();
    };
  };
  switch (info.array) {
    case ArrayName::kConnectivity: {
      std::vector<std::array<std::int64_t, 1>> vertices;
      for (const KeptCorner& corner : mesh_.corners())
        vertices.push_back({static_cast<std::int64_t>(corner.vertex)});
      ConnectivityBuffer buffer;
      const auto bytes =
          connectivity_bytes(vertices, decltype(vertices)(), info.value_bytes, buffer);
      return read({bytes.begin(), bytes.end()});
    }
    case ArrayName::kLeaf: {
      std::vector<std::uint32_t> leaves;
      for (const KeptCorner& corner : mesh_.corners())
        leaves.push_back(static_cast<std::uint32_t>(corner.leaf));
      return read(bytes_of(leaves));
    }
    case ArrayName::kBody:
    case ArrayName::kSheet:
    case ArrayName::kCrease:
      return zeros();
    case ArrayName::kRadiusEdge:
    case ArrayName::kDihedral:
      return no_qualities();
    default:
      return nullptr;
  }
}

// All ranks call it: the items of each run before its first block are told to the run whose block
// has them. Such a block may end in another run of the same rank, or of any higher one.
void ArrayBlocks::tell_items(const ArrayInfo& info, std::uint64_t block_items,
                             std::vector<Run>& runs) {
  Exchange& exchange = mesh_.exchange();
  std::vector<std::vector<std::uint64_t>> firsts, ends;  // by run, then by rank
  for (const Run& run : runs) {
    firsts.push_back(gather_numbers(exchange, run.own.first));
    ends.push_back(gather_numbers(exchange, run.own.end));
  }
  for (std::size_t from = 0; from < runs.size(); ++from)
    for (std::size_t to = 0; to <= from; ++to) {
      std::vector<std::string> told(firsts.front().size());
      do_on_all(exchange, [&] {
        const NumberRange own = runs[from].own;
        const std::uint64_t first_block = block_items * num_blocks(own.first, block_items);
        if (own.size() == 0 || own.first == first_block) return;
        const std::uint64_t start = first_block - block_items;
        for (std::size_t rank = 0; rank < told.size(); ++rank) {
          if (!(firsts[to][rank] <= start && start < ends[to][rank])) continue;
          told[rank].resize((std::min(first_block, own.end) - own.first) * info.item_bytes());
          runs[from].read(own.first, std::as_writable_bytes(std::span(told[rank])));
        }
      });
      for (const std::string& items : exchange.swap(std::move(told))) {
        const auto bytes = std::as_bytes(std::span(items));
        runs[to].after.insert(runs[to].after.end(), bytes.begin(), bytes.end());
      }
    }
}

std::function<std::optional<ArrayBlocks::Block>()> ArrayBlocks::blocks_of(const ArrayInfo& info,
                                                                          std::uint64_t block_items,
                                                                          Run run) const {
  const std::uint64_t first = block_items * num_blocks(run.own.first, block_items),
                      end = std::min(info.num_items,
                                     block_items * num_blocks(run.own.end, block_items));
  // Of tetrahedra alone, threads find the leaves.
  const bool is_formula = info.array == ArrayName::kLeaf && run.own.end <= counts_.num_cells;
  return [=, run = std::move(run), next = first]() mutable -> std::optional<Block> {
    if (next >= end) return std::nullopt;
    Block block{next, std::min(block_items, end - next), {}};
    next += block.count;
    const std::uint64_t num_own = std::min(next, run.own.end) - block.first;
    if (!run.read || (is_formula && num_own == block.count)) return block;
    block.bytes.resize(block.count * info.item_bytes());
    const auto of_own = std::span(block.bytes).first(num_own * info.item_bytes());
    run.read(block.first, of_own);
    if (num_own == block.count) return block;
    if (run.after.size() != block.bytes.size() - of_own.size())
      throw ExchangeError("ranks disagree on who has which items: this is a bug of locvol");
    std::ranges::copy(run.after, block.bytes.begin() + static_cast<std::ptrdiff_t>(of_own.size()));
    return block;
  };
}

std::vector<ArrayBlocks::Blocks> ArrayBlocks::blocks(const ArrayInfo& info,
                                                     std::uint64_t block_items) {
  if (info.num_items == 0) return {};
  std::vector<Run> runs = runs_of(info);
  if (runs.front().read) tell_items(info, block_items, runs);
  std::vector<Blocks> all;
  for (Run& run : runs) all.push_back({info, blocks_of(info, block_items, std::move(run))});
  return all;
}

std::vector<std::byte> ArrayBlocks::computed(const ArrayInfo& info, const Block& block) const {
  if (info.array == ArrayName::kLeaf)
    return bytes_of(mesh_.leaves_of_cells(block.first, block.count));
  if (info.array == ArrayName::kPointIds)
    return bytes_of(mesh_.numbers_of(block.first, block.count));
  if (info.array == ArrayName::kCorner)
    return bytes_of(corners_of(corners_, block.first, block.count));
  if (info.array == ArrayName::kTypes) {
    std::vector<std::byte> types(block.count);
    std::uint64_t end = 0;
    for (const CellKind& kind : kinds_) {
      const std::uint64_t first = end;
      end += kind.count;
      for (std::uint64_t i = std::max(first, block.first);
           i < std::min(end, block.first + block.count); ++i)
        types[i - block.first] = std::byte{kind.vtk_type};
    }
    return types;
  }
  const std::uint64_t first = block.first + (info.array == ArrayName::kEnds ? 1 : 0);
  return offset_bytes(first, block.count, info.value_bytes, kinds_);
}

}  // namespace locvol
