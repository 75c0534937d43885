// The audit of cells one by one.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>

#include "engine/audit/audit_creases.h"
#include "engine/audit/audit_leaf.h"
#include "refine/predicates.h"

namespace locvol {
namespace {

double in_degrees(double cosine) {
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * (180 / std::numbers::pi);
}

std::string with_ratio(const char* what, double value, const char* unit) {
  char text[128];
  std::snprintf(text, sizeof text, "%s (%.9g%s)", what, value, unit);
  return text;
}

std::vector<Point> positions(const LocalPoints& points) {
  std::vector<Point> result(points.size());
  for (LocalIndex i = 0; i < points.size(); ++i) result[i] = points.position(i);
  return result;
}

class CellCheck {
 public:
  CellCheck(const AuditLeaf& leaf, const AuditCreases& creases, const AuditBounds& bounds,
            AuditFindings& findings)
      : leaf_(leaf),
        creases_(creases),
        bounds_(bounds),
        findings_(findings),
        report_(findings.report()),
        grid_(positions(leaf.points), bounds.size) {}

  void run() {
    std::vector<std::array<LocalIndex, 4>> sorted_cells;
    for (std::size_t i = 0; i < leaf_.cells.cells.size(); ++i) {
      ++report_.num_cells;
      auto vertices = resolve(leaf_.cells.cells[i]);
      if (!vertices) continue;
      const double before = volume_;
      check(*vertices);
      add_to_body(leaf_.cells.body_of(i), volume_ - before, (*vertices)[0]);
      std::ranges::sort(*vertices);
      sorted_cells.push_back(*vertices);
      if (const LocalIndex smallest = smallest_of(*vertices); !leaf_.is_own(smallest))
        add(&AuditReport::num_misplaced_cells, "a cell's smallest vertex is not of this leaf",
            smallest);
    }
    check_badly_shaped();
    check_repeated(sorted_cells);
    report_.volume += volume_;
    if (min_cosine_ > max_cosine_) return;
    if (const double smallest = in_degrees(max_cosine_); smallest < report_.min_dihedral_degrees) {
      report_.min_dihedral_degrees = smallest;
      report_.worst_leaf = leaf_.key;
      report_.worst_place = worst_place_;
    }
    report_.max_dihedral_degrees = std::max(report_.max_dihedral_degrees, in_degrees(min_cosine_));
  }

  void add_to_body(BodyId body, double volume, LocalIndex place) {
    if (report_.body_volumes.empty() && body == kOnlyBody) return;
    if (body == kNoBody || body > report_.body_volumes.size())
      return add(&AuditReport::num_run_faults, "a cell is of a body that there is not", place);
    report_.body_volumes[body - 1] += volume;
  }

 private:
  using Vertices = std::array<LocalIndex, 4>;
  using Corners = std::array<Point, 4>;

  void add(std::uint64_t AuditReport::*count, std::string_view what, LocalIndex place) {
    findings_.add(count, what, leaf_.key, leaf_.points.position(place));
  }

  void add_unless_open(std::uint64_t AuditReport::*count, std::string_view what, LocalIndex place) {
    findings_.add_unless_open(count, what, leaf_.key, leaf_.points.position(place));
  }

  // Not counting those of the core, if there are others; of the core's, the one with the smallest
  // site.
  LocalIndex smallest_of(const Vertices& ascending) const {
    const auto is_listed = [&](LocalIndex i) { return !leaf_.points[i].is_core; };
    const auto listed = std::ranges::find_if(ascending, is_listed);
    if (listed != ascending.end()) return *listed;
    return std::ranges::min(ascending, {}, [&](LocalIndex i) { return leaf_.points[i].id; });
  }

  // The cell's vertices, if all are known.
  std::optional<Vertices> resolve(const std::array<std::uint32_t, 4>& cell) {
    const Vertices vertices = {leaf_.cell_vertex[cell[0]], leaf_.cell_vertex[cell[1]],
                               leaf_.cell_vertex[cell[2]], leaf_.cell_vertex[cell[3]]};
    const auto known =
        std::ranges::find_if(vertices, [](LocalIndex i) { return i != kUnknownPoint; });
    for (std::size_t i = 0; i < 4; ++i) {
      if (vertices[i] != kUnknownPoint) continue;
      findings_.add(&AuditReport::num_unknown_vertices,
                    "a cell here names point " + std::to_string(leaf_.cells.vertices[cell[i]]) +
                        ", which is in no leaf within twice the size",
                    leaf_.key, known == vertices.end() ? Point{} : leaf_.points.position(*known));
    }
    if (std::ranges::find(vertices, kUnknownPoint) != vertices.end()) return std::nullopt;
    return vertices;
  }

  void check(Vertices v) {
    const LocalPoints& p = leaf_.points;
    Corners corners = {p.position(v[0]), p.position(v[1]), p.position(v[2]), p.position(v[3])};
    const int sign = exact_orientation(corners[0], corners[1], corners[2], corners[3]);
    if (sign <= 0) {
      add(&AuditReport::num_misoriented_cells,
          sign < 0 ? "a cell is negatively oriented" : "a cell is flat", v[0]);
    }
    if (sign == 0) return;
    volume_ +=
        dot(corners[1] - corners[0], cross(corners[2] - corners[0], corners[3] - corners[0])) / 6;
    if (sign < 0) {
      std::swap(v[2], v[3]);
      std::swap(corners[2], corners[3]);
    }
    const Circumsphere ball = circumsphere_of(corners[0], corners[1], corners[2], corners[3]);
    check_sizes(v, corners, ball);
    check_empty(v, corners, ball);
    measure_dihedrals(corners, ball.center);
  }

