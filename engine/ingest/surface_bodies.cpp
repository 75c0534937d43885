#include "engine/ingest/surface_bodies.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <span>
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
#include "octree/sort_and_unite.h"
#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

static_assert(kMaxBodies <= DomainState::kMostBody);

constexpr std::uint64_t kNoTriangle = std::numeric_limits<std::uint64_t>::max();

// Of a shell, what one cell has, or all of it.
struct ShellPart {
  SurfaceComponent sum;
  std::uint64_t first_triangle = kNoTriangle;

  void add(const ShellPart& other, bool is_turned) {
    sum.add(other.sum, is_turned);
    first_triangle = std::min(first_triangle, other.first_triangle);
  }
};

// Of a patch, likewise.
struct PatchPart {
  SurfaceComponent sum;
  Triangle first = {.id = kNoTriangle, .corners = {}};
  bool is_first_turned = false;  // against the orientation that the sum is of

  void add(const PatchPart& other, bool is_turned) {
    sum.add(other.sum, is_turned);
    if (other.first.id < first.id) {
      first = other.first;
      is_first_turned = other.is_first_turned != is_turned;
    }
  }
};

// What a cell has of a group in one of its parts of patches.
struct PartGroup {
  std::uint32_t part = 0;
  SheetId group = 1;
  std::uint64_t first_triangle = kNoTriangle;
};
// Which of the bodies that are given have triangles in a part of a shell.
struct PartBody {
  std::uint32_t part = 0, body = 0;
  friend auto operator<=>(const PartBody&, const PartBody&) = default;
};

struct SharedByParts {  // a triangle that other cells have, too
  std::uint64_t id = 0;
  std::uint32_t part = 0;
  bool is_turned = false, is_last = false;
};

struct CellBodies {
  // One of each place, with the numbers of their parts of patches in place of their changes.
  std::vector<Triangle> triangles;
  std::vector<ShellPart> shells;
  std::vector<PatchPart> patches;
  std::vector<std::vector<std::uint32_t>> shells_of_patch;  // parts
  std::vector<PartBody> bodies;
  std::vector<PartGroup> groups;
  std::vector<SharedByParts> shared_by_shells, shared_by_patches;
};

class BodiesOfCell {
 public:
  BodiesOfCell(std::vector<Triangle> triangles, const TriangleBucket& bucket,
               const TriangleBuckets& buckets, std::span<const std::uint32_t> given,
               bool has_contacts, double middle_z)
      : all_(std::move(triangles)),
        cell_(bucket.cell),
        buckets_(buckets),
        box_(buckets.frame().box(bucket.cell)),
        given_(given),
        has_contacts_(has_contacts),
        middle_z_(middle_z),
        soup_(soup_of(all_)) {}

  CellBodies run() && {
    find_shells();
    if (has_contacts_) find_places();
    find_patches();
    return std::move(found_);
  }

 private:
  void find_shells() {
    std::vector<std::uint32_t> bodies;
    for (const Triangle& triangle : all_) bodies.push_back(given_body(given_, triangle));
    Mates mates = paired_edges(soup_.vertices.size(), soup_.triangles, bodies);
    if (has_contacts_)
      unpair_others(mates, [&](std::uint32_t h) {
        return bodies[h / 3] == bodies[mates[h] / 3] || is_whole(h);
      });
    Components components = find_components(soup_.triangles, mates);
    found_.shells.resize(components.count);
    for (std::uint32_t t = 0; t < all_.size(); ++t) {
      const std::uint32_t number = components.of_triangle[t];
      ShellPart& part = found_.shells[number];
      take(all_[t], components.is_turned[t], number, part.sum, found_.shared_by_shells);
      part.first_triangle = std::min(part.first_triangle, all_[t].id);
      found_.bodies.push_back({number, bodies[t]});
    }
    sort_and_unite(found_.bodies);
    shell_of_ = std::move(components.of_triangle);
  }

