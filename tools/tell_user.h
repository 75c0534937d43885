// What a user is told while a command works, on standard error.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

namespace locvol {

// Prints in one piece. That nobody can read it any more, for its reader has gone or its disk is
// full, is no reason to end a run of hours: so failures are ignored.
template <class... Values>
void tell_user(fmt::format_string<Values...> format, Values&&... values) {
  const std::string text = fmt::format(format, std::forward<Values>(values)...);
  std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace locvol
