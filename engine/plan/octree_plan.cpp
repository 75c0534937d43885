#include "engine/plan/octree_plan.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "engine/shared/input_error.h"
#include "engine/shared/number_text.h"
#include "octree/lattice.h"
#include "refine/cover_leaf.h"
#include "refine/size_leaf.h"

namespace locvol {
namespace {

Frame frame_around(const RunParameters& parameters, const Box& surface, double leaf_side) {
  const double margin = 0.5 * parameters.size + 0.01 * max_norm(surface.max - surface.min);
  try {
    return Frame::around(surface, margin, leaf_side);
  } catch (const std::invalid_argument& e) {
    throw InputError("size " + decimal(parameters.size) + " is too small for this surface (" +
                     e.what() + "): choose a larger size or move the model to the origin");
  }
}

// Of a leaf that will hold half of κ lattice points, over h.
double side_of_lattice(const RunParameters& parameters) {
  const double lattice_density = 2 / (kLatticeSpacing * kLatticeSpacing * kLatticeSpacing);
  return std::max(std::cbrt(0.5 * static_cast<double>(parameters.leaf_capacity) / lattice_density),
                  kMinLeafSide);
}

}  // namespace

double start_leaf_side(const RunParameters& parameters) {
  const auto capacity = static_cast<double>(parameters.leaf_capacity);
  constexpr double kPointsPerArea = 2;  // to λ²
  const double side = std::sqrt(0.25 * capacity / kPointsPerArea);
  if (parameters.sizes().is_uniform())
    return parameters.size * (parameters.is_surface_only ? std::max(side, kMinLeafSide)
                                                         : side_of_lattice(parameters));
  // Where h grows no more, cubes are as large as fits that.
  const double whole = kLatticeSpacing *
                       (std::isfinite(parameters.max_size) ? parameters.max_size : parameters.size);
  return std::exp2(std::round(std::log2(std::max(side, kMinLeafSide) * parameters.size / whole))) *
         whole;
}

StartSides::StartSides(const RunParameters& parameters, const OctreePlan& plan)
    : size_(parameters.size),
      most_(parameters.max_size),
      side_(1.001 * plan.frame.side(plan.level)),
      side_inside_(side_of_lattice(parameters)),
      plan_(plan),
      shapes_(parameters.shapes, parameters.growth, plan.frame) {}

double StartSides::least_size(MortonKey node) {
  return std::min(size_, shapes_.bounds(node).least);
}

bool StartSides::is_narrow(MortonKey node) {
  return node.level() >= plan_.level &&
         (node.level() == MortonKey::kMaxLevel ||
          plan_.frame.side(node.level()) <= side_ * least_size(node) / size_);
}

bool StartSides::is_narrow_inside(MortonKey node) {
  const double size = std::min(most_, shapes_.bounds(node).least);
  return node.level() == MortonKey::kMaxLevel ||
         plan_.frame.side(node.level()) <= 2 * side_inside_ * size;
}

OctreePlan plan_octree(const RunParameters& parameters, const Box& surface) {
  const double leaf_side = start_leaf_side(parameters);
  OctreePlan plan{.frame = frame_around(parameters, surface, leaf_side)};
  if (parameters.init == Initialization::kPaper) return plan;
  const double least_size = plan.frame.side(0) / (kLatticeSpacing * (kMaxSiteIndex - 8));
  if (parameters.size < least_size)
    throw InputError("size " + decimal(parameters.size) +
                     " is too small for this surface: the lattice would have more than 2^20 cells "
                     "to a side; choose a size of at least " +
                     rounded(1.01 * least_size));
  plan.level = plan.frame.level_of_side(leaf_side);
  const double finest = plan.frame.side(kMaxCubeLevel);
  const double least = parameters.sizes().least;
  if (!parameters.sizes().is_uniform() && kLatticeSpacing * least < finest)
    throw InputError("size " + decimal(least) +
                     " is too small for this surface: the octree of sizes would have more than "
                     "2^19 cubes to a side; choose a size of at least " +
                     rounded(1.01 * finest / kLatticeSpacing));
  return plan;
}

}  // namespace locvol
