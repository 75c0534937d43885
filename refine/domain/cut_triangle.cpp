#include "refine/domain/cut_triangle.h"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Constrained_triangulation_face_base_2.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Number = Kernel::FT;
using Place = Kernel::Point_2;  // in the plane, without one coordinate
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<Point, Kernel>;
using FaceBase =
    CGAL::Triangulation_face_base_with_info_2<bool, Kernel,
                                              CGAL::Constrained_triangulation_face_base_2<Kernel>>;
using Triangulation = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>,
    CGAL::Exact_intersections_tag>;
using Corners = std::array<Point, 3>;

Kernel::Point_3 exact(const Point& p) { return {p.x, p.y, p.z}; }

// The nearest double, of two as near the smaller one; never -0.0.
double rounded(const Number& number) {
  const auto [low, high] = CGAL::to_interval(number);
  if (low == high) return low + 0.0;
  const auto& value = number.exact();
  using Exact = std::decay_t<decltype(value)>;
  const auto error = [&](double d) -> Exact {
    const Exact difference = value - Exact(d);
    return difference < 0 ? Exact(-difference) : difference;
  };
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  const double near = CGAL::to_double(value);
  double best = std::nextafter(near, -kEndless);
  Exact least = error(best);
  for (const double other : {near, std::nextafter(near, kEndless)})
    if (Exact its = error(other); its < least) {
      best = other;
      least = std::move(its);
    }
  return best + 0.0;
}

// The plane of a triangle, seen along the axis that it is steepest to. So all triangles of a plane
// have the same view of it.
class PlaneView {
 public:
  explicit PlaneView(const Corners& corners)
      : origin_(exact(corners[0])),
        normal_(CGAL::cross_product(exact(corners[1]) - origin_, exact(corners[2]) - origin_)) {
    for (int axis = 1; axis < 3; ++axis)
      if (CGAL::abs(normal_[axis]) > CGAL::abs(normal_[axis_])) axis_ = axis;
  }

  bool is_turned() const { return normal_[axis_] < 0; }  // seen so, the corners turn right
  Number height(const Kernel::Point_3& p) const { return normal_ * (p - origin_); }
  Place place(const Kernel::Point_3& p) const { return {p[first()], p[second()]}; }
  // Of a place in the plane.
  Point rounded_point(const Place& place) const {
    const Number x = place.x(), y = place.y();
    Point point;
    point[first()] = rounded(x);
    point[second()] = rounded(y);
    point[axis_] = rounded(origin_[axis_] - (normal_[first()] * (x - origin_[first()]) +
                                             normal_[second()] * (y - origin_[second()])) /
                                                normal_[axis_]);
    return point;
  }

 private:
  int first() const { return (axis_ + 1) % 3; }
  int second() const { return (axis_ + 2) % 3; }

  Kernel::Point_3 origin_;
  Kernel::Vector_3 normal_;
  int axis_ = 0;
};

class TriangleCutter {
 public:
  explicit TriangleCutter(const Corners& corners)
      : corners_(corners),
        view_(corners),
        triangle_(view_.place(exact(corners[0])), view_.place(exact(corners[1])),
                  view_.place(exact(corners[2]))) {
    for (int k = 0; k < 3; ++k) cuts_.insert_constraint(triangle_[k], triangle_[k + 1]);
  }

