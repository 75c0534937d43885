#include "engine/ingest/cell_sections.h"

#include <fmt/format.h>

#include <array>
#include <optional>
#include <vector>

#include "engine/ingest/polygon_triangulation.h"

namespace locvol {
namespace {

constexpr std::size_t kStripCorners = 1024;  // of which twice as many are looked at at once

// Three corners in a row are a triangle, every other one the other way around.
void give_strip(const std::vector<std::uint64_t>& strip, const FilePlace& place,
                SurfaceSink& sink) {
  for (std::size_t i = 2; i < strip.size(); ++i) {
    const std::uint64_t a = strip[i - 2], b = strip[i - 1], c = strip[i];
    if (a == b || b == c || c == a) continue;  // which strips turn around by
    sink.polygon(i % 2 == 0 ? std::array{a, b, c} : std::array{b, a, c}, place);
  }
}

}  // namespace

void give_cells(const InputFile& file, const CellSection& section, std::uint64_t first_vertex,
                std::uint64_t first_face, const std::function<std::int64_t()>& next_group,
                const std::string& group_name, SurfaceSink& sink) {
  const bool is_strip = section.kind == CellSection::Kind::kStrips;
  std::optional<std::int64_t> group;
  std::vector<std::uint64_t> corners;
  std::uint64_t num_left = section.num_corners;
  for (std::uint64_t c = 0; c < section.num_cells; ++c) {
    if (next_group) {
      const std::int64_t value = next_group();
      if (section.kind == CellSection::Kind::kOther) continue;
      if (group != value) sink.group(fmt::format("{} {}", group_name, value));
      group = value;
    }
    if (section.kind == CellSection::Kind::kOther) continue;
    const FilePlace place{FilePlace::Unit::kFace, first_face + c + 1};
    const std::uint64_t length = section.next_length();
    if (length > num_left)
      file.refuse(
          fmt::format("{} has {} corners, but only {} are left; the file is damaged: export it "
                      "again",
                      to_string(place), length, num_left));
    // Strips are as long as whoever made them could make them.
    if (!is_strip && length > kMaxPolygonCorners)
      file.refuse(fmt::format("{} has {} corners, more than {}; cut it into triangles",
                              to_string(place), length, kMaxPolygonCorners));
    num_left -= length;
    corners.clear();
    for (std::uint64_t i = 0; i < length; ++i) {
      corners.push_back(first_vertex + section.next_corner());
      if (is_strip && corners.size() == 2 * kStripCorners) {
        give_strip(corners, place, sink);
        corners.erase(corners.begin(), corners.end() - 2);
      }
    }
    if (is_strip)
      give_strip(corners, place, sink);
    else
      sink.polygon(corners, place);
  }
  if (num_left > 0 && section.kind != CellSection::Kind::kOther)
    file.refuse(fmt::format("has {} corners that no cell has; the file is damaged: export it again",
                            num_left));
}

}  // namespace locvol
