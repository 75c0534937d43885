#include "engine/ingest/surface_bodies.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "engine/ingest/part_joiner.h"
#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_components.h"
#include "engine/ingest/surface_groups.h"
#include "engine/ingest/surface_text.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "octree/mix.h"

namespace locvol {
namespace {

constexpr std::uint64_t kNoTriangle = std::numeric_limits<std::uint64_t>::max();

// Of a component, what one cell has, or all of it.
struct BodyPart {
  SurfaceComponent sum;
  std::uint64_t first_triangle = kNoTriangle;

  void add(const BodyPart& other, bool is_turned) {
    sum.add(other.sum, is_turned);
    first_triangle = std::min(first_triangle, other.first_triangle);
  }
};

// What a cell has of a group in one of its parts.
struct PartGroup {
  std::uint32_t part = 0;
  SheetId group = 1;
  std::uint64_t first_triangle = kNoTriangle;
};

struct SharedByParts {  // a triangle that other cells have, too
  std::uint64_t id = 0;
  std::uint32_t part = 0;
  bool is_turned = false, is_last = false;
};

struct CellBodies {
  std::vector<Triangle> triangles;  // with the numbers of their parts in place of their changes
  std::vector<BodyPart> parts;
  std::vector<PartGroup> groups;
  std::vector<SharedByParts> shared;
};

CellBodies bodies_of_cell(std::vector<Triangle> triangles, const TriangleBucket& bucket,
                          const TriangleBuckets& buckets, double middle_z) {
  const Box box = buckets.frame().box(bucket.cell);
  const TriangleSoup soup = soup_of(triangles);
  const Mates mates = paired_edges(soup.vertices.size(), soup.triangles);
  const Components components = find_components(soup.triangles, mates);
  CellBodies cell;
  cell.parts.resize(components.count);
  std::map<std::pair<std::uint32_t, SheetId>, std::uint64_t> groups;
  for (std::uint32_t t = 0; t < triangles.size(); ++t) {
    Triangle& triangle = triangles[t];
    const std::uint32_t number = components.of_triangle[t];
    BodyPart& part = cell.parts[number];
    part.sum.add_corners(triangle);
    if (owns_triangle(box, triangle))
      part.sum.add_volume(triangle, components.is_turned[t], middle_z);
    part.first_triangle = std::min(part.first_triangle, triangle.id);
    const auto [group, is_new] = groups.try_emplace({number, triangle.sheet}, triangle.id);
    if (!is_new) group->second = std::min(group->second, triangle.id);
    if (TriangleBuckets::reaches_out(box, triangle))
      cell.shared.push_back({triangle.id, number, components.is_turned[t],
                             buckets.is_last_with(bucket.cell, triangle)});
    triangle.change = DomainState::in(number);
  }
  for (const auto& [place, first_triangle] : groups)
    cell.groups.push_back({place.first, place.second, first_triangle});
  cell.triangles = std::move(triangles);
  return cell;
}

// A component of the surface: a closed shell, with a body on either side.
struct Shell {
  BodyPart all;
  std::uint32_t of = 0;                 // which of the bodies that are given bounds it, from 0 on
  std::optional<std::uint32_t> around;  // the innermost other shell that it lies in
  BodyId inside = kNoBody, outside = kNoBody;
};

class BodyNumbering {
 public:
  BodyNumbering(CheckedSurface& surface, const BodyLaw& law, IngestWatch& watch, Workers& workers)
      : surface_(surface), law_(law), watch_(watch), workers_(workers) {}

  std::vector<BodyFacts> run() && {
    find_parts();
    find_owners();
    find_nesting();
    name_bodies();
    label();
    surface_.labels = labels();
    surface_.facts.volume = volume_.value();
    return std::move(bodies_);
  }

