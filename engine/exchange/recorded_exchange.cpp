#include "engine/exchange/recorded_exchange.h"

#include <cstdint>
#include <cstring>
#include <string_view>
#include <utility>

namespace locvol {
namespace {

// | verb | number of messages u64 | size u64, bytes | size u64, bytes | ... |
constexpr char kSwap = 's', kGather = 'g';

void append_number(std::string& bytes, std::uint64_t number) {
  bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

class SaidReader {
 public:
  explicit SaidReader(std::string_view said) : said_(said) {}
  bool is_at_end() const { return said_.empty(); }
  std::string take(std::size_t size) {
    if (size > said_.size()) throw ExchangeError("what the rank has said is cut short");
    std::string taken(said_.substr(0, size));
    said_.remove_prefix(size);
    return taken;
  }
  std::uint64_t take_number() {
    std::uint64_t number = 0;
    std::memcpy(&number, take(sizeof number).data(), sizeof number);
    return number;
  }

 private:
  std::string_view said_;
};

}  // namespace

std::vector<std::string> RecordedExchange::swap(std::vector<std::string> messages) {
  append(kSwap, messages);
  return exchange_.swap(std::move(messages));
}

std::vector<std::string> RecordedExchange::gather(const std::string& message) {
  append(kGather, {message});
  return exchange_.gather(message);
}

std::string RecordedExchange::take() { return std::exchange(said_, {}); }

void RecordedExchange::append(char verb, const std::vector<std::string>& messages) {
  said_ += verb;
  append_number(said_, messages.size());
  for (const std::string& message : messages) {
    append_number(said_, message.size());
    said_ += message;
  }
}

void say_again(Exchange& exchange, const std::string& said) {
  SaidReader reader(said);
  while (!reader.is_at_end()) {
    const char verb = reader.take(1).front();
    std::vector<std::string> messages(reader.take_number());
    for (std::string& message : messages) message = reader.take(reader.take_number());
    if (verb == kGather && messages.size() == 1)
      exchange.gather(messages.front());
    else if (verb == kSwap && messages.size() == static_cast<std::size_t>(exchange.num_ranks()))
      exchange.swap(std::move(messages));
    else
      throw ExchangeError("what the rank has said is damaged");
  }
}

}  // namespace locvol
