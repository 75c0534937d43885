#include "engine/output/stored_mesh.h"

#include <unistd.h>

#include <algorithm>
#include <stdexcept>
#include <string>

#include "engine/shared/leaf_name.h"
#include "engine/shared/scratch_directory.h"

namespace locvol {
namespace {

constexpr double kRoundingSlack = 1 + 1e-9;  // for the rounding of distances between boxes

std::string name_of(const Store& store) { return "the store " + store.directory().string(); }

}  // namespace

RunRecord stored_run(const Store& store, const Reader& reader) {
  auto run = reader.run();
  if (!run) throw StoreError(name_of(store) + " holds no run");
  return *std::move(run);
}

RunRecord finished_run(const Store& store, const Reader& reader) {
  RunRecord run = stored_run(store, reader);
  if (run.phase != Phase::kDone)
    throw StoreError(name_of(store) + " holds an unfinished run: resume it first");
  return run;
}

std::filesystem::path place_for_lists(const Store& store) {
  const bool is_writable = ::access(store.directory().c_str(), W_OK) == 0;
  return (is_writable ? store.directory() : temporary_directory()) / "lists";
}

LinearOctree stored_octree(const Store& store, const Reader& reader) try {
  return LinearOctree(reader.leaf_keys());
} catch (const std::invalid_argument& e) {
  throw CorruptRecord(name_of(store) + ": " + e.what(), MortonKey());
}

std::vector<std::size_t> leaves_near(const LinearOctree& octree, const Frame& frame,
                                     std::size_t leaf, double distance) {
  const auto leaves = octree.leaves();
  std::vector<std::size_t> places;
  auto place = leaves.begin();
  for (const MortonKey key :
       octree.leaves_within(frame, frame.box(leaves[leaf]), distance * kRoundingSlack)) {
    place = std::lower_bound(place, leaves.end(), key);
    places.push_back(static_cast<std::size_t>(place - leaves.begin()));
  }
  return places;
}

LeafScale::LeafScale(const Reader& reader, const RunRecord& run) : size_(run.parameters.size) {
  const SizeLaw law = run.parameters.sizes();
  if (law.is_uniform()) return;
  const double factor = reach_factor(law.growth, kCellReach) / kCellReach;
  reader.for_each_leaf([&](MortonKey, const LeafInfo& info) {
    of_leaves_.push_back(factor * info.largest_size);
    return true;
  });
}

void throw_unknown_point(std::uint64_t id, MortonKey leaf) {
  throw CorruptRecord(leaf_name(leaf) + ": a cell names point " + std::to_string(id) +
                          ", which is in no leaf near it",
                      leaf);
}

PointTable::PointTable(const LeafPoints& points) {
  ids.reserve(points.points.size());
  positions.reserve(points.points.size());
  for (const MeshPoint& point : points.points) {
    ids.push_back(point.id);
    positions.push_back(point.position);
  }
}

}  // namespace locvol
