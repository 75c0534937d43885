#include "engine/ingest.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/leaf_queue.h"
#include "engine/leaf_sides.h"
#include "refine/surface_patch.h"

namespace locvol {
namespace {

// Commits whenever enough is written, so that LMDB's dirty pages stay few.
class BoundedBatches {
 public:
  explicit BoundedBatches(Store& store) : store_(store) {}

  // For the records of one more leaf.
  Batch& next() {
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
  static constexpr std::uint64_t kMaxBytes = std::uint64_t{8} << 20;

  Store& store_;
  std::optional<Batch> batch_;
  int num_leaves_ = 0;
};

void erase_all(Store& store) {
  std::vector<QueueEntry> queued;
  store.snapshot().for_each_queued([&](const QueueEntry& entry) {
    queued.push_back(entry);
    return true;
  });
  const std::vector<MortonKey> leaves = store.snapshot().leaf_keys();
  BoundedBatches batches(store);
  for (const QueueEntry& entry : queued)
    batches.next().erase_queue_entry(entry.position, entry.leaf);
  for (const MortonKey leaf : leaves) batches.next().erase_leaf(leaf);
  batches.commit();
}

// Hands each leaf the triangles that meet its box, in Morton order, by descending the octree.
class SurfaceCutter {
 public:
  SurfaceCutter(const InputSurface& surface, const Frame& frame, const LinearOctree& octree,
                BoundedBatches& batches)
      : surface_(surface),
        frame_(frame),
        octree_(octree),
        batches_(batches),
        parities_(octree.size()) {}

  // Returns the leaves' center_to_corner_parities().
  std::vector<std::uint8_t> cut() {
    std::vector<std::uint64_t> all(surface_.triangles.size());
    std::iota(all.begin(), all.end(), std::uint64_t{0});
    cut(MortonKey::root(), all);
    return std::move(parities_);
  }

 private:
  // `candidates`: in order of id, all that meet the parent's box.
  void cut(MortonKey node, const std::vector<std::uint64_t>& candidates) {
    const Box box = frame_.box(node);
    std::vector<std::uint64_t> met;
    std::ranges::copy_if(candidates, std::back_inserter(met),
                         [&](std::uint64_t i) { return meets(surface_.triangle(i), box); });
    if (met.empty()) return;
    const auto leaves = octree_.leaves_under(node);
    if (leaves.front() == node) return store(leaves, met);
    for (int octant = 0; octant < 8; ++octant) cut(node.child(octant), met);
  }

  void store(std::span<const MortonKey> leaf, const std::vector<std::uint64_t>& met) {
    LeafSurface piece;
    piece.triangles.reserve(met.size());
    for (const std::uint64_t i : met) piece.triangles.push_back(surface_.triangle(i));
    parities_[static_cast<std::size_t>(leaf.data() - octree_.leaves().data())] =
        center_to_corner_parities(piece.triangles, frame_.box(leaf.front()));
    LeafInfo info;
    info.num_triangles = met.size();
    Batch& batch = batches_.next();
    batch.put_leaf(leaf.front(), info);
    batch.put_surface(leaf.front(), piece);
  }

  const InputSurface& surface_;
  const Frame& frame_;
  const LinearOctree& octree_;
  BoundedBatches& batches_;
  std::vector<std::uint8_t> parities_;
};

// Completes the leaves' infos, and queues those that may get points.
void store_sides(const LinearOctree& octree, const RunRecord& run,
                 const std::vector<bool>& is_center_inside, BoundedBatches& batches) {
  const QueuePosition waiting{0, kNoColor};
  const bool is_cover = run.parameters.init == Initialization::kCover;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const MortonKey leaf = octree.leaves()[i];
    Batch& batch = batches.next();
    LeafInfo info = batch.leaf(leaf).value_or(LeafInfo{});
    info.is_center_inside = is_center_inside[i];
    if (is_cover && (info.num_triangles > 0 || info.is_center_inside)) {
      info.queued = waiting;
      batch.put_queue_entry({waiting, leaf, run.frame.box(leaf)});
    }
    batch.put_leaf(leaf, info);
  }
}

}  // namespace

void ingest(Store& store, InputSurface surface, RunRecord run) {
  const OctreePlan plan = plan_octree(run.parameters, run.surface.box);
  run.frame = plan.frame;
  run.phase = Phase::kIngest;
  BoundedBatches batches(store);
  batches.next().put_run(run);
  batches.commit();
  erase_all(store);

  const LinearOctree octree = LinearOctree::uniform(plan.level);
  const auto parities = SurfaceCutter(surface, run.frame, octree, batches).cut();
  surface = {};
  store_sides(octree, run, center_sides(octree, parities), batches);
  run.phase = Phase::kInitialize;
  batches.next().put_run(run);
  batches.commit();
}

}  // namespace locvol
