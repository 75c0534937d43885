#include "engine/leaf_loader.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <utility>

namespace locvol {
namespace {

constexpr double kSlack = 1.01;  // on distances whose exact value does not matter

// Where a fraction of λ keeps the lattice off the planes of the octree and of most models.
constexpr Point kLatticeOffset{0.1370, 0.2718, 0.3517};

// A visit that inserts more than any mesh needs is a bug (DESIGN 3.6).
std::uint64_t max_insertions(std::uint64_t leaf_capacity) { return 50 * leaf_capacity + 100000; }

}  // namespace

LeafLoader::LeafLoader(RunState& state) : state_(state) {
  if (state_.is_cover()) return;
  const Box root = state_.run.frame.root_box();
  whole_surface_ =
      std::make_unique<SurfacePatch>(triangles_meeting(root), root, root.min, false, state_.size());
  all_points_.emplace(state_.size());
  for (const MortonKey leaf : state_.octree.leaves())
    for (const MeshPoint& point : state_.leaves.points(leaf).points) all_points_->insert(point);
}

LoadedCover LeafLoader::load_cover(MortonKey leaf) {
  const double size = state_.size();
  LoadedCover loaded{.patch = patch_around(leaf, kSlack * size), .input = {}};
  loaded.input = {.size = size,
                  .seed = state_.run.parameters.seed,
                  .lattice_origin = state_.run.frame.origin() + size * kLatticeOffset,
                  .box = state_.box(leaf),
                  .surface = loaded.patch.get(),
                  .nearby_samples = {}};
  for (const MeshPoint& point : points_around(leaf, kSampleRadius * size))
    if (point.kind == PointKind::kSurface) loaded.input.nearby_samples.push_back(point.position);
  return loaded;
}

LoadedLeaf LeafLoader::load(MortonKey leaf) {
  const double size = state_.size();
  const double ghost_distance = state_.is_cover() ? kReach * size : kNeighborhood * size;
  LoadedLeaf loaded;
  if (state_.is_cover()) loaded.patch = patch_around(leaf, kSlack * kReach / 2 * size);
  loaded.input = {.criteria = criteria(),
                  .box = state_.box(leaf),
                  .own = state_.leaves.points(leaf).points,
                  .ghosts = points_around(leaf, ghost_distance),
                  .surface = state_.is_cover() ? loaded.patch.get() : whole_surface_.get(),
                  .all_points = all_points_ ? &*all_points_ : nullptr,
                  .max_own_points = max_own_points(leaf),
                  .max_insertions = max_insertions(state_.run.parameters.leaf_capacity)};
  return loaded;
}

void LeafLoader::note_inserted(const MeshPoint& point) {
  if (all_points_) all_points_->insert(point);
}

void LeafLoader::note_deleted(const MeshPoint& point) {
  if (all_points_) all_points_->erase(point);
}

Criteria LeafLoader::criteria() const {
  const double size = state_.size();
  return {.size = size,
          .radius_edge_bound = state_.run.parameters.radius_edge_bound,
          .reach = state_.is_cover() ? kReach * size : std::numeric_limits<double>::infinity(),
          .spacing_floor = state_.run.parameters.spacing_floor * size};
}

// κ, or no bound where the children would be too small.
std::uint64_t LeafLoader::max_own_points(MortonKey leaf) const {
  const bool may_split = leaf.level() < MortonKey::kMaxLevel &&
                         state_.run.frame.side(leaf.level() + 1) >= kMinChildSide * state_.size();
  return may_split ? state_.run.parameters.leaf_capacity : 0;
}

std::unique_ptr<const SurfacePatch> LeafLoader::patch_around(MortonKey leaf, double distance) {
  const Box box = state_.box(leaf);
  const Box region = box.expanded(distance);
  return std::make_unique<SurfacePatch>(triangles_meeting(region), region, box.center(),
                                        state_.leaves.info(leaf).is_center_inside, state_.size());
}

// Each once, in order of id; and some more, that only come close.
std::vector<Triangle> LeafLoader::triangles_meeting(const Box& region) {
  std::vector<Triangle> triangles;
  for (const MortonKey leaf : state_.octree.leaves_within(state_.run.frame, region, 0))
    std::ranges::copy_if(state_.leaves.surface(leaf).triangles, std::back_inserter(triangles),
                         [&](const Triangle& t) { return t.box().overlaps(region); });
  std::ranges::sort(triangles, {}, &Triangle::id);
  const auto repeated = std::ranges::unique(triangles, {}, &Triangle::id);
  triangles.erase(repeated.begin(), repeated.end());
  return triangles;
}

std::vector<MeshPoint> LeafLoader::points_around(MortonKey leaf, double distance) {
  const Box box = state_.box(leaf);
  std::vector<MeshPoint> around;
  for (const MortonKey other : state_.octree.leaves_within(state_.run.frame, box, distance)) {
    if (other == leaf) continue;
    std::ranges::copy_if(state_.leaves.points(other).points, std::back_inserter(around),
                         [&](const MeshPoint& p) {
                           return box.squared_distance(p.position) <= distance * distance;
                         });
  }
  std::ranges::sort(around, {}, &MeshPoint::id);
  return around;
}

}  // namespace locvol
