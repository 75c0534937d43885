// Puts parts of a surface together that hang together, from those that lie in one cell each.
#pragma once

#include <algorithm>
#include <compare>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

namespace locvol {

// A triangle that also lies beyond the cells that have come.
struct OpenTriangle {
  std::uint64_t id = 0;
  std::uint32_t component = 0;  // its place among these
  bool is_turned = false;       // against the component's orientation
  friend auto operator<=>(const OpenTriangle&, const OpenTriangle&) = default;
};

template <class Part>
struct JoinedParts {
  std::vector<Part> components;
  std::vector<OpenTriangle> open;  // in order of id
};

// Cells come in Morton order; a triangle that meets several cells is in a part of each, and so
// joins those parts. Part: add(other, is_turned) takes another one in.
// Memory: 12 bytes a part, and about 50 for each triangle of which a cell has come and another has
// not: those across a section of the model.
template <class Part>
class PartJoiner {
 public:
  // Numbers the parts that other cells may have parts of, from 0 on.
  std::uint32_t add_part(const Part& part) {
    const auto number = static_cast<std::uint32_t>(parts_.size());
    parts_.push_back(part);
    parents_.push_back({number, false});
    return number;
  }
  // A part that no other cell has part of.
  void add_whole(const Part& component) { components_.push_back(component); }
  // The triangle is in the part, `is_turned` against its orientation. `is_last`: no later cell has
  // it. Returns false if the orientations of its parts contradict each other.
  bool join(std::uint64_t triangle, std::uint32_t part, bool is_turned, bool is_last) {
    const auto known = open_.find(triangle);
    if (known == open_.end()) {
      if (!is_last) open_.emplace(triangle, Place{part, is_turned});
      return true;
    }
    const Place other = known->second;
    if (is_last) open_.erase(known);
    Place a = root_of(part), b = root_of(other.part);
    const bool differ = (a.is_turned != is_turned) != (b.is_turned != other.is_turned);
    if (a.part == b.part) return !differ;
    if (a.part < b.part) std::swap(a, b);
    parents_[a.part] = {b.part, differ};  // the first part stands for all
    return true;
  }
  // `numbers`: by part that has a number, the place of what it is part of.
  JoinedParts<Part> take(std::vector<std::uint32_t>& numbers) {
    for (std::uint32_t part = 0; part < parts_.size(); ++part) {
      const Place root = root_of(part);
      if (root.part != part) parts_[root.part].add(parts_[part], root.is_turned);
    }
    JoinedParts<Part> joined{std::move(components_), {}};
    numbers.resize(parts_.size());
    for (std::uint32_t part = 0; part < parts_.size(); ++part) {
      const std::uint32_t root = root_of(part).part;  // not after it
      if (root == part) {
        numbers[part] = static_cast<std::uint32_t>(joined.components.size());
        joined.components.push_back(parts_[part]);
      } else {
        numbers[part] = numbers[root];
      }
    }
    for (const auto& [triangle, place] : open_)
      joined.open.push_back(
          {triangle, numbers[place.part], place.is_turned != root_of(place.part).is_turned});
    std::ranges::sort(joined.open);
    return joined;
  }
  JoinedParts<Part> take() {
    std::vector<std::uint32_t> numbers;
    return take(numbers);
  }

 private:
  struct Place {
    std::uint32_t part = 0;
    bool is_turned = false;
  };

  Place root_of(std::uint32_t part) {
    Place root{part, false};
    while (parents_[root.part].part != root.part) {
      const Place parent = parents_[root.part];
      root = {parent.part, root.is_turned != parent.is_turned};
    }
    bool is_turned = root.is_turned;
    while (parents_[part].part != root.part && part != root.part) {  // shorten the path
      const Place parent = parents_[part];
      parents_[part] = {root.part, is_turned};
      is_turned = is_turned != parent.is_turned;
      part = parent.part;
    }
    return root;
  }

  std::vector<Part> components_, parts_;
  std::vector<Place> parents_;  // union-find, with the orientation relative to the parent's
  std::unordered_map<std::uint64_t, Place> open_;
};

}  // namespace locvol
