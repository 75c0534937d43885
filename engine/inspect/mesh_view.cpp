#include "engine/inspect/mesh_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "engine/exchange/in_rank_order.h"
#include "engine/ingest/surface_check.h"
#include "engine/inspect/cell_mesh.h"
#include "engine/inspect/leaf_row_fields.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/shared/lattice_of_run.h"
#include "engine/shared/leaf_name.h"
#include "octree/octree.h"
#include "octree/site_block.h"
#include "octree/table_hash.h"

namespace locvol {

auto fields(Maybe<ViewLeaf> auto& leaf) {
  auto& [key, state, num_leaves, num_visits, num_points, num_cells, num_insertions,
         num_unresolved] = leaf;
  return std::tuple(Field("key", key), Field("state", state), Field("num_leaves", num_leaves),
                    Field("num_visits", num_visits), Field("num_points", num_points),
                    Field("num_cells", num_cells), Field("num_insertions", num_insertions),
                    Field("num_unresolved", num_unresolved));
}
auto fields(Maybe<LeafCounts> auto& counts) {
  auto& [num_leaves, by_visits, by_level] = counts;
  return std::tuple(Field("num_leaves", num_leaves), Field("by_visits", by_visits),
                    Field("by_level", by_level));
}
auto fields(Maybe<ViewSite> auto& marked) {
  auto& [site, leaf] = marked;
  return std::tuple(Field("site", site), Field("leaf", leaf));
}
auto fields(Maybe<SurfaceThinner::Vertex> auto& vertex) {
  auto& [cube, sum, count] = vertex;
  return std::tuple(Field("cube", cube), Field("sum", sum), Field("count", count));
}
auto fields(Maybe<SurfaceThinner::JoinedTriangle> auto& triangle) {
  auto& [vertices, num, sheet] = triangle;
  return std::tuple(Field("vertices", vertices), Field("num", num), Field("sheet", sheet));
}
auto fields(Maybe<SurfaceThinner::Part> auto& part) {
  auto& [vertices, triangles] = part;
  return std::tuple(Field("vertices", vertices), Field("triangles", triangles));
}

namespace {

constexpr std::size_t kViewTableBytes = std::size_t{16} << 20;
// Of a cell along an axis, in λ: that of the lattice's cells on the average.
constexpr double kCellExtent = 5.0 / 3 * (kLatticeSpacing / 2);
constexpr double kEstimateMargin = 1.25;
constexpr int kMaxPlanesOfAxis = 15;
// Steps of the finest grid along the longest side: what a page with 16 bits a coordinate can tell
// apart.
constexpr double kFinestSteps = 65535;

bool meets(const ViewPlane& plane, const Box& box) {
  return box.min[plane.axis] <= plane.position && plane.position <= box.max[plane.axis];
}

// -- Leaves --------------------------------------------------------------------------------------

void merge(ViewLeaf& into, const ViewLeaf& other) {
  into.state = std::min(into.state, other.state);
  into.num_leaves += other.num_leaves;
  into.num_visits = std::max(into.num_visits, other.num_visits);
  into.num_points += other.num_points;
  into.num_cells += other.num_cells;
  into.num_insertions += other.num_insertions;
  into.num_unresolved += other.num_unresolved;
}

ViewLeaf view_leaf(MortonKey key, const LeafInfo& info) {
  ViewLeaf leaf{.key = key,
                .state = LeafRow{.key = key, .info = info, .unresolved = {}, .faults = {}}.state(),
                .num_visits = info.num_visits,
                .num_points = info.num_points + info.num_core_points,
                .num_cells = info.num_cells + info.num_core_cells,
                .num_unresolved = info.num_unresolved};
  for (const std::uint64_t count : info.num_insertions) leaf.num_insertions += count;
  return leaf;
}

void count(const ViewLeaf& leaf, LeafCounts& counts) {
  ++counts.num_leaves;
  if (leaf.state == LeafState::kEmpty) return;
  ++counts.by_visits[leaf.num_visits];
  ++counts.by_level[static_cast<std::uint64_t>(leaf.key.level())];
}

LeafCounts counts_of_all(const LeafCounts& own, Exchange& exchange) {
  LeafCounts all;
  for (const LeafCounts& of_rank : gather_values(exchange, own)) {
    all.num_leaves += of_rank.num_leaves;
    for (const auto& [visits, num] : of_rank.by_visits) all.by_visits[visits] += num;
    for (const auto& [level, num] : of_rank.by_level) all.by_level[level] += num;
  }
  return all;
}

// Leaves in Morton order; those below one node of the deepest level allowed become one. That level
// rises as more leaves come than may be.
class LeafGatherer {
 public:
  explicit LeafGatherer(std::uint64_t max_leaves) : max_leaves_(max_leaves) {}

