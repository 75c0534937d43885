// How far the signed numbers of 32 bits in a file go.
#pragma once

#include <cstdint>

namespace locvol {

inline constexpr std::uint64_t kMaxInt32 = 0x7fffffff;

}  // namespace locvol
