#include "engine/output/quadratic_cell.h"

#include <algorithm>
#include <bit>
#include <vector>

namespace locvol {
namespace {

// The place of the edge between two corners.
constexpr std::array<std::array<std::uint8_t, 4>, 4> kEdgeBetween = [] {
  std::array<std::array<std::uint8_t, 4>, 4> between{};
  for (std::uint8_t e = 0; e < kCellEdges.size(); ++e) {
    const auto& [i, j] = kCellEdges[e];
    between[i][j] = between[j][i] = e;
  }
  return between;
}();

// Of a monomial of third degree in the four barycentric coordinates: its place among the 20, and in
// how many orders its factors come.
struct Monomials {
  std::array<std::array<std::array<std::uint8_t, 4>, 4>, 4> place{};
  std::array<double, 20> num_orders{};
};
constexpr Monomials kMonomials = [] {
  Monomials all;
  std::uint8_t next = 0;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i; j < 4; ++j)
      for (std::size_t k = j; k < 4; ++k) {
        for (const auto& [a, b, c] : std::array<std::array<std::size_t, 3>, 6>{
                 {{i, j, k}, {i, k, j}, {j, i, k}, {j, k, i}, {k, i, j}, {k, j, i}}})
          all.place[a][b][c] = next;
        all.num_orders[next++] = i == k ? 1 : i == j || j == k ? 3 : 6;
      }
  return all;
}();

// Is the bound kept, whatever nodes are back in the middle? Told by lengths alone: with the shifts
// in coordinates of the straight cell, the derivative is 1 + M, and no column of M is longer than
// ρ, so that its determinant differs from 1 by at most 3ρ + 3ρ² + ρ³.
bool is_nearly_straight(const std::array<Point, 4>& corners, const NodeShifts& shifts) {
  constexpr double kMostColumn = 0.2;
  static_assert(3 * kMostColumn + 3 * kMostColumn * kMostColumn +
                    kMostColumn * kMostColumn * kMostColumn <
                1 - kLeastJacobian);
  const std::array<Point, 3> columns = {corners[1] - corners[0], corners[2] - corners[0],
                                        corners[3] - corners[0]};
  const std::array<Point, 3> rows = {cross(columns[1], columns[2]), cross(columns[2], columns[0]),
                                     cross(columns[0], columns[1])};
  const double det = dot(columns[0], rows[0]);
  std::array<double, 6> lengths{};
  for (std::size_t e = 0; e < 6; ++e)
    lengths[e] =
        4 / det *
        norm(Point{dot(rows[0], shifts[e]), dot(rows[1], shifts[e]), dot(rows[2], shifts[e])});
  // Column k at corner i: the shifts of the edges from i to k and to 0.
  const auto length = [&](std::size_t i, std::size_t k) {
    return i == k ? 0 : lengths[kEdgeBetween[i][k]];
  };
  for (std::size_t k = 1; k < 4; ++k)
    for (std::size_t i = 0; i < 4; ++i)
      if (!(length(i, k) + length(i, 0) <= kMostColumn)) return false;
  return true;
}

}  // namespace

// In Bézier form, the map is x = Σ b_ij λ_i λ_j with b_ii a corner and b_ij = the edge's middle + 2
// shifts. Its derivative by λ_k, with λ_0 = 1 - λ_1 - λ_2 - λ_3, is 2 Σ λ_i (b_ik - b_i0). So the
// determinant is 8 Σ λ_i λ_j λ_l det(d_i1, d_j2, d_l3), with d_ik = b_ik - b_i0.
double least_jacobian(const std::array<Point, 4>& corners, const NodeShifts& shifts) {
  const auto control = [&](std::size_t i, std::size_t j) {
    if (i == j) return corners[i];
    return middle(corners[i], corners[j]) + 2 * shifts[kEdgeBetween[i][j]];
  };
  std::array<std::array<Point, 3>, 4> d;
  for (std::size_t i = 0; i < 4; ++i) {
    const Point origin = control(i, 0);
    for (std::size_t k = 1; k < 4; ++k) d[i][k - 1] = control(i, k) - origin;
  }
  std::array<double, 20> coefficients{};
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j) {
      const Point normal = cross(d[i][0], d[j][1]);
      for (std::size_t l = 0; l < 4; ++l)
        coefficients[kMonomials.place[i][j][l]] += dot(normal, d[l][2]);
    }
  const double straight =
      dot(cross(corners[1] - corners[0], corners[2] - corners[0]), corners[3] - corners[0]);
  double least = coefficients[0];
  for (std::size_t m = 0; m < coefficients.size(); ++m)
    least = std::min(least, coefficients[m] / kMonomials.num_orders[m]);
  return 8 * least / straight;
}

std::uint8_t allowed_nodes(const std::array<Point, 4>& corners, const NodeShifts& shifts) {
  std::vector<std::size_t> off;
  for (std::size_t e = 0; e < shifts.size(); ++e)
    if (shifts[e] != Point{}) off.push_back(e);
  const auto nodes_of = [&](unsigned subset) {
    std::uint8_t nodes = 0;
    for (std::size_t n = 0; n < off.size(); ++n)
      if (subset >> n & 1) nodes |= static_cast<std::uint8_t>(1U << off[n]);
    return nodes;
  };
  const unsigned all = (1U << off.size()) - 1;
  if (is_nearly_straight(corners, shifts)) return nodes_of(all);
  // A set will do if it does itself, and all that lack one of its nodes do.
  std::vector<bool> will_do(all + 1);
  will_do[0] = true;
  unsigned best = 0;
  for (unsigned subset = 1; subset <= all; ++subset) {
    bool do_smaller = true;
    for (std::size_t n = 0; n < off.size(); ++n)
      if (subset >> n & 1) do_smaller = do_smaller && will_do[subset & ~(1U << n)];
    if (!do_smaller) continue;
    NodeShifts some{};
    for (std::size_t n = 0; n < off.size(); ++n)
      if (subset >> n & 1) some[off[n]] = shifts[off[n]];
    will_do[subset] = least_jacobian(corners, some) >= kLeastJacobian;
    if (will_do[subset] && std::popcount(subset) > std::popcount(best)) best = subset;
  }
  return nodes_of(best);
}

}  // namespace locvol
