// What the size is in each leaf that the domain may meet, where it is not the same everywhere.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/plan/octree_plan.h"
#include "engine/plan/part_sizes.h"
#include "engine/plan/phases.h"
#include "engine/run/leaf_distances.h"
#include "engine/stages/split_leaves.h"
#include "engine/stages/visiting_stage.h"
#include "octree/size_shapes.h"
#include "refine/domain/far_surface.h"
#include "refine/size_leaf.h"

namespace locvol {

auto fields(Maybe<FarPoint> auto& point) {
  auto& [node, place] = point;
  return std::tuple(Field("node", node), Field("place", place));
}

namespace {

constexpr std::uint64_t kBytesPerNode = 250;  // with a size, its tree and what is near it

SizeTotals totals_of(const RunView& run, MortonKey leaf) {
  SizeTotals totals;
  for (const SizeCube& cube : run.leaves().sizes(leaf).cubes)
    totals += size_totals(run.parameters().sizes(), cube, run.box(cube.key));
  // In whole steps, sums of leaves do not depend on their order: below 2^43 cells.
  constexpr double kSteps = 1 << 10;
  const auto in_steps = [](double v) { return std::round(kSteps * v) / kSteps; };
  return {in_steps(totals.of_volume), in_steps(totals.of_area), in_steps(totals.of_lattice),
          in_steps(totals.of_core)};
}

// A list for each of the other ranks; all that come, one after another.
template <class ListFor>
auto swap_with_others(Exchange& exchange, const ListFor& list_for) {
  std::vector<std::invoke_result_t<ListFor, int>> lists;
  for (int rank = 0; rank < exchange.num_ranks(); ++rank) {
    lists.emplace_back();
    if (rank != exchange.rank()) lists.back() = list_for(rank);
  }
  std::invoke_result_t<ListFor, int> all;
  for (const auto& of_rank : swap_lists(exchange, std::move(lists)))
    all.insert(all.end(), of_rank.begin(), of_rank.end());
  return all;
}

class SizeStage : public VisitingStage<SizeInput, std::vector<SizeCube>> {
 public:
  explicit SizeStage(const StageTools& tools)
      : VisitingStage(tools),
        shapes_(state_.parameters().shapes, state_.parameters().growth, state_.frame()),
        body_sizes_(
            sizes_throughout_bodies(state_.parameters(), state_.store().snapshot().sheets())) {}

  std::vector<Step> steps_before() override {
    if (!state_.parameters().has_image()) return {};
    return {
        splitting_rich(tools_, [this](MortonKey leaf) { return share_of_nodes(state_, leaf); })};
  }
  bool has_shared_knowledge() const override { return true; }
  // What stands for the surface while sizes are found, and for what it asks for: of others' what
  // the rank's leaves may ask for, the less, the farther it is. Memory: messages.
  void share_knowledge() override {
    if (far_) return;
    far_.emplace(far_surface());
    Exchange& exchange = tools_.outside_supersteps;
    std::vector<std::vector<Box>> places;
    for (int rank = 0; rank < exchange.num_ranks(); ++rank) {
      auto& boxes = places.emplace_back();
      for (const MortonKey node : state_.ranks().shares().nodes_of(rank))
        boxes.push_back(state_.frame().box(node));
    }
    const auto places_of = [&](int rank) -> const std::vector<Box>& {
      return places[static_cast<std::size_t>(rank)];
    };
    far_->add_told(
        swap_with_others(exchange, [&](int rank) { return far_->seen_from(places_of(rank)); }));
    if (state_.parameters().has_nodes()) {
      told_nodes_ =
          swap_with_others(exchange, [&](int rank) { return nodes_seen_from(places_of(rank)); });
      unite(told_nodes_);
    }
    tools_.budget.keep(far_->bytes());
  }

  bool changes_others() const override { return false; }
  double conflict_distance(MortonKey) const override { return kNoConflict; }

