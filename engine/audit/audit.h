// Re-derives the paper's guarantee (engine/PROMISES.md, 1) from the stored bytes of a finished run
// alone, leaf by leaf, by other code than built it. Not that surface Delaunay balls are below λ.
#pragma once

#include "engine/audit/audit_report.h"
#include "engine/shared/step_progress.h"
#include "storage/store.h"

namespace locvol {

// Memory: a leaf with what lies within 2λ of it; 64 MB for the borders of leaves met before; and
// where the boundary of the mesh crosses from leaves done to leaves to do, some 100 bytes a vertex.
// Steps are leaves. Throws StoreError, CorruptRecord.
AuditReport audit(const Store& store, const StepProgress& on_step = {});

}  // namespace locvol
