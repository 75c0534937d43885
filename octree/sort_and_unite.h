// Makes a set of a list.
#pragma once

#include <algorithm>
#include <functional>
#include <vector>

namespace locvol {

// Sorts values by a projection of theirs, and keeps one of those that are equal by it.
template <class T, class Projection = std::identity>
void sort_and_unite(std::vector<T>& values, Projection projection = {}) {
  std::ranges::sort(values, {}, projection);
  const auto again = std::ranges::unique(values, {}, projection);
  values.erase(again.begin(), again.end());
}

}  // namespace locvol
