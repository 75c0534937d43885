#include "refine/crease_leaf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <queue>
#include <span>
#include <utility>

#include "refine/crease_graph.h"
#include "refine/tip_ring.h"

namespace locvol {
namespace {

// Where three creases meet and two of them do so at an acute angle: how far the first points on
// them are, over the step, and the direction of a point on the face between two of them, if there
// is one.
//
// With points at equal distances, the center of the ball through these and the corner may lie
// beyond one of the three faces, for the point across from it is too close to that. A point on the
// face, at the foot of that one, parts the cell there in two, which have their centers inside.
// Where the foot is too near to a crease, the points are not as far as each other, so that the
// center moves.
constexpr double kBeside = 0.25;  // its sine to creases at least, over that between them
struct AtCorner {
  std::array<double, 3> parts{1, 1, 1};
  std::optional<Point> between = std::nullopt;
};
AtCorner at_corner(const std::array<Point, 3>& ways) {
  constexpr double kInside = 0.1;  // of the largest weight
  constexpr double kLeast = 0.75;  // so that none lies in the corner's ball
  // The center is a sum of the directions, with weights that solve a system of three equations.
  const double a = dot(ways[1], ways[2]), b = dot(ways[0], ways[2]), c = dot(ways[0], ways[1]);
  std::array<double, 3> weights{(1 - a) * (1 + a - b - c), (1 - b) * (1 + b - a - c),
                                (1 - c) * (1 + c - a - b)};
  const double most = std::ranges::max(weights);
  const auto least = std::ranges::min_element(weights);
  if (!(most > 0) || *least >= kInside * most) return {};
  const auto from = static_cast<std::size_t>(least - weights.begin());
  const Point &u = ways[(from + 1) % 3], &w = ways[(from + 2) % 3], normal = cross(u, w);
  const Point foot = ways[from] - dot(ways[from], normal) / dot(normal, normal) * normal;
  const double beside = kBeside * norm(foot) * norm(normal);
  if (dot(cross(u, foot), normal) > beside * norm(normal) &&
      dot(cross(foot, w), normal) > beside * norm(normal))
    return {.between = 1 / norm(foot) * foot};
  for (double& weight : weights) weight = std::max(weight, kInside * most);
  std::array<double, 3> parts{weights[0] + c * weights[1] + b * weights[2],
                              c * weights[0] + weights[1] + a * weights[2],
                              b * weights[0] + a * weights[1] + weights[2]};
  const double longest = std::ranges::max(parts);
  if (!(std::ranges::min(parts) >= kLeast * longest)) return {};
  for (double& part : parts) part /= longest;
  return {.parts = parts};
}

bool are_acute(std::span<const Point> ways) {
  for (std::size_t i = 0; i < ways.size(); ++i)
    for (std::size_t j = i + 1; j < ways.size(); ++j)
      if (dot(ways[i], ways[j]) > kAcuteCorner) return true;
  return false;
}

// May what is around the place, up to a distance over λ, lie in the leaf?
bool is_near(const CreaseInput& input, const Point& p, double distance) {
  const double most = distance * input.size;
  return input.box.squared_distance(p) <= most * most;
}

class CreaseSampler {
 public:
  CreaseSampler(const CreaseInput& input, const LeafDomain& domain, const SizeField& sizes,
                const StopToken* stop)
      : input_(input), domain_(domain), sizes_(sizes), graph_(domain), poll_(stop) {
    find_steps();
  }

  std::vector<Point> run() && {
    for (const Point& p : input_.nearby) graph_.add(p, tolerance());
    // Of other leaves' fixed vertices, whether they are there yet or not.
    for (Vertex v = 0; v < graph_.num_vertices(); ++v)
      if (graph_.is_fixed(v) && !graph_.has_point_at(v)) place(graph_.position(v));
    for (const CornerPoint& corner : domain_.corners())
      if (!graph_.vertex_at(corner.position)) place_tip(corner.position);
    for (Vertex v = 0; v < graph_.num_vertices(); ++v)
      if (graph_.is_fixed(v)) place_around(v);
    for (Index i = 0; i < graph_.num_points(); ++i) fill_from(i);
    start_where_none_is();
    return std::move(points_);
  }

 private:
  using Edge = CreaseGraph::Edge;
  using Heading = CreaseGraph::Heading;
  using Index = CreaseGraph::Index;
  using Place = CreaseGraph::Place;
  using Vertex = CreaseGraph::Vertex;

