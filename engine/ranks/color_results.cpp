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

// What all are told of a rank's visits.
struct ColorFacts {
  bool is_stopped = false, has_more = false;
  std::uint64_t num_ids = 0;       // of all of its visits
  std::uint64_t first_own_id = 0;  // 0: it is not known yet
};
auto fields(Maybe<ColorFacts> auto& facts) {
  auto& [is_stopped, has_more, num_ids, first_own_id] = facts;
  return std::tuple(Field("is_stopped", is_stopped), Field("has_more", has_more),
                    Field("num_ids", num_ids), Field("first_own_id", first_own_id));
}
// What it tells those that it matters to; ids are counted from its first one on.
using SentResults = std::vector<SentResult>;

ColorResults::ColorResults(RunState& state, Exchange& exchange)
    : state_(state),
      exchange_(exchange),
      file_(OpenFile::temporary(state.store().directory() / "results")) {}

void ColorResults::add(MortonKey leaf, std::uint64_t num_ids, std::string_view result,
                       const std::function<std::string()>& for_others) {
  assert(results_.empty() || results_.back().leaf < leaf);
  Result added{.leaf = leaf,
               .num_ids = num_ids,
               .offset = size_,
               .size = result.size(),
               .touched = state_.others_touched(leaf)};
  const auto append = [&](std::string_view bytes) {
    file_.write_at(size_, std::as_bytes(std::span(bytes)));
    size_ += bytes.size();
  };
  append(result);
  if (!added.touched.empty()) {
    const std::string others = for_others();
    added.size_for_others = others.size();
    append(others);
  }
  results_.push_back(std::move(added));
}

std::string ColorResults::bytes_at(std::uint64_t offset, std::uint64_t size) const {
  std::string bytes(size, '\0');
  file_.read_at(offset, std::as_writable_bytes(std::span(bytes)));
  return bytes;
}

// Of own results from `num_sent` on what there is room for: to each rank.
std::vector<std::string> ColorResults::messages_from(std::uint64_t num_sent) {
  std::vector<SentResults> sent(static_cast<std::size_t>(exchange_.num_ranks()));
  std::size_t num_bytes = 0;
  std::uint64_t first_id = 0;
  for (std::size_t i = 0; i < num_sent; ++i) first_id += results_[i].num_ids;
  for (; num_sent < results_.size() && num_bytes < kMessageBytes; ++num_sent) {
    const Result& result = results_[num_sent];
    if (!result.touched.empty()) {
      const RankResult for_others{first_id,
                                  bytes_at(result.offset + result.size, result.size_for_others)};
      for (const int rank : result.touched) {
        sent[static_cast<std::size_t>(rank)].push_back({result.leaf, for_others});
        num_bytes += for_others.bytes.size();
      }
    }
    first_id += result.num_ids;
  }
  num_sent_ = num_sent;
  std::vector<std::string> messages;  // most of them empty: what is far matters to none
  for (const SentResults& results : sent)
    messages.push_back(results.empty() ? std::string() : pack(results));
  return messages;
}

std::vector<ColorFacts> ColorResults::gather(ColorFacts own) {
  own.has_more = num_sent_ < results_.size();
  return gather_values(exchange_, own);
}

void ColorResults::swap_and_keep(std::vector<std::string> messages,
                                 const std::vector<ColorFacts>& facts) {
  const std::vector<std::string> received = exchange_.swap(std::move(messages));
  for (std::size_t rank = 0; rank < received.size(); ++rank) {
    if (received[rank].empty()) continue;
    for (auto& [leaf, result] : unpack<SentResults>(received[rank])) {
      result.first_id += facts[rank].first_own_id;
      state_.keep_result(leaf, std::move(result));
    }
  }
  state_.note_sent(num_sent_);
  if (std::ranges::none_of(facts, &ColorFacts::has_more)) state_.note_all_sent();
}

bool ColorResults::begin(const QueuePosition& color, bool is_stopped) {
  std::vector<std::string> messages = messages_from(0);
  ColorFacts own;
  own.is_stopped = is_stopped;
  for (const Result& result : results_) own.num_ids += result.num_ids;
  std::vector<ColorFacts> facts = gather(own);
  if (std::ranges::any_of(facts, &ColorFacts::is_stopped)) return false;
  std::uint64_t next_id = state_.run().next_point_id;
  for (ColorFacts& of_rank : facts) {
    of_rank.first_own_id = next_id;
    next_id += of_rank.num_ids;
  }
  state_.begin_applying(color, facts[static_cast<std::size_t>(exchange_.rank())].first_own_id,
                        next_id);
  swap_and_keep(std::move(messages), facts);
  return true;
}

void ColorResults::send_more() {
  std::vector<std::string> messages = messages_from(state_.rank().num_sent);
  ColorFacts own;
  own.first_own_id = state_.rank().next_id;
  const std::vector<ColorFacts> facts = gather(own);
  swap_and_keep(std::move(messages), facts);
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
