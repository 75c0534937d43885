// What the visits of one color found, told to the ranks that it matters to, and applied by each of
// them in the order of one process. Visits of one color neither see nor change each other: so what
// they find is the same while others are being applied.
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

struct ColorFacts;

// Memory: some 60 bytes for each visit, and a few times kMessageBytes, and twice what ranks nearby
// send; own results are in a nameless file beside the store, others' in the store. Errors:
// ExchangeError, StoreError, std::system_error
class ColorResults {
 public:
  ColorResults(RunState& state, Exchange& exchange);

  // Of the rank's own leaves, in Morton order; `num_ids`: that applying it will give; for_others():
  // what they get.
  void add(MortonKey leaf, std::uint64_t num_ids, std::string_view result,
           const std::function<std::string()>& for_others);

  // Called by all ranks when each has made its visits, or was stopped: sends some of what they
  // found, keeps what comes, and begins to apply the color. False: a rank was stopped, and nothing
  // has changed.
  bool begin(const QueuePosition& color, bool is_stopped);
  // Called by all ranks, as long as any has more to send. REQUIRES: RankRecord::applied, and not
  // is_all_sent
  void send_more();
  // When all ranks have: calls apply(leaf, result) for all that matter to this rank, in Morton
  // order. Each is gone from the store with the commit that keeps what it changes.
  using Apply = std::function<void(MortonKey leaf, std::string_view result)>;
  void apply_all(const Apply& apply);

 private:
  struct Result {
    MortonKey leaf;
    std::uint64_t num_ids = 0, offset = 0, size = 0;
    std::vector<int> touched;           // other ranks that it matters to
    std::uint64_t size_for_others = 0;  // after it, what these get
  };

  std::string bytes_at(std::uint64_t offset, std::uint64_t size) const;
  std::vector<std::string> messages_from(std::uint64_t num_sent);
  std::vector<ColorFacts> gather(ColorFacts own);
  void swap_and_keep(std::vector<std::string> messages, const std::vector<ColorFacts>& facts);

  RunState& state_;
  Exchange& exchange_;
  OpenFile file_;
  std::uint64_t size_ = 0;  // of the file
  std::vector<Result> results_;
  std::uint64_t num_sent_ = 0;
};

}  // namespace locvol
