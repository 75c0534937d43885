// Where tests find files, and what they run in. One source knows: all others are the same for a
// compiler cache wherever a clone lies, and under a sanitizer.
#pragma once

#include <filesystem>

namespace locvol {

// Of the shared models; empty: there are none, and tests that need them are skipped.
std::filesystem::path models_directory();

// Of this repository's tests.
std::filesystem::path tests_directory();

// Is the library built for a sanitizer? It has a heap of its own, many times that of the program.
bool is_sanitized();

}  // namespace locvol
