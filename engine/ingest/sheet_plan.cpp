#include "engine/ingest/sheet_plan.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <tuple>
#include <utility>

#include "octree/disjoint_sets.h"

namespace locvol {
namespace {

class SpeckMerger {
 public:
  SpeckMerger(std::span<const SheetPart> parts, std::span<const SheetBorder> borders,
              const SheetLaw& law)
      : parts_(parts.begin(), parts.end()),
        beside_(parts.size()),
        parents_(parts.size()),
        wholes_(parts.size()),
        law_(law) {
    std::iota(parents_.begin(), parents_.end(), std::uint32_t{0});
    for (const auto& [a, b, length] : borders) {
      if (a == b) continue;
      beside_[a][b].add(length);
      beside_[b][a].add(length);
    }
  }

  // Returns how many specks there were.
  std::uint64_t run() {
    for (std::uint32_t part = 0; part < parts_.size(); ++part) add_if_small(part);
    std::uint64_t num_specks = 0;
    while (!small_.empty()) {
      const std::uint32_t speck = std::get<2>(small_.extract(small_.begin()).value());
      if (beside_[speck].empty()) continue;
      ++num_specks;
      const std::uint32_t with = neighbor_of(speck);
      if (is_strip(speck)) {
        has_strips_ = true;
        wholes_.unite(speck, with);
      }
      unite(speck, with);
    }
    return num_specks;
  }

  std::uint32_t root_of(std::uint32_t part) {
    while (parents_[part] != part) part = parents_[part] = parents_[parents_[part]];
    return part;
  }
  bool has_strips() const { return has_strips_; }
  std::uint32_t whole_of(std::uint32_t part) {
    return static_cast<std::uint32_t>(wholes_.find(part));
  }
  const SheetPart& part(std::uint32_t root) const { return parts_[root]; }

 private:
  using Small = std::tuple<double, std::uint64_t, std::uint32_t>;  // area, first triangle, part
  Small small(std::uint32_t part) const {
    return {parts_[part].area.value(), parts_[part].first_triangle, part};
  }
  void add_if_small(std::uint32_t part) {
    if (parts_[part].area.value() < law_.least_area || is_strip(part)) small_.insert(small(part));
  }
  bool is_strip(std::uint32_t part) const {
    constexpr double kMostTurn = 0.5;  // over the border
    if (!(law_.least_width > 0) || parts_[part].num_points == 0) return false;
    CompensatedSum border;
    for (const auto& [other, length] : beside_[part]) border.add(length);
    return 2 * parts_[part].area.value() < law_.least_width * border.value() &&
           std::abs(parts_[part].turn.value()) < kMostTurn * border.value();
  }

  std::uint32_t neighbor_of(std::uint32_t speck) const {
    const auto& beside = beside_[speck];
    const auto by_length = [&](const auto& one, const auto& other) {
      const double length = one.second.value(), longest = other.second.value();
      if (length != longest) return length < longest;
      return parts_[one.first].first_triangle > parts_[other.first].first_triangle;
    };
    return std::ranges::max_element(beside, by_length)->first;
  }

  void unite(std::uint32_t speck, std::uint32_t with) {
    small_.erase(small(with));
    parts_[with].add(parts_[speck], false);
    parents_[speck] = with;
    for (const auto& [other, length] : std::exchange(beside_[speck], {})) {
      beside_[other].erase(speck);
      if (other == with) continue;
      beside_[other][with].add(length);
      beside_[with][other].add(length);
    }
    add_if_small(with);
  }

  std::vector<SheetPart> parts_;
  std::vector<std::map<std::uint32_t, CompensatedSum>> beside_;  // lengths of borders
  std::vector<std::uint32_t> parents_;                           // a forest; roots are sheets
  DisjointSets wholes_;                                          // see SheetPlan::whole_of_part
  bool has_strips_ = false;
  std::set<Small> small_;
  SheetLaw law_;
};

// Names that are all different: where one is taken, by that of a group, an underscore is added.
class SheetNames {
 public:
  explicit SheetNames(std::span<const std::string> groups) : taken_(groups.begin(), groups.end()) {}
  std::string unused(std::string name) {
    while (!taken_.insert(name).second) name += '_';
    return name;
  }

 private:
  std::set<std::string> taken_;
};

// Several groups may have one name: those of several bodies.
void name_sheets(std::span<const SheetId> group_of, std::span<const std::string> groups,
                 std::vector<SheetFacts>& sheets) {
  std::map<std::string, std::size_t> num_sheets, num_named;
  for (const SheetId group : group_of) ++num_sheets[groups[group - 1]];
  SheetNames names(groups);
  for (std::size_t s = 0; s < sheets.size(); ++s) {
    const std::string& name = groups[group_of[s] - 1];
    sheets[s].group = name;
    if (name.empty())
      sheets[s].name = names.unused("sheet " + std::to_string(s + 1));
    else if (num_sheets[name] == 1)
      sheets[s].name = name;
    else
      sheets[s].name = names.unused(name + '_' + std::to_string(++num_named[name]));
  }
}

}  // namespace

SheetPlan plan_sheets(std::span<const SheetPart> parts, std::span<const SheetBorder> borders,
                      std::span<const std::string> groups, const SheetLaw& law,
                      std::span<const std::array<BodyId, 2>> bodies_of_group, std::size_t most) {
  SpeckMerger merger(parts, borders, law);
  SheetPlan plan;
  plan.num_specks = merger.run();
  std::vector<std::uint32_t> roots;
  for (std::uint32_t part = 0; part < parts.size(); ++part)
    if (merger.root_of(part) == part) roots.push_back(part);
  if (roots.size() > most) {
    plan.num_too_many = roots.size();
    return plan;
  }
  std::ranges::sort(roots, {}, [&](auto root) { return merger.part(root).first_triangle; });
  std::vector<SheetId> number(parts.size()), group_of;
  for (const std::uint32_t root : roots) {
    SheetFacts facts;
    facts.first_triangle = merger.part(root).first_triangle;
    if (!bodies_of_group.empty()) facts.bodies = bodies_of_group[merger.part(root).group - 1];
    plan.sheets.push_back(std::move(facts));
    number[root] = static_cast<SheetId>(plan.sheets.size());
    group_of.push_back(merger.part(root).group);
  }
  for (std::uint32_t part = 0; part < parts.size(); ++part)
    plan.of_part.push_back(number[merger.root_of(part)]);
  for (std::uint32_t part = 0; merger.has_strips() && part < parts.size(); ++part)
    plan.whole_of_part.push_back(merger.whole_of(part));
  name_sheets(group_of, groups, plan.sheets);
  return plan;
}

}  // namespace locvol