  // Part of a way along creases. `measure`: of the way to its end, in steps
  struct Part {
    Edge edge = 0;
    double from = 0, to = 0;  // along the edge
    double measure = 0;
  };
  struct Way {
    std::vector<Part> parts;
    Index end = CreaseGraph::kNone;  // none: it leads out of what is known, or of the leaf's reach
    double measure() const { return parts.empty() ? 0 : parts.back().measure; }
  };

  // In steps, of a way that is taken in one.
  static constexpr double kMostSteps = kLongestStep / kCreaseStep;
  static constexpr double kLeastRing = 4;  // radius, over the spacing floor
  // Over the step: how much of a crease is left at least beyond the first point on it.
  static constexpr double kLeastRest = 0.5;
  // How far from the leaf, over λ, there may be a corner with points around it that matter.
  static constexpr double kRingReach = 2.5 * kCreaseStep;

  double tolerance() const { return kOffCrease * input_.size; }
  bool is_own(const Point& p) const { return is_in_leaf(input_.box, p); }
  double most_step(const Point& p) const { return kCreaseStep * sizes_.on_surface_at(p); }

  // ---- Steps

  // A fixed vertex' first steps: all of its creases that end near it are of whole steps.
  double first_step(Vertex v) const {
    double step = most_step(graph_.position(v));
    for (const Edge e : graph_.edges_at(v)) {
      double length = 0;
      std::optional<Heading> heading = graph_.into(e, v);
      while (heading && length < 2 * step) {
        length += graph_.length(heading->from.edge);
        const Vertex next = heading->next(graph_);
        if (graph_.is_fixed(next)) {
          if (length < 2 * step)
            step = std::min(step, length > kMostSteps * step ? 0.5 * length : length);
          break;
        }
        heading = graph_.past(*heading);
      }
    }
    return step;
  }

  // At each vertex, the length that steps may have: they change by kCreaseGrowth.
  void find_steps() {
    step_at_.assign(graph_.num_vertices(), std::numeric_limits<double>::infinity());
    using Entry = std::pair<double, Vertex>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
    const auto offer = [&](Vertex v, double step) {
      if (step >= step_at_[v]) return;
      step_at_[v] = step;
      queue.emplace(step, v);
    };
    for (Vertex v = 0; v < graph_.num_vertices(); ++v)
      offer(v, graph_.is_fixed(v) ? first_step(v) : most_step(graph_.position(v)));
    while (!queue.empty()) {
      const auto [step, v] = queue.top();
      queue.pop();
      if (step > step_at_[v]) continue;
      for (const Edge e : graph_.edges_at(v))
        offer(graph_.ends(e)[graph_.ends(e)[0] == v], step + kCreaseGrowth * graph_.length(e));
    }
    // So that no step turns too far, edges count by how the crease turns at their ends.
    most_on_.reserve(graph_.edges().size());
    for (Edge e = 0; e < graph_.edges().size(); ++e) {
      const auto turn_at = [&](Vertex v) { return graph_.is_fixed(v) ? 0 : graph_.turn(v); };
      const double turn = 0.5 * (turn_at(graph_.ends(e)[0]) + turn_at(graph_.ends(e)[1]));
      constexpr double kMost = kMostTurn * std::numbers::pi / 180;
      most_on_.push_back(turn > 0 ? kMost / turn * graph_.length(e)
                                  : std::numeric_limits<double>::infinity());
    }
  }

  double step_at(const Place& place) const {
    const auto& [a, b] = graph_.ends(place.edge);
    const double beyond = graph_.length(place.edge) - place.along;
    return std::min({most_on_[place.edge], step_at_[a] + kCreaseGrowth * place.along,
                     step_at_[b] + kCreaseGrowth * beyond, most_step(graph_.position(place))});
  }

  // ---- Ways

  // From a place up to the next point, but no farther than a step out of the leaf.
  Way way_along(const Heading& start) {
    Way way;
    double measure = 0, outside = 0;
    std::optional<Heading> heading = start;
    // A crease has no more edges; one that is closed comes back to its point, or to its start.
    for (std::size_t n = 0; heading && n <= graph_.edges().size(); ++n) {
      poll_();
      const Edge edge = heading->from.edge;
      const Index next = graph_.next_on_edge(*heading);
      const double sign = heading->is_forward ? 1 : -1;
      const double end = next != CreaseGraph::kNone ? graph_.place(next).along
                         : heading->is_forward      ? graph_.length(edge)
                                                    : 0;
      for (double at = heading->from.along; sign * (end - at) > 0;) {
        constexpr double kPart = 0.125;  // of a step
        const double step = step_at({edge, at});
        const double length = std::min(sign * (end - at), kPart * step);
        const double to = length < sign * (end - at) ? at + sign * length : end;
        const double middle = step_at({edge, 0.5 * (at + to)});
        measure += length / middle;
        way.parts.push_back({edge, at, to, measure});
        if (is_own(graph_.position({edge, to})))
          outside = 0;
        else
          outside += length / middle;
        if (outside > 1.5) return way;
        at = to;
      }
      if (next != CreaseGraph::kNone) {
        way.end = next;
        return way;
      }
      const Vertex v = heading->next(graph_);
      if (graph_.has_point_at(v)) {
        way.end = graph_.point_at(v);
        return way;
      }
      heading = graph_.past(*heading);
    }
    return way;
  }

