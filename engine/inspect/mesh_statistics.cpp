#include "engine/inspect/mesh_statistics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/exchange/in_rank_order.h"
#include "engine/exchange/pack.h"
#include "engine/inspect/cell_gauge.h"
#include "engine/inspect/leaf_row_fields.h"
#include "engine/inspect/neighbor_ratio.h"
#include "engine/output/leaf_lists.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/shared/idle_pool.h"
#include "engine/shared/lattice_of_run.h"
#include "engine/shared/workers.h"
#include "octree/octree.h"
#include "octree/site_block.h"
#include "octree/size_field.h"
#include "refine/core_index.h"
#include "refine/forced_angles.h"
#include "refine/predicates.h"

namespace locvol {

auto fields(Maybe<Histogram> auto& histogram) {
  auto& [edges, counts] = histogram;
  return std::tuple(Field("edges", edges), Field("counts", counts));
}
auto fields(Maybe<MeshStatistics> auto& s) {
  return std::tuple(
      Field("num_cells", s.num_cells), Field("num_core_cells", s.num_core_cells),
      Field("volume", s.volume), Field("min_dihedral_degrees", s.min_dihedral_degrees),
      Field("max_dihedral_degrees", s.max_dihedral_degrees),
      Field("min_dihedral_bound", s.min_dihedral_bound), Field("num_poor_cells", s.num_poor_cells),
      Field("num_forced_cells", s.num_forced_cells),
      Field("max_radius_edge_ratio", s.max_radius_edge_ratio),
      Field("max_bounded_ratio", s.max_bounded_ratio), Field("num_above_ratio", s.num_above_ratio),
      Field("max_circumradius", s.max_circumradius),
      Field("max_radius_over_size", s.max_radius_over_size),
      Field("max_neighbor_ratio", s.max_neighbor_ratio),
      Field("num_cells_by_octave", s.num_cells_by_octave),
      Field("dihedral_angles", s.dihedral_angles),
      Field("min_dihedral_angles", s.min_dihedral_angles),
      Field("radius_edge_ratios", s.radius_edge_ratios),
      Field("radii_over_size", s.radii_over_size), Field("bodies", s.bodies));
}

// Of a leaf, told to ranks near it.
struct ToldFacets {
  MortonKey leaf;
  std::vector<OpenFacet> open;
};
auto fields(Maybe<OpenFacet> auto& facet) {
  auto& [vertices, radius] = facet;
  return std::tuple(Field("vertices", vertices), Field("radius", radius));
}
auto fields(Maybe<ToldFacets> auto& told) {
  auto& [leaf, open] = told;
  return std::tuple(Field("leaf", leaf), Field("open", open));
}

namespace {

constexpr std::size_t kWindowBytes = std::size_t{8} << 20;
// Of a task, which measures leaf after leaf.
constexpr std::uint64_t kCellsPerPiece = 40'000;

using CubeList = LeafList<SizeCube>;

// What one thread reads with.
struct Window {
  Window(const Store& store, const LinearOctree& octree)
      : snapshot(store.snapshot()),
        tables(kWindowBytes,
               [this, &octree](std::size_t leaf) {
                 return PointTable(snapshot.points(octree.leaves()[leaf]));
               }),
        cubes(kWindowBytes, [this, &octree](std::size_t leaf) {
          return CubeList{snapshot.sizes(octree.leaves()[leaf]).cubes};
        }) {}
  const Snapshot snapshot;
  LeafWindow<PointTable> tables;
  LeafWindow<CubeList> cubes;  // where sizes vary
};

// A finished run, its cells measured so far, and what for.
struct Measured {
  const Store& store;
  const RunRecord& run;
  const LinearOctree& octree;
  // Of each leaf, the rank's own cells: of other ranks' it may have what was mended.
  const std::vector<std::uint64_t>& num_cells;
  const LeafScale scale;
  const std::function<void()> on_piece;
  const std::function<bool(const LeafPoorCell&)> on_poor;  // may be absent
  CellGauge all;
  std::map<BodyId, CellGauge> bodies;  // of each, where there are several
  bool has_bodies = false;
  std::optional<NeighborRatio> neighbors;  // where sizes vary, and all is measured
  bool is_enough = false;                  // on_poor wants no more
  IdlePool<Window> windows;
};

CellGauge gauge_for(const RunRecord& run) {
  return CellGauge(run.parameters.size, run.parameters.min_dihedral, core_size(run.parameters),
                   run.parameters.radius_edge_bound);
}

LeafPoorCell poor_cell(MortonKey leaf, const CellGauge::Corners& c, const CellGauge& its_gauge,
                       bool is_forced) {
  const Circumsphere ball = circumsphere_of(c[0], c[1], c[2], c[3]);
  const bool is_flat = !std::isfinite(ball.radius);
  return {.leaf = leaf,
          .position = is_flat ? 0.25 * (c[0] + c[1] + c[2] + c[3]) : ball.center,
          .radius = ball.radius,
          .degrees = its_gauge.statistics().min_dihedral_degrees,
          .is_forced = is_forced};
}

// Neighboring leaves, measured by one thread.
class MeasureTask : public Task {
 public:
  MeasureTask(Measured& measured, std::vector<std::size_t> leaves)
      : measured_(measured), leaves_(std::move(leaves)) {}

