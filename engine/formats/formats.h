// One function for each format: it writes the mesh to a file that is empty yet, and returns the
// file's size. Bytes are the same for any number of threads. A mesh that several ranks have
// (MeshSource::exchange()), they write together: each what it has, the first one what is no rank's.
// Errors: StoreError, std::system_error; FormatLimit before a byte is written.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "engine/formats/output_options.h"
#include "engine/formats/vtu_header.h"
#include "engine/output/mesh_source.h"
#include "engine/shared/partial_file.h"

namespace locvol {

// Bytes of a value in VTK's arrays `connectivity` and `offsets`: 4 (Int32) or 8 (Int64).
struct IndexWidths {
  std::uint64_t connectivity = 4, offsets = 4;
};

// Of the rank's part, or of all. All ranks call it.
void add_creases(MeshSource& mesh, MeshCounts& counts);

// Cell data: `leaf` (its place in Morton order) and, with the quality, `radius_edge_ratio` and
// `min_dihedral_degrees`, in Float32. With the boundary, its triangles come after all tetrahedra,
// with the leaves of their cells, and there is `sheet`: 0 of tetrahedra; the quality of a triangle
// is no number (NaN). Where the run keeps creases, edges and corners come after the triangles, with
// `crease`, 0 of all but edges, and as point data `corner`, 0 of all but corners. Field
// data have the names of sheets and creases, and of each its number and its dimension. A part has
// `GlobalPointIds`, too, as point data: the numbers of its vertices in the mesh of all ranks. VTU:
// XML with raw appended data, UInt64 headers. Of `connectivity` and `offsets` each is as wide as
// `least` says, and Int64 if Int32 does not hold its numbers.
std::uint64_t write_vtu(MeshSource& mesh, const OutputOptions& output, PartialFile& file,
                        const IndexWidths& least = {});
std::uint64_t write_compressed_vtu(MeshSource& mesh, const OutputOptions& output, PartialFile& file,
                                   const IndexWidths& least = {8, 8});
// VTKHDF 1.0, one partition, 64-bit ids; HDF5 opens the file by its name. Of several ranks, which
// compress, the first one puts all chunks into it, and alone gets its size.
std::uint64_t write_vtkhdf(MeshSource& mesh, const OutputOptions& output, PartialFile& file);

// A part of a mesh in a file beside others, for one that makes a whole of them.
struct PieceFile {
  std::string name;
  MeshCounts counts;
};
// Writes the file that names the VTU files of all ranks.
void write_pvtu(std::span<const PieceFile> pieces, const OutputOptions& output, PartialFile& file);
// A partition for each VTKHDF file, of virtual datasets: a reader gets values from where they are.
// `fields`: those of the pieces.
void write_partitioned_vtkhdf(std::span<const PieceFile> pieces, const OutputOptions& output,
                              const std::vector<VtuField>& fields, PartialFile& file);

// Gmsh, binary: tetrahedra of volume 1 (physical group "volume"), triangles of surface 1
// ("boundary"), and where creases are kept lines of curves and points, a group each; of the part of
// rank r, of volume and surface r + 2 in partition r + 1, with tags that are the same in all parts.
std::uint64_t write_msh4(MeshSource& mesh, PartialFile& file);
std::uint64_t write_msh2(MeshSource& mesh, PartialFile& file);
// Tetrahedra and boundary triangles, all with the reference 1, edges of creases, which of first
// order are ridges, and corners, which are required. Version 4 from 2^31 of them on; the binary one
// is of version 3 if it is below, but the file beyond 2^31 bytes.
std::uint64_t write_medit(MeshSource& mesh, PartialFile& file);
std::uint64_t write_binary_medit(MeshSource& mesh, PartialFile& file, int least_version = 2);
// C3D4 elements in the set `volume`; the boundary's nodes in the set `boundary`, its facets in the
// surface `boundary`; a set of nodes of each crease and corner. No number is longer than 20
// characters, as Abaqus wants it: coordinates have 13 digits at least.
std::uint64_t write_abaqus(MeshSource& mesh, PartialFile& file);
// Indices from 1. `faces`, `edges`: unless null, the boundary's triangles, whose markers are the
// sheets, and edges of creases, with theirs.
std::uint64_t write_tetgen(MeshSource& mesh, PartialFile& nodes, PartialFile& elements,
                           PartialFile* faces, PartialFile* edges);

// The boundary, outward.
std::uint64_t write_stl(MeshSource& mesh, PartialFile& file);
std::uint64_t write_stl_text(MeshSource& mesh, PartialFile& file);
std::uint64_t write_ply(MeshSource& mesh, PartialFile& file);
std::uint64_t write_obj(MeshSource& mesh, PartialFile& file);
// With `sheet` of each triangle, and of several bodies those `behind` and `before` it, 0: none.
// Field data as write_vtu() has them.
std::uint64_t write_vtp(MeshSource& mesh, PartialFile& file);

}  // namespace locvol
