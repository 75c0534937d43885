#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"

namespace locvol {
namespace {

// Binary STL, little-endian:
//   byte 0   80   header, any text
//   byte 80   4   n, the number of triangles
//   byte 84  50   first triangle: normal (3 floats), three corners (3 floats each), 2 unused bytes
//   …             n of them
// The unused bytes are a color to some programs, with nothing behind them.
constexpr std::size_t kHeaderBytes = 84;
constexpr std::size_t kTriangleBytes = 50;
constexpr std::size_t kNormalBytes = 12;

std::uint32_t little_endian(const unsigned char* bytes) {
  return bytes[0] | std::uint32_t{bytes[1]} << 8 | std::uint32_t{bytes[2]} << 16 |
         std::uint32_t{bytes[3]} << 24;
}

double float_at(const unsigned char* bytes) { return std::bit_cast<float>(little_endian(bytes)); }

std::uint32_t promised_triangles(std::string_view header) {
  return little_endian(reinterpret_cast<const unsigned char*>(header.data()) + 80);
}

std::uint64_t binary_size(std::uint64_t num_triangles) {
  return kHeaderBytes + kTriangleBytes * num_triangles;
}

bool starts_with(std::string_view word, std::string_view lower_case) {
  if (word.size() < lower_case.size()) return false;
  for (std::size_t i = 0; i < lower_case.size(); ++i)
    if ((word[i] | 0x20) != lower_case[i]) return false;
  return true;
}

bool is_word(std::string_view word, std::string_view lower_case) {
  return word.size() == lower_case.size() && starts_with(word, lower_case);
}

bool starts_comment(std::string_view word) {
  return word[0] == '#' || word[0] == ';' || word[0] == '!' || word.starts_with("//");
}

// solid NAME / facet normal x y z / outer loop / vertex x y z (three times) / endloop / endfacet /
// endsolid NAME: with keywords in any case, those of an end also as two words, and a facet on as
// many lines as one likes. Only facets and names matter: whatever else stands between facets is let
// be, and so are normals, and what follows a vertex. A solid is a group of its name.
class AsciiStlParser {
 public:
  AsciiStlParser(InputFile& file, SurfaceSink& sink) : file_(file), sink_(sink), scanner_(file) {}

  void run() {
    while (scanner_.next_line()) {
      bool is_first = true;
      while (!scanner_.at_line_end() && take(scanner_.word(), is_first)) is_first = false;
    }
    if (num_corners_) file_.refuse("ends inside a facet: it is cut off; fetch or export it again");
    if (!has_begun_)
      file_.refuse(
          "is text, but no ASCII STL file: no line of it begins with \"solid\" or \"facet\"");
    if (is_in_solid_)
      sink_.note("the file ends without \"endsolid\": if parts are missing, it is cut off");
  }

 private:
  // False: the rest of the line says nothing.
  bool take(std::string_view word, bool is_first) {
    if (!has_begun_ && !is_word(word, "solid") && !is_word(word, "facet")) return false;
    if (is_word(word, "vertex")) return take_vertex();
    if (is_word(word, "facet")) return begin_facet();
    if (is_word(word, "outer")) return begin_loop();
    if (starts_with(word, "end")) return take_end(word.substr(3));
    if (is_word(word, "solid")) {
      require(!num_corners_, "a solid begins inside a facet");
      has_begun_ = is_in_solid_ = true;
      sink_.group(scanner_.rest());
    } else if (num_corners_ && is_first) {
      require(starts_comment(word), "is no line of a facet");
    }
    return false;
  }

  bool take_vertex() {
    require(num_corners_ && *num_corners_ < 3, "a vertex too many, or outside a facet");
    const double x = scanner_.coordinate(), y = scanner_.coordinate(), z = scanner_.coordinate();
    corners_[static_cast<std::size_t>((*num_corners_)++)] = {x, y, z};
    return true;
  }

  // Its normal is whatever comes before the loop, which may be on the same line.
  bool begin_facet() {
    require(!num_corners_, "\"facet\" stands inside a facet");
    has_begun_ = true;
    num_corners_ = 0;
    scanner_.word();  // "normal"
    if (std::ranges::none_of(scanner_.rest(), [](char c) { return (c | 0x20) == 'o'; }))
      return false;  // as fast as lines are that say nothing
    while (!scanner_.at_line_end())
      if (is_word(scanner_.word(), "outer")) return begin_loop();
    return true;
  }

  bool begin_loop() {
    scanner_.word();  // "loop"
    require(num_corners_.has_value(), "a loop stands outside a facet");
    return true;
  }

  // What stands at the end, or in the next word: some write "endsolidNAME".
  bool take_end(std::string_view of) {
    if (of.empty()) of = scanner_.word();
    if (is_word(of, "loop")) {
      require(num_corners_.has_value(), "a loop stands outside a facet");
    } else if (is_word(of, "facet")) {
      require(num_corners_ == 3, "a facet must have three vertices");
      sink_.facet(corners_);
      num_corners_.reset();
    } else {
      require(!num_corners_, "is no line of a facet");
      if (starts_with(of, "solid")) is_in_solid_ = false;
      return false;
    }
    return true;
  }

