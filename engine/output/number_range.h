#pragma once

#include <cstdint>

namespace locvol {

// Some vertices or cells, by their numbers: from `first` to before `end`.
struct NumberRange {
  std::uint64_t first = 0, end = 0;
  std::uint64_t size() const { return end - first; }
};

}  // namespace locvol
