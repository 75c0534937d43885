#include <fmt/format.h>

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "engine/ingest/number_bytes.h"
#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/value_reader.h"

namespace locvol {
namespace {

// What the shortest vertex ("0 0 0") and the shortest face ("0") take, with the end of the line.
constexpr std::uint64_t kMinVertexBytes = 6;
constexpr std::uint64_t kMinFaceBytes = 2;

// ST, C, N, 4 and n in any order, then OFF: texture coordinates, colors and normals follow the
// position on each vertex line; 4 and n are other dimensions. The number of vertices may follow at
// once, as in some files of ModelNet.
struct OffKeyword {
  bool is_valid = false;
  bool is_three_dimensional = true;
  std::uint64_t num_more_floats = 0;  // of each vertex in a binary file
  std::string_view count;             // what follows
};

OffKeyword parse_keyword(std::string_view word) {
  const auto skip = [&](std::string_view prefix, std::string_view lower_case) {
    const bool is_there = word.starts_with(prefix) || word.starts_with(lower_case);
    if (is_there) word.remove_prefix(prefix.size());
    return is_there;
  };
  OffKeyword keyword;
  for (;;) {
    if (skip("ST", "st"))
      keyword.num_more_floats += 2;
    else if (skip("C", "c"))
      keyword.num_more_floats += 4;
    else if (skip("N", "N"))
      keyword.num_more_floats += 3;
    else
      break;
  }
  while (skip("4", "4") || skip("n", "n")) keyword.is_three_dimensional = false;
  keyword.is_valid = skip("OFF", "off") && word.find_first_not_of("0123456789") == word.npos;
  keyword.count = word;
  return keyword;
}

// None: what follows this line is binary. The first word is the keyword, or the number of vertices
// where the keyword is left out.
std::optional<std::uint64_t> read_num_vertices(InputFile& file, TextScanner& scanner,
                                               OffKeyword& keyword) {
  const std::string_view first = scanner.word_on_any_line();
  keyword = parse_keyword(first);
  const auto count = [&](std::string_view word) {
    const std::int64_t number = scanner.integer(word, "number of vertices");
    if (number < 0) file.refuse_line("the number of vertices is negative");
    return static_cast<std::uint64_t>(number);
  };
  if (!keyword.is_valid) {
    if (first.find_first_not_of("0123456789") != std::string_view::npos)
      file.refuse_line("is no OFF file: it must begin with the word OFF");
    return count(first);
  }
  if (!keyword.is_three_dimensional)
    file.refuse_line("is an OFF file of another dimension than 3; export it as OFF");
  if (!keyword.count.empty()) return count(keyword.count);
  const std::string_view second = scanner.word_on_any_line();
  if (second == "BINARY") return std::nullopt;
  return count(second);
}

void check_counts(const InputFile& file, std::uint64_t num_vertices, std::uint64_t num_faces) {
  // One byte more: the last line may lack its end.
  const std::uint64_t available = file.remaining() + 1;
  if (num_vertices > available / kMinVertexBytes ||
      num_faces > (available - kMinVertexBytes * num_vertices) / kMinFaceBytes)
    file.refuse_line(fmt::format(
        "promises {} vertices and {} faces, more than the remaining {} bytes can hold; the file is "
        "cut off or its header is wrong",
        num_vertices, num_faces, file.remaining()));
}

// ---- Binary, as Geomview has it: 32-bit integers and floats, the highest byte first

std::uint64_t take_count(InputFile& file, const char* what) {
  const std::int64_t count = integer_in(file.take(4), NumberType::kInt32, true);
  if (count < 0)
    file.refuse(fmt::format("the {} is negative ({}) before byte {}; the file is damaged", what,
                            count, file.position()));
  return static_cast<std::uint64_t>(count);
}

void parse_binary(InputFile& file, std::uint64_t num_more_floats, SurfaceSink& sink) {
  const std::uint64_t num_vertices = take_count(file, "number of vertices");
  const std::uint64_t num_faces = take_count(file, "number of faces");
  file.take(4);  // the number of edges
  const std::uint64_t vertex_bytes = 4 * (3 + num_more_floats), min_face_bytes = 8;
  if (num_vertices > file.remaining() / vertex_bytes ||
      num_faces > (file.remaining() - vertex_bytes * num_vertices) / min_face_bytes)
    file.refuse(fmt::format(
        "its header promises {} vertices and {} faces, more than the remaining {} bytes can hold; "
        "the file is cut off, or its numbers do not have the highest byte first",
        num_vertices, num_faces, file.remaining()));
  sink.announce(num_faces);
  for (std::uint64_t v = 0; v < num_vertices; ++v) {
    const unsigned char* const bytes = file.take(vertex_bytes);
    const auto coordinate = [&](int axis) {
      return number_in(bytes + 4 * axis, NumberType::kFloat32, true);
    };
    give_vertex(file, v, {coordinate(0), coordinate(1), coordinate(2)}, sink);
  }
  std::vector<std::uint64_t> corners;
  for (std::uint64_t f = 0; f < num_faces; ++f) {
    const std::uint64_t num_corners = take_count(file, "number of corners");
    corners.clear();
    for (std::uint64_t c = 0; c < num_corners; ++c)
      corners.push_back(take_count(file, "number of a vertex"));
    const std::uint64_t num_colors = take_count(file, "number of colors");
    for (std::uint64_t i = 0; i < num_colors; ++i) file.take(4);
    sink.polygon(corners, {FilePlace::Unit::kFace, f + 1});
  }
  if (!file.peek(1).empty())
    file.refuse(
        fmt::format("goes on at byte {}, after the {} vertices and {} faces that its header "
                    "promises; correct the header",
                    file.position(), num_vertices, num_faces));
}

}  // namespace

bool is_off_keyword(std::string_view word) { return parse_keyword(word).is_valid; }

void parse_off(InputFile& file, SurfaceSink& sink) {
  constexpr std::size_t kHeadBytes = 256;
  TextScanner scanner(file, '#');
  OffKeyword keyword;
  // A line of the head may end in any way, but a byte after "BINARY" may be of any value.
  if (file.peek(kHeadBytes).find('\n') != std::string_view::npos)
    file.set_line_end(InputFile::LineEnd::kLineFeed);
  const auto counted = read_num_vertices(file, scanner, keyword);
  if (!counted) return parse_binary(file, keyword.num_more_floats, sink);
  file.set_line_end(InputFile::LineEnd::kAny);
  const std::uint64_t num_vertices = *counted;
  const std::uint64_t num_faces = scanner.count_on_any_line("number of faces");
  scanner.skip_line();  // the number of edges, which nobody keeps right
  check_counts(file, num_vertices, num_faces);
  sink.announce(num_faces);

  for (std::uint64_t v = 0; v < num_vertices; ++v) {
    const double x = scanner.coordinate_on_any_line();
    const double y = scanner.coordinate_on_any_line();
    const double z = scanner.coordinate_on_any_line();
    sink.vertex({x, y, z});
    scanner.skip_line();  // normal, color, texture coordinates
  }
  std::vector<std::uint64_t> corners;
  for (std::uint64_t f = 0; f < num_faces; ++f) {
    const std::uint64_t num_corners = scanner.count_on_any_line("number of corners");
    const FilePlace place{FilePlace::Unit::kLine, file.line_number()};
    corners.clear();
    for (std::uint64_t c = 0; c < num_corners; ++c)
      corners.push_back(scanner.count_on_any_line("number of a vertex"));
    sink.polygon(corners, place);
    scanner.skip_line();  // color
  }
  if (scanner.next_line())
    file.refuse_line(
        fmt::format("the file goes on after the {} vertices and {} faces that its header "
                    "promises; correct the header",
                    num_vertices, num_faces));
}

}  // namespace locvol
