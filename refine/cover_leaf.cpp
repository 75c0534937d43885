#include "refine/cover_leaf.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

#include "octree/mix.h"
#include "octree/sort_and_unite.h"
#include "refine/crease_graph.h"
#include "refine/domain/fragment.h"
#include "refine/mirror.h"
#include "refine/point_cubes.h"

namespace locvol {
namespace {

// ---- Fragments, halved until each lies within one sample's ball

// Where the weights sum to 1. Clamped, so that rounding cannot push it out of a leaf that the
// fragment lies in.
Point combination(const Fragment& f, double u, double v) {
  const auto& [a, b, c] = f.corners;
  return clamped(a + u * (b - a) + v * (c - a), f.box());
}

// Uniform over the fragment.
Point random_point(const Fragment& f) {
  const std::uint64_t bits = mix(~f.key);
  double u = static_cast<double>(bits >> 32) * 0x1p-32;
  double v = static_cast<double>(bits & 0xffffffff) * 0x1p-32;
  if (u + v > 1) {
    u = 1 - u;
    v = 1 - v;
  }
  return combination(f, u, v);
}

// A box in cubes of about `side`, or larger ones where it is very wide, numbered.
class Cubes {
 public:
  Cubes(const Box& box, double side) : low_(box.min) {
    constexpr double kMostOnAxis = 32;
    const Point sides = box.max - box.min;
    for (const int axis : {0, 1, 2}) {
      const double wanted = std::min(std::ceil(sides[axis] / side), kMostOnAxis);
      num_[std::size_t(axis)] = static_cast<std::uint32_t>(wanted);
      inverse_side_[axis] = num_[std::size_t(axis)] / sides[axis];
    }
  }
  std::uint32_t size() const { return num_[0] * num_[1] * num_[2]; }
  // Of the one that holds p, or of the nearest.
  std::uint32_t number(const Point& p) const {
    const auto place = [&](int axis) {
      const double v = (p[axis] - low_[axis]) * inverse_side_[axis];
      return static_cast<std::uint32_t>(std::clamp(v, 0.0, num_[std::size_t(axis)] - 1.0));
    };
    return (place(2) * num_[1] + place(1)) * num_[0] + place(0);
  }

 private:
  Point low_, inverse_side_;
  std::array<std::uint32_t, 3> num_{};
};

// Halved until none is longer than length_at() its first corner, and then cube by cube, so that
// what is near is in the cache, and in a cube in order of key, the priority.
template <class LengthAt>
std::vector<Fragment> by_priority(std::vector<Fragment> fragments, const LengthAt& length_at,
                                  const Cubes& cubes, const StopToken* stop) {
  StopPoll poll(stop);
  for (std::size_t i = 0; i < fragments.size(); ++i)
    while (true) {
      poll();
      const auto [edge, squared_length] = longest_edge(fragments[i]);
      const double length = length_at(fragments[i].corners[0]);
      if (squared_length <= length * length) break;
      const auto [here, there] = halves(fragments[i], edge);
      fragments[i] = here;
      fragments.push_back(there);
    }
  // Keys are hashes, so of a cube's a bucket by their leading bits holds a few. Equal ones (by
  // chance, one leaf in 10⁹) keep the order of the array.
  const auto num_bits = static_cast<int>(std::bit_width(fragments.size() / cubes.size() / 4)) + 1;
  const auto bucket_of = [&](const Fragment& f) {
    return std::uint64_t{cubes.number(f.corners[0])} << num_bits | f.key >> (64 - num_bits);
  };
  // Of buckets, once filled.
  std::vector<std::uint32_t> end((std::size_t{cubes.size()} << num_bits) + 1, 0);
  for (const Fragment& f : fragments) ++end[bucket_of(f) + 1];
  std::partial_sum(end.begin(), end.end(), end.begin());
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(fragments.size());
  for (std::uint32_t place = 0; place < fragments.size(); ++place) {
    const Fragment& f = fragments[place];
    order[end[bucket_of(f)]++] = {f.key, place};
  }
  for (std::size_t bucket = 0, first = 0; bucket + 1 < end.size(); first = end[bucket++])
    std::sort(order.begin() + std::ptrdiff_t(first), order.begin() + end[bucket]);
  std::vector<Fragment> sorted;
  sorted.reserve(fragments.size());
  for (const auto& [key, place] : order) sorted.push_back(fragments[place]);
  return sorted;
}

// ---- Samples

// SampleGrid finds the samples near a point of a box. Each cell lists all samples that are listed
// within a distance that reaches any of its points, so a query reads one cell; there are far more
// queries than samples.
class SampleGrid {
 public:
  // `side`: of its cells, or more.
  SampleGrid(const Box& box, double side);

