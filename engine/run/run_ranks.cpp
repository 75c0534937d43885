#include "engine/run/run_ranks.h"

#include <algorithm>
#include <utility>

#include "engine/run/leaf_distances.h"
#include "engine/run/run_points.h"

namespace locvol {

std::vector<int> RunRanks::others_touched(MortonKey leaf) const {
  std::vector<int> ranks;
  const double distance = touch_distance(run(), leaves().info(leaf));
  for (const MortonKey other : octree().leaves_within(frame(), box(leaf), distance))
    for (const int rank : others_holding(other))
      if (const auto place = std::ranges::lower_bound(ranks, rank);
          place == ranks.end() || *place != rank)
        ranks.insert(place, rank);
  return ranks;
}

void RunRanks::begin_applying(const QueuePosition& color, std::uint64_t first, std::uint64_t end) {
  data_.rank->applied = color;
  data_.rank->next_id = first;
  data_.rank->end_id = end;
}

void RunRanks::note_sent(std::uint64_t num_sent, bool is_all) {
  data_.rank->num_sent = num_sent;
  data_.rank->is_all_sent = is_all;
}

std::uint64_t RunRanks::take_ids() {
  return std::exchange(data_.rank->next_id, data_.rank->next_id + kIdsOfVisit);
}

void RunRanks::end_applying() {
  data_.rank->applied.reset();
  data_.run.next_point_id = data_.rank->end_id;
}

void RunRanks::end_superstep(std::string said) {
  ++data_.rank->superstep;
  words_ = RankWords{std::move(said)};
}

void RunRanks::write_to(Batch& batch) {
  if (data_.rank) batch.put_rank(*data_.rank);
  if (words_) batch.put_words(*words_);
  for (const auto& [leaf, result] : results_)
    if (result)
      batch.put_result(leaf, *result);
    else
      batch.erase_result(leaf);
  results_.clear();
  words_.reset();
}

}  // namespace locvol
