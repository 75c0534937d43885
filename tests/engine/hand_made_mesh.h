// Small meshes whose every number is known, and stores that hold them, cut by any octree.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <numeric>
#include <random>
#include <set>
#include <vector>

#include "octree/octree.h"
#include "octree/sort_and_unite.h"
#include "refine/predicates.h"
#include "storage/store.h"

namespace locvol {

using CellIds = std::array<std::uint64_t, 4>;

struct HandMadeMesh {
  std::vector<MeshPoint> points;  // id order is none in particular; some are unused
  std::vector<CellIds> cells;
  std::vector<Triangle> surface;
  std::vector<CreaseEdge>
      creases;  // in order of their ends; if there are some, they are to be kept
  std::vector<CornerPoint> crease_corners;
  double size = 1;  // λ
  double radius_edge_bound = 2;

  const MeshPoint& point(std::uint64_t id) const {
    return *std::ranges::find(points, id, &MeshPoint::id);
  }
  MeshPoint& point(std::uint64_t id) { return *std::ranges::find(points, id, &MeshPoint::id); }
  std::array<Point, 4> corners(const CellIds& cell) const {
    return {point(cell[0]).position, point(cell[1]).position, point(cell[2]).position,
            point(cell[3]).position};
  }
  std::uint64_t smallest(const CellIds& cell) const {
    return *std::ranges::min_element(cell, {},
                                     [&](std::uint64_t id) { return point(id).position; });
  }
  std::set<std::uint64_t> used_ids() const {
    std::set<std::uint64_t> ids;
    for (const CellIds& cell : cells) ids.insert(cell.begin(), cell.end());
    return ids;
  }
  std::uint64_t next_id() const {
    return points.empty() ? 0 : std::ranges::max(points, {}, &MeshPoint::id).id + 1;
  }
};

// The facets that are in one cell, as id triples.
inline std::vector<std::array<std::uint64_t, 3>> boundary_of(const HandMadeMesh& mesh) {
  std::map<std::array<std::uint64_t, 3>, int> uses;
  for (const CellIds& cell : mesh.cells) {
    for (std::size_t k = 0; k < 4; ++k) {
      std::array<std::uint64_t, 3> facet{};
      for (std::size_t i = 0, j = 0; i < 4; ++i) {
        if (i != k) facet[j++] = cell[i];
      }
      std::ranges::sort(facet);
      ++uses[facet];
    }
  }
  std::vector<std::array<std::uint64_t, 3>> boundary;
  for (const auto& [facet, count] : uses) {
    if (count == 1) boundary.push_back(facet);
  }
  return boundary;
}

// Makes the mesh's own boundary the input surface.
inline void take_boundary_as_surface(HandMadeMesh& mesh) {
  mesh.surface.clear();
  for (const auto& [a, b, c] : boundary_of(mesh)) {
    mesh.surface.push_back(
        {mesh.surface.size(),
         {mesh.point(a).position, mesh.point(b).position, mesh.point(c).position}});
  }
}

// Ids that follow neither position nor leaf.
inline void shuffle_ids(HandMadeMesh& mesh, unsigned seed) {
  std::vector<std::uint64_t> order(mesh.points.size());
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937_64(seed));
  for (MeshPoint& p : mesh.points) p.id = order[p.id];
  for (CellIds& cell : mesh.cells) {
    for (std::uint64_t& id : cell) id = order[id];
  }
}

class MeshBuilder {
 public:
  std::uint64_t id(const Point& p) {
    const auto [place, is_new] = ids_.try_emplace(p, mesh_.points.size());
    if (is_new) mesh_.points.push_back({place->second, p, PointKind::kVolume});
    return place->second;
  }
  void add_cell(const std::array<Point, 4>& p) {
    CellIds cell = {id(p[0]), id(p[1]), id(p[2]), id(p[3])};
    if (exact_orientation(p[0], p[1], p[2], p[3]) < 0) std::swap(cell[2], cell[3]);
    mesh_.cells.push_back(cell);
  }
  HandMadeMesh finish(double size) {
    mesh_.size = size;
    shuffle_ids(mesh_, 7);
    take_boundary_as_surface(mesh_);
    return std::move(mesh_);
  }

