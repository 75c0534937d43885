// ValueReader reads the numbers of a file that has them as text or as bytes.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <cstdint>

#include "engine/ingest/number_bytes.h"
#include "engine/ingest/surface_sink.h"
#include "engine/ingest/text_scanner.h"

namespace locvol {

enum class Encoding { kAscii, kLittleEndian, kBigEndian };

// Throws InputError if it is not finite.
inline void give_vertex(const InputFile& file, std::uint64_t number, const Point& p,
                        SurfaceSink& sink) {
  if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
    file.refuse(
        fmt::format("vertex {} (counted from 0) has the coordinates ({}, {}, {}), which are not "
                    "finite; remove it and its triangles, then close the holes",
                    number, p.x, p.y, p.z));
  sink.vertex(p);
}

// All throw InputError: the file ends, or a word is no such number.
class ValueReader {
 public:
  ValueReader(InputFile& file, Encoding encoding)
      : file_(file), encoding_(encoding), scanner_(file) {}

  bool is_text() const { return encoding_ == Encoding::kAscii; }
  TextScanner& text() { return scanner_; }  // of what lies between values

  double number(NumberType type) {
    if (encoding_ == Encoding::kAscii) return scanner_.coordinate_on_any_line();
    return number_in(file_.take(bytes_of(type)), type, is_big_endian());
  }

  // REQUIRES: is_integer(type)
  std::uint64_t count(NumberType type, const char* what) {
    if (encoding_ == Encoding::kAscii) return scanner_.count_on_any_line(what);
    const std::int64_t value = integer(type, what);
    if (value < 0)
      file_.refuse(fmt::format("the {} is negative ({}) before byte {}; the file is damaged", what,
                               value, file_.position()));
    return static_cast<std::uint64_t>(value);
  }
  // Below 0 also for what is above 2^63 - 1.
  std::int64_t integer(NumberType type, const char* what) {
    if (encoding_ == Encoding::kAscii) return scanner_.integer(scanner_.word_on_any_line(), what);
    return integer_in(file_.take(bytes_of(type)), type, is_big_endian());
  }

  void skip(NumberType type) {
    if (encoding_ == Encoding::kAscii)
      scanner_.word_on_any_line();
    else
      file_.take(bytes_of(type));
  }

  FilePlace place(std::uint64_t face) const {
    if (encoding_ == Encoding::kAscii) return {FilePlace::Unit::kLine, file_.line_number()};
    return {FilePlace::Unit::kFace, face + 1};
  }

  bool has_more() { return !scanner_.at_line_end() || scanner_.next_line(); }

 private:
  bool is_big_endian() const { return encoding_ == Encoding::kBigEndian; }

  InputFile& file_;
  Encoding encoding_;
  TextScanner scanner_;
};

}  // namespace locvol
