// Work that takes long, beside Python: it runs in a thread of its own, without Python's lock, while
// the thread that called waits, tells how far it is, and lets Python handle its signals.
#pragma once

#include <pybind11/pybind11.h>

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "engine/locvol.h"
#include "octree/stop.h"

namespace locvol {

// What the work tells, and is told.
// Threads: tell_*() and is_stopped() by any, without Python's lock.
class Watch : public StopToken {
 public:
  void tell(const Status& status);
  void tell(const std::string& note);
  bool is_stopped() const override { return is_stopped_; }
  // What of these a run is to know.
  Control control(std::uint64_t memory_bytes, int num_threads);

 private:
  friend pybind11::object watch_over(Watch& watch, const pybind11::object& progress,
                                     const pybind11::object& on_note,
                                     const std::function<void()>& work);
  struct News {
    std::optional<Status> status;
    std::vector<std::string> notes;
  };

  std::mutex mutex_;
  std::condition_variable changed_;
  News news_;             // since Python was told
  bool is_done_ = false;  // the work
  std::atomic<bool> is_stopped_ = false;
};

// Does the work, and returns once it is over; what it throws comes out. `progress`: called with the
// last Status ten times a second, if there is another one; the watch is stopped if it returns
// False. `on_note`: called with each note. Both may be None.
// Returns what Python has thrown meanwhile, from these or from a handler of a signal: then the
// watch was stopped, too. Else None.
pybind11::object watch_over(Watch& watch, const pybind11::object& progress,
                            const pybind11::object& on_note, const std::function<void()>& work);

// The same for work without news. What Python has thrown comes out.
void watch_over(const std::function<void(const Watch&)>& work);

}  // namespace locvol
