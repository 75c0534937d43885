// What is known of each sheet of a finished mesh: of the surface's triangles, of the mesh's facets,
// and its shape.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/inspect/sheet_shape.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

struct SheetRow {
  SheetFacts surface;             // of a surface without sheets: all of it, called "boundary"
  BodyId behind = 1, before = 0;  // the bodies on its sides
  std::uint64_t num_facets = 0;   // of the mesh
  double facet_area = 0;
  SheetShape shape;  // of the surface
};

struct SheetTable {
  std::vector<SheetRow> rows;  // by id, from 1 on
  double tolerance = 0;        // how far from its shape a corner of a sheet may be
};

// Corners of CAD files in float32 are this close to what they are corners of, over the diagonal of
// the surface's box.
inline constexpr double kShapeTolerance = 1e-5;

// Streams over the surface twice and over the mesh's facets, on one thread. Memory: three kilobytes
// a sheet, what VertexNumbering takes, and 8 MB for points. `output`: a temporary file lies beside
// it. Throws StoreError unless the store holds a finished run; CorruptRecord, std::system_error,
// Stopped.
// `exchange`: of the ranks that have the mesh together, which all call it and get the same.
SheetTable sheet_table(const Store& store, const std::filesystem::path& output,
                       const StopToken* stop = nullptr, Exchange& exchange = alone());

// The same of a mesh whose bodies share no vertices: of a sheet between two bodies each side is
// one, and both are called as SheetSides has it.
SheetTable with_both_sides(SheetTable table, const SurfaceSheets& sheets);

}  // namespace locvol
