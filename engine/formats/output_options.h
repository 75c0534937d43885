// What is asked of a file that a mesh is written to, and what there is of a mesh to be written.
#pragma once

#include <cstdint>

namespace locvol {

enum class MeshFormat {
  kVtu,
  kVtuZlib,
  kVtkHdf,
  kMsh4,
  kMsh2,
  kMedit,
  kMeditBinary,
  kAbaqus,
  kTetgen,
  kStl,
  kStlText,
  kPly,
  kObj,
  kVtp,
};

// What is written of a mesh.
struct OutputOptions {
  MeshFormat format = MeshFormat::kVtu;
  bool has_quality = false;   // as cell data, where the format has any
  bool is_by_ranks = false;   // several processes write one file
  bool has_boundary = false;  // with the cells, in formats that do not have it always
  bool has_faces = false;     // the command puts a file of what is known of the sheets beside it
  bool splits_interfaces = false;  // of several bodies, each has vertices of its own
  int order = 1;                   // 2: cells have a node in the middle of each edge, too
};

// What a mesh has of all that a format numbers.
struct MeshCounts {
  std::uint64_t num_vertices = 0, num_cells = 0;  // with the nodes of second order
  std::uint64_t num_boundary_facets = 0, num_boundary_vertices = 0;
  int order = 1;             // of the cells, and of facets and edges as cells
  bool has_creases = false;  // the run keeps some, so files tell of them
  std::uint64_t num_crease_edges = 0, num_corners = 0;
  bool has_bodies = false;  // several, so files tell them apart
};

// How many vertices and nodes they have.
constexpr std::uint64_t num_corners_of_cell(int order) { return order == 2 ? 10 : 4; }
constexpr std::uint64_t num_corners_of_facet(int order) { return order == 2 ? 6 : 3; }
constexpr std::uint64_t num_corners_of_edge(int order) { return order == 2 ? 3 : 2; }

}  // namespace locvol