  void add(ViewLeaf leaf) {
    append(std::move(leaf));
    while (leaves_.size() > max_leaves_ && level_ > 0) rise_to(level_ - 1);
  }
  std::vector<ViewLeaf> take() { return std::move(leaves_); }
  // Of all ranks, which call it. Few more are told than may be: of each border between shares, one
  // node may be on both sides.
  std::vector<ViewLeaf> take_of_all(Exchange& exchange) {
    const std::uint64_t num_borders = static_cast<std::uint64_t>(exchange.num_ranks()) - 1;
    rise_to(static_cast<int>(smallest(exchange, static_cast<std::uint64_t>(level_))));
    while (sum(exchange, leaves_.size()).all > max_leaves_ + num_borders && level_ > 0)
      rise_to(level_ - 1);
    LeafGatherer all(max_leaves_);
    for (ViewLeaf& leaf : gather_all(exchange, leaves_)) all.add(std::move(leaf));
    return all.take();
  }

 private:
  void rise_to(int level) {
    level_ = level;
    for (ViewLeaf& held : std::exchange(leaves_, {})) append(std::move(held));
  }
  void append(ViewLeaf leaf) {
    while (leaf.key.level() > level_) leaf.key = leaf.key.parent();
    if (!leaves_.empty() && leaves_.back().key == leaf.key)
      merge(leaves_.back(), leaf);
    else
      leaves_.push_back(std::move(leaf));
  }

  std::uint64_t max_leaves_;
  int level_ = MortonKey::kMaxLevel;
  std::vector<ViewLeaf> leaves_;
};

std::uint32_t place_of(MortonKey leaf, std::span<const ViewLeaf> leaves) {
  // Morton order puts a node between its children: its place is that of the one holding the leaf.
  const auto place = std::ranges::partition_point(
      leaves, [&](const ViewLeaf& held) { return held.key.range_max() < leaf.range_min(); });
  return static_cast<std::uint32_t>(place - leaves.begin());
}

// -- Cells ---------------------------------------------------------------------------------------

// A facet of the boundary, by the ids of its vertices, which ascend.
struct SheetFacet {
  std::array<std::uint64_t, 3> ids{};
  SheetId sheet = 0;
};
auto fields(Maybe<SheetFacet> auto& facet) {
  auto& [ids, sheet] = facet;
  return std::tuple(Field("ids", ids), Field("sheet", sheet));
}

// Cells of one leaf, the core's after those that the store lists.
struct LeafMesh {
  std::vector<std::uint64_t> ids;
  std::vector<Point> positions;
  std::vector<bool> is_core;  // of each vertex
  std::vector<std::array<std::uint32_t, 4>> cells;
  std::vector<BodyId> bodies;      // of each cell, if there are several
  std::vector<SheetFacet> facets;  // that the leaf lists, if they are asked for

