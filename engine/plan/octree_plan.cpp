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

}  // namespace

double start_leaf_side(const RunParameters& parameters) {
  const auto capacity = static_cast<double>(parameters.leaf_capacity);
  if (parameters.sizes().is_uniform()) {
    const double lattice_density = 2 / (kLatticeSpacing * kLatticeSpacing * kLatticeSpacing);
    const double side = std::cbrt(0.5 * capacity / lattice_density);
    return std::max(side, kMinLeafSide) * parameters.size;
  }
  constexpr double kPointsPerArea = 2;  // to λ²
  const double side = std::sqrt(0.25 * capacity / kPointsPerArea);
  return std::exp2(std::round(std::log2(std::max(side, kMinLeafSide) / kLatticeSpacing))) *
         kLatticeSpacing * parameters.size;
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
  if (!parameters.sizes().is_uniform() && kLatticeSpacing * parameters.size < finest)
    throw InputError("size " + decimal(parameters.size) +
                     " is too small for this surface: the octree of sizes would have more than "
                     "2^19 cubes to a side; choose a size of at least " +
                     rounded(1.01 * finest / kLatticeSpacing));
  return plan;
}

}  // namespace locvol