  // `listed`: at least the radius of any query that it may answer
  void add(const Point& sample, const SurfaceSide& side, double listed);

  // Is no sample of the side closer to p than `spacing`, and none of any at p? REQUIRES: p lies in
  // the closed box
  bool is_free(const Point& p, const SurfaceSide& side, double spacing) const {
    return !any_around(p, [&](const Point& s, std::uint32_t its_side) {
      const double squared = squared_distance(p, s);
      return squared < spacing * spacing && (squared == 0 || are_same(sides_[its_side], side));
    });
  }
  // Is one sample closer to all of the fragment than p? May overlook it where p is farther from its
  // first corner than the radius, or that is not in the closed box.
  bool is_nearer_than(const Point& p, const Fragment& f) const {
    return box_.contains(f.corners[0]) &&
           any_around(f.corners[0],
                      [&](const Point& s, std::uint32_t) { return is_nearer(f, s, p); });
  }
  // Does the fragment lie in the ball of one sample of the side that was added since num_around()
  // was `num_before`? REQUIRES: it lies in the closed box
  bool covers_since(const Fragment& f, const SurfaceSide& side, double radius,
                    std::uint32_t num_before) const {
    const double radius2 = radius * radius;
    const auto covers = [&](const Point& s, std::uint32_t its_side) {
      return squared_distance(f.corners[0], s) <= radius2 &&
             squared_distance(f.corners[1], s) <= radius2 &&
             squared_distance(f.corners[2], s) <= radius2 && are_same(sides_[its_side], side);
    };
    return any_around(f.corners[0], covers, num_before);
  }
  // Of samples that may cover the fragment: they only get more.
  std::uint32_t num_around(const Fragment& f) const {
    const std::uint32_t first = first_[index(cell_of(f.corners[0]))];
    return first == kNone ? 0 : blocks_[first].num_before + blocks_[first].num;
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  struct Block {  // of a cell's list of samples
    static constexpr std::uint32_t kSize = 8;
    std::uint32_t num = 0, num_before = 0;  // in this block, and in the next ones
    std::uint32_t next = kNone;
    std::array<Point, kSize> samples;
    std::array<std::uint32_t, kSize> sides;  // places in sides_
  };
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  // Monotone in each coordinate. Of a point of the box: a cell of the grid.
  Cell cell_of(const Point& p) const;
  std::size_t index(const Cell& c) const {
    return static_cast<std::size_t>((c[2] * shape_[1] + c[1]) * shape_[0] + c[0]);
  }
  // But for the first `num_before` that were added.
  template <class Test>
  bool any_around(const Point& p, Test test, std::uint32_t num_before = 0) const;

  Box box_;
  double side_;  // of a cell
  Cell shape_;   // cells on each axis
  std::array<std::vector<double>, 3> gaps_;
  std::vector<Block> blocks_;
  std::vector<SurfaceSide> sides_;    // of samples; where all are one side, that
  std::vector<std::uint32_t> first_;  // block of a cell, the one that is not full; or kNone
};

SampleGrid::SampleGrid(const Box& box, double side) : box_(box) {
  constexpr double kMaxShape = 128;  // bounds the memory; in a larger box the cells grow instead
  const Point sides = box.max - box.min;
  side_ = std::max(side, std::max({sides.x, sides.y, sides.z}) / kMaxShape);
  const Cell last = cell_of(box.max);
  shape_ = {last[0] + 1, last[1] + 1, last[2] + 1};
  first_.assign(static_cast<std::size_t>(shape_[0] * shape_[1] * shape_[2]), kNone);
}

// Truncated, not floored: as monotone, and faster. What lies less than a cell below the grid joins
// its first cells, which add() tells apart by distance.
SampleGrid::Cell SampleGrid::cell_of(const Point& p) const {
  const Point c = (1 / side_) * (p - box_.min);
  return {static_cast<std::int64_t>(c.x), static_cast<std::int64_t>(c.y),
          static_cast<std::int64_t>(c.z)};
}

void SampleGrid::add(const Point& sample, const SurfaceSide& side, double listed) {
  const double margin = 1.001 * listed;  // a little for rounding
  if (sides_.empty() || !(sides_.back() == side)) sides_.push_back(side);
  const auto its_side = static_cast<std::uint32_t>(sides_.size() - 1);
  const Box ball_box = Box::around(sample).expanded(margin);
  Cell low = cell_of(ball_box.min), high = cell_of(ball_box.max);
  // How far the sample is from a cell along each axis, squared.
  for (const std::size_t axis : {0, 1, 2}) {
    low[axis] = std::max<std::int64_t>(low[axis], 0);
    high[axis] = std::min(high[axis], shape_[axis] - 1);
    gaps_[axis].clear();
    const double place = sample[static_cast<int>(axis)] - box_.min[static_cast<int>(axis)];
    for (std::int64_t c = low[axis]; c <= high[axis]; ++c) {
      const double above = place - side_ * static_cast<double>(c);
      const double gap = std::max({0.0, -above, above - side_});
      gaps_[axis].push_back(gap * gap);
    }
  }
  const auto gap = [&](std::size_t axis, std::int64_t c) {
    return gaps_[axis][static_cast<std::size_t>(c - low[axis])];
  };
  for (std::int64_t k = low[2]; k <= high[2]; ++k) {
    for (std::int64_t j = low[1]; j <= high[1]; ++j) {
      const double most = margin * margin - gap(2, k) - gap(1, j);
      for (std::int64_t i = low[0]; i <= high[0]; ++i) {
        if (gap(0, i) > most) continue;
        std::uint32_t& first = first_[index({i, j, k})];
        if (first == kNone || blocks_[first].num == Block::kSize) {
          const std::uint32_t num =
              first == kNone ? 0 : blocks_[first].num_before + blocks_[first].num;
          blocks_.push_back({0, num, first, {}, {}});
          first = static_cast<std::uint32_t>(blocks_.size() - 1);
        }
        Block& block = blocks_[first];
        block.sides[block.num] = its_side;
        block.samples[block.num++] = sample;
      }
    }
  }
}

template <class Test>
bool SampleGrid::any_around(const Point& p, Test test, std::uint32_t num_before) const {
  for (std::uint32_t b = first_[index(cell_of(p))]; b != kNone; b = blocks_[b].next) {
    const Block& block = blocks_[b];
    if (block.num_before + block.num <= num_before) return false;
    const std::uint32_t first = num_before > block.num_before ? num_before - block.num_before : 0;
    for (std::uint32_t i = first; i < block.num; ++i)
      if (test(block.samples[i], block.sides[i])) return true;
  }
  return false;
}

// The same for samples that are listed within very different distances: each is in one of several
// grids, with cells about as large.
class SampleGrids {
 public:
  // `least`, `most`: of those distances, about
  SampleGrids(const Box& box, double least, double most) {
    double side = least;
    grids_.emplace_back(box, side);
    while (side < most) grids_.emplace_back(box, side *= 2);
    side_ = least;
  }