 private:
  HandMadeMesh mesh_;
  std::map<Point, std::uint64_t> ids_;
};

// Unit cubes at integer places from 0 to n-1, those that `has` names, each cut into six cells along
// its diagonal from the lower to the upper corner. Circumradius √3/2, volume 1/6 each, λ = 1.
inline HandMadeMesh cubes(int n, const std::function<bool(int, int, int)>& has) {
  MeshBuilder builder;
  for (int i = 0; i < n * n * n; ++i) {
    const std::array<int, 3> at = {i % n, i / n % n, i / (n * n)};
    if (!has(at[0], at[1], at[2])) continue;
    std::array<int, 3> axes = {0, 1, 2};
    do {
      std::array<Point, 4> path;
      path[0] = {double(at[0]), double(at[1]), double(at[2])};
      for (std::size_t step = 0; step < 3; ++step) {
        path[step + 1] = path[step];
        path[step + 1][axes[step]] += 1;
      }
      builder.add_cell(path);
    } while (std::ranges::next_permutation(axes).found);
  }
  return builder.finish(1);
}

// The cells of the body-centered cubic lattice of spacing 1.75 whose centroids lie within `radius`
// of `center`; λ = 1, circumradius 0.978, dihedral angles 60° and 90°.
inline HandMadeMesh lattice_ball(const Point& center, double radius) {
  MeshBuilder builder;
  const double half = 0.5 * 1.75;
  const int n = 2 * (static_cast<int>(radius / half) / 2 + 3);
  const auto at = [&](const std::array<int, 3>& g) {
    return Point{g[0] * half, g[1] * half, g[2] * half};
  };
  for (int i = -n; i <= n; i += 2) {
    for (int j = -n; j <= n; j += 2) {
      for (int k = -n; k <= n; k += 2) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
          // An edge along `axis`, and a square of odd points around its middle.
          const std::array<int, 3> p = {i, j, k};
          std::array<int, 3> q = p, middle = p;
          q[axis] += 2;
          middle[axis] += 1;
          for (int turn = 0; turn < 4; ++turn) {
            const auto corner = [&](int t) {
              std::array<int, 3> c = middle;
              c[u] += (t & 3) == 0 || (t & 3) == 3 ? 1 : -1;
              c[v] += (t & 3) < 2 ? 1 : -1;
              return at(c);
            };
            const std::array<Point, 4> cell = {at(p), at(q), corner(turn), corner(turn + 1)};
            const Point centroid = 0.25 * (cell[0] + cell[1] + cell[2] + cell[3]);
            if (squared_distance(centroid, center) < radius * radius) builder.add_cell(cell);
          }
        }
      }
    }
  }
  return builder.finish(1);
}

// The Delaunay triangulation of random points, by trying all quadruples; λ holds for all cells.
inline HandMadeMesh random_delaunay(unsigned seed, int num_points) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> coordinate(0, 4);
  std::vector<Point> points;
  for (int i = 0; i < num_points; ++i) {
    points.push_back({coordinate(random), coordinate(random), coordinate(random)});
  }
  MeshBuilder builder;
  double largest = 0;
  const auto n = points.size();
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = a + 1; b < n; ++b) {
      for (std::size_t c = b + 1; c < n; ++c) {
        for (std::size_t d = c + 1; d < n; ++d) {
          std::array<Point, 4> cell = {points[a], points[b], points[c], points[d]};
          const int sign = exact_orientation(cell[0], cell[1], cell[2], cell[3]);
          if (sign == 0) continue;
          if (sign < 0) std::swap(cell[2], cell[3]);
          const bool is_empty = std::ranges::none_of(points, [&](const Point& p) {
            return exact_side_of_circumsphere(cell[0], cell[1], cell[2], cell[3], p) > 0;
          });
          if (!is_empty) continue;
          builder.add_cell(cell);
          largest = std::max(largest, circumsphere_of(cell[0], cell[1], cell[2], cell[3]).radius);
        }
      }
    }
  }
  HandMadeMesh mesh = builder.finish(1.01 * largest);
  mesh.radius_edge_bound = 1e6;
  return mesh;
}

