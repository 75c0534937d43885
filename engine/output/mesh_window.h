// What a thread reads a finished mesh with.
#pragma once

#include "engine/output/vertex_numbering.h"
#include "engine/output/vertex_positions.h"
#include "engine/shared/idle_pool.h"
#include "storage/store.h"

namespace locvol {

struct MeshWindow {
  // Both must outlive it. `num_shares`: so many divide the memory that one may take.
  MeshWindow(const Store& store, const VertexNumbering& numbering, int num_shares)
      : snapshot(store.snapshot()),
        numbers(snapshot, numbering, num_shares),
        positions(snapshot, numbering, num_shares) {}

  const Snapshot snapshot;
  NumberWindow numbers;
  VertexPositions positions;
};
using MeshWindows = LendingPool<MeshWindow>;

}  // namespace locvol
