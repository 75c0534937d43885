// SurfaceGroups numbers the groups of a surface's triangles that have names, in the order of their
// first triangles. What has no name is one group, with an empty one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "octree/mesh_facet.h"

namespace locvol {

// A name as files and messages can show it: UTF-8 without blanks around it, of 255 bytes at most.
// What is no character that can be seen becomes an underscore.
std::string shown_name(std::string_view text);

// Memory: that of the names, 4 MB at most.
class SurfaceGroups {
 public:
  static constexpr std::size_t kMaxGroups = 10'000, kMaxNameBytes = 255;

  void begin(std::string_view name);  // of what comes from here on
  // Groups from here on are others than those before, even if they have the same names. What has no
  // name gets this one.
  void begin_body(std::string_view name);
  bool has_too_many() const { return groups_.size() > kMaxGroups; }
  // Stands for the group until its number is known.
  std::uint32_t current();
  const std::string& current_name() const { return name_.empty() ? body_name_ : name_; }
  // From 1 on, given when it is first asked for. `group`: of current()
  SheetId number_of(std::uint32_t group) {
    if (numbers_[group] == 0) give_number(group);
    return numbers_[group];
  }
  bool has_cut_names() const { return has_cut_names_; }
  std::vector<std::string> take_names() { return std::move(names_); }  // by number
  // By number, how many bodies have begun before the one that the group is of; 0: the first.
  std::vector<std::uint32_t> take_bodies() { return std::move(bodies_); }

 private:
  void give_number(std::uint32_t group);

  using Key = std::pair<std::uint32_t, std::string>;  // its body, its name
  std::map<Key, std::uint32_t> groups_;
  std::vector<const Key*> keys_;  // by group
  std::vector<SheetId> numbers_;  // of groups; 0: none of its triangles has come
  std::vector<std::string> names_;
  std::vector<std::uint32_t> bodies_;
  std::string name_, body_name_;
  std::uint32_t num_bodies_ = 0;
  std::uint32_t current_ = kUnknown;
  bool has_cut_names_ = false;
  static constexpr std::uint32_t kUnknown = 0xffffffff;
};

}  // namespace locvol
