#include "engine/run/leaf_loader.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <span>
#include <utility>

#include "engine/plan/octree_plan.h"
#include "engine/run/core_around.h"
#include "octree/sort_and_unite.h"

namespace locvol {
namespace {

constexpr double kDistanceSlack = 1.01;  // on distances whose exact value does not matter

// Of a patch's grid, with resolutions over λ. Making a fine one pays where all facets of a leaf are
// held against it; first points and the few facets of a later visit ask less.
constexpr GridFineness kFine{3.2, 48}, kOfCover{4, 64}, kOfFill{3, 48}, kCoarse{6, 128};

SizeRules rules_of(const RunParameters& p) {
  return {p.per_circle, p.deviation, p.layers, p.min_size, p.spacing_floor, p.growth};
}

constexpr std::uint64_t kBytesPerPiece = 350;  // of a surface that is measured
constexpr std::uint64_t kBytesPerNode = 250;   // of one with a size, its tree and what is near it

constexpr std::uint64_t kPointsOfReservation = 100000, kGridBytesPerPoint = 130;

// In a leaf's box, and on its triangles at the density of a maximal sample (at most one in each
// disk of radius r_s / 2, which is some 1.8 times what it gets to).
std::uint64_t most_lattice_points(const Box& box, double size) {
  const Point sides = (1 / (kLatticeSpacing * size)) * (box.max - box.min);
  return static_cast<std::uint64_t>(2 * (sides.x + 1) * (sides.y + 1) * (sides.z + 1));
}
std::uint64_t most_samples(std::span<const Triangle> triangles, double size) {
  double area = 0;
  for (const auto& [id, c] : triangles) area += 0.5 * norm(cross(c[1] - c[0], c[2] - c[0]));
  return static_cast<std::uint64_t>(2 * area / (size * size));
}

// A visit that inserts more than any mesh needs is a bug.
std::uint64_t max_insertions(std::uint64_t leaf_capacity) { return 50 * leaf_capacity + 100000; }

}  // namespace

LeafLoader::LeafLoader(RunState& state, MemoryBudget& budget, const StopToken* stop)
    : state_(state),
      budget_(budget),
      stop_(stop),
      shapes_(state.run().parameters.shapes, state.run().parameters.growth, state.run().frame) {
  if (state_.is_cover()) return;
  const Box root = state_.run().frame.root_box();
  std::vector<Triangle> triangles = triangles_meeting(root);
  budget_.keep(
      VisitSize{.volume = volume_over_size(root, state_.size()), .num_triangles = triangles.size()}
          .bytes_to_refine());
  whole_surface_ = std::make_unique<SurfacePatch>(SurfacePiece{.triangles = std::move(triangles),
                                                               .region = root,
                                                               .reference = root.min,
                                                               .is_reference_inside = false,
                                                               .fineness = {state_.size()}},
                                                  stop_);
  all_points_.emplace(state_.size());
  for (const MortonKey leaf : state_.octree().leaves()) {
    throw_if_stopped(stop_);
    for (const MeshPoint& point : state_.leaves().points(leaf).points) note_inserted(point);
  }
}

// Pieces to measure in a leaf; a few hundred bytes each.
std::uint64_t LeafLoader::most_pieces() const {
  return std::max<std::uint64_t>(2 * state_.run().parameters.leaf_capacity, 20000);
}

double LeafLoader::share_of_pieces(MortonKey leaf) {
  const auto most = static_cast<double>(most_pieces());
  const auto num_nodes = static_cast<double>(state_.leaves().sizes(leaf).nodes.size());
  if (state_.leaves().info(leaf).num_triangles == 0 || state_.run().phase != Phase::kMeasure)
    return num_nodes / most;
  const LoadedMeasure loaded = load_measure(leaf);
  const auto memory = budget_.reserve(loaded.bytes);
  return std::max(num_nodes, num_pieces_to_measure(loaded.input, stop_)) / most;
}

LoadedMeasure LeafLoader::load_measure(MortonKey leaf) {
  const RunParameters& parameters = state_.run().parameters;
  LoadedMeasure loaded;
  loaded.input = {.rules = rules_of(parameters),
                  .size = parameters.size,
                  .frame = state_.run().frame,
                  .leaf = leaf,
                  .surface = {}};
  if (state_.leaves().info(leaf).num_triangles == 0) return loaded;
  const double distance = measure_reach(loaded.input.rules, parameters.size);
  const Box region = state_.box(leaf).expanded(distance);
  std::vector<Triangle> triangles = triangles_meeting(region);
  const VisitSize visit{.volume = volume_over_size(region, parameters.size),
                        .num_points = triangles.size(),  // with what is measured of them
                        .num_triangles = triangles.size()};
  loaded.bytes = visit.bytes_to_cover() + kBytesPerPiece * most_pieces();
  loaded.input.surface =
      surface_around(leaf, distance, std::move(triangles),
                     {kOfCover.resolution * parameters.size, kOfCover.triangles_per_cell});
  return loaded;
}

LoadedSize LeafLoader::load_size(MortonKey leaf, const FarSurface& far) {
  const RunParameters& parameters = state_.run().parameters;
  const Box box = state_.box(leaf);
  const std::span<const SizeShape> shapes = shapes_.in(leaf);
  double most = std::min(state_.size(), size_bounds(shapes, parameters.growth, box).most);
  std::vector<SizedNode> nodes;
  if (parameters.has_nodes()) {
    const double diagonal = norm(box.max - box.min);
    const double deepest =
        state_.leaves().info(leaf).num_triangles > 0
            ? diagonal
            : far.around(box).distance(box.center(), std::numeric_limits<double>::max()) +
                  0.5 * diagonal;
    nodes = nodes_around(leaf, deepest);
    for (const SizedNode& node : nodes)
      most = std::min(most, node.size + parameters.growth *
                                            state_.run().frame.box(node.key).most_distance(box));
  }
  const double distance = kExactDistance * most;
  const Box region = box.expanded(distance);
  std::vector<Triangle> triangles = triangles_meeting(region);
  const VisitSize visit{.volume = triangles.empty() ? 0 : volume_over_size(region, most),
                        .num_points = 0,
                        .num_triangles = triangles.size()};
  return {.bytes = visit.bytes_to_cover() + shapes.size() * sizeof(SizeShape) +
                   kBytesPerNode * nodes.size(),
          .input = {
              .law = parameters.sizes(),
              .exact_distance = distance,
              .frame = state_.run().frame,
              .leaf = leaf,
              .surface = surface_around(leaf, distance, std::move(triangles),
                                        {kOfCover.resolution * most, kOfCover.triangles_per_cell}),
              .shapes = {shapes.begin(), shapes.end()},
              .nodes = std::move(nodes)}};
}

FarSurface LeafLoader::far_surface(const StopToken* stop) {
  FarSurface far(state_.run().frame);
  for (const MortonKey leaf : state_.octree().leaves()) {
    throw_if_stopped(stop);
    state_.leaves().trim();
    if (state_.leaves().info(leaf).num_triangles > 0 && state_.is_own(leaf))
      far.add(leaf, state_.leaves().surface(leaf).triangles);
  }
  far.finish();
  return far;
}

std::vector<SizedNode> LeafLoader::nodes_seen_from(std::span<const Box> places) {
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

LoadedCover LeafLoader::load_cover(MortonKey leaf) {
  const double size = state_.surface_size(leaf);
  const Box box = state_.box(leaf);
  std::vector<MeshPoint> around;
  if (state_.leaves().info(leaf).num_triangles > 0)
    around = points_around(leaf, sample_radius(state_.is_uniform()));
  const double patch_distance = kDistanceSlack * (state_.is_uniform() ? kCoreDepth : 1.0) * size;
  const Box region = box.expanded(patch_distance);
  std::vector<Triangle> triangles = triangles_meeting(region);
  const bool has_shapes = state_.run().parameters.sizes().has_shapes();
  SizeCubes sizes = sizes_around(leaf, has_shapes ? sample_radius(false) : 0);
  const std::uint64_t num_lattice = state_.is_uniform() ? most_lattice_points(box, size)
                                    : sizes.law.has_core()
                                        ? most_lattice_points(box, sizes.law.most)
                                        : 9 * sizes.cubes.size();
  const VisitSize visit{.volume = volume_over_size(region, state_.least_size(leaf)),
                        .num_points = around.size() + num_lattice + most_samples(triangles, size),
                        .num_triangles = triangles.size()};
  LoadedCover loaded;
  loaded.bytes = visit.bytes_to_cover();
  loaded.input = {.size = size,
                  .seed = state_.run().parameters.seed,
                  .lattice = state_.lattice(),
                  .box = box,
                  .surface = surface_around(leaf, patch_distance, std::move(triangles), kOfCover),
                  .nearby_samples = {},
                  .sizes = std::move(sizes)};
  for (const MeshPoint& point : around)
    if (point.kind == PointKind::kSurface) loaded.input.nearby_samples.push_back(point.position);
  return loaded;
}

LoadedFill LeafLoader::load_fill(MortonKey leaf) {
  const double size = state_.surface_size(leaf);
  const double patch_distance = state_.is_uniform() ? kDistanceSlack * size : surface_reach(leaf);
  std::vector<MeshPoint> points = points_around(leaf, kFillReach);
  const std::vector<MeshPoint>& own = state_.leaves().points(leaf).points;
  points.insert(points.end(), own.begin(), own.end());
  std::ranges::sort(points, {}, &MeshPoint::id);
  CoreRows core = core_around(state_, leaf, kCoreReach * core_size(state_.run().parameters));
  const Box region = state_.box(leaf).expanded(patch_distance);
  std::vector<Triangle> triangles = triangles_meeting(region);
  const VisitSize visit{.volume = volume_over_size(region, state_.least_size(leaf)),
                        .num_points = points.size(),
                        .num_triangles = triangles.size()};
  return {.bytes = visit.bytes_to_cover(),
          .input = {.size = size,
                    .box = state_.box(leaf),
                    .points = std::move(points),
                    .core = std::move(core),
                    .surface = surface_around(leaf, patch_distance, std::move(triangles), kOfFill),
                    .sizes = sizes_around(leaf, kFillReach)}};
}

LoadedLeaf LeafLoader::load(MortonKey leaf) {
  const double size = state_.surface_size(leaf);
  const double patch_distance =
      state_.is_uniform() ? kDistanceSlack * kReach / 2 * size : surface_reach(leaf);
  keep_memory_of_points();
  std::vector<MeshPoint> own = state_.leaves().points(leaf).points;
  std::vector<MeshPoint> ghosts = points_around(leaf, state_.is_cover() ? kReach : kNeighborhood);
  const Box region = state_.box(leaf).expanded(patch_distance);
  std::vector<Triangle> triangles;
  if (state_.is_cover()) triangles = triangles_meeting(region);
  const VisitSize visit{
      .volume = state_.is_cover() ? volume_over_size(region, state_.least_size(leaf)) : 0,
      .num_points = most_points_of_visit(own.size(), ghosts.size()),
      .num_triangles = triangles.size()};
  std::optional<LastVisit> last = last_visit(leaf);
  const GridFineness fineness = last ? kCoarse : kFine;
  LoadedLeaf loaded;
  loaded.bytes = visit.bytes_to_refine();
  loaded.input = {.criteria = criteria(leaf),
                  .box = state_.box(leaf),
                  .own = std::move(own),
                  .ghosts = std::move(ghosts),
                  .surface = {},
                  .core = {},
                  .max_own_points = max_own_points(leaf),
                  .last_visit = std::move(last),
                  .max_insertions = max_insertions(state_.run().parameters.leaf_capacity)};
  if (!state_.is_cover()) return loaded;
  loaded.input.waiting = waiting_around(leaf);
  loaded.input.surface = surface_around(leaf, patch_distance, std::move(triangles), fineness);
  loaded.input.core = core_around(state_, leaf, kCoreReach * core_size(state_.run().parameters));
  loaded.input.sizes = sizes_around(leaf, kReach);
  return loaded;
}

void LeafLoader::note_inserted(const MeshPoint& point) {
  if (!all_points_) return;
  ++num_points_;
  all_points_->insert(point);
}

void LeafLoader::note_deleted(const MeshPoint& point) {
  if (!all_points_) return;
  --num_points_;
  all_points_->erase(point);
}

// Before a visit, and not as its points come: what is half applied must not be given up.
void LeafLoader::keep_memory_of_points() {
  while (num_points_ > num_points_reserved_) {
    budget_.keep(kPointsOfReservation * kGridBytesPerPoint);
    num_points_reserved_ += kPointsOfReservation;
  }
}

std::optional<LastVisit> LeafLoader::last_visit(MortonKey leaf) {
  const LeafInfo& info = state_.leaves().info(leaf);
  if (info.first_new_id == 0) return std::nullopt;
  LeafCells held = state_.leaves().cells(leaf);
  LeafFacets facets = state_.leaves().facets(leaf);
  return LastVisit{info.first_new_id,
                   {std::move(held.vertices), std::move(held.cells)},
                   {std::move(facets.vertices), std::move(facets.facets)},
                   std::move(held.asked)};
}

double LeafLoader::volume_over_size(const Box& box, double size) const {
  const Point sides = (1 / size) * (box.max - box.min);
  return sides.x * sides.y * sides.z;
}

// Only points that samples may not hide ask for the surface: those on it, and volume points at most
// r_s deep.
double LeafLoader::surface_reach(MortonKey leaf) {
  const double growth = state_.run().parameters.growth;
  return kDistanceSlack * reach_factor(growth, kReach) / 2 * (1 + growth) *
         state_.surface_size(leaf);
}

// The node, or the largest one that it lies in whose side is small over its distance: what that is
// does not depend on which of those between them is known.
SizedNode LeafLoader::seen_from(std::span<const Box> places, SizedNode node) const {
  constexpr double kDetail = 0.05;  // sides of nodes, over their distance
  const Frame& frame = state_.run().frame;
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

// At a place at the depth d, a node on the surface at the distance D >= d matters if s + g D < λ +
// g d.
std::vector<SizedNode> LeafLoader::nodes_around(MortonKey leaf, double deepest) {
  constexpr double kWidest = 1.1;  // of what seen_from() makes of a node, the way across
  const RunParameters& p = state_.run().parameters;
  const Frame& frame = state_.run().frame;
  const Box box = state_.box(leaf);
  const double farthest = deepest + (p.size - p.sizes().least) / p.growth;
  std::vector<SizedNode> nodes;
  const auto take = [&](const SizedNode& node) {
    const SizedNode seen = seen_from({&box, 1}, node);
    if (box.squared_distance(frame.box(seen.key)) <= farthest * farthest) nodes.push_back(seen);
  };
  for (const MortonKey other : state_.octree().leaves_within(frame, box, kWidest * farthest)) {
    throw_if_stopped(stop_);
    if (!state_.is_own(other)) continue;
    if (state_.leaves().info(other).num_triangles == 0 && !p.has_image()) continue;
    for (const SizedNode& node : state_.leaves().sizes(other).nodes) take(node);
    state_.leaves().trim();
  }
  for (const SizedNode& node : told_nodes_) take(node);
  unite(nodes);
  return nodes;
}

SizeCubes LeafLoader::sizes_around(MortonKey leaf, double k) {
  SizeCubes sizes;
  if (state_.is_uniform()) return sizes;
  const Frame& frame = state_.run().frame;
  sizes.law = state_.run().parameters.sizes();
  sizes.frame = frame;
  const Box box = state_.box(leaf);
  const double farthest = state_.reach_of(leaf, k);
  const double factor = kDistanceSlack * reach_factor(sizes.law.growth, k);
  const auto reaches = [&](const SizeCube& cube) {
    const double squared = box.squared_distance(frame.box(cube.key));
    if (squared == 0) return true;
    if (squared > farthest * farthest) return false;
    const double reach = factor * largest_size(sizes.law, cube);
    return squared <= reach * reach;
  };
  for (const MortonKey other : state_.octree().leaves_within(frame, box, farthest)) {
    std::ranges::copy_if(state_.leaves().sizes(other).cubes, std::back_inserter(sizes.cubes),
                         reaches);
    state_.leaves().trim();
  }
  // A cube may be larger than a leaf that was split.
  const auto repeated = std::ranges::unique(sizes.cubes);
  sizes.cubes.erase(repeated.begin(), repeated.end());
  return sizes;
}

// In cover mode few points are added to those that cover the domain; in paper mode a leaf fills up
// until it is split.
std::uint64_t LeafLoader::most_points_of_visit(std::uint64_t num_own,
                                               std::uint64_t num_ghosts) const {
  const std::uint64_t num_local = num_own + num_ghosts;
  if (state_.is_cover()) return num_local + num_local / 5 + 100;
  const std::uint64_t capacity = state_.run().parameters.leaf_capacity;
  return 2 * std::max(num_own, capacity) + num_ghosts;
}

Criteria LeafLoader::criteria(MortonKey leaf) {
  const RunParameters& p = state_.run().parameters;
  return state_.is_cover()
             ? Criteria::of_cover(state_.surface_size(leaf), p.radius_edge_bound, p.spacing_floor,
                                  p.min_dihedral, p.growth)
             : Criteria::of_paper(p.size, p.radius_edge_bound, p.spacing_floor, p.min_dihedral);
}

// κ, or no bound where the children would be too small: below some λ, or a tenth of what leaves are
// at the start, they load so many ghosts that a dense sheet takes twice as long, to save a third of
// the memory.
std::uint64_t LeafLoader::max_own_points(MortonKey leaf) {
  if (leaf.level() == MortonKey::kMaxLevel) return 0;
  const RunParameters& parameters = state_.run().parameters;
  const double start = state_.is_cover() ? start_leaf_side(parameters) : 0;
  const double size = std::min(state_.size(), state_.least_size(leaf));
  const double least = std::max(kMinChildSide * size, 0.1 * start * (size / state_.size()));
  return state_.run().frame.side(leaf.level() + 1) >= least ? parameters.leaf_capacity : 0;
}

// As far as circumcenters of cells at own points lie.
std::vector<Box> LeafLoader::waiting_around(MortonKey leaf) {
  std::vector<Box> waiting;
  if (state_.run().parameters.min_dihedral == 0) return waiting;
  // One that has come into the queue since for want of a listed point, all of the core before,
  // waits for a later epoch: a visit far away may have made it do so, or be about to.
  const auto& own = state_.leaves().info(leaf).queued;
  const auto is_of_epoch = [epoch = own ? own->epoch : state_.run().epoch](const LeafInfo& info) {
    return info.queued && info.queued->epoch <= epoch;
  };
  for (const MortonKey other : state_.octree().leaves_within(
           state_.run().frame, state_.box(leaf), 0.5 * state_.reach_of(leaf, kNeighborhood)))
    if (const LeafInfo& info = state_.leaves().info(other);
        other != leaf && is_of_epoch(info) && info.num_visits == 0)
      waiting.push_back(state_.box(other));
  return waiting;
}

SurfacePiece LeafLoader::surface_around(MortonKey leaf, double distance,
                                        std::vector<Triangle> triangles, GridFineness fineness) {
  if (state_.run().phase > Phase::kSize) fineness.resolution *= state_.least_size(leaf);
  const Box box = state_.box(leaf);
  return {.triangles = std::move(triangles),
          .region = box.expanded(distance),
          .reference = box.center(),
          .is_reference_inside = state_.leaves().info(leaf).is_center_inside,
          .fineness = fineness};
}

// Each once, in order of id; and some more, that only come close.
std::vector<Triangle> LeafLoader::triangles_meeting(const Box& region) {
  std::vector<Triangle> triangles;
  for (const MortonKey leaf : state_.octree().leaves_within(state_.run().frame, region, 0)) {
    throw_if_stopped(stop_);
    if (state_.leaves().info(leaf).num_triangles == 0) continue;
    std::ranges::copy_if(state_.leaves().surface(leaf).triangles, std::back_inserter(triangles),
                         [&](const Triangle& t) { return t.box().overlaps(region); });
    state_.leaves().trim();
  }
  sort_and_unite(triangles, &Triangle::id);
  return triangles;
}

std::vector<MeshPoint> LeafLoader::points_around(MortonKey leaf, double k) {
  const double distance = state_.reach_of(leaf, k);
  const Box box = state_.box(leaf), nearly = box.expanded(distance);
  const double factor = reach_factor(state_.run().parameters.growth, k);
  const bool is_uniform = state_.is_uniform();
  const SizeLaw law = state_.run().parameters.sizes();
  const double near = std::min(distance, factor * law.least);  // any point's reach
  std::vector<MeshPoint> around;
  for (const MortonKey other : state_.octree().leaves_within(state_.run().frame, box, distance)) {
    if (other == leaf || state_.leaves().info(other).num_points == 0) continue;
    std::span<const SizeCube> cubes;
    if (!is_uniform) cubes = state_.leaves().sizes(other).cubes;
    SizeCursor sizes(law, state_.run().frame, cubes);
    std::ranges::copy_if(state_.leaves().points(other).points, std::back_inserter(around),
                         [&](const MeshPoint& p) {
                           if (!nearly.contains(p.position)) return false;
                           const double squared = box.squared_distance(p.position);
                           if (squared > distance * distance) return false;
                           if (is_uniform || squared <= near * near) return true;
                           const double reach = factor * sizes.at(p.position);
                           return squared <= reach * reach;
                         });
    state_.leaves().trim();
  }
  std::ranges::sort(around, {}, &MeshPoint::id);
  return around;
}

}  // namespace locvol
