// How far apart parts of a surface are that face each other: lines go out from places of it, up to
// where they meet the surface next, on either side.
//
//   ProbePicker: the places, while the surface is read, in any order
//   WallProbes:  their lines, and what these meet, cell by cell
//   LineSights:  what lines have met, put together in any order
//
// All are functions of the set of triangles, whatever cells and processes they are shared out to.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "octree/geometry.h"
#include "refine/domain/triangle_tree.h"
#include "storage/records.h"

namespace locvol {

// A place of the surface, from which lines go out.
struct WallProbe {
  // A triangle's places come at equal steps of this, of which the area has one: those that come
  // first, of all triangles, are spread evenly over the surface.
  double order = 0;
  Point place, direction;        // across the triangle; of length 1
  std::array<Point, 3> corners;  // of the triangle
  friend auto operator<=>(const WallProbe&, const WallProbe&) = default;
};

class ProbePicker {
 public:
  static constexpr std::size_t kNumProbes = 1024;

  void add(const Triangle& triangle);
  void add(const WallProbe& probe);
  // The probes in order; of a surface with fewer places that can be told apart, fewer.
  std::vector<WallProbe> take();

 private:
  bool may_take(double order) const {
    return probes_.size() < kNumProbes || order <= probes_.front().order;
  }

  std::vector<WallProbe> probes_;  // a heap, the last in order first
};

// A place where a line meets a triangle.
struct LineHit {
  std::uint32_t line = 0;
  double distance = 0;  // below 0: behind the probe's place
  double cosine = 0;    // of the angle between the line and the triangle's normal, from 0 to 1
};

// The lines of probes: each has one straight across its triangle, and kNumOblique that lean, to
// different sides.
class WallProbes {
 public:
  static constexpr std::size_t kNumOblique = 2, kNumLines = 1 + kNumOblique;
  static constexpr double kLean = 3;  // the tangent of their angle

  WallProbes() = default;
  // Makes the lines of probes of a surface in `box`. Memory: 600 bytes a probe.
  WallProbes(std::span<const WallProbe> probes, const Box& box);

  std::size_t num_lines() const { return lines_.size(); }  // those of a probe one after another

  // The places where lines meet triangles in the half-open cell, but not those of their own probes.
  // Of lines that lean, and behind places, the nearest alone are needed, and others may be left
  // out. `tree`: of all triangles that meet the cell
  std::vector<LineHit> hits_in(const Box& cell, const TriangleTree& tree,
                               std::span<const Point> vertices,
                               std::span<const std::array<std::uint32_t, 3>> triangles) const;

 private:
  // A line, with two directions across its own.
  struct Line {
    Point place, direction, across, beside;
    std::array<Point, 3> corners;
    TriangleTree::Stretch all;
  };

  void add_line(const WallProbe& probe, const Point& direction);
  std::optional<LineHit> hit(std::uint32_t line, const std::array<Point, 3>& corners) const;

  double rounding_ = 0;  // more than is lost of a distance; so close may be the probe's triangle
  std::vector<Line> lines_;
};

// What a line has met, in any order.
class LineSight {
 public:
  // The nearest, on one side of the place.
  struct Nearest {
    double distance = std::numeric_limits<double>::infinity(), cosine = 0;
  };

  void add(const LineHit& hit);
  void add(const LineSight& other);
  const Nearest& nearest(bool is_ahead) const { return is_ahead ? ahead_ : behind_; }
  // Tells of a line straight across whether the inside is ahead.
  bool is_inside_ahead() const { return is_odd_ahead_; }

  // All members, for those who send a sight.
  template <class Self>
  static auto members(Self& sight) {
    return std::tie(sight.ahead_.distance, sight.ahead_.cosine, sight.behind_.distance,
                    sight.behind_.cosine, sight.is_odd_ahead_);
  }

 private:
  static void keep_nearer(Nearest& nearest, const Nearest& other) {
    if (other.distance < nearest.distance) nearest = other;
  }

  Nearest ahead_, behind_;
  bool is_odd_ahead_ = false;  // so many have been met
};

using LineSights = std::vector<LineSight>;
// REQUIRES: of the same lines, if there are any
void add(LineSights& all, const LineSights& others);

// What probes say of the surface, by all of their lines.
FacingFacts facing_facts(const LineSights& sights);

}  // namespace locvol