  void cut_along(const Corners& other) {
    const std::array<Kernel::Point_3, 3> points{exact(other[0]), exact(other[1]), exact(other[2])};
    const std::array<Number, 3> heights{view_.height(points[0]), view_.height(points[1]),
                                        view_.height(points[2])};
    if (std::ranges::all_of(heights, [](const Number& h) { return h == 0; })) {
      for (std::size_t k = 0; k < 3; ++k)
        cut_along(view_.place(points[k]), view_.place(points[(k + 1) % 3]));
      return;
    }
    std::vector<Place> ends;  // of what the plane has of the other one
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      if (heights[k] == 0) ends.push_back(view_.place(points[k]));
      if (CGAL::sign(heights[k]) * CGAL::sign(heights[next]) >= 0) continue;
      const Place a = view_.place(points[k]), b = view_.place(points[next]);
      ends.push_back(a + heights[k] / (heights[k] - heights[next]) * (b - a));
    }
    if (!ends.empty()) cut_along(ends.front(), ends.back());
  }

  TrianglePieces pieces() {
    TrianglePieces pieces;
    if (cuts_.number_of_vertices() == 3) {
      pieces.corners = {corners_};
      return pieces;
    }
    for (const auto vertex : cuts_.finite_vertex_handles())
      vertex->info() = view_.rounded_point(vertex->point());
    for (const auto face : cuts_.finite_face_handles()) face->info() = false;
    for (const auto face : cuts_.finite_face_handles()) {
      if (face->info()) continue;
      const std::vector<Triangulation::Vertex_handle> polygon = polygon_with(face);
      for (std::size_t i = 2; i < polygon.size(); ++i)
        add(polygon[0]->info(), polygon[i - 1]->info(), polygon[i]->info(), pieces);
    }
    std::ranges::sort(pieces.corners);
    return pieces;
  }

 private:
  void cut_along(const Place& from, const Place& to) {
    if (from == to) {
      if (!triangle_.has_on_unbounded_side(from)) cuts_.insert(from);
      return;
    }
    const auto common = CGAL::intersection(Kernel::Segment_2(from, to), triangle_);
    if (!common) return;
    if (const auto* segment = boost::get<Kernel::Segment_2>(&*common))
      cuts_.insert_constraint(segment->source(), segment->target());
    else if (const auto* point = boost::get<Place>(&*common))
      cuts_.insert(*point);
  }

  // Faces whose corners lie on one circle could be others just as well. Taken together they are a
  // convex polygon, which begins with its smallest corner, and is all that the points and edges
  // decide.
  std::vector<Triangulation::Vertex_handle> polygon_with(Triangulation::Face_handle face) {
    std::vector<Triangulation::Vertex_handle> polygon;
    const auto go_on = [&](const auto& self, Triangulation::Face_handle f, int from) -> void {
      f->info() = true;
      for (int n = from < 0 ? 0 : 1; n < 3; ++n) {
        const int k = from < 0 ? n : (from + n) % 3;  // the edge opposite corner k
        const Triangulation::Face_handle beyond = f->neighbor(k);
        if (is_open(f, k) && !beyond->info())
          self(self, beyond, beyond->index(f));
        else
          polygon.push_back(f->vertex(Triangulation::ccw(k)));
      }
    };
    go_on(go_on, face, -1);
    const auto smallest = std::ranges::min_element(polygon, [](const auto& v, const auto& w) {
      return CGAL::lexicographically_xy_smaller(v->point(), w->point());
    });
    std::ranges::rotate(polygon, smallest);
    return polygon;
  }

  bool is_open(Triangulation::Face_handle face, int k) const {
    const Triangulation::Face_handle beyond = face->neighbor(k);
    if (face->is_constrained(k) || cuts_.is_infinite(beyond)) return false;
    const auto& far = beyond->vertex(beyond->index(face))->point();
    return CGAL::side_of_oriented_circle(face->vertex(0)->point(), face->vertex(1)->point(),
                                         face->vertex(2)->point(),
                                         far) == CGAL::ON_ORIENTED_BOUNDARY;
  }

  void add(const Point& a, const Point& b, const Point& c, TrianglePieces& pieces) const {
    if (a == b || b == c || c == a) {
      ++pieces.num_collapsed;
      return;
    }
    Corners piece{a, b, c};
    if (view_.is_turned()) std::swap(piece[1], piece[2]);
    std::ranges::rotate(piece, std::ranges::min_element(piece));
    pieces.corners.push_back(piece);
  }

  Corners corners_;
  PlaneView view_;
  Kernel::Triangle_2 triangle_;
  Triangulation cuts_;
};

}  // namespace

TrianglePieces cut_triangle(const std::array<Point, 3>& triangle,
                            std::span<const std::array<Point, 3>> others) {
  TriangleCutter cutter(triangle);
  for (const std::array<Point, 3>& other : others) cutter.cut_along(other);
  return cutter.pieces();
}

}  // namespace locvol
