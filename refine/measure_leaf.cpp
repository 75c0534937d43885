#include "refine/measure_leaf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "refine/domain/box_tree.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/fragment.h"

namespace locvol {
namespace {

constexpr double kPi = std::numbers::pi;
// Edges that turn by more are creases, and no part of a curved sheet. In degrees.
constexpr double kCreaseAngle = 40;
// Sheets that make a smaller angle are a tip. Facets across it, seldom any, get longer with the
// angle, and at this one are as long as any. Measured on wedges of 5° to 45°.
constexpr double kTip = std::numbers::pi / 6;
// Of the boundary's edges, over h, on average.
constexpr double kEdge = 1.15;
// Sheets form a thin part if they face each other up to this angle, in degrees.
constexpr double kParallel = 30;

// ---- Symmetric tensors: xx, yy, zz, xy, yz, zx

using Tensor = std::array<double, 6>;

Tensor product(const Point& a, const Point& b, double factor) {
  return {factor * a.x * b.x,
          factor * a.y * b.y,
          factor * a.z * b.z,
          0.5 * factor * (a.x * b.y + a.y * b.x),
          0.5 * factor * (a.y * b.z + a.z * b.y),
          0.5 * factor * (a.z * b.x + a.x * b.z)};
}

void add(const Tensor& t, double factor, Tensor& sum) {
  for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += factor * t[k];
}

// The largest and the smallest eigenvalue (Smith 1961).
std::pair<double, double> eigenvalues(const Tensor& t) {
  const auto& [xx, yy, zz, xy, yz, zx] = t;
  const double mean = (xx + yy + zz) / 3;
  const double a = xx - mean, b = yy - mean, c = zz - mean;
  const double p2 = (a * a + b * b + c * c + 2 * (xy * xy + yz * yz + zx * zx)) / 6;
  if (!(p2 > 0)) return {mean, mean};
  const double p = std::sqrt(p2);
  const double det = a * (b * c - yz * yz) - xy * (xy * c - yz * zx) + zx * (xy * yz - b * zx);
  const double angle = std::acos(std::clamp(det / (2 * p * p2), -1.0, 1.0)) / 3;
  return {mean + 2 * p * std::cos(angle), mean + 2 * p * std::cos(angle + 2 * kPi / 3)};
}

double most_curved(const Tensor& curvature) {
  const auto [high, low] = eigenvalues(curvature);
  return std::max(std::abs(high), std::abs(low));
}

// ---- What is measured of a triangle

Point area_vector(const std::array<Point, 3>& c) { return 0.5 * cross(c[1] - c[0], c[2] - c[0]); }

Point normalized(const Point& v) {
  const double length = norm(v);
  return length > 0 ? 1 / length * v : Point{};
}

// That fits the differences of the normals along the edges, by least squares.
Tensor curvature_of(const std::array<Point, 3>& corners, const std::array<Point, 3>& normals,
                    const Point& normal) {
  const Point u = normalized(corners[1] - corners[0]), v = cross(normal, u);
  double xx = 0, xy = 0, yy = 0, r0 = 0, r1 = 0, r2 = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Point edge = corners[(k + 1) % 3] - corners[k];
    const Point turn = normals[(k + 1) % 3] - normals[k];
    const double x = dot(edge, u), y = dot(edge, v), a = dot(turn, u), b = dot(turn, v);
    xx += x * x, xy += x * y, yy += y * y;
    r0 += x * a, r1 += y * a + x * b, r2 += y * b;
  }
  // (xx xy 0; xy xx+yy xy; 0 xy yy) (e f g) = (r0 r1 r2)
  const double middle = xx + yy - xy * xy / xx - xy * xy / yy;
  const double f = (r1 - xy * r0 / xx - xy * r2 / yy) / middle;
  const double e = (r0 - xy * f) / xx, g = (r2 - xy * f) / yy;
  if (!std::isfinite(e) || !std::isfinite(f) || !std::isfinite(g)) return {};
  Tensor t = product(u, u, e);
  add(product(u, v, 1), 2 * f, t);
  add(product(v, v, 1), g, t);
  return t;
}

std::uint8_t direction_of(const Point& normal) {
  const double x = std::abs(normal.x), y = std::abs(normal.y), z = std::abs(normal.z);
  const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  return static_cast<std::uint8_t>(2 * axis + (normal[axis] < 0));
}

struct Measured {
  Point normal;
  Tensor curvature{};
};

// Or a vertex, where a and b are the same, and the surface turns as on a cone.
struct Edge {
  Point a, b;
  double turn = 0;        // in radians
  double width = 0;       // of the narrower of its triangles; of a vertex, its shortest edge
  Point left{}, right{};  // normals of its triangles
  bool is_convex = false;
  double opening = 0;  // of a vertex like the tip of a cone: the tangent of half its angle
};

// Normals at the corners are those of the triangles around that no crease parts from it.
class Curvatures {
 public:
  explicit Curvatures(std::span<const Triangle> triangles, StopPoll poll)
      : triangles_(triangles), measured_(triangles.size()), at_corners_(triangles.size()) {
    for (std::size_t n = 0; n < triangles.size(); ++n)
      measured_[n].normal = normalized(area_vector(triangles[n].corners));
    std::vector<Corner> corners;
    for (std::uint32_t n = 0; n < triangles.size(); ++n)
      for (std::uint32_t k = 0; k < 3; ++k) corners.push_back({triangles[n].corners[k], n, k});
    std::ranges::sort(corners);
    for (auto first = corners.begin(); first != corners.end();) {
      poll();
      const auto end = std::find_if(first, corners.end(),
                                    [&](const Corner& c) { return c.place != first->place; });
      join_around({first, end});
      first = end;
    }
    for (std::size_t n = 0; n < triangles.size(); ++n)
      measured_[n].curvature =
          curvature_of(triangles[n].corners, at_corners_[n], measured_[n].normal);
  }

