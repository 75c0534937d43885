// The surface of what triangles wind around, whatever they are: where the generalized winding
// number exceeds 1/2 is inside.
//
//   triangles ── one orientation ── cut along each other ── kept where the label changes ──
//     holes closed by the level 1/2 ── the same again of what is closed ── the surface
//
// So holes close, what overlaps is united, and doubled and inner walls vanish.
#pragma once

#include <cstdint>

#include "octree/geometry.h"
#include "octree/stop.h"
#include "refine/cure/cure_surface.h"

namespace locvol {

struct WindingChanges {
  std::uint64_t num_joined = 0;  // points at open edges that became others
  double largest_move = 0;       // of these
  // Triangles without neighbors are no part of the surface, which is where the number is 1/2.
  bool is_level = false;
  std::uint64_t num_turned = 0;  // triangles, against most of their patch, or all against them
  std::uint64_t num_cut = 0;     // along others
  double left_out_area = 0;      // inside or outside on both sides, over all area
  std::uint64_t num_holes = 0;
  std::uint64_t largest_hole = 0;  // edges of it
  double closing_area = 0;         // over the surface's
  // The share of the box where the number is farther than 0.1 from an integer.
  double doubt = 0;
};

// Of the shortest open edge at a point: what is farther away from it is not joined with it.
inline constexpr double kOfShortestOpen = 0.1;

// What two points, or a point and an edge of a triangle, are nearer than, is one to
// winding_surface().
double snapping_distance(const Box& box);

// A closed surface: each edge is in an even number of triangles, and they face away from what is
// inside; where rounding does not let it close, some edges stay open. It may meet itself as much
// as rounding does. Groups of what closes holes are those around
// them, some with kOverHole. `spacing`: holes more than three times as wide get vertices as far
// apart. `gap`: points at open edges that are closer become one, unless that is more than a tenth
// of such edges at them. No triangles: nothing is inside. Throws Stopped.
LooseSurface winding_surface(const LooseSurface& surface, double spacing, double gap,
                             WindingChanges& changes, const StopToken* stop);

struct WindingDoubt {
  double share = 0;         // WindingChanges::doubt
  double inside = 0;        // of the box, where the number exceeds 3/4: beside a sheet, nowhere
  bool is_nothing = false;  // all cancel each other
};
// These alone, in a part of the time. Where nothing is open, 0. Throws Stopped.
WindingDoubt winding_doubt(const LooseSurface& surface, const StopToken* stop);

}  // namespace locvol