  void compute() override {
    std::unique_ptr<Window> window =
        measured_.windows.take([&] { return std::make_unique<Window>(measured_.store, octree_); });
    for (const std::size_t leaf : leaves_) measure(leaf, *window);
    for (const auto& [body, gauge] : bodies_) gauge_.add(gauge);
    measured_.windows.put_back(std::move(window));
  }
  void apply() override {
    measured_.all.add(gauge_);
    for (const auto& [body, gauge] : bodies_)
      measured_.bodies.try_emplace(body, gauge_for(run_)).first->second.add(gauge);
    if (measured_.neighbors)
      for (const LeafNeighbors& leaf : neighbors_) measured_.neighbors->add(leaf);
    measured_.on_piece();
    for (const LeafPoorCell& cell : poor_)
      measured_.is_enough = measured_.is_enough || !measured_.on_poor(cell);
  }

 private:
  void measure(std::size_t leaf, Window& window) {
    const MortonKey key = octree_.leaves()[leaf];
    const LeafCells cells =
        measured_.num_cells[leaf] > 0 ? window.snapshot.cells(key) : LeafCells();
    const std::vector<std::size_t> near = near_leaves(leaf, kCellReach);
    const std::vector<Point> positions = positions_of(cells.vertices, leaf, near, window.tables);
    std::optional<SizeField> sizes;
    if (!law_.is_uniform() && !cells.cells.empty()) sizes = sizes_around(leaf, near, window.cubes);
    std::vector<double> radii;
    std::optional<ForcedAngles> angles;  // where a cell is poor
    std::array<CellGauge::Corners, CellGauge::kAtOnce> some{};
    std::size_t num = 0;
    const auto add_to = [&](CellGauge& gauge) {
      const auto these = std::span(some).first(std::exchange(num, 0));
      const CellGauge::Added added = gauge.add(these, sizes ? &*sizes : nullptr);
      if (measured_.neighbors)
        radii.insert(radii.end(), added.radii.begin(),
                     added.radii.begin() + static_cast<std::ptrdiff_t>(these.size()));
      for (std::size_t i = 0; i < these.size(); ++i) {
        if (!added.are_poor[i]) continue;
        if (!angles && keeps_creases(run_)) angles = angles_around(leaf, near, window.snapshot);
        add_poor(key, these[i], angles && angles->are_forced(these[i]), gauge);
      }
    };
    for (std::size_t n = 0; n < cells.cells.size(); ++n) {
      const auto& [a, b, c, d] = cells.cells[n];
      some[num++] = {positions[a], positions[b], positions[c], positions[d]};
      for (const std::uint32_t i : {a, b, c, d})
        if (std::isnan(positions[i].x)) throw_unknown_point(cells.vertices[i], key);
      if (measured_.has_bodies)  // one by one
        add_to(bodies_.try_emplace(cells.body_of(n), gauge_for(run_)).first->second);
      else if (num == some.size())
        add_to(gauge_);
    }
    add_to(gauge_);
    if (measured_.neighbors) neighbors_.push_back(leaf_neighbors(cells, radii));
  }

