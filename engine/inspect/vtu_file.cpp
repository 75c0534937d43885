#include "engine/inspect/vtu_file.h"

#include <bit>
#include <span>
#include <sstream>
#include <string_view>
#include <utility>

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "the header says LittleEndian");

// The appended data: after the mark "_", each array as a 64-bit count of its bytes and the bytes.
class GridWriter {
 public:
  explicit GridWriter(const VtuGrid& grid) : grid_(grid) {}

  std::uint64_t write(const std::filesystem::path& file) {
    const std::string head = header();
    PartialFile out(file);
    const std::uint64_t bytes = head.size() + data_bytes_ + kFooter.size();
    out.reserve(bytes);
    FileSection section(out, 0);
    section.append(std::as_bytes(std::span(head)));
    for (const VtuArray& array : arrays_) {
      section.append_value(array.bytes);
      array.write(section);
    }
    section.append(std::as_bytes(std::span(kFooter)));
    section.flush();
    out.publish();
    return bytes;
  }

 private:
  static constexpr std::string_view kFooter = "\n  </AppendedData>\n</VTKFile>\n";

  // Fills arrays_ with what the header lists, in this order.
  std::string header() {
    std::ostringstream text;
    text << "<?xml version=\"1.0\"?>\n"
            "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
            "header_type=\"UInt64\">\n  <UnstructuredGrid>\n    <Piece NumberOfPoints=\""
         << grid_.num_points << "\" NumberOfCells=\"" << grid_.num_cells << "\">\n";
    list(text, "Points", {points()});
    list(text, "Cells", {connectivity(), offsets(), types()});
    list(text, "PointData", grid_.point_data);
    list(text, "CellData", grid_.cell_data);
    text << "    </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n_";
    return text.str();
  }

  void list(std::ostream& text, std::string_view section, const std::vector<VtuArray>& arrays) {
    text << "      <" << section << ">\n";
    for (const VtuArray& array : arrays) {
      text << "        <DataArray type=\"" << array.type << "\" Name=\"" << array.name
           << "\" NumberOfComponents=\"" << array.num_components
           << "\" format=\"appended\" offset=\"" << data_bytes_ << "\"/>\n";
      data_bytes_ += sizeof(std::uint64_t) + array.bytes;
      arrays_.push_back(array);
    }
    text << "      </" << section << ">\n";
  }

  VtuArray points() const {
    return {"Points", "Float64", 3, 24 * grid_.num_points, [this](FileSection& out) {
              for (std::size_t i = 0; i < grid_.num_points; ++i) {
                const Point p = grid_.point(i);
                out.append_value(std::array{p.x, p.y, p.z});
              }
            }};
  }

  VtuArray connectivity() const {
    const std::size_t k = grid_.vertices_per_cell;
    return vtu_array("connectivity", grid_.num_cells * k,
                     [this, k](std::size_t i) { return grid_.vertex(i / k, i % k); });
  }

  VtuArray offsets() const {
    return vtu_array("offsets", grid_.num_cells, [this](std::size_t i) {
      return static_cast<std::int64_t>((i + 1) * grid_.vertices_per_cell);
    });
  }

  VtuArray types() const {
    return vtu_array("types", grid_.num_cells, [this](std::size_t) { return grid_.cell_type; });
  }

  const VtuGrid& grid_;
  std::vector<VtuArray> arrays_;
  std::uint64_t data_bytes_ = 0;
};

}  // namespace

std::uint64_t write_vtu_grid(const VtuGrid& grid, const std::filesystem::path& file) {
  return GridWriter(grid).write(file);
}

}  // namespace locvol
