// Cells as visits list them, and as stores have them: there bodies are of no weight where one has
// all.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "refine/leaf.h"
#include "storage/records.h"

namespace locvol {

// Nothing but the cells and their vertices.
inline CellList listed_cells(LeafCells stored) {
  CellList list;
  list.cells.reserve(stored.cells.size());
  for (std::size_t i = 0; i < stored.cells.size(); ++i)
    list.cells.push_back({stored.cells[i], stored.body_of(i)});
  list.vertices = std::move(stored.vertices);
  return list;
}

// `ids`: of the list's vertices
inline LeafCells stored_cells(std::vector<std::uint64_t> ids, const CellList& list) {
  LeafCells stored;
  stored.vertices = std::move(ids);
  stored.cells.reserve(list.cells.size());
  for (const MeshCell& cell : list.cells) stored.cells.push_back(cell.vertices);
  if (std::ranges::any_of(
          list.cells, [](BodyId body) { return body != kOnlyBody; }, &MeshCell::body)) {
    stored.bodies.reserve(list.cells.size());
    for (const MeshCell& cell : list.cells) stored.bodies.push_back(cell.body);
  }
  return stored;
}

}  // namespace locvol
