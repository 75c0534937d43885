// The size of cells as a function of the place (refine/ALGORITHM.md, "Sizes that vary"): λ
// everywhere, or h(x) as the sizes of a run's leaves have it.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/lattice.h"
#include "octree/morton_key.h"

namespace locvol {

// What h is made of: inside, at most `surface` + `growth` times the distance to the surface;
// outside, `surface`; less at shapes, and near them.
struct SizeLaw {
  double surface = 0;  // λ: the largest size at the surface
  double growth = 0;   // g: h changes by at most g times the way; 0: λ everywhere
  double most = std::numeric_limits<double>::infinity();
  double least = surface;  // of any shape

  bool is_uniform() const { return growth == 0; }
  // Tells whether there is a lattice whose points need not be listed, where sizes vary. It is that
  // of `most`.
  bool has_core() const { return !is_uniform() && most < std::numeric_limits<double>::infinity(); }
  bool has_shapes() const { return least < surface; }
  // h where the surface is so far away, and shapes make it smaller by `less` than that alone would.
  double at_distance(double distance, double less = 0) const {
    const double size = surface - less + growth * std::max(distance, 0.0);
    return size > most ? most : size < least ? least : size;
  }
  friend bool operator==(const SizeLaw&, const SizeLaw&) = default;
};

// A cube of the octree of sizes, which is as large as the lattice's cells in it may be.
struct SizeCube {
  MortonKey key;
  // The distance of its corners from the surface (1 = upper x, 2 = y, 4 = z): negative outside.
  // Between them it is interpolated, and at the center `excess` larger than it is.
  std::array<float, 8> distance{};
  float excess = 0;
  // By how much h is smaller at its corners than the surface alone would make it; it is
  // interpolated, too.
  std::array<float, 8> less{};
  friend bool operator==(const SizeCube&, const SizeCube&) = default;
};

// The cubes around a leaf: a value, which can be stored and sent.
struct SizeCubes {
  SizeLaw law;
  Frame frame;
  std::vector<SizeCube> cubes;  // none in another, in Morton order; none: λ everywhere
  friend bool operator==(const SizeCubes&, const SizeCubes&) = default;
};

// Tells whether the cube lies outside, so that no surface passes through. No place in it is farther
// from all of its corners than half of its diagonal.
bool is_outside(const SizeCube& cube, double side);

// What is at a cube's corners, at a point of its box.
double interpolated(const std::array<float, 8>& corners, const Box& box, const Point& p);
// h at a point of the cube's box.
double size_in(const SizeLaw& law, const SizeCube& cube, const Box& box, const Point& p);
// No less than h anywhere in the cube.
double largest_size(const SizeLaw& law, const SizeCube& cube);

// Looks up h, quickly where a place lies near the one before. What it is made of must outlive it.
class SizeCursor {
 public:
  // `cubes`: in Morton order
  SizeCursor(const SizeLaw& law, const Frame& frame, std::span<const SizeCube> cubes)
      : law_(&law), frame_(&frame), cubes_(cubes) {}
  double at(const Point& p);  // h(p); where no cube is known, λ