  void add(const Point& sample, const SurfaceSide& side, double listed) {
    std::size_t n = 0;
    for (double width = side_; width < listed && n + 1 < grids_.size(); width *= 2) ++n;
    grids_[n].add(sample, side, listed);
  }

  // As in SampleGrid.
  bool is_free(const Point& p, const SurfaceSide& side, double spacing) const {
    return std::ranges::all_of(
        grids_, [&](const SampleGrid& grid) { return grid.is_free(p, side, spacing); });
  }
  bool is_nearer_than(const Point& p, const Fragment& f) const {
    return std::ranges::any_of(grids_,
                               [&](const SampleGrid& grid) { return grid.is_nearer_than(p, f); });
  }
  bool covers(const Fragment& f, const SurfaceSide& side, double radius) const {
    return covers_since(f, side, radius, 0);
  }
  bool covers_since(const Fragment& f, const SurfaceSide& side, double radius,
                    std::uint32_t num_before) const {
    return std::ranges::any_of(grids_, [&](const SampleGrid& grid) {
      return grid.covers_since(f, side, radius, num_before);
    });
  }
  std::uint32_t num_around(const Fragment& f) const {
    return grids_.size() == 1 ? grids_.front().num_around(f) : 0;  // then all are asked again
  }

 private:
  std::vector<SampleGrid> grids_;
  double side_;  // of the first's cells
};

bool are_parallel(const Point& a, const Point& b) {
  constexpr double kCosine = 0.99;
  return std::abs(dot(a, b)) > kCosine * norm(a) * norm(b);
}

bool is_uniform(const CoverInput& input) { return input.sizes.cubes.empty(); }

// A Poisson-disk sample that is maximal but for kSampleSpacing < kSampleRadius, by dart throwing at
// the uncovered fragments, which halve from round to round (after Ebeida and others, "A simple
// algorithm for maximal Poisson-disk sampling", 2012). A fragment as small as the difference is
// covered once its dart fails, for a sample is that close to the dart.
class SurfaceSampler {
 public:
  SurfaceSampler(const CoverInput& input, const LeafDomain& domain, const SizeField& sizes,
                 const StopToken* stop)
      : domain_(domain),
        sizes_(sizes),
        owned_(closed(input.box)),
        size_(input.size),
        spacing_((sizes.is_uniform() ? kSampleSpacing : kGradedSampleSpacing) * size_),
        first_spacing_(sizes.is_uniform() ? spacing_ : kGradedFirstSpacing * size_),
        radius_(sample_radius(sizes.is_uniform()) * size_),
        reach_(input.box.expanded(input.are_sides_apart ? kMirrorDistance * size_ : radius_)),
        grid_(reach_, std::min(1.0, sizes.least() / size_) * farthest_query(), farthest_query()),
        stop_(stop) {
    if (input.are_sides_apart) take_in_creases(input.crease_points);
    for (const Point& sample : input.nearby_samples) add(sample, side_at(sample));
    if (input.are_sides_apart && !domain_.only_body()) go_on_with(input.nearby_samples);
  }

