#include "engine/replay.h"

#include <algorithm>
#include <array>
#include <limits>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "engine/leaf_loader.h"
#include "engine/leaf_name.h"
#include "engine/run_state.h"

namespace locvol {
namespace {

constexpr std::size_t kCacheBytes = std::size_t{64} << 20;

using Cells = std::vector<std::array<VertexRef, 4>>;  // sorted

void require_refinement(const Store& store) {
  const auto run = store.snapshot().run();
  if (run && run->phase >= Phase::kRefine) return;
  throw StoreError("the run in " + store.directory().string() +
                   " has not begun to refine: there is no visit to replay yet");
}

RunState state_of(Store& store) try {
  return RunState(store, kCacheBytes);
} catch (const std::invalid_argument& e) {
  throw StoreError("the store " + store.directory().string() +
                   " is damaged, its leaves are no octree: " + e.what());
}

Cells stored_cells(const Store& store, MortonKey leaf) {
  const LeafCells stored = store.snapshot().cells(leaf);
  Cells cells;
  cells.reserve(stored.cells.size());
  for (const auto& [a, b, c, d] : stored.cells)
    cells.push_back(
        {stored.vertices[a], stored.vertices[b], stored.vertices[c], stored.vertices[d]});
  std::ranges::sort(cells);
  return cells;
}

// How many of `some` are not in `others`; both sorted.
std::uint64_t num_missing(const Cells& some, const Cells& others) {
  return static_cast<std::uint64_t>(std::ranges::count_if(
      some, [&](const auto& cell) { return !std::ranges::binary_search(others, cell); }));
}

// Positions of the vertices of a visit's cells.
class VertexTable {
 public:
  explicit VertexTable(const Replay& replay, const LeafInput& input) : inserted_(replay.delta) {
    for (const MeshPoint& p : input.own) known_[p.id] = vertex(p, true);
    for (const MeshPoint& p : input.ghosts) known_[p.id] = vertex(p, false);
    for (const RefineStep& step : replay.steps)
      if (step.action == RefineStep::Action::kTakeIn)
        known_[step.point] = vertex({step.point, step.position, step.kind}, false);
    for (std::size_t i = 0; i < inserted_.inserted.size(); ++i) {
      const InsertedPoint& p = inserted_.inserted[i];
      known_[kNewPoint | i] = {-1, p.position, p.kind, input.box.contains(p.position)};
    }
  }
  CellMesh mesh_of(const Cells& cells) const {
    CellMesh mesh;
    std::unordered_map<VertexRef, std::uint32_t> index;
    for (const auto& refs : cells) {
      auto& cell = mesh.cells.emplace_back();
      for (std::size_t i = 0; i < 4; ++i) {
        const auto next = static_cast<std::uint32_t>(mesh.vertices.size());
        const auto [place, is_new] = index.try_emplace(refs[i], next);
        if (is_new) mesh.vertices.push_back(known_.at(refs[i]));
        cell[i] = place->second;
      }
    }
    return mesh;
  }

 private:
  static CellMesh::Vertex vertex(const MeshPoint& p, bool is_own) {
    return {static_cast<std::int64_t>(p.id), p.position, p.kind, is_own};
  }

  const LeafDelta& inserted_;
  std::unordered_map<VertexRef, CellMesh::Vertex> known_;  // asked, never listed
};

void visit(LeafInput& input, Replay& replay) {
  input.on_step = [&](const RefineStep& step) { replay.steps.push_back(step); };
  try {
    replay.delta = refine_leaf(input);
  } catch (const RefineError& e) {
    replay.error = e.what();
  }
}

}  // namespace

Replay replay(const Store& store, MortonKey leaf) {
  Store now = store.frozen();
  require_refinement(now);
  if (!now.snapshot().leaf(leaf))
    throw StoreError("the store " + store.directory().string() + " has no " + leaf_name(leaf));
  RunState state = state_of(now);
  MemoryBudget no_cap(std::numeric_limits<std::uint64_t>::max());
  LeafLoader loader(state, no_cap);
  LoadedLeaf loaded = loader.load(leaf);

  Replay replay;
  replay.leaf = leaf;
  replay.box = state.box(leaf);
  replay.size = state.size();
  replay.info = state.leaves.info(leaf);
  replay.num_own = loaded.input.own.size();
  replay.num_ghosts = loaded.input.ghosts.size();
  replay.num_triangles = loaded.input.surface->triangles().size();
  visit(loaded.input, replay);

  const Cells stored = stored_cells(now, leaf);
  const Cells found = std::exchange(replay.delta.cells, {});
  replay.num_stored_cells = stored.size();
  replay.num_cells_gone = num_missing(stored, found);
  replay.num_cells_new = num_missing(found, stored);
  replay.mesh = VertexTable(replay, loaded.input).mesh_of(found);
  return replay;
}

}  // namespace locvol
