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

ColorResults::ColorResults(RunState& state, Exchange& exchange)
    : state_(state),
      exchange_(exchange),
      file_(OpenFile::temporary(state.store().directory() / "results")) {}

void ColorResults::add(MortonKey leaf, std::uint64_t num_ids, std::string_view result,
                       const std::function<std::string()>& for_others) {
  assert(results_.empty() || results_.back().leaf < leaf);
  Result added{leaf, num_ids, size_, result.size()};
  const auto append = [&](std::string_view bytes) {
    file_.write_at(size_, std::as_bytes(std::span(bytes)));
    size_ += bytes.size();
  };
  append(result);
  if (state_.ranks_touched(leaf).size() > 1) {
    const std::string others = for_others();
    added.size_for_others = others.size();
    append(others);
  }
  results_.push_back(added);
}

std::uint64_t ColorResults::num_ids() const {
  std::uint64_t num = 0;
  for (const Result& result : results_) num += result.num_ids;
  return num;
}

std::string ColorResults::bytes_at(std::uint64_t offset, std::uint64_t size) const {
  std::string bytes(size, '\0');
  file_.read_at(offset, std::as_writable_bytes(std::span(bytes)));
  return bytes;
}

bool ColorResults::is_all_sent() const { return state_.rank().num_sent == results_.size(); }

void ColorResults::send_some() {
  std::vector<std::vector<SentResult>> sent(static_cast<std::size_t>(exchange_.num_ranks()));
  std::vector<std::size_t> num_bytes(sent.size());
  std::uint64_t next_id = state_.rank().next_id, num_sent = state_.rank().num_sent;
  for (std::size_t i = 0; i < num_sent; ++i) next_id += results_[i].num_ids;
  for (; num_sent < results_.size() && std::ranges::max(num_bytes) < kMessageBytes; ++num_sent) {
    const Result& result = results_[num_sent];
    if (result.size_for_others > 0) {
      const RankResult for_others{next_id,
                                  bytes_at(result.offset + result.size, result.size_for_others)};
      for (const int rank : state_.ranks_touched(result.leaf)) {
        if (rank == exchange_.rank()) continue;
        sent[static_cast<std::size_t>(rank)].push_back({result.leaf, for_others});
        num_bytes[static_cast<std::size_t>(rank)] += for_others.bytes.size();
      }
    }
    next_id += result.num_ids;
  }
  std::vector<std::string> messages;
  for (const auto& of_rank : sent) messages.push_back(pack(of_rank));
  for (const std::string& message : exchange_.swap(std::move(messages)))
    for (SentResult& received : unpack<std::vector<SentResult>>(message))
      state_.keep_result(received.leaf, std::move(received.result));
  state_.note_sent(num_sent);
}

void ColorResults::apply_all(const Apply& apply) {
  const std::vector<MortonKey> others = state_.store().snapshot().result_keys();
  auto other = others.begin();
  const auto apply_others_before = [&](std::optional<MortonKey> leaf) {
    for (; other != others.end() && (!leaf || *other < *leaf); ++other) {
      const RankResult result = state_.store().snapshot().result(*other).value();
      state_.begin_ids(result.first_id);
      state_.drop_result(*other);
      apply(*other, result.bytes);
    }
  };
  for (const Result& result : results_) {
    apply_others_before(result.leaf);
    state_.begin_ids(state_.rank().next_id);
    state_.put_next_own_id(state_.rank().next_id + result.num_ids);
    apply(result.leaf, bytes_at(result.offset, result.size));
  }
  apply_others_before(std::nullopt);
}

}  // namespace locvol
