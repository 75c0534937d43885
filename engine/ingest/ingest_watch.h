// IngestWatch counts what the ingest has done: the user sees it move, and can stop it.
#pragma once

#include <cstdint>
#include <exception>
#include <functional>

namespace locvol {

// Thrown where the user stops the ingest.
class IngestStopped : public std::exception {
 public:
  const char* what() const noexcept override { return "the ingest was stopped"; }
};

class IngestWatch {
 public:
  static constexpr std::uint64_t kUsualStep = std::uint64_t{1} << 18;

  IngestWatch() = default;
  // Both may be empty. They are called every `step` triangles, of all stages together.
  IngestWatch(std::function<bool()> is_stopped,
              std::function<void(std::uint64_t num_triangles)> on_progress,
              std::uint64_t step = kUsualStep)
      : is_stopped_(std::move(is_stopped)), on_progress_(std::move(on_progress)), step_(step) {}

  // Throws IngestStopped.
  void advance(std::uint64_t num_triangles = 1) {
    waiting_ += num_triangles;
    if (waiting_ < step_) return;
    num_triangles_ += waiting_;
    waiting_ = 0;
    if (on_progress_) on_progress_(num_triangles_);
    if (is_stopped_ && is_stopped_()) throw IngestStopped();
  }

 private:
  std::function<bool()> is_stopped_;
  std::function<void(std::uint64_t)> on_progress_;
  std::uint64_t step_ = kUsualStep;
  std::uint64_t num_triangles_ = 0, waiting_ = 0;
};

}  // namespace locvol
