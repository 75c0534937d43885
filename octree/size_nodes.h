// The sizes that a surface asks for itself, at nodes that it passes through: many, so in a tree.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "octree/frame.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

// A node with the size that is asked for in all of it.
struct SizedNode {
  MortonKey key;
  float size = 0;
  friend bool operator==(const SizedNode&, const SizedNode&) = default;
};
// Makes the nodes ascend, each key once, with the least of its sizes.
void unite(std::vector<SizedNode>& nodes);

// h is the least of s + g · distance over nodes of size s. Found by bounds of what a branch of the
// tree may ask for.
class SizeNodes {
 public:
  SizeNodes(std::vector<SizedNode> nodes, double growth, const Frame& frame);

  bool is_empty() const { return tree_.empty(); }
  // The places of branches that matter somewhere.
  using Branches = std::vector<std::uint32_t>;
  Branches all() const { return is_empty() ? Branches{} : Branches{0}; }
  // Finds those of the branches that may ask for `most` or less in the box, as parts that are no
  // wider than it. Lowers `most` to what they ask for in all of the box.
  void find_near(const Branches& branches, const Box& box, double& most, Branches& near) const;
  // What they ask for at p, if that is less than `most`; else `most`.
  double size_at(const Branches& branches, const Point& p, double most) const;

 private:
  struct Branch {
    Point low;
    double side = 0;
    double least = 0;                  // of all sizes in it
    std::uint32_t first = 0, num = 0;  // its parts; none: it asks for `least` in all of it

    Box box() const { return {low, {low.x + side, low.y + side, low.z + side}}; }
  };
  void grow(std::uint32_t place, MortonKey common, std::span<const SizedNode> nodes);

  Frame frame_;
  double growth_;
  std::vector<Branch> tree_;
};

}  // namespace locvol
