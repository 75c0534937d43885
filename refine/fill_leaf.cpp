#include "refine/fill_leaf.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "octree/site_block.h"
#include "octree/sort_and_unite.h"
#include "refine/cover_leaf.h"
#include "refine/domain/fragment.h"
#include "refine/leaf.h"
#include "refine/point_cubes.h"

namespace locvol {
namespace {

// Over λ.
constexpr double kHoleRadius = 0.985;    // at least; the lattice's own are smaller
constexpr double kWorthClimbing = 0.87;  // from a place this far from all points
constexpr double kSight = 1.65;          // of a climb: it knows the points around its start
constexpr float kFirstStep = 0.25F, kLastStep = 0.03F;
constexpr int kStepsOfALength = 4;

// Finds places that are farther from all points near than the places around them. Single precision
// will do: what is found is looked at again, and twice as many points are looked at at once.
class Climber {
 public:
  // From the start, in steps along the axes, shorter and shorter ones. `size`: λ there
  Point climb(const Point& start, double size, const PointCubes& points) {
    size_ = size;
    look_around(start, points);
    Place p{0, 0, 0};
    float highest = heights_around(p, 0).front();
    for (float step = kFirstStep; step > kLastStep; step *= 0.5F)
      for (int n = 0; n < kStepsOfALength; ++n) {
        const std::array<float, 6> heights = heights_around(p, step);
        const auto best = std::ranges::max_element(heights);
        if (*best <= highest) break;
        highest = *best;
        const auto way = static_cast<std::size_t>(best - heights.begin());
        p[way / 2] += way % 2 == 0 ? -step : step;
      }
    height_ = std::sqrt(highest);
    return start + size_ * Point{p[0], p[1], p[2]};
  }
  // Of the place that was climbed to last: how far it is from all points, over the size at the
  // start; about.
  double height() const { return static_cast<double>(height_); }

 private:
  using Place = std::array<float, 3>;  // from the start, over λ
  static constexpr std::size_t kLanes = 4;
  using Lanes [[gnu::vector_size(kLanes * sizeof(float))]] = float;
  struct Around {  // some points, side by side
    Lanes x, y, z;
  };

  void look_around(const Point& start, const PointCubes& points) {
    constexpr float kFar = 1e6F;
    const double sight = kSight * size_;
    around_.clear();
    std::size_t lane = kLanes;
    points.for_each_around(start, sight, [&](const Point& q) {
      if (squared_distance(start, q) >= sight * sight) return true;
      if (lane == kLanes) {
        around_.push_back({Lanes{} + kFar, Lanes{} + kFar, Lanes{} + kFar});
        lane = 0;
      }
      const Point p = 1 / size_ * (q - start);
      around_.back().x[lane] = static_cast<float>(p.x);
      around_.back().y[lane] = static_cast<float>(p.y);
      around_.back().z[lane] = static_cast<float>(p.z);
      ++lane;
      return true;
    });
  }

  static float least_of(const Lanes& v) { return std::min({v[0], v[1], v[2], v[3]}); }

  // The squared distance to the nearest point a step before and after p, along x, y and z: a step s
  // changes the square of a distance by s² ± 2 s times its part along the axis.
  std::array<float, 6> heights_around(const Place& p, float step) const {
    std::array<Lanes, 6> least;
    least.fill(Lanes{} + std::numeric_limits<float>::infinity());
    for (const Around& q : around_) {
      const Lanes dx = q.x - p[0], dy = q.y - p[1], dz = q.z - p[2];
      const Lanes d = dx * dx + dy * dy + dz * dz;
      const auto take_in = [&](std::size_t axis, const Lanes& along) {
        const Lanes before = d + along, after = d - along;
        Lanes &first = least[2 * axis], &second = least[2 * axis + 1];
        first = before < first ? before : first;
        second = after < second ? after : second;
      };
      take_in(0, 2 * step * dx);
      take_in(1, 2 * step * dy);
      take_in(2, 2 * step * dz);
    }
    std::array<float, 6> heights{};
    for (std::size_t way = 0; way < 6; ++way) heights[way] = least_of(least[way]) + step * step;
    return heights;
  }

