#include "engine/ingest/ingest.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/image_sizes.h"
#include "engine/ingest/ingest_share.h"
#include "engine/ingest/nearest_sheets.h"
#include "engine/ingest/polyline_edges.h"
#include "engine/ingest/start_leaves.h"
#include "engine/ingest/surface_bodies.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_creases.h"
#include "engine/ingest/surface_sheets.h"
#include "engine/plan/octree_plan.h"
#include "engine/plan/part_sizes.h"
#include "engine/plan/phases.h"
#include "engine/run/leaf_queue.h"
#include "engine/run/leaf_states.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/surface_part.h"
#include "refine/domain/triangle_box.h"

namespace locvol {
namespace {

// Commits whenever enough is written, so that LMDB's dirty pages stay few.
class BoundedBatches {
 public:
  BoundedBatches(Store& store, const StopToken* stop) : store_(store), stop_(stop) {}

  // For the records of one more leaf. Throws Stopped.
  Batch& next() {
    throw_if_stopped(stop_);
    if (batch_ && (num_leaves_ >= kMaxLeaves || batch_->bytes_written() > kMaxBytes)) commit();
    if (!batch_) batch_.emplace(store_.begin());
    ++num_leaves_;
    return *batch_;
  }
  void commit() {
    if (!batch_) return;
    batch_->commit();
    batch_.reset();
    num_leaves_ = 0;
    store_.release_pages();
  }

 private:
  static constexpr int kMaxLeaves = 2000;
  static constexpr std::uint64_t kMaxBytes = std::uint64_t{4} << 20;

  Store& store_;
  const StopToken* stop_;
  std::optional<Batch> batch_;
  int num_leaves_ = 0;
};

void erase_all(Store& store, const StopToken* stop) {
  std::vector<QueueEntry> queued;
  store.snapshot().for_each_queued([&](const QueueEntry& entry) {
    queued.push_back(entry);
    return true;
  });
  const std::vector<MortonKey> leaves = store.snapshot().leaf_keys();
  BoundedBatches batches(store, stop);
  for (const QueueEntry& entry : queued) batches.next().erase_queue_entry(entry);
  for (const MortonKey leaf : leaves) batches.next().erase_leaf(leaf);
  batches.commit();
}

// A leaf with more triangles is cut as far as its children remain wide enough.
constexpr std::uint64_t kMaxLeafTriangles = 50'000;

// Hands each leaf the triangles that meet its box, and of creases what does, in Morton order, by
// descending to the buckets and from there, or from larger leaves, to the leaves.
class SurfaceCutter {
 public:
  // `cells`: see cells_near_surface(); those whose leaves are wanted.
  SurfaceCutter(const CheckedSurface& surface, const CreasesOfCells& creases,
                std::span<const MortonKey> cells, const RunRecord& run, BoundedBatches& batches,
                IngestWatch& watch)
      : surface_(surface),
        creases_(creases),
        cells_(cells),
        frame_(run.frame),
        sides_(run.parameters, {run.frame, 0}),
        may_split_(run.parameters.init == Initialization::kCover),
        batches_(batches),
        watch_(watch) {}

  CutLeaves cut() {
    descend(MortonKey::root(), cells_);
    return std::move(leaves_);
  }

 private:
  using Cells = std::span<const MortonKey>;  // under a node, or the one that it lies in

  // Above the buckets.
  void descend(MortonKey node, Cells cells) {
    if (cells.empty()) return;
    const auto buckets = surface_.buckets.under(node);
    if (buckets.size() == 1 && buckets.front().cell.is_ancestor_or_self_of(node)) {
      cut(node, cells, surface_in(buckets.front()));
      watch_.advance(buckets.front().triangles.count);
    } else if (is_leaf(node, cells) && !is_to_be_split(node, buckets)) {
      store(node, gathered(buckets));
    } else {
      for_each_child(node, cells,
                     [&](MortonKey child, Cells of_child) { descend(child, of_child); });
    }
  }

  LeafSurface surface_in(const TriangleBucket& bucket) const {
    LeafSurface surface{surface_.load(bucket)};
    creases_.add_to(static_cast<std::size_t>(&bucket - surface_.buckets.all().data()), surface);
    return surface;
  }