  std::array<Point, 4> corners(std::size_t cell) const {
    const auto& [a, b, c, d] = cells[cell];
    return {positions[a], positions[b], positions[c], positions[d]};
  }
  std::size_t bytes() const {
    return cells.size() * sizeof cells[0] + bodies.size() * sizeof(BodyId) + 40 * ids.size() +
           facets.size() * sizeof facets[0];
  }
};
auto fields(Maybe<LeafMesh> auto& mesh) {
  auto& [ids, positions, is_core, cells, bodies, facets] = mesh;
  return std::tuple(Field("ids", ids), Field("positions", positions), Field("is_core", is_core),
                    Field("cells", cells), Field("bodies", bodies), Field("facets", facets));
}

// For the first rank.
struct ToldCells {
  std::uint32_t set = 0, leaf = 0;  // places in MeshView::cells and MeshView::leaves
  LeafMesh mesh;
};
auto fields(Maybe<ToldCells> auto& told) {
  auto& [set, leaf, mesh] = told;
  return std::tuple(Field("set", set), Field("leaf", leaf), Field("mesh", mesh));
}

// Some of the cells, and what they name.
template <class IsShown>
LeafMesh part_of(const LeafMesh& mesh, const IsShown& is_shown) {
  constexpr std::uint32_t kNew = ~std::uint32_t{0};
  std::vector<std::uint32_t> place(mesh.ids.size(), kNew);
  LeafMesh part;
  part.facets = mesh.facets;
  for (std::size_t cell = 0; cell < mesh.cells.size(); ++cell) {
    if (!is_shown(cell)) continue;
    part.cells.push_back(mesh.cells[cell]);
    if (!mesh.bodies.empty()) part.bodies.push_back(mesh.bodies[cell]);
    for (std::uint32_t& vertex : part.cells.back()) {
      const std::uint32_t v = std::exchange(vertex, place[vertex]);
      if (vertex != kNew) continue;
      vertex = place[v] = static_cast<std::uint32_t>(part.ids.size());
      part.ids.push_back(mesh.ids[v]);
      part.positions.push_back(mesh.positions[v]);
      part.is_core.push_back(mesh.is_core[v]);
    }
  }
  return part;
}

class LeafMeshReader {
 public:
  // `has_facets`, `has_bodies`: leaves come with the facets that they list, and with the bodies of
  // their cells.
  LeafMeshReader(const Reader& reader, const RunRecord& run, const LinearOctree& octree,
                 bool has_facets, bool has_bodies)
      : reader_(reader),
        has_facets_(has_facets),
        has_bodies_(has_bodies),
        run_(run),
        octree_(octree),
        scale_(reader, run),
        lattice_(lattice_of(run)),
        tables_(kViewTableBytes, [this](std::size_t leaf) { return load_table(leaf); }) {}

  LeafMesh load(std::size_t leaf) {
    const MortonKey key = octree_.leaves()[leaf];
    const std::vector<std::size_t> around =
        leaves_near(octree_, run_.frame, leaf, kCellReach * scale_.of(leaf));
    read_core(key, around);
    LeafCells cells = reader_.cells(key);
    LeafMesh mesh;
    if (has_bodies_)
      for (std::size_t i = 0; i < cells.cells.size(); ++i) mesh.bodies.push_back(cells.body_of(i));
    mesh.ids = std::move(cells.vertices);
    mesh.cells = std::move(cells.cells);
    if (has_facets_) read_facets(key, mesh);
    find_positions(key, around, mesh);
    add_core_cells(key, mesh);
    return mesh;
  }

 private:
  // Of a leaf.
  struct Table {
    PointTable listed;
    LatticeCore core;
    std::size_t bytes() const {
      return sizeof *this + listed.bytes() + sizeof(LatticeRow) * core.rows.capacity();
    }
  };

  Table load_table(std::size_t leaf) const {
    const MortonKey key = octree_.leaves()[leaf];
    LeafPoints points = reader_.points(key);
    Table table{.listed = PointTable(points), .core = std::move(points.core)};
    try {
      if (!table.core.is_empty()) check_core(table.core, sites(key));
    } catch (const std::invalid_argument& e) {
      throw CorruptRecord(leaf_name(key) + ": " + e.what(), key);
    }
    return table;
  }

  void read_facets(MortonKey leaf, LeafMesh& mesh) const {
    const LeafFacets listed = reader_.facets(leaf);
    for (const auto& [vertices, labels] : listed.facets) {
      SheetFacet& facet = mesh.facets.emplace_back();
      std::ranges::transform(vertices, facet.ids.begin(),
                             [&](std::uint32_t v) { return listed.vertices[v]; });
      std::ranges::sort(facet.ids);
      facet.sheet = labels.sheet;
    }
  }

