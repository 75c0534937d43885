// Ingest: a surface in memory becomes the first records of a store, cut by octree leaf.
#pragma once

#include "engine/run_setup.h"
#include "engine/surface_input.h"
#include "storage/store.h"

namespace locvol {

// Erases what the store holds and starts `run` in it: each leaf gets the triangles that meet its
// box and the side of its center, and the leaves that may get points are queued for epoch 0. A
// crash leaves the store in Phase::kIngest, to be ingested again; the last batch ends the phase.
// Memory: the surface, 16 bytes a triangle and a few bytes a leaf; the surface is freed on return.
// Throws InputError (see plan_octree), StoreError.
void ingest(Store& store, InputSurface surface, RunRecord run);

}  // namespace locvol