  double size_ = 0;
  float height_ = 0;
  std::vector<Around> around_;
};

class HoleSearch {
 public:
  HoleSearch(const FillInput& input, const LeafDomain& domain, const SizeField& sizes,
             const StopToken* stop)
      : input_(input),
        domain_(domain),
        sizes_(sizes),
        core_(input.core),
        stop_(stop),
        size_(input.size),
        half_(0.5 * kLatticeSpacing * size_) {
    std::vector<Point> all, samples;
    for (const MeshPoint& p : input.points) {
      all.push_back(p.position);
      if (is_on_surface(p.kind)) samples.push_back(p.position);
    }
    if (sizes.is_uniform()) {
      find_lattice();
      mark_sites(all);
    } else {
      add_border_of_core(all);
    }
    Box known = input.box;
    for (const Point& p : all) known = known.joined(p);
    const double side = std::min(size_, sizes.least());
    points_.emplace(known, side, kMostCubes, all);
    samples_.emplace(known, side, kMostCubes, samples);
  }

  FillPoints run() { return sizes_.is_uniform() ? search_lattice() : search_cubes(); }

 private:
  static constexpr double kStart = kFillReach - kSight;  // outside of the leaf
  static constexpr double kMostCubes = 128;              // in a row

  // The balls of the lattice's cells cover what is deep, so holes lie around the centers of such
  // balls whose cells miss a site. Where all sites are outside, so is the center, but for thin
  // parts without room for a hole.
  FillPoints search_lattice() {
    const Box around = input_.box.expanded(kStart * size_);
    const Pass pass{kHoleRadius, kWorthClimbing, kWorthClimbing};
    SiteBlock<std::uint8_t> is_outside(is_there_.box(), 0);
    StopPoll poll(stop_, 8);
    for (const LatticeSite& site : sites_near_surface(is_outside)) {
      poll();
      const Point corner = place(site);
      for (const auto& [b, c, d] : kLatticeCells) {
        if (is_there_[site] && is_there_[site + b] && is_there_[site + c] && is_there_[site + d])
          continue;
        if (is_outside[site] && is_outside[site + b] && is_outside[site + c] &&
            is_outside[site + d])
          continue;
        const LatticeSite sum = b + c + d;
        const Point center =
            corner + 0.25 * half_ * Point{double(sum.i), double(sum.j), double(sum.k)};
        if (!around.contains(center)) continue;
        Start start{center, size_};
        search_from(start, pass);
      }
    }
    return found();
  }

  // A place where a climb may begin, and what is known of it.
  struct Start {
    Point point;
    double size = 0;                                        // h there
    std::optional<bool> is_inside = {};                     // once it was asked
    double hole = std::numeric_limits<double>::infinity();  // no larger one is found from there
  };
  // A search from many starts. All lengths are over h.
  struct Pass {
    double hole_radius = 0;  // of holes that are filled, at least
    double worth = 0;        // of a start: its distance from all points, at least
    double worth_later = 0;  // the same in the last pass
  };

  // Where sizes vary, the lattice has no sites in small cubes. There all points are centers of
  // holes, and fewer will do if the largest holes come first.
  FillPoints search_cubes() {
    constexpr double kWorth = 0.72;  // of a start, over the hole's radius
    constexpr std::array kHoleRadii{1.3, 1.12, 1.0};
    StopPoll poll(stop_, 8);
    std::vector<Start> starts = starts_in_cubes();
    for (const double radius : kHoleRadii) {
      const Pass pass{radius, kWorth * radius, kWorth * kHoleRadii.back()};
      std::erase_if(starts, [&](Start& start) {
        poll();
        return start.hole >= radius && !search_from(start, pass);
      });
    }
    return found();
  }