  // Of triangles with the same vertices the first stands for all, with the shells of all.
  void find_places() {
    std::vector<std::pair<TriangleCorners, std::uint32_t>> sorted;
    for (std::uint32_t t = 0; t < all_.size(); ++t) {
      sorted.emplace_back(soup_.triangles[t], t);
      std::ranges::sort(sorted.back().first);
    }
    std::ranges::sort(sorted);
    shells_at_.resize(all_.size());
    std::vector<bool> is_first(all_.size());
    for (std::size_t i = 0, first = 0; i < sorted.size(); ++i) {
      if (sorted[i].first != sorted[first].first) first = i;
      is_first[sorted[i].second] = i == first;
      shells_at_[sorted[first].second].push_back(shell_of_[sorted[i].second]);
    }
    std::size_t kept = 0;
    for (std::size_t t = 0; t < all_.size(); ++t) {
      if (!is_first[t]) continue;
      soup_.triangles[kept] = soup_.triangles[t];
      shells_at_[kept].swap(shells_at_[t]);
      all_[kept++] = all_[t];
    }
    soup_.triangles.resize(kept);
    all_.resize(kept);
  }

  // What hangs together by edges of two triangles, which are then of the same shells.
  void find_patches() {
    Mates mates = paired_edges(soup_.vertices.size(), soup_.triangles);
    if (has_contacts_) unpair_others(mates, [&](std::uint32_t h) { return is_whole(h); });
    const Components components = find_components(soup_.triangles, mates);
    found_.patches.resize(components.count);
    found_.shells_of_patch.resize(components.count);
    std::map<std::pair<std::uint32_t, SheetId>, std::uint64_t> groups;
    for (std::uint32_t t = 0; t < all_.size(); ++t) {
      const Triangle& triangle = all_[t];
      const std::uint32_t number = components.of_triangle[t];
      PatchPart& part = found_.patches[number];
      take(triangle, components.is_turned[t], number, part.sum, found_.shared_by_patches);
      if (triangle.id < part.first.id) {
        part.first = triangle;
        part.is_first_turned = components.is_turned[t];
        found_.shells_of_patch[number] =
            has_contacts_ ? shells_at_[t] : std::vector<std::uint32_t>{shell_of_[t]};
      }
      const auto [group, is_new] = groups.try_emplace({number, triangle.sheet}, triangle.id);
      if (!is_new) group->second = std::min(group->second, triangle.id);
    }
    for (const auto& [place, first_triangle] : groups)
      found_.groups.push_back({place.first, place.second, first_triangle});
    for (std::uint32_t t = 0; t < all_.size(); ++t)
      all_[t].change = DomainState::instead_of(components.of_triangle[t]);
    found_.triangles = std::move(all_);
  }

  // Are all triangles at the edge here?
  bool is_whole(std::uint32_t h) const {
    return TriangleBuckets::meets_edge(box_, soup_.vertices[origin(soup_.triangles, h)],
                                       soup_.vertices[target(soup_.triangles, h)]);
  }

  void take(const Triangle& triangle, bool is_turned, std::uint32_t part, SurfaceComponent& sum,
            std::vector<SharedByParts>& shared) const {
    sum.add_corners(triangle);
    if (owns_triangle(box_, triangle)) sum.add_volume(triangle, is_turned, middle_z_);
    if (TriangleBuckets::reaches_out(box_, triangle))
      shared.push_back({triangle.id, part, is_turned, buckets_.is_last_with(cell_, triangle)});
  }

  std::vector<Triangle> all_;
  MortonKey cell_;
  const TriangleBuckets& buckets_;
  Box box_;
  std::span<const std::uint32_t> given_;
  bool has_contacts_;
  double middle_z_;
  TriangleSoup soup_;
  std::vector<std::uint32_t> shell_of_;                // of triangles, parts
  std::vector<std::vector<std::uint32_t>> shells_at_;  // likewise, of all at its place
  CellBodies found_;
};

// A component of what is given for a body: it is closed.
struct Shell {
  ShellPart all;
  std::uint32_t of = 0;  // which of the bodies that are given it bounds, from 0 on
};

// A part of the surface with the same shells everywhere, so with one body on either side.
struct Patch {
  PatchPart all;
  std::vector<std::uint32_t> shells;              // ascending
  std::size_t front_region = 0, back_region = 0;  // the first triangle's normal points to the front
  BodyId front = kNoBody, back = kNoBody;
};

