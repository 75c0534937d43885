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
#include <map>
#include <optional>
#include <type_traits>
#include <utility>

#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

using Kernel = CGAL::Exact_predicates_exact_constructions_kernel;
using Number = Kernel::FT;
using Place = Kernel::Point_2;  // in the plane, without one coordinate
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<std::optional<Point>, Kernel>;
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

// With its ends in order, so that all triangles that have it compute the same.
struct Edge {
  Point low, high;
  friend auto operator<=>(const Edge&, const Edge&) = default;
};
Edge edge_of(const Corners& triangle, std::size_t k) {
  const Point &a = triangle[k], &b = triangle[(k + 1) % 3];
  return a < b ? Edge{a, b} : Edge{b, a};
}

bool are_near(const Point& a, const Point& b, double distance) {
  return squared_distance(a, b) < distance * distance;
}
bool is_near(const Edge& edge, const Point& point, double distance) {
  return are_near(point, closest_on_segment(edge.low, edge.high, point), distance);
}

// Where on the edge a point near it lies, from 0 to 1; not if it is near an end.
std::optional<double> place_along(const Edge& edge, const Point& point, double distance) {
  const Point along = edge.high - edge.low;
  const double place = dot(point - edge.low, along) / dot(along, along);
  if (!(place > 0 && place < 1) || !are_near(point, edge.low + place * along, distance) ||
      are_near(point, edge.low, distance) || are_near(point, edge.high, distance))
    return std::nullopt;
  return place;
}

// Where two edges are near each other, and no end of one is near the other.
std::optional<Point> crossing_of(Edge e, Edge f, double distance) {
  constexpr double kLeastSine = 1e-6;
  if (f < e) std::swap(e, f);
  const Point u = e.high - e.low, v = f.high - f.low, w = f.low - e.low, across = cross(u, v);
  const double square = dot(across, across);
  if (square <= kLeastSine * kLeastSine * dot(u, u) * dot(v, v)) return std::nullopt;
  const double s = dot(cross(w, v), across) / square, t = dot(cross(w, u), across) / square;
  if (!(s > 0 && s < 1 && t > 0 && t < 1)) return std::nullopt;
  const Point p = e.low + s * u, q = f.low + t * v;
  if (!are_near(p, q, distance) || is_near(e, f.low, distance) || is_near(e, f.high, distance) ||
      is_near(f, e.low, distance) || is_near(f, e.high, distance))
    return std::nullopt;
  return 0.5 * (p + q) + Point{};  // no -0.0
}

Box box_of(const Corners& t) { return Box::around(t[0]).joined(t[1]).joined(t[2]); }

// Does the other triangle lie on one side of this one's plane, farther than the distance?
bool is_beyond_plane(const Corners& triangle, const Corners& other, double distance) {
  const Point normal = cross(triangle[1] - triangle[0], triangle[2] - triangle[0]);
  const double reach = distance * norm(normal);
  const auto height = [&](const Point& p) { return dot(p - triangle[0], normal); };
  const auto [low, high] = std::minmax({height(other[0]), height(other[1]), height(other[2])});
  return low > reach || high < -reach;
}

