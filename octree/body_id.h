// Numbers of bodies: the parts of the domain that a user names.
#pragma once

#include <cstdint>

namespace locvol {

using BodyId = std::uint32_t;  // they count from 1

inline constexpr BodyId kNoBody = 0;    // outside of all
inline constexpr BodyId kOnlyBody = 1;  // where there is one, it is this

}  // namespace locvol
