// Re-derives the paper's guarantee (engine/PROMISES.md, 1) from the stored bytes of a finished run
// alone, leaf by leaf, by other code than built it. Not that surface Delaunay balls are below λ.
#pragma once

#include <cstdint>

#include "engine/audit/audit_report.h"
#include "engine/exchange/exchange.h"
#include "engine/shared/step_progress.h"
#include "storage/store.h"

namespace locvol {

// Memory: a leaf with what lies within 2λ of it; 64 MB for the borders of leaves met before; and
// where the boundary of the mesh crosses from leaves done to leaves to do, some 100 bytes a vertex.
// Steps are leaves. Throws StoreError, CorruptRecord.
// `one_in`: checks one leaf in so many, by chance but always the same ones, with all that lies near
// it; what is told of the mesh is then of these.
AuditReport audit(const Store& store, const StepProgress& on_step = {}, std::uint64_t one_in = 1);

// audit() by all ranks of a run. Each rank checks its own leaves, for which others tell it the
// records of theirs beside them, a mebibyte at once, into a store without a name on the disk of its
// own. All get one report, that of all stores as one, but for the last digits of the volume, and
// with descriptions of the first few violations of each kind that each rank has found.
// Memory: that of audit(); 32 bytes for each two vertices of the boundary that a facet joins across
// a border; and on all ranks, 24 for each two components that are one.
AuditReport audit_as_rank(const Store& own, Exchange& exchange, const StepProgress& on_step = {},
                          std::uint64_t one_in = 1);

}  // namespace locvol
