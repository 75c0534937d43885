// Ingest: a surface file becomes the first records of a store, cut by octree leaf.
#pragma once

#include <filesystem>
#include <functional>

#include "engine/ingest/surface_input.h"
#include "engine/plan/options.h"
#include "storage/store.h"

namespace locvol {

// Checks the surface, then starts `run` in the store that `open_store` gives; it is asked for one
// when nothing can be refused any more, nor by `check_run`, which gets the run with all that is
// known of its surface, and what temporary files hold. Erases what the store holds. Each leaf gets
// the triangles that meet its box and the side of its center, and the leaves that may get points
// are queued for epoch 0. A crash leaves the store in Phase::kIngest, to be ingested again; the
// last batch ends the phase. Where `stop` says so, the store is left in that phase, too. Memory: 64
// MB, whatever the size of the surface, but for leaves with more than 100,000 triangles, whose
// sides are below 8 λ (200 bytes a triangle), and see check_surface(). Throws InputError,
// StoreError, std::system_error where temporary files cannot be written.
using RunCheck = std::function<void(const RunRecord&, std::uint64_t temporary_bytes)>;
Store ingest(RawSurface raw, RunRecord run, const RunCheck& check_run,
             const std::function<Store()>& open_store, const RunControl& control,
             const StopSource& stop, std::uint64_t bucket_capacity = kBucketCapacity);

// Tells the user of `control`, in Phase::kIngest, who is asked through `stop`.
IngestWatch watch_of(const RunControl& control, const StopSource& stop);

}  // namespace locvol
