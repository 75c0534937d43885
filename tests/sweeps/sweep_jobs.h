// What the sweeps of tables share: rows are made by several jobs at a time.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <filesystem>
#include <mutex>
#include <thread>
#include <vector>

#include "tests/temp_dir.h"

namespace locvol::sweeps {

// Calls work(i, directory) for each i below `num`, by so many threads, each with an empty directory
// of its own. Throws what a call threw: then that thread calls no more.
template <class Work>
void for_each_in_jobs(std::size_t num, int num_jobs, const Work& work) {
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr error;
  std::vector<std::jthread> jobs;
  for (int job = 0; job < num_jobs; ++job)
    jobs.emplace_back([&] {
      try {
        const TempDir directory;
        for (std::size_t i = next++; i < num; i = next++) work(i, directory.path());
      } catch (...) {
        const std::lock_guard lock(mutex);
        error = std::current_exception();
      }
    });
  jobs.clear();  // joins
  if (error) std::rethrow_exception(error);
}

}  // namespace locvol::sweeps
