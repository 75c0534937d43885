#include "engine/ingest/text_scanner.h"

#include <fmt/format.h>
#include <locale.h>

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <string>
#include <system_error>

namespace locvol {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

// from_chars() knows no leading plus.
std::string_view without_plus(std::string_view word) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
  return word;
}

}  // namespace

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

std::string shown(std::string_view word) {
  std::string text(word.substr(0, 40));
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e) c = '?';
  return word.size() > 40 ? text + "..." : text;
}

std::optional<double> parse_number(std::string_view word) {
  const std::string_view digits = without_plus(word);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc::invalid_argument) return std::nullopt;
  if (end != digits.data() + digits.size()) {
    if (*end != 'd' && *end != 'D') return std::nullopt;
    std::string of_fortran(word);  // 1.5D+00
    of_fortran[static_cast<std::size_t>(end - word.data())] = 'e';
    return parse_number(of_fortran);
  }
  // Too large, or so small that it rounds to 0 or a denormal, as strtod() does; with a decimal
  // point, whatever locale the program that calls us has set.
  if (error == std::errc::result_out_of_range) {
    static const locale_t kPlain = ::newlocale(LC_ALL_MASK, "C", nullptr);
    return ::strtod_l(std::string(digits).c_str(), nullptr, kPlain);
  }
  return value;
}

bool TextScanner::next_line() {
  while (file_.next_line(rest_)) {
    cut_ = {};
    if (comment_ != '\0') {
      const std::string_view line = rest_;
      rest_ = line.substr(0, line.find(comment_));
      cut_ = line.substr(rest_.size());
    }
    if (!at_line_end()) return true;
  }
  rest_ = {};
  return false;
}

bool TextScanner::at_line_end() {
  std::size_t i = 0;
  while (i < rest_.size() && is_blank(rest_[i])) ++i;
  rest_.remove_prefix(i);
  return rest_.empty();
}

std::string_view TextScanner::word() {
  if (at_line_end()) return {};
  std::size_t length = 1;
  while (length < rest_.size() && !is_blank(rest_[length])) ++length;
  const std::string_view word = rest_.substr(0, length);
  rest_.remove_prefix(length);
  return word;
}

std::string_view TextScanner::word_on_any_line() {
  if (at_line_end() && !next_line()) file_.refuse_truncated();
  return word();
}

double TextScanner::coordinate() {
  const std::string_view next = word();
  if (next.empty()) file_.refuse_line("a coordinate is missing; the file is damaged or cut off");
  return coordinate(next);
}

std::uint64_t TextScanner::count_on_any_line(const char* what) {
  const std::int64_t count = integer(word_on_any_line(), what);
  if (count < 0) file_.refuse_line(fmt::format("the {} is negative ({})", what, count));
  return static_cast<std::uint64_t>(count);
}

double TextScanner::coordinate(std::string_view word) const {
  const std::optional<double> number = parse_number(word);
  if (!number)
    file_.refuse_line(fmt::format("\"{}\" is no number (with a decimal point)", shown(word)));
  const double value = *number;
  if (!std::isfinite(value))
    file_.refuse_line(
        fmt::format("the coordinate \"{}\" is not finite; remove the damaged vertex "
                    "and its triangles, then close the holes",
                    shown(word)));
  return value;
}

std::int64_t TextScanner::integer(std::string_view word, const char* what) const {
  if (word.empty()) file_.refuse_line(fmt::format("the {} is missing", what));
  const std::string_view digits = without_plus(word);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size())
    file_.refuse_line(
        fmt::format("\"{}\" is no integer, but the {} is expected", shown(word), what));
  return value;
}

}  // namespace locvol