  void add_poor(MortonKey leaf, const CellGauge::Corners& corners, bool is_forced,
                CellGauge& gauge) {
    if (is_forced) gauge.add_forced();
    if (!measured_.on_poor) return;
    CellGauge one = gauge_for(run_);
    one.add({&corners, 1});
    poor_.push_back(poor_cell(leaf, corners, one, is_forced));
  }

  ForcedAngles angles_around(std::size_t leaf, std::span<const std::size_t> near,
                             const Snapshot& snapshot) const {
    DomainPiece piece;
    piece.region =
        run_.frame.box(octree_.leaves()[leaf]).expanded(kCellReach * measured_.scale.of(leaf));
    for (const std::size_t other : near) piece.add(snapshot.surface(octree_.leaves()[other]));
    piece.unite();
    return ForcedAngles(std::move(piece), run_.parameters.size, run_.parameters.min_dihedral);
  }

  // Where the leaf's cells may have their circumcenters.
  SizeField sizes_around(std::size_t leaf, std::span<const std::size_t> near,
                         LeafWindow<CubeList>& lists) const {
    const Box region =
        run_.frame.box(octree_.leaves()[leaf]).expanded(kCellReach / 2 * measured_.scale.of(leaf));
    SizeCubes sizes{law_, run_.frame, {}};
    for (const std::size_t other : near) {
      if (!run_.frame.box(octree_.leaves()[other]).overlaps(region)) continue;
      const auto theirs = lists.get(other);
      std::ranges::copy_if(
          theirs->values, std::back_inserter(sizes.cubes),
          [&](const SizeCube& cube) { return run_.frame.box(cube.key).overlaps(region); });
    }
    return SizeField(sizes);
  }

  std::vector<std::size_t> near_leaves(std::size_t leaf, double factor) const {
    return leaves_near(octree_, run_.frame, leaf, factor * measured_.scale.of(leaf));
  }

  // NaN where no leaf near has the point.
  std::vector<Point> positions_of(std::span<const std::uint64_t> ids, std::size_t leaf,
                                  std::span<const std::size_t> near,
                                  LeafWindow<PointTable>& tables) const {
    std::vector<Point> positions(ids.size(), {kUnknown, kUnknown, kUnknown});
    const std::size_t num_sites = num_site_ids(ids);
    for (std::size_t i = 0; i < num_sites; ++i) positions[i] = lattice_.position_of(ids[i]);
    const auto others = ids.subspan(num_sites);
    std::size_t num_left = others.size();
    const auto take_from = [&](std::size_t neighbor) {
      const auto table = tables.get(neighbor);
      for_each_common(others, table->ids, [&](auto id, auto place) {
        positions[num_sites + static_cast<std::size_t>(id)] =
            table->positions[static_cast<std::size_t>(place)];
        --num_left;
      });
    };
    take_from(leaf);
    if (num_left == 0) return positions;
    for (const std::size_t other : near)
      if (other != leaf) take_from(other);
    return positions;
  }

