#include "engine/ranks/color_results.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <optional>
#include <span>
#include <utility>

namespace locvol {
namespace {

// Before the bytes of each result in a message.
struct ResultHeader {
  std::uint64_t leaf = 0, first_id = 0, size = 0;
};

void append_to(std::string& message, const ResultHeader& header, std::string_view bytes) {
  message.append(reinterpret_cast<const char*>(&header), sizeof header);
  message += bytes;
}

}  // namespace

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
  std::vector<std::string> messages(static_cast<std::size_t>(exchange_.num_ranks()));
  std::uint64_t next_id = state_.rank().next_id, num_sent = state_.rank().num_sent;
  for (std::size_t i = 0; i < num_sent; ++i) next_id += results_[i].num_ids;
  std::size_t most = 0;  // bytes of a message
  for (; num_sent < results_.size() && most < kMessageBytes; ++num_sent) {
    const Result& result = results_[num_sent];
    const std::string bytes = bytes_at(result.offset + result.size, result.size_for_others);
    for (const int rank : bytes.empty() ? std::vector<int>() : state_.ranks_touched(result.leaf)) {
      if (rank == exchange_.rank()) continue;
      std::string& message = messages[static_cast<std::size_t>(rank)];
      append_to(message, {result.leaf.bits(), next_id, bytes.size()}, bytes);
      most = std::max(most, message.size());
    }
    next_id += result.num_ids;
  }
  for (std::string_view message : exchange_.swap(std::move(messages)))
    while (!message.empty()) {
      ResultHeader header;
      if (message.size() < sizeof header) throw ExchangeError("half a message arrived");
      std::memcpy(&header, message.data(), sizeof header);
      message.remove_prefix(sizeof header);
      if (message.size() < header.size) throw ExchangeError("half a message arrived");
      state_.keep_result(MortonKey::from_bits(header.leaf),
                         {header.first_id, std::string(message.substr(0, header.size))});
      message.remove_prefix(header.size);
    }
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
