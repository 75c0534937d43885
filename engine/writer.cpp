#include "engine/writer.h"

#include <array>
#include <bit>
#include <sstream>
#include <string>
#include <string_view>

#include "engine/leaf_name.h"
#include "engine/leaf_window.h"
#include "engine/partial_file.h"
#include "engine/vertex_numbering.h"

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

// One array of the appended data: its byte count, then values as they come.
FileSection begin_array(PartialFile& file, std::uint64_t offset, std::uint64_t bytes) {
  FileSection section(file, offset);
  section.append_value(bytes);
  return section;
}

RunRecord finished_run(const Store& store, const Reader& reader) {
  const auto run = reader.run();
  const std::string name = "the store " + store.directory().string();
  if (!run) throw StoreError(name + " holds no run");
  if (run->phase != Phase::kDone)
    throw StoreError(name + " holds an unfinished run: resume it first");
  return *run;
}

void write_points(const Reader& reader, const VertexNumbering& numbering, std::size_t leaf,
                  FileSection& out) {
  const auto append = [&](const Point& p) { out.append_value(std::array{p.x, p.y, p.z}); };
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
std::uint64_t write_core_connectivity(VertexNumbering& numbering, std::size_t leaf,
                                      FileSection& out) {
  const SiteBlock<std::int64_t>* numbers = numbering.core_numbers(leaf);
  if (numbers == nullptr) return 0;
  std::uint64_t num_cells = 0;
  for_each_site(numbering.sites(leaf), [&](const LatticeSite& site) {
    const std::int64_t here = (*numbers)[site];
    if (here < 0) return;
    std::array<std::int64_t, kLargerNeighbors.size()> others{};
    for (std::size_t n = 0; n < others.size(); ++n)
      others[n] = (*numbers)[site + kLargerNeighbors[n]];
    for (const auto& [a, b, c] : kCellsOfLargerNeighbors) {
      if (others[a] < 0 || others[b] < 0 || others[c] < 0) continue;
      out.append_value(std::array{here, others[a], others[b], others[c]});
      ++num_cells;
    }
  });
  return num_cells;
}

// Returns how many cells the leaf has.
std::uint64_t write_connectivity(const Reader& reader, VertexNumbering& numbering, std::size_t leaf,
                                 FileSection& out) {
  const MortonKey key = numbering.leaves()[leaf];
  const LeafCells cells = reader.cells(key);
  const std::vector<std::int64_t> numbers = numbering.numbers(leaf, cells.vertices);
  for (const auto& cell : cells.cells) {
    const std::array<std::int64_t, 4> named = {numbers[cell[0]], numbers[cell[1]], numbers[cell[2]],
                                               numbers[cell[3]]};
    for (std::size_t i = 0; i < 4; ++i) {
      if (named[i] >= 0) continue;
      throw CorruptRecord(leaf_name(key) + ": a cell names point " +
                              std::to_string(cells.vertices[cell[i]]) +
                              ", which is in no leaf near it",
                          key);
    }
    out.append_value(named);
  }
  const std::uint64_t num_core_cells = write_core_connectivity(numbering, leaf, out);
  if (num_core_cells != numbering.num_core_cells(leaf))
    throw CorruptRecord(leaf_name(key) + ": its count of core cells is not theirs", key);
  return cells.cells.size() + num_core_cells;
}

void write_offsets(std::uint64_t num_cells, FileSection& out) {
  for (std::uint64_t cell = 1; cell <= num_cells; ++cell) out.append_value(4 * cell);
}

void write_types(std::uint64_t num_cells, FileSection& out) {
  for (std::uint64_t cell = 0; cell < num_cells; ++cell) out.append_value(kVtkTetra);
}

void write_leaves(const Reader& reader, VertexNumbering& numbering, PartialFile& file,
                  std::uint64_t data, const Layout& layout, PageRelease& pages) {
  const std::uint64_t num_cells = numbering.num_cells();
  FileSection points = begin_array(file, data + layout.points, 24 * numbering.num_vertices());
  FileSection connectivity = begin_array(file, data + layout.connectivity, 32 * num_cells);
  FileSection leaf_of_cell = begin_array(file, data + layout.leaf, 4 * num_cells);
  for (std::size_t leaf = 0; leaf < numbering.leaves().size(); ++leaf) {
    write_points(reader, numbering, leaf, points);
    const std::uint64_t cells_here = write_connectivity(reader, numbering, leaf, connectivity);
    for (std::uint64_t i = 0; i < cells_here; ++i) {
      leaf_of_cell.append_value(static_cast<std::uint32_t>(leaf));
    }
    pages.count(32 * cells_here);
  }
  for (FileSection* section : {&points, &connectivity, &leaf_of_cell}) section->flush();
}

void write_constant_arrays(std::uint64_t num_cells, PartialFile& file, std::uint64_t data,
                           const Layout& layout) {
  FileSection offsets = begin_array(file, data + layout.offsets, 8 * num_cells);
  write_offsets(num_cells, offsets);
  offsets.flush();
  FileSection types = begin_array(file, data + layout.types, num_cells);
  write_types(num_cells, types);
  types.append(std::as_bytes(std::span(kFooter)));
  types.flush();
}

}  // namespace

WriteSummary write_vtu(const Store& store, const std::filesystem::path& file) {
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
  write_leaves(snapshot, numbering, out, head.size(), layout, pages);
  write_constant_arrays(num_cells, out, head.size(), layout);
  out.publish();
  return {num_vertices, num_cells, bytes};
}

}  // namespace locvol
