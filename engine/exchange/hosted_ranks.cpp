#include "engine/exchange/hosted_ranks.h"

#include <cassert>
#include <chrono>
#include <cstddef>
#include <string>
#include <tuple>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/exchange/thread_ranks.h"

namespace locvol {

struct HostedMessage {
  int from = 0, to = 0;  // ranks
  std::string bytes;
};
auto fields(Maybe<HostedMessage> auto& message) {
  auto& [from, to, bytes] = message;
  return std::tuple(Field("from", from), Field("to", to), Field("bytes", bytes));
}

namespace {

constexpr int kToAll = -1;
using Messages = std::vector<HostedMessage>;

std::size_t at(int place) { return static_cast<std::size_t>(place); }

// To each of the places, what is for ranks there.
template <class PlaceOf>
std::vector<Messages> dealt(std::vector<Messages> lists, int num_places, const PlaceOf& place_of) {
  std::vector<Messages> dealt(at(num_places));
  for (Messages& list : lists)
    for (HostedMessage& message : std::exchange(list, {}))
      if (message.to == kToAll)
        for (Messages& to_place : dealt) to_place.push_back(message);
      else
        dealt[at(place_of(message.to))].push_back(std::move(message));
  return dealt;
}

// What the process' ranks say goes to the first of them, from process to process, and to whom it is
// for.
class HostedRank : public Exchange {
 public:
  HostedRank(int num_ranks, Exchange& threads, Exchange& processes)
      : num_ranks_(num_ranks), threads_(threads), processes_(processes) {}

  int rank() const override { return processes_.rank() + threads_.rank() * processes_.num_ranks(); }
  int num_ranks() const override { return num_ranks_; }

  std::vector<std::string> swap(std::vector<std::string> messages) override {
    assert(messages.size() == at(num_ranks_));
    Messages said;
    for (int to = 0; to < num_ranks_; ++to)
      if (!messages[at(to)].empty()) said.push_back({rank(), to, std::move(messages[at(to)])});
    return heard(std::move(said));
  }

  std::vector<std::string> gather(const std::string& message) override {
    return heard({{rank(), kToAll, message}});
  }

  ExchangeStats stats() const override { return threads_.stats(); }

 private:
  std::vector<std::string> heard(Messages said) {
    std::vector<Messages> lists(at(threads_.num_ranks()));
    lists.front() = std::move(said);
    lists = swap_lists(threads_, std::move(lists));
    if (threads_.rank() == 0) lists = heard_by_threads(std::move(lists));
    std::vector<std::string> messages(at(num_ranks_));
    for (Messages& list : swap_lists(threads_, std::move(lists)))
      for (HostedMessage& message : list) messages.at(at(message.from)) = std::move(message.bytes);
    return messages;
  }

  std::vector<Messages> heard_by_threads(std::vector<Messages> said) {
    const int num_processes = processes_.num_ranks();
    said = dealt(std::move(said), num_processes, [&](int rank) { return rank % num_processes; });
    any(processes_, true);  // so that those without ranks know that there is more
    said = swap_lists(processes_, std::move(said));
    return dealt(std::move(said), threads_.num_ranks(),
                 [&](int rank) { return rank / num_processes; });
  }

  int num_ranks_;
  Exchange& threads_;
  Exchange& processes_;
};

}  // namespace

std::vector<int> ranks_hosted(int num_ranks, const Exchange& processes) {
  std::vector<int> ranks;
  for (int rank = processes.rank(); rank < num_ranks; rank += processes.num_ranks())
    ranks.push_back(rank);
  return ranks;
}

void run_hosted_ranks(int num_ranks, Exchange& processes,
                      const std::function<void(Exchange&)>& work) {
  constexpr std::chrono::hours kPatience{24 * 365};  // others may have hours of visits to make
  const auto num_here = static_cast<int>(ranks_hosted(num_ranks, processes).size());
  const auto as_rank = [&](Exchange& threads) {
    HostedRank rank(num_ranks, threads, processes);
    work(rank);
  };
  if (num_here > 0) run_as_ranks(num_here, as_rank, {.patience = kPatience});
  while (any(processes, false))
    swap_lists(processes, std::vector<Messages>(at(processes.num_ranks())));
}

}  // namespace locvol