// A point that an edge gets.
struct Print {
  double along = 0;
  Point point;
  friend auto operator<=>(const Print&, const Print&) = default;
};

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

  // What is close is there from now on, where it would be if the triangle were plane.
  void imprint(std::span<const Corners> others, double distance) {
    std::map<Point, Place> places;
    for (int k = 0; k < 3; ++k) places.emplace(corners_[static_cast<std::size_t>(k)], triangle_[k]);
    std::vector<Print> on_edges;
    for (std::size_t k = 0; k < 3; ++k) {
      const Edge edge = edge_of(corners_, k);
      const Place low = places.at(edge.low), high = places.at(edge.high);
      on_edges.clear();
      for (const Corners& other : others)
        for (std::size_t j = 0; j < 3; ++j) {
          if (const auto along = place_along(edge, other[j], distance))
            on_edges.push_back({*along, other[j]});
          if (const auto point = crossing_of(edge, edge_of(other, j), distance))
            on_edges.push_back({*place_along(edge, *point, 2 * distance), *point});
        }
      std::ranges::sort(on_edges);
      double last = 0;
      for (const auto& [along, point] : on_edges) {
        if (along == std::exchange(last, along) || places.contains(point)) continue;
        places.emplace(point, insert(low + Number(along) * (high - low), point));
      }
    }
    for (const Corners& other : others)
      for (const Point& point : other) {
        if (places.contains(point)) continue;
        if (const auto place = place_inside(point, distance))
          places.emplace(point, insert(*place, point));
      }
    std::vector<Print> on_edge;
    for (const Corners& other : others)
      for (std::size_t j = 0; j < 3; ++j) {
        const Edge edge = edge_of(other, j);
        on_edge = {{0, edge.low}, {1, edge.high}};
        for (std::size_t k = 0; k < 3; ++k) {
          if (const auto along = place_along(edge, corners_[k], distance))
            on_edge.push_back({*along, corners_[k]});
          if (const auto point = crossing_of(edge, edge_of(corners_, k), distance))
            on_edge.push_back({*place_along(edge, *point, 2 * distance), *point});
        }
        std::erase_if(on_edge, [&](const Print& print) { return !places.contains(print.point); });
        std::ranges::sort(on_edge);
        for (std::size_t i = 1; i < on_edge.size(); ++i)
          if (const Place& from = places.at(on_edge[i - 1].point),
              &to = places.at(on_edge[i].point);
              from != to)
            cuts_.insert_constraint(from, to);
      }
  }

  TrianglePieces pieces() {
    TrianglePieces pieces;
    if (cuts_.number_of_vertices() == 3) {
      pieces.corners = {corners_};
      return pieces;
    }
    for (const auto vertex : cuts_.finite_vertex_handles())
      if (!vertex->info()) vertex->info() = view_.rounded_point(vertex->point());
    for (const auto face : cuts_.finite_face_handles()) face->info() = false;
    for (const auto face : cuts_.finite_face_handles()) {
      if (face->info()) continue;
      const std::vector<Triangulation::Vertex_handle> polygon = polygon_with(face);
      for (std::size_t i = 2; i < polygon.size(); ++i)
        add(*polygon[0]->info(), *polygon[i - 1]->info(), *polygon[i]->info(), pieces);
    }
    std::ranges::sort(pieces.corners);
    return pieces;
  }

 private:
  Place insert(const Place& place, const Point& point) {
    cuts_.insert(place)->info() = point;
    return place;
  }

  // Of a point that is near the triangle, and not near its edges.
  std::optional<Place> place_inside(const Point& point, double distance) const {
    const auto& [a, b, c] = corners_;
    const Point normal = cross(b - a, c - a);
    const double height = dot(point - a, normal) / norm(normal);
    if (std::abs(height) >= distance) return std::nullopt;
    for (std::size_t k = 0; k < 3; ++k)
      if (is_near(edge_of(corners_, k), point, distance)) return std::nullopt;
    const Place place = view_.place(exact(point - (height / norm(normal)) * normal));
    if (!triangle_.has_on_bounded_side(place)) return std::nullopt;
    return place;
  }

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

bool leaves_print(const std::array<Point, 3>& triangle, const std::array<Point, 3>& other,
                  double distance) {
  if (is_beyond_plane(triangle, other, distance) || is_beyond_plane(other, triangle, distance))
    return false;
  const Box reach = box_of(triangle).expanded(distance);
  for (const Point& p : other)
    if (reach.contains(p) && std::ranges::find(triangle, p) == triangle.end() &&
        are_near(p, closest_on_triangle(triangle, p), distance))
      return true;
  for (std::size_t j = 0; j < 3; ++j) {
    const Edge edge = edge_of(other, j);
    const Box around = Box::around(edge.low).joined(edge.high).expanded(distance);
    if (!around.overlaps(reach)) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      const Edge own = edge_of(triangle, k);
      if (around.overlaps(Box::around(own.low).joined(own.high)) &&
          crossing_of(own, edge, distance))
        return true;
    }
  }
  return false;
}

TrianglePieces imprinted_triangle(const std::array<Point, 3>& triangle,
                                  std::span<const std::array<Point, 3>> others, double distance) {
  if (height_of(triangle) < distance) {
    for (std::size_t k = 0; k < 3; ++k)
      if (place_along(edge_of(triangle, k), triangle[(k + 2) % 3], distance))
        return {.corners = {}, .num_collapsed = 1};
    return {.corners = {triangle}};
  }
  TriangleCutter cutter(triangle);
  cutter.imprint(others, distance);
  return cutter.pieces();
}

double height_of(const std::array<Point, 3>& t) {
  const double longest = std::sqrt(std::max(
      {squared_distance(t[0], t[1]), squared_distance(t[1], t[2]), squared_distance(t[2], t[0])}));
  return longest > 0 ? norm(cross(t[1] - t[0], t[2] - t[0])) / longest : 0;
}

}  // namespace locvol