// Places that lie in the same shells.
struct Region {
  std::vector<std::uint32_t> shells;  // ascending
  BodyId body = kNoBody;
  // Of the bodies that are given, the innermost there: one, unless some only overlap. Ascending.
  std::vector<std::uint32_t> innermost;
  CompensatedSum volume;
};

class BodyNumbering {
 public:
  BodyNumbering(CheckedSurface& surface, const BodyLaw& law, IngestWatch& watch, Workers& workers)
      : surface_(surface), law_(law), watch_(watch), workers_(workers) {}

  std::vector<BodyFacts> run() && {
    find_parts();
    find_owners();
    name_bodies();
    find_regions();
    find_nesting();
    label();
    add_up();
    note_overlaps();
    surface_.labels = labels();
    surface_.facts.volume = volume_.value();
    if (surface_.has_contacts) measure_net();
    return std::move(bodies_);
  }

 private:
  // The buckets' triangles then carry the numbers of their parts of patches.
  void find_parts() {
    PartJoiner<ShellPart> shells;
    PartJoiner<PatchPart> patches;
    std::vector<std::vector<std::uint32_t>> shells_of_part;
    const double middle_z = surface_.facts.box.center().z;
    std::size_t place = 0;
    for_each_in_order(
        workers_, surface_.buckets.all(),
        [&](const TriangleBucket& bucket) { return surface_.load(bucket); },
        [&](const TriangleBucket& bucket, std::vector<Triangle> triangles) {
          throw_if_stopped(watch_.stop());
          return BodiesOfCell(std::move(triangles), bucket, surface_.buckets, surface_.given_bodies,
                              surface_.has_contacts, middle_z)
              .run();
        },
        [&](const TriangleBucket&, CellBodies& cell) {
          const std::uint32_t first_shell = num_parts_of_shells_;
          const auto first_patch = static_cast<std::uint32_t>(shells_of_part.size());
          for (const ShellPart& part : cell.shells)
            num_parts_of_shells_ = shells.add_part(part) + 1;
          for (const PatchPart& part : cell.patches) patches.add_part(part);
          for (const auto& [id, part, is_turned, is_last] : cell.shared_by_shells)
            shells.join(id, first_shell + part, is_turned, is_last);
          for (const auto& [id, part, is_turned, is_last] : cell.shared_by_patches)
            patches.join(id, first_patch + part, is_turned, is_last);
          for (std::vector<std::uint32_t>& parts : cell.shells_of_patch) {
            for (std::uint32_t& part : parts) part += first_shell;
            shells_of_part.push_back(std::move(parts));
          }
          for (PartBody& body : cell.bodies)
            bodies_of_parts_.push_back({body.part + first_shell, body.body});
          for (PartGroup& group : cell.groups) {
            group.part += first_patch;
            groups_.push_back(group);
          }
          for (Triangle& triangle : cell.triangles)
            triangle.change = DomainState::instead_of(first_patch + triangle.change.number());
          surface_.buckets.replace(surface_.spill, place++, cell.triangles);
          watch_.advance(cell.triangles.size());
        });
    surface_.has_copies = false;
    shell_of_part_ = in_order(
        shells, [](const ShellPart& shell) { return shell.first_triangle; },
        [&](ShellPart& shell) { shells_.push_back({.all = shell}); });
    patch_of_part_ = in_order(
        patches, [](const PatchPart& patch) { return patch.first.id; },
        [&](PatchPart& patch) { patches_.push_back({.all = patch, .shells = {}}); });
    for (std::size_t part = 0; part < patch_of_part_.size(); ++part) {
      std::vector<std::uint32_t>& own = patches_[patch_of_part_[part]].shells;
      if (!own.empty()) continue;
      for (const std::uint32_t shell : shells_of_part[part]) own.push_back(shell_of_part_[shell]);
      std::ranges::sort(own);
    }
  }

