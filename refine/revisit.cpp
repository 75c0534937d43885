#include "refine/revisit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <string>

namespace locvol {

std::optional<Revisit> Revisit::of(const LeafInput& input, const SizeField& sizes) {
  if (!input.last_visit) return std::nullopt;
  Revisit revisit(input, sizes);
  revisit.find_active();
  if (revisit.num_active_ > input.own.size() / 4) return std::nullopt;
  revisit.gather_part();
  return revisit;
}

Revisit::Revisit(const LeafInput& input, const SizeField& sizes)
    : input_(&input), sizes_(&sizes), is_active_(input.own.size()) {}

// Within the reach, for it can make balls as large as count; if that is infinite, to the stars that
// it was in, and what else can matter is found when it does (WholeModel::points).
double Revisit::deletion_matters(const Point& q) const {
  if (!sizes_->is_uniform()) return sizes_->reach_of_balls(q, kReach);
  const double reach = input_->criteria.reach;
  return std::isfinite(reach) ? reach : insertion_matters(q);
}

// As far as points are loaded, if that is not all that there are.
template <class Item>
CubesOf<Item> Revisit::cubes_of(const LeafInput& input, std::span<const Item> items) {
  const double reach = input.criteria.reach;
  const Box box = std::isfinite(reach) ? input.box.expanded(reach) : input.box;
  constexpr double kMostCubes = 64;  // in a row
  return {box, input.criteria.size, kMostCubes, items};
}

CubesOf<Revisit::Numbered> Revisit::cubes_of_all(const LeafInput& input) {
  std::vector<Numbered> points;
  points.reserve(input.own.size() + input.ghosts.size());
  for (const auto* some : {&input.own, &input.ghosts})
    for (const MeshPoint& p : *some)
      points.push_back({p.position, static_cast<std::uint32_t>(points.size())});
  return cubes_of<Numbered>(input, points);
}

const MeshPoint& Revisit::point(std::size_t i) const {
  const std::size_t num_own = input_->own.size();
  return i < num_own ? input_->own[i] : input_->ghosts[i - num_own];
}

template <class Visit>
void Revisit::for_each_near(const Point& q, double distance, Visit visit) const {
  cubes_->for_each_around(q, distance, [&](const Numbered& p) {
    return squared_distance(p.position, q) >= distance * distance || visit(p.number);
  });
}

// Around what was inserted since, and what others ask to look at. Not of what C7 changed: this
// leaf's list of cells knows it by now.
void Revisit::find_active() {
  std::vector<Point> inserted = input_->last_visit->asked;
  for (const auto* points : {&input_->own, &input_->ghosts})
    for (const MeshPoint& p : *points)
      if (p.id >= input_->last_visit->first_new_id && p.kind != PointKind::kVolume)
        inserted.push_back(p.position);
  const auto insertions = cubes_of<Point>(*input_, inserted);
  for (std::size_t i = 0; i < is_active_.size(); ++i)
    is_active_[i] =
        !insertions.is_free(input_->own[i].position, insertion_matters(input_->own[i].position));
  num_active_ = static_cast<std::size_t>(std::ranges::count(is_active_, true));
}

void Revisit::gather_part() {
  cubes_ = cubes_of_all(*input_);
  part_.criteria = input_->criteria;
  part_.box = input_->box;
  part_.max_insertions = input_->max_insertions;
  part_.waiting = input_->waiting;
  if (input_->max_own_points > 0)
    part_.max_own_points = input_->max_own_points - (input_->own.size() - num_active_);
  is_in_part_.resize(num_points());
  for (std::size_t i = 0; i < is_active_.size(); ++i)
    if (is_active_[i])
      for_each_near(input_->own[i].position, deletion_matters(input_->own[i].position),
                    [&](std::size_t k) {
                      is_in_part_[k] = true;
                      return true;
                    });
  // What C7 may ask for besides is left out until it does.
  const bool is_all_given = input_->criteria.min_dihedral > 0 && num_active_ > 0;
  for (std::size_t i = 0; i < is_in_part_.size(); ++i) {
    if (!is_in_part_[i] && !is_all_given) continue;
    const bool is_own = i < is_active_.size() && is_active_[i];
    (is_own ? part_.own : part_.ghosts).push_back(point(i));
  }
}

bool Revisit::is_complete(const LeafDelta& delta) const {
  bool is_complete = true;
  const auto require_active = [&](const Point& q, double distance) {
    for_each_near(q, distance, [&](std::size_t i) {
      is_complete &= i >= is_active_.size() || is_active_[i];
      return is_complete;
    });
  };
  for (const InsertedPoint& p : delta.inserted) {
    const Point& q = p.position;
    require_active(q, p.is_deleted ? deletion_matters(q) : insertion_matters(q));
    for_each_near(q, deletion_matters(q), [&](std::size_t i) {
      is_complete &= is_in_part_[i];
      return is_complete;
    });
  }
  for (const MeshPoint& p : delta.deleted) require_active(p.position, deletion_matters(p.position));
  return is_complete;
}

namespace {

const MeshPoint* find_in(const std::vector<MeshPoint>& points, VertexRef id) {
  const auto found = std::ranges::lower_bound(points, id, {}, &MeshPoint::id);
  return found != points.end() && found->id == id ? &*found : nullptr;
}

}  // namespace

// The position of a vertex; of a point of the core, which no cell is of, one behind all others.
Point Revisit::place_among_smallest(VertexRef id, const CoreIndex* core) const {
  for (const auto* points : {&input_->own, &input_->ghosts})
    if (const MeshPoint* found = find_in(*points, id)) return found->position;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (core && id < kFirstOtherId && core->contains(site_of(id)))
    return {kInfinity, kInfinity, kInfinity};
  throw RefineError("a cell of the last visit has the point " + std::to_string(id) +
                    ", which is not loaded");
}

std::vector<Revisit::VertexKind> Revisit::kinds_of(const std::vector<VertexRef>& vertices) const {
  std::vector<VertexKind> kinds(vertices.size(), VertexKind::kOther);
  for (std::size_t i = 0; i < is_active_.size(); ++i) {
    const auto found = std::ranges::lower_bound(vertices, input_->own[i].id);
    if (found != vertices.end() && *found == input_->own[i].id)
      kinds[static_cast<std::size_t>(found - vertices.begin())] =
          is_active_[i] ? VertexKind::kActive : VertexKind::kInactive;
  }
  return kinds;
}

// Those that the leaf itself lists.
template <class List>
std::vector<typename List::Name> Revisit::taken_own(std::vector<OfOther<List>>& items) const {
  std::vector<typename List::Name> own;
  std::erase_if(items, [&](const OfOther<List>& item) {
    if (!is_in_leaf(input_->box, item.smallest)) return false;
    own.push_back(item.name);
    return true;
  });
  return own;
}

// A cell or facet is of the point that is its smallest vertex, not counting those of the core: an
// own one. One whose own vertices are all active may be gone, and other vertices of it, too.
template <class List>
void Revisit::add_kept(const List& last, std::vector<OfOther<List>>& others_gone,
                       std::vector<OfOther<List>>& others_made, const CoreIndex* core,
                       List& list) const {
  const std::vector<VertexKind> kinds = kinds_of(last.vertices);
  List kept;
  kept.vertices = last.vertices;
  std::ranges::copy_if(
      items_of(last), std::back_inserter(items_of(kept)), [&](const typename List::Item& item) {
        const auto& vertices = vertices_in(item);
        const auto has = [&](VertexKind kind) {
          return std::ranges::any_of(vertices, [&](std::uint32_t v) { return kinds[v] == kind; });
        };
        if (!has(VertexKind::kActive)) return true;
        if (!has(VertexKind::kInactive)) return false;
        const auto smallest = std::ranges::min(vertices, {}, [&](std::uint32_t v) {
          return place_among_smallest(last.vertices[v], core);
        });
        return kinds[smallest] != VertexKind::kActive;
      });
  drop_unused_vertices(kept);
  const Changes<List> changes{.gone = taken_own(others_gone), .made = taken_own(others_made)};
  if (!changes.gone.empty() || !changes.made.empty()) apply(changes, kept);

  List all;
  std::ranges::set_union(kept.vertices, list.vertices, std::back_inserter(all.vertices));
  name_vertices(kept, all.vertices);
  name_vertices(list, all.vertices);
  items_of(all).reserve(items_of(kept).size() + items_of(list).size());
  std::ranges::merge(items_of(kept), items_of(list), std::back_inserter(items_of(all)));
  list = std::move(all);
}

void Revisit::add_kept(LeafDelta& delta, const CoreIndex* core) const {
  if (delta.is_overfull) return;
  const LastVisit& last = *input_->last_visit;
  add_kept(last.cells, delta.others_gone, delta.others_made, core, delta.cells);
  add_kept(last.facets, delta.others_facets_gone, delta.others_facets_made, core, delta.facets);
}

}  // namespace locvol
