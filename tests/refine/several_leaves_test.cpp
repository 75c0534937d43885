// Leaves that know of each other by their points alone must derive one mesh (refine/ALGORITHM.md):
// a run of cover mode over a uniform grid of leaves, without store and engine.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <optional>
#include <ostream>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "refine/cell_shape.h"
#include "refine/circumcenter.h"
#include "refine/cover_leaf.h"
#include "refine/domain/triangle_box.h"
#include "refine/point_cubes.h"
#include "refine/refine_leaf.h"
#include "tests/refine/brute_force.h"
#include "tests/refine/domain_pieces.h"
#include "tests/refine/lattice_points.h"
#include "tests/refine/mesh_checker.h"
#include "tests/refine/shapes.h"

namespace locvol {
namespace {

using shapes::Mesh;

Mesh sphere() { return shapes::icosphere({0, 0, 0}, 1, 4); }
Mesh torus() { return shapes::torus(1, 0.4, 96, 40); }

struct Scene {
  std::string name;
  Mesh (*make)() = nullptr;  // not the mesh itself: each process would make those of all scenes
  double size = 0;           // λ
  int num_leaves = 1;        // on each axis
  long euler_characteristic = 2;
  int num_disturbances = 0;
  double min_dihedral = 0;
  friend std::ostream& operator<<(std::ostream& out, const Scene& s) { return out << s.name; }
};

enum class Visits {
  kWhole,
  kPartial,          // from the second on: of what has changed
  kPartialAndWhole,  // partial, and compared with what a whole visit gives
};

// As many lattice points as can be are known by their sites alone, or none are.
enum class Core { kExplicit, kImplicit };

using Cell = std::array<std::uint64_t, 4>;  // ids

class LeafRun {
 public:
  LeafRun(const Scene& scene, Visits visits, Core core = Core::kExplicit);

  // Visits all leaves in turn until a full round changes nothing.
  void refine();
  // Visits each leaf that waits once; again and again until none does, as the engine does.
  void visit_once();
  void visit_waiting();
  // What a visit of a leaf with this box would do, and P after that.
  LeafDelta visit_of(const Box& box, double min_dihedral) const;
  std::size_t num_own(const Box& box) const { return load(leaf_of(box)).own.size(); }
  std::vector<MeshPoint> points_after(const LeafDelta& delta) const;
  // What leaves list, with what others have replaced since, is what a visit without C7 finds,
  // unless they wait for a visit.
  void expect_lists_as_found() const;

  const Mesh& mesh() const { return mesh_; }
  // P, and the cells as indices into it; with those of the core.
  std::vector<MeshPoint> points() const;
  std::vector<IndexedCell> cells() const;
  std::size_t num_core() const { return core_.size(); }
  std::uint64_t num_met() const { return num_met_; }  // core points that were made explicit
  std::uint64_t num_taken_in() const { return num_taken_in_; }  // by visits
  int num_rounds() const { return num_rounds_; }
  // By partial visits that were compared, and by the whole ones.
  std::pair<std::uint64_t, std::uint64_t> num_cells_made() const { return num_cells_made_; }
  std::uint64_t num_insertions() const { return num_insertions_; }
  std::uint64_t num_deletions() const { return num_deletions_; }
  // Insertions of which it was known whose stars they change, and visits that nothing called for.
  // Points moved for C7, those on the surface among them, cells that it left as they are, and cells
  // of other leaves that it replaced.
  std::uint64_t num_moves() const { return num_moves_; }
  std::size_t num_moved_on_surface() const { return num_moved_on_surface_; }
  std::size_t num_poor() const { return num_poor_; }
  std::size_t num_partial() const { return num_partial_; }  // visits of visit_waiting()
  std::uint64_t num_replaced() const { return num_replaced_; }
  std::uint64_t num_known() const { return num_known_; }
  std::uint64_t num_spared() const { return num_spared_; }

 private:
  struct Leaf {
    Box box;
    DomainPiece domain;
    std::optional<LastVisit> last_visit = std::nullopt;
    bool waits = true;    // its last visit, or another leaf's since then, changed something here
    CellList cells = {};  // of its last visit, with what others have replaced
    FacetList facets = {};
  };