 private:
  // The buckets' triangles then carry the numbers of their parts.
  void find_parts() {
    PartJoiner<BodyPart> joiner;
    const double middle_z = surface_.facts.box.center().z;
    std::size_t place = 0;
    for_each_in_order(
        workers_, surface_.buckets.all(),
        [&](const TriangleBucket& bucket) { return surface_.load(bucket); },
        [&](const TriangleBucket& bucket, std::vector<Triangle> triangles) {
          throw_if_stopped(watch_.stop());
          return bodies_of_cell(std::move(triangles), bucket, surface_.buckets, middle_z);
        },
        [&](const TriangleBucket&, CellBodies& cell) {
          std::uint32_t first = 0;
          for (std::size_t i = 0; i < cell.parts.size(); ++i) {
            const std::uint32_t number = joiner.add_part(cell.parts[i]);
            if (i == 0) first = number;
          }
          for (const auto& [id, part, is_turned, is_last] : cell.shared)
            joiner.join(id, first + part, is_turned, is_last);
          for (PartGroup& group : cell.groups) {
            group.part += first;
            groups_.push_back(group);
          }
          for (Triangle& triangle : cell.triangles)
            triangle.change = DomainState::in(first + triangle.change.body());
          surface_.buckets.replace(surface_.spill, place++, cell.triangles);
          watch_.advance(cell.triangles.size());
        });
    surface_.has_copies = false;
    std::vector<std::uint32_t> numbers;
    const JoinedParts<BodyPart> joined = joiner.take(numbers);
    // In the order of their first triangles.
    std::vector<std::uint32_t> order(joined.components.size()), rank(order.size());
    for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
    std::ranges::sort(order, {},
                      [&](std::uint32_t i) { return joined.components[i].first_triangle; });
    for (std::uint32_t i = 0; i < order.size(); ++i) {
      rank[order[i]] = i;
      shells_.push_back({.all = joined.components[order[i]], .around = std::nullopt});
    }
    for (const std::uint32_t number : numbers) shell_of_part_.push_back(rank[number]);
  }

  bool is_by_file() const { return surface_.files.size() > 1; }

  // Files are bodies; of one file, its groups; without groups, the shells themselves. Files or
  // groups that are closed together alone are one body: they are its sheets.
  void find_owners() {
    if (!is_by_file() && surface_.groups.size() == 1) {
      names_.resize(shells_.size());
      for (std::uint32_t s = 0; s < shells_.size(); ++s) shells_[s].of = s;
      return require_few();
    }
    std::vector<std::string> given;
    if (is_by_file())
      for (const SurfaceFile& file : surface_.files) given.push_back(file.body);
    else
      given = surface_.groups;
    constexpr auto kNone = std::numeric_limits<std::uint32_t>::max();
    std::vector<std::uint32_t> first_of(shells_.size(), kNone), parents(given.size(), kNone);
    const auto root_of = [&](std::uint32_t i) {
      while (parents[i] != i) i = parents[i] = parents[parents[i]];
      return i;
    };
    for (const PartGroup& group : groups_) {
      const std::uint32_t its =
          is_by_file() ? surface_.file_of_group[group.group - 1] : group.group - 1;
      if (parents[its] == kNone) parents[its] = its;
      std::uint32_t& first = first_of[shell_of_part_[group.part]];
      if (first == kNone) first = its;
      const std::uint32_t a = root_of(first), b = root_of(its);
      parents[std::max(a, b)] = std::min(a, b);
    }
    std::vector<std::uint32_t> number(given.size());
    for (std::uint32_t i = 0; i < given.size(); ++i) {
      if (parents[i] == kNone) {
        if (is_by_file())
          throw InputError(fmt::format(
              "{}: all of its triangles lie on those of other files; give each body once",
              surface_.files[i].file));
        continue;  // points of all of its triangles were joined
      }
      const std::uint32_t root = root_of(i);
      if (root == i) {
        number[i] = static_cast<std::uint32_t>(names_.size());
        names_.push_back(given[i]);
      } else {
        names_[number[root]] += '+' + given[i];
      }
    }
    for (std::string& name : names_) name = shown_name(name);
    for (std::uint32_t s = 0; s < shells_.size(); ++s) shells_[s].of = number[root_of(first_of[s])];
    require_few();
  }
  void require_few() const {
    if (names_.size() > kMaxBodies)
      refuse("has {} bodies, more than {}; unite some", names_.size(), kMaxBodies);
  }

