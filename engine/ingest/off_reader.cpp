#include <fmt/format.h>

#include <cstdint>
#include <string_view>
#include <vector>

#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"

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
  std::string_view count;  // what follows
};

OffKeyword parse_keyword(std::string_view word) {
  const auto skip = [&](std::string_view prefix, std::string_view lower_case) {
    const bool is_there = word.starts_with(prefix) || word.starts_with(lower_case);
    if (is_there) word.remove_prefix(prefix.size());
    return is_there;
  };
  OffKeyword keyword;
  while (skip("ST", "st") || skip("C", "c") || skip("N", "N")) {
  }
  while (skip("4", "4") || skip("n", "n")) keyword.is_three_dimensional = false;
  keyword.is_valid = skip("OFF", "off") && word.find_first_not_of("0123456789") == word.npos;
  keyword.count = word;
  return keyword;
}

// The first word is the keyword, or the number of vertices where the keyword is left out.
std::uint64_t read_num_vertices(InputFile& file, TextScanner& scanner) {
  const std::string_view first = scanner.word_on_any_line();
  const OffKeyword keyword = parse_keyword(first);
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
  if (second == "BINARY") file.refuse_line("is binary OFF; export it as ASCII OFF or as PLY");
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

}  // namespace

bool is_off_keyword(std::string_view word) { return parse_keyword(word).is_valid; }

void parse_off(InputFile& file, SurfaceSink& sink) {
  TextScanner scanner(file, '#');
  const std::uint64_t num_vertices = read_num_vertices(file, scanner);
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