inline std::vector<HandMadeMesh> different_meshes() {
  return {lattice_ball({2, 2, 2}, 2.6),
          cubes(3, [](int x, int y, int) { return x != 1 || y != 1; }), random_delaunay(3, 20)};
}

// A root from -2 to 6 on each axis: boxes of level 3 have a side of 1, at integer places.
inline Frame hand_made_frame() { return Frame({-2, -2, -2}, std::ldexp(8, -MortonKey::kMaxLevel)); }

// One leaf of level 1, seven cut to level 2, and one of those to level 3.
inline LinearOctree mixed_octree() {
  LinearOctree octree = LinearOctree::uniform(1);
  for (int octant = 1; octant < 8; ++octant) octree.split(MortonKey::root().child(octant));
  octree.split(MortonKey::root().child(7).child(0));
  return octree;
}

inline std::vector<LinearOctree> octrees() {
  return {LinearOctree::uniform(0), LinearOctree::uniform(1), LinearOctree::uniform(2),
          LinearOctree::uniform(3), mixed_octree()};
}

// What the mesh is in terms of records.
class HandMadeStore {
 public:
  HandMadeStore(const HandMadeMesh& mesh, const LinearOctree& octree)
      : size_(mesh.size),
        radius_edge_bound_(mesh.radius_edge_bound),
        has_creases_(!mesh.creases.empty() || !mesh.crease_corners.empty()) {
    const Frame frame = hand_made_frame();
    const auto owner = [&](const Point& p) { return octree.leaf_owning(frame, p); };
    for (const MortonKey key : octree.leaves()) {
      leaves[key] = {};
      for (const Triangle& triangle : mesh.surface) {
        if (triangle.box().overlaps(frame.box(key))) {
          leaves[key].surface.triangles.push_back(triangle);
        }
      }
      for (const CreaseEdge& edge : mesh.creases)
        if (edge.box().overlaps(frame.box(key))) leaves[key].surface.creases.push_back(edge);
      for (const CornerPoint& corner : mesh.crease_corners)
        if (frame.box(key).contains(corner.position)) leaves[key].surface.corners.push_back(corner);
    }
    for (const MeshPoint& p : mesh.points) leaves[owner(p.position)].points.points.push_back(p);
    for (auto& [key, leaf] : leaves) {
      std::ranges::sort(leaf.points.points, {}, &MeshPoint::id);
    }
    std::map<MortonKey, std::vector<CellIds>> cells;
    for (const CellIds& cell : mesh.cells) {
      const auto smallest = std::ranges::min_element(cell, {}, [&](std::uint64_t id) {
        const auto p = std::ranges::find(mesh.points, id, &MeshPoint::id);
        return p == mesh.points.end() ? Point{1e300, 0, 0} : p->position;
      });
      cells[owner(mesh.point(*smallest).position)].push_back(cell);
    }
    for (const auto& [key, list] : cells) leaves[key].cells = indexed(list);
  }

  static LeafCells indexed(const std::vector<CellIds>& cells) {
    std::set<std::uint64_t> ids;
    for (const CellIds& cell : cells) ids.insert(cell.begin(), cell.end());
    LeafCells result;
    result.vertices.assign(ids.begin(), ids.end());
    for (const CellIds& cell : cells) {
      auto& indices = result.cells.emplace_back();
      for (std::size_t i = 0; i < 4; ++i) {
        indices[i] = static_cast<std::uint32_t>(std::distance(ids.begin(), ids.find(cell[i])));
      }
    }
    return result;
  }

