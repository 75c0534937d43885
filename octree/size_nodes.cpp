#include "octree/size_nodes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace locvol {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// Between any point of a and any of b.
double farthest_distance(const Box& a, const Box& b) {
  const Point one = a.max - b.min, two = b.max - a.min;
  return norm({std::max(one.x, two.x), std::max(one.y, two.y), std::max(one.z, two.z)});
}

MortonKey common_ancestor(MortonKey a, MortonKey b) {
  while (!a.is_ancestor_or_self_of(b)) a = a.parent();
  return a;
}

}  // namespace

void unite(std::vector<SizedNode>& nodes) {
  std::ranges::sort(nodes, {}, [](const SizedNode& n) { return std::pair(n.key, n.size); });
  const auto repeated = std::ranges::unique(nodes, {}, &SizedNode::key);
  nodes.erase(repeated.begin(), repeated.end());
}

SizeNodes::SizeNodes(std::vector<SizedNode> nodes, double growth, const Frame& frame)
    : frame_(frame), growth_(growth) {
  if (nodes.empty()) return;
  // A node before what lies in it.
  std::ranges::sort(nodes, {}, [](const SizedNode& n) {
    return std::tuple(n.key.range_min(), n.key.level(), n.size);
  });
  MortonKey common = nodes.front().key;
  for (const SizedNode& node : nodes) common = common_ancestor(common, node.key);
  tree_.reserve(2 * nodes.size());
  tree_.emplace_back();
  grow(0, common, nodes);
}

void SizeNodes::grow(std::uint32_t place, MortonKey common, std::span<const SizedNode> nodes) {
  const Box box = frame_.box(common);
  Branch branch{.low = box.min, .side = frame_.side(common.level()), .least = kInfinite};
  for (const SizedNode& node : nodes)
    branch.least = std::min(branch.least, static_cast<double>(node.size));
  if (nodes.size() > 1) {
    std::vector<std::pair<MortonKey, std::span<const SizedNode>>> parts;
    std::size_t first = 0;
    while (first < nodes.size() && nodes[first].key == common) ++first;
    if (first > 0) parts.emplace_back(common, nodes.first(1));
    while (first < nodes.size()) {
      MortonKey part = nodes[first].key;
      while (part.level() > common.level() + 1) part = part.parent();
      std::size_t end = first;
      while (end < nodes.size() && part.is_ancestor_or_self_of(nodes[end].key)) ++end;
      const std::span<const SizedNode> its = nodes.subspan(first, end - first);
      part = its.front().key;
      for (const SizedNode& node : its) part = common_ancestor(part, node.key);
      parts.emplace_back(part, its);
      first = end;
    }
    branch.first = static_cast<std::uint32_t>(tree_.size());
    branch.num = static_cast<std::uint32_t>(parts.size());
    tree_.resize(tree_.size() + parts.size());
    for (std::size_t k = 0; k < parts.size(); ++k)
      grow(branch.first + static_cast<std::uint32_t>(k), parts[k].first, parts[k].second);
  }
  tree_[place] = branch;
}

void SizeNodes::find_near(const Branches& branches, const Box& box, double& most,
                          Branches& near) const {
  near.clear();
  const double side = box.max.x - box.min.x;
  const auto lower = [&](const Branch& b) {
    const Box of_b = b.box();
    const double distance = b.num == 0 ? of_b.most_distance(box) : farthest_distance(of_b, box);
    most = std::min(most, b.least + growth_ * distance);
  };
  const auto may_matter = [&](const Branch& b) {
    const double distance = most - b.least;
    return distance >= 0 &&
           growth_ * growth_ * b.box().squared_distance(box) <= distance * distance;
  };
  for (const std::uint32_t n : branches) lower(tree_[n]);
  for (const std::uint32_t n : branches)
    if (may_matter(tree_[n])) near.push_back(n);
  // Parts take the place of what is too wide.
  for (std::size_t i = 0; i < near.size();) {
    const Branch& b = tree_[near[i]];
    if (b.num == 0 || b.side <= side) {
      ++i;
      continue;
    }
    near[i] = near.back();
    near.pop_back();
    for (std::uint32_t k = 0; k < b.num; ++k) lower(tree_[b.first + k]);
    for (std::uint32_t k = 0; k < b.num; ++k)
      if (may_matter(tree_[b.first + k])) near.push_back(b.first + k);
  }
  std::erase_if(near, [&](std::uint32_t n) { return !may_matter(tree_[n]); });
}

double SizeNodes::size_at(const Branches& branches, const Point& p, double most) const {
  // Deepest first: a branch's parts are a few.
  const auto ask = [&](const auto& self, std::uint32_t n) -> void {
    const Branch& b = tree_[n];
    const double distance = (most - b.least) / growth_;
    const double squared = b.box().squared_distance(p);
    if (!(distance > 0) || squared >= distance * distance) return;
    if (b.num == 0) {
      most = std::min(most, b.least + growth_ * std::sqrt(squared));
      return;
    }
    for (std::uint32_t k = 0; k < b.num; ++k) self(self, b.first + k);
  };
  for (const std::uint32_t n : branches) ask(ask, n);
  return most;
}

}  // namespace locvol
