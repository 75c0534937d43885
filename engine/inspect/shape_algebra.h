// Axes of symmetric matrices, and small systems of linear equations.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "octree/geometry.h"

namespace locvol {

using Matrix3 = std::array<std::array<double, 3>, 3>;

inline Point normalized(const Point& v) {
  const double length = norm(v);
  return length > 0 ? (1 / length) * v : Point{};
}

// The eigenvectors of a symmetric matrix, by Jacobi's rotations, that of the smallest eigenvalue
// first.
inline std::array<Point, 3> axes_of(Matrix3 a) {
  Matrix3 axes = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  // columns
  for (int sweep = 0; sweep < 30; ++sweep)
    for (const auto& [p, q] : {std::pair<std::size_t, std::size_t>{0, 1}, {0, 2}, {1, 2}}) {
      if (a[p][q] == 0) continue;
      const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const double t = std::copysign(1 / (std::abs(theta) + std::hypot(theta, 1)), theta);
      const double c = 1 / std::hypot(t, 1), s = t * c;
      for (std::size_t k = 0; k < 3; ++k) {
        const double of_p = a[k][p], of_q = a[k][q];
        a[k][p] = c * of_p - s * of_q;
        a[k][q] = s * of_p + c * of_q;
      }
      for (std::size_t k = 0; k < 3; ++k) {
        const double of_p = a[p][k], of_q = a[q][k];
        a[p][k] = c * of_p - s * of_q;
        a[q][k] = s * of_p + c * of_q;
        const double axis_p = axes[k][p], axis_q = axes[k][q];
        axes[k][p] = c * axis_p - s * axis_q;
        axes[k][q] = s * axis_p + c * axis_q;
      }
    }
  std::array<std::size_t, 3> order = {0, 1, 2};
  std::ranges::stable_sort(order, {}, [&](std::size_t k) { return a[k][k]; });
  std::array<Point, 3> found;
  std::ranges::transform(order, found.begin(), [&](std::size_t k) {
    return normalized({axes[0][k], axes[1][k], axes[2][k]});
  });
  return found;
}

// Solves n linear equations, each with its right side last; nothing if they tell no one solution.
template <std::size_t n>
std::optional<std::array<double, n>> solved(std::array<std::array<double, n + 1>, n> rows) {
  constexpr double kSingular = 1e-13;
  double largest = 0;
  for (const auto& row : rows)
    for (std::size_t k = 0; k < n; ++k) largest = std::max(largest, std::abs(row[k]));
  for (std::size_t k = 0; k < n; ++k) {
    const auto pivot = std::ranges::max_element(
        rows.begin() + static_cast<std::ptrdiff_t>(k), rows.end(), {},
        [&](const std::array<double, n + 1>& row) { return std::abs(row[k]); });
    if (!(std::abs((*pivot)[k]) > kSingular * largest)) return std::nullopt;
    std::swap(rows[k], *pivot);
    for (std::size_t other = 0; other < n; ++other) {
      if (other == k) continue;
      const double factor = rows[other][k] / rows[k][k];
      for (std::size_t j = k; j <= n; ++j) rows[other][j] -= factor * rows[k][j];
    }
  }
  std::array<double, n> solution;
  for (std::size_t k = 0; k < n; ++k) solution[k] = rows[k][n] / rows[k][k];
  return solution;
}

// Two unit vectors across it.
inline std::pair<Point, Point> axes_across(const Point& axis) {
  const double x = std::abs(axis.x), y = std::abs(axis.y), z = std::abs(axis.z);
  const Point other = x <= y && x <= z ? Point{1, 0, 0} : y <= z ? Point{0, 1, 0} : Point{0, 0, 1};
  const Point u = normalized(cross(axis, other));
  return {u, cross(axis, u)};
}

}  // namespace locvol