  Place place_at(const Way& way, double measure) const {
    const auto part = std::ranges::lower_bound(way.parts, measure, {}, &Part::measure);
    if (part == way.parts.end()) return {way.parts.back().edge, way.parts.back().to};
    const double before = part == way.parts.begin() ? 0 : (part - 1)->measure;
    const double share =
        part->measure > before ? (measure - before) / (part->measure - before) : 0.0;
    return {part->edge, part->from + share * (part->to - part->from)};
  }

  // ---- Points

  void place(const Point& p) {
    if (!graph_.add(p, tolerance())) return;
    if (is_own(p)) points_.push_back(p);
  }

  // Of a cone, with what is around it.
  void place_tip(const Point& tip) {
    if (is_own(tip)) points_.push_back(tip);
    if (!is_near(input_, tip, kTipRadius)) return;
    const double most = kTipRadius * sizes_.on_surface_at(tip);
    std::ranges::copy_if(ring_around_tip(domain_, tip, most, kLeastRing * domain_.crease_floor()),
                         std::back_inserter(points_), [&](const Point& p) { return is_own(p); });
  }

  // Where creases meet at an acute angle, the first points on them have places that are told by the
  // corner alone: on a sphere through it whose center lies between them, not beyond one of them. So
  // the cells at the corner have their circumcenters on the side that they are on.
  void place_around(Vertex v) {
    const Point& p = graph_.position(v);
    const double step = step_at_[v];
    if (!is_near(input_, p, kRingReach)) return;
    std::vector<Heading> headings;
    std::vector<Point> ways;
    for (const Edge e : graph_.edges_at(v)) {
      if (graph_.is_left_out(e)) continue;
      headings.push_back(graph_.into(e, v));
      const Point there = graph_.position_along(headings.back(), step);
      if (there == p) return;
      ways.push_back((1 / norm(there - p)) * (there - p));
    }
    if (!are_acute(ways)) return;
    AtCorner first;
    if (ways.size() == 3) first = at_corner({ways[0], ways[1], ways[2]});
    for (std::size_t n = 0; n < headings.size(); ++n) {
      const double length = step * (ways.size() == 3 ? first.parts[n] : 1),
                   enough = length + kLeastRest * step;
      if (length_to_next(headings[n], enough) < enough) continue;
      place(graph_.position_along(headings[n], length));
    }
    if (!first.between) return;
    constexpr double kOff = 0.1;  // over the step; a face that bends more is left alone
    const auto between = domain_.closest_to(p + step * *first.between, kOff * step);
    if (!between || !is_own(between->position)) return;
    if (!domain_.closest_on_crease(between->position, 0.9 * kBeside * step))
      points_.push_back(between->position);
  }

  // How far it is along a crease to the next point, or vertex that is fixed, up to a length.
  double length_to_next(const Heading& start, double most) const {
    double along = 0;
    std::optional<Heading> heading = start;
    while (heading && along < most) {
      if (const Index point = graph_.next_on_edge(*heading); point != CreaseGraph::kNone)
        return along + std::abs(graph_.place(point).along - heading->from.along);
      along += heading->left(graph_);
      const Vertex next = heading->next(graph_);
      if (graph_.is_fixed(next) || graph_.has_point_at(next)) return along;
      heading = graph_.past(*heading);
    }
    return heading ? most : along;
  }

  void fill_from(Index i) {
    for (const Heading& heading : graph_.headings(graph_.place(i))) fill(i, heading);
  }

