/// \file
/// What a program asks of a run: a part of locvol.h, which includes it.
//
// The engine and the command take the same struct. Each member that the mesh depends on has a row
// in option_table.h.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace locvol {

// These are in storage/run_choices.h. It is not included here, where an installed header would not
// find it: locvol.h does that.
enum class Initialization : std::uint8_t;
enum class InsideRule : std::uint8_t;

/// x, y and z.
using Coordinates = std::array<double, 3>;

/// λ, the bound on the circumradii of the cells and on the surface's balls. Half of it makes about
/// eight times the cells.
struct Size {
  double value = 0;         ///< A length in the units of the coordinates, or a percentage.
  bool is_percent = false;  ///< Whether it is one: of the smallest side of the bounding box.

  /// A length in the units of the coordinates.
  static Size length(double value) { return {value, false}; }
  /// A percentage of the smallest side of the surface's bounding box.
  static Size percent(double value) { return {value, true}; }
};

/// Where cells are to be smaller than elsewhere: the bound on circumradii is `size` in all of the
/// shape, and larger by Options::growth of the distance from it.
struct SizedShape {
  /// What it is.
  enum class Kind { kBall, kBox, kSegment };
  Kind kind = Kind::kBall;  ///< What it is.
  Size size = {};           ///< Of cells in it.
  Coordinates a = {};       ///< Of a ball its center, of a box a corner, of a segment an end.
  Coordinates b = {};       ///< The other corner or end.
  double radius = 0;        ///< Of a ball; 0: a point.
  std::string place = {};   ///< What messages call it; empty: by its number.

  /// A point, with radius 0, or a ball.
  static SizedShape ball(Size size, const Coordinates& center, double radius = 0) {
    return {Kind::kBall, size, center, center, radius, {}};
  }
  /// Given by two opposite corners.
  static SizedShape box(Size size, const Coordinates& a, const Coordinates& b) {
    return {Kind::kBox, size, a, b, 0, {}};
  }
  /// Between two points.
  static SizedShape segment(Size size, const Coordinates& a, const Coordinates& b) {
    return {Kind::kSegment, size, a, b, 0, {}};
  }
};

/// How large cells are on a sheet of the surface, or in a body: see Options.
struct SizedPart {
  /// Of the sheet, or of the surface's group that it is of; of the body. Of a sheet also its id,
  /// "#7", or a place that it is the closest to, "near 1,2,3".
  std::string name = {};
  Size size = {};          ///< Of cells on it, or in it.
  std::string place = {};  ///< What messages call it; empty: by its name.
};

/// What the mesh depends on, besides the surface; and where its run is kept.
struct Options {
  Size size = {};  ///< Must be given; SurfaceInfo::default_size is one.
  /// Directory of the run's store, made if it is not there, and kept. Empty: a directory of its own
  /// in `scratch`, which goes with the Mesh.
  std::filesystem::path store = {};
  /// Where a store without a name is made. Empty: the system's directory for temporary files, which
  /// may lie in memory.
  std::filesystem::path scratch = {};
  bool is_forced = false;           ///< Start anew over the store of another run.
  std::uint64_t leaf_capacity = 0;  ///< κ: a leaf with more points is split. 0: the default.
  std::uint64_t seed = 0;           ///< Of the sample of the surface.
  /// Cells get no dihedral angle below this, in degrees, 0 (any) to 40; absent: 15. Up to 20 is
  /// kept nearly everywhere; a cell that nothing improves stays, and is told by
  /// Statistics::num_poor_cells.
  std::optional<double> min_dihedral = {};
  double spacing_floor = 0.02;  ///< No point comes closer than this to another; over λ.
  /// Cells grow from the surface inwards: the bound on circumradii is λ at the surface, and larger
  /// by this much of the distance from it, 0 (one size everywhere) to 0.3.
  double growth = 0;
  Size max_size = {};  ///< What that bound does not grow beyond. Of value 0: none.
  /// With any, a growth of 0 stands for 0.2, with `size` as what the bound does not grow beyond.
  std::vector<SizedShape> shapes = {};
  /// Likewise: the bound is the size on the sheet, and larger by `growth` of the distance from it.
  /// A name that no sheet of the surface has is an error.
  std::vector<SizedPart> sheets = {};
  /// Likewise: the size, below `size`, is the body's λ. The bound is the size where the body ends,
  /// and larger outside by `growth` of the distance from it. Inside it is the size everywhere, or,
  /// if `growth` is above 0 and `max_size` none or above `size`, grows inwards as elsewhere. A name
  /// that no body has is an error.
  std::vector<SizedPart> bodies = {};
  /// Likewise, a VTK image (.vti) of sizes. Empty: none.
  std::filesystem::path size_image = {};
  // Likewise with one of the next three, each 0 or of value 0 for none.
  double per_circle = 0;  ///< So many edges around a circle where the surface is curved: 3 to 1000.
  Size deviation = {};  ///< How far the boundary may be from the surface, and the surface from it.
  double layers = 0;    ///< So many cells across parts that are thin: 1 to 20.
  Size min_size = {};   ///< What these three do not go below. Of value 0: 0.02 of `size`.
  /// Points of the surface that lie closer to each other than this become one; of value 0: none.
  /// Absent: those that close a surface which is not closed otherwise, up to a millionth of its
  /// width away; Control::on_note tells of them.
  std::optional<Size> weld = {};
  /// Edges where the surface turns by more degrees than this are edges of the mesh, and part its
  /// faces; 0: none are, and faces end only where names do that the surface gives them.
  double sharp_angle = 40;
  /// A file of polylines along edges of the surface, which are sharp whatever their angle. Each
  /// line of it is a polyline: how many points it has, and their coordinates. Empty: none.
  std::filesystem::path sharp_polylines = {};
  /// Of a surface whose groups have names, each group that is closed by itself is a body; without
  /// names, each shell is one. A body that lies in another is cut out of it, and the cells of the
  /// two share the vertices between them. Not set: all that the surface bounds is one body.
  bool has_bodies = false;
  /// Names of bodies that are none: cavities of those that they lie in.
  std::vector<std::string> voids = {};
  /// Of several bodies, what is nearer than this to another one is made to touch it, whether there
  /// is a gap between them or they overlap so little. Of value 0: only what rounding alone parts.
  Size gap = {};
  /// The mesh is the boundary alone: triangles, and no cells. All points lie on the surface.
  bool is_surface_only = false;
  /// What is taken for the inside: InsideRule::kClosed, kWinding or kWrap. By winding numbers,
  /// triangles of any kind can be meshed: holes close, what overlaps is united, and doubled and
  /// inner walls vanish; of several bodies each is what its own triangles wind around. Sheets,
  /// which enclose nothing, can be wrapped: a new surface goes around all triangles.
  InsideRule inside = {};
  /// Of what is wrapped: what a ball of this radius does not go through is bridged. A length; of
  /// value 0: a 50th of the longest side of the bounding box.
  Size wrap_alpha = {};
  /// How far the new surface is from the triangles. A length; of value 0: a 30th of `wrap_alpha`.
  Size wrap_offset = {};
  /// Initialization::kCover, or kPaper: one size everywhere, one body, and any dihedral angle
  /// unless one is asked for.
  Initialization init = {};
};

}  // namespace locvol