  SiteBox sites(MortonKey leaf) const { return lattice_.sites_in(run_.frame.box(leaf)); }

  void read_core(MortonKey leaf, std::span<const std::size_t> around) {
    core_ = {};
    has_core_ = false;
    for (const std::size_t other : around) {
      const auto table = tables_.get(other);
      if (table->core.is_empty()) continue;
      // Not made for leaves outside, which may be a thousand λ wide.
      if (!has_core_) core_ = {sites(leaf).expanded(2), kNoBody};
      has_core_ = true;
      for_each_core_row(table->core, sites(octree_.leaves()[other]), core_.box(),
                        [&](const LatticeRow& row, std::uint64_t) {
                          for (std::int32_t n = 0; n < static_cast<std::int32_t>(row.count); ++n)
                            core_[row.first + LatticeSite{0, 0, 2 * n}] = row.body;
                        });
    }
  }
  bool is_core(const LatticeSite& site) const {
    return has_core_ && core_.box().contains(site) && core_[site] != kNoBody;
  }

  void find_positions(MortonKey leaf, std::span<const std::size_t> around, LeafMesh& mesh) {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    const std::span<const std::uint64_t> ids = mesh.ids;
    mesh.positions.assign(ids.size(), {kUnknown, kUnknown, kUnknown});
    mesh.is_core.assign(ids.size(), false);
    for (const std::size_t other : around) {
      const auto table = tables_.get(other);
      for_each_common(ids, table->listed.ids, [&](auto id, auto place) {
        mesh.positions[static_cast<std::size_t>(id)] =
            table->listed.positions[static_cast<std::size_t>(place)];
      });
    }
    for (std::size_t i = 0; i < ids.size(); ++i) {
      if (!std::isnan(mesh.positions[i].x)) continue;
      if (ids[i] >= kFirstOtherId || !is_core(site_of(ids[i]))) throw_unknown_point(ids[i], leaf);
      mesh.positions[i] = lattice_.position(site_of(ids[i]));
      mesh.is_core[i] = true;
    }
  }

  void add_core_cells(MortonKey leaf, LeafMesh& mesh) const {
    if (!has_core_) return;
    constexpr std::uint32_t kNew = ~std::uint32_t{0};
    SiteBlock<std::uint32_t> index(core_.box(), kNew);
    const auto vertex = [&](const LatticeSite& site) {
      std::uint32_t& place = index[site];
      if (place == kNew) {
        place = static_cast<std::uint32_t>(mesh.ids.size());
        mesh.ids.push_back(site_id(site));
        mesh.positions.push_back(lattice_.position(site));
        mesh.is_core.push_back(true);
      }
      return place;
    };
    for_each_core_cell(
        sites(leaf), [&](const LatticeSite& site) { return is_core(site); },
        [&](const LatticeSite& site, const LatticeCell& cell) {
          mesh.cells.push_back({vertex(site), vertex(site + cell[0]), vertex(site + cell[1]),
                                vertex(site + cell[2])});
          if (has_bodies_) mesh.bodies.push_back(core_[site]);
        });
  }

  const Reader& reader_;
  bool has_facets_, has_bodies_;
  const RunRecord& run_;
  const LinearOctree& octree_;
  LeafScale scale_;
  Lattice lattice_;
  LeafWindow<Table> tables_;
  SiteBlock<BodyId> core_;  // around the leaf in hand
  bool has_core_ = false;
};

// Gathers cells into one ViewCells.
class CellGatherer {
 public:
  CellGatherer(ViewCells& out, bool finds_boundary) : out_(out), finds_boundary_(finds_boundary) {}

  // Returns how many they are.
  template <class IsShown>
  std::uint64_t add(std::uint32_t leaf, const LeafMesh& mesh, const IsShown& is_shown) {
    out_.leaves.push_back({leaf, 0});
    for (const auto& [ids, sheet] : mesh.facets) sheets_[ids] = sheet;
    for (std::size_t cell = 0; cell < mesh.cells.size(); ++cell)
      if (is_shown(cell)) add(mesh, cell);
    return out_.leaves.back()[1];
  }