  // What the parts are joined to, in the order of their first triangles; by part, its place there.
  template <class Part>
  static std::vector<std::uint32_t> in_order(PartJoiner<Part>& joiner, const auto& first_of,
                                             const auto& take) {
    std::vector<std::uint32_t> numbers;
    JoinedParts<Part> joined = joiner.take(numbers);
    std::vector<std::uint32_t> order(joined.components.size()), rank(order.size());
    std::iota(order.begin(), order.end(), std::uint32_t{0});
    std::ranges::sort(order, {}, [&](std::uint32_t i) { return first_of(joined.components[i]); });
    for (std::uint32_t i = 0; i < order.size(); ++i) {
      rank[order[i]] = i;
      take(joined.components[order[i]]);
    }
    for (std::uint32_t& number : numbers) number = rank[number];
    return numbers;
  }

  bool is_by_file() const { return surface_.files.size() > 1; }

  // Without names, each shell is one. Files or groups that are closed together alone are one body:
  // they are its sheets.
  void find_owners() {
    if (surface_.given_bodies.empty()) {
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
    for (const auto& [part, its] : bodies_of_parts_) {
      if (parents[its] == kNone) parents[its] = its;
      std::uint32_t& first = first_of[shell_of_part_[part]];
      if (first == kNone) first = its;
      const std::uint32_t a = root_of(first), b = root_of(its);
      parents[std::max(a, b)] = std::min(a, b);
    }
    std::vector<std::uint32_t> number(given.size());
    for (std::uint32_t i = 0; i < given.size(); ++i) {
      if (parents[i] == kNone) {
        if (is_by_file())
          throw InputError(
              fmt::format("{}: nothing is left of it, for points of all of its "
                          "triangles were joined; leave it out",
                          surface_.files[i].file));
        continue;
      }
      const std::uint32_t root = root_of(i);
      if (root == i) {
        number[i] = static_cast<std::uint32_t>(names_.size());
        names_.push_back(given[i]);
        if (is_by_file()) files_.push_back(surface_.files[i].file);
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

  // Each shell has a mark, and a patch those of its shells, added up without a carry. What a ray
  // from beside a patch upwards crosses adds up to the marks of the shells that the place lies in:
  // so places with the same sum are in the same region. From outside, patch after patch, it is
  // found which shells that are.
  void find_regions() {
    const auto mark = [](std::uint32_t shell) { return mix(shell + 1); };
    std::vector<std::uint64_t> marks;
    std::vector<std::array<Point, 3>> firsts;
    for (const Patch& patch : patches_) {
      firsts.push_back(patch.all.first.corners);
      marks.push_back(0);
      for (const std::uint32_t shell : patch.shells) marks.back() ^= mark(shell);
    }
    Nesting nesting{std::span<const std::array<Point, 3>>(firsts)};
    for (const TriangleBucket& bucket : surface_.buckets.all()) {
      throw_if_stopped(watch_.stop());
      const Box cell = surface_.buckets.frame().box(bucket.cell);
      for (const Triangle& t : surface_.load(bucket))
        if (owns_triangle(cell, t)) nesting.add(t, marks[patch_of_part_[t.change.number()]]);
      watch_.advance(bucket.triangles.count);
    }
    const std::vector<std::uint64_t> above = nesting.sums();

    std::unordered_map<std::uint64_t, std::size_t> by_sum = {{0, 0}};  // asked, never listed
    const auto region = [&](std::uint64_t sum) {
      return by_sum.try_emplace(sum, by_sum.size()).first->second;
    };
    for (std::size_t p = 0; p < patches_.size(); ++p) {
      patches_[p].front_region = region(above[p]);
      patches_[p].back_region = region(above[p] ^ marks[p]);
      if (!leads_up(firsts[p])) std::swap(patches_[p].front_region, patches_[p].back_region);
    }
    regions_.resize(by_sum.size());
    std::vector<std::vector<std::size_t>> patches_at(regions_.size());
    for (std::size_t p = 0; p < patches_.size(); ++p)
      for (const std::size_t r : {patches_[p].front_region, patches_[p].back_region})
        patches_at[r].push_back(p);
    std::vector<bool> is_known(regions_.size());
    is_known[0] = true;
    std::vector<std::size_t> known = {0};
    for (std::size_t n = 0; n < known.size(); ++n)
      for (const std::size_t p : patches_at[known[n]]) {
        const std::size_t beyond = patches_[p].front_region ^ patches_[p].back_region ^ known[n];
        if (is_known[beyond]) continue;
        is_known[beyond] = true;
        known.push_back(beyond);
        std::ranges::set_symmetric_difference(regions_[known[n]].shells, patches_[p].shells,
                                              std::back_inserter(regions_[beyond].shells));
      }
    assert(known.size() == regions_.size() && "all of space hangs together");
  }
  // Does a ray upwards that is moved a little begin in front of the triangle?
  static bool leads_up(const std::array<Point, 3>& corners) {
    const auto& [a, b, c] = corners;
    for (const int axis : {2, 0, 1})
      if (const int sign = orientation_along(axis, a, b, c); sign != 0) return sign > 0;
    return true;
  }

  // Of each shell, which lie around all of it.
  void find_nesting() {
    std::size_t work = 0;
    around_.resize(shells_.size());
    for (const Region& region : regions_) work += region.shells.size() * region.shells.size();
    constexpr std::size_t kMostWork = 1'000'000'000;
    if (work > kMostWork) refuse("has shells that lie in each other too deep; leave some out");
    std::vector<bool> is_known(shells_.size());
    std::vector<std::uint32_t> both;
    for (const Region& region : regions_)
      for (const std::uint32_t shell : region.shells) {
        if (!is_known[shell]) {
          is_known[shell] = true;
          around_[shell] = region.shells;
          continue;
        }
        both.clear();
        std::ranges::set_intersection(around_[shell], region.shells, std::back_inserter(both));
        around_[shell] = both;
      }
  }
  bool lies_in(std::uint32_t shell, std::uint32_t other) const {
    return std::ranges::binary_search(around_[shell], other);
  }

  // The innermost of the bodies that the region lies in. A shell of a body in another one of the
  // same body bounds a cavity of it.
  std::vector<std::uint32_t> innermost_of(const Region& region) const {
    struct Held {
      std::uint32_t body = 0, shell = 0;  // the innermost one
      bool is_in = false;
    };
    std::vector<Held> held;
    for (const std::uint32_t shell : region.shells) {
      const std::uint32_t body = shells_[shell].of;
      const auto known = std::ranges::find(held, body, &Held::body);
      if (known == held.end()) {
        held.push_back({body, shell, true});
        continue;
      }
      known->is_in = !known->is_in;
      if (lies_in(shell, known->shell)) known->shell = shell;
    }
    std::erase_if(held, [](const Held& h) { return !h.is_in; });
    const auto is_around_another = [&](const Held& h) {
      return std::ranges::any_of(held, [&](const Held& other) {
        return lies_in(other.shell, h.shell) && !lies_in(h.shell, other.shell);
      });
    };
    std::vector<std::uint32_t> innermost;
    for (const Held& h : held)
      if (!is_around_another(h)) innermost.push_back(h.body);
    std::ranges::sort(innermost);
    return innermost;
  }

  void label() {
    for (Region& region : regions_) {
      region.innermost = innermost_of(region);
      if (!region.innermost.empty()) region.body = ids_[region.innermost.front()];
    }
    std::vector<bool> is_kept(bodies_.size() + 1), bounds(shells_.size());
    for (Patch& patch : patches_) {
      patch.front = regions_[patch.front_region].body;
      patch.back = regions_[patch.back_region].body;
      is_kept[patch.front] = is_kept[patch.back] = true;
      for (const std::uint32_t shell : patch.shells)
        bounds[shell] = bounds[shell] || patch.front != patch.back;
    }
    for (std::size_t s = 0; s < shells_.size(); ++s)
      if (!bounds[s])
        refuse(
            "has a part of {}, up to {}, that bounds nothing, for the same lies on both of its "
            "sides; leave it out",
            names_[shells_[s].of], text(shells_[s].all.sum.top));
    for (std::size_t b = 0; b < names_.size(); ++b)
      if (ids_[b] != kNoBody && !is_kept[ids_[b]])
        throw InputError(fmt::format(
            "{}: nothing is left of the body {}, for bodies that lie in it, or were given before "
            "it, take all of its place; leave it out",
            files_.empty() ? surface_.facts.file : files_[b], names_[b]));
  }

  void add_up() {
    for (const Patch& patch : patches_) {
      const double volume =
          patch.all.is_first_turned ? -patch.all.sum.volume() : patch.all.sum.volume();
      const auto add = [&](BodyId body, double its) {
        if (body == kNoBody) return;
        volumes_[body].add(its);
        volume_.add(its);
      };
      regions_[patch.back_region].volume.add(volume);
      regions_[patch.front_region].volume.add(-volume);
      if (patch.front == patch.back) continue;
      add(patch.back, volume);
      add(patch.front, -volume);
    }
    std::vector<std::optional<std::uint32_t>> first_shell(bodies_.size());
    for (std::uint32_t s = 0; s < shells_.size(); ++s) {
      const BodyId id = ids_[shells_[s].of];
      if (id == kNoBody) continue;
      BodyFacts& body = bodies_[id - 1];
      if (body.num_shells++ == 0) first_shell[id - 1] = s;
      body.num_triangles += shells_[s].all.sum.num_triangles;
    }
    std::vector<std::vector<BodyId>> beyond(bodies_.size());  // the first shell, of the body
    for (const Patch& patch : patches_) {
      if (patch.front == patch.back) continue;
      for (const auto& [body, other] :
           {std::pair(patch.front, patch.back), {patch.back, patch.front}})
        if (body != kNoBody && first_shell[body - 1] &&
            std::ranges::binary_search(patch.shells, *first_shell[body - 1]))
          beyond[body - 1].push_back(other);
    }
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
      bodies_[b].volume = volumes_[static_cast<BodyId>(b + 1)].value();
      sort_and_unite(beyond[b]);
      if (beyond[b].size() == 1) bodies_[b].around = beyond[b].front();
    }
  }

  // Of bodies that only overlap, the first has the place.
  void note_overlaps() {
    std::map<std::pair<std::uint32_t, std::uint32_t>, CompensatedSum> volumes;
    for (const Region& region : regions_)
      for (std::size_t i = 1; i < region.innermost.size(); ++i)
        volumes[{region.innermost.front(), region.innermost[i]}].add(region.volume);
    std::size_t num_told = 0;
    for (const auto& [bodies, volume] : volumes) {
      if (num_told++ == kMostToldPairs) break;
      surface_.facts.notes.push_back(fmt::format(
          "{} and {} overlap, in a volume of {:.6g}: {} has the place", names_[bodies.first],
          names_[bodies.second], volume.value(), names_[bodies.first]));
    }
    if (volumes.size() > kMostToldPairs)
      surface_.facts.notes.push_back(
          fmt::format("{} more pairs of bodies overlap", volumes.size() - kMostToldPairs));
  }

  // Groups are cut where bodies change, and numbered anew by their first triangles.
  BodyLabels labels() {
    BodyLabels labels;
    for (const std::uint32_t patch : patch_of_part_)
      labels.changes.push_back(DomainState::between(patches_[patch].front, patches_[patch].back));
    std::erase_if(groups_, [&](const PartGroup& group) {
      return labels.changes[group.part] == DomainState();
    });
    const auto key_of = [&](const PartGroup& group) {
      const Patch& patch = patches_[patch_of_part_[group.part]];
      return std::tuple(std::max(patch.front, patch.back), std::min(patch.front, patch.back),
                        group.group);
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
    labels.first.resize(patch_of_part_.size() + 1);
    for (const PartGroup& group : groups_) {
      labels.groups.push_back({group.group, numbers.at(key_of(group))});
      labels.first[group.part + 1] = static_cast<std::uint32_t>(labels.groups.size());
    }
    for (std::size_t p = 1; p < labels.first.size(); ++p)
      labels.first[p] = std::max(labels.first[p], labels.first[p - 1]);
    return labels;
  }

  // Each place once, and without what bounds nothing.
  void measure_net() {
    struct Nothing {
      void add(const Nothing&, bool) {}
    };
    struct Net {
      std::uint64_t num_vertices = 0, num_edges = 0, num_triangles = 0;
      CompensatedSum area;
      std::uint32_t num_parts = 0;
      std::vector<SharedByParts> shared;
    };
    PartJoiner<Nothing> joiner;
    Net all;
    for_each_in_order(
        workers_, surface_.buckets.all(),
        [&](const TriangleBucket& bucket) { return surface_.load(bucket); },
        [&](const TriangleBucket& bucket, const std::vector<Triangle>& triangles) {
          throw_if_stopped(watch_.stop());
          const Box box = surface_.buckets.frame().box(bucket.cell);
          const TriangleSoup soup = soup_of(triangles);
          const auto is_owned = [&](std::uint32_t v) {
            return TriangleBuckets::owns(box, soup.vertices[v]);
          };
          Net net;
          for (std::uint32_t v = 0; v < soup.vertices.size(); ++v) net.num_vertices += is_owned(v);
          EdgeTable(soup.vertices.size(), soup.triangles)
              .for_each_edge([&](std::span<const std::uint32_t> uses) {
                const std::uint32_t v = origin(soup.triangles, uses[0]),
                                    w = target(soup.triangles, uses[0]);
                net.num_edges += is_owned(soup.vertices[v] < soup.vertices[w] ? v : w);
              });
          // What has vertices in common is one.
          std::vector<std::uint32_t> parents(soup.vertices.size());
          std::iota(parents.begin(), parents.end(), std::uint32_t{0});
          const auto root_of = [&](std::uint32_t v) {
            while (parents[v] != v) v = parents[v] = parents[parents[v]];
            return v;
          };
          for (const auto& [a, b, c] : soup.triangles)
            for (const std::uint32_t v : {b, c}) {
              const std::uint32_t one = root_of(a), other = root_of(v);
              parents[std::max(one, other)] = std::min(one, other);
            }
          std::map<std::uint32_t, std::uint32_t> parts;  // by root
          for (std::uint32_t t = 0; t < triangles.size(); ++t) {
            const Triangle& triangle = triangles[t];
            const auto part = parts.try_emplace(root_of(soup.triangles[t][0]), net.num_parts).first;
            net.num_parts = static_cast<std::uint32_t>(parts.size());
            if (owns_triangle(box, triangle)) {
              ++net.num_triangles;
              const auto& [a, b, c] = triangle.corners;
              net.area.add(0.5 * norm(cross(b - a, c - a)));
            }
            if (TriangleBuckets::reaches_out(box, triangle))
              net.shared.push_back({triangle.id, part->second, false,
                                    surface_.buckets.is_last_with(bucket.cell, triangle)});
          }
          return net;
        },
        [&](const TriangleBucket& bucket, const Net& net) {
          std::uint32_t first = 0;
          for (std::uint32_t i = 0; i < net.num_parts; ++i)
            if (const std::uint32_t number = joiner.add_part({}); i == 0) first = number;
          for (const auto& [id, part, is_turned, is_last] : net.shared)
            joiner.join(id, first + part, false, is_last);
          all.num_vertices += net.num_vertices;
          all.num_edges += net.num_edges;
          all.num_triangles += net.num_triangles;
          all.area.add(net.area);
          watch_.advance(bucket.triangles.count);
        });
    SurfaceFacts& facts = surface_.facts;
    facts.num_vertices = all.num_vertices;
    facts.num_triangles = all.num_triangles;
    facts.num_components = joiner.take().components.size();
    facts.euler_characteristic = static_cast<std::int64_t>(all.num_vertices) -
                                 static_cast<std::int64_t>(all.num_edges) +
                                 static_cast<std::int64_t>(all.num_triangles);
    facts.area = all.area.value();
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
  std::uint32_t num_parts_of_shells_ = 0;
  std::vector<PartBody> bodies_of_parts_;
  std::vector<PartGroup> groups_;
  std::vector<std::uint32_t> shell_of_part_, patch_of_part_;
  std::vector<Shell> shells_;
  std::vector<Patch> patches_;
  std::vector<Region> regions_;                     // the first is what is outside of all
  std::vector<std::vector<std::uint32_t>> around_;  // of shells, with themselves: ascending
  std::vector<std::string> names_;                  // of the bodies that are given, with voids
  std::vector<std::string> files_;                  // of these, if each is one
  std::vector<BodyId> ids_;                         // of these
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
