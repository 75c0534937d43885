// What a VTU file says before its arrays, and after them:
//
//   header | arrays, each a head and its bytes | footer
//
// VTK's XML with raw appended data; the last byte of the header is the mark "_".
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace locvol {

enum class VtuSection { kPoints, kCells, kPointData, kCellData };

struct VtuArrayEntry {
  VtuSection section;
  std::string name, vtk_type;        // "Float64"
  std::uint64_t num_components = 1;  // of points: 3
  std::uint64_t offset = 0;          // of its head, after the mark
  bool has_global_ids = false;       // numbers of points that other files have, too
};

// Of the whole file: the number of what has a name, and its dimension, as meshio has groups.
struct VtuField {
  std::string name;
  std::uint32_t id = 0;
  std::uint32_t dimension = 0;
};

// A multiple of eight bytes; as many whatever the offsets.
std::string vtu_header(std::uint64_t num_points, std::uint64_t num_cells,
                       const std::vector<VtuArrayEntry>& arrays, bool is_compressed = false,
                       const std::vector<VtuField>& fields = {});

// The same of triangles alone, as VTK's PolyData (.vtp).
std::string vtp_header(std::uint64_t num_points, std::uint64_t num_triangles,
                       const std::vector<VtuArrayEntry>& arrays,
                       const std::vector<VtuField>& fields);

inline constexpr std::string_view kVtuFooter = "\n  </AppendedData>\n</VTKFile>\n";

}  // namespace locvol