  // `candidates`: all that meets the node's box, and others.
  void cut(MortonKey node, Cells cells, const LeafSurface& candidates) {
    if (cells.empty()) return;
    const Box box = frame_.box(node);
    LeafSurface met;
    std::ranges::copy_if(candidates.triangles, std::back_inserter(met.triangles),
                         [&](const Triangle& t) { return touches(t, box); });
    append_creases(box, candidates, met);
    if (is_leaf(node, cells) &&
        !(may_split(node) && num_owned(met.triangles, box) > kMaxLeafTriangles))
      return store(node, met);
    for_each_child(node, cells,
                   [&](MortonKey child, Cells of_child) { cut(child, of_child, met); });
  }

  template <class Visit>
  static void for_each_child(MortonKey node, Cells cells, const Visit& visit) {
    const bool is_in_cell = is_leaf(node, cells);
    for (int octant = 0; octant < 8; ++octant) {
      const MortonKey child = node.child(octant);
      if (is_in_cell) {
        visit(child, cells);
        continue;
      }
      const auto end = std::ranges::upper_bound(cells, child.range_max());
      visit(child, Cells(cells.begin(), end));
      cells = Cells(end, cells.end());
    }
  }

  static bool is_leaf(MortonKey node, Cells cells) {
    return cells.front().is_ancestor_or_self_of(node);
  }
  bool may_split(MortonKey node) {
    return may_split_ && node.level() < MortonKey::kMaxLevel &&
           frame_.side(node.level() + 1) >= kMinLeafSide * sides_.least_size(node);
  }
  bool is_to_be_split(MortonKey node, std::span<const TriangleBucket> buckets) {
    if (!may_split(node)) return false;
    std::uint64_t at_most = 0, num_triangles = 0;
    for (const TriangleBucket& bucket : buckets) at_most += bucket.triangles.count;
    if (at_most <= kMaxLeafTriangles) return false;
    for (const TriangleBucket& bucket : buckets)
      num_triangles += num_owned(surface_.load(bucket), frame_.box(bucket.cell));
    return num_triangles > kMaxLeafTriangles;
  }
  // Does not depend on the buckets: each triangle counts in one cell.
  static std::uint64_t num_owned(const std::vector<Triangle>& triangles, const Box& box) {
    return static_cast<std::uint64_t>(
        std::ranges::count_if(triangles, [&](const Triangle& t) { return owns_triangle(box, t); }));
  }

  LeafSurface gathered(std::span<const TriangleBucket> buckets) const {
    LeafSurface surface;
    for (const TriangleBucket& bucket : buckets) {
      const LeafSurface held = surface_in(bucket);
      surface.append(held);
      watch_.advance(held.size());
    }
    surface.unite();
    return surface;
  }

  void store(MortonKey leaf, const LeafSurface& surface) {
    throw_if_stopped(watch_.stop());
    leaves_.keys.push_back(leaf);
    leaves_.corners.push_back(center_to_corners(frame_.box(leaf), surface));
    if (surface.is_empty()) return;
    LeafInfo info;
    info.num_triangles = surface.size();
    Batch& batch = batches_.next();
    batch.put_leaf(leaf, info);
    batch.put_surface(leaf, surface);
  }

  const CheckedSurface& surface_;
  const CreasesOfCells& creases_;
  Cells cells_;
  const Frame& frame_;
  StartSides sides_;
  bool may_split_;
  BoundedBatches& batches_;
  IngestWatch& watch_;
  CutLeaves leaves_;
};

// Leaves of the start, in Morton order, and the states of their centers.
struct StartLeaves {
  std::vector<MortonKey> keys;
  std::vector<DomainState> centers;

