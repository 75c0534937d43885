// The ranks of a run take its surface in together: each reads a part of the file, and checks and
// cuts what lies in a part of space.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "engine/exchange/exchange.h"
#include "engine/ingest/ingest.h"
#include "engine/ingest/ingest_watch.h"
#include "engine/plan/disk_room.h"
#include "engine/shared/workers.h"
#include "octree/geometry.h"
#include "storage/records.h"
#include "storage/store.h"

namespace locvol {

// Called by all ranks, with the same file. `directory`: of the rank's temporary files; `disk`: see
// disk_of_parts(). planned() is called on the first, the others are told. Gives the store that
// calls.open_store() gave, which has the leaves of a share of space: together, the records of
// ingest() by one process. Nothing, on all ranks: the file is not seen by all, not of
// SurfaceRanges, or damaged, or its surface is to be repaired: that is for one process. Memory:
// that of ingest(), of deal_triangles() and RankShare. Throws as ingest(), and Stopped: then all
// ranks do. So it is where `file` is empty: the surface is in none.
std::optional<Store> ingest_by_ranks(
    const std::filesystem::path& file, const std::filesystem::path& directory,
    const std::function<RunRecord(const std::string& digest, const Box& box)>& planned,
    const IngestCalls& calls, IngestWatch& watch, Workers& workers, Exchange& exchange,
    const DiskOf& disk, std::uint64_t bucket_capacity = kBucketCapacity);

}  // namespace locvol
