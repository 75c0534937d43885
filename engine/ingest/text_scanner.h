// TextScanner cuts the lines of an InputFile into words and numbers.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "engine/ingest/input_file.h"

namespace locvol {

// A word as a message may show it: short, and without control characters.
std::string shown(std::string_view word);
// Without blanks around it.
std::string_view trimmed(std::string_view text);
// A number with a decimal point; infinity, or about 0, for one out of a double's range. None: it is
// no number.
std::optional<double> parse_number(std::string_view word);

class TextScanner {
 public:
  // `comment` starts a comment, up to the end of its line; '\0': there are none.
  explicit TextScanner(InputFile& file, char comment = '\0') : file_(file), comment_(comment) {}

  bool next_line();    // to the next line with a word on it; false at the end of the file
  bool at_line_end();  // no further word on this line
  void skip_line() { rest_ = {}; }
  std::string_view rest() const { return rest_; }    // of this line
  std::string_view comment() const { return cut_; }  // what ends it, with its mark

  std::string_view word();  // on this line; empty at its end
  // The next word on this line. Throws InputError if there is none or it is no finite number.
  double coordinate();
  // The next word, on this line or a later one.
  std::string_view word_on_any_line();
  double coordinate_on_any_line() { return coordinate(word_on_any_line()); }
  std::uint64_t count_on_any_line(const char* what);  // `what` is counted, for messages

  // Throw InputError, naming the line, if the word is no finite number, no integer.
  double coordinate(std::string_view word) const;
  std::int64_t integer(std::string_view word, const char* what) const;

 private:
  InputFile& file_;
  char comment_;
  std::string_view rest_, cut_;  // of the current line
};

}  // namespace locvol