  void add(MortonKey key, DomainState center) {
    keys.push_back(key);
    centers.push_back(center);
  }
  // Those that begin in the range, of all.
  void keep(const KeyRange& range) {
    const auto begun = range.begun_of(keys);
    const auto first = begun.data() - keys.data(), end = first + std::ssize(begun);
    const auto keep_these = [&](auto& list) {
      list.erase(list.begin() + end, list.end());
      list.erase(list.begin(), list.begin() + first);
    };
    keep_these(keys);
    keep_these(centers);
  }
};

// `state`: of all of the node
void add_parts(MortonKey node, int level, DomainState state, StartLeaves& leaves) {
  if (node.level() == level) return leaves.add(node, state);
  for (int octant = 0; octant < 8; ++octant) add_parts(node.child(octant), level, state, leaves);
}

// Of the centers of its leaves. `octree`: the coarsest with the leaves `near`
std::vector<DomainState> states_of(const LinearOctree& octree, const CutLeaves& near) {
  std::vector<CornerStates> corners(octree.size());
  for (std::size_t i = 0, n = 0; i < octree.size() && n < near.keys.size(); ++i)
    if (octree.leaves()[i] == near.keys[n]) corners[i] = near.corners[n++];
  return center_states(octree, corners);
}

// Leaves away from the surface are as large as can be outside, and of `level` inside, if lattice
// points are to come there.
StartLeaves completed(const CutLeaves& near, int level, bool has_volume) {
  const LinearOctree octree = LinearOctree::coarsest_with(near.keys);
  const std::vector<DomainState> states = states_of(octree, near);
  StartLeaves leaves;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const MortonKey leaf = octree.leaves()[i];
    if (!has_volume || states[i].body() == kNoBody || leaf.level() >= level)
      leaves.add(leaf, states[i]);
    else
      add_parts(leaf, level, states[i], leaves);
  }
  return leaves;
}

// Where sizes grow from the surface inwards, leaves do: those inside are at most twice as wide as
// the ones beside them, and as narrow as shapes and the largest size ask for.
StartLeaves completed_by_size(const CutLeaves& near, const Frame& frame, StartSides& sides_wanted) {
  LinearOctree octree = LinearOctree::coarsest_with(near.keys);
  const std::vector<DomainState> states = states_of(octree, near);
  std::map<MortonKey, DomainState> at_first;  // of leaves to begin with
  for (std::size_t i = 0; i < octree.size(); ++i) at_first.emplace(octree.leaves()[i], states[i]);
  const auto is_near_surface = [&](MortonKey leaf) {
    return std::ranges::binary_search(near.keys, leaf);
  };
  const auto state_of = [&](MortonKey leaf) {  // of it, or of the one that it is a part of
    while (!at_first.contains(leaf)) leaf = leaf.parent();
    return at_first.at(leaf);
  };
  const auto is_outside = [&](MortonKey leaf) { return state_of(leaf).body() == kNoBody; };
  std::vector<MortonKey> wide(octree.leaves().begin(), octree.leaves().end());
  while (!wide.empty()) {
    const MortonKey leaf = wide.back();
    wide.pop_back();
    if (is_outside(leaf) || is_near_surface(leaf) || sides_wanted.is_narrow_inside(leaf)) continue;
    octree.split(leaf);
    for (int octant = 0; octant < 8; ++octant) wide.push_back(leaf.child(octant));
  }
  std::vector<MortonKey> small(octree.leaves().begin(), octree.leaves().end());
  std::ranges::stable_sort(small, std::ranges::greater(), &MortonKey::level);
  for (std::size_t n = 0; n < small.size(); ++n) {
    const MortonKey leaf = small[n];
    if (!octree.is_leaf(leaf)) continue;
    for (const MortonKey beside : octree.leaves_within(frame, frame.box(leaf), 0)) {
      if (beside.level() + 1 >= leaf.level() || is_outside(beside) || is_near_surface(beside))
        continue;
      octree.split(beside);
      for (int octant = 0; octant < 8; ++octant) small.push_back(beside.child(octant));
      small.push_back(leaf);  // its children may still be too wide
    }
  }
  StartLeaves leaves;
  for (const MortonKey leaf : octree.leaves()) leaves.add(leaf, state_of(leaf));
  return leaves;
}

// Completes the leaves' infos, and queues those that may get points.
void store_leaves(const StartLeaves& leaves, const RunRecord& run, BoundedBatches& batches) {
  const QueuePosition waiting{0, kNoColor};
  const bool is_cover = run.parameters.init == Initialization::kCover;
  // Those inside are as large as can be then, and have nothing to be visited for.
  const bool has_surface_alone =
      run.parameters.is_surface_only && run.parameters.sizes().is_uniform();
  for (std::size_t i = 0; i < leaves.keys.size(); ++i) {
    const MortonKey leaf = leaves.keys[i];
    Batch& batch = batches.next();
    LeafInfo info = batch.leaf(leaf).value_or(LeafInfo{});
    info.center = leaves.centers[i];
    if (is_cover && (has_surface_alone ? info.has_surface() : info.meets_domain())) {
      info.queued = waiting;
      batch.put_queue_entry({waiting, leaf});
    }
    batch.put_leaf(leaf, info);
  }
}

// Each to the leaf that it lies in, or to those in it.
void store_image_nodes(const std::vector<MortonKey>& leaves, const RunRecord& run,
                       BoundedBatches& batches, const StopToken* stop) {
  std::vector<std::pair<std::size_t, SizedNode>> owned;
  const auto take = [&](std::span<const SizedNode> nodes) {
    owned.clear();
    for (const SizedNode& node : nodes) {
      auto leaf = std::ranges::partition_point(
          leaves, [&](MortonKey l) { return l.range_max() < node.key.range_min(); });
      for (; leaf != leaves.end() && leaf->range_min() <= node.key.range_max(); ++leaf)
        owned.emplace_back(static_cast<std::size_t>(leaf - leaves.begin()), node);
    }
    std::ranges::stable_sort(owned, {}, &std::pair<std::size_t, SizedNode>::first);
    for (auto first = owned.begin(); first != owned.end();) {
      const MortonKey leaf = leaves[first->first];
      Batch& batch = batches.next();
      LeafSizes sizes = batch.sizes(leaf);
      for (const std::size_t n = first->first; first != owned.end() && first->first == n; ++first)
        sizes.nodes.push_back(first->second);
      unite(sizes.nodes);
      batch.put_sizes(leaf, sizes);
    }
  };
  read_image_nodes(run.image_file, run, take, stop);
}

// Of a run that begins.
void put_run(Store& store, const RunRecord& run, const SurfaceSheets& sheets) {
  Batch batch = store.begin();
  batch.put_run(run);
  batch.put_sheets(sheets);
  batch.put_timeline({});
  batch.commit();
}

}  // namespace

