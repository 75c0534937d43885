// Which parts of a surface are sheets: what hangs together within a named group, without what is
// too small to be one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "engine/shared/compensated_sum.h"
#include "octree/mesh_facet.h"
#include "storage/records.h"

namespace locvol {

// A sheet's worth of area, over λ²: what is smaller is a speck, if anything is beside it in its
// group.
inline constexpr double kLeastSheetArea = 0.5;
inline constexpr std::size_t kMaxSheets = 10'000;

// Triangles of one group that hang together by edges which are not sharp, or some of them.
struct SheetPart {
  std::uint64_t first_triangle = std::numeric_limits<std::uint64_t>::max();
  SheetId group = 1;
  CompensatedSum area;

  void add(const SheetPart& other, bool /*is_turned*/) {
    if (other.first_triangle < first_triangle) first_triangle = other.first_triangle;
    area.add(other.area);
  }
};

// Sharp edges between two parts of a group.
struct SheetBorder {
  std::uint32_t a = 0, b = 0;  // places of parts, a < b
  CompensatedSum length;
};

struct SheetPlan {
  std::vector<SheetId> of_part;    // from 1 on, in the order of their first triangles
  std::vector<SheetFacts> sheets;  // with names and first triangles; no more is known
  std::uint64_t num_specks = 0;    // parts that were too small
  std::uint64_t num_too_many = 0;  // sheets; 0: not more than the most, else none is here
};

// Parts smaller than `least_area`, the smallest first, become one with the part of their group with
// which they share the longest border. `groups`: names, by SheetPart::group. A sheet is called as
// its group; of several in a group, NAME_1 and so on; without a group's name, by its own number.
// Borders may be listed several times, and join parts that are one.
// `bodies_of_group`: on the sides of each group; empty: the only one is behind all. `most`: sheets.
SheetPlan plan_sheets(std::span<const SheetPart> parts, std::span<const SheetBorder> borders,
                      std::span<const std::string> groups, double least_area,
                      std::span<const std::array<BodyId, 2>> bodies_of_group = {},
                      std::size_t most = kMaxSheets);

}  // namespace locvol