  void finish() {
    if (!finds_boundary_) return;
    out_.boundary.assign(out_.cells.size(), 0);
    for (const auto& [facet, place] : open_)  // in any order: each sets a bit of its own
      out_.boundary[place >> 2] |= static_cast<std::uint8_t>(1U << (place & 3));
    for (const auto& [facet, place] : between_)
      out_.boundary[place >> 2] |= static_cast<std::uint8_t>(0x11U << (place & 3));
    if (!sheets_.empty()) find_sheets();
  }

 private:
  using Facet = std::array<std::uint32_t, 3>;

  void find_sheets() {
    std::vector<std::pair<std::uint32_t, SheetId>> by_place;
    const auto find = [&](const Facet& facet, std::uint32_t place) {
      std::array<std::uint64_t, 3> ids{};
      std::ranges::transform(facet, ids.begin(), [&](std::uint32_t v) { return ids_[v]; });
      std::ranges::sort(ids);
      const auto listed = sheets_.find(ids);
      by_place.emplace_back(place, listed == sheets_.end() ? 0 : listed->second);
    };
    for (const auto& [facet, place] : open_) find(facet, place);
    for (const auto& [facet, place] : between_) find(facet, place);
    std::ranges::sort(by_place);
    for (const auto& [place, sheet] : by_place) out_.sheets.push_back(sheet);
  }

  void add(const LeafMesh& mesh, std::size_t cell) {
    std::array<std::uint32_t, 4> named{};
    for (std::size_t i = 0; i < 4; ++i) {
      const std::uint32_t v = mesh.cells[cell][i];
      const auto next = static_cast<std::uint32_t>(out_.vertices.size());
      const auto [place, is_new] = index_.try_emplace(mesh.ids[v], next);
      if (is_new) {
        out_.vertices.push_back(mesh.positions[v]);
        if (finds_boundary_) ids_.push_back(mesh.ids[v]);
      }
      named[i] = place->second;
    }
    out_.cells.push_back(named);
    ++out_.leaves.back()[1];
    if (!mesh.bodies.empty()) {
      const BodyId body = mesh.bodies[cell];
      if (out_.bodies.empty() || out_.bodies.back()[0] != body) out_.bodies.push_back({body, 0});
      ++out_.bodies.back()[1];
      body_of_.push_back(body);
    }
    const CellQuality quality = quality_of(mesh.corners(cell));
    out_.min_dihedral_degrees.push_back(static_cast<float>(quality.min_dihedral_degrees));
    out_.radius_edge_ratios.push_back(static_cast<float>(quality.radius_edge_ratio));
    out_.circumradii.push_back(static_cast<float>(quality.circumradius));
    if (finds_boundary_) toggle_facets(mesh, cell);
  }

  // A facet that comes twice is inside, or between two bodies. Those of core points alone are
  // always inside.
  void toggle_facets(const LeafMesh& mesh, std::size_t cell) {
    const auto place = static_cast<std::uint32_t>(out_.cells.size() - 1);
    const auto& named = out_.cells.back();
    for (std::uint32_t opposite = 0; opposite < 4; ++opposite) {
      Facet facet{};
      bool is_of_core = true;
      for (std::uint32_t i = 0, n = 0; i < 4; ++i) {
        if (i == opposite) continue;
        facet[n++] = named[i];
        is_of_core = is_of_core && mesh.is_core[mesh.cells[cell][i]];
      }
      if (is_of_core) continue;
      std::ranges::sort(facet);
      const auto [held, is_new] = open_.try_emplace(facet, 4 * place + opposite);
      if (is_new) continue;
      const std::uint32_t other = held->second;
      open_.erase(held);
      if (mesh.bodies.empty() || body_of_[other >> 2] == body_of_[place]) continue;
      between_.emplace_back(facet, other);
      between_.emplace_back(facet, 4 * place + opposite);
    }
  }

