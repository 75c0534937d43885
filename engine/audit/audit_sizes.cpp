#include "engine/audit/audit_sizes.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace locvol {

void AuditSizes::add(const std::vector<SizeCube>& cubes) {
  for (const SizeCube& cube : cubes) {
    cubes_.emplace(cube.key, cube);
    deepest_ = std::max(deepest_, cube.key.level());
  }
}

double AuditSizes::at(const Point& p) const {
  constexpr double kBeside = 1e-7;  // over λ
  if (cubes_.empty()) return law_.surface;
  double size = in_cube_of(p);
  for (int axis = 0; axis < 3; ++axis)
    for (const double way : {-kBeside, kBeside}) {
      Point beside = p;
      beside[axis] += way * law_.surface;
      size = std::max(size, in_cube_of(beside));
    }
  return size;
}

// The cube is found from the smallest upwards; each corner counts by how near p is to it along
// each axis.
double AuditSizes::in_cube_of(const Point& p) const {
  if (!frame_.contains(p)) return law_.surface;
  MortonKey node = frame_.key_of(p, deepest_);
  while (!cubes_.contains(node) && node != MortonKey::root()) node = node.parent();
  const auto found = cubes_.find(node);
  if (found == cubes_.end()) return law_.surface;
  const Box box = frame_.box(node);
  double distance = 0, less = 0;
  for (std::size_t corner = 0; corner < 8; ++corner) {
    double weight = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const double side = box.max[axis] - box.min[axis];
      weight *= (corner >> axis & 1 ? p[axis] - box.min[axis] : box.max[axis] - p[axis]) / side;
    }
    distance += weight * static_cast<double>(found->second.distance[corner]);
    less += weight * static_cast<double>(found->second.less[corner]);
  }
  const double depth = std::max(0.0, distance - static_cast<double>(found->second.excess));
  return std::max(law_.least, std::min(law_.most, law_.surface - less + law_.growth * depth));
}

}  // namespace locvol