  const Measured& of(std::size_t n) const { return measured_[n]; }
  const std::vector<Edge>& edges() const { return edges_; }  // that turn

 private:
  struct Corner {
    Point place;
    std::uint32_t triangle = 0, index = 0;
    friend auto operator<=>(const Corner&, const Corner&) = default;
  };
  static constexpr double kFlat = 1 - 1e-9;
  struct Spoke {  // an edge from the vertex, of one of its corners
    Point end;
    std::uint32_t corner = 0;
    friend auto operator<=>(const Spoke&, const Spoke&) = default;
  };

  void join_around(std::span<const Corner> corners) {
    const auto at = [&](const Corner& c, std::uint32_t k) {
      return triangles_[c.triangle].corners[(c.index + k) % 3];
    };
    spokes_.clear();
    creases_.clear();
    sharpest_ = 1;
    for (std::uint32_t n = 0; n < corners.size(); ++n)
      for (const std::uint32_t k : {1U, 2U}) spokes_.push_back({at(corners[n], k), n});
    std::ranges::sort(spokes_);
    fan_.resize(corners.size());
    std::iota(fan_.begin(), fan_.end(), 0U);
    for (std::size_t s = 1; s < spokes_.size(); ++s) {
      if (spokes_[s].end != spokes_[s - 1].end) continue;
      const std::uint32_t a = spokes_[s - 1].corner, b = spokes_[s].corner;
      const double cosine =
          dot(measured_[corners[a].triangle].normal, measured_[corners[b].triangle].normal);
      static const double kCrease = std::cos(kPi / 180 * kCreaseAngle);
      if (cosine > kCrease) fan_[root(a)] = root(b);
      if (cosine < kFlat && corners[0].place < spokes_[s].end)
        edges_.push_back({corners[0].place, spokes_[s].end, std::acos(std::max(-1.0, cosine)),
                          std::min(width_beside(corners[a], spokes_[s].end),
                                   width_beside(corners[b], spokes_[s].end)),
                          measured_[corners[a].triangle].normal,
                          measured_[corners[b].triangle].normal,
                          is_convex(corners[a], corners[b], spokes_[s].end)});
      if (cosine > kCrease) continue;
      creases_.push_back(spokes_[s].end);
      sharpest_ = std::min(sharpest_, cosine);
    }
    sums_.assign(corners.size(), {});
    angles_.assign(corners.size(), 0);
    for (std::uint32_t n = 0; n < corners.size(); ++n) {
      const Point p = corners[n].place;
      const Point one = normalized(at(corners[n], 1) - p), two = normalized(at(corners[n], 2) - p);
      const double angle = std::acos(std::clamp(dot(one, two), -1.0, 1.0));
      Point& sum = sums_[root(n)];
      sum = sum + angle * measured_[corners[n].triangle].normal;
      angles_[root(n)] += angle;
    }
    for (std::uint32_t n = 0; n < corners.size(); ++n)
      at_corners_[corners[n].triangle][corners[n].index] = normalized(sums_[root(n)]);
    note_vertex(corners[0].place);
  }
  // Its triangles lean as much on average. Where it lies on a crease that goes on, what is cut off
  // of that crease is its edges' affair: what counts is how much the crease turns, and how much the
  // sheet on each side leans. REQUIRES: sums_, angles_, spokes_, creases_ are the vertex's
  void note_vertex(const Point& place) {
    double shortest = std::numeric_limits<double>::infinity();
    for (const Spoke& spoke : spokes_)
      shortest = std::min(shortest, squared_distance(spoke.end, place));
    double cosine = 1, turn = 0, opening = 0;
    if (creases_.size() == 2) {
      for (std::size_t n = 0; n < sums_.size(); ++n)
        if (angles_[n] > 0) cosine = std::min(cosine, norm(sums_[n]) / angles_[n]);
      const Point in = normalized(place - creases_[0]), out = normalized(creases_[1] - place);
      turn = std::acos(std::clamp(dot(in, out), -1.0, 1.0));
    } else {
      Point sum;
      for (const Point& some : sums_) sum = sum + some;
      cosine = norm(sum) / std::accumulate(angles_.begin(), angles_.end(), 0.0);
      // Where one of its edges is a tip, it is the corner of a knife, which the edge sees to.
      if (sharpest_ > -std::cos(kTip) && cosine < kFlat)
        opening = cosine / std::sqrt(1 - cosine * cosine);
    }
    if (cosine < kFlat) turn = std::max(turn, 2 * std::acos(cosine));
    if (turn > 0)
      edges_.push_back({.a = place,
                        .b = place,
                        .turn = turn,
                        .width = std::sqrt(shortest),
                        .left = {},
                        .right = {},
                        .opening = opening});
  }
  // The edge from the two corners' place to `end`.
  bool is_convex(const Corner& one, const Corner& two, const Point& end) const {
    for (const Point& p : triangles_[two.triangle].corners)
      if (p != two.place && p != end) return dot(measured_[one.triangle].normal, p - one.place) < 0;
    return false;
  }
  // Of the corner's triangle, across the edge from there to `end`.
  double width_beside(const Corner& corner, const Point& end) const {
    const double area = norm(area_vector(triangles_[corner.triangle].corners));
    return 2 * area / norm(end - corner.place);
  }
  std::uint32_t root(std::uint32_t n) {
    while (fan_[n] != n) n = fan_[n] = fan_[fan_[n]];
    return n;
  }

