#include "engine/stages/split_leaves.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <optional>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/plan/octree_plan.h"
#include "engine/run/core_around.h"
#include "engine/run/leaf_states.h"
#include "engine/shared/input_error.h"
#include "refine/domain/surface_part.h"
#include "refine/size_leaf.h"

namespace locvol {
namespace {

// Its children wait for the epoch that it waited for.
void split_empty_leaf(RunState& state, MortonKey leaf) {
  const auto queued = state.leaves().info(leaf).queued;
  split_leaf(state, leaf);
  if (!queued) return;
  for (int octant = 0; octant < 8; ++octant) {
    if (state.leaves().info(leaf.child(octant)).meets_domain())
      state.queue().enqueue(leaf.child(octant), queued->epoch);
  }
}

class SplittingStep {
 public:
  SplittingStep(const StageTools& tools, std::function<std::vector<MortonKey>()> find,
                std::function<bool(MortonKey leaf)> is_too_much)
      : tools_(tools), find_(std::move(find)), is_too_much_(std::move(is_too_much)) {}

  bool operator()() {
    RunState& state = tools_.state;
    if (!waiting_) waiting_ = find_(), std::ranges::reverse(*waiting_);
    std::vector<std::vector<MortonKey>> told(static_cast<std::size_t>(tools_.exchange.num_ranks()));
    while (!waiting_->empty()) {
      throw_if_stopped(&tools_.stop);
      const MortonKey leaf = waiting_->back();
      waiting_->pop_back();
      if (state.is_own(leaf) && is_too_much_(leaf)) {
        require_few_leaves(state, static_cast<double>(state.octree().size()));
        for (const int rank : state.others_holding(leaf))
          told[static_cast<std::size_t>(rank)].push_back(leaf);
        split_empty_leaf(state, leaf);
        for (int octant = 7; octant >= 0; --octant) waiting_->push_back(leaf.child(octant));
      }
      state.leaves().trim();
      if (state.commits().is_due()) break;
    }
    for (const auto& of_rank : swap_lists(tools_.exchange, std::move(told)))
      for (const MortonKey leaf : of_rank) {
        split_empty_leaf(state, leaf);
        state.leaves().trim();
      }
    return !waiting_->empty();
  }

  static void require_few_leaves(const RunView& run, double num_leaves) {
    if (num_leaves < kMaxStartLeaves) return;
    const RunParameters& p = run.parameters();
    throw InputError(fmt::format(
        "{}: the sizes that the surface asks for, from {} on, with {} points to a leaf need more "
        "than {} leaves: ask for less, give a larger --min-size, or a larger leaf capacity",
        run.run().surface.file, p.sizes().least, p.leaf_capacity, kMaxStartLeaves));
  }

 private:
  StageTools tools_;
  std::function<std::vector<MortonKey>()> find_;
  std::function<bool(MortonKey leaf)> is_too_much_;
  std::optional<std::vector<MortonKey>> waiting_;  // the next one last
};

}  // namespace

void split_leaf(RunState& state, MortonKey leaf) {
  if (state.is_beyond(leaf)) return;
  std::array<LeafRecords::Child, 8> children;
  const LeafPoints& own = state.leaves().points(leaf);
  for (const MeshPoint& point : own.points) {
    const MortonKey owner = state.frame().key_of(point.position, leaf.level() + 1);
    children[static_cast<std::size_t>(owner.octant())].points.points.push_back(point);
  }
  std::array<CornerStates, 8> corners;
  const LeafSurface& surface = state.leaves().surface(leaf);
  LeafSizes sizes;
  if (!state.is_uniform()) sizes = state.leaves().sizes(leaf);
  for (int octant = 0; octant < 8; ++octant) {
    const auto i = static_cast<std::size_t>(octant);
    const Box box = state.box(leaf.child(octant));
    const MortonKey child = leaf.child(octant);
    const auto is_in_child = [&](MortonKey key) {
      return child.is_ancestor_or_self_of(key) || key.is_ancestor_or_self_of(child);
    };
    std::ranges::copy_if(sizes.cubes, std::back_inserter(children[i].sizes.cubes), is_in_child,
                         &SizeCube::key);
    std::ranges::copy_if(sizes.nodes, std::back_inserter(children[i].sizes.nodes), is_in_child,
                         &SizedNode::key);
    children[i].surface = part_in(box, surface);
    corners[i] = center_to_corners(box, children[i].surface);
    children[i].points.core = clipped(own.core, state.sites(leaf.child(octant)));
  }
  const auto states = center_states_of_children(state.leaves().info(leaf).center, corners);
  for (std::size_t i = 0; i < children.size(); ++i) children[i].center = states[i];
  state.records().split(leaf, std::move(children));
  for (int octant = 0; octant < 8; ++octant)
    if (const MortonKey child = leaf.child(octant); state.is_own(child))
      state.records().put_num_core_cells(child, num_core_cells(state, child));
}

LeafStage::Step splitting(const StageTools& tools, std::function<std::vector<MortonKey>()> find,
                          std::function<bool(MortonKey leaf)> is_too_much) {
  return SplittingStep(tools, std::move(find), std::move(is_too_much));
}

LeafStage::Step splitting_rich(const StageTools& tools, std::function<double(MortonKey)> share) {
  const auto find = [tools, share] {
    RunState& state = tools.state;
    double num_leaves = 0;
    std::vector<MortonKey> rich;
    for (const MortonKey leaf : state.octree().leaves()) {
      throw_if_stopped(&tools.stop);
      if (!state.is_own(leaf)) continue;
      const double pieces = share(leaf);
      if (pieces > 1) rich.push_back(leaf);
      num_leaves += pieces;
      state.leaves().trim();
    }
    SplittingStep::require_few_leaves(state, num_leaves);
    return rich;
  };
  return splitting(tools, find, [share](MortonKey leaf) {
    return leaf.level() < kMaxCubeLevel && share(leaf) > 1;
  });
}

// A few hundred bytes each.
std::uint64_t most_pieces(const RunParameters& parameters) {
  return std::max<std::uint64_t>(2 * parameters.leaf_capacity, 20000);
}

double share_of_nodes(const RunView& run, MortonKey leaf) {
  return static_cast<double>(run.leaves().sizes(leaf).nodes.size()) /
         static_cast<double>(most_pieces(run.parameters()));
}

}  // namespace locvol
