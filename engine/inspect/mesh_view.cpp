#include "engine/inspect/mesh_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "engine/ingest/surface_check.h"
#include "engine/inspect/cell_mesh.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/shared/lattice_of_run.h"
#include "engine/shared/leaf_name.h"
#include "octree/octree.h"
#include "octree/site_block.h"

namespace locvol {
namespace {

constexpr std::size_t kWindowBytes = std::size_t{16} << 20;
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

// Leaves in Morton order; those below one node of the deepest level allowed become one. That level
// rises as more leaves come than may be.
class LeafGatherer {
 public:
  explicit LeafGatherer(std::uint64_t max_leaves) : max_leaves_(max_leaves) {}

  void add(ViewLeaf leaf) {
    append(std::move(leaf));
    while (leaves_.size() > max_leaves_ && level_ > 0) {
      --level_;
      for (ViewLeaf& held : std::exchange(leaves_, {})) append(std::move(held));
    }
  }
  std::vector<ViewLeaf> take() { return std::move(leaves_); }

 private:
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

// The cells of one leaf, the core's after those that the store lists.
struct LeafMesh {
  std::vector<std::uint64_t> ids;
  std::vector<Point> positions;
  std::vector<bool> is_core;  // of each vertex
  std::vector<std::array<std::uint32_t, 4>> cells;

  std::array<Point, 4> corners(std::size_t cell) const {
    const auto& [a, b, c, d] = cells[cell];
    return {positions[a], positions[b], positions[c], positions[d]};
  }
};

class LeafMeshReader {
 public:
  LeafMeshReader(const Reader& reader, const RunRecord& run, const LinearOctree& octree)
      : reader_(reader),
        run_(run),
        octree_(octree),
        scale_(reader, run),
        lattice_(lattice_of(run)),
        tables_(kWindowBytes, [this](std::size_t leaf) { return load_table(leaf); }) {}

  LeafMesh load(std::size_t leaf) {
    const MortonKey key = octree_.leaves()[leaf];
    const std::vector<std::size_t> around =
        leaves_near(octree_, run_.frame, leaf, kCellReach * scale_.of(leaf));
    read_core(key, around);
    LeafCells cells = reader_.cells(key);
    LeafMesh mesh{.ids = std::move(cells.vertices),
                  .positions = {},
                  .is_core = {},
                  .cells = std::move(cells.cells)};
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

  SiteBox sites(MortonKey leaf) const { return lattice_.sites_in(run_.frame.box(leaf)); }

  void read_core(MortonKey leaf, std::span<const std::size_t> around) {
    core_ = {};
    has_core_ = false;
    for (const std::size_t other : around) {
      const auto table = tables_.get(other);
      if (table->core.is_empty()) continue;
      // Not made for leaves outside, which may be a thousand λ wide.
      if (!has_core_) core_ = {sites(leaf).expanded(2), 0};
      has_core_ = true;
      for_each_core_site(table->core, sites(octree_.leaves()[other]), core_.box(),
                         [&](const LatticeSite& site, std::uint64_t) { core_[site] = 1; });
    }
  }
  bool is_core(const LatticeSite& site) const {
    return has_core_ && core_.box().contains(site) && core_[site] != 0;
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
        });
  }

  const Reader& reader_;
  const RunRecord& run_;
  const LinearOctree& octree_;
  LeafScale scale_;
  Lattice lattice_;
  LeafWindow<Table> tables_;
  SiteBlock<std::uint8_t> core_;  // around the leaf in hand
  bool has_core_ = false;
};

// Gathers cells into one ViewCells.
class CellGatherer {
 public:
  CellGatherer(ViewCells& out, bool finds_boundary) : out_(out), finds_boundary_(finds_boundary) {}

  void begin_leaf(std::uint32_t leaf) { out_.leaves.push_back({leaf, 0}); }

  void add(const LeafMesh& mesh, std::size_t cell) {
    std::array<std::uint32_t, 4> named{};
    for (std::size_t i = 0; i < 4; ++i) {
      const std::uint32_t v = mesh.cells[cell][i];
      const auto next = static_cast<std::uint32_t>(out_.vertices.size());
      const auto [place, is_new] = index_.try_emplace(mesh.ids[v], next);
      if (is_new) out_.vertices.push_back(mesh.positions[v]);
      named[i] = place->second;
    }
    out_.cells.push_back(named);
    ++out_.leaves.back()[1];
    const CellQuality quality = quality_of(mesh.corners(cell));
    out_.min_dihedral_degrees.push_back(static_cast<float>(quality.min_dihedral_degrees));
    out_.radius_edge_ratios.push_back(static_cast<float>(quality.radius_edge_ratio));
    out_.circumradii.push_back(static_cast<float>(quality.circumradius));
    if (finds_boundary_) toggle_facets(mesh, cell);
  }

