#include "engine/inspect/crease_table.h"

#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/output/vertex_numbering.h"

namespace locvol {

CreaseTable crease_table(const Store& store, const StopToken* stop, Exchange& exchange) {
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = finished_run(store, snapshot);
  CreaseTable table;
  if (!keeps_creases(run)) return table;
  if (exchange.num_ranks() > 1) stop = nullptr;  // where ranks talk to each other, none may stop
  PageRelease pages(store);
  const std::filesystem::path place = place_for_lists(store);
  const VertexNumbering numbering(snapshot, run, place, pages, stop, exchange);
  const KeptCreases creases(snapshot, run, numbering, place, pages, stop, exchange);
  table.kept.assign(creases.kept().begin(), creases.kept().end());
  table.num_corners = creases.corners().size();
  const double floor = run.parameters.spacing_floor * run.parameters.sizes().least;
  const SurfaceSheets sheets = snapshot.sheets();
  for (CreaseId crease = 1; crease <= table.kept.size(); ++crease) {
    const double length = sheets.creases[crease - 1].length;
    const double lost = length - table.kept[crease - 1].length;
    table.length += length;
    if (lost <= 3 * floor) continue;
    table.lost_length += lost;
    table.not_whole.push_back(crease);
  }
  return table;
}

}  // namespace locvol