  std::span<const Triangle> triangles_;
  std::vector<Measured> measured_;
  std::vector<std::array<Point, 3>> at_corners_;  // normals
  std::vector<Edge> edges_;
  std::vector<Spoke> spokes_;
  std::vector<std::uint32_t> fan_;
  std::vector<Point> sums_;     // of normals, by fan
  std::vector<double> angles_;  // of its corners, by fan
  std::vector<Point> creases_;  // ends of the vertex's
  double sharpest_ = 1;         // cosine of how much the surface turns at them, at most
};

// ---- Nodes of one level, with what is in them

struct Sums {
  MortonKey node;
  std::uint8_t direction = 0;
  double area = 0;
  Point place;  // times area
  Tensor places{}, curvature{};

  std::pair<MortonKey, std::uint8_t> name() const { return {node, direction}; }
  void add(const Sums& more) {
    area += more.area;
    place = place + more.place;
    locvol::add(more.places, 1, places);
    locvol::add(more.curvature, 1, curvature);
  }
};

// In order, those with the same name together.
void merge(std::vector<Sums>& all) {
  std::ranges::stable_sort(all, {}, &Sums::name);
  std::size_t num = 0;
  for (const Sums& sums : all)
    if (num > 0 && all[num - 1].name() == sums.name())
      all[num - 1].add(sums);
    else
      all[num++] = sums;
  all.resize(num);
}

class LeafMeasure {
 public:
  // `surface`: null where nothing is asked across the inside
  LeafMeasure(const MeasureInput& input, std::span<const Triangle> triangles,
              const LeafDomain* domain, const StopToken* stop)
      : input_(input),
        rules_(input.rules),
        domain_(domain),
        poll_(stop),
        triangles_(triangles),
        origin_(input.frame.box(input.leaf).center()),
        finest_(std::max(input.leaf.level(),
                         input.frame.level_no_wider(rules_.least > 0 ? rules_.least : input.size))),
        coarsest_(std::clamp(input.frame.level_no_wider(input.size), input.leaf.level(), finest_)),
        around_(input.frame.box(input.leaf).expanded(1.001 * input.frame.side(coarsest_))),
        curvatures_(triangles_, StopPoll(stop)) {}