  std::vector<Point> sample(std::vector<Fragment> fragments) {
    const Cubes cubes(owned_, kCubeSide * spacing_);
    double spacing = first_spacing_;
    int num_rounds = 0;
    const auto length_at = [&](const Point& p) { return kFirstLength * scaled(spacing_, p); };
    for (fragments = by_priority(std::move(fragments), length_at, cubes, stop_); !fragments.empty();
         fragments = uncovered_halves(throw_darts(fragments, spacing)))
      if (++num_rounds == kNumFirstRounds) spacing = spacing_;
    return std::move(samples_);
  }

  // As far as samples are known. REQUIRES: p lies in the leaf
  bool is_hidden(const Point& p, const LeafDomain& domain) const {
    return is_hidden_from(domain, p, sample_radius_from(sizes_, size_, p),
                          [&](const Fragment& f) { return grid_.is_nearer_than(p, f); });
  }

 private:
  // ---- Sheets, and sides that face each other, each by itself
  bool are_sides_apart() const { return creases_.has_value(); }
  SurfaceSide side_of(const Fragment& f) const {
    return are_sides_apart() ? SurfaceSide{f.sheet, normal_of(f.corners)} : SurfaceSide();
  }
  SurfaceSide side_at(const Point& sample) const {
    if (!are_sides_apart()) return {};
    const auto closest = domain_.closest_to(sample, size_);
    return closest ? closest->side : SurfaceSide();
  }
  void take_in_creases(std::span<const Point> points);
  bool is_out_of_balls(const Point& p) const;
  // The orbit of a dart, which is a sample of each of its sides, as far as samples may be put.
  // False if there is no room for one of them: they keep `spacing` from those of their sides that
  // are there, and the dart `spacing_in_stack`, where a side that it sees is parallel to its own.
  bool find_mirrors(const Point& dart, const SurfaceSide& side, double spacing,
                    double spacing_in_stack);
  static constexpr double kSameSample = 0.05;  // of the spacing
  bool is_there(const MirrorPoint& mirror, double spacing) const {
    return !grid_.is_free(mirror.position, mirror.side, kSameSample * spacing);
  }
  void add_sample(const MirrorPoint& sample);
  void go_on_with(std::span<const Point> samples);

  // The longer the fewer rounds, and the more darts that could have known better.
  static constexpr double kFirstLength = 1;
  static constexpr int kNumFirstRounds = 2;  // with the first spacing
  // Over the spacing. A cube's samples are a few hundred.
  static constexpr double kCubeSide = 20;