  void finish() {
    if (!finds_boundary_) return;
    out_.boundary.assign(out_.cells.size(), 0);
    for (const auto& [facet, place] : open_)  // in any order: each sets a bit of its own
      out_.boundary[place >> 2] |= static_cast<std::uint8_t>(1U << (place & 3));
  }

 private:
  using Facet = std::array<std::uint32_t, 3>;

  // A facet that comes twice is inside. Those of core points alone always are.
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
      if (!is_new) open_.erase(held);
    }
  }

  ViewCells& out_;
  bool finds_boundary_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;    // of vertices, by id; never listed
  std::unordered_map<Facet, std::uint32_t, TableHash> open_;  // 4 * cell + opposite vertex
};

bool straddles(const LeafMesh& mesh, std::size_t cell, const ViewPlane& plane) {
  const auto corners = mesh.corners(cell);
  const auto [low, high] = std::minmax({corners[0][plane.axis], corners[1][plane.axis],
                                        corners[2][plane.axis], corners[3][plane.axis]});
  return low <= plane.position && plane.position <= high;
}

// -- The view ------------------------------------------------------------------------------------

class Viewer {
 public:
  Viewer(const Store& store, const ViewLimits& limits)
      : limits_(limits),
        reader_(store.snapshot()),
        pages_(store),
        run_(stored_run(store, reader_)),
        octree_(stored_octree(store, reader_)),
        scale_(reader_, run_) {}

  MeshView view() {
    read_leaves();
    read_sites();
    if (run_.phase == Phase::kDone) read_cells();
    if (!view_.has_all_cells()) read_surface();
    return std::move(view_);
  }

 private:
  void read_leaves() {
    LeafGatherer gatherer(limits_.max_leaves);
    reader_.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
      num_cells_.push_back(info.num_cells + info.num_core_cells);
      num_unresolved_.push_back(info.num_unresolved > 0);
      ViewLeaf leaf = view_leaf(key, info);
      if (leaf.state != LeafState::kEmpty) gatherer.add(std::move(leaf));
      return true;
    });
    view_.leaves = gatherer.take();
  }

  void read_sites() {
    for (std::size_t leaf = 0; leaf < num_unresolved_.size(); ++leaf) {
      if (!num_unresolved_[leaf]) continue;
      for (const UnresolvedSite& site : reader_.unresolved(octree_.leaves()[leaf]).sites) {
        if (view_.sites.size() == limits_.max_sites) return;
        view_.sites.push_back({site, place_of(octree_.leaves()[leaf], view_.leaves)});
      }
    }
  }

  void read_cells() {
    if (run_.counts.num_cells <= limits_.max_cells) {
      view_.cells.emplace_back();
      gather_cells({}, true);
      return;
    }
    // Where the model fills its leaves badly, planes meet more cells than was thought: fewer, then.
    const auto estimate = [this](const ViewPlane& plane) { return num_met(plane); };
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
      room = -1;
      for (const ViewPlane& plane : planes) room += estimate(plane);
    }
  }

  double num_met(const ViewPlane& plane) const {
    double num = 0;
    for (std::size_t leaf = 0; leaf < num_cells_.size(); ++leaf) {
      if (num_cells_[leaf] == 0) continue;
      const Box box = run_.frame.box(octree_.leaves()[leaf]);
      // Half-open: a plane between two leaves counts once.
      if (plane.position < box.min[plane.axis] || plane.position >= box.max[plane.axis]) continue;
      const double side = box.max.x - box.min.x, extent = kCellExtent * scale_.of(leaf);
      num += static_cast<double>(num_cells_[leaf]) * std::min(1.0, extent / side);
    }
    return kEstimateMargin * num;
  }

  // All cells, or those that meet one of the planes. False: these are too many.
  bool gather_cells(std::span<const ViewPlane> planes, bool has_all) {
    std::vector<CellGatherer> gatherers;
    for (ViewCells& cells : view_.cells) gatherers.emplace_back(cells, has_all);
    LeafMeshReader meshes(reader_, run_, octree_);
    std::uint64_t num_gathered = 0;
    for (std::size_t leaf = 0; leaf < octree_.size(); ++leaf) {
      if (num_cells_[leaf] == 0) continue;
      const MortonKey key = octree_.leaves()[leaf];
      const Box box = run_.frame.box(key).expanded(kCellReach * scale_.of(leaf));
      const bool is_met =
          std::ranges::any_of(planes, [&](const ViewPlane& plane) { return meets(plane, box); });
      if (!has_all && !is_met) continue;
      const LeafMesh mesh = meshes.load(leaf);
      pages_.count(mesh.cells.size() * sizeof mesh.cells[0] + 40 * mesh.ids.size());
      for (std::size_t g = 0; g < gatherers.size(); ++g) {
        if (!has_all && !meets(planes[g], box)) continue;
        gatherers[g].begin_leaf(place_of(key, view_.leaves));
        for (std::size_t cell = 0; cell < mesh.cells.size(); ++cell) {
          if (!has_all && !straddles(mesh, cell, planes[g])) continue;
          gatherers[g].add(mesh, cell);
          ++num_gathered;
        }
      }
      if (!has_all && num_gathered > limits_.max_cells) return false;
    }
    for (CellGatherer& gatherer : gatherers) gatherer.finish();
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

  // False: there are too many triangles.
  bool thin(SurfaceThinner& thinner) {
    for (const MortonKey leaf : octree_.leaves()) {
      const LeafSurface surface = reader_.surface(leaf);
      const Box box = run_.frame.box(leaf);
      for (const Triangle& triangle : surface.triangles)
        if (owns_triangle(box, triangle)) thinner.add(triangle);
      pages_.count(surface.triangles.size() * sizeof(Triangle));
      if (thinner.num_triangles() > limits_.max_triangles) return false;
    }
    return true;
  }

  ViewLimits limits_;
  Snapshot reader_;
  PageRelease pages_;
  RunRecord run_;
  LinearOctree octree_;
  LeafScale scale_;
  std::vector<std::uint64_t> num_cells_;  // of each leaf
  std::vector<bool> num_unresolved_;
  MeshView view_;
};

}  // namespace

