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

// A strip is narrower than this, over the spacing floor, ends in a point, and is a step: the
// surface turns one way where it begins, and the other way where it ends. Towards the point its two
// creases are too close to each other to be kept. Those of a wall are not, for mirrors part its
// sides. What is narrower than the floor itself needs no point. What is wide elsewhere may have
// strips, too: where it is narrow, ribs part it, edges that are shorter than a strip is wide.
inline constexpr double kLeastSheetWidth = 3;
inline constexpr double kPointedAngle = 15;  // degrees: what is more acute is a point

struct SheetLaw {
  // Degrees; 0: if no edges are given, sheets are the named groups, whatever hangs together.
  double sharp_angle = 0;
  double least_area = 0;   // of sheets
  double least_width = 0;  // of sheets with points: twice the area over the length of the border

  // Of a run. `spacing_floor`: over λ
  static SheetLaw of_size(double size, double sharp_angle, double spacing_floor) {
    return {.sharp_angle = sharp_angle,
            .least_area = kLeastSheetArea * size * size,
            .least_width = kLeastSheetWidth * spacing_floor * size};
  }
};

// Triangles of one group that hang together by edges which are neither sharp nor ribs, or some of
// them.
struct SheetPart {
  std::uint64_t first_triangle = std::numeric_limits<std::uint64_t>::max();
  SheetId group = 1;
  CompensatedSum area;
  std::uint64_t num_points = 0;  // see kPointedAngle
  // The length of its sharp edges, seen from it, where the surface turns to the side that it faces,
  // less that where it turns away. Those within it have two sides.
  CompensatedSum turn;
  bool is_first_turned = false;  // the first triangle, against the way that the part faces

  void add(const SheetPart& other, bool is_turned) {
    if (other.first_triangle < first_triangle) {
      first_triangle = other.first_triangle;
      is_first_turned = other.is_first_turned != is_turned;
    }
    area.add(other.area);
    num_points += other.num_points;
    CompensatedSum its_turn = other.turn;
    if (is_turned) its_turn.negate();
    turn.add(its_turn);
  }
  // Then it faces as its first triangle does, however it was put together.
  void face_as_first() {
    if (is_first_turned) turn.negate();
    is_first_turned = false;
  }
};

// Edges between two parts of a group: sharp ones, or ribs.
struct SheetBorder {
  std::uint32_t a = 0, b = 0;  // places of parts, a < b
  bool is_rib = false;
  CompensatedSum length;
};

// What a triangle is of.
struct SheetPiece {
  std::uint32_t part = 0, whole = 0;  // strips have a whole in common with what they are one with
  // Is the edge between them one of a strip and of what it is one with? Then it is no crease.
  bool is_beside_strip(const SheetPiece& other) const {
    return part != other.part && whole == other.whole;
  }
};

struct SheetPlan {
  std::vector<SheetId> of_part;    // from 1 on, in the order of their first triangles
  std::vector<SheetFacts> sheets;  // with names and first triangles; no more is known
  std::uint64_t num_specks = 0;    // parts that were too small, and strips
  std::vector<SheetPiece> pieces;  // by part; empty: there are no strips
  std::uint64_t num_too_many = 0;  // sheets; 0: not more than the most, else none is here
};

// What ribs part is one again, but strips and what is no strip. Then parts smaller than the law's
// least area, and strips, the smallest first, become one with the part of their group with which
// they share the longest border. `groups`: names, by SheetPart::group. A sheet is called as
// its group; of several in a group, NAME_1 and so on; without a group's name, by its own number.
// Borders may be listed several times, and join parts that are one. `bodies_of_group`: on the sides
// of each group; empty: the only one is behind all. `most`: sheets.
SheetPlan plan_sheets(std::span<const SheetPart> parts, std::span<const SheetBorder> borders,
                      std::span<const std::string> groups, const SheetLaw& law,
                      std::span<const std::array<BodyId, 2>> bodies_of_group = {},
                      std::size_t most = kMaxSheets);

}  // namespace locvol
