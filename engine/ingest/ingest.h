// Ingest: a surface file becomes the first records of a store, cut by octree leaf.
#pragma once

#include <cstdint>
#include <functional>

#include "engine/ingest/surface_input.h"
#include "storage/store.h"

namespace locvol {

// What a run that is taken in asks, in this order. Before open_store() any may refuse, by throwing.
struct IngestCalls {
  // The surface is known; temporary files hold so many bytes.
  std::function<void(const RunRecord&, std::uint64_t temporary_bytes)> check;
  std::function<void(const RunRecord&)> begin;  // its leaves can be planned
  std::function<Store()> open_store;
  std::uint64_t memory_cap = 0;  // of the run
};

// Checks the surface, then starts `run` in the store that open_store() gives. Erases what the store
// holds. Each leaf gets the triangles that meet its box and the side of its center, and the leaves
// that may get points are queued for epoch 0. A crash leaves the store in Phase::kIngest, to be
// ingested again; the last batch ends the phase. Where the watch is stopped, the store is left in
// that phase, too. Memory: 64 MB, whatever the size of the surface, but for leaves with more than
// 100,000 triangles, whose sides are below 8 λ (200 bytes a triangle), and see check_surface().
// Throws InputError, StoreError, std::system_error where temporary files cannot be written.
// Of several processes each stores the leaves of its share. REQUIRES: their ranges begin where
// nodes of the OctreePlan's level do
Store ingest(RawSurface raw, RunRecord run, const IngestCalls& calls, IngestWatch& watch,
             Workers& workers, std::uint64_t bucket_capacity = kBucketCapacity,
             const IngestShare& share = IngestShare());

}  // namespace locvol
