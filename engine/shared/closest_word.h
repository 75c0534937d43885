// Which of the words that are known is meant, where one is not.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace locvol {

// The first of those that are meant most likely by who wrote `word`; empty if none is.
std::string closest_word(std::string_view word, std::span<const std::string> known);

}  // namespace locvol
