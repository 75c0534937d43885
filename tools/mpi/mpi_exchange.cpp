#include "tools/mpi/mpi_exchange.h"

#include <mpi.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <numeric>
#include <string_view>
#include <thread>
#include <utility>

namespace locvol {
namespace {

// MPI counts with int.
constexpr std::size_t kMostBytes = std::size_t{1} << 30;

// A message's size, and all of it if there is room: then one operation of all ranks is enough.
template <std::size_t kBytes>
struct Slot {
  explicit Slot(std::string_view message = {}) : size(message.size()) {
    if (is_all()) std::ranges::copy(message, bytes.begin());
  }
  bool is_all() const { return size <= kBytes; }
  std::string message() const { return std::string(bytes.data(), size); }  // REQUIRES: is_all()

  std::uint64_t size = 0;
  std::array<char, kBytes> bytes = {};
};
using SlotOfOne = Slot<56>;
using SlotOfAll = Slot<504>;

// Adds its life to a number of seconds.
class Stopwatch {
 public:
  explicit Stopwatch(double& seconds) : seconds_(seconds) {}
  ~Stopwatch() {
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  double& seconds_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// MPI's own waiting keeps a core busy, which ranks of one machine need for their work. So it
// pauses, the longer it waits: up to a sixteenth of that, or a quarter where ranks share cores, and
// the next one's work goes on meanwhile.
int pauses_of_wait() {
  MPI_Comm machine;
  MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &machine);
  int num_ranks = 0;
  MPI_Comm_size(machine, &num_ranks);
  MPI_Comm_free(&machine);
  return static_cast<unsigned>(num_ranks) > std::thread::hardware_concurrency() ? 4 : 16;
}

}  // namespace

MpiExchange::MpiExchange(int& argc, char**& argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
  MPI_Comm_size(MPI_COMM_WORLD, &num_ranks_);
  pauses_of_wait_ = pauses_of_wait();
}

MpiExchange::~MpiExchange() { MPI_Finalize(); }

void MpiExchange::end_all(int exit_code) {
  MPI_Abort(MPI_COMM_WORLD, exit_code);
  std::abort();
}

ExchangeStats MpiExchange::stats() const {
  ExchangeStats stats = stats_;
  stats.seconds -= seconds_of_work();
  return stats;
}

// Does the caller's work meanwhile, as long as there is any.
template <class Requests>
void MpiExchange::wait_for_all(Requests requests) {
  using std::chrono::microseconds;
  constexpr microseconds kShortest{20}, kLongest{5000};
  const auto start = std::chrono::steady_clock::now();
  for (;;) {
    int are_done = 0;
    MPI_Testall(static_cast<int>(std::size(requests)), std::data(requests), &are_done,
                MPI_STATUSES_IGNORE);
    if (are_done != 0) return;
    if (work()) continue;
    const auto waited = std::chrono::steady_clock::now() - start;
    std::this_thread::sleep_for(std::clamp(
        std::chrono::duration_cast<microseconds>(waited / pauses_of_wait_), kShortest, kLongest));
  }
}

std::vector<std::string> MpiExchange::swap(std::vector<std::string> messages) {
  assert(messages.size() == static_cast<std::size_t>(num_ranks_));
  const Stopwatch stopwatch(stats_.seconds);
  std::vector<SlotOfOne> slots, theirs(messages.size());
  for (const std::string& message : messages) slots.emplace_back(message);
  MPI_Request slots_known;
  MPI_Ialltoall(slots.data(), sizeof(SlotOfOne), MPI_BYTE, theirs.data(), sizeof(SlotOfOne),
                MPI_BYTE, MPI_COMM_WORLD, &slots_known);
  wait_for_all(std::array{slots_known});

  std::vector<std::string> received(messages.size());
  std::vector<MPI_Request> requests;
  const auto in_pieces = [&](std::string& bytes, const auto& transfer) {
    for (std::size_t from = 0; from < bytes.size(); from += kMostBytes)
      transfer(bytes.data() + from, static_cast<int>(std::min(kMostBytes, bytes.size() - from)),
               &requests.emplace_back());
  };
  for (int other = 0; other < num_ranks_; ++other) {
    const auto i = static_cast<std::size_t>(other);
    if (other == rank_) {
      received[i] = std::move(messages[i]);
      continue;
    }
    stats_.num_messages += messages[i].empty() ? 0 : 1;
    stats_.num_bytes += messages[i].size();
    if (theirs[i].is_all()) {
      received[i] = theirs[i].message();
    } else {
      received[i].resize(theirs[i].size);
      in_pieces(received[i], [&](char* bytes, int size, MPI_Request* request) {
        MPI_Irecv(bytes, size, MPI_BYTE, other, 0, MPI_COMM_WORLD, request);
      });
    }
    if (slots[i].is_all()) continue;
    in_pieces(messages[i], [&](char* bytes, int size, MPI_Request* request) {
      MPI_Isend(bytes, size, MPI_BYTE, other, 0, MPI_COMM_WORLD, request);
    });
  }
  wait_for_all(std::move(requests));
  return received;
}

std::vector<std::string> MpiExchange::gather(const std::string& message) {
  std::vector<SlotOfAll> slots(static_cast<std::size_t>(num_ranks_));
  {
    const Stopwatch stopwatch(stats_.seconds);
    const SlotOfAll slot(message);
    MPI_Request slots_known;
    MPI_Iallgather(&slot, sizeof(SlotOfAll), MPI_BYTE, slots.data(), sizeof(SlotOfAll), MPI_BYTE,
                   MPI_COMM_WORLD, &slots_known);
    wait_for_all(std::array{slots_known});
  }
  std::vector<std::string> messages;
  if (std::ranges::all_of(slots, &SlotOfAll::is_all)) {
    for (const SlotOfAll& slot : slots) messages.push_back(slot.message());
  } else {
    std::vector<std::uint64_t> sizes;
    for (const SlotOfAll& slot : slots) sizes.push_back(slot.size);
    const std::uint64_t total = std::reduce(sizes.begin(), sizes.end());
    if (total > kMostBytes)  // one by one
      return swap(std::vector<std::string>(slots.size(), message));
    messages = gather_long(message, sizes);
  }
  if (!message.empty()) {
    stats_.num_messages += static_cast<std::uint64_t>(num_ranks_ - 1);
    stats_.num_bytes += static_cast<std::uint64_t>(num_ranks_ - 1) * message.size();
  }
  return messages;
}

// Of these sizes, in all at most kMostBytes.
std::vector<std::string> MpiExchange::gather_long(const std::string& message,
                                                  std::span<const std::uint64_t> sizes) {
  const Stopwatch stopwatch(stats_.seconds);
  std::vector<int> counts, places;
  int total = 0;
  for (const std::uint64_t size : sizes) {
    places.push_back(total);
    counts.push_back(static_cast<int>(size));
    total += counts.back();
  }
  std::string all(static_cast<std::size_t>(total), '\0');
  MPI_Request done;
  MPI_Iallgatherv(message.data(), static_cast<int>(message.size()), MPI_BYTE, all.data(),
                  counts.data(), places.data(), MPI_BYTE, MPI_COMM_WORLD, &done);
  wait_for_all(std::array{done});
  std::vector<std::string> messages;
  std::size_t begin = 0;
  for (const std::uint64_t size : sizes) {
    messages.push_back(all.substr(begin, size));
    begin += size;
  }
  return messages;
}

}  // namespace locvol
