// What ranks say to each other, over MPI: all that knows of MPI is in this folder.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "engine/exchange/exchange.h"

namespace locvol {

// MpiExchange lives from MPI_Init to MPI_Finalize, with all of the job's processes as ranks. One
// lives at a time, in the process' first thread. An error of MPI ends the job.
class MpiExchange : public Exchange {
 public:
  MpiExchange(int& argc, char**& argv);
  MpiExchange(const MpiExchange&) = delete;
  MpiExchange& operator=(const MpiExchange&) = delete;
  ~MpiExchange() override;

  int rank() const override { return rank_; }
  int num_ranks() const override { return num_ranks_; }
  std::vector<std::string> swap(std::vector<std::string> messages) override;
  std::vector<std::string> gather(const std::string& message) override;
  ExchangeStats stats() const override;
  // Ends all ranks' processes, with this exit code: after an error, of which others know nothing.
  [[noreturn]] void end_all(int exit_code);

 private:
  template <class Requests>
  void wait_for_all(Requests requests);
  std::vector<std::string> gather_long(const std::string& message,
                                       std::span<const std::uint64_t> sizes);

  int rank_ = 0, num_ranks_ = 1;
  int pauses_of_wait_ = 1;  // a wait of a second pauses for at most 1 / pauses_of_wait_ at once
  ExchangeStats stats_;
};

}  // namespace locvol
