// Where tests find files. The paths are known to one source: all others are the same for a compiler
// cache wherever a clone lies.
#pragma once

#include <filesystem>

namespace locvol {

// Of the shared models; empty: there are none, and tests that need them are skipped.
std::filesystem::path models_directory();

// Of this repository's tests.
std::filesystem::path tests_directory();

}  // namespace locvol
