/// \file
/// Choices that a run has by name: a part of locvol.h, which includes it.
//
// Stores have their numbers.
#pragma once

#include <cstdint>

namespace locvol {

/// Which points come first.
enum class Initialization : std::uint8_t {
  kCover = 0,  ///< They cover the domain: the default, and what most options need.
  kPaper = 1   ///< Few, as in the paper.
};

/// What is inside.
enum class InsideRule : std::uint8_t {
  kClosed = 0,   ///< What the surface encloses, which has to be closed.
  kWinding = 1,  ///< Where its winding number is above 1/2, whatever it is.
  kWrap = 2      ///< What a new surface around it encloses, whatever it is.
};

}  // namespace locvol
