#include "engine/writer.h"

#include <array>
#include <bit>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/leaf_name.h"
#include "engine/leaf_window.h"
#include "engine/partial_file.h"
#include "engine/vertex_numbering.h"
#include "engine/workers.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "the header says LittleEndian");

constexpr std::uint8_t kVtkTetra = 10;

// The appended data of a VTU file: after the mark "_", each array as a 64-bit count of its bytes
// and the bytes. Arrays of 8-byte values come first, so that all values lie at multiples of their
// size.
//
//   header, padded | _ | n points | n connectivity | n offsets | n leaf | n types | footer
struct Layout {
  std::uint64_t points, connectivity, offsets, leaf, types, end;  // of the counts, after the mark

  Layout(std::uint64_t num_vertices, std::uint64_t num_cells) {
    points = 0;
    connectivity = points + 8 + 24 * num_vertices;
    offsets = connectivity + 8 + 32 * num_cells;
    leaf = offsets + 8 + 8 * num_cells;
    types = leaf + 8 + 4 * num_cells;
    end = types + 8 + num_cells;
  }
};

constexpr std::string_view kFooter = "\n  </AppendedData>\n</VTKFile>\n";

std::string data_array(std::string_view type, std::string_view name, std::string_view attributes,
                       std::uint64_t offset) {
  std::ostringstream text;
  text << "        <DataArray type=\"" << type << "\" Name=\"" << name << "\" " << attributes
       << "format=\"appended\" offset=\"" << offset << "\"/>\n";
  return text.str();
}

// Up to and with the mark, which is the last byte before a multiple of eight.
std::string header(std::uint64_t num_vertices, std::uint64_t num_cells, const Layout& layout) {
  std::ostringstream text;
  text << "<?xml version=\"1.0\"?>\n"
          "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
          "header_type=\"UInt64\">\n  <UnstructuredGrid>\n"
       << "    <Piece NumberOfPoints=\"" << num_vertices << "\" NumberOfCells=\"" << num_cells
       << "\">\n      <Points>\n"
       << data_array("Float64", "Points", "NumberOfComponents=\"3\" ", layout.points)
       << "      </Points>\n      <Cells>\n"
       << data_array("Int64", "connectivity", "", layout.connectivity)
       << data_array("Int64", "offsets", "", layout.offsets)
       << data_array("UInt8", "types", "", layout.types)
       << "      </Cells>\n      <CellData Scalars=\"leaf\">\n"
       << data_array("UInt32", "leaf", "", layout.leaf)
       << "      </CellData>\n    </Piece>\n  </UnstructuredGrid>\n"
          "  <AppendedData encoding=\"raw\">\n";
  std::string result = text.str();
  result.append(7 - result.size() % 8, ' ');
  return result + '_';
}

RunRecord finished_run(const Store& store, const Reader& reader) {
  const auto run = reader.run();
  const std::string name = "the store " + store.directory().string();
  if (!run) throw StoreError(name + " holds no run");
  if (run->phase != Phase::kDone)
    throw StoreError(name + " holds an unfinished run: resume it first");
  return *run;
}

// The share of some leaves, one after another in Morton order, in each of the arrays. It is encoded
// here, and written to its places in the file by any thread.
struct Piece {
  using Vertex = std::array<double, 3>;
  using Cell = std::array<std::int64_t, 4>;

  std::uint64_t first_vertex = 0, first_cell = 0;
  std::vector<Vertex> points;
  std::vector<Cell> connectivity;
  std::vector<std::uint32_t> leaf_of_cell;

  bool is_full() const { return bytes() >= kFullBytes; }
  std::uint64_t bytes() const {
    return sizeof(Vertex) * points.size() + sizeof(Cell) * connectivity.size();
  }

 private:
  static constexpr std::uint64_t kFullBytes = std::uint64_t{1} << 20;
};