  std::vector<Step> steps_after() override {
    const auto all = [this] {
      far_.reset();
      const auto leaves = state_.octree().leaves();
      return std::vector<MortonKey>(leaves.begin(), leaves.end());
    };
    return {splitting(tools_, all, [this](MortonKey leaf) { return is_to_be_full(leaf); })};
  }

  Phase end() override {
    SizeTotals own, all;
    for (const MortonKey leaf : state_.octree().leaves()) {
      throw_if_stopped(&tools_.stop);
      if (state_.is_own(leaf)) own += totals_of(state_, leaf);
      state_.leaves().trim();
    }
    for (const auto& of_rank : gather_values(
             tools_.exchange, std::vector{own.of_volume, own.of_area, own.of_lattice, own.of_core}))
      all += {of_rank.at(0), of_rank.at(1), of_rank.at(2), of_rank.at(3)};
    state_.note_sizes(all);
    return next_phase(state_.run(), Phase::kSize);
  }

 protected:
  Loaded<SizeInput> load_input(MortonKey leaf) override {
    const RunParameters& parameters = state_.parameters();
    const Box box = state_.box(leaf);
    const std::span<const SizeShape> shapes = shapes_.in(leaf);
    double most = std::min(state_.size(), size_bounds(shapes, parameters.growth, box).most);
    std::vector<SizedNode> nodes;
    if (parameters.has_nodes()) {
      const double diagonal = norm(box.max - box.min);
      const double deepest =
          state_.leaves().info(leaf).has_surface()
              ? diagonal
              : far_->around(box).distance(box.center(), std::numeric_limits<double>::max()) +
                    0.5 * diagonal;
      nodes = nodes_around(leaf, deepest);
      for (const SizedNode& node : nodes)
        most = std::min(
            most, node.size + parameters.growth * state_.frame().box(node.key).most_distance(box));
    }
    const double distance = kExactDistance * most;
    DomainPiece domain = around_.domain(leaf, distance, fineness(kFinenessOfCover, most));
    const VisitSize visit{
        .volume = domain.has_surface() ? volume_over_size(domain.region, most) : 0,
        .num_points = 0,
        .surface_size = domain.surface_size()};
    return {.bytes = visit.bytes_to_cover() + shapes.size() * sizeof(SizeShape) +
                     kBytesPerNode * nodes.size(),
            .input = {.law = parameters.sizes(),
                      .exact_distance = distance,
                      .frame = state_.frame(),
                      .leaf = leaf,
                      .domain = std::move(domain),
                      .shapes = {shapes.begin(), shapes.end()},
                      .nodes = std::move(nodes),
                      .body_sizes = body_sizes_}};
  }

  std::vector<SizeCube> compute(SizeInput&& input) const override {
    return size_leaf(std::move(input), *far_, &tools_.stop);
  }

  void apply_result(MortonKey leaf, const std::vector<SizeCube>& cubes) override {
    state_.queue().dequeue(leaf);
    state_.records().put_sizes(leaf, {.cubes = cubes, .nodes = state_.leaves().sizes(leaf).nodes});
    state_.queue().enqueue(leaf);
  }

 private:
  // Of the rank's own leaves.
  FarSurface far_surface() {
    FarSurface far(state_.frame());
    for (const MortonKey leaf : state_.octree().leaves()) {
      throw_if_stopped(&tools_.stop);
      state_.leaves().trim();
      if (state_.leaves().info(leaf).has_surface() && state_.is_own(leaf))
        far.add(leaf, state_.leaves().surface(leaf));
    }
    far.finish();
    return far;
  }

  // What the surface in the rank's own leaves, or an image, asks for, with as much detail as
  // matters in these boxes.
  std::vector<SizedNode> nodes_seen_from(std::span<const Box> places) {
    constexpr std::size_t kFewNodes = 10000;
    std::vector<SizedNode> nodes;
    std::size_t num_united = 0;
    for (const MortonKey leaf : state_.octree().leaves()) {
      if (!state_.is_own(leaf)) continue;
      for (const SizedNode& node : state_.leaves().sizes(leaf).nodes)
        nodes.push_back(seen_from(places, node));
      state_.leaves().trim();
      if (nodes.size() > 2 * num_united + kFewNodes) {
        unite(nodes);
        num_united = nodes.size();
      }
    }
    unite(nodes);
    return nodes;
  }