  ViewCells& out_;
  bool finds_boundary_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;    // of vertices, by id; never listed
  std::unordered_map<Facet, std::uint32_t, TableHash> open_;  // 4 * cell + opposite vertex
  std::vector<std::pair<Facet, std::uint32_t>> between_;      // likewise, twice each
  std::vector<BodyId> body_of_;                               // of the cells, if there are several
  std::vector<std::uint64_t> ids_;                            // of the vertices
  std::unordered_map<std::array<std::uint64_t, 3>, SheetId, TableHash> sheets_;  // never listed
};

bool straddles(const LeafMesh& mesh, std::size_t cell, const ViewPlane& plane) {
  const auto corners = mesh.corners(cell);
  const auto [low, high] = std::minmax({corners[0][plane.axis], corners[1][plane.axis],
                                        corners[2][plane.axis], corners[3][plane.axis]});
  return low <= plane.position && plane.position <= high;
}

// Gathers cells leaf by leaf into the view's sets. Another rank than the first keeps its own until
// finish() tells them.
class SetGatherer {
 public:
  SetGatherer(std::vector<ViewCells>& sets, bool finds_boundary, Exchange& exchange)
      : exchange_(exchange) {
    for (ViewCells& set : sets) gatherers_.emplace_back(set, finds_boundary);
  }

  // Returns how many they are.
  template <class IsShown>
  std::uint64_t add(std::uint32_t set, std::uint32_t leaf, const LeafMesh& mesh,
                    const IsShown& is_shown) {
    if (exchange_.rank() == 0) return gatherers_[set].add(leaf, mesh, is_shown);
    told_.push_back({set, leaf, part_of(mesh, is_shown)});
    return told_.back().mesh.cells.size();
  }

  void finish() {
    tell();
    for (CellGatherer& gatherer : gatherers_) gatherer.finish();
  }

 private:
  void tell() {
    auto leaf = told_.begin();
    const auto next = [&]() -> std::optional<std::vector<ToldCells>> {
      if (leaf == told_.end()) return std::nullopt;
      std::vector<ToldCells> some;
      for (std::size_t bytes = 0; leaf != told_.end() && bytes < kMessageBytes; ++leaf) {
        bytes += leaf->mesh.bytes();
        some.push_back(std::move(*leaf));
      }
      return some;
    };
    tell_first_rank(exchange_, next, [&](const std::vector<ToldCells>& some) {
      for (const auto& [set, place, mesh] : some)
        gatherers_.at(set).add(place, mesh, [](std::size_t) { return true; });
    });
  }

  Exchange& exchange_;
  std::vector<CellGatherer> gatherers_;
  std::vector<ToldCells> told_;
};

// -- The view ------------------------------------------------------------------------------------

class Viewer {
 public:
  Viewer(const Store& store, const ViewLimits& limits, Exchange& exchange)
      : limits_(limits),
        exchange_(exchange),
        reader_(store.snapshot()),
        pages_(store),
        run_(stored_run(store, reader_)),
        octree_(stored_octree(store, reader_)),
        scale_(reader_, run_) {
    run_.counts = total_counts(exchange_, run_.counts);
  }

  MeshView view() {
    view_.sheets = reader_.sheets();
    read_leaves();
    read_sites();
    read_creases();
    if (run_.phase == Phase::kDone) read_cells();
    if (!view_.has_all_cells()) read_surface();
    return std::move(view_);
  }

 private:
  void read_leaves() {
    LeafGatherer gatherer(limits_.max_leaves);
    reader_.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
      const bool is_own = info.holding == Holding::kOwn;
      is_own_.push_back(is_own);
      num_cells_.push_back(is_own ? info.num_cells + info.num_core_cells : 0);
      has_sites_.push_back(is_own && info.num_unresolved > 0);
      if (!is_own) return true;
      ViewLeaf leaf = view_leaf(key, info);
      count(leaf, view_.leaf_counts);
      if (leaf.state != LeafState::kEmpty) gatherer.add(std::move(leaf));
      return true;
    });
    view_.leaves = gatherer.take_of_all(exchange_);
    view_.leaf_counts = counts_of_all(view_.leaf_counts, exchange_);
  }

  void read_sites() {
    read_own_sites();
    view_.sites = first_of_ranks(exchange_, std::move(view_.sites), limits_.max_sites);
  }

