// The last to catch: every error becomes a message and an exit code.
#pragma once

#include <filesystem>
#include <functional>

namespace locvol {

// What `run` returns; kExitError after a message, which begins with the name, if it throws, or if
// its results did not reach their reader.
int guarded(const char* name, const std::function<int()>& run);

// The store of the command, for the message when no memory is left to make one.
void note_store(const std::filesystem::path& store);

}  // namespace locvol