  double num_pieces() {
    constexpr double kPieces = 4;  // halves come down to between half of the length and all of it
    double num = 0;
    for (std::size_t n = 0; n < triangles_.size(); ++n) {
      poll_();
      const double length = piece_length(n);
      double area = 0;
      const std::vector<Point> polygon = clipped(triangles_[n], around_);
      for (std::size_t i = 2; i < polygon.size(); ++i)
        area += norm(area_vector({polygon[0], polygon[i - 1], polygon[i]}));
      num += 1 + kPieces * area / (length * length);
      const double of_sheet = kSheetStep * size_of_sheet(triangles_[n].sheet);
      if (of_sheet < input_.size) num += kPieces * area / (of_sheet * of_sheet);
    }
    return num;
  }

  std::vector<SizedNode> run() {
    if (rules_.per_circle > 0 || rules_.deviation > 0) measure_curvature();
    if (rules_.deviation > 0) measure_creases();
    if (rules_.layers > 0) measure_thickness();
    if (!rules_.sheet_sizes.empty()) measure_sheets();
    unite(found_);
    return std::move(found_);
  }

 private:
  void note(MortonKey node, double size) {
    if (size < input_.size && input_.leaf.is_ancestor_or_self_of(node))
      found_.push_back({node, static_cast<float>(std::max(size, rules_.least))});
  }
  void note(const Point& p, double size) { note_as_it_is(p, std::max(size, rules_.least)); }
  void note_as_it_is(const Point& p, double size) {
    if (!(size < input_.size) || !input_.frame.contains(p)) return;
    const int level = std::max(input_.frame.level_no_wider(size), input_.leaf.level());
    const MortonKey node = input_.frame.key_of(p, level);
    if (input_.leaf.is_ancestor_or_self_of(node))
      found_.push_back({node, static_cast<float>(size)});
  }

  // -- Curvature and deviation

  double size_for_circles(double curvature) const {
    return rules_.per_circle > 0 ? 2 * kPi / (rules_.per_circle * kEdge * curvature)
                                 : std::numeric_limits<double>::infinity();
  }
  // A ball of radius s around a place of a sheet with radius of curvature R: the facet is s² / 2 R
  // off.
  double size_for_deviation(double curvature) const {
    return rules_.deviation > 0 ? std::sqrt(kSafe * 2 * rules_.deviation / curvature)
                                : std::numeric_limits<double>::infinity();
  }
  // Of places on a ball's surface, squared distances from the plane through them are 0.4 (v / R)²
  // on average, and v along it. Tells what no curvature is left of on average: noise.
  double size_for_flatness(const Tensor& places) const {
    const auto [along, across] = eigenvalues(places);
    return across > 0 ? size_for_deviation(std::sqrt(across / 0.4) / along)
                      : std::numeric_limits<double>::infinity();
  }

  void measure_curvature() {
    levels_.resize(std::size_t(finest_) + 1);
    std::vector<Sums>& finest = levels_.back();
    for (std::size_t n = 0; n < triangles_.size(); ++n) {
      const auto& [normal, curvature] = curvatures_.of(n);
      for_each_piece({triangles_[n].corners}, piece_length(n), [&](const Fragment& piece) {
        poll_();
        const Point center = center_of(piece);
        if (!around_.contains(center) || !input_.frame.contains(center)) return;
        const double area = norm(area_vector(piece.corners));
        const Point place = center - origin_;
        Sums sums{.node = input_.frame.key_of(center, finest_),
                  .direction = direction_of(normal),
                  .area = area,
                  .place = area * place,
                  .places = product(place, place, area)};
        add(curvature, area, sums.curvature);
        finest.push_back(sums);
      });
      if (finest.size() > 2 * num_merged_ + 100000) {
        merge(finest);
        num_merged_ = finest.size();
      }
    }
    merge(finest);
    for (int level = finest_ - 1; level >= coarsest_; --level) {
      std::vector<Sums>& coarser = levels_[std::size_t(level)];
      coarser = levels_[std::size_t(level) + 1];
      for (Sums& sums : coarser) sums.node = sums.node.parent();
      merge(coarser);
    }
    std::optional<MortonKey> last;
    for (const Sums& sums : levels_[std::size_t(coarsest_)])
      if (last != sums.node && input_.leaf.is_ancestor_or_self_of(sums.node)) {
        last = sums.node;
        descend(sums.node);
      }
    levels_.clear();
  }