  // Where rounding puts it on a face that belongs to the next leaf, it moves back by one rounding
  // error: else nobody would own the points of a sheet that leans towards the face that little.
  Point aim(const Fragment& f) const { return clamped(random_point(f), owned_); }
  struct Target {
    const Fragment* fragment;
    double radius;             // of samples' balls at all of it
    std::uint32_t num_around;  // that do not cover it
  };
  std::vector<Target> throw_darts(std::span<const Fragment> fragments, double spacing);
  std::vector<Fragment> uncovered_halves(std::span<const Target> targets) const;

  // Of a length where h is as large as it gets on the surface: what it is at p.
  double scaled(double length, const Point& p) const { return scale_at(p) * length; }
  double scale_at(const Point& p) const {
    return sizes_.has_shapes() ? sizes_.on_surface_at(p) / size_ : 1;
  }
  // Of samples' balls at all of the fragment. `scale`: of lengths at a point of it, where a dart
  // that fails covers what is as small as the gap between the radius and the spacing there: between
  // two cubes sizes may jump by more.
  double radius_on(const Fragment& f, double scale) const {
    if (!sizes_.has_shapes()) return radius_;
    const double change = sizes_.growth() * std::sqrt(longest_edge(f).second);
    return radius_ / size_ * std::max(0.0, scale * size_ - change);
  }
  double farthest_query() const { return std::max(radius_, first_spacing_); }
  void add(const Point& sample, const SurfaceSide& side) {
    double listed = farthest_query();
    if (sizes_.has_shapes())
      listed = scaled(listed, sample) / (1 - listed / size_ * sizes_.growth());
    grid_.add(sample, side, listed);
  }