 private:
  const SizeLaw* law_;
  const Frame* frame_;
  std::span<const SizeCube> cubes_;
  const SizeCube* last_ = nullptr;
  Box last_box_;
};
// h(p); where no cube is known, λ. `cubes`: in Morton order
inline double size_at(const SizeLaw& law, const Frame& frame, std::span<const SizeCube> cubes,
                      const Point& p) {
  return SizeCursor(law, frame, cubes).at(p);
}
// No more, and no less, than h in any of the cubes; in any that the surface may pass through.
// Without such, of the last: λ, or the second where that is less.
struct SizeRange {
  double least = 0, most = 0, on_surface = 0;
};
SizeRange size_range(const SizeLaw& law, const Frame& frame, std::span<const SizeCube> cubes);
// λ, or at shapes what is there in its place: the largest at the cube's corners.
double base_size(const SizeLaw& law, const SizeCube& cube);
// Tells whether h is as large as it gets in all of the cube, and within `distance` of it.
bool is_saturated(const SizeLaw& law, const SizeCube& cube, double distance = 0);
// How much larger than its bound h would be at the border of the lattice, and of the core, over
// growth · most. Where h grows no more there is the lattice of that size, and farther in its core
// (SizeLaw::has_core). Balls of the lattice's cells have their centers where h is as large; around
// a point of the core there is nothing but the lattice.
inline constexpr double kLatticeMargin = 1, kCoreMargin = kLatticeMargin + 3;
// Has all of the cube the lattice? Is all of it of the core?
bool is_of_lattice(const SizeLaw& law, const SizeCube& cube);
bool is_of_core(const SizeLaw& law, const SizeCube& cube);
// Integrals of 1 / h³ over the domain, over what of it has the lattice, and of that over the core;
// of 1 / h² over the surface.
struct SizeTotals {
  double of_volume = 0, of_area = 0, of_lattice = 0, of_core = 0;
  bool are_known() const { return of_volume > 0; }
  SizeTotals& operator+=(const SizeTotals& other) {
    of_volume += other.of_volume, of_area += other.of_area;
    of_lattice += other.of_lattice, of_core += other.of_core;
    return *this;
  }
  friend bool operator==(const SizeTotals&, const SizeTotals&) = default;
};
// The totals of what is in the cube, about.
SizeTotals size_totals(const SizeLaw& law, const SizeCube& cube, const Box& box);

// How far balls through a point reach from it, over h there, if their radii are at most k / 2 times
// h at their centers.
inline double reach_factor(double growth, double k) { return k / (1 - 0.5 * growth * k); }

// Calls visit(site) for its center and its corners: points of the lattice of cubes, but for cubes
// that are all outside.
template <class Visit>
void for_each_lattice_point(const SizeCube& cube, Visit visit) {
  const auto is_outside = [](float d) { return d < 0; };
  if (std::ranges::all_of(cube.distance, is_outside)) return;
  const GridPoint low = cube.key.grid_min();
  const auto site = [&](std::uint32_t i, std::uint32_t j, std::uint32_t k) {  // in half sides
    const std::uint32_t half = cube.key.grid_side() / 2;
    return LatticeSite{static_cast<std::int32_t>((low.x + i * half) / 2),
                       static_cast<std::int32_t>((low.y + j * half) / 2),
                       static_cast<std::int32_t>((low.z + k * half) / 2)};
  };
  visit(site(1, 1, 1));
  for (std::uint32_t n = 0; n < 8; ++n) visit(site(2 * (n & 1), 2 * (n >> 1 & 1), 2 * (n >> 2)));
}

// Looks up h, often: see size_at().
class SizeField {
 public:
  explicit SizeField(double size) : law_{.surface = size}, range_{size, size, size} {}
  explicit SizeField(const SizeCubes& sizes);

  bool is_uniform() const { return law_.is_uniform(); }
  bool has_shapes() const { return law_.has_shapes(); }
  double growth() const { return law_.growth; }

  // Is h known there?
  bool has(const Point& p) const { return is_uniform() || cube_at(p) != nullptr; }
  // h(p). Where no cube is known: λ.
  double at(const Point& p) const { return is_uniform() ? on_surface() : graded_at(p); }
  // The least depth at which p lies inside; less than 0: it is not known. Distances at a cube's
  // corners have a sign and change by no more than the way. From the mean of them that h is made
  // of, a corner is as far as √3/2 of the side at most.
  double least_depth(const Point& p) const;
  // How much larger than its bound h would be, if it grew on; less than 0 where it is smaller.
  // REQUIRES: law().has_core(), and the cube at p is known
  double room(const Point& p) const;
  // λ.
  double on_surface() const { return law_.surface; }
  // h(p) of a point of the surface; of others, λ where that is less.
  double on_surface_at(const Point& p) const {
    return law_.has_shapes() ? std::min(law_.surface, at(p)) : law_.surface;
  }
  // No less than h anywhere; no more.
  double largest() const { return range_.most; }
  double least() const { return range_.least; }
  // Tells whether a ball's radius is below k times h at its center. Most often least() tells.
  bool is_below(double squared_radius, double k, const Point& center) const {
    const auto is_below = [&](double bound) { return squared_radius < bound * bound; };
    return is_below(k * least()) || (!is_uniform() && is_below(k * graded_at(center)));
  }
  // How far a ball through p reaches from it if its radius is at most k / 2 times h at its center.
  // REQUIRES: growth · k < 2
  double reach_of_balls(const Point& p, double k) const {
    return is_uniform() ? k * on_surface() : reach_factor(growth(), k) * graded_at(p);
  }

 private:
  // A SizeCube, ready for use.
  struct Cube {
    Point low;
    double inverse_side = 0;
    std::array<float, 8> distance{}, less{};
    float excess = 0;
    bool is_less = false;                 // somewhere
    using Place = std::array<double, 3>;  // over the side, from the lowest corner
    Place place(const Point& p) const;
    double depth(const Place& at) const;
  };
  double graded_at(const Point& p) const;
  const Cube* cube_at(const Point& p) const;  // null: none is known there

  SizeLaw law_;
  Box root_;
  double inverse_unit_ = 0;
  std::vector<std::uint64_t> first_, last_;  // of each cube's range of keys
  std::vector<Cube> cubes_;
  // The cubes to look at in each node of one level around: the first that meets it, and the end.
  struct Range {
    std::uint32_t first = 0, end = 0;
  };
  void make_grid(std::span<const SizeCube> cubes, std::span<const GridPoint> lows);
  std::vector<Range> grid_;
  std::array<std::uint32_t, 3> grid_origin_{}, grid_shape_{};
  int grid_shift_ = 0;  // of positions on the octree's grid, to get at the grid's nodes
  SizeRange range_;
};

}  // namespace locvol
