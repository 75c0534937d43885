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
#include "refine/cover_leaf.h"
#include "refine/fragment.h"
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
  explicit Climber(double size) : size_(size) {}

  // From the start, in steps along the axes, shorter and shorter ones.
  Point climb(const Point& start, const PointCubes& points) {
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
    return start + size_ * Point{p[0], p[1], p[2]};
  }

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

  double size_;
  std::vector<Around> around_;
};

class HoleSearch {
 public:
  HoleSearch(const FillInput& input, const SurfacePatch& surface, const StopToken* stop)
      : input_(input),
        surface_(surface),
        core_(input.core),
        stop_(stop),
        size_(input.size),
        half_(0.5 * kLatticeSpacing * size_),
        climber_(size_) {
    find_lattice();
    std::vector<Point> all, samples;
    for (const MeshPoint& p : input.points) {
      all.push_back(p.position);
      if (p.kind == PointKind::kSurface) samples.push_back(p.position);
    }
    mark_sites(all);
    const Box known = input.box.expanded(kFillReach * size_);
    points_.emplace(known, size_, all);
    samples_.emplace(known, size_, samples);
  }

  // The balls of the lattice's cells cover what is deep, so holes lie around the centers of such
  // balls whose cells miss a site. Where all sites are outside, so is the center, but for thin
  // parts without room for a hole.
  FillPoints run() {
    const Box around = input_.box.expanded(kStart * size_);
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
        if (around.contains(center)) search_from(center);
      }
    }
    std::ranges::sort(found_.met_core);
    const auto repeated = std::ranges::unique(found_.met_core);
    found_.met_core.erase(repeated.begin(), repeated.end());
    return std::move(found_);
  }

 private:
  static constexpr double kStart = kFillReach - kSight;  // outside of the leaf

  // From which the cells are looked at, in order. All sites that are outside are marked so.
  std::vector<LatticeSite> sites_near_surface(SiteBlock<std::uint8_t>& is_outside) const {
    constexpr double kFarthest = kLatticeDepth + kLatticeSpacing;  // of a cell that misses a site
    static const double kCircumradius = std::sqrt(5.0) / 4 * kLatticeSpacing;
    const SiteBox corners = is_there_.box().expanded(-2);
    std::vector<LatticeSite> near;
    StopPoll poll(stop_);
    for_each_piece(is_there_.box(), [&](const LatticeRow& row) {
      poll();
      const Point p = place(row.first);
      const auto [is_inside, distance] = surface_.locate(p);
      const bool outside = !is_inside && surface_.region().contains(p);
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

  void search_from(const Point& start) {
    const double radius = kWorthClimbing * size_;
    if (points_->has_in_cube(start, radius) || !surface_.is_inside(start) ||
        !points_->is_free(start, radius))
      return;
    const Point center = climber_.climb(start, *points_);
    if (!is_in_leaf(input_.box, center) || !points_->is_free(center, kHoleRadius * size_) ||
        !surface_.is_inside(center) || !is_deep_enough(center))
      return;
    found_.centers.push_back(center);
    points_->add(center);
    core_.append_met(center, size_, found_.met_core);
  }

  // Like a lattice point.
  bool is_deep_enough(const Point& p) {
    if (!surface_.is_near(p, kLatticeDepth * size_)) return true;
    if (surface_.is_near(p, kLeastLatticeDepth * size_)) return false;
    const double radius = kSampleRadius * size_;
    near_.clear();
    samples_->for_each_around(p, 2 * radius, [&](const Point& q) {
      if (squared_distance(p, q) < 4 * radius * radius) near_.push_back(q);
      return true;
    });
    return is_hidden_from(surface_, p, radius, [&](const Fragment& f) {
      return std::ranges::any_of(near_, [&](const Point& q) { return is_nearer(f, q, p); });
    });
  }

  const FillInput& input_;
  const SurfacePatch& surface_;
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
  const SurfacePatch surface(std::move(input.surface), stop);
  return HoleSearch(input, surface, stop).run();
}

}  // namespace locvol
