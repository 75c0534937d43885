// IngestWatch counts what the ingest has done: the user sees it move, and can stop it.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>

#include "engine/shared/stop_source.h"

namespace locvol {

class IngestWatch {
 public:
  static constexpr std::uint64_t kUsualStep = std::uint64_t{1} << 18;

  IngestWatch() = default;
  // Both may be missing. The user is told and asked every `step` triangles, of all stages together,
  // and asked whenever that is due.
  IngestWatch(const StopSource* stop, std::function<void(std::uint64_t num_triangles)> on_progress,
              std::uint64_t step = kUsualStep)
      : stop_(stop), on_progress_(std::move(on_progress)), step_(step) {}

  // Throws Stopped.
  void advance(std::uint64_t num_triangles = 1) {
    waiting_ += num_triangles;
    unasked_ += num_triangles;
    if (unasked_ >= kUnasked) look();
  }
  // The token for what has no watch; null if it cannot be stopped.
  const StopToken* stop() const { return stop_; }

 private:
  static constexpr std::uint64_t kUnasked = 1024;

  void look() {
    unasked_ = 0;
    throw_if_stopped(stop_);
    if (waiting_ < step_) return;
    num_triangles_ += std::exchange(waiting_, 0);
    if (on_progress_) on_progress_(num_triangles_);
    if (stop_ != nullptr && stop_->ask()) throw Stopped();
  }

  const StopSource* stop_ = nullptr;
  std::function<void(std::uint64_t)> on_progress_;
  std::uint64_t step_ = kUsualStep;
  std::uint64_t num_triangles_ = 0, waiting_ = 0, unasked_ = 0;
};

}  // namespace locvol