void add_points(const Reader& reader, const VertexNumbering& numbering, std::size_t leaf,
                Piece& piece) {
  const auto append = [&](const Point& p) { piece.points.push_back({p.x, p.y, p.z}); };
  const std::vector<std::uint64_t> used = numbering.used_ids(leaf);
  const LeafPoints held = reader.points(numbering.leaves()[leaf]);
  auto next = used.begin();
  for (const MeshPoint& point : held.points) {
    if (next == used.end() || point.id != *next) continue;
    append(point.position);
    ++next;
  }
  const SiteBox sites = numbering.sites(leaf);
  for_each_core_site(held.core, sites, sites, [&](const LatticeSite& site, std::uint64_t) {
    append(numbering.lattice().position(site));
  });
}

// The cells of the leaf's core, by formula. Returns how many there are.
std::uint64_t add_core_cells(VertexNumbering& numbering, std::size_t leaf, Piece& piece) {
  // Not asked for leaves outside, which may be a thousand λ wide.
  if (numbering.num_core_vertices(leaf) == 0) return 0;
  const SiteBlock<std::int64_t>* numbers = numbering.core_numbers(leaf);
  const std::size_t num_before = piece.connectivity.size();
  for_each_site(numbering.sites(leaf), [&](const LatticeSite& site) {
    const std::int64_t here = (*numbers)[site];
    if (here < 0) return;
    std::array<std::int64_t, kLargerNeighbors.size()> others{};
    for (std::size_t n = 0; n < others.size(); ++n)
      others[n] = (*numbers)[site + kLargerNeighbors[n]];
    for (const auto& [a, b, c] : kCellsOfLargerNeighbors) {
      if (others[a] < 0 || others[b] < 0 || others[c] < 0) continue;
      piece.connectivity.push_back({here, others[a], others[b], others[c]});
    }
  });
  return piece.connectivity.size() - num_before;
}

void add_cells(const Reader& reader, VertexNumbering& numbering, std::size_t leaf, Piece& piece) {
  const MortonKey key = numbering.leaves()[leaf];
  const LeafCells cells = reader.cells(key);
  const std::vector<std::int64_t> numbers = numbering.numbers(leaf, cells.vertices);
  for (const auto& cell : cells.cells) {
    const Piece::Cell named = {numbers[cell[0]], numbers[cell[1]], numbers[cell[2]],
                               numbers[cell[3]]};
    for (std::size_t i = 0; i < 4; ++i) {
      if (named[i] >= 0) continue;
      throw CorruptRecord(leaf_name(key) + ": a cell names point " +
                              std::to_string(cells.vertices[cell[i]]) +
                              ", which is in no leaf near it",
                          key);
    }
    piece.connectivity.push_back(named);
  }
  if (add_core_cells(numbering, leaf, piece) != numbering.num_core_cells(leaf))
    throw CorruptRecord(leaf_name(key) + ": its count of core cells is not theirs", key);
  piece.leaf_of_cell.resize(piece.connectivity.size(), static_cast<std::uint32_t>(leaf));
}

// Takes piece after piece off the store.
class PieceReader {
 public:
  PieceReader(const Reader& reader, VertexNumbering& numbering, PageRelease& pages)
      : reader_(reader), numbering_(numbering), pages_(pages) {}

  // Nothing: that was all.
  std::optional<Piece> next() {
    if (leaf_ == numbering_.leaves().size()) return std::nullopt;
    Piece piece;
    piece.first_vertex = num_vertices_;
    piece.first_cell = num_cells_;
    for (; leaf_ < numbering_.leaves().size() && !piece.is_full(); ++leaf_) {
      add_points(reader_, numbering_, leaf_, piece);
      add_cells(reader_, numbering_, leaf_, piece);
    }
    num_vertices_ += piece.points.size();
    num_cells_ += piece.connectivity.size();
    pages_.count(piece.bytes());
    return piece;
  }

 private:
  const Reader& reader_;
  VertexNumbering& numbering_;
  PageRelease& pages_;
  std::size_t leaf_ = 0;
  std::uint64_t num_vertices_ = 0, num_cells_ = 0;  // of the pieces so far
};

// Where the arrays lie in the file.
class ArrayFile {
 public:
  ArrayFile(PartialFile& file, std::uint64_t data, const Layout& layout)
      : file_(file), data_(data), layout_(layout) {}