  void require(bool holds, const char* what) const {
    if (!holds) file_.refuse_line(fmt::format("{}; the file is damaged", what));
  }

  InputFile& file_;
  SurfaceSink& sink_;
  TextScanner scanner_;
  bool has_begun_ = false;  // a solid or a facet
  bool is_in_solid_ = false;
  std::optional<int> num_corners_;  // of the open facet
  std::array<Point, 3> corners_;
};

// The next triangles, of which `first` is the first one.
void read_triangles(InputFile& file, std::uint64_t first, std::uint64_t end, SurfaceSink& sink) {
  std::array<Point, 3> corners;
  for (std::uint64_t t = first; t < end; ++t) {
    const unsigned char* data = file.take(kTriangleBytes) + kNormalBytes;
    for (int corner = 0; corner < 3; ++corner, data += 12) {
      const Point p{float_at(data), float_at(data + 4), float_at(data + 8)};
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
        file.refuse(
            fmt::format("corner {} of triangle {} has the coordinates ({}, {}, {}), which are "
                        "not finite; remove the triangle, then close the hole",
                        corner + 1, t + 1, p.x, p.y, p.z));
      corners[static_cast<std::size_t>(corner)] = p;
    }
    sink.facet(corners);
  }
}

// How many triangles are to be read. A count above what is there tells that the file is cut off.
// One below is wrong where all that is there is whole triangles, for some programs do not know it
// when they write the header; otherwise something else follows the triangles.
std::uint64_t triangles_in(const InputFile& file, std::uint64_t promised, SurfaceSink& sink) {
  const std::uint64_t bytes = file.size() - kHeaderBytes;
  const std::uint64_t whole = bytes / kTriangleBytes, more = bytes % kTriangleBytes;
  if (promised > whole)
    file.refuse(
        fmt::format("is no whole STL file: as binary STL it promises {} triangles, which take "
                    "{} bytes, but it has {}; fetch or export it again",
                    promised, binary_size(promised), file.size()));
  if (promised == whole && more == 0) return promised;
  if (more == 0) {
    sink.note(fmt::format("the file says that it has {} triangles, but has {}, which are read",
                          promised, whole));
    return whole;
  }
  if (promised == 0 && whole > 0)
    file.refuse(fmt::format(
        "is no whole STL file: as binary STL it promises no triangles, but has {} and {} bytes of "
        "another; fetch or export it again",
        whole, more));
  sink.note(fmt::format("left out the last {} bytes of the file, which follow its triangles",
                        file.size() - binary_size(promised)));
  return promised;
}

class BinaryStlRanges : public SurfaceRanges {
 public:
  BinaryStlRanges(InputFile file, std::uint64_t num_triangles)
      : SurfaceRanges(std::move(file), num_triangles, 0) {}

  void read_part(std::uint64_t part, std::uint64_t num_parts, SurfaceSink& sink) override {
    const std::uint64_t first = begin_of_part(num_faces(), part, num_parts);
    file_.seek(binary_size(first));
    read_triangles(file_, first, begin_of_part(num_faces(), part + 1, num_parts), sink);
  }
};

}  // namespace

bool has_stl_line(std::string_view text) {
  while (!text.empty()) {
    const std::size_t begin = text.find_first_not_of(" \t\r\n");
    if (begin == std::string_view::npos) return false;
    text.remove_prefix(begin);
    const std::string_view word = text.substr(0, text.find_first_of(" \t\r\n"));
    if (is_word(word, "solid") || is_word(word, "facet")) return true;
    text.remove_prefix(std::min(text.find_first_of("\r\n"), text.size()));
  }
  return false;
}

bool is_binary_stl(InputFile& file) {
  const std::string_view header = file.peek(kHeaderBytes);
  return header.size() == kHeaderBytes && file.size() == binary_size(promised_triangles(header));
}

void parse_binary_stl(InputFile& file, SurfaceSink& sink) {
  const std::string_view header = file.peek(kHeaderBytes);
  if (header.size() < kHeaderBytes)
    file.refuse(
        "is no STL file: it neither begins with \"solid\" nor has the 84 bytes of a header");
  const std::uint64_t num_triangles = triangles_in(file, promised_triangles(header), sink);
  file.take(kHeaderBytes);
  sink.announce(num_triangles);
  read_triangles(file, 0, num_triangles, sink);
}

std::unique_ptr<SurfaceRanges> ranges_of_binary_stl(InputFile file) {
  if (!is_binary_stl(file)) return nullptr;
  const std::uint64_t num_triangles = promised_triangles(file.peek(kHeaderBytes));
  return std::make_unique<BinaryStlRanges>(std::move(file), num_triangles);
}

void parse_ascii_stl(InputFile& file, SurfaceSink& sink) { AsciiStlParser(file, sink).run(); }

}  // namespace locvol
