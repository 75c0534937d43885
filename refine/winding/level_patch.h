// The surface over holes: where the winding number passes 1/2. Internal to refine/winding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "octree/geometry.h"
#include "octree/stop.h"
#include "refine/winding/chain.h"
#include "refine/winding/winding_number.h"

namespace locvol {

struct PatchCounts {
  std::uint64_t num_holes = 0;     // loops of open edges
  std::uint64_t largest_hole = 0;  // edges of it
  double area = 0;                 // of what closes them
};

// Closes the open edges of what bounds something but for its holes.
//   - Pieces that are narrower than three times the spacing, and bound nothing, go.
//   - A hole is filled by triangles without new vertices if it is as narrow; a wider one if they
//     lie where the winding number is nearly 1/2.
//   - The others lose the teeth of their rims (rim_ears.h). What is then narrower than twice the
//     spacing is filled likewise. Over the rest goes the level 1/2, on a grid of that spacing (by
//     marching tetrahedra). Open edges are halved to the spacing, and what is left between grid and
//     edges is filled, and unfolded (unfold_patch.h).
// Afterwards the chain is closed. Throws Stopped.
PatchCounts close_by_level(Chain& kept, double spacing, const StopToken* stop);

// A connected part of triangles.
struct ChainPiece {
  Box box;
  std::size_t num = 0;
  double area = 0, border = 0;  // the latter: the length of edges in one triangle

  // Is it narrower than `most`, or of fewer triangles than `few`, and has so long a border that it
  // bounds nothing? A closed curve of length L bounds at least no area of L²/4π: around it more is
  // missing than is there.
  bool is_island(double most, std::size_t few) const;
};
// Of pieces that go, and of holes that are filled by triangles without new vertices, the width in
// spacings; and of how few triangles islands are.
inline constexpr double kWide = 3;
inline constexpr std::size_t kFewOnIsland = 10;
inline constexpr double kMostIslands = 0.3;  // of the area

// Fills those open edges whose holes take no level. `number`: of winding, at a place. True: others
// are left.
bool fill_holes(Chain& kept, std::span<const OpenEdge> open, double spacing,
                const std::function<double(const Point&)>& number);
PatchCounts counts_of_holes(const Chain& chain, std::span<const OpenEdge> open);
// Is the number at a place over a hole so near to 1/2 that the level is nearly there?
bool is_near_level(double number);

// Is it mostly made of such pieces, or of wider ones of few triangles, as triangles without
// neighbors are?
bool is_mostly_islands(const Chain& chain, double spacing);
// Then this is all there is: the level 1/2, closed, on such a grid. `number`: of the chain. Throws
// Stopped.
Chain level_surface(const Chain& chain, const WindingNumber& number, double spacing,
                    const StopToken* stop);

// Closes open edges by triangles without new vertices alone.
PatchCounts close_by_loops(Chain& chain);

}  // namespace locvol
