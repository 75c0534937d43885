// The cap on the memory of the process, shared out before it is used (engine/shared/README.md,
// "Memory").
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

#include "storage/records.h"

namespace locvol {

// The cap is too small for the run.
class OverBudget : public std::runtime_error {
 public:
  OverBudget(const std::string& what, std::uint64_t bytes)
      : std::runtime_error(what), bytes_(bytes) {}
  std::uint64_t bytes() const { return bytes_; }  // of heap that would do

 private:
  std::uint64_t bytes_;
};

// RAM that this process may still take without the system having to swap: what the kernel calls
// available, cut to what is left of the limits on the process and its control group.
std::uint64_t free_memory();
// The least cap under which a surface can be read and checked.
extern const std::uint64_t kLeastMemory;
// What the user asks for, or half of what is free if that is 0; bytes of the whole process, but for
// what it takes `besides`. Throws OverBudget if the rest is less than it takes to read and check a
// surface.
std::uint64_t memory_cap(std::uint64_t asked, std::uint64_t besides = 0);
// How many of the threads `asked` for may each have a bucket of the surface, or a piece of the
// output, under the cap; 0: of those that the process may use.
int num_streaming_threads(int asked, std::uint64_t cap);
// The most RAM that the process has held so far (VmHWM), in bytes; and what it holds now.
std::uint64_t peak_resident_memory();
std::uint64_t resident_memory();

// The most that decoded records may take, however large the cap: more has not made any run faster.
inline constexpr std::uint64_t kMostCacheBytes = std::uint64_t{256} << 20;
// The least for the records around a leaf, and for the writer's windows, which take as much.
inline constexpr std::uint64_t kLeastCacheBytes = std::uint64_t{24} << 20;

// What a visit has to deal with; it gives the memory that the visit takes at its peak, for its
// input, triangulation, tables and result. Calibrated on whole runs with counted allocations
// (tests/engine/run/visit_memory_test.cpp).
struct VisitSize {
  double volume = 0;               // of its piece of space, over λ³
  std::uint64_t num_points = 0;    // local ones, with those that it may insert
  std::uint64_t surface_size = 0;  // DomainPiece::surface_size()

  std::uint64_t bytes_to_refine() const {
    return kLeast + grid_bytes() + 1900 * num_points + 420 * surface_size;
  }
  std::uint64_t bytes_to_cover() const {
    return kLeast + grid_bytes() + 250 * num_points + 500 * surface_size;
  }

 private:
  static constexpr std::uint64_t kLeast = 1 << 20;
  std::uint64_t grid_bytes() const { return static_cast<std::uint64_t>(40 * volume); }
};

// How the cap is shared out. What is not named here is the heap, which visits and the cache of
// records share: a visit reserves what it needs, the cache has to live with the rest.
class MemoryPlan {
 public:
  // Throws OverBudget, with the least cap that would do, unless `cap` leaves room for visits of
  // `largest_visit` bytes next to a few records. REQUIRES: cap > 0
  MemoryPlan(std::uint64_t cap, std::uint64_t num_leaves, std::uint64_t largest_visit);

  std::uint64_t cap() const { return cap_; }
  std::uint64_t heap() const { return heap_; }
  // How many of the threads asked for have some memory to work in.
  int num_threads(int asked) const;
  // The most that changes may take, decoded, before they have to be committed.
  std::uint64_t max_unwritten() const { return unwritten_; }
  // The least cap with a heap that `bytes` more fit into.
  std::uint64_t cap_with_heap(std::uint64_t heap) const;
  MemoryRecord record() const;  // the planned part of it

 private:
  std::uint64_t cap_, leaves_, unwritten_, heap_;
};

// Bytes that workers share. Safe from many threads.
class MemoryBudget {
 public:
  // Gives back on destruction.
  class Reservation {
   public:
    Reservation() = default;
    Reservation(Reservation&& other) noexcept
        : budget_(std::exchange(other.budget_, nullptr)), bytes_(other.bytes_) {}
    Reservation& operator=(Reservation&& other) noexcept {
      std::swap(budget_, other.budget_);
      std::swap(bytes_, other.bytes_);
      return *this;
    }
    ~Reservation();

   private:
    friend class MemoryBudget;
    Reservation(MemoryBudget* budget, std::uint64_t bytes) : budget_(budget), bytes_(bytes) {}
    MemoryBudget* budget_ = nullptr;
    std::uint64_t bytes_ = 0;
  };

  explicit MemoryBudget(std::uint64_t bytes) : total_(bytes), free_(bytes) {}

  // Waits until others have given back enough. Throws OverBudget if there never will be.
  Reservation reserve(std::uint64_t bytes);
  // Takes bytes for good: those who reserve share what is left. Waits and throws as reserve().
  void keep(std::uint64_t bytes);
  std::uint64_t total() const;
  std::uint64_t free_bytes() const;
  std::uint64_t largest_reservation() const;

 private:
  void take(std::unique_lock<std::mutex>& lock, std::uint64_t bytes);

  std::uint64_t total_;
  std::uint64_t kept_ = 0;
  mutable std::mutex mutex_;
  std::condition_variable given_back_;
  std::uint64_t free_;
  std::uint64_t largest_ = 0;
};

std::string memory_text(std::uint64_t bytes);  // in whole MiB, rounded up, as --memory takes it

}  // namespace locvol