  void descend(MortonKey node) {
    const auto all = in(node, node.level());
    if (all.empty()) return;
    poll_();
    const double side = input_.frame.side(node.level());
    double size = std::numeric_limits<double>::infinity();
    for (const Sums& sums : all) size = std::min(size, size_around(sums, side));
    if (size >= side || node.level() == finest_) return note(node, size);
    for (int octant = 0; octant < 8; ++octant) descend(node.child(octant));
  }

  // All directions of a node.
  std::span<const Sums> in(MortonKey node, int level) const {
    const std::vector<Sums>& all = levels_[std::size_t(level)];
    const auto [first, end] = std::ranges::equal_range(all, node, {}, &Sums::node);
    return {first, end};
  }

  double size_around(const Sums& center, double side) const {
    Sums sums;
    const int level = center.node.level();
    const GridPoint low = center.node.grid_min();
    const std::int64_t step = center.node.grid_side(),
                       last = std::int64_t{1} << MortonKey::kMaxLevel;
    for (int k = 0; k < 27; ++k) {
      const std::int64_t x = low.x + (k % 3 - 1) * step, y = low.y + (k / 3 % 3 - 1) * step,
                         z = low.z + (k / 9 - 1) * step;
      if (std::min({x, y, z}) < 0 || std::max({x, y, z}) >= last) continue;
      const MortonKey node =
          MortonKey::containing({static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y),
                                 static_cast<std::uint32_t>(z)},
                                level);
      for (const Sums& some : in(node, level))
        if (some.direction == center.direction) sums.add(some);
    }
    if (!(sums.area > 0)) return std::numeric_limits<double>::infinity();
    Tensor curvature{}, places{};
    add(sums.curvature, 1 / sums.area, curvature);
    add(sums.places, 1 / sums.area, places);
    const Point mean = 1 / sums.area * sums.place;
    add(product(mean, mean, 1), -1, places);
    const double bend = most_curved(curvature);
    double size = std::min(size_for_circles(bend), size_for_deviation(bend));
    // Along an edge it may be curved in this node only.
    if (center.area > kWhole * side * side)
      size = std::min(size, size_for_deviation(most_curved(center.curvature) / center.area));
    return std::min(size, size_for_flatness(places));
  }

  // -- Creases, which facets cut off

  // Edges and vertices that turn little between narrow triangles are parts of something curved, and
  // do not count.
  void measure_creases() {
    const Box box = input_.frame.box(input_.leaf);
    for (const Edge& edge : curvatures_.edges()) {
      const double size = std::min(size_for_crease(edge.turn), size_for_needle(edge));
      if (size >= input_.size || (edge.turn < kPi / 180 * kCreaseAngle && size > edge.width))
        continue;
      if (!Box::around(edge.a).joined(edge.b).overlaps(box)) continue;
      const double length = norm(edge.b - edge.a);
      for (double at = 0;;) {
        poll_();
        const Point p = at < length ? edge.a + at / length * (edge.b - edge.a) : edge.b;
        const double here = box.contains(p) ? std::max(size, size_at_tip(p, edge, size)) : size;
        note(p, here);
        if (at >= length) break;
        at = std::min(at + 0.5 * std::max(here, rules_.least), length);
      }
    }
  }

  // A facet that cuts an edge off has its vertices on a ball around a place of the surface, without
  // a sample in it, so with a radius below `kCovered` sizes: what it cuts off is at most as deep as
  // if the ball were around a place of the edge. A vertex is cut off likewise, as of a cone.
  double size_for_crease(double turn) const {
    return kSafeSize * rules_.deviation / (kCovered * std::sin(0.5 * turn));
  }

  // A vertex like the tip of a cone is cut off where the cone is no wider than a size there, which
  // has grown on the way (0.8 sizes, measured on cones and pyramids with half angles of 4° to 25°).
  // A cone narrower than sizes grow asks for the least.
  double size_for_needle(const Edge& edge) const {
    if (edge.opening == 0) return std::numeric_limits<double>::infinity();
    const double slope = 2 * edge.opening - rules_.growth;
    return std::max(rules_.least, kSafeSize * rules_.deviation * slope);
  }

