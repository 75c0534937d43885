#include "tools/python/watched.h"

#include <chrono>
#include <exception>
#include <thread>
#include <utility>

namespace locvol {
namespace py = pybind11;
namespace {

using Clock = std::chrono::steady_clock;

// Python handles a signal so soon, and is told of progress so often.
constexpr std::chrono::milliseconds kSignals{50}, kProgress{100};

}  // namespace

void Watch::tell(const Status& status) {
  const std::lock_guard lock(mutex_);
  news_.status = status;
}

void Watch::tell(const std::string& note) {
  const std::lock_guard lock(mutex_);
  news_.notes.push_back(note);
}

Control Watch::control(std::uint64_t memory_bytes, int num_threads) {
  return {.memory_bytes = memory_bytes,
          .num_threads = num_threads,
          .on_progress = [this](const Status& status) { tell(status); },
          .is_canceled = [this] { return is_stopped(); },
          .on_note = [this](const std::string& note) { tell(note); }};
}

py::object watch_over(Watch& watch, const py::object& progress, const py::object& on_note,
                      const std::function<void()>& work) {
  std::exception_ptr thrown;  // by the work
  py::object refused = py::none();
  const auto call_python = [&](Watch::News news) {
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    for (const std::string& note : news.notes)
      if (!on_note.is_none()) on_note(note);
    if (news.status && !progress.is_none() && progress(*news.status).ptr() == Py_False)
      watch.is_stopped_ = true;
  };

  py::gil_scoped_release release;
  std::thread worker([&] {
    try {
      work();
    } catch (...) {
      thrown = std::current_exception();
    }
    const std::lock_guard lock(watch.mutex_);
    watch.is_done_ = true;
    watch.changed_.notify_one();
  });
  auto told = Clock::now() - kProgress;
  for (bool is_done = false; !is_done;) {
    Watch::News news;
    {
      std::unique_lock lock(watch.mutex_);
      watch.changed_.wait_for(lock, kSignals, [&] { return watch.is_done_; });
      is_done = watch.is_done_;
      if (is_done || Clock::now() - told >= kProgress) {
        told = Clock::now();
        news = std::exchange(watch.news_, {});
      }
    }
    // Python has thrown once: it has its say no more.
    const py::gil_scoped_acquire acquire;
    if (!refused.is_none()) continue;
    try {
      call_python(std::move(news));
    } catch (py::error_already_set& error) {
      if (error.trace()) error.value().attr("__traceback__") = error.trace();
      refused = error.value();
      watch.is_stopped_ = true;
    }
  }
  worker.join();
  const py::gil_scoped_acquire acquire;
  if (thrown && refused.is_none()) std::rethrow_exception(thrown);
  if (thrown) {
    try {
      std::rethrow_exception(thrown);
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kCanceled) throw;
    } catch (const Stopped&) {  // as it was told to
    }
  }
  return refused;
}

void watch_over(const std::function<void(const Watch&)>& work) {
  Watch watch;
  const py::object refused = watch_over(watch, py::none(), py::none(), [&] { work(watch); });
  if (refused.is_none()) return;
  PyErr_SetObject(py::type::handle_of(refused).ptr(), refused.ptr());
  throw py::error_already_set();
}

}  // namespace locvol
