#pragma once

#include <cstdint>
#include <functional>

namespace locvol {

// Told how far a pass over a store has come: `done` of `all`, in a unit of the pass. Called by one
// thread at a time, not always the same one, with `done` ascending; may be empty.
using StepProgress = std::function<void(std::uint64_t done, std::uint64_t all)>;

}  // namespace locvol