  const LeafDomain& domain_;
  const SizeField& sizes_;
  const Box owned_;
  const double size_;
  const double spacing_, first_spacing_, radius_;
  const Box reach_;   // where samples may be put, or matter
  SampleGrids grid_;  // all samples, nearby ones as well; as far as they are around the leaf
  std::vector<Point> samples_;
  std::optional<CreaseGraph> creases_;  // null: sides are not apart
  struct Ball {
    Point position;
    double radius = 0;
  };
  std::optional<CubesOf<Ball>> balls_;  // of points on creases
  double largest_ball_ = 0;
  std::vector<MirrorPoint> mirrors_;  // of the dart at hand
  const StopToken* stop_;
};

void SurfaceSampler::take_in_creases(std::span<const Point> points) {
  creases_.emplace(domain_);
  std::vector<Ball> balls;
  for (const Point& p : points)
    if (!creases_->add(p, kOffCrease * size_)) add(p, side_at(p));  // the tip of a cone
  std::vector<SheetId> sheets;
  for (CreaseGraph::Index i = 0; i < creases_->num_points(); ++i) {
    creases_->sheets(i, sheets);
    for (const SheetId sheet : sheets) add(creases_->point(i), {sheet});
    balls.push_back({creases_->point(i), creases_->ball_radius(i)});
    largest_ball_ = std::max(largest_ball_, balls.back().radius);
  }
  if (largest_ball_ == 0) return;
  constexpr double kMostCubes = 128;  // in a row: balls may be small for the leaf
  balls_.emplace(domain_.region(), largest_ball_, kMostCubes, balls);
}

bool SurfaceSampler::is_out_of_balls(const Point& p) const {
  if (!balls_) return true;
  return balls_->for_each_around(p, largest_ball_, [&](const Ball& ball) {
    return squared_distance(p, ball.position) >= ball.radius * ball.radius;
  });
}

bool SurfaceSampler::find_mirrors(const Point& dart, const SurfaceSide& side, double spacing,
                                  double spacing_in_stack) {
  const double size = scaled(size_, dart);
  mirrors_.clear();
  bool has_room = true, is_in_stack = false;
  const auto take = [&](const MirrorPoint& mirror, const Point& source) {
    if (has_room && !is_in_stack && source == dart &&
        are_parallel(side.normal, mirror.side.normal)) {
      is_in_stack = true;
      has_room = grid_.is_free(dart, side, spacing_in_stack);
    }
    if (!has_room || !reach_.contains(mirror.position)) return false;
    const bool is_free =
        grid_.is_free(mirror.position, mirror.side, spacing) && is_out_of_balls(mirror.position);
    if (is_free) mirrors_.push_back(mirror);
    has_room = is_free || is_there(mirror, spacing);
    return is_free;
  };
  for_each_in_orbit(domain_, dart, kMirrorReach * size, kMirrorDistance * size, take);
  return has_room;
}

void SurfaceSampler::add_sample(const MirrorPoint& sample) {
  samples_.push_back(sample.position);
  add(sample.position, sample.side);
}

// What is left to this leaf of orbits of samples around it.
void SurfaceSampler::go_on_with(std::span<const Point> samples) {
  SampleGrids followed(reach_, farthest_query(), farthest_query());
  for (const Point& sample : samples) {
    if (!reach_.contains(sample)) continue;
    const double size = scaled(size_, sample), spacing = scaled(first_spacing_, sample);
    const SurfaceSide side = side_at(sample);
    if (!followed.is_free(sample, side, kSameSample * spacing)) continue;
    for_each_in_orbit(domain_, sample, kMirrorReach * size, kMirrorDistance * size,
                      [&](const MirrorPoint& mirror, const Point&) {
                        const auto& [position, its_side] = mirror;
                        if (!reach_.contains(position)) return false;
                        followed.add(position, its_side, spacing);
                        if (owned_.contains(position) && is_out_of_balls(position) &&
                            grid_.is_free(position, its_side, spacing))
                          add_sample(mirror);
                        return true;
                      });
  }
}

// One at each fragment that is not covered when its turn comes. Returns those fragments.
std::vector<SurfaceSampler::Target> SurfaceSampler::throw_darts(std::span<const Fragment> fragments,
                                                                double spacing) {
  std::vector<Target> targets;
  StopPoll poll(stop_);
  const double gap2 = (radius_ - spacing_) * (radius_ - spacing_);
  for (const Fragment& fragment : fragments) {
    poll();
    const Point dart = aim(fragment);
    const double scale = scale_at(dart), radius = radius_on(fragment, scale);
    const SurfaceSide side = side_of(fragment);
    if (grid_.covers(fragment, side, radius)) continue;
    // What is as small as this is covered by a dart alone, or by what is in its way.
    const bool is_small = are_sides_apart() && longest_edge(fragment).second <= gap2;
    const bool is_in_ball = are_sides_apart() && !is_out_of_balls(dart);
    if (is_in_ball && is_small) continue;
    targets.push_back({&fragment, radius, grid_.num_around(fragment)});
    if (is_in_ball || !grid_.is_free(dart, side, scale * spacing)) continue;
    // A leaf that was covered before has each place within the radius of a sample. An orbit through
    // a stack of bodies that has less room would end there.
    const bool may_end = !is_small && !domain_.only_body();
    const double spacing_in_stack = std::max(scale * spacing, may_end ? radius : 0);
    const bool has_room =
        are_sides_apart() && find_mirrors(dart, side, scale * spacing, spacing_in_stack);
    if (are_sides_apart() && !has_room && !is_small) continue;
    if (has_room)
      for (const MirrorPoint& mirror : mirrors_) add_sample(mirror);
    add_sample({dart, side});
  }
  return targets;
}

std::vector<Fragment> SurfaceSampler::uncovered_halves(std::span<const Target> targets) const {
  std::vector<Fragment> result;
  for (const auto& [fragment, radius, num_around] : targets) {
    if (grid_.covers_since(*fragment, side_of(*fragment), radius, num_around)) continue;
    const std::array<Fragment, 2> both = halves(*fragment, longest_edge(*fragment).first);
    result.insert(result.end(), both.begin(), both.end());
  }
  return result;
}

// ---- Lattice

// For a lattice point. REQUIRES: p lies inside
bool is_deep_enough(const CoverInput& input, const SizeField& sizes, const LeafDomain& domain,
                    const SurfaceSampler& sampler, const Point& p) {
  const double least =
      kLeastLatticeDepth * (sizes.has_shapes() ? sizes.on_surface_at(p) : input.size);
  return !domain.is_near(p, sample_radius_from(sizes, input.size, p)) ||
         (!domain.is_near(p, least) && sampler.is_hidden(p, domain));
}

// Where sizes vary, lattice points are centers and corners of cubes.
void cover_with_cubes(const CoverInput& input, const SizeField& sizes, const LeafDomain& domain,
                      const SurfaceSampler& sampler, StopPoll poll, CoverPoints& points) {
  std::vector<LatticeSite>& sites = points.lattice;
  for (const SizeCube& cube : input.sizes.cubes) {
    const double side = input.sizes.frame.side(cube.key.level());
    if (!has_lattice(input.sizes.law, cube, side)) continue;
    for_each_lattice_point(cube, [&](const LatticeSite& site) {
      if (is_in_leaf(input.box, input.lattice.position(site))) sites.push_back(site);
    });
  }
  sort_and_unite(sites);
  std::erase_if(sites, [&](const LatticeSite& site) {
    poll();
    const Point p = input.lattice.position(site);
    return !is_in_body(domain.label(p)) || !is_deep_enough(input, sizes, domain, sampler, p);
  });
}

// Where h grows no more, lattice points are those of its size.
void cover_inside(const CoverInput& input, const SizeField& sizes, const LeafDomain& domain,
                  const SurfaceSampler& sampler, StopPoll poll, CoverPoints& points) {
  const SizeLaw& law = input.sizes.law;
  if (std::ranges::all_of(input.sizes.cubes,
                          [&](const SizeCube& cube) { return is_of_core(law, cube); })) {
    points.core.is_whole = true;
    points.core.body = domain.label(input.box.center()).value_or(kOnlyBody);
    return;
  }
  const double of_one = law.growth * law.most;
  for_each_site(input.lattice.sites_in(input.box), [&](const LatticeSite& site) {
    poll();
    const Point p = input.lattice.position(site);
    const double room = sizes.room(p);
    if (room < kLatticeMargin * of_one) return;
    if (room >= kCoreMargin * of_one)
      add_row({site, 1, domain.label(p).value_or(kOnlyBody)}, points.core);
    else if (is_in_body(domain.label(p)) && is_deep_enough(input, sizes, domain, sampler, p))
      points.lattice.push_back(site);
  });
}

void cover_with_lattice(const CoverInput& input, const SizeField& sizes, const LeafDomain& domain,
                        const SurfaceSampler& sampler, StopPoll poll, CoverPoints& points) {
  // The sites at the row's beginning that are within `distance` of its first, displaced or not.
  const auto num_within = [&](double distance, const LatticeRow& row) {
    constexpr double kSlack = 1.001;
    const double num = distance / (kSlack * input.lattice.spacing());
    return 1 + static_cast<std::uint32_t>(std::clamp(num, 0.0, row.count - 1.0));
  };
  for_each_piece(input.lattice.sites_in(input.box), [&](const LatticeRow& row) {
    poll();
    const LatticeSite& site = row.first;
    const Point p = input.lattice.position(site);
    const LeafDomain::Location location = domain.locate(p);
    const double distance = location.distance_bound;
    const BodyId body = location.label().value_or(kNoBody);
    if (body == kNoBody) return num_within(distance, row);
    if (!domain.is_near(p, kCoreDepth * input.size)) {
      const std::uint32_t num_as_deep = num_within(distance - kCoreDepth * input.size, row);
      add_row({site, num_as_deep, body}, points.core);
      return num_as_deep;
    }
    if (is_deep_enough(input, sizes, domain, sampler, p)) points.lattice.push_back(site);
    return 1U;
  });
}

}  // namespace

CoverPoints cover_leaf(CoverInput input, const StopToken* stop) {
  assert(input.size > 0 && "λ is a length");
  const LeafDomain domain(std::move(input.domain), stop);
  CoverPoints points;
  if (!domain.has_surface() && is_uniform(input)) {
    const BodyId body = domain.label(input.box.center()).value_or(kNoBody);
    points.core.is_whole = body != kNoBody && !input.is_surface_only;
    if (points.core.is_whole) points.core.body = body;
    return points;
  }
  const SizeField sizes = is_uniform(input) ? SizeField(input.size) : SizeField(input.sizes);
  SurfaceSampler sampler(input, domain, sizes, stop);
  points.samples = sampler.sample(fragments_in(input.box, domain, input.seed, stop));
  if (input.is_surface_only) return points;
  const auto cover = is_uniform(input)            ? cover_with_lattice
                     : input.sizes.law.has_core() ? cover_inside
                                                  : cover_with_cubes;
  cover(input, sizes, domain, sampler, StopPoll(stop), points);
  return points;
}

}  // namespace locvol