  void disturb();
  void cut_into_leaves();
  Leaf leaf_of(const Box& box) const;
  void make_core();
  void make_explicit(const LatticeSite& site);
  bool visit(Leaf& leaf);
  LeafInput load(const Leaf& leaf) const;
  void commit(Leaf& leaf, const LeafDelta& delta);
  template <class List>
  void change_others(const std::vector<OfOther<List>>& gone, const std::vector<OfOther<List>>& made,
                     const std::vector<std::uint64_t>& ids, List Leaf::*held,
                     List LastVisit::*last);
  void enqueue_others(const Leaf& leaf, const LeafDelta& delta);
  void list_cells(const LeafDelta& delta);
  Leaf& leaf_owning(const Point& p);

  const Scene& scene_;
  const Mesh mesh_;
  Visits visits_;
  LeafDomain whole_;
  Lattice lattice_;
  std::set<LatticeSite> core_;
  std::vector<Leaf> leaves_;
  std::vector<MeshPoint> points_;  // ids ascend; without the core
  std::uint64_t next_id_ = kFirstOtherId;
  std::vector<Cell> cells_;
  int num_rounds_ = 0;
  std::pair<std::uint64_t, std::uint64_t> num_cells_made_;
  std::uint64_t num_insertions_ = 0, num_deletions_ = 0, num_met_ = 0, num_taken_in_ = 0;
  std::uint64_t num_known_ = 0, num_spared_ = 0, num_moves_ = 0, num_replaced_ = 0;
  std::size_t num_poor_ = 0, num_partial_ = 0, num_moved_on_surface_ = 0;
};

DomainPiece whole_surface(const Mesh& mesh, double margin) {
  return whole_piece(shapes::bounding_box(mesh).expanded(margin), mesh);
}

LeafRun::LeafRun(const Scene& scene, Visits visits, Core core)
    : scene_(scene),
      mesh_(scene.make()),
      visits_(visits),
      whole_(whole_surface(mesh_, 3 * scene.size)),
      lattice_(lattice_around(whole_.region(), scene.size)) {
  const CoverPoints cover = cover_leaf(
      {scene.size, 1, lattice_, whole_.region(), whole_surface(mesh_, 3 * scene.size), {}});
  for (const LatticeSite& site : lattice_sites(cover, lattice_.sites_in(whole_.region())))
    points_.push_back(lattice_.point(site));
  for (const Point& p : cover.samples) points_.push_back({next_id_++, p, PointKind::kSurface});
  disturb();
  if (core == Core::kImplicit) make_core();
  cut_into_leaves();
}

// All lattice points that may be: their neighbors are of P, and no other point is near.
void LeafRun::make_core() {
  std::set<LatticeSite> sites;
  std::vector<Point> others;
  for (const MeshPoint& p : points_)
    if (p.id < kFirstOtherId)
      sites.insert(site_of(p.id));
    else
      others.push_back(p.position);
  for (const LatticeSite& site : sites) {
    const Point p = lattice_.position(site);
    const double star = kLatticeStar * scene_.size;
    if (std::ranges::all_of(kLatticeNeighbors,
                            [&](const LatticeSite& d) { return sites.contains(site + d); }) &&
        std::ranges::none_of(others,
                             [&](const Point& q) { return squared_distance(p, q) <= star * star; }))
      core_.insert(site);
  }
  std::erase_if(points_, [&](const MeshPoint& p) {
    return p.id < kFirstOtherId && core_.contains(site_of(p.id));
  });
}

void LeafRun::make_explicit(const LatticeSite& site) {
  ASSERT_EQ(core_.erase(site), 1u);
  ++num_met_;
  const MeshPoint p = lattice_.point(site);
  points_.insert(std::ranges::lower_bound(points_, p.id, {}, &MeshPoint::id), p);
  for (Leaf& leaf : leaves_)
    if (leaf.box.squared_distance(p.position) <= std::pow(2 * scene_.size, 2)) {
      if (leaf.last_visit) leaf.last_visit->asked.push_back(p.position);
      leaf.waits = true;
    }
}

std::vector<MeshPoint> LeafRun::points() const {
  std::vector<MeshPoint> all = points_;
  for (const LatticeSite& site : core_) all.push_back(lattice_.point(site));
  std::ranges::sort(all, {}, &MeshPoint::id);
  return all;
}

std::vector<IndexedCell> LeafRun::cells() const {
  std::vector<Cell> cells = cells_;
  for (const LatticeSite& site : core_)
    for (const LatticeCell& cell : kLatticeCells) {
      const std::array sites{site, site + cell[0], site + cell[1], site + cell[2]};
      if (std::ranges::all_of(sites, [&](const LatticeSite& s) { return core_.contains(s); }))
        cells.push_back(
            {site_id(sites[0]), site_id(sites[1]), site_id(sites[2]), site_id(sites[3])});
    }
  const std::vector<MeshPoint> all = points();
  std::vector<IndexedCell> indexed;
  for (const Cell& cell : cells) {
    auto& indices = indexed.emplace_back();
    for (std::size_t i = 0; i < 4; ++i) {
      const auto found = std::ranges::lower_bound(all, cell[i], {}, &MeshPoint::id);
      if (found == all.end() || found->id != cell[i]) {
        ADD_FAILURE() << "a cell has a vertex that is not in P";
        return {};
      }
      indices[i] = static_cast<std::size_t>(found - all.begin());
    }
  }
  return indexed;
}

// Volume points close beneath the surface (C2, and deletions) and pairs of points much too close
// (C6).
void LeafRun::disturb() {
  constexpr unsigned kSeed = 61;
  shapes::Random random(kSeed);
  const auto some = static_cast<std::size_t>(scene_.num_disturbances);
  for (const Point& p : shapes::random_points_on(mesh_, some, random)) {
    const Point beneath = p - 0.15 * scene_.size * ((1 / norm(p)) * p);
    if (is_inside(whole_, beneath)) points_.push_back({next_id_++, beneath, PointKind::kVolume});
  }
  for (std::size_t n = 0; n < some;) {
    const Point p = shapes::uniform_in(random, whole_.region());
    if (!is_inside(whole_, p) || whole_.is_near(p, 1.1 * scene_.size)) continue;
    points_.push_back({next_id_++, p, PointKind::kLattice});
    points_.push_back({next_id_++, p + Point{0.05 * scene_.size, 0, 0}, PointKind::kLattice});
    ++n;
  }
}

void LeafRun::cut_into_leaves() {
  const Box space = shapes::bounding_box(mesh_).expanded(0.1 * scene_.size);
  const int n = scene_.num_leaves;
  const auto corner = [&](int i, int j, int k) {
    const Point d = space.max - space.min;
    return space.min + Point{d.x * i / n, d.y * j / n, d.z * k / n};
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k)
        leaves_.push_back(leaf_of({corner(i, j, k), corner(i + 1, j + 1, k + 1)}));
}

LeafRun::Leaf LeafRun::leaf_of(const Box& box) const {
  const Box region = box.expanded((0.5 * kReach + 0.02) * scene_.size);
  Mesh part;
  for (const Triangle& t : mesh_)
    if (meets(t, region)) part.push_back(t);
  return {box, {part, region, region.center(), *whole_.state(region.center()), {scene_.size}}};
}

LeafDelta LeafRun::visit_of(const Box& box, double min_dihedral) const {
  LeafInput input = load(leaf_of(box));
  input.criteria.min_dihedral = min_dihedral;
  return refine_leaf(input);
}

std::vector<MeshPoint> LeafRun::points_after(const LeafDelta& delta) const {
  std::vector<MeshPoint> after = points();
  std::erase_if(after, [&](const MeshPoint& p) {
    return std::ranges::find(delta.moved, p) != delta.moved.end();
  });
  std::uint64_t id = next_id_;
  for (const InsertedPoint& p : delta.inserted) after.push_back({id++, p.position, p.kind});
  return after;
}

// As the engine does.
LeafInput LeafRun::load(const Leaf& leaf) const {
  LeafInput input;
  input.criteria = Criteria::of_cover(scene_.size, 2, 1e-3);
  input.criteria.min_dihedral = scene_.min_dihedral;
  input.box = leaf.box;
  input.domain = leaf.domain;
  input.last_visit = leaf.last_visit;
  input.max_insertions = 20000;
  const double reach = input.criteria.reach;
  for (const MeshPoint& p : points_)
    if (is_in_leaf(leaf.box, p.position))
      input.own.push_back(p);
    else if (leaf.box.squared_distance(p.position) <= reach * reach)
      input.ghosts.push_back(p);
  std::set<LatticeSite> near;  // no farther than a visit asks
  for (const LatticeSite& site : core_)
    if (leaf.box.squared_distance(lattice_.position(site)) <= std::pow(kCoreReach * scene_.size, 2))
      near.insert(site);
  input.core = core_rows(lattice_, near);
  return input;
}

void LeafRun::commit(Leaf& leaf, const LeafDelta& delta) {
  num_insertions_ += delta.inserted.size();
  num_deletions_ += delta.deleted.size();
  num_moves_ += delta.stats.moves;
  num_poor_ += delta.poor.size();
  num_moved_on_surface_ += static_cast<std::size_t>(
      std::ranges::count(delta.moved, PointKind::kSurface, &MeshPoint::kind));
  for (const auto* gone : {&delta.deleted, &delta.moved})
    std::erase_if(points_,
                  [&](const MeshPoint& p) { return std::ranges::find(*gone, p) != gone->end(); });
  for (Leaf& other : leaves_)
    if (&other != &leaf)
      for (const MeshPoint& p : delta.deleted)
        if (other.box.squared_distance(p.position) <= std::pow(kReach * scene_.size, 2))
          other.last_visit.reset();
  std::vector<std::uint64_t> ids;  // of the inserted points
  for (const InsertedPoint& p : delta.inserted) {
    ids.push_back(next_id_);
    if (!p.is_deleted) points_.push_back({next_id_++, p.position, p.kind});
  }
  leaf.cells = delta.cells;
  leaf.facets = delta.facets;
  for (auto* vertices : {&leaf.cells.vertices, &leaf.facets.vertices})
    for (VertexRef& ref : *vertices)
      if (ref & kNewPoint) ref = ids[ref & ~kNewPoint];
  if (visits_ == Visits::kWhole || !delta.unresolved.empty())
    leaf.last_visit.reset();
  else
    leaf.last_visit = LastVisit{next_id_, leaf.cells, leaf.facets};
  for (const std::uint64_t id : delta.met_core) make_explicit(site_of(id));
  enqueue_others(leaf, delta);
  for (Leaf& other : leaves_)
    for (const Point& place : delta.left)
      if (&other != &leaf && other.waits && other.last_visit &&
          other.box.squared_distance(place) <= std::pow(kNeighborhood * scene_.size, 2))
        other.last_visit->asked.push_back(place);
  change_others(delta.others_gone, delta.others_made, ids, &Leaf::cells, &LastVisit::cells);
  change_others(delta.others_facets_gone, delta.others_facets_made, ids, &Leaf::facets,
                &LastVisit::facets);
  for (const PoorCell& poor : delta.poor)
    for (const Point& p : poor.others) {
      Leaf& other = leaf_owning(p);
      other.waits = true;
      if (other.last_visit) other.last_visit->asked.push_back(p);
    }
}

LeafRun::Leaf& LeafRun::leaf_owning(const Point& p) {
  return *std::ranges::find_if(leaves_, [&](const Leaf& l) { return is_in_leaf(l.box, p); });
}

template <class List>
void LeafRun::change_others(const std::vector<OfOther<List>>& gone,
                            const std::vector<OfOther<List>>& made,
                            const std::vector<std::uint64_t>& ids, List Leaf::*held,
                            List LastVisit::*last) {
  std::map<Leaf*, Changes<List>> changes;
  const auto add = [&](const std::vector<OfOther<List>>& items, auto list) {
    for (OfOther<List> item : items) {
      for (VertexRef& v : vertices_in(item.name))
        if (v & kNewPoint) v = ids[v & ~kNewPoint];
      (changes[&leaf_owning(item.smallest)].*list).push_back(item.name);
      ++num_replaced_;
    }
  };
  add(gone, &Changes<List>::gone);
  add(made, &Changes<List>::made);
  for (auto& [owner, change] : changes) {
    if (owner->waits && !owner->last_visit) continue;
    change.is_strict = !owner->waits;
    apply(change, owner->*held);
    if (owner->last_visit) (*owner->last_visit).*last = owner->*held;
  }
}

void LeafRun::visit_once() {
  for (Leaf& leaf : leaves_) {
    if (!std::exchange(leaf.waits, false)) continue;
    num_partial_ += leaf.last_visit.has_value();
    commit(leaf, refine_leaf(load(leaf)));
  }
}

void LeafRun::visit_waiting() {
  while (num_rounds_ < 20 && std::ranges::any_of(leaves_, &Leaf::waits)) {
    ++num_rounds_;
    visit_once();
  }
}

void LeafRun::expect_lists_as_found() const {
  for (const Leaf& leaf : leaves_) {
    LeafInput input = load(leaf);
    input.criteria.min_dihedral = 0;
    input.last_visit.reset();
    const LeafDelta delta = refine_leaf(input);
    EXPECT_TRUE(leaf.waits || (delta.inserted.empty() && delta.deleted.empty()));
    if (!leaf.waits) {
      EXPECT_TRUE(delta.cells == leaf.cells);
      EXPECT_TRUE(delta.facets == leaf.facets);
    }
  }
}

// As the engine does.
void LeafRun::enqueue_others(const Leaf& leaf, const LeafDelta& delta) {
  const auto enqueue_within = [&](const Point& p, double distance) {
    for (Leaf& other : leaves_)
      if (&other != &leaf && other.box.squared_distance(p) <= distance * distance)
        other.waits = true;
  };
  for (const MeshPoint& p : delta.deleted) enqueue_within(p.position, kReach * scene_.size);
  for (const InsertedPoint& p : delta.inserted) {
    if (p.is_deleted) continue;
    num_known_ += p.changed.has_value();
    if (p.changed)
      for (const Point& changed : *p.changed) enqueue_within(changed, 0);
    else
      enqueue_within(p.position, 2 * scene_.size);
  }
}

// Of a visit without insertions.
void LeafRun::list_cells(const LeafDelta& delta) {
  for (std::size_t n = 0; n < delta.cells.size(); ++n) cells_.push_back(delta.cells.refs(n));
}

bool LeafRun::visit(Leaf& leaf) {
  LeafInput input = load(leaf);
  const LeafDelta delta = refine_leaf(input);
  if (!std::exchange(leaf.waits, false) && scene_.min_dihedral == 0) {
    EXPECT_TRUE(delta.inserted.empty() && delta.deleted.empty() && delta.cells == leaf.cells &&
                delta.facets == leaf.facets)
        << "nobody said that it changes";
    ++num_spared_;
  }
  if (visits_ == Visits::kPartialAndWhole && input.last_visit) {
    input.last_visit.reset();
    const LeafDelta whole = refine_leaf(input);
    if (whole.inserted.empty() || delta.inserted.empty()) {
      EXPECT_EQ(delta.inserted.size(), whole.inserted.size());
      EXPECT_TRUE(delta.cells == whole.cells) << "in round " << num_rounds_;
      EXPECT_TRUE(delta.facets == whole.facets) << "in round " << num_rounds_;
      num_cells_made_.first += delta.stats.cells_made;
      num_cells_made_.second += whole.stats.cells_made;
    }
  }
  EXPECT_TRUE(delta.unresolved.empty());
  num_taken_in_ += delta.stats.points_added;
  for (const InsertedPoint& p : delta.inserted)
    EXPECT_LE(leaf.box.squared_distance(p.position), std::pow((kReach - 1) * scene_.size, 2))
        << "all volume points that it might have to delete are loaded";
  if (scene_.num_disturbances == 0) {
    EXPECT_EQ(delta.stats.insertions[2], 0u) << "holes in P were taken for a torn boundary";
  }
  commit(leaf, delta);
  if (!delta.inserted.empty() || !delta.deleted.empty()) return true;
  list_cells(delta);
  return false;
}

void LeafRun::refine() {
  bool is_changed = true;
  while (is_changed && num_rounds_ < 20) {
    is_changed = false;
    cells_.clear();
    ++num_rounds_;
    for (Leaf& leaf : leaves_) is_changed |= visit(leaf);
  }
  ASSERT_FALSE(is_changed) << "does not end";
  if (visits_ != Visits::kPartialAndWhole) return;
  cells_.clear();
  for (Leaf& leaf : leaves_) EXPECT_FALSE(visit(leaf));  // all have been visited before
}

class SeveralLeaves : public testing::TestWithParam<Scene> {};

INSTANTIATE_TEST_SUITE_P(
    Scenes, SeveralLeaves,
    testing::Values(Scene{"SphereInOne", sphere, 0.2, 1, 2}, Scene{"SphereIn8", sphere, 0.2, 2, 2},
                    Scene{"SphereIn27", sphere, 0.1, 3, 2},
                    Scene{"DisturbedSphereIn27", sphere, 0.1, 3, 2, 10},
                    Scene{"TorusIn8", torus, 0.15, 2, 0},
                    Scene{"TorusIn27", [] { return shapes::torus(1, 0.25, 96, 32); }, 0.15, 3, 0},
                    Scene{"DisturbedSphereIn8", sphere, 0.2, 2, 2, 25},
                    Scene{"DisturbedTorusIn27", torus, 0.15, 3, 0, 25},
                    Scene{"ShellsIn8", [] { return shapes::nested_shells(1, 0.7, 3); }, 0.18, 2,
                          4}),
    [](const auto& instance) { return instance.param.name; });

void expect_one_mesh(const Scene& scene, const LeafRun& run) {
  if (scene.num_disturbances > 0) {
    EXPECT_GT(run.num_insertions(), 0u);
    EXPECT_GT(run.num_deletions(), 0u);
  }
  const std::vector<MeshPoint> points = run.points();
  const std::vector<IndexedCell> cells = run.cells();
  std::vector<CellKey> keys;
  for (const auto& [a, b, c, d] : cells) {
    keys.push_back(
        key_of({points[a].position, points[b].position, points[c].position, points[d].position}));
    ASSERT_EQ(brute_force::orientation(points[a].position, points[b].position, points[c].position,
                                       points[d].position),
              1);
  }
  std::ranges::sort(keys);
  EXPECT_EQ(std::ranges::adjacent_find(keys), keys.end()) << "a cell from two leaves";
  const MeshChecker checker(points, run.mesh());
  const std::vector<CellKey> expected = checker.inside_cells();
  EXPECT_GT(expected.size(), 500u);
  EXPECT_EQ(keys.size(), expected.size());
  EXPECT_TRUE(keys == expected) << "the cells are not those of the one triangulation of P";
  for (const auto& [condition, position, radius] : checker.broken_conditions(scene.size, 2))
    ADD_FAILURE() << "C" << condition << " at " << position.x << ' ' << position.y << ' '
                  << position.z << ", radius " << radius;
  EXPECT_EQ(manifold_fault(cells, points), "");
  EXPECT_EQ(boundary_euler_characteristic(cells), scene.euler_characteristic);
  EXPECT_LE(run.num_rounds(), 5) << "leaves need 2 visits, rarely 3";
}

TEST_P(SeveralLeaves, DeriveOneMesh) {
  LeafRun run(GetParam(), Visits::kWhole);
  run.refine();
  expect_one_mesh(GetParam(), run);
}

TEST_P(SeveralLeaves, DeriveOneMeshVisitingWhatChanged) {
  LeafRun run(GetParam(), Visits::kPartial);
  run.refine();
  expect_one_mesh(GetParam(), run);
  if (run.num_rounds() == 1) return;
  EXPECT_GT(run.num_spared(), 0u);
  // A visit in which an inserted point goes again knows of none what changed, and there is but one.
  if (GetParam().name.ends_with("InOne")) return;
  EXPECT_GT(run.num_known(), 0u);
}

TEST_P(SeveralLeaves, PartialVisitsFindWhatWholeOnesDo) {
  LeafRun run(GetParam(), Visits::kPartialAndWhole);
  run.refine();
  const auto [partial, whole] = run.num_cells_made();
  EXPECT_LT(partial, whole) << "or nothing was compared";
}

// ---- With a lattice core as large as can be, so that much is inserted near it

// The mesh is that of all points, as if each were listed.
TEST_P(SeveralLeaves, DeriveOneMeshAroundACore) {
  for (const Visits visits : {Visits::kWhole, Visits::kPartial}) {
    LeafRun run(GetParam(), visits, Core::kImplicit);
    const std::size_t num_core = run.num_core();
    run.refine();
    expect_one_mesh(GetParam(), run);
    EXPECT_EQ(run.num_core() + run.num_met(), num_core);
    RecordProperty("core", std::to_string(num_core));
    RecordProperty("met", std::to_string(run.num_met()));
    RecordProperty("taken_in", std::to_string(run.num_taken_in()));
    if (!GetParam().name.ends_with("SphereIn27")) continue;
    EXPECT_GT(run.num_core(), 0u);
    EXPECT_GT(run.num_met(), 0u);
    EXPECT_GT(run.num_taken_in(), 0u);
  }
}

TEST_P(SeveralLeaves, PartialVisitsAroundACoreFindWhatWholeOnesDo) {
  LeafRun run(GetParam(), Visits::kPartialAndWhole, Core::kImplicit);
  run.refine();
  const auto [partial, whole] = run.num_cells_made();
  EXPECT_LT(partial, whole) << "or nothing was compared";
}

Mesh box() { return shapes::box({{-1, -0.9, -0.8}, {1, 1, 1}}); }

const Scene kImproved[] = {
    {"SphereIn8", sphere, 0.1, 2, 2, 0, 15}, {"TorusIn8", torus, 0.1, 2, 0, 0, 15},
    {"TorusIn27", torus, 0.1, 3, 0, 0, 25},  {"BoxIn8", box, 0.15, 2, 2, 0, 15},
    {"BoxIn27", box, 0.1, 3, 2, 0, 25},
};

class ImprovedInSeveralLeaves : public testing::TestWithParam<Scene> {};

INSTANTIATE_TEST_SUITE_P(Scenes, ImprovedInSeveralLeaves, testing::ValuesIn(kImproved),
                         [](const auto& instance) { return instance.param.name; });

// Moves are judged right without asking the other leaves: all that C1 to C6 ask holds, and each
// leaf knows the cells that others have replaced.
TEST_P(ImprovedInSeveralLeaves, KeepTheConditionsAndEachOthersCells) {
  LeafRun run(GetParam(), Visits::kWhole);
  run.visit_once();
  run.expect_lists_as_found();
  EXPECT_GT(run.num_moves(), 50u);
  EXPECT_GT(run.num_replaced(), 100u);
  const MeshChecker checker(run.points(), run.mesh());
  for (const auto& [condition, position, radius] : checker.broken_conditions(GetParam().size, 2))
    ADD_FAILURE() << "C" << condition << " at " << position.x << ' ' << position.y << ' '
                  << position.z << ", radius " << radius;
}

TEST_P(ImprovedInSeveralLeaves, HaveBoundaryTrianglesAsRoundAsBefore) {
  Scene as_it_was = GetParam();
  as_it_was.min_dihedral = 0;
  LeafRun before(as_it_was, Visits::kWhole), after(GetParam(), Visits::kWhole);
  before.refine();
  after.refine();
  EXPECT_NE(before.points().size(), after.points().size());
  EXPECT_GE(smallest_boundary_angle(after.cells(), after.points()),
            std::min(24.9999, smallest_boundary_angle(before.cells(), before.points())));
}

// Whoever owns its vertices: others leave it to this leaf, and are told if nothing helped. Of
// leaves with few points: some of what is around is out of reach of all of them.
TEST(PoorCellsAround, TheLeafOfTheirCentersImprovesThemOrTells) {
  const Scene scene{"SphereInOne", sphere, 0.1, 1, 2};
  constexpr double kAngle = 15, kSlack = 1e-3;
  LeafRun run(scene, Visits::kWhole, Core::kImplicit);
  run.refine();
  const std::vector<MeshPoint> points = run.points();
  const auto centers_of_poor = [&](std::vector<MeshPoint> some, const Box& box) {
    std::erase_if(some, [&](const MeshPoint& p) {
      return box.squared_distance(p.position) > std::pow(3 * scene.size, 2);
    });
    std::vector<Point> centers;
    for (const CellKey& cell : MeshChecker(some, run.mesh()).inside_cells()) {
      const Point center = circumball(cell, scene.size).center;
      if (largest_cosine(cell) > std::cos((kAngle - kSlack) * std::numbers::pi / 180) &&
          is_in_leaf(box, center))
        centers.push_back(center);
    }
    return centers;
  };
  constexpr unsigned kSeed = 44;
  shapes::Random random(kSeed);
  const std::vector<Point> centers = centers_of_poor(points, shapes::bounding_box(run.mesh()));
  ASSERT_GT(centers.size(), 50u);
  std::size_t num_leaves = 0;
  for (std::size_t n = 0; n < 160; ++n) {
    const Point& center = centers[n % centers.size()];
    const double side = shapes::uniform(random, 1, 2) * scene.size;
    const Point from = shapes::uniform_in(random, {{-1, -1, -1}, {0, 0, 0}});
    const Box box{center + side * from, center + side * (from + Point{1, 1, 1})};
    if (run.num_own(box) == 0) continue;  // such a leaf is not visited
    ++num_leaves;
    const LeafDelta delta = run.visit_of(box, kAngle);
    for (const Point& left : centers_of_poor(run.points_after(delta), box))
      EXPECT_TRUE(std::ranges::any_of(
          delta.poor,
          [&](const PoorCell& p) { return squared_distance(p.position, left) < 1e-12; }))
          << "seed " << kSeed << ", leaf " << n;
  }
  EXPECT_GT(num_leaves, 80u);
}

// What visits rely on (fragment.h): all of the surface has a surface point within the radius, and
// is closer to one than to any point that is hidden from it.
TEST_P(ImprovedInSeveralLeaves, SurfacePointsThatMoveHideWhatTheyHid) {
  LeafRun run(GetParam(), Visits::kWhole);
  run.refine();
  RecordProperty("moved_on_surface", std::to_string(run.num_moved_on_surface()));
  if (GetParam().min_dihedral > 20) {
    EXPECT_GT(run.num_moved_on_surface(), 10u);
  }
  const double size = GetParam().size;
  const Box space = shapes::bounding_box(run.mesh()).expanded(size);
  std::vector<Point> samples, hidden;
  for (const MeshPoint& p : run.points())
    if (p.kind != PointKind::kInserted && p.kind != PointKind::kVolume)
      (p.kind == PointKind::kSurface ? samples : hidden).push_back(p.position);
  const PointCubes near_samples(space, size, 128, samples), near_hidden(space, size, 128, hidden);
  constexpr unsigned kSeed = 97;
  shapes::Random random(kSeed);
  for (const Point& p : shapes::random_points_on(run.mesh(), 100'000, random)) {
    double least = kSampleRadius * size * (1 + 1e-12);
    ASSERT_FALSE(near_samples.is_free(p, least)) << "seed " << kSeed;
    for (double below = 0; least - below > 1e-6 * size;) {
      const double half = 0.5 * (below + least);
      (near_samples.is_free(p, half) ? below : least) = half;
    }
    ASSERT_TRUE(near_hidden.is_free(p, least - 1e-6 * size)) << "seed " << kSeed;
  }
}

// Lists that others changed serve partial visits.
TEST_P(ImprovedInSeveralLeaves, VisitWhatChangedInPart) {
  std::size_t num_partial = 0;
  for (const Core core : {Core::kExplicit, Core::kImplicit}) {
    LeafRun run(GetParam(), Visits::kPartial, core);
    run.visit_waiting();
    EXPECT_LT(run.num_rounds(), 8);
    run.expect_lists_as_found();
    num_partial += run.num_partial();
  }
  EXPECT_GT(num_partial, 0u);
}

TEST_P(ImprovedInSeveralLeaves, HaveNoCellBelowTheBound) {
  LeafRun run(GetParam(), Visits::kWhole, Core::kImplicit);
  run.refine();
  std::size_t num_below = 0;
  const std::vector<MeshPoint> points = run.points();
  for (const auto& [a, b, c, d] : run.cells()) {
    const double cosine = largest_cosine(
        {points[a].position, points[b].position, points[c].position, points[d].position});
    num_below += std::acos(cosine) < GetParam().min_dihedral * std::numbers::pi / 180;
  }
  EXPECT_EQ(num_below, 0u) << run.num_poor();
  expect_one_mesh(GetParam(), run);
}

}  // namespace
}  // namespace locvol
