// How messages about a surface name its parts.
#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <string>
#include <string_view>

#include "engine/ingest/surface_check.h"
#include "octree/geometry.h"

namespace locvol {

inline std::string text(const Point& p) { return fmt::format("({}, {}, {})", p.x, p.y, p.z); }

inline std::string text(const Triangle& t) {
  return fmt::format("triangle {} with the corners {}, {}, {}", t.id, text(t.corners[0]),
                     text(t.corners[1]), text(t.corners[2]));
}

inline std::string text(const EdgeFlaws& flaws) {
  return fmt::format("{} to {} of triangle {}", text(flaws.from), text(flaws.to),
                     flaws.half_edge / 3);
}

inline std::string counted(std::uint64_t count, std::string_view one, std::string_view many) {
  return fmt::format("{} {}", count, count == 1 ? one : many);
}

}  // namespace locvol