  FillPoints found() {
    sort_and_unite(found_.met_core);
    return std::move(found_);
  }
  // In small cubes and in those beside them, in Morton order: of each its lowest corner, and the
  // middles of the faces there. These are a quarter of a side from where balls of the lattice's
  // cells would be centered, and no two cubes have the same.
  std::vector<Start> starts_in_cubes() const {
    std::vector<Start> starts;
    const Frame& frame = input_.sizes.frame;
    const SizeLaw& law = input_.sizes.law;
    for (const SizeCube& cube : input_.sizes.cubes) {
      const Box box = frame.box(cube.key);
      const double side = box.max.x - box.min.x;
      const auto [nearest, farthest] = std::ranges::minmax(cube.distance);
      constexpr double kBesideSmall = 2.5;  // sides are powers of two of one another
      const bool is_among_lattice =
          law.has_core() ? is_saturated(law, cube, (kLatticeMargin + 1) * law.most + side)
                         : side > kBesideSmall * kLeastCube * base_size(law, cube);
      if (farthest < 0 || (is_among_lattice && nearest > 0)) continue;
      const double distance = kStart * largest_size(law, cube);
      if (input_.box.squared_distance(box) > distance * distance) continue;
      const double half = 0.5 * side;
      for (const Point& step :
           {Point{0, 0, 0}, {0, half, half}, {half, 0, half}, {half, half, 0}}) {
        const Point p = box.min + step;
        // All of the lattice is there as far as its balls reach.
        if (law.has_core() && sizes_.room(p) >= (kLatticeMargin + 1) * law.growth * law.most)
          continue;
        const double size = size_in(law, cube, box, p), nearly = kStart * size;
        if (input_.box.squared_distance(p) <= nearly * nearly) starts.push_back({p, size});
      }
    }
    return starts;
  }

  // From which the cells are looked at, in order. All sites that are outside are marked so.
  std::vector<LatticeSite> sites_near_surface(SiteBlock<std::uint8_t>& is_outside) const {
    constexpr double kFarthest = kSampleRadius + kLatticeSpacing;  // of a cell that misses a site
    static const double kCircumradius = std::sqrt(5.0) / 4 * kLatticeSpacing;
    const SiteBox corners = is_there_.box().expanded(-2);
    std::vector<LatticeSite> near;
    StopPoll poll(stop_);
    for_each_piece(is_there_.box(), [&](const LatticeRow& row) {
      poll();
      const Point p = place(row.first);
      const LeafDomain::Location location = domain_.locate(p);
      const double distance = location.distance_bound;
      const bool outside = location.label() == kNoBody;
      const bool is_far = distance > kFarthest * size_;
      const std::uint32_t num = is_far ? num_within(distance - kFarthest * size_, row) : 1;
      if (outside)
        for (std::uint32_t n = 0; n < num; ++n)
          is_outside[row.first + LatticeSite{0, 0, 2 * static_cast<std::int32_t>(n)}] = 1;
      if (!is_far && !(outside && distance > kCircumradius * size_) && corners.contains(row.first))
        near.push_back(row.first);
      return num;
    });
    return near;
  }
  // The sites at the row's beginning that are within `distance` of its first.
  std::uint32_t num_within(double distance, const LatticeRow& row) const {
    return 1 + static_cast<std::uint32_t>(std::min(distance / (2 * half_), row.count - 1.0));
  }
  // But for the displacement, which does not matter here.
  Point place(const LatticeSite& s) const {
    return origin_ + half_ * Point{double(s.i), double(s.j), double(s.k)};
  }

  // Its points tell where it lies. Without any, all places are as good.
  void find_lattice() {
    origin_ = input_.box.min;
    const auto known = std::ranges::find_if(input_.points, has_site);
    if (known != input_.points.end())
      origin_ = known->position - (place(site_of(known->id)) - origin_);
  }

  // Appends points of the core that are not among others of it: where sizes vary.
  void add_border_of_core(std::vector<Point>& all) const {
    const Lattice& lattice = input_.core.lattice;
    for (const auto& [first, count, body] : input_.core.rows)
      for (std::int32_t n = 0; n < static_cast<std::int32_t>(count); ++n) {
        const LatticeSite site = first + LatticeSite{0, 0, 2 * n};
        const bool is_among_core = std::ranges::all_of(
            kLatticeNeighbors,
            [&](const LatticeSite& step) { return core_.contains(site + step); });
        if (!is_among_core) all.push_back(lattice.undisplaced(site));
      }
  }

