// All that a store holds, to be compared.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <vector>

#include "storage/store.h"

namespace locvol {

struct LeafContents {
  LeafInfo info;
  LeafPoints points;
  LeafCells cells;
  LeafFacets facets;
  LeafSurface surface;
  LeafUnresolved unresolved;
  LeafSizes sizes;
  friend bool operator==(const LeafContents&, const LeafContents&) = default;
};
struct Contents {
  RunRecord run;
  SurfaceSheets sheets;
  std::map<MortonKey, LeafContents> leaves;
  std::vector<QueueEntry> queue;
  friend bool operator==(const Contents&, const Contents&) = default;
};

inline Contents contents_of(const std::filesystem::path& directory) {
  const Store store = Store::open(directory, {.read_only = true});
  const Snapshot snapshot = store.snapshot();
  Contents contents{.run = *snapshot.run(), .sheets = snapshot.sheets(), .leaves = {}, .queue = {}};
  for (const MortonKey key : snapshot.leaf_keys())
    contents.leaves[key] = {*snapshot.leaf(key),  snapshot.points(key),  snapshot.cells(key),
                            snapshot.facets(key), snapshot.surface(key), snapshot.unresolved(key),
                            snapshot.sizes(key)};
  snapshot.for_each_queued([&](const QueueEntry& entry) {
    contents.queue.push_back(entry);
    return true;
  });
  return contents;
}

// Says which record differs first, where EXPECT_EQ could only print bytes.
inline testing::AssertionResult are_equal(const Contents& a, const Contents& b) {
  if (a.run != b.run) return testing::AssertionFailure() << "the run records differ";
  if (a.sheets != b.sheets) return testing::AssertionFailure() << "the sheets differ";
  if (a.leaves.size() != b.leaves.size())
    return testing::AssertionFailure()
           << a.leaves.size() << " and " << b.leaves.size() << " leaves";
  for (const auto& [key, leaf] : a.leaves) {
    const auto other = b.leaves.find(key);
    if (other == b.leaves.end() || leaf != other->second)
      return testing::AssertionFailure() << "leaf " << key.bits() << " differs";
  }
  if (a.queue != b.queue) return testing::AssertionFailure() << "the queues differ";
  return testing::AssertionSuccess();
}

}  // namespace locvol
