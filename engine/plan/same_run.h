// Whether a store's run is the one that is asked for.
#pragma once

#include <cstdint>
#include <filesystem>
#include <stdexcept>

#include "storage/store.h"

namespace locvol {

// Another input or other parameters than the store's; the message names what differs, and what can
// be done.
class StoreMismatch : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// No point of a mesh is in its store, or nothing but points of one without a cell: whoever asks for
// another run loses nothing if that begins anew.
bool is_in_vain(const RunRecord& run);

// Throws StoreMismatch, naming each option that differs and both its values. `asked`: of the run
// that is asked for, with its surface's file. `started`: when the store's run began, in seconds
// since 1970; 0: unknown.
void require_same_run(const RunRecord& held, const RunRecord& asked,
                      const std::filesystem::path& store, std::uint64_t started = 0);

// Throws StoreMismatch if the store has a rank's part of a run that several processes work on.
void require_whole_run(const Store& store);

}  // namespace locvol