  // How many of the ascending ids are those of lattice points, whose places the run knows.
  std::size_t num_site_ids(std::span<const std::uint64_t> ids) const {
    const bool has_site_ids = run_.parameters.init == Initialization::kCover &&
                              run_.next_point_id >= kFirstOtherId;  // not in stores of old
    if (!has_site_ids) return 0;
    return static_cast<std::size_t>(std::ranges::lower_bound(ids, kFirstOtherId) - ids.begin());
  }

  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  Measured& measured_;
  const RunRecord& run_ = measured_.run;
  const LinearOctree& octree_ = measured_.octree;
  std::vector<std::size_t> leaves_;  // places in Morton order
  Lattice lattice_ = lattice_of(run_);
  SizeLaw law_ = run_.parameters.sizes();
  CellGauge gauge_ = gauge_for(run_);
  std::map<BodyId, CellGauge> bodies_;    // likewise of each body
  std::vector<LeafNeighbors> neighbors_;  // of each leaf, if they are asked for
  std::vector<LeafPoorCell> poor_;        // likewise
};

// How many cells of the lattice core a leaf has in each body, of `num_cells` in all.
std::map<BodyId, std::uint64_t> core_cells_of_leaf(const Reader& reader, const RunRecord& run,
                                                   const LinearOctree& octree,
                                                   const LeafScale& scale, std::size_t place,
                                                   std::uint64_t num_cells) {
  const Lattice lattice = lattice_of(run);
  const MortonKey leaf = octree.leaves()[place];
  const LatticeCore core = reader.points(leaf).core;
  const SiteBox sites = lattice.sites_in(run.frame.box(leaf));
  std::set<BodyId> bodies;
  for_each_row(core, sites, [&](const LatticeRow& row, std::uint64_t) { bodies.insert(row.body); });
  if (bodies.size() == 1) return {{*bodies.begin(), num_cells}};
  CoreRows around{.lattice = lattice, .rows = {}};
  for (const std::size_t other :
       leaves_near(octree, run.frame, place, kCellReach * scale.of(place)))
    for_each_core_row(reader.points(octree.leaves()[other]).core,
                      lattice.sites_in(run.frame.box(octree.leaves()[other])), sites.expanded(2),
                      [&](const LatticeRow& row, std::uint64_t) { around.rows.push_back(row); });
  const CoreIndex index(around);
  std::map<BodyId, std::uint64_t> num;
  for_each_row(core, sites, [&](const LatticeRow& row, std::uint64_t) {
    for (std::int32_t n = 0; n < static_cast<std::int32_t>(row.count); ++n) {
      const LatticeSite site = row.first + LatticeSite{0, 0, 2 * n};
      for (const LatticeCell& cell : kLatticeCells)
        num[row.body] += index.contains(site + cell[0]) && index.contains(site + cell[1]) &&
                         index.contains(site + cell[2]);
    }
  });
  return num;
}

// Each rank is told of cells that may be neighbors of its own. Memory: these.
void share_neighbors(const Reader& reader, NeighborRatio& neighbors, Exchange& exchange) {
  std::vector<std::vector<ToldFacets>> told(static_cast<std::size_t>(exchange.num_ranks()));
  std::vector<MortonKey> leaves;
  reader.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
    if (info.holding == Holding::kOwn)
      for (const std::uint32_t rank : info.ranks)
        if (static_cast<int>(rank) != exchange.rank())
          told[rank].push_back({leaf, neighbors.open_facets(leaves.size())});
    leaves.push_back(leaf);
    return true;
  });
  for (auto& of_rank : swap_lists(exchange, std::move(told)))
    for (ToldFacets& of_leaf : of_rank) {
      const auto place = std::ranges::lower_bound(leaves, of_leaf.leaf);
      if (place == leaves.end() || *place != of_leaf.leaf)
        throw ExchangeError("another rank has other leaves");
      neighbors.put_told(static_cast<std::size_t>(place - leaves.begin()), std::move(of_leaf.open));
    }
}

