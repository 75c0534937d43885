#include "engine/inspect/replay.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "engine/run/leaf_loader.h"
#include "engine/run/point_grid.h"
#include "engine/run/run_state.h"
#include "engine/shared/leaf_name.h"

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

Cells sorted(const CellList& list) {
  Cells cells;
  cells.reserve(list.size());
  for (std::size_t i = 0; i < list.size(); ++i) cells.push_back(list.refs(i));
  std::ranges::sort(cells);
  return cells;
}

Cells stored_cells(const Store& store, MortonKey leaf) {
  LeafCells stored = store.snapshot().cells(leaf);
  return sorted({std::move(stored.vertices), std::move(stored.cells)});
}

// How many of `some` are not in `others`; both sorted.
std::uint64_t num_missing(const Cells& some, const Cells& others) {
  return static_cast<std::uint64_t>(std::ranges::count_if(
      some, [&](const auto& cell) { return !std::ranges::binary_search(others, cell); }));
}

// Positions of the vertices of a visit's cells.
class VertexTable {
 public:
  VertexTable(const Replay& replay, const LeafInput& input, const std::vector<MeshPoint>& core) {
    for (const MeshPoint& p : input.own) known_[p.id] = vertex(p, true);
    for (const auto* others : {&input.ghosts, &core})
      for (const MeshPoint& p : *others) known_[p.id] = vertex(p, false);
    for (const RefineStep& step : replay.steps)
      if (step.action == RefineStep::Action::kTakeIn)
        known_[step.point] = vertex({step.point, step.position, step.kind}, false);
    for (std::size_t i = 0; i < replay.delta.inserted.size(); ++i) {
      const InsertedPoint& p = replay.delta.inserted[i];
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

  std::unordered_map<VertexRef, CellMesh::Vertex> known_;  // asked, never listed
};

// Core points one by one.
class CoreList : public CoreIndex {
 public:
  explicit CoreList(const std::vector<MeshPoint>& points) : points_(points) {}
  bool contains(const LatticeSite& site) const override {
    return std::ranges::binary_search(points_, site_id(site), {}, &MeshPoint::id);
  }
  void within(const Point& q, double radius, std::vector<MeshPoint>& out) const override {
    out.clear();
    std::ranges::copy_if(points_, std::back_inserter(out), [&](const MeshPoint& p) {
      return squared_distance(p.position, q) <= radius * radius;
    });
  }

 private:
  const std::vector<MeshPoint>& points_;
};

std::vector<MeshPoint> all_points(RunState& state) {
  std::vector<MeshPoint> points;
  for (const MortonKey leaf : state.octree().leaves()) {
    const std::vector<MeshPoint>& own = state.leaves().points(leaf).points;
    points.insert(points.end(), own.begin(), own.end());
  }
  return points;
}

PointGrid index_of(const std::vector<MeshPoint>& points, double size) {
  PointGrid index(size);
  for (const MeshPoint& point : points) index.insert(point);
  return index;
}

}  // namespace

StoredVisit stored_visit(const Store& store, MortonKey leaf) {
  Store now = store.frozen();
  require_refinement(now);
  if (!now.snapshot().leaf(leaf))
    throw StoreError("the store " + store.directory().string() + " has no " + leaf_name(leaf));
  RunState state = state_of(now);
  MemoryBudget no_cap(std::numeric_limits<std::uint64_t>::max());
  LeafLoader loader(state, no_cap);
  LoadedLeaf loaded = loader.load(leaf);
  if (!state.leaves().info(leaf).queued) loaded.input.last_visit.reset();  // shows all of the leaf

  StoredVisit visit;
  visit.leaf = leaf;
  visit.is_clean = !state.leaves().info(leaf).queued;
  visit.num_left_out = state.leaves().info(leaf).num_left_out;
  visit.num_visits = state.leaves().info(leaf).num_visits;
  const SurfacePatch& surface = *loaded.complete().surface;
  visit.triangles.assign(surface.triangles().begin(), surface.triangles().end());
  visit.region = surface.region();
  visit.is_center_inside = surface.is_inside(loaded.input.box.center());
  if (!state.is_cover()) visit.all_points = all_points(state);
  if (loaded.core) visit.core = loaded.core->points();
  visit.cells = stored_cells(now, leaf);
  visit.input = std::move(loaded.input);
  visit.input.surface = nullptr;
  visit.input.all_points = nullptr;
  visit.input.core = nullptr;
  return visit;
}

Replay replay(const StoredVisit& visit) {
  Replay replay;
  LeafInput input = visit.input;
  const double size = input.criteria.size;
  const SurfacePatch surface(visit.triangles, visit.region, input.box.center(),
                             visit.is_center_inside, GridFineness{size});
  const PointGrid index = index_of(visit.all_points.value_or(std::vector<MeshPoint>()), size);
  input.surface = &surface;
  input.all_points = visit.all_points ? &index : nullptr;
  const CoreList core(visit.core);
  input.core = visit.core.empty() ? nullptr : &core;
  input.on_step = [&](const RefineStep& step) { replay.steps.push_back(step); };
  try {
    replay.delta = refine_leaf(input);
  } catch (const RefineError& e) {
    replay.error = e.what();
  } catch (const std::logic_error& e) {  // of CGAL, or of the standard library
    replay.error = e.what();
  }
  const Cells found = sorted(std::exchange(replay.delta.cells, {}));
  replay.num_cells_gone = num_missing(visit.cells, found);
  replay.num_cells_new = num_missing(found, visit.cells);
  replay.num_left_out = visit.num_left_out;
  replay.mesh = VertexTable(replay, input, visit.core).mesh_of(found);
  return replay;
}

}  // namespace locvol