  void read_own_sites() {
    for (std::size_t leaf = 0; leaf < has_sites_.size(); ++leaf) {
      if (!has_sites_[leaf]) continue;
      for (const UnresolvedSite& site : reader_.unresolved(octree_.leaves()[leaf]).sites) {
        if (view_.sites.size() == limits_.max_sites) return;
        view_.sites.push_back({site, place_of(octree_.leaves()[leaf], view_.leaves)});
      }
    }
  }

  // Each where its first end is.
  void read_creases() {
    if (view_.sheets.creases.empty() && view_.sheets.num_corners == 0) return;
    for (std::size_t leaf = 0; leaf < is_own_.size(); ++leaf) {
      if (!is_own_[leaf]) continue;
      const MortonKey key = octree_.leaves()[leaf];
      const LeafSurface surface = reader_.surface(key);
      const Box box = run_.frame.box(key);
      for (const CreaseEdge& edge : surface.creases)
        if (is_in_leaf(box, edge.ends[0]) && view_.creases.size() < limits_.max_creases)
          view_.creases.push_back(edge);
      for (const CornerPoint& corner : surface.corners)
        if (is_in_leaf(box, corner.position) && view_.corners.size() < limits_.max_creases)
          view_.corners.push_back(corner);
    }
    view_.creases = first_of_ranks(exchange_, std::move(view_.creases), limits_.max_creases);
    view_.corners = first_of_ranks(exchange_, std::move(view_.corners), limits_.max_creases);
  }

  void read_cells() {
    if (run_.counts.num_cells <= limits_.max_cells) {
      view_.cells.emplace_back();
      gather_cells({}, true);
      return;
    }
    // Where the model fills its leaves badly, planes meet more cells than was thought: fewer, then.
    const auto estimate = [this](std::span<const ViewPlane> planes) { return num_met(planes); };
    auto room = static_cast<double>(limits_.max_cells);
    while (room >= 1) {
      const auto planes = view_planes(run_.surface.box, static_cast<std::uint64_t>(room), estimate);
      for (const ViewPlane& plane : planes) {
        ViewCells& cells = view_.cells.emplace_back();
        cells.axis = plane.axis;
        cells.position = plane.position;
      }
      if (planes.empty() || gather_cells(planes, false)) return;
      view_.cells.clear();
      room = estimate(planes) - 1;
    }
  }

  // In whole steps, so that sums do not depend on who has which leaves.
  double num_met(std::span<const ViewPlane> planes) const {
    constexpr double kSteps = 1 << 10;
    std::uint64_t num = 0;
    for (const ViewPlane& plane : planes)
      for (std::size_t leaf = 0; leaf < num_cells_.size(); ++leaf) {
        if (num_cells_[leaf] == 0) continue;
        const Box box = run_.frame.box(octree_.leaves()[leaf]);
        // Half-open: a plane between two leaves counts once.
        if (plane.position < box.min[plane.axis] || plane.position >= box.max[plane.axis]) continue;
        const double side = box.max.x - box.min.x, extent = kCellExtent * scale_.of(leaf);
        num += static_cast<std::uint64_t>(kSteps * kEstimateMargin *
                                          static_cast<double>(num_cells_[leaf]) *
                                          std::min(1.0, extent / side));
      }
    return static_cast<double>(of_all(num)) / kSteps;
  }

  // The sum of all ranks' numbers.
  std::uint64_t of_all(std::uint64_t own) const { return sum(exchange_, own).all; }

  bool on_all(bool is_true) const { return !any(exchange_, !is_true); }

  // All cells, or those that meet one of the planes. False: these are too many.
  bool gather_cells(std::span<const ViewPlane> planes, bool has_all) {
    SetGatherer sets(view_.cells, has_all, exchange_);
    LeafMeshReader meshes(reader_, run_, octree_, has_all && view_.sheets.sheets.size() > 1,
                          view_.sheets.bodies.size() > 1);
    std::uint64_t num_gathered = 0;
    for (std::size_t leaf = 0; leaf < octree_.size(); ++leaf) {
      if (num_cells_[leaf] == 0) continue;
      const MortonKey key = octree_.leaves()[leaf];
      const Box box = run_.frame.box(key).expanded(kCellReach * scale_.of(leaf));
      const bool is_met =
          std::ranges::any_of(planes, [&](const ViewPlane& plane) { return meets(plane, box); });
      if (!has_all && !is_met) continue;
      const LeafMesh mesh = meshes.load(leaf);
      pages_.count(mesh.bytes());
      for (std::uint32_t set = 0; set < view_.cells.size(); ++set) {
        if (!has_all && !meets(planes[set], box)) continue;
        num_gathered += sets.add(set, place_of(key, view_.leaves), mesh, [&](std::size_t cell) {
          return has_all || straddles(mesh, cell, planes[set]);
        });
      }
      if (!has_all && num_gathered > limits_.max_cells) break;
    }
    if (!has_all && of_all(num_gathered) > limits_.max_cells) return false;
    sets.finish();
    return true;
  }

