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

// `border`: the length of sharp edges around it
bool is_strip(const SheetPart& part, double border, const SheetLaw& law) {
  constexpr double kMostTurn = 0.5;  // over the border
  const double least_width =
      part.num_points > 0 ? law.least_width : law.least_width / kLeastSheetWidth;
  return 2 * part.area.value() < least_width * border &&
         std::abs(part.turn.value()) < kMostTurn * border;
}

// Parts, put together from what ribs part.
struct WholeParts {
  std::vector<SheetPart> parts;
  std::vector<SheetBorder> borders;     // of these
  std::vector<std::uint32_t> of_piece;  // places of parts, by piece
};

class RibJoiner {
 public:
  RibJoiner(std::span<const SheetPart> pieces, std::span<const SheetBorder> borders,
            const SheetLaw& law)
      : pieces_(pieces.begin(), pieces.end()), borders_(borders), law_(law), sets_(pieces.size()) {
    for (SheetPart& piece : pieces_) piece.face_as_first();
  }

  WholeParts run() && {
    // What is narrow hangs together, and so does all else; then there may be strips.
    const std::vector<bool> is_narrow = those([&](const SheetPart& piece, double border) {
      return 2 * piece.area.value() < law_.least_width * border;
    });
    join_alike(is_narrow);
    std::vector<bool> is_strip = those([&](const SheetPart& piece, double border) {
      return locvol::is_strip(piece, border, law_);
    });
    for (std::size_t i = 0; i < is_strip.size(); ++i)
      if (!is_narrow[i]) is_strip[i] = false;
    join_alike(is_strip);
    return joined();
  }

 private:
  // is(part, length of its border), asked of what is put together so far; by piece.
  template <class Is>
  std::vector<bool> those(const Is& is) {
    const WholeParts whole = joined();
    std::vector<CompensatedSum> lengths(whole.parts.size());
    for (const SheetBorder& border : whole.borders)
      if (border.a != border.b)
        for (const std::uint32_t part : {border.a, border.b}) lengths[part].add(border.length);
    std::vector<bool> found;
    for (const std::uint32_t part : whole.of_piece)
      found.push_back(is(whole.parts[part], lengths[part].value()));
    return found;
  }

  void join_alike(const std::vector<bool>& kind) {
    for (const SheetBorder& border : borders_)
      if (border.is_rib && kind[border.a] == kind[border.b]) sets_.unite(border.a, border.b);
  }

  WholeParts joined() {
    WholeParts whole;
    for (std::uint32_t piece = 0; piece < pieces_.size(); ++piece) {
      const std::size_t first = sets_.find(piece);
      if (first == piece) {
        whole.of_piece.push_back(static_cast<std::uint32_t>(whole.parts.size()));
        whole.parts.push_back(pieces_[piece]);
      } else {
        whole.of_piece.push_back(whole.of_piece[first]);
        whole.parts[whole.of_piece[first]].add(pieces_[piece], false);
      }
    }
    for (const auto& [a, b, is_rib, length] : borders_)
      if (!is_rib) whole.borders.push_back({whole.of_piece[a], whole.of_piece[b], false, length});
    return whole;
  }

  std::vector<SheetPart> pieces_;
  std::span<const SheetBorder> borders_;
  const SheetLaw& law_;
  DisjointSets sets_;
};

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
    for (const auto& [a, b, is_rib, length] : borders) {
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
  SheetPiece piece(std::uint32_t part) {
    return {part, static_cast<std::uint32_t>(wholes_.find(part))};
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
    CompensatedSum border;
    for (const auto& [other, length] : beside_[part]) border.add(length);
    return locvol::is_strip(parts_[part], border.value(), law_);
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
  DisjointSets wholes_;                                          // see SheetPiece
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

SheetPlan plan_sheets(std::span<const SheetPart> pieces, std::span<const SheetBorder> all_borders,
                      std::span<const std::string> groups, const SheetLaw& law,
                      std::span<const std::array<BodyId, 2>> bodies_of_group, std::size_t most) {
  const auto [parts, borders, of_piece] = RibJoiner(pieces, all_borders, law).run();
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
  for (const std::uint32_t part : of_piece) {
    plan.of_part.push_back(number[merger.root_of(part)]);
    if (merger.has_strips()) plan.pieces.push_back(merger.piece(part));
  }
  name_sheets(group_of, groups, plan.sheets);
  return plan;
}

}  // namespace locvol