  // The count of bytes that each array begins with.
  void write_counts(std::uint64_t num_vertices, std::uint64_t num_cells) {
    write(layout_.points, 24 * num_vertices);
    write(layout_.connectivity, 32 * num_cells);
    write(layout_.offsets, 8 * num_cells);
    write(layout_.leaf, 4 * num_cells);
    write(layout_.types, num_cells);
  }
  void write_piece(const Piece& piece) {
    const std::uint64_t num_cells = piece.connectivity.size();
    std::vector<std::uint64_t> offsets(num_cells);
    for (std::uint64_t i = 0; i < num_cells; ++i) offsets[i] = 4 * (piece.first_cell + i + 1);
    const std::vector<std::uint8_t> types(num_cells, kVtkTetra);
    const std::lock_guard lock(mutex_);
    write_values(layout_.points, piece.first_vertex, std::span(piece.points));
    write_values(layout_.connectivity, piece.first_cell, std::span(piece.connectivity));
    write_values(layout_.offsets, piece.first_cell, std::span(offsets));
    write_values(layout_.leaf, piece.first_cell, std::span(piece.leaf_of_cell));
    write_values(layout_.types, piece.first_cell, std::span(types));
  }
  void write_footer() { file_.write_at(data_ + layout_.end, std::as_bytes(std::span(kFooter))); }

 private:
  void write(std::uint64_t array, std::uint64_t value) {
    file_.write_at(data_ + array, std::as_bytes(std::span(&value, 1)));
  }
  template <class T>
  void write_values(std::uint64_t array, std::uint64_t first, std::span<T> values) {
    constexpr std::uint64_t kCountBytes = 8;
    file_.write_at(data_ + array + kCountBytes + first * sizeof(T), std::as_bytes(values));
  }

  PartialFile& file_;
  std::uint64_t data_;
  Layout layout_;
  std::mutex mutex_;  // the kernel lets one thread at a time write to a file: others would spin
};

class PieceTask : public Task {
 public:
  PieceTask(Piece piece, ArrayFile& out, const std::function<void(std::uint64_t)>& on_written)
      : piece_(std::move(piece)),
        num_cells_(piece_.first_cell + piece_.connectivity.size()),
        out_(out),
        on_written_(on_written) {}
  void compute() override {
    out_.write_piece(piece_);
    piece_ = {};
  }
  void apply() override { on_written_(num_cells_); }

 private:
  Piece piece_;
  std::uint64_t num_cells_;  // up to its last
  ArrayFile& out_;
  const std::function<void(std::uint64_t num_cells)>& on_written_;
};

}  // namespace

WriteSummary write_vtu(const Store& store, const std::filesystem::path& file, int num_threads,
                       const StepProgress& on_step) {
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = finished_run(store, snapshot);
  PageRelease pages(store);
  PartialFile out(file);
  VertexNumbering numbering(snapshot, run, file, pages);
  const std::uint64_t num_vertices = numbering.num_vertices(), num_cells = numbering.num_cells();

  const Layout layout(num_vertices, num_cells);
  const std::string head = header(num_vertices, num_cells, layout);
  const std::uint64_t bytes = head.size() + layout.end + kFooter.size();
  out.reserve(bytes);
  out.write_at(0, std::as_bytes(std::span(head)));
  ArrayFile arrays(out, head.size(), layout);
  arrays.write_counts(num_vertices, num_cells);
  PieceReader pieces(snapshot, numbering, pages);
  const std::function<void(std::uint64_t)> tell = [&](std::uint64_t num_written) {
    if (on_step) on_step(num_written, num_cells);
  };
  Workers(num_threads).run_in_order([&]() -> std::unique_ptr<Task> {
    auto piece = pieces.next();
    return piece ? std::make_unique<PieceTask>(*std::move(piece), arrays, tell) : nullptr;
  });
  arrays.write_footer();
  out.publish();
  return {num_vertices, num_cells, bytes};
}

}  // namespace locvol
