#include <fmt/format.h>

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

bool is_word(std::string_view word, std::string_view lower_case) {
  if (word.size() != lower_case.size()) return false;
  for (std::size_t i = 0; i < word.size(); ++i)
    if ((word[i] | 0x20) != lower_case[i]) return false;
  return true;
}

// facet normal x y z / outer loop / vertex x y z (three times) / endloop / endfacet: the word that
// begins a line decides, and num_corners_ says where in the facet we are.
class AsciiStlParser {
 public:
  AsciiStlParser(InputFile& file, SurfaceSink& sink) : file_(file), sink_(sink), scanner_(file) {}

  void run() {
    while (scanner_.next_line()) {
      take(scanner_.word());
      scanner_.skip_line();  // the name of a solid, a normal
    }
    if (is_in_solid_)
      file_.refuse("ends without \"endsolid\": it is cut off; fetch or export it again");
  }

 private:
  void take(std::string_view word) {
    if (is_word(word, "vertex")) {
      take_vertex();
    } else if (is_word(word, "facet")) {
      require(is_in_solid_ && !num_corners_, "\"facet\" stands inside a facet or outside a solid");
      num_corners_ = 0;
    } else if (is_word(word, "outer") || is_word(word, "endloop")) {
      require(num_corners_.has_value(), "a loop stands outside a facet");
    } else if (is_word(word, "endfacet")) {
      require(num_corners_ == 3, "a facet must have three vertices");
      sink_.facet(corners_);
      num_corners_.reset();
    } else if (is_word(word, "solid")) {
      require(!is_in_solid_, "a solid begins inside a solid");
      is_in_solid_ = true;
    } else if (is_word(word, "endsolid")) {
      require(is_in_solid_ && !num_corners_, "\"endsolid\" stands inside a facet");
      is_in_solid_ = false;
    } else {
      file_.refuse_line("is no line of an ASCII STL file; the file is damaged");
    }
  }

  void take_vertex() {
    require(num_corners_ && *num_corners_ < 3, "a vertex too many, or outside a facet");
    const double x = scanner_.coordinate(), y = scanner_.coordinate(), z = scanner_.coordinate();
    corners_[static_cast<std::size_t>((*num_corners_)++)] = {x, y, z};
  }

  void require(bool holds, const char* what) const {
    if (!holds) file_.refuse_line(fmt::format("{}; the file is damaged", what));
  }

  InputFile& file_;
  SurfaceSink& sink_;
  TextScanner scanner_;
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

bool is_binary_stl(InputFile& file) {
  const std::string_view header = file.peek(kHeaderBytes);
  return header.size() == kHeaderBytes && file.size() == binary_size(promised_triangles(header));
}

void parse_binary_stl(InputFile& file, SurfaceSink& sink) {
  const std::string_view header = file.peek(kHeaderBytes);
  if (header.size() < kHeaderBytes)
    file.refuse(
        "is no STL file: it neither begins with \"solid\" nor has the 84 bytes of a header");
  const std::uint64_t num_triangles = promised_triangles(header);
  if (file.size() != binary_size(num_triangles))
    file.refuse(
        fmt::format("is no whole STL file: as binary STL it promises {} triangles, which take "
                    "{} bytes, but it has {}; fetch or export it again",
                    num_triangles, binary_size(num_triangles), file.size()));
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
