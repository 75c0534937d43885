// RunRanks are what a rank keeps of a run that several work on: whom its visits matter to, which
// color is being applied, what it has heard and said.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "engine/run/run_view.h"

namespace locvol {

class RunRanks : RunView {
 public:
  using RunView::RunView;

  // False: one process has all of the run, and its store has no such record.
  bool is_rank() const { return data_.rank.has_value(); }
  const RankRecord& record() const { return *data_.rank; }  // REQUIRES: is_rank()
  const Shares& shares() const { return data_.shares; }
  // Others that have a leaf which a visit of this one may change, ascending. REQUIRES: it is own
  std::vector<int> others_touched(MortonKey leaf) const;

  // From now on `color` is applied: its first own new point gets this id, and after all the run's
  // next one is `end`.
  void begin_applying(const QueuePosition& color, std::uint64_t first, std::uint64_t end);
  void note_sent(std::uint64_t num_sent, bool is_all);
  std::uint64_t take_ids();  // of the next own visit: the first
  void end_applying();
  // What a visit on another rank found, from the next commit on; it is applied, likewise.
  void keep_result(MortonKey leaf, RankResult result) { results_[leaf] = std::move(result); }
  void drop_result(MortonKey leaf) { results_[leaf] = std::nullopt; }

  // One of the phase, after which more follow.
  void end_step() { ++data_.rank->stage; }
  // Leaves are well where they are, from this phase on.
  void note_stay(Phase phase) { data_.rank->moved_at = phase; }
  // The next commit ends a superstep, in which the rank has said this to others.
  void end_superstep(std::string said);

 private:
  friend class RunCommits;  // writes what has changed
  void write_to(Batch& batch);

  std::optional<RankWords> words_;
  std::map<MortonKey, std::optional<RankResult>> results_;  // nothing: to be erased
};

}  // namespace locvol
