#include "engine/run/surroundings.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "octree/near_cubes.h"
#include "refine/cover_leaf.h"

namespace locvol {

namespace {

// A cube may be larger than a leaf that was split.
void unite(std::vector<SizeCube>& cubes) {
  const auto repeated = std::ranges::unique(cubes);
  cubes.erase(repeated.begin(), repeated.end());
}

}  // namespace

double volume_over_size(const Box& box, double size) {
  const Point sides = (1 / size) * (box.max - box.min);
  return sides.x * sides.y * sides.z;
}

// The same in all leaves.
double Surroundings::crease_floor() const {
  const RunParameters& p = run_.parameters();
  return p.spacing_floor * p.sizes().least;
}

DomainPiece Surroundings::piece_in(const Box& region, GridFineness fineness,
                                   void (DomainPiece::*add)(const LeafSurface&)) const {
  DomainPiece piece;
  piece.region = region;
  piece.fineness = fineness;
  piece.crease_floor = crease_floor();
  for (const MortonKey leaf : run_.octree().leaves_within(run_.frame(), region, 0)) {
    throw_if_stopped(stop_);
    if (!run_.leaves().info(leaf).has_surface()) continue;
    (piece.*add)(run_.leaves().surface(leaf));
    run_.leaves().trim();
  }
  piece.unite();
  return piece;
}

DomainPiece Surroundings::domain(MortonKey leaf, double distance, GridFineness fineness) const {
  const Box box = run_.box(leaf);
  DomainPiece piece = piece_in(box.expanded(distance), fineness);
  piece.reference = box.center();
  piece.reference_state = run_.leaves().info(leaf).center;
  return piece;
}

// The root's corners are outside.
DomainPiece Surroundings::whole_domain(GridFineness fineness) const {
  DomainPiece piece = piece_in(run_.frame().root_box(), fineness);
  piece.reference = piece.region.min;
  piece.is_whole = true;
  return piece;
}

DomainPiece Surroundings::creases(MortonKey leaf, double distance) const {
  return piece_in(run_.box(leaf).expanded(distance), {}, &DomainPiece::add_creases);
}

// Only points that samples may not hide ask for the surface: those on it, and volume points at most
// r_s deep.
double Surroundings::surface_reach(MortonKey leaf) const {
  const double growth = run_.parameters().growth;
  return kDistanceSlack * reach_factor(growth, kReach) / 2 * (1 + growth) * run_.surface_size(leaf);
}

std::vector<MeshPoint> Surroundings::points(MortonKey leaf, double k) const {
  const double distance = run_.reach_of(leaf, k);
  const Box box = run_.box(leaf), nearly = box.expanded(distance);
  const double factor = reach_factor(run_.parameters().growth, k);
  const SizeLaw law = run_.parameters().sizes();
  std::vector<MeshPoint> around;
  for (const MortonKey other : run_.octree().leaves_within(run_.frame(), box, distance)) {
    if (other == leaf || run_.leaves().info(other).num_points == 0) continue;
    // Any point's reach there is between these.
    const double least = factor * run_.least_size(other);
    const double most = std::min(distance, run_.reach_of(other, k));
    if (box.squared_distance(run_.box(other)) > most * most) continue;
    std::span<const SizeCube> cubes;
    if (least < most) cubes = run_.leaves().sizes(other).cubes;
    SizeCursor sizes(law, run_.frame(), cubes);
    std::ranges::copy_if(run_.leaves().points(other).points, std::back_inserter(around),
                         [&](const MeshPoint& p) {
                           if (!nearly.contains(p.position)) return false;
                           const double squared = box.squared_distance(p.position);
                           if (squared > most * most) return false;
                           if (squared <= least * least) return true;
                           const double reach = factor * sizes.at(p.position);
                           return squared <= reach * reach;
                         });
    run_.leaves().trim();
  }
  std::ranges::sort(around, {}, &MeshPoint::id);
  return around;
}

template <class IsTaken>
std::vector<MeshPoint> Surroundings::points_within(MortonKey leaf, double distance,
                                                   const IsTaken& is_taken) const {
  const Box box = run_.box(leaf);
  std::vector<MeshPoint> within;
  for (const MortonKey other : run_.octree().leaves_within(run_.frame(), box, distance)) {
    if (run_.leaves().info(other).num_points == 0) continue;
    std::ranges::copy_if(
        run_.leaves().points(other).points, std::back_inserter(within), [&](const MeshPoint& p) {
          return is_taken(p.kind) && box.squared_distance(p.position) <= distance * distance;
        });
    run_.leaves().trim();
  }
  std::ranges::sort(within, {}, &MeshPoint::id);
  return within;
}

std::vector<MeshPoint> Surroundings::crease_points(MortonKey leaf, double distance) const {
  if (!run_.run().has_creases) return {};
  return points_within(leaf, distance, [](PointKind kind) { return kind == PointKind::kCrease; });
}

bool Surroundings::are_sides_apart() const {
  const double reach = kMirrorReach * run_.size();
  return run_.run().has_creases &&
         std::ranges::any_of(run_.run().surface.facing.places, [&](const FacingPlaces& places) {
           return std::exp2(static_cast<double>(places.step) / FacingPlaces::kStepsPerOctave) <
                  reach;
         });
}

std::vector<MeshPoint> Surroundings::samples(MortonKey leaf, double distance) const {
  return points_within(leaf, distance, [](PointKind kind) { return kind == PointKind::kSurface; });
}

SizeCubes Surroundings::sizes(MortonKey leaf, double k) const {
  SizeCubes sizes;
  if (run_.is_uniform()) return sizes;
  const Frame& frame = run_.frame();
  sizes.law = run_.parameters().sizes();
  sizes.frame = frame;
  const Box box = run_.box(leaf);
  const double farthest = run_.reach_of(leaf, k);
  const double factor = kDistanceSlack * reach_factor(sizes.law.growth, k);
  const auto reaches = [&](const SizeCube& cube) {
    const double squared = box.squared_distance(frame.box(cube.key));
    if (squared == 0) return true;
    if (squared > farthest * farthest) return false;
    const double reach = factor * largest_size(sizes.law, cube);
    return squared <= reach * reach;
  };
  for (const MortonKey other : run_.octree().leaves_within(frame, box, farthest)) {
    const double most = std::min(farthest, factor * run_.leaves().info(other).largest_size);
    if (box.squared_distance(frame.box(other)) > most * most) continue;
    for_each_cube_near(frame, other, run_.leaves().sizes(other).cubes, box, most,
                       [&](const SizeCube& cube) {
                         if (reaches(cube)) sizes.cubes.push_back(cube);
                       });
    run_.leaves().trim();
  }
  unite(sizes.cubes);
  return sizes;
}

SizeCubes Surroundings::sizes_within(MortonKey leaf, double distance) const {
  SizeCubes sizes{.law = run_.parameters().sizes(), .frame = run_.frame(), .cubes = {}};
  const Box box = run_.box(leaf);
  for (const MortonKey other : run_.octree().leaves_within(run_.frame(), box, distance)) {
    std::ranges::copy_if(run_.leaves().sizes(other).cubes, std::back_inserter(sizes.cubes),
                         [&](const SizeCube& cube) {
                           return box.squared_distance(run_.frame().box(cube.key)) <=
                                  distance * distance;
                         });
    run_.leaves().trim();
  }
  unite(sizes.cubes);
  return sizes;
}

}  // namespace locvol
