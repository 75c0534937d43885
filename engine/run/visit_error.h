// A visit whose computation failed: a bug, which the run has not seen anything of.
#pragma once

#include <string>

#include "octree/morton_key.h"
#include "refine/leaf.h"

namespace locvol {

// Any other RefineError has failed while a visit was applied, and left the run half changed.
class VisitError : public RefineError {
 public:
  VisitError(MortonKey leaf, const std::string& what) : RefineError(what), leaf_(leaf) {}
  MortonKey leaf() const { return leaf_; }

 private:
  MortonKey leaf_;
};

}  // namespace locvol