  // The node, or the largest one that it lies in whose side is small over its distance: what that
  // is does not depend on which of those between them is known.
  SizedNode seen_from(std::span<const Box> places, SizedNode node) const {
    constexpr double kDetail = 0.05;  // sides of nodes, over their distance
    const Frame& frame = state_.frame();
    while (node.key.level() > 0) {
      const MortonKey above = node.key.parent();
      const Box box = frame.box(above);
      const double side = frame.side(above.level()) / kDetail;
      if (std::ranges::any_of(
              places, [&](const Box& place) { return place.squared_distance(box) < side * side; }))
        break;
      node.key = above;
    }
    return node;
  }

  // What the surface asks for that may matter in the leaf, which is no deeper below it than
  // `deepest`; with less detail where that is far. At a place at the depth d, a node on the surface
  // at the distance D >= d matters if s + g D < λ + g d.
  std::vector<SizedNode> nodes_around(MortonKey leaf, double deepest) {
    constexpr double kWidest = 1.1;  // of what seen_from() makes of a node, the way across
    const RunParameters& p = state_.parameters();
    const Frame& frame = state_.frame();
    const Box box = state_.box(leaf);
    const double farthest = deepest + (p.size - p.sizes().least) / p.growth;
    std::vector<SizedNode> nodes;
    const auto take = [&](const SizedNode& node) {
      const SizedNode seen = seen_from({&box, 1}, node);
      if (box.squared_distance(frame.box(seen.key)) <= farthest * farthest) nodes.push_back(seen);
    };
    for (const MortonKey other : state_.octree().leaves_within(frame, box, kWidest * farthest)) {
      throw_if_stopped(&tools_.stop);
      if (!state_.is_own(other)) continue;
      if (!state_.leaves().info(other).has_surface() && !p.has_image()) continue;
      for (const SizedNode& node : state_.leaves().sizes(other).nodes) take(node);
      state_.leaves().trim();
    }
    for (const SizedNode& node : told_nodes_) take(node);
    unite(nodes);
    return nodes;
  }

  // Will the leaf have more points than it is meant to, or much smaller cells somewhere than leaves
  // so wide are made for? Measured: 0.75 to h³ inside, and as many to h² of a cube's side where the
  // surface passes through.
  bool is_to_be_full(MortonKey leaf) {
    const RunParameters& parameters = state_.parameters();
    const SizeLaw law = parameters.sizes();
    const std::vector<SizeCube>& cubes = state_.leaves().sizes(leaf).cubes;
    if (!law.has_shapes() || cubes.empty() || leaf.level() == MortonKey::kMaxLevel) return false;
    constexpr double kPoints = 0.75;
    const Frame& frame = state_.frame();
    // Grids are as fine in all of it as it takes somewhere.
    const double widest = 1.001 * start_leaf_side(parameters) / parameters.size;
    if (frame.side(leaf.level()) > widest * state_.least_size(leaf)) return true;
    double num_points = 0;
    for (const SizeCube& cube : cubes) {
      const auto [nearest, farthest] = std::ranges::minmax(cube.distance);
      if (farthest < 0 || is_of_core(law, cube)) continue;
      const Box box = frame.box(cube.key);
      const double side = std::min(frame.side(cube.key.level()),
                                   frame.side(leaf.level()));  // may be split below it
      const double over_size = side / size_in(law, cube, box, box.center());
      num_points += kPoints * (nearest > 0 ? over_size : 1) * over_size * over_size;
    }
    return num_points > static_cast<double>(parameters.leaf_capacity);
  }

  ShapesOfNodes shapes_;
  const std::vector<double> body_sizes_;
  std::optional<FarSurface> far_;
  std::vector<SizedNode> told_nodes_;  // by other ranks
};

}  // namespace

std::unique_ptr<LeafStage> size_stage(const StageTools& tools) {
  return std::make_unique<SizeStage>(tools);
}

}  // namespace locvol
