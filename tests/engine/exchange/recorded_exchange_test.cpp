#include "engine/exchange/recorded_exchange.h"

#include <gtest/gtest.h>

#include "engine/exchange/thread_ranks.h"

namespace locvol {
namespace {

// What rank 1 says a second time is what the others heard the first time.
TEST(RecordedExchange, SaysAgainWhatItSaid) {
  run_as_ranks(3, [](Exchange& exchange) {
    const auto say = [](Exchange& to_others) {
      const std::string by = std::to_string(to_others.rank());
      std::vector<std::string> heard = to_others.gather("all " + by);
      for (const std::string& said : to_others.swap({by + ">0", "", by + std::string(3000, '2')}))
        heard.push_back(said);
      for (const std::uint64_t number : gather_numbers(to_others, 17 + std::stoull(by)))
        heard.push_back(std::to_string(number));
      return heard;
    };
    RecordedExchange recorded(exchange);
    const std::vector<std::string> heard = say(recorded);
    const std::string said = recorded.take();
    EXPECT_TRUE(recorded.take().empty());
    if (exchange.rank() == 1)
      say_again(exchange, said);
    else
      EXPECT_EQ(say(exchange), heard);
    EXPECT_EQ(sum(exchange, 1).all, 3U);  // and all are where they should be
  });
}

TEST(RecordedExchange, RefusesWhatIsDamaged) {
  run_as_ranks(1, [](Exchange& exchange) {
    RecordedExchange recorded(exchange);
    recorded.gather("hello");
    const std::string said = recorded.take();
    say_again(exchange, said);
    for (std::size_t size = 1; size < said.size(); ++size)
      EXPECT_THROW(say_again(exchange, said.substr(0, size)), ExchangeError) << size;
    EXPECT_THROW(say_again(exchange, "?" + said.substr(1)), ExchangeError);
  });
}

}  // namespace
}  // namespace locvol
