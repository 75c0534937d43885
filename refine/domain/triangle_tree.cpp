#include "refine/domain/triangle_tree.h"

#include <utility>

namespace locvol {
namespace {

// Places v from [low, low + extent] on 21 bits and spreads them for a Morton code.
std::uint64_t spread_bits(double v, double low, double extent) {
  const double unit = extent > 0 ? (v - low) / extent : 0.0;
  auto x = static_cast<std::uint64_t>(std::clamp(unit, 0.0, 1.0) * 2097151.0);
  x = (x | x << 32) & 0x001f00000000ffff;
  x = (x | x << 16) & 0x001f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

}  // namespace

TriangleTree::TriangleTree(std::span<const Point> vertices,
                           std::span<const std::array<std::uint32_t, 3>> triangles,
                           const Box& region, double margin)
    : levels_(1) {
  if (triangles.empty()) return;
  std::vector<Node> nodes;
  nodes.reserve(triangles.size());
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    const auto& [a, b, c] = triangles[t];
    const Box box = Box::around(vertices[a]).joined(vertices[b]).joined(vertices[c]);
    nodes.push_back({(margin > 0 ? box.expanded(margin) : box).common(region), t});
  }
  sort_along_curve(nodes);
  build_levels();
}

void TriangleTree::sort_along_curve(const std::vector<Node>& nodes) {
  Box all = nodes[0].box;
  for (const Node& node : nodes) all = all.joined(node.box);
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(nodes.size());
  for (std::uint32_t t = 0; t < nodes.size(); ++t) {
    const Point c = nodes[t].box.center();
    keys[t] = {spread_bits(c.x, all.min.x, all.max.x - all.min.x) |
                   spread_bits(c.y, all.min.y, all.max.y - all.min.y) << 1 |
                   spread_bits(c.z, all.min.z, all.max.z - all.min.z) << 2,
               t};
  }
  std::sort(keys.begin(), keys.end());
  levels_[0].reserve(keys.size());
  for (const auto& [key, t] : keys) levels_[0].push_back(nodes[t]);
}

void TriangleTree::build_levels() {
  while (levels_.back().size() > kFanOut) {
    const std::vector<Node>& below = levels_.back();
    std::vector<Node> next;
    next.reserve(below.size() / kFanOut + 1);
    for (std::size_t begin = 0; begin < below.size(); begin += kFanOut) {
      const std::size_t end = std::min(begin + kFanOut, below.size());
      Node node = below[begin];
      for (std::size_t i = begin + 1; i < end; ++i)
        node = {node.box.joined(below[i].box), std::min(node.triangle, below[i].triangle)};
      next.push_back(node);
    }
    levels_.push_back(std::move(next));
  }
}

}  // namespace locvol