  void fill(Index from, const Heading& heading) {
    constexpr double kSlack = 1e-6;  // rounding does not make one more
    const auto num_steps = [](double measure) {
      return measure <= kMostSteps + kSlack ? 1.0 : std::ceil(measure - kSlack);
    };
    const Way way = way_along(heading);
    if (way.parts.empty()) return;
    if (way.end == CreaseGraph::kNone) {
      // It goes on unknown: whole steps, of which those count that end in the leaf.
      for (double measure = 1; measure <= way.measure(); ++measure)
        place_if_own(place_at(way, measure));
      return;
    }
    const bool is_loop = way.end == from;
    const double num = std::max(num_steps(way.measure()), is_loop ? 3.0 : 1.0);
    for (double k = 1; k < num; ++k) place_if_own(own_place_near(way, k * way.measure() / num));
  }
  void place_if_own(const Place& there) {
    if (const Point p = graph_.position(there); is_own(p)) place(p);
  }

  // What lies in another leaf may have been left to this one, if that has been here before: the
  // closest place in the leaf, less than half a step away, is as good.
  Place own_place_near(const Way& way, double measure) const {
    const Place wanted = place_at(way, measure);
    if (is_own(graph_.position(wanted))) return wanted;
    Place best = wanted;
    double least = 0.5;
    for (const Part& part : way.parts) {
      const double off = std::abs(part.measure - measure);
      if (off >= least || !is_own(graph_.position({part.edge, part.to}))) continue;
      least = off;
      best = {part.edge, part.to};
    }
    return best;
  }

  // Creases in the leaf that have no point yet, nor come to one soon: they are closed, or come from
  // leaves that have not been here.
  void start_where_none_is() {
    for (Edge e = 0; e < graph_.edges().size(); ++e) {
      const CreaseEdge& edge = graph_.edges()[e];
      if (graph_.is_left_out(e) || !edge.box().overlaps(input_.box)) continue;
      // What of it lies in the box, in the middle.
      double low = 0, high = 1;
      const Point way = edge.ends[1] - edge.ends[0];
      for (const int axis : {0, 1, 2}) {
        if (way[axis] == 0) continue;
        double first = (input_.box.min[axis] - edge.ends[0][axis]) / way[axis];
        double last = (input_.box.max[axis] - edge.ends[0][axis]) / way[axis];
        if (first > last) std::swap(first, last);
        low = std::max(low, first), high = std::min(high, last);
      }
      if (low > high) continue;
      const Place middle{e, 0.5 * (low + high) * graph_.length(e)};
      const Point p = graph_.position(middle);
      if (!is_own(p) || graph_.has_point_at(middle)) continue;
      const auto is_near_point = [&](bool is_forward) {
        const Way way_to = way_along({middle, is_forward});
        return way_to.end != CreaseGraph::kNone && way_to.measure() <= 1;
      };
      if (is_near_point(true) || is_near_point(false)) continue;
      const auto index = static_cast<Index>(graph_.num_points());
      place(p);
      for (Index i = index; i < graph_.num_points(); ++i) fill_from(i);
    }
  }

  const CreaseInput& input_;
  const LeafDomain& domain_;
  const SizeField& sizes_;
  CreaseGraph graph_;
  std::vector<double> step_at_;  // of vertices
  std::vector<double> most_on_;  // of edges, for how they turn
  std::vector<Point> points_;
  StopPoll poll_;
};

}  // namespace

bool asks_for_surface(const CreaseInput& input) {
  std::map<Point, std::vector<Point>> ways;  // from corners
  for (const CreaseEdge& edge : input.domain.creases)
    for (const std::size_t k : {0, 1})
      if (edge.is_corner[k] && is_near(input, edge.ends[k], 1)) {
        const Point way = edge.ends[1 - k] - edge.ends[k];
        ways[edge.ends[k]].push_back((1 / norm(way)) * way);
      }
  const bool asks = std::ranges::any_of(ways, [](const auto& corner) {
    return corner.second.size() == 3 && are_acute(corner.second);
  });
  return asks || std::ranges::any_of(input.domain.corners, [&](const CornerPoint& corner) {
           return is_near(input, corner.position, kTipRadius) &&
                  std::ranges::none_of(input.domain.creases, [&](const CreaseEdge& edge) {
                    return edge.ends[0] == corner.position || edge.ends[1] == corner.position;
                  });
         });
}

CreasePoints crease_leaf(CreaseInput input, const StopToken* stop) {
  if (input.domain.creases.empty() && input.domain.corners.empty()) return {};
  const LeafDomain domain(std::move(input.domain), stop);
  const SizeField sizes =
      input.sizes.cubes.empty() ? SizeField(input.size) : SizeField(input.sizes);
  return {CreaseSampler(input, domain, sizes, stop).run()};
}

}  // namespace locvol