  // The marks of the shells around a shell add up to those around its innermost one and that one's
  // own.
  void find_nesting() {
    std::vector<SurfaceComponent> sums;
    for (const Shell& shell : shells_) sums.push_back(shell.all.sum);
    Nesting nesting(sums);
    const auto mark = [](std::uint32_t shell) { return mix(shell + 1); };
    for (const TriangleBucket& bucket : surface_.buckets.all()) {
      throw_if_stopped(watch_.stop());
      const Box cell = surface_.buckets.frame().box(bucket.cell);
      for (const Triangle& t : surface_.load(bucket))
        if (owns_triangle(cell, t)) nesting.add(t, mark(shell_of_part_[t.change.body()]));
      watch_.advance(bucket.triangles.count);
    }
    const std::vector<std::uint64_t> around = nesting.sums();
    std::unordered_map<std::uint64_t, std::uint32_t> by_sum;  // asked, never listed
    for (std::uint32_t s = 0; s < shells_.size(); ++s) by_sum.emplace(around[s] ^ mark(s), s);
    for (std::uint32_t s = 0; s < shells_.size(); ++s)
      if (around[s] != 0) shells_[s].around = by_sum.at(around[s]);
  }

  // Names are different, and voids are none of the bodies.
  void name_bodies() {
    std::set<std::string> taken;
    for (std::size_t b = 0; b < names_.size(); ++b) {
      std::string name = names_[b].empty() ? fmt::format("body {}", b + 1) : names_[b];
      for (int n = 2; !taken.insert(name).second; ++n)
        name = fmt::format("{}_{}", names_[b].empty() ? "body" : names_[b], n);
      names_[b] = name;
    }
    ids_.resize(names_.size());
    std::vector<bool> is_void(names_.size());
    for (const std::string& name : law_.voids) {
      const auto found = std::ranges::find(names_, name);
      if (found == names_.end())
        refuse("has no body that is called {}, as --void asks for; its bodies: {}", name,
               fmt::join(names_, ", "));
      is_void[static_cast<std::size_t>(found - names_.begin())] = true;
    }
    for (std::size_t b = 0; b < names_.size(); ++b) {
      if (is_void[b]) continue;
      bodies_.push_back({.name = names_[b]});
      ids_[b] = static_cast<BodyId>(bodies_.size());
    }
    if (bodies_.empty()) refuse("is all void: leave a body that is none");
  }

  // Of the places just inside a shell: the innermost body of those that they lie in. A shell of a
  // body around another one of the same body bounds a cavity of it.
  BodyId label_inside(std::uint32_t shell) const {
    std::vector<std::uint32_t> way;  // from outside
    for (std::optional<std::uint32_t> s = shell; s; s = shells_[*s].around) way.push_back(*s);
    std::vector<std::uint32_t> in;
    for (auto s = way.rbegin(); s != way.rend(); ++s) {
      const std::uint32_t body = shells_[*s].of;
      const auto held = std::ranges::find(in, body);
      if (held != in.end())
        in.erase(held);
      else
        in.push_back(body);
    }
    return in.empty() ? kNoBody : ids_[in.back()];
  }