std::vector<ViewPlane> view_planes(const Box& box, std::uint64_t max_cells,
                                   const std::function<double(const ViewPlane&)>& num_met) {
  std::vector<ViewPlane> best;
  for (int num = 1; num <= kMaxPlanesOfAxis; ++num) {
    std::vector<ViewPlane> planes;
    double total = 0;
    for (int axis = 0; axis < 3; ++axis)
      for (int i = 1; i <= num; ++i) {
        const double side = box.max[axis] - box.min[axis];
        planes.push_back({axis, box.min[axis] + side * i / (num + 1)});
        total += num_met(planes.back());
      }
    if (total > static_cast<double>(max_cells)) break;
    best = std::move(planes);
  }
  return best;
}

std::uint32_t SurfaceThinner::vertex_at(const Point& p) {
  const auto step = [&](double value, double origin) {
    constexpr std::uint64_t kMask = (std::uint64_t{1} << 21) - 1;
    return static_cast<std::uint64_t>(std::llround((value - origin) / grid_) + 1) & kMask;
  };
  const std::uint64_t cube =
      step(p.x, origin_.x) << 42 | step(p.y, origin_.y) << 21 | step(p.z, origin_.z);
  const auto [place, is_new] =
      index_.try_emplace(cube, static_cast<std::uint32_t>(vertices_.size()));
  if (is_new) vertices_.emplace_back();
  Vertex& vertex = vertices_[place->second];
  vertex.sum = vertex.sum + p;
  ++vertex.count;
  return place->second;
}

void SurfaceThinner::add(const Triangle& triangle) {
  std::array<std::uint32_t, 3> t{};
  for (std::size_t i = 0; i < 3; ++i) t[i] = vertex_at(triangle.corners[i]);
  if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return;
  std::ranges::rotate(t, std::ranges::min_element(t));
  const int turn = t[1] < t[2] ? 1 : -1;
  if (turn < 0) std::swap(t[1], t[2]);
  const auto [place, is_new] = triangles_.try_emplace(t, turn);
  if (!is_new && (place->second += turn) == 0) triangles_.erase(place);
}

ViewSurface SurfaceThinner::take() {
  ViewSurface surface;
  for (const Vertex& vertex : vertices_)
    surface.vertices.push_back((1 / vertex.count) * vertex.sum);
  for (const auto& [t, count] : triangles_)
    for (int i = 0; i < std::abs(count); ++i)
      surface.triangles.push_back(count > 0 ? t : std::array{t[0], t[2], t[1]});
  std::ranges::sort(surface.triangles);  // no order of a hash table shows
  return surface;
}

MeshView mesh_view(const Store& store, const ViewLimits& limits) {
  return Viewer(store, limits).view();
}

}  // namespace locvol
