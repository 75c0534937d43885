#pragma once

#include <stdexcept>

namespace locvol {

// The input is at fault. The message names the file, the place (line, triangle, coordinates) and
// the cure.
class InputError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace locvol