  void check_sizes(const Vertices& v, const Corners& c, const Circumsphere& ball) {
    double shortest2 = squared_distance(c[0], c[1]);
    for (const auto& [i, j] : {std::pair{0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}) {
      shortest2 = std::min(shortest2, squared_distance(c[static_cast<std::size_t>(i)],
                                                       c[static_cast<std::size_t>(j)]));
    }
    const double size = ball.radius / leaf_.sizes.at(ball.center),
                 ratio = ball.radius / std::sqrt(shortest2);
    report_.max_circumradius = std::max(report_.max_circumradius, size);
    report_.max_radius_edge_ratio = std::max(report_.max_radius_edge_ratio, ratio);
    if (!(size < kBoundSlack)) {
      add_unless_open(&AuditReport::num_large_cells,
                      with_ratio("a cell's circumradius", size, " of the size"), v[0]);
    }
    if (ratio <= bounds_.radius_edge * kBoundSlack) return;
    if (bounds_.has_creases)
      for (std::size_t i = 0; i < 4; ++i)
        for (std::size_t j = i + 1; j < 4; ++j)
          if (squared_distance(c[i], c[j]) <= shortest2 * kBoundSlack) {
            short_edges_.push_back({v[i], v[j]});
            cell_of_short_edge_.push_back(badly_shaped_.size());
          }
    badly_shaped_.push_back({v[0], ratio});
  }

  // Of those whose shortest edge leads from sheet to sheet, or from crease to crease, the bound is
  // not asked.
  void check_badly_shaped() {
    std::vector<bool> is_exempt(badly_shaped_.size());
    if (!short_edges_.empty()) {
      const std::vector<bool> leads_across = creases_.lead_across(short_edges_);
      for (std::size_t i = 0; i < short_edges_.size(); ++i)
        if (leads_across[i]) is_exempt[cell_of_short_edge_[i]] = true;
    }
    for (std::size_t i = 0; i < badly_shaped_.size(); ++i) {
      const auto& [place, ratio] = badly_shaped_[i];
      if (is_exempt[i]) continue;
      add_unless_open(&AuditReport::num_badly_shaped_cells,
                      with_ratio("a cell's radius-edge ratio", ratio, ""), place);
    }
  }

  // Candidates come from the rounded ball, inflated a hair; the exact predicate decides.
  void check_empty(const Vertices& v, const Corners& c, const Circumsphere& ball) {
    const double hair = 1e-9 * ball.radius + bounds_.rounding;
    const double radius = ball.radius + hair;
    LocalIndex inside = kUnknownPoint;
    grid_.for_each_near(Box::around(ball.center).expanded(radius),
                        [&](LocalIndex i, const Point& p) {
                          if (squared_distance(p, ball.center) > radius * radius) return;
                          if (std::ranges::find(v, i) != v.end() || inside != kUnknownPoint) return;
                          if (exact_side_of_circumsphere(c[0], c[1], c[2], c[3], p) > 0) inside = i;
                        });
    if (inside == kUnknownPoint) return;
    add(&AuditReport::num_nonempty_circumballs,
        "this point, " + std::to_string(leaf_.points[inside].id) + ", lies in a cell's circumball",
        inside);
  }

  // A dihedral angle is a straight angle less the one between the outward normals.
  void measure_dihedrals(const Corners& c, const Point& center) {
    std::array<Point, 4> normal = {cross(c[3] - c[1], c[2] - c[1]), cross(c[2] - c[0], c[3] - c[0]),
                                   cross(c[3] - c[0], c[1] - c[0]),
                                   cross(c[1] - c[0], c[2] - c[0])};
    for (Point& n : normal) {
      const double length = norm(n);
      if (!(length > 0)) return;  // underflow
      n = (1 / length) * n;
    }
    double of_smallest = -1;
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = i + 1; j < 4; ++j) {
        const double cosine = -dot(normal[i], normal[j]);
        min_cosine_ = std::min(min_cosine_, cosine);
        of_smallest = std::max(of_smallest, cosine);
      }
    }
    if (in_degrees(of_smallest) * kBoundSlack < bounds_.min_dihedral) ++report_.num_poor_cells;
    if (of_smallest <= max_cosine_) return;
    max_cosine_ = of_smallest;
    worst_place_ = center;
  }

  void check_repeated(std::vector<Vertices>& cells) {
    std::ranges::sort(cells);
    for (std::size_t i = 1; i < cells.size(); ++i) {
      if (cells[i - 1] != cells[i]) continue;
      add(&AuditReport::num_repeated_cells, "a cell is stored twice", cells[i][0]);
    }
  }

  struct BadlyShaped {
    LocalIndex place = 0;
    double ratio = 0;
  };

  const AuditLeaf& leaf_;
  const AuditCreases& creases_;
  const AuditBounds& bounds_;
  AuditFindings& findings_;
  AuditReport& report_;
  AuditGrid grid_;
  double volume_ = 0;
  double min_cosine_ = 2, max_cosine_ = -2;
  Point worst_place_;  // of the cell with max_cosine_
  std::vector<BadlyShaped> badly_shaped_;
  std::vector<std::array<LocalIndex, 2>> short_edges_;  // of these, as short as the shortest
  std::vector<std::size_t> cell_of_short_edge_;
};

}  // namespace

void check_cells(const AuditLeaf& leaf, const AuditCreases& creases, const AuditBounds& bounds,
                 AuditFindings& findings) {
  if (!leaf.cells.cells.empty()) CellCheck(leaf, creases, bounds, findings).run();
}

}  // namespace locvol
