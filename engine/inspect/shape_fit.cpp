#include "engine/inspect/shape_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "engine/inspect/shape_algebra.h"

namespace locvol {
namespace {

constexpr std::size_t kPointsPerUnknown = 2;
// Of how far the points lie apart: a small part of anything comes close to a torus. What is almost
// a cylinder is neither.
constexpr double kFineness = 1e-4, kLeastSlope = 1e-3, kMostRadius = 500;

template <std::size_t n>
using Unknowns = std::array<double, n>;

// From `x` on, steps of Levenberg and Marquardt. off(x, p): how far p is from the shape, or a
// function that is 0 there.
template <std::size_t n, class Off>
void fit(std::span<const Point> points, Unknowns<n>& x, const Unknowns<n>& scales, const Off& off) {
  constexpr int kMostSteps = 50;
  constexpr double kDifference = 1e-6, kEnough = 1e-14;
  const auto sum_of_squares = [&](const Unknowns<n>& at) {
    double sum = 0;
    for (const Point& p : points) sum += off(at, p) * off(at, p);
    return sum;
  };
  double sum = sum_of_squares(x), damping = 1e-3;
  for (int step = 0; step < kMostSteps && damping < 1e12; ++step) {
    std::array<std::array<double, n + 1>, n> rows{};
    for (const Point& p : points) {
      Unknowns<n> slope{};
      for (std::size_t k = 0; k < n; ++k) {
        Unknowns<n> more = x, less = x;
        more[k] += kDifference * scales[k];
        less[k] -= kDifference * scales[k];
        slope[k] = (off(more, p) - off(less, p)) / (2 * kDifference);  // over the scale
      }
      const double here = off(x, p);
      for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < n; ++j) rows[i][j] += slope[i] * slope[j];
        rows[i][n] -= slope[i] * here;
      }
    }
    bool is_better = false;
    while (!is_better && damping < 1e12) {
      auto damped = rows;
      for (std::size_t k = 0; k < n; ++k) damped[k][k] += damping * (rows[k][k] + 1e-12);
      const auto change = solved<n>(damped);
      Unknowns<n> next = x;
      if (change)
        for (std::size_t k = 0; k < n; ++k) next[k] += (*change)[k] * scales[k];
      const double of_next = change ? sum_of_squares(next) : sum;
      is_better = of_next < sum;
      damping *= is_better ? 0.1 : 10;
      if (!is_better) continue;
      const bool is_enough = sum - of_next < kEnough * sum;
      x = next;
      sum = of_next;
      if (is_enough) damping = 1e12;
    }
  }
}

template <std::size_t n, class Off>
double farthest_of(std::span<const Point> points, const Unknowns<n>& x, const Off& off) {
  double farthest = 0;
  for (const Point& p : points) farthest = std::max(farthest, std::abs(off(x, p)));
  return farthest;
}

// The middle of some points, and how far they lie from it at most.
struct Spread {
  Point middle;
  double radius = 0;
};
Spread spread_of(std::span<const Point> points) {
  Spread spread;
  for (const Point& p : points) spread.middle = spread.middle + p;
  spread.middle = (1 / static_cast<double>(points.size())) * spread.middle;
  for (const Point& p : points) spread.radius = std::max(spread.radius, norm(p - spread.middle));
  return spread;
}

// Of a point: along an axis through a place, and across it.
struct AlongAndAcross {
  double along, across;
};
AlongAndAcross seen(const Point& p, const Point& place, const Point& axis) {
  const double along = dot(p - place, axis);
  return {along, norm(p - place - along * axis)};
}

Point tilted(const Point& axis, const Point& u, const Point& v, double by_u, double by_v) {
  return normalized(axis + by_u * u + by_v * v);
}

// The center of the circle that is closest to points, seen along the axis; at `height` on it.
std::optional<std::pair<Point, double>> circle_around(std::span<const Point> points,
                                                      const Spread& spread, const Point& axis) {
  const auto [u, v] = axes_across(axis);
  std::array<std::array<double, 4>, 3> rows{};
  for (const Point& p : points) {
    const std::array<double, 3> terms = {dot(p - spread.middle, u), dot(p - spread.middle, v), 1};
    const double square = terms[0] * terms[0] + terms[1] * terms[1];
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) rows[i][j] += terms[i] * terms[j];
      rows[i][3] -= terms[i] * square;
    }
  }
  const auto circle = solved<3>(rows);
  if (!circle) return std::nullopt;
  const auto& [d, e, f] = *circle;
  const double squared = 0.25 * (d * d + e * e) - f;
  if (!(squared > 0)) return std::nullopt;
  return std::pair{spread.middle - 0.5 * d * u - 0.5 * e * v, std::sqrt(squared)};
}

}  // namespace