Store ingest(RawSurface raw, RunRecord run, const IngestCalls& calls, IngestWatch& watch,
             Workers& workers, std::uint64_t bucket_capacity, const IngestShare& share) {
  const OctreePlan plan = plan_octree(run.parameters, raw.box);
  run.frame = plan.frame;
  run.phase = Phase::kIngest;
  std::optional<Store> store;
  try {
    const BodyLaw law =
        body_law(run.parameters.has_bodies, run.parameters.voids, run.surface.more_files.size());
    raw.has_several_bodies = law.has_several();
    CheckedSurface surface =
        check_surface(std::move(raw), plan.frame, watch, workers, bucket_capacity, share,
                      run.parameters.weld, run.parameters.sharp_angle, run.parameters.gap,
                      {run.parameters.inside, run.parameters.size, calls.memory_cap});
    std::vector<BodyFacts> bodies = number_bodies(surface, law, watch, workers);
    find_given_edges(surface, {run.sharp_file, run.parameters.sharp_polylines, run.parameters.weld},
                     watch, workers, share);
    const double size = run.parameters.size;
    SurfaceSheets sheets = number_sheets(
        surface, SheetLaw::of_size(size, run.parameters.sharp_angle, run.parameters.spacing_floor),
        watch, workers, share);
    sheets.bodies = std::move(bodies);
    sheets.nearest = nearest_sheets(surface, run.parameters.sheet_sizes, watch, share);
    require_sized_parts(run.parameters, sheets);
    const CreasesOfCells creases = find_creases(surface,
                                                {.sharp_angle = run.parameters.sharp_angle,
                                                 .least_extent = kLeastCreaseExtent * size,
                                                 .least_distance = kLeastCreaseDistance * size},
                                                watch, workers, share, sheets);
    const SurfaceFacts planned = std::exchange(run.surface, surface.facts);
    run.surface.file = planned.file;
    run.surface.more_files = planned.more_files;
    run.has_creases = !sheets.creases.empty() || sheets.num_corners > 0;
    calls.check(run, surface.spill.bytes());
    const std::vector<MortonKey> cells = cells_near_surface(surface, run.parameters, watch, share);
    calls.begin(run);

    store.emplace(calls.open_store());
    put_run(*store, run, sheets);
    erase_all(*store, watch.stop());
    BoundedBatches batches(*store, watch.stop());
    const KeyRange range = share.range();
    CutLeaves cut =
        SurfaceCutter(surface, creases, range.begun_of(cells), run, batches, watch).cut();
    share.join_leaves(cut);
    const bool is_uniform = run.parameters.sizes().is_uniform();
    StartSides sides(run.parameters, plan);
    const bool has_volume = !run.parameters.is_surface_only;
    StartLeaves leaves = is_uniform ? completed(cut, plan.level, has_volume)
                                    : completed_by_size(cut, run.frame, sides);
    leaves.keep(range);
    store_leaves(leaves, run, batches);
    if (run.parameters.has_image()) store_image_nodes(leaves.keys, run, batches, watch.stop());
    run.phase = next_phase(run, Phase::kIngest);
    batches.next().put_run(run);
    batches.commit();
  } catch (const Stopped&) {
    if (!store) store.emplace(calls.open_store());
    put_run(*store, run, {});
  }
  return std::move(*store);
}

}  // namespace locvol
