// Fragments: pieces of triangles of the surface, which halve until something is known of each.
// Internal to refine/.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "octree/geometry.h"
#include "octree/stop.h"
#include "refine/domain/leaf_domain.h"

namespace locvol {

// A triangular piece of an input triangle; it may have no area.
// `key` is a hash of (seed, triangle, path of splits): its priority and its source of randomness.
struct Fragment {
  std::array<Point, 3> corners;
  std::uint64_t key = 0;
  SheetId sheet = kOnlySheet;

  Box box() const { return Box::around(corners[0]).joined(corners[1]).joined(corners[2]); }
};

// Corner i, such that the edge from it to the next corner is a longest one; and its squared length.
inline std::pair<std::size_t, double> longest_edge(const Fragment& f) {
  std::pair<std::size_t, double> longest{0, squared_distance(f.corners[0], f.corners[1])};
  for (const std::size_t i : {1, 2}) {
    const double length2 = squared_distance(f.corners[i], f.corners[(i + 1) % 3]);
    if (length2 > longest.second) longest = {i, length2};
  }
  return longest;
}

// Halves across an edge; the longest one, for a needle then falls apart along its length only.
std::array<Fragment, 2> halves(const Fragment& f, std::size_t edge);

Point clamped(const Point& p, const Box& box);
// The closed box that holds the same points as a half-open one.
Box closed(const Box& box);

// Of all the surface in a half-open box. Pieces on a face of it stay, though they may belong to the
// next leaf as well: after rounding nobody can tell. Throws Stopped.
std::vector<Fragment> fragments_in(const Box& box, const LeafDomain& domain, std::uint64_t seed,
                                   const StopToken* stop);

// The piece of a triangle in a closed box: a convex polygon, or nothing.
std::vector<Point> clipped(const Triangle& triangle, const Box& box);

// Tells whether all of the fragment is closer to q than to p. It lies on q's side of the plane
// between the two if its corners do.
inline bool is_nearer(const Fragment& f, const Point& q, const Point& p) {
  return std::ranges::all_of(
      f.corners, [&](const Point& c) { return squared_distance(c, q) < squared_distance(c, p); });
}

// Tells whether is_known(piece) holds for pieces that cover the fragment and are no shorter than
// `length`.
template <class IsKnown>
bool is_made_of(const Fragment& f, double length, const IsKnown& is_known) {
  if (is_known(f)) return true;
  const auto [edge, squared_length] = longest_edge(f);
  if (squared_length < length * length) return false;
  const std::array<Fragment, 2> both = halves(f, edge);
  return is_made_of(both[0], length, is_known) && is_made_of(both[1], length, is_known);
}

// Tells whether is_known(piece) holds for pieces that cover the surface within `radius` of p.
template <class IsKnown>
bool is_known_around(const LeafDomain& domain, const Point& p, double radius,
                     const IsKnown& is_known) {
  constexpr double kLeastLength = 0.09;  // over the radius
  std::vector<Triangle> near;
  domain.triangles_near(p, radius, near);
  return std::ranges::all_of(near, [&](const Triangle& triangle) {
    return is_made_of({triangle.corners}, kLeastLength * radius, is_known);
  });
}

// Do samples hide p: is each point of the surface closer to one of them? May say no where it is so
// by little. All of the surface has a sample within `radius`; is_nearer(fragment): is one sample
// closer to all of it than p? It may overlook samples for fragments that are not near p.
template <class IsNearer>
bool is_hidden_from(const LeafDomain& domain, const Point& p, double radius,
                    const IsNearer& is_nearer) {
  return is_known_around(domain, p, radius, [&](const Fragment& f) {
    return f.box().squared_distance(p) >= radius * radius || is_nearer(f);
  });
}

// Within which samples cover the surface, at least and at most, around a place.
struct CoverRadius {
  double least = 0, most = 0;
};
// Samples cover the surface, and hide some points from it. Do they still, if the one at `before` is
// gone? `samples`: others within twice the largest radius of it; `hidden`: of the hidden points,
// all that are as close to it and may be closer to the surface than that radius. May say no where
// it is so by little.
inline bool is_covered_without(const LeafDomain& domain, const Point& before,
                               const CoverRadius& radius, std::span<const Point> samples,
                               std::span<const Point> hidden) {
  const double radius2 = radius.most * radius.most, covered2 = radius.least * radius.least;
  std::size_t last = 0;  // what served for one fragment nearly always serves for the next
  const auto is_one = [&](const auto& serves) {
    if (last < samples.size() && serves(samples[last])) return true;
    const auto found = std::ranges::find_if(samples, serves);
    if (found != samples.end()) last = static_cast<std::size_t>(found - samples.begin());
    return found != samples.end();
  };
  return is_known_around(domain, before, radius.most, [&](const Fragment& f) {
    const Box box = f.box();
    if (box.squared_distance(before) > radius2) return true;  // others are closer
    const auto covers = [&](const Point& sample) {
      return std::ranges::all_of(
          f.corners, [&](const Point& c) { return squared_distance(c, sample) <= covered2; });
    };
    const auto is_hidden = [&](const Point& p) {
      return box.squared_distance(p) >= radius2 ||
             is_one([&](const Point& s) { return is_nearer(f, s, p); });
    };
    return is_one(covers) && std::ranges::all_of(hidden, is_hidden);
  });
}

}  // namespace locvol
