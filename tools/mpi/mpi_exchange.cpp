#include "tools/mpi/mpi_exchange.h"

#include <mpi.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <thread>
#include <utility>

namespace locvol {
namespace {

// MPI counts with int.
constexpr std::size_t kMostBytes = std::size_t{1} << 30;

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

// Does `work` meanwhile, as long as there is any. MPI's own waiting keeps a core busy, which ranks
// of one machine need for theirs: the longer it takes, the longer the pauses, up to a sixteenth.
void wait_for_all(std::vector<MPI_Request>& requests, const Exchange::Work& work) {
  using std::chrono::microseconds;
  constexpr microseconds kShortest{20}, kLongest{5000};
  const auto num = static_cast<int>(requests.size());
  const auto start = std::chrono::steady_clock::now();
  for (int are_done = 0; are_done == 0;) {
    MPI_Testall(num, requests.data(), &are_done, MPI_STATUSES_IGNORE);
    if (are_done != 0) break;
    if (work()) continue;
    const auto waited = std::chrono::steady_clock::now() - start;
    std::this_thread::sleep_for(
        std::clamp(std::chrono::duration_cast<microseconds>(waited / 16), kShortest, kLongest));
  }
}

void wait_for(MPI_Request request, const Exchange::Work& work) {
  std::vector<MPI_Request> requests = {request};
  wait_for_all(requests, work);
}

}  // namespace

MpiExchange::MpiExchange(int& argc, char**& argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
  MPI_Comm_size(MPI_COMM_WORLD, &num_ranks_);
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

std::vector<std::string> MpiExchange::swap(std::vector<std::string> messages) {
  assert(messages.size() == static_cast<std::size_t>(num_ranks_));
  const Stopwatch stopwatch(stats_.seconds);
  std::vector<std::uint64_t> sizes, theirs(messages.size());
  for (const std::string& message : messages) sizes.push_back(message.size());
  MPI_Request sizes_known;
  MPI_Ialltoall(sizes.data(), 1, MPI_UINT64_T, theirs.data(), 1, MPI_UINT64_T, MPI_COMM_WORLD,
                &sizes_known);
  wait_for(sizes_known, [this] { return work(); });

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
    received[i].resize(theirs[i]);
    in_pieces(received[i], [&](char* bytes, int size, MPI_Request* request) {
      MPI_Irecv(bytes, size, MPI_BYTE, other, 0, MPI_COMM_WORLD, request);
    });
    in_pieces(messages[i], [&](char* bytes, int size, MPI_Request* request) {
      MPI_Isend(bytes, size, MPI_BYTE, other, 0, MPI_COMM_WORLD, request);
    });
    stats_.num_messages += messages[i].empty() ? 0 : 1;
    stats_.num_bytes += messages[i].size();
  }
  wait_for_all(requests, [this] { return work(); });
  return received;
}

std::vector<std::string> MpiExchange::gather(const std::string& message) {
  std::vector<std::uint64_t> sizes(static_cast<std::size_t>(num_ranks_));
  {
    const Stopwatch stopwatch(stats_.seconds);
    const std::uint64_t size = message.size();
    MPI_Request sizes_known;
    MPI_Iallgather(&size, 1, MPI_UINT64_T, sizes.data(), 1, MPI_UINT64_T, MPI_COMM_WORLD,
                   &sizes_known);
    wait_for(sizes_known, [this] { return work(); });
  }
  std::vector<int> counts, places;
  std::size_t total = 0;
  for (const std::uint64_t size : sizes) {
    counts.push_back(static_cast<int>(std::min<std::uint64_t>(size, kMostBytes)));
    places.push_back(static_cast<int>(std::min(total, kMostBytes)));
    total += size;
  }
  if (total > kMostBytes)  // one by one
    return swap(std::vector<std::string>(static_cast<std::size_t>(num_ranks_), message));
  const Stopwatch stopwatch(stats_.seconds);
  std::string all(total, '\0');
  MPI_Request done;
  MPI_Iallgatherv(message.data(), static_cast<int>(message.size()), MPI_BYTE, all.data(),
                  counts.data(), places.data(), MPI_BYTE, MPI_COMM_WORLD, &done);
  wait_for(done, [this] { return work(); });
  if (!message.empty()) {
    stats_.num_messages += static_cast<std::uint64_t>(num_ranks_ - 1);
    stats_.num_bytes += static_cast<std::uint64_t>(num_ranks_ - 1) * message.size();
  }
  std::vector<std::string> messages;
  std::size_t begin = 0;
  for (const std::uint64_t size : sizes) {
    messages.push_back(all.substr(begin, size));
    begin += size;
  }
  return messages;
}

}  // namespace locvol