  void read_surface() {
    const Point origin = run_.surface.box.min;
    const double finest = max_norm(run_.surface.box.max - run_.surface.box.min) / kFinestSteps;
    const auto wanted = static_cast<double>(std::max<std::uint64_t>(limits_.max_triangles, 8));
    const bool is_small = run_.surface.num_triangles <= limits_.max_triangles;
    // A grid of side h has about 1.8 cubes to h² of surface, and twice as many triangles.
    double grid = is_small ? finest : std::max(finest, std::sqrt(3.6 * run_.surface.area / wanted));
    for (;; grid *= 1.3) {
      SurfaceThinner thinner(origin, grid);
      if (!thin(thinner)) continue;
      view_.surface = thinner.take();
      view_.surface.grid = is_small ? 0 : grid;
      return;
    }
  }

  // False: there are too many triangles. As some cancel each other, that is known at the end; but
  // of vertices there are only ever more.
  bool thin(SurfaceThinner& thinner) {
    const auto has_room = [&] { return thinner.num_vertices() <= limits_.max_triangles; };
    for (std::size_t leaf = 0; leaf < octree_.size() && has_room(); ++leaf)
      if (is_own_[leaf]) add_triangles(octree_.leaves()[leaf], thinner);
    if (!on_all(has_room())) return false;
    std::optional<SurfaceThinner::Part> own;
    if (exchange_.rank() != 0) own = thinner.take_part();
    tell_first_rank(
        exchange_, [&] { return std::exchange(own, std::nullopt); },
        [&](const SurfaceThinner::Part& part) {
          if (has_room()) thinner.add(part);
        });
    const bool fits = has_room() && thinner.num_triangles() <= limits_.max_triangles;
    return on_all(fits);
  }

  void add_triangles(MortonKey leaf, SurfaceThinner& thinner) {
    const LeafSurface surface = reader_.surface(leaf);
    const Box box = run_.frame.box(leaf);
    for (const Triangle& triangle : surface.triangles)
      if (owns_triangle(box, triangle)) thinner.add(triangle);
    pages_.count(surface.triangles.size() * sizeof(Triangle));
  }

  ViewLimits limits_;
  Exchange& exchange_;
  Snapshot reader_;
  PageRelease pages_;
  RunRecord run_;
  LinearOctree octree_;
  LeafScale scale_;
  // Of each leaf; of others' there is nothing.
  std::vector<std::uint64_t> num_cells_;
  std::vector<bool> is_own_, has_sites_;
  MeshView view_;
};

}  // namespace

std::vector<ViewPlane> view_planes(
    const Box& box, std::uint64_t max_cells,
    const std::function<double(std::span<const ViewPlane>)>& num_met) {
  std::vector<ViewPlane> best;
  for (int num = 1; num <= kMaxPlanesOfAxis; ++num) {
    std::vector<ViewPlane> planes;
    for (int axis = 0; axis < 3; ++axis)
      for (int i = 1; i <= num; ++i) {
        const double side = box.max[axis] - box.min[axis];
        planes.push_back({axis, box.min[axis] + side * i / (num + 1)});
      }
    if (num_met(planes) > static_cast<double>(max_cells)) break;
    best = std::move(planes);
  }
  return best;
}

MeshView mesh_view(const Store& store, const ViewLimits& limits, Exchange& exchange) {
  return Viewer(store, limits, exchange).view();
}

}  // namespace locvol
