#include "tools/mpi/mpi_exchange.h"

#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/temp_dir.h"

namespace locvol {
namespace {

MpiExchange* exchange = nullptr;  // of all tests, each of which all ranks run

// What rank `from` says to rank `to`, in the n-th call: lengths around those up to which a message
// goes with its size, and some that are much longer, in any combination of ranks.
std::string said(int from, int to, int n) {
  constexpr std::array<std::size_t, 12> kLengths = {0,   1,   55,  56,     57,  100,
                                                    503, 504, 505, 70'000, 504, 56};
  const std::size_t length = kLengths[static_cast<std::size_t>(5 * from + 7 * to + n) % 12];
  return std::string(length, static_cast<char>('a' + (3 * from + to + n) % 26));
}

constexpr int kToAll = 0;
constexpr int kNumCalls = 48;

TEST(MpiExchange, SwapsMessagesOfAnyLength) {
  for (int n = 0; n < kNumCalls; ++n) {
    std::vector<std::string> messages;
    for (int to = 0; to < exchange->num_ranks(); ++to)
      messages.push_back(said(exchange->rank(), to, n));
    messages = exchange->swap(std::move(messages));
    EXPECT_EQ(messages.size(), static_cast<std::size_t>(exchange->num_ranks()));
    for (int from = 0; from < exchange->num_ranks(); ++from)
      EXPECT_TRUE(messages[static_cast<std::size_t>(from)] == said(from, exchange->rank(), n));
  }
}

TEST(MpiExchange, GathersMessagesOfAnyLength) {
  for (int n = 0; n < kNumCalls; ++n) {
    const auto messages = exchange->gather(said(exchange->rank(), kToAll, n));
    EXPECT_EQ(messages.size(), static_cast<std::size_t>(exchange->num_ranks()));
    for (int from = 0; from < exchange->num_ranks(); ++from)
      EXPECT_TRUE(messages[static_cast<std::size_t>(from)] == said(from, kToAll, n));
  }
}

TEST(MpiExchange, GathersWhereAllAreShort) {
  const std::string own(static_cast<std::size_t>(exchange->rank()), 'x');
  const auto messages = exchange->gather(own);
  for (std::size_t from = 0; from < messages.size(); ++from)
    EXPECT_EQ(messages[from], std::string(from, 'x'));
}

TEST(MpiExchange, CountsWhatIsSentToOthers) {
  const ExchangeStats before = exchange->stats();
  std::vector<std::string> messages(static_cast<std::size_t>(exchange->num_ranks()));
  messages.back() = "to the last one";
  exchange->swap(messages);
  exchange->gather("to all");
  const auto num_others = static_cast<std::uint64_t>(exchange->num_ranks() - 1);
  const bool is_last = exchange->rank() + 1 == exchange->num_ranks();
  const ExchangeStats after = exchange->stats();
  EXPECT_EQ(after.num_messages - before.num_messages, num_others + (is_last ? 0 : 1));
  EXPECT_EQ(after.num_bytes - before.num_bytes, 6 * num_others + (is_last ? 0 : 15));
  EXPECT_GE(after.seconds, before.seconds);
}

// Others come only once the first rank has done a piece of its work.
TEST(MpiExchange, DoesWorkWhileItWaits) {
  std::optional<TempDir> dir;
  if (exchange->rank() == 0) dir.emplace();
  const std::string file = exchange->gather(dir ? (*dir / "done").string() : "").front();
  if (dir) {
    const WorkWhileWaiting work(*exchange, [&] { return !std::ofstream(file).is_open(); });
    wait_for_all(*exchange);
  } else {
    while (!std::filesystem::exists(file)) std::this_thread::yield();
    wait_for_all(*exchange);
  }
  EXPECT_EQ(exchange->num_ranks() > 1, std::filesystem::exists(file));
  wait_for_all(*exchange);
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  locvol::MpiExchange exchange(argc, argv);
  locvol::exchange = &exchange;
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