// All ranks call it.
MeshStatistics measure(const Store& store, int num_threads, const StepProgress& on_step,
                       std::function<bool(const LeafPoorCell&)> on_poor, const StopToken* stop,
                       Exchange& exchange) {
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = finished_run(store, snapshot);
  const LinearOctree octree = stored_octree(store, snapshot);
  std::vector<std::uint64_t> num_cells;
  num_cells.reserve(octree.size());
  std::uint64_t num_listed_cells = 0, num_core_cells = 0;
  std::vector<std::uint64_t> num_core_of_leaf;
  snapshot.for_each_leaf([&](MortonKey, const LeafInfo& info) {
    num_core_of_leaf.push_back(info.holding == Holding::kOwn ? info.num_core_cells : 0);
    const bool is_own = info.holding == Holding::kOwn;
    num_cells.push_back(is_own ? info.num_cells : 0);
    num_listed_cells += num_cells.back();
    num_core_cells += is_own ? info.num_core_cells : 0;
    return true;
  });
  Measured measured{.store = store,
                    .run = run,
                    .octree = octree,
                    .num_cells = num_cells,
                    .scale = LeafScale(snapshot, run),
                    .on_piece =
                        [&] {
                          if (on_step) on_step(measured.all.num_cells(), num_listed_cells);
                        },
                    .on_poor = std::move(on_poor),
                    .all = gauge_for(run),
                    .bodies = {},
                    .has_bodies = snapshot.sheets().has_several_bodies(),
                    .neighbors = {},
                    .is_enough = false,
                    .windows = {}};
  const bool has_neighbors = !run.parameters.sizes().is_uniform() && !measured.on_poor;
  if (has_neighbors) measured.neighbors.emplace(place_for_lists(store));
  std::size_t leaf = 0;
  const auto next_piece = [&]() -> std::unique_ptr<Task> {
    throw_if_stopped(stop);
    if (measured.is_enough) return nullptr;
    std::vector<std::size_t> leaves;
    for (std::uint64_t num = 0; leaf < num_cells.size() && num < kCellsPerPiece; ++leaf) {
      if (num_cells[leaf] > 0 || has_neighbors) leaves.push_back(leaf);
      num += num_cells[leaf];
    }
    if (leaves.empty()) return nullptr;
    return std::make_unique<MeasureTask>(measured, std::move(leaves));
  };
  do_on_all(exchange, [&] { Workers(num_threads).run_in_order(next_piece); });
  measured.all.add_core(num_core_cells);
  MeshStatistics statistics = measured.all.statistics();
  if (measured.has_bodies) {
    for (std::size_t place = 0; place < num_core_of_leaf.size(); ++place)
      if (num_core_of_leaf[place] > 0)
        for (const auto& [body, num] : core_cells_of_leaf(snapshot, run, octree, measured.scale,
                                                          place, num_core_of_leaf[place]))
          measured.bodies.try_emplace(body, gauge_for(run)).first->second.add_core(num);
    for (BodyId body = 1; body <= snapshot.sheets().bodies.size(); ++body)
      statistics.bodies.push_back(
          measured.bodies.try_emplace(body, gauge_for(run)).first->second.statistics());
  }
  if (has_neighbors && exchange.num_ranks() > 1)
    share_neighbors(snapshot, *measured.neighbors, exchange);
  const auto near = [&](std::size_t place) {
    return leaves_near(octree, run.frame, place, 2 * kCellReach * measured.scale.of(place));
  };
  if (has_neighbors)
    do_on_all(exchange,
              [&] { statistics.max_neighbor_ratio = measured.neighbors->ratio(near, stop); });
  return statistics;
}

}  // namespace

MeshStatistics mesh_statistics(const Store& store, int num_threads, const StepProgress& on_step,
                               const StopToken* stop, Exchange& exchange) {
  const MeshStatistics own = measure(store, num_threads, on_step, {}, stop, exchange);
  std::optional<MeshStatistics> all;
  double most = 0;
  for (const MeshStatistics& of_rank : gather_values(exchange, own)) {
    most = std::max(most, of_rank.max_neighbor_ratio);
    all = all ? together(*all, of_rank) : of_rank;
  }
  all->max_neighbor_ratio = most;
  return *all;
}

void for_each_poor_cell(const Store& store, const std::function<bool(const LeafPoorCell&)>& visit,
                        int num_threads, const StopToken* stop) {
  const RunRecord run = finished_run(store, store.snapshot());
  if (run.parameters.min_dihedral > 0) measure(store, num_threads, {}, visit, stop, alone());
}

std::vector<LeafPoorCell> first_poor_cells(const Store& store, std::uint64_t max, int num_threads,
                                           Exchange& exchange) {
  std::vector<LeafPoorCell> cells;
  const auto take = [&](const LeafPoorCell& cell) {
    cells.push_back(cell);
    return cells.size() < max;
  };
  if (max > 0) for_each_poor_cell(store, take, num_threads);
  return first_of_ranks(exchange, std::move(cells), max);
}

}  // namespace locvol
