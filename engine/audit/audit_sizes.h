// The size of cells at a place, from a run's records, by other code than builds the mesh
// (octree/size_field.h).
#pragma once

#include <unordered_map>
#include <vector>

#include "octree/frame.h"
#include "octree/size_field.h"
#include "octree/table_hash.h"

namespace locvol {

class AuditSizes {
 public:
  AuditSizes() = default;  // of no use
  AuditSizes(const SizeLaw& law, const Frame& frame) : law_(law), frame_(frame) {}

  void add(const std::vector<SizeCube>& cubes);
  // h(p); λ where no cube is known. Cubes meet in small steps, and p is rounded: the largest that h
  // has beside it.
  double at(const Point& p) const;

 private:
  double in_cube_of(const Point& p) const;

  SizeLaw law_;
  Frame frame_;
  int deepest_ = 0;                                           // level of a cube
  std::unordered_map<MortonKey, SizeCube, TableHash> cubes_;  // asked, never listed
};

}  // namespace locvol