  // Sheets that make a small angle are told apart (C3, C4) almost down to where they are a spacing
  // floor apart, so that at a tip much less is cut off than a facet could. Not so at the bottom of
  // a groove: what mending leaves out there is of cells as large as those around.
  double size_for_tip(double least_angle, double largest_angle) const {
    const double of_floor = 0.5 * rules_.spacing_floor / std::tan(0.5 * least_angle);
    const double of_facets = kCovered * std::pow(largest_angle / kTip, 4);
    return kSafeSize * rules_.deviation / (of_floor + of_facets);
  }

  // As large as the surface is a tip in a ball of that radius, from `least` on; `least` if it is
  // none.
  double size_at_tip(const Point& p, const Edge& edge, double least) {
    constexpr double kStep = 1.25;
    if (edge.turn < kPi - kTip || !edge.is_convex) return least;
    for (const auto& [place, left, right, size] : tips_)
      if (squared_distance(p, place) < 0.0625 * size * size && dot(left, edge.left) > kSameSheet &&
          dot(right, edge.right) > kSameSheet)
        return size;
    double found = least;
    for (double size = kStep * least; found < input_.size; size *= kStep) {
      size = std::min(size, input_.size);
      const auto angles = angles_of_tip(p, edge, size);
      if (!angles || size_for_tip(angles->first, angles->second) < size) break;
      found = size;
    }
    if (tips_.size() == kMostTips) tips_.pop_front();
    tips_.push_back({p, edge.left, edge.right, found});
    return found;
  }

  // The least and the largest angle that the sheets on the edge's two sides make closer than
  // `radius` to p; none if anything else is there.
  std::optional<std::pair<double, double>> angles_of_tip(const Point& p, const Edge& edge,
                                                         double radius) {
    if (boxes_.empty()) {
      for (const Triangle& t : triangles_) boxes_.push_back(t.box());
      tree_ = BoxTree(boxes_);
    }
    const Point out = normalized(edge.left + edge.right);
    const Point across = normalized(edge.left - edge.right);
    const Point along = cross(out, across);
    const double infinity = std::numeric_limits<double>::infinity();
    std::array<std::pair<double, double>, 2> leans{{{infinity, -infinity}, {infinity, -infinity}}};
    bool is_tip = true;
    double squared = radius * radius;
    tree_.for_each_within(p, squared, [&](std::uint32_t n) {
      const Point& normal = curvatures_.of(n).normal;
      if (normal == Point{} || squared_distance(triangles_[n], p) >= radius * radius) return;
      const double side = dot(normal, across);
      const double lean = std::atan2(dot(normal, out), std::abs(side));
      auto& [least, largest] = leans[side > 0 ? 0 : 1];
      least = std::min(least, lean);
      largest = std::max(largest, lean);
      is_tip = is_tip && std::abs(dot(normal, along)) < kSkew && 2 * std::abs(lean) < kTip;
      if (!is_tip) squared = 0;
    });
    const double least = leans[0].first + leans[1].first;
    if (!is_tip || !(least > 0)) return std::nullopt;
    return std::pair(least, leans[0].second + leans[1].second);
  }

  // -- Thickness

  void measure_thickness() {
    const Box box = input_.frame.box(input_.leaf);
    for (std::size_t n = 0; n < triangles_.size(); ++n)
      if (triangles_[n].box().overlaps(box)) measure_thickness({triangles_[n].corners}, n);
  }

  void measure_thickness(const Fragment& f, std::size_t n) {
    poll_();
    const auto [edge, squared_length] = longest_edge(f);
    if (!f.box().overlaps(input_.frame.box(input_.leaf))) return;
    const double size =
        std::max(rules_.least, thickness_at(center_of(f), n) / (rules_.layers * kLayer));
    const double length = std::sqrt(squared_length);
    if (length > input_.size || (size < input_.size && length > 1.5 * size)) {
      for (const Fragment& half : halves(f, edge)) measure_thickness(half, n);
      return;
    }
    note(center_of(f), size);
  }

