// Writes small unstructured grids as VTU files, for looking at: arrays by name, given as functions.
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <type_traits>
#include <vector>

#include "engine/shared/partial_file.h"
#include "octree/geometry.h"

namespace locvol {

// An array of a VTU file. Its values are asked for when the file is written.
struct VtuArray {
  std::string name;
  std::string type;  // VTK's name of it: "Float64"
  std::uint64_t num_components = 1;
  std::uint64_t bytes = 0;
  std::function<void(FileSection&)> write;
};

template <class T>
constexpr const char* vtk_type_name() {
  if constexpr (std::same_as<T, double>) return "Float64";
  if constexpr (std::same_as<T, std::int64_t>) return "Int64";
  if constexpr (std::same_as<T, std::uint64_t>) return "UInt64";
  if constexpr (std::same_as<T, std::uint8_t>) return "UInt8";
}

// An array with one number, value(i), for each i < num.
template <class Value>
VtuArray vtu_array(std::string name, std::size_t num, Value value) {
  using T = std::invoke_result_t<Value, std::size_t>;
  return {std::move(name), vtk_type_name<T>(), 1, num * sizeof(T), [num, value](FileSection& out) {
            for (std::size_t i = 0; i < num; ++i) out.append_value(value(i));
          }};
}

// VTK's numbers of types of cells.
inline constexpr std::uint8_t kVtkHexahedron = 12;

// Cells of one type.
struct VtuCells {
  std::uint8_t type = 0;
  std::uint64_t num_vertices = 0;  // of each
  std::uint64_t num = 0;
};

struct VtuGrid {
  std::uint64_t num_points = 0;
  std::function<Point(std::size_t)> point;
  std::vector<VtuCells> cells;  // those of one type after another
  std::function<std::int64_t(std::size_t cell, std::size_t i)> vertex;
  std::vector<VtuArray> point_data, cell_data;

  std::uint64_t num_cells() const;
};

// A grid of hexahedra, each with corners of its own; without data.
VtuGrid grid_of_boxes(std::size_t num, const std::function<Box(std::size_t)>& box);

// Returns the file's size. Errors as PartialFile; the file appears only when it is whole.
std::uint64_t write_vtu_grid(const VtuGrid& grid, const std::filesystem::path& file);

}  // namespace locvol
