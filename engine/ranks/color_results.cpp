#include "engine/ranks/color_results.h"

#include <algorithm>
#include <cassert>
#include <optional>
#include <span>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"

namespace locvol {

// What another rank gets of a visit.
struct SentResult {
  MortonKey leaf;
  RankResult result;
};
auto fields(Maybe<RankResult> auto& result) {
  auto& [first_id, bytes] = result;
  return std::tuple(Field("first_id", first_id), Field("bytes", bytes));
}
auto fields(Maybe<SentResult> auto& sent) {
  auto& [leaf, result] = sent;
  return std::tuple(Field("leaf", leaf), Field("result", result));
}

using SentResults = std::vector<SentResult>;

// Each message begins with them, and most are no longer: what is far matters to none.
enum SenderFlags : char { kIsStopped = 1, kHasMore = 2 };

// Of all senders.
unsigned flags_of(std::span<const std::string> messages) {
  unsigned flags = 0;
  for (const std::string& message : messages) {
    if (message.empty()) throw ExchangeError("what another rank said did not arrive");
    flags |= static_cast<unsigned char>(message.front());
  }
  return flags;
}

ColorResults::ColorResults(RunState& state, Exchange& exchange, const QueuePosition& color,
                           bool changes_others)
    : state_(state),
      exchange_(exchange),
      color_(color),
      file_(OpenFile::temporary(state.store().directory() / "results")) {
  const LeafQueue& queue = state.queue().entries();
  if (queue.is_empty() || queue.front() != color) return;
  for (const MortonKey leaf : queue.front_leaves())
    if (state.is_own(leaf))
      results_.push_back({.leaf = leaf,
                          .touched = changes_others ? state.ranks().others_touched(leaf)
                                                    : state.others_holding(leaf)});
}

std::vector<QueueEntry> ColorResults::unvisited(bool is_near, std::size_t most) const {
  std::vector<QueueEntry> leaves;
  for (auto result = results_.begin(); result != results_.end() && leaves.size() < most; ++result)
    if (!result->is_found && result->touched.empty() != is_near)
      leaves.push_back({color_, result->leaf});
  return leaves;
}

void ColorResults::add(MortonKey leaf, std::string_view result,
                       const std::function<std::string()>& for_others) {
  const auto added = std::ranges::lower_bound(results_, leaf, {}, &Result::leaf);
  assert(added != results_.end() && added->leaf == leaf && !added->is_found);
  const auto append = [&](std::string_view bytes) {
    file_.write_at(size_, std::as_bytes(std::span(bytes)));
    size_ += bytes.size();
  };
  added->is_found = true;
  added->offset = size_;
  added->size = result.size();
  append(result);
  if (added->touched.empty()) return;
  const std::string others = for_others();
  added->size_for_others = others.size();
  append(others);
}

std::string ColorResults::bytes_at(std::uint64_t offset, std::uint64_t size) const {
  std::string bytes(size, '\0');
  file_.read_at(offset, std::as_writable_bytes(std::span(bytes)));
  return bytes;
}

// Of own results from `num_sent` on what there is room for: to each rank.
std::vector<std::string> ColorResults::messages_from(std::uint64_t num_sent,
                                                     std::uint64_t first_own_id) {
  std::vector<SentResults> sent(static_cast<std::size_t>(exchange_.num_ranks()));
  std::size_t num_bytes = 0;
  for (; num_sent < results_.size() && num_bytes < kMessageBytes; ++num_sent) {
    const Result& result = results_[num_sent];
    if (result.touched.empty()) continue;
    const RankResult for_others{first_own_id + num_sent * kIdsOfVisit,
                                bytes_at(result.offset + result.size, result.size_for_others)};
    for (const int rank : result.touched) {
      sent[static_cast<std::size_t>(rank)].push_back({result.leaf, for_others});
      num_bytes += for_others.bytes.size();
    }
  }
  num_sent_ = num_sent;
  const char flags = num_sent < results_.size() ? char{kHasMore} : char{0};
  std::vector<std::string> messages;
  for (const SentResults& results : sent)
    messages.push_back(flags + (results.empty() ? std::string() : pack(results)));
  return messages;
}

void ColorResults::keep(const std::vector<std::string>& received) {
  for (const std::string& message : received) {
    if (message.size() == 1) continue;
    for (auto& [leaf, result] : unpack<SentResults>(std::string_view(message).substr(1)))
      state_.ranks().keep_result(leaf, std::move(result));
  }
  state_.ranks().note_sent(num_sent_, (flags_of(received) & kHasMore) == 0);
}

bool ColorResults::begin(std::uint64_t first_own_id, std::uint64_t end_id, bool is_stopped) {
  std::vector<std::string> messages;
  if (is_stopped)
    messages.assign(static_cast<std::size_t>(exchange_.num_ranks()), {char{kIsStopped}});
  else
    messages = messages_from(0, first_own_id);
  const std::vector<std::string> received = exchange_.swap(std::move(messages));
  if ((flags_of(received) & kIsStopped) != 0) return false;
  state_.ranks().begin_applying(color_, first_own_id, end_id);
  keep(received);
  return true;
}

void ColorResults::send_more() {
  keep(exchange_.swap(
      messages_from(state_.ranks().record().num_sent, state_.ranks().record().next_id)));
}

void ColorResults::apply_all(const Apply& apply) {
  const std::vector<MortonKey> others = state_.store().snapshot().result_keys();
  auto other = others.begin();
  const auto apply_others_before = [&](std::optional<MortonKey> leaf) {
    for (; other != others.end() && (!leaf || *other < *leaf); ++other) {
      const RankResult result = state_.store().snapshot().result(*other).value();
      state_.points().begin_ids(result.first_id);
      state_.ranks().drop_result(*other);
      apply(*other, result.bytes);
    }
  };
  for (const Result& result : results_) {
    apply_others_before(result.leaf);
    state_.points().begin_ids(state_.ranks().take_ids());
    apply(result.leaf, bytes_at(result.offset, result.size));
  }
  apply_others_before(std::nullopt);
}

}  // namespace locvol
