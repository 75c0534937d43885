// How messages write numbers.
#pragma once

#include <array>
#include <charconv>
#include <string>

namespace locvol {

// The shortest that reads back as v.
inline std::string decimal(double v) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), v).ptr};
}

// The number to three digits.
inline std::string rounded(double v) {
  std::array<char, 32> text;
  return {
      text.data(),
      std::to_chars(text.data(), text.data() + text.size(), v, std::chars_format::general, 3).ptr};
}

}  // namespace locvol
