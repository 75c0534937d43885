// Remembers what a rank says to others, so that it can say it again to one that has not heard it.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/exchange.h"

namespace locvol {

// Memory: all messages since the last take().
class RecordedExchange : public Exchange {
 public:
  explicit RecordedExchange(Exchange& exchange) : exchange_(exchange) {}

  int rank() const override { return exchange_.rank(); }
  int num_ranks() const override { return exchange_.num_ranks(); }
  std::vector<std::string> swap(std::vector<std::string> messages) override;
  std::vector<std::string> gather(const std::string& message) override;
  ExchangeStats stats() const override { return exchange_.stats(); }
  void set_work(Work work) override { exchange_.set_work(std::move(work)); }

  // All that was said since it was last asked.
  std::string take();

 private:
  void append(char verb, const std::vector<std::string>& messages);

  Exchange& exchange_;
  std::string said_;
};

// Says all of it again, as RecordedExchange::take() gave it, and listens to nobody.
void say_again(Exchange& exchange, const std::string& said);

}  // namespace locvol