  // Appends points of the core that matter.
  void mark_sites(std::vector<Point>& all) {
    const Point low = (1 / half_) * (input_.box.min - origin_);
    const Point high = (1 / half_) * (input_.box.max - origin_);
    const auto below = [](double v) { return static_cast<std::int32_t>(std::floor(v)); };
    const SiteBox sites{{below(low.x), below(low.y), below(low.z)},
                        {below(high.x) + 2, below(high.y) + 2, below(high.z) + 2}};
    is_there_ = {sites.expanded(3), 0};
    for (const MeshPoint& p : input_.points)
      if (has_site(p) && is_there_.box().contains(site_of(p.id))) is_there_[site_of(p.id)] = 1;
    if (core_.is_empty()) return;
    const SiteBox known = is_there_.box(), inner = known.expanded(-2);
    SiteBlock<std::uint8_t> is_core(known, 0);
    for_each_site(known, [&](const LatticeSite& site) {
      if (core_.contains(site)) is_core[site] = is_there_[site] = 1;
    });
    for_each_site(known, [&](const LatticeSite& site) {
      if (!is_core[site]) return;
      const bool is_among_core =
          std::ranges::all_of(kLatticeNeighbors, [&](const LatticeSite& step) {
            return inner.contains(site) ? is_core[site + step] != 0 : core_.contains(site + step);
          });
      // Others are not the nearest to any place outside.
      if (!is_among_core) all.push_back(place(site));
    });
  }

  // Climbs from the start, and fills the hole that is there. Returns whether a later pass may find
  // one: points only get more.
  bool search_from(Start& start, const Pass& pass) {
    const double least = pass.worth_later * start.size, worth = pass.worth * start.size;
    if (points_->has_in_cube(start.point, least)) return false;
    if (!start.is_inside) start.is_inside = is_in_body(domain_.label(start.point));
    if (!*start.is_inside) return false;
    const double squared = points_->squared_clearance(start.point, least, worth);
    if (squared < worth * worth) return squared >= least * least;
    const Point center = climber_.climb(start.point, start.size, *points_);
    const double size = sizes_.at(center);
    start.hole = climber_.height() * start.size / size;
    if (!is_in_leaf(input_.box, center) || !points_->is_free(center, pass.hole_radius * size) ||
        (!sizes_.is_uniform() && core_.has_within(center, size)) ||
        !is_in_body(domain_.label(center)) || !is_deep_enough(center))
      return true;
    found_.centers.push_back(center);
    points_->add(center);
    core_.append_met(center, found_.met_core);
    return true;
  }

  // Like a lattice point.
  bool is_deep_enough(const Point& p) {
    const double radius = sample_radius_from(sizes_, size_, p);
    if (!domain_.is_near(p, radius)) return true;
    const double least =
        kLeastLatticeDepth * (sizes_.has_shapes() ? sizes_.on_surface_at(p) : size_);
    if (domain_.is_near(p, least)) return false;
    near_.clear();
    samples_->for_each_around(p, 2 * radius, [&](const Point& q) {
      if (squared_distance(p, q) < 4 * radius * radius) near_.push_back(q);
      return true;
    });
    return is_hidden_from(domain_, p, radius, [&](const Fragment& f) {
      return std::ranges::any_of(near_, [&](const Point& q) { return is_nearer(f, q, p); });
    });
  }

  const FillInput& input_;
  const LeafDomain& domain_;
  const SizeField& sizes_;
  const CoreIndex core_;
  const StopToken* stop_;
  const double size_, half_;                    // λ; half of the lattice's spacing
  Point origin_;                                // of the lattice
  std::optional<PointCubes> points_, samples_;  // of P; of these, the ones on the surface
  std::vector<Point> near_;
  SiteBlock<std::uint8_t> is_there_;  // which sites are points of P
  Climber climber_;
  FillPoints found_;
};

}  // namespace

FillPoints fill_leaf(FillInput input, const StopToken* stop) {
  assert(input.size > 0 && "λ is a length");
  const LeafDomain domain(std::move(input.domain), stop);
  const SizeField sizes =
      input.sizes.cubes.empty() ? SizeField(input.size) : SizeField(input.sizes);
  return HoleSearch(input, domain, sizes, stop).run();
}

}  // namespace locvol
