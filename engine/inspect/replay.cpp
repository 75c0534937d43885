#include "engine/inspect/replay.h"

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <type_traits>
#include <unordered_map>
#include <utility>

#include "engine/plan/phases.h"
#include "engine/run/listed_cells.h"
#include "engine/run/point_grid.h"
#include "engine/run/run_state.h"
#include "engine/run/surroundings.h"
#include "engine/run/whole_model.h"
#include "engine/shared/leaf_name.h"
#include "engine/stages/refine_stage.h"
#include "octree/mix.h"
#include "refine/leaf_fields.h"
#include "refine/refine_leaf.h"

namespace locvol {
namespace {

constexpr std::size_t kCacheBytes = std::size_t{64} << 20;

using Cells = std::vector<NamedCell>;  // sorted

void require_refinement(const Store& store) {
  const auto run = store.snapshot().run();
  if (run && are_first_points_known(run->phase)) return;
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
  for (std::size_t i = 0; i < list.size(); ++i) cells.push_back({list.refs(i), list.cells[i].body});
  std::ranges::sort(cells);
  return cells;
}

Cells stored_cells(const Store& store, MortonKey leaf) {
  return sorted(listed_cells(store.snapshot().cells(leaf)));
}

// How many of `some` are not in `others`; both sorted.
std::uint64_t num_missing(const Cells& some, const Cells& others) {
  return static_cast<std::uint64_t>(std::ranges::count_if(
      some, [&](const auto& cell) { return !std::ranges::binary_search(others, cell); }));
}

// Positions of the vertices of a visit's cells.
class VertexTable {
 public:
  VertexTable(const Replay& replay, const LeafInput& input) {
    for (const MeshPoint& p : input.own) known_[p.id] = vertex(p, true);
    for (const MeshPoint& p : input.ghosts) known_[p.id] = vertex(p, false);
    for (const auto& [first, count, body] : input.core.rows)
      for (std::int32_t n = 0; n < static_cast<std::int32_t>(count); ++n) {
        const MeshPoint p = input.core.lattice.point(first + LatticeSite{0, 0, 2 * n});
        known_[p.id] = vertex(p, false);
      }
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
    for (const auto& [refs, of_body] : cells) {
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

std::vector<MeshPoint> all_points(const RunView& state) {
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

// A hash of all members, to the last bit.
class Digest {
 public:
  std::uint64_t value() const { return value_; }
  template <class T>
  void add(const T& value) {
    if constexpr (std::same_as<T, double>) {
      add(std::bit_cast<std::uint64_t>(value));
    } else if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      value_ = mix(value_ ^ static_cast<std::uint64_t>(value));
    } else if constexpr (HasFields<const T>) {
      for_each_field(value, [this](const char*, const auto& member) { add(member); });
    } else if constexpr (requires { value.has_value(); }) {
      add(value.has_value());
      if (value) add(*value);
    } else {
      add(value.size());
      for (const auto& item : value) add(item);
    }
  }

 private:
  std::uint64_t value_ = 0;
};

std::uint64_t digest_of(const LeafDelta& delta) {
  Digest digest;
  digest.add(delta);
  return digest.value();
}

}  // namespace

StoredVisit stored_visit(const Store& store, MortonKey leaf) {
  Store now = store.frozen();
  require_refinement(now);
  if (!now.snapshot().leaf(leaf))
    throw StoreError("the store " + store.directory().string() + " has no " + leaf_name(leaf));
  RunState state = state_of(now);
  MemoryBudget no_cap(std::numeric_limits<std::uint64_t>::max());
  HeldModel model(state, no_cap);
  Loaded<LeafInput> loaded = load_refine(state, Surroundings(state), model, leaf);
  if (!state.leaves().info(leaf).queued) {
    loaded.input.last_visit.reset();  // shows all of the leaf
    // What C7 could not improve it might now, after what other leaves have done.
    loaded.input.criteria.min_dihedral = 0;
    loaded.input.waiting.clear();
  }

  StoredVisit visit;
  visit.leaf = leaf;
  visit.is_clean = !state.leaves().info(leaf).queued;
  visit.num_left_out = state.leaves().info(leaf).num_left_out;
  visit.num_visits = state.leaves().info(leaf).num_visits;
  visit.input = std::move(loaded.input);
  if (model.whole().domain != nullptr) {
    visit.all_points = all_points(state);
    visit.input.domain = Surroundings(state).whole_domain({state.size()});
  }
  visit.cells = stored_cells(now, leaf);
  return visit;
}

Replay replay(const StoredVisit& visit) {
  Replay replay;
  const PointGrid index =
      index_of(visit.all_points.value_or(std::vector<MeshPoint>()), visit.input.criteria.size);
  const auto note = [&](const RefineStep& step) { replay.steps.push_back(step); };
  try {
    replay.delta = refine_leaf(visit.input, {.on_step = note},
                               {.points = visit.all_points ? &index : nullptr});
  } catch (const RefineError& e) {
    replay.error = e.what();
  } catch (const std::logic_error& e) {  // of CGAL, or of the standard library
    replay.error = e.what();
  }
  replay.digest = digest_of(replay.delta);
  const Cells found = sorted(std::exchange(replay.delta.cells, {}));
  replay.num_cells_gone = num_missing(visit.cells, found);
  replay.num_cells_new = num_missing(found, visit.cells);
  replay.num_left_out = visit.num_left_out;
  replay.mesh = VertexTable(replay, visit.input).mesh_of(found);
  return replay;
}

}  // namespace locvol
