// What the visits of one color found, told to the ranks that it matters to, and applied by each of
// them in the order of one process. Visits of one color neither see nor change each other: so what
// they find is the same while others are being applied, and those that matter to no other rank may
// be made while ranks wait for each other.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/run/run_state.h"
#include "engine/shared/partial_file.h"

namespace locvol {

// Memory: some 80 bytes for each visit, and a few times kMessageBytes, and twice what ranks nearby
// send; own results are in a nameless file beside the store, others' in the store. Errors:
// ExchangeError, StoreError, std::system_error
class ColorResults {
 public:
  // Of the rank's own leaves that wait there. `changes_others`: visits change what is known of
  // other leaves than the visited one.
  ColorResults(RunState& state, Exchange& exchange, const QueuePosition& color,
               bool changes_others);

  const QueuePosition& color() const { return color_; }
  bool has_own() const { return !results_.empty(); }
  // Of these, without a result so far, in Morton order: those whose visits matter to other ranks,
  // and of the rest the first `most`.
  std::vector<QueueEntry> near_others() const { return unvisited(true, results_.size()); }
  std::vector<QueueEntry> far_from_others() const { return far_from_others(results_.size()); }
  std::vector<QueueEntry> far_from_others(std::size_t most) const { return unvisited(false, most); }
  // for_others(): what they get.
  void add(MortonKey leaf, std::string_view result, const std::function<std::string()>& for_others);

  // Called by all ranks when each has made its visits near others, or was stopped: sends some of
  // what they found, keeps what comes, and begins to apply the color. Ids of new points begin at
  // `first_own_id`, and end for all ranks at `end_id`. False: a rank was stopped, and nothing has
  // changed.
  bool begin(std::uint64_t first_own_id, std::uint64_t end_id, bool is_stopped);
  // Called by all ranks, as long as any has more to send. REQUIRES: RankRecord::applied, and not
  // is_all_sent
  void send_more();
  // When all ranks have: calls apply(leaf, result) for all that matter to this rank, in Morton
  // order. Each is gone from the store with the commit that keeps what it changes. REQUIRES: all
  // visits are made
  using Apply = std::function<void(MortonKey leaf, std::string_view result)>;
  void apply_all(const Apply& apply);

 private:
  struct Result {
    MortonKey leaf;
    std::vector<int> touched;  // other ranks that it matters to
    bool is_found = false;
    std::uint64_t offset = 0, size = 0;
    std::uint64_t size_for_others = 0;  // after it, what these get
  };

  std::vector<QueueEntry> unvisited(bool is_near, std::size_t most) const;
  std::string bytes_at(std::uint64_t offset, std::uint64_t size) const;
  std::vector<std::string> messages_from(std::uint64_t num_sent, std::uint64_t first_own_id);
  void keep(const std::vector<std::string>& received);

  RunState& state_;
  Exchange& exchange_;
  QueuePosition color_;
  OpenFile file_;
  std::uint64_t size_ = 0;       // of the file
  std::vector<Result> results_;  // of all own leaves, in Morton order
  std::uint64_t num_sent_ = 0;   // of these
};

}  // namespace locvol