  // By leaf: those that one of the cells has which are stored.
  std::map<MortonKey, LeafFacets> boundary_facets() const {
    struct Owned {
      Point position;
      MortonKey leaf;
    };
    struct Used {
      int count = 0;
      std::array<std::uint64_t, 3> facet;
    };
    std::map<std::uint64_t, Owned> points;
    for (const auto& [key, leaf] : leaves)
      for (const MeshPoint& p : leaf.points.points)
        if (std::isfinite(p.position.x + p.position.y + p.position.z))
          points[p.id] = {p.position, key};
    std::map<std::array<std::uint64_t, 3>, Used> uses;
    for (const auto& [key, leaf] : leaves)
      for (const auto& [a, b, c, d] : leaf.cells.cells) {
        const auto& ids = leaf.cells.vertices;
        CellIds cell{ids[a], ids[b], ids[c], ids[d]};
        if (!std::ranges::all_of(cell, [&](std::uint64_t id) { return points.contains(id); }))
          continue;
        const auto at = [&](std::size_t k) { return points[cell[k]].position; };
        const int sign = exact_orientation(at(0), at(1), at(2), at(3));
        if (sign == 0) continue;
        if (sign < 0) std::swap(cell[2], cell[3]);
        const auto& [p, q, r, s] = cell;
        for (const auto& facet :
             {std::array{q, r, s}, std::array{p, s, r}, std::array{p, q, s}, std::array{p, r, q}}) {
          std::array<std::uint64_t, 3> name = facet;
          std::ranges::sort(name);
          Used& used = uses[name];
          ++used.count;
          used.facet = facet;
        }
      }
    std::map<MortonKey, LeafFacets> result;
    for (const int pass : {0, 1})
      for (const auto& [name, used] : uses) {
        if (used.count != 1) continue;
        const std::uint64_t smallest =
            std::ranges::min(name, {}, [&](std::uint64_t id) { return points[id].position; });
        LeafFacets& list = result[points[smallest].leaf];
        if (pass == 0) {
          list.vertices.insert(list.vertices.end(), name.begin(), name.end());
          continue;
        }
        sort_and_unite(list.vertices);
        MeshFacet& facet = list.facets.emplace_back();
        for (std::size_t k = 0; k < 3; ++k)
          facet.vertices[k] = static_cast<std::uint32_t>(
              std::ranges::lower_bound(list.vertices, used.facet[k]) - list.vertices.begin());
        facet.vertices = smallest_first(facet.vertices);
        facet.labels.sheet =
            sheet_of({points[used.facet[0]].position, points[used.facet[1]].position,
                      points[used.facet[2]].position});
      }
    for (auto& [key, list] : result) std::ranges::sort(list.facets);
    return result;
  }

  Store write(const std::filesystem::path& directory) const {
    return write(directory, boundary_facets());
  }
  Store write(const std::filesystem::path& directory,
              const std::map<MortonKey, LeafFacets>& facets) const {
    Store store = Store::open(directory, {.create = true, .is_durable = false});
    Batch batch = store.begin();
    RunRecord run;
    run.parameters.size = size_;
    run.parameters.radius_edge_bound = radius_edge_bound_;
    run.parameters.min_dihedral = min_dihedral;
    run.frame = hand_made_frame();
    run.phase = phase;
    run.surface.volume = 1.5;
    run.surface.euler_characteristic = 2;
    run.surface.num_components = 1;
    run.has_creases = has_creases_;
    run.parameters.init = init;
    for (const auto& [key, leaf] : leaves)
      run.counts.num_unresolved += leaf.unresolved.sites.size();
    batch.put_run(run);
    batch.put_sheets(sheets);
    for (const auto& [key, leaf] : leaves) {
      LeafInfo info;
      info.num_points = leaf.points.points.size();
      info.num_cells = leaf.cells.cells.size();
      info.num_triangles = leaf.surface.triangles.size();
      info.num_unresolved = leaf.unresolved.sites.size();
      batch.put_leaf(key, info);
      batch.put_points(key, leaf.points);
      batch.put_cells(key, leaf.cells);
      batch.put_surface(key, leaf.surface);
      batch.put_unresolved(key, leaf.unresolved);
    }
    for (const auto& [key, list] : facets) batch.put_facets(key, list);
    for (const QueueEntry& entry : queue) batch.put_queue_entry(entry);
    batch.commit();
    return store;
  }

  struct Leaf {
    LeafPoints points;
    LeafCells cells;
    LeafSurface surface;
    LeafUnresolved unresolved;
  };
  std::map<MortonKey, Leaf> leaves;
  std::vector<QueueEntry> queue;
  Phase phase = Phase::kDone;
  Initialization init = Initialization::kCover;
  double min_dihedral = 0;
  SurfaceSheets sheets;
  std::function<SheetId(const std::array<Point, 3>&)> sheet_of = [](const auto&) {
    return SheetId{1};
  };

 private:
  double size_, radius_edge_bound_;
  bool has_creases_;
};

}  // namespace locvol
