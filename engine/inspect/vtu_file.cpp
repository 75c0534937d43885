#include "engine/inspect/vtu_file.h"

#include <span>
#include <utility>

#include "engine/formats/vtu_header.h"

namespace locvol {
namespace {

// The head of an array is the number of its bytes.
class GridWriter {
 public:
  explicit GridWriter(const VtuGrid& grid) : grid_(grid) {}

  std::uint64_t write(const std::filesystem::path& file) {
    const std::string head = header();
    PartialFile out(file);
    const std::uint64_t bytes = head.size() + data_bytes_ + kVtuFooter.size();
    out.reserve(bytes);
    FileSection section(out, 0);
    section.append(std::as_bytes(std::span(head)));
    for (const VtuArray& array : arrays_) {
      section.append_value(array.bytes);
      array.write(section);
    }
    section.append(std::as_bytes(std::span(kVtuFooter)));
    section.flush();
    out.publish();
    return bytes;
  }

 private:
  // Fills arrays_ with what the header lists, in this order.
  std::string header() {
    add(VtuSection::kPoints, points());
    add(VtuSection::kCells, connectivity());
    add(VtuSection::kCells, offsets());
    add(VtuSection::kCells, types());
    for (const VtuArray& array : grid_.point_data) add(VtuSection::kPointData, array);
    for (const VtuArray& array : grid_.cell_data) add(VtuSection::kCellData, array);
    return vtu_header(grid_.num_points, grid_.num_cells(), entries_);
  }

  void add(VtuSection section, const VtuArray& array) {
    entries_.push_back({section, array.name, array.type, array.num_components, data_bytes_});
    data_bytes_ += sizeof(std::uint64_t) + array.bytes;
    arrays_.push_back(array);
  }

  VtuArray points() const {
    return {"Points", "Float64", 3, 24 * grid_.num_points, [this](FileSection& out) {
              for (std::size_t i = 0; i < grid_.num_points; ++i) {
                const Point p = grid_.point(i);
                out.append_value(std::array{p.x, p.y, p.z});
              }
            }};
  }

  // Calls visit(cells, number of the cell) for each, in order.
  template <class Visit>
  void for_each_cell(const Visit& visit) const {
    std::size_t cell = 0;
    for (const VtuCells& cells : grid_.cells)
      for (std::uint64_t i = 0; i < cells.num; ++i) visit(cells, cell++);
  }

  VtuArray connectivity() const {
    std::uint64_t num = 0;
    for (const VtuCells& cells : grid_.cells) num += cells.num * cells.num_vertices;
    return {"connectivity", "Int64", 1, num * sizeof(std::int64_t), [this](FileSection& out) {
              for_each_cell([&](const VtuCells& cells, std::size_t cell) {
                for (std::size_t i = 0; i < cells.num_vertices; ++i)
                  out.append_value(grid_.vertex(cell, i));
              });
            }};
  }

  VtuArray offsets() const {
    return {"offsets", "Int64", 1, grid_.num_cells() * sizeof(std::int64_t),
            [this](FileSection& out) {
              std::int64_t offset = 0;
              for_each_cell([&](const VtuCells& cells, std::size_t) {
                out.append_value(offset += static_cast<std::int64_t>(cells.num_vertices));
              });
            }};
  }

  VtuArray types() const {
    return {
        "types", "UInt8", 1, grid_.num_cells(), [this](FileSection& out) {
          for_each_cell([&](const VtuCells& cells, std::size_t) { out.append_value(cells.type); });
        }};
  }

  const VtuGrid& grid_;
  std::vector<VtuArray> arrays_;
  std::vector<VtuArrayEntry> entries_;
  std::uint64_t data_bytes_ = 0;
};

}  // namespace

std::uint64_t VtuGrid::num_cells() const {
  std::uint64_t num = 0;
  for (const VtuCells& some : cells) num += some.num;
  return num;
}

VtuGrid grid_of_boxes(std::size_t num, const std::function<Box(std::size_t)>& box) {
  constexpr std::array<int, 8> kOctants = {0, 1, 3, 2, 4, 5, 7, 6};  // VTK's order of corners
  VtuGrid grid;
  grid.num_points = 8 * num;
  grid.cells = {{.type = kVtkHexahedron, .num_vertices = 8, .num = num}};
  grid.point = [box, kOctants](std::size_t i) {
    const auto [min, max] = box(i / 8);
    const int octant = kOctants[i % 8];
    return Point{octant & 1 ? max.x : min.x, octant & 2 ? max.y : min.y,
                 octant & 4 ? max.z : min.z};
  };
  grid.vertex = [](std::size_t cell, std::size_t i) {
    return static_cast<std::int64_t>(8 * cell + i);
  };
  return grid;
}

std::uint64_t write_vtu_grid(const VtuGrid& grid, const std::filesystem::path& file) {
  return GridWriter(grid).write(file);
}

}  // namespace locvol
