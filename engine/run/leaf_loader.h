// LeafLoader gathers what cover_leaf, fill_leaf and refine_leaf need to know of a leaf and its
// surroundings.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/run/point_grid.h"
#include "engine/run/run_state.h"
#include "engine/shared/memory_budget.h"
#include "octree/size_shapes.h"
#include "refine/cover_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/leaf.h"
#include "refine/measure_leaf.h"
#include "refine/size_leaf.h"
#include "refine/surface_patch.h"

namespace locvol {

// All that a visit reads, copied from the run.
template <class Input>
struct Loaded {
  std::uint64_t bytes = 0;  // that the visit takes at its peak
  Input input;
};
using LoadedLeaf = Loaded<LeafInput>;
using LoadedCover = Loaded<CoverInput>;
using LoadedFill = Loaded<FillInput>;
using LoadedMeasure = Loaded<MeasureInput>;
using LoadedSize = Loaded<SizeInput>;

class LeafLoader {
 public:
  // In paper mode reads all of the surface and of P, and keeps them. Throws OverBudget, Stopped.
  LeafLoader(RunState& state, MemoryBudget& budget, const StopToken* stop = nullptr);

  LoadedMeasure load_measure(MortonKey leaf);
  // What measuring the leaf takes, and what its nodes do, over what a visit should. Above 1, it
  // should be split.
  double share_of_pieces(MortonKey leaf);
  LoadedSize load_size(MortonKey leaf, const FarSurface& far);
  // Of the rank's own leaves. Throws Stopped
  FarSurface far_surface(const StopToken* stop);
  // What the surface in them, or an image, asks for, with as much detail as matters in these boxes.
  std::vector<SizedNode> nodes_seen_from(std::span<const Box> places);
  // The same of other ranks' leaves, of load_size() to come.
  void take_nodes(std::vector<SizedNode> told) { told_nodes_ = std::move(told); }
  LoadedCover load_cover(MortonKey leaf);
  LoadedFill load_fill(MortonKey leaf);
  LoadedLeaf load(MortonKey leaf);  // in paper mode throws OverBudget: P has outgrown the memory
  // Keeps up with P.
  void note_inserted(const MeshPoint& point);
  void note_deleted(const MeshPoint& point);
  WholeModel whole() const { return {whole_surface_.get(), all_points_ ? &*all_points_ : nullptr}; }

 private:
  Criteria criteria(MortonKey leaf);
  std::uint64_t max_own_points(MortonKey leaf);
  std::optional<LastVisit> last_visit(MortonKey leaf);
  void keep_memory_of_points();
  // `size`: the least that matters there
  double volume_over_size(const Box& box, double size) const;
  std::uint64_t most_pieces() const;
  // What triangles a visit looks up lies this far from where h(p) is, at points that the surface
  // may matter to.
  double surface_reach(MortonKey leaf);
  // What the surface asks for that may matter in the leaf, which is no deeper below it than
  // `deepest`; with less detail where that is far.
  std::vector<SizedNode> nodes_around(MortonKey leaf, double deepest);
  // h wherever a ball through a point of the leaf may be centered, and wherever it may reach, if
  // its radius is at most k / 2 times h at its center.
  SizeCubes sizes_around(MortonKey leaf, double k);
  SizedNode seen_from(std::span<const Box> places, SizedNode node) const;
  std::uint64_t most_points_of_visit(std::uint64_t num_own, std::uint64_t num_ghosts) const;
  std::vector<Box> waiting_around(MortonKey leaf);
  SurfacePiece surface_around(MortonKey leaf, double distance, std::vector<Triangle> triangles,
                              GridFineness fineness);
  std::vector<Triangle> triangles_meeting(const Box& region);
  // Points of other leaves that a ball through a point of the leaf may reach, in order of id, if
  // its radius is at most k / 2 times h at its center.
  std::vector<MeshPoint> points_around(MortonKey leaf, double k);

  RunState& state_;
  MemoryBudget& budget_;
  const StopToken* stop_;
  ShapesOfNodes shapes_;
  std::vector<SizedNode> told_nodes_;
  // All below is for paper mode.
  std::unique_ptr<const SurfacePatch> whole_surface_;
  std::uint64_t num_points_reserved_ = 0, num_points_ = 0;
  std::optional<PointGrid> all_points_;
};

}  // namespace locvol