  void label() {
    for (std::uint32_t s = 0; s < shells_.size(); ++s) shells_[s].inside = label_inside(s);
    for (Shell& shell : shells_) {
      if (shell.around) shell.outside = shells_[*shell.around].inside;
      if (shell.inside == shell.outside)
        refuse(
            "has a part of {}, up to {}, that bounds nothing, for the same lies on both of its "
            "sides; leave it out",
            names_[shell.of], text(shell.all.sum.top));
      const double enclosed = std::abs(shell.all.sum.volume());
      const auto add = [&](BodyId body, double its) {
        if (body == kNoBody) return;
        volumes_[body].add(its);
        volume_.add(its);
      };
      add(shell.inside, enclosed);
      add(shell.outside, -enclosed);
      if (ids_[shell.of] == kNoBody) continue;
      BodyFacts& body = bodies_[ids_[shell.of] - 1];
      if (body.num_shells++ == 0 && shell.inside == ids_[shell.of]) body.around = shell.outside;
      body.num_triangles += shell.all.sum.num_triangles;
    }
    for (std::size_t b = 0; b < bodies_.size(); ++b)
      bodies_[b].volume = volumes_[static_cast<BodyId>(b + 1)].value();
  }

  // Groups are cut where bodies change, and numbered anew by their first triangles.
  BodyLabels labels() {
    BodyLabels labels;
    for (const std::uint32_t shell : shell_of_part_)
      labels.changes.push_back(DomainState::between(shells_[shell].inside, shells_[shell].outside));
    const auto key_of = [&](const PartGroup& group) {
      const Shell& shell = shells_[shell_of_part_[group.part]];
      return std::tuple(std::max(shell.inside, shell.outside),
                        std::min(shell.inside, shell.outside), group.group);
    };
    std::map<std::tuple<BodyId, BodyId, SheetId>, std::uint64_t> firsts;
    for (const PartGroup& group : groups_) {
      const auto [first, is_new] = firsts.try_emplace(key_of(group), group.first_triangle);
      if (!is_new) first->second = std::min(first->second, group.first_triangle);
    }
    std::vector<std::pair<std::uint64_t, std::tuple<BodyId, BodyId, SheetId>>> in_order;
    for (const auto& [key, first] : firsts) in_order.emplace_back(first, key);
    std::ranges::sort(in_order);
    std::map<std::tuple<BodyId, BodyId, SheetId>, SheetId> numbers;
    std::vector<std::string> names;
    for (const auto& [first, key] : in_order) {
      const auto& [behind, before, group] = key;
      names.push_back(surface_.groups[group - 1]);
      numbers[key] = static_cast<SheetId>(names.size());
      surface_.bodies_of_group.push_back({behind, before});
    }
    surface_.groups = std::move(names);
    std::ranges::sort(groups_, {}, [](const PartGroup& g) { return std::pair(g.part, g.group); });
    labels.first.resize(shell_of_part_.size() + 1);
    for (const PartGroup& group : groups_) {
      labels.groups.push_back({group.group, numbers.at(key_of(group))});
      labels.first[group.part + 1] = static_cast<std::uint32_t>(labels.groups.size());
    }
    for (std::size_t p = 1; p < labels.first.size(); ++p)
      labels.first[p] = std::max(labels.first[p], labels.first[p - 1]);
    return labels;
  }

  template <typename... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> pattern, Args&&... args) const {
    throw InputError(fmt::format("{}: {}", surface_.facts.file,
                                 fmt::format(pattern, std::forward<Args>(args)...)));
  }

  CheckedSurface& surface_;
  const BodyLaw& law_;
  IngestWatch& watch_;
  Workers& workers_;
  std::vector<PartGroup> groups_;
  std::vector<std::uint32_t> shell_of_part_;
  std::vector<Shell> shells_;
  std::vector<std::string> names_;  // of the bodies that are given, with voids
  std::vector<BodyId> ids_;         // of these
  std::vector<BodyFacts> bodies_;
  std::map<BodyId, CompensatedSum> volumes_;
  CompensatedSum volume_;
};

}  // namespace

std::vector<BodyFacts> number_bodies(CheckedSurface& surface, const BodyLaw& law,
                                     IngestWatch& watch, Workers& workers) {
  if (!law.has_several()) return {};
  return BodyNumbering(surface, law, watch, workers).run();
}

}  // namespace locvol