// Unknown are where the axis passes the middle, how it is tilted, the radius there and its slope.
std::optional<FittedCone> fitted_cone(std::span<const Point> points, std::span<const Point> axes,
                                      double tolerance) {
  constexpr std::size_t n = 6;
  if (points.size() < kPointsPerUnknown * n) return std::nullopt;
  const Spread spread = spread_of(points);
  tolerance = std::min(tolerance, kFineness * spread.radius);
  for (const Point& start : axes) {
    const auto [u, v] = axes_across(start);
    const auto circle = circle_around(points, spread, start);
    if (!circle) continue;
    const auto place = [&](const Unknowns<n>& x) { return circle->first + x[0] * u + x[1] * v; };
    const auto axis = [&](const Unknowns<n>& x) { return tilted(start, u, v, x[2], x[3]); };
    const auto off = [&](const Unknowns<n>& x, const Point& p) {
      const auto [along, across] = seen(p, place(x), axis(x));
      return (across - x[4] - x[5] * along) / std::sqrt(1 + x[5] * x[5]);
    };
    // To begin with, for it is smooth at the tip.
    const auto off_square = [&](const Unknowns<n>& x, const Point& p) {
      const auto [along, across] = seen(p, place(x), axis(x));
      const double radius = x[4] + x[5] * along;
      return (across * across - radius * radius) / (2 * spread.radius);
    };
    // How the radius grows along it, at first.
    double mean = 0, squares = 0, products = 0;
    for (const Point& p : points) mean += seen(p, circle->first, start).along;
    mean /= static_cast<double>(points.size());
    for (const Point& p : points) {
      const auto [along, across] = seen(p, circle->first, start);
      squares += (along - mean) * (along - mean);
      products += (along - mean) * (across - circle->second);
    }
    const double slope = squares > 0 ? products / squares : 0;
    Unknowns<n> x = {0, 0, 0, 0, circle->second - slope * mean, slope};
    const Unknowns<n> scales = {spread.radius, spread.radius, 1, 1, spread.radius, 1};
    fit<n>(points, x, scales, off_square);
    fit<n>(points, x, scales, off);
    const double farthest = farthest_of<n>(points, x, off);
    if (!(farthest <= tolerance) || !(std::abs(x[5]) > kLeastSlope)) continue;
    const Point along = axis(x);
    return FittedCone{place(x) - x[4] / x[5] * along, x[5] > 0 ? along : -1.0 * along,
                      std::atan(std::abs(x[5]))};
  }
  return std::nullopt;
}

// Unknown are the center, how the axis is tilted, and both radii.
std::optional<FittedTorus> fitted_torus(std::span<const Point> points, std::span<const Point> axes,
                                        double tolerance) {
  constexpr std::size_t n = 7;
  if (points.size() < kPointsPerUnknown * n) return std::nullopt;
  const Spread spread = spread_of(points);
  tolerance = std::min(tolerance, kFineness * spread.radius);
  for (const Point& start : axes) {
    const auto [u, v] = axes_across(start);
    const auto circle = circle_around(points, spread, start);
    if (!circle) continue;
    const auto off = [&](const Unknowns<n>& x, const Point& p) {
      const Point center = circle->first + x[0] * u + x[1] * v + x[2] * start;
      const auto [along, across] = seen(p, center, tilted(start, u, v, x[3], x[4]));
      return std::hypot(across - x[5], along) - x[6];
    };
    double mean = 0, most = 0;
    for (const Point& p : points) mean += seen(p, circle->first, start).along;
    mean /= static_cast<double>(points.size());
    for (const Point& p : points) {
      const auto [along, across] = seen(p, circle->first, start);
      most = std::max(most, std::hypot(along - mean, across - circle->second));
    }
    for (const double tube : {most, 0.3 * most, 3 * most}) {
      Unknowns<n> x = {0, 0, mean, 0, 0, circle->second, tube};
      const double r = spread.radius;
      fit<n>(points, x, {r, r, r, 1, 1, r, r}, off);
      const double farthest = farthest_of<n>(points, x, off);
      if (!(farthest <= tolerance) || !(x[5] > 0) || !(x[6] > 0) || x[5] > kMostRadius * r)
        continue;
      return FittedTorus{circle->first + x[0] * u + x[1] * v + x[2] * start,
                         tilted(start, u, v, x[3], x[4]), x[5], x[6]};
    }
  }
  return std::nullopt;
}

}  // namespace locvol
