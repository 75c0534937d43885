// What a fuzz target claims, in every build.
#pragma once

#include <cstdio>
#include <cstdlib>

namespace locvol {

// libFuzzer keeps the input that breaks a claim, as it keeps one that crashes.
inline void expect(bool holds, const char* claim) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", claim);
  std::abort();
}

}  // namespace locvol