  // Across the inside, to a sheet that is nearly parallel; infinite: none is as near as matters.
  double thickness_at(const Point& p, std::size_t n) {
    constexpr double kOff = 0.02;  // over the least size: from where the surface is crossed
    static const double kFacing = -std::cos(kPi / 180 * kParallel);
    const Point& normal = curvatures_.of(n).normal;
    const double most = rules_.layers * kLayer * input_.size;
    const Point from = p - kOff * rules_.least * normal, to = p - most * normal;
    domain_->crossings(from, to, crossings_);
    for (const Crossing& crossing : crossings_) {
      const auto at = std::ranges::lower_bound(triangles_, crossing.triangle, {}, &Triangle::id);
      const auto other = static_cast<std::size_t>(at - triangles_.begin());
      if (other == n) continue;
      if (dot(normal, curvatures_.of(other).normal) > kFacing) break;
      return norm(crossing.position - p);
    }
    return std::numeric_limits<double>::infinity();
  }

  // -- Sheets that sizes are given for

  double size_of_sheet(SheetId sheet) const {
    return sheet <= rules_.sheet_sizes.size() ? rules_.sheet_sizes[sheet - 1]
                                              : std::numeric_limits<double>::infinity();
  }

  void measure_sheets() {
    std::size_t num_united = 0;
    for (const Triangle& triangle : triangles_) {
      const double size = size_of_sheet(triangle.sheet);
      if (!(size < input_.size)) continue;
      for_each_piece({triangle.corners}, kSheetStep * size, [&](const Fragment& piece) {
        poll_();
        note_as_it_is(center_of(piece), size);
      });
      if (found_.size() < 2 * num_united + 100000) continue;
      unite(found_);
      num_united = found_.size();
    }
  }

  static Point center_of(const Fragment& f) {
    return 1.0 / 3 * (f.corners[0] + f.corners[1] + f.corners[2]);
  }
  double piece_length(std::size_t n) const {
    const double bend = most_curved(curvatures_.of(n).curvature);
    return std::clamp(std::min(size_for_circles(bend), size_for_deviation(bend)), rules_.least,
                      input_.size);
  }
  // None longer than `length`, of what may be around the leaf.
  template <class Visit>
  void for_each_piece(const Fragment& f, double length, const Visit& visit) const {
    if (!f.box().overlaps(around_)) return;
    const auto [edge, squared_length] = longest_edge(f);
    if (squared_length <= length * length) return visit(f);
    for (const Fragment& half : halves(f, edge)) for_each_piece(half, length, visit);
  }

  // No place of a sheet is farther than this from a node that it asks for, over the size.
  static constexpr double kSheetStep = 0.5;
  static constexpr double kSafe = 0.8;
  // Of a size that is asked for, what cells get may be a little more.
  static constexpr double kSafeSize = 0.97;
  // How far the surface is from a sample at most, over the size there.
  static constexpr double kCovered = 0.98;
  static constexpr double kSkew = 0.34;        // sine of how much a tip's sheets lean along it
  static constexpr double kSameSheet = 0.999;  // cosine of normals
  static constexpr std::size_t kMostTips = 16;
  struct Tip {
    Point place, left, right;
    double size = 0;
  };

  static constexpr double kWhole = 0.5;  // of a node's side, squared: enough of the surface in it

  const MeasureInput& input_;
  const SizeRules& rules_;
  const LeafDomain* domain_;
  StopPoll poll_;
  std::span<const Triangle> triangles_;
  Point origin_;  // of places
  int finest_, coarsest_;
  Box around_;  // what is averaged in the leaf's nodes
  Curvatures curvatures_;
  std::vector<std::vector<Sums>> levels_;
  std::size_t num_merged_ = 0;
  std::vector<Crossing> crossings_;
  std::vector<SizedNode> found_;
  std::vector<Box> boxes_;  // of triangles, once a tip is looked at
  BoxTree tree_;
  std::deque<Tip> tips_;  // the last that were found
};

}  // namespace

double measure_reach(const SizeRules& rules, double size) {
  return 1.1 * std::max(1.0, rules.layers * kLayer) * size;
}

std::vector<SizedNode> measure_leaf(MeasureInput input, const StopToken* stop) {
  if (!input.domain.has_surface()) return {};
  if (input.rules.layers == 0)
    return LeafMeasure(input, input.domain.triangles, nullptr, stop).run();
  const LeafDomain domain(std::move(input.domain), stop);
  return LeafMeasure(input, domain.triangles(), &domain, stop).run();
}

double num_pieces_to_measure(const MeasureInput& input, const StopToken* stop) {
  return LeafMeasure(input, input.domain.triangles, nullptr, stop).num_pieces();
}

}  // namespace locvol
