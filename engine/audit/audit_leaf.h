// The parts of the audit (audit.h): what is loaded around a leaf, and the checks on it.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "engine/audit/audit_grid.h"
#include "engine/audit/audit_report.h"
#include "engine/audit/audit_sizes.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "octree/shares.h"

namespace locvol {

// Index of a point in LocalPoints, so that order of index is lexicographic order of points.
using LocalIndex = std::uint32_t;
inline constexpr LocalIndex kUnknownPoint = ~LocalIndex{0};

inline constexpr double kBoundSlack = 1 + 1e-9;  // rounded measures against bounds

// Counts violations and describes the first of each kind.
class AuditFindings {
 public:
  explicit AuditFindings(AuditReport& report) : report_(&report) {}
  AuditReport& report() { return *report_; }
  void add(std::uint64_t AuditReport::*count, std::string_view what, MortonKey leaf,
           const Point& place);
  // Counts what refinement leaves open where it could not go on: near a site it is no violation.
  void add_unless_open(std::uint64_t AuditReport::*count, std::string_view what, MortonKey leaf,
                       const Point& place);
  void add_fault(const std::string& what);
  // Takes the sites that may matter to the findings to come. `distance`: up to which one is near
  void set_sites(std::vector<Point> sites, double distance);

 private:
  AuditReport* report_;
  std::vector<Point> sites_;
  double site_distance_ = 0;
};

// The leaves of a store, found by their boxes. Leaves are named by their place in Morton order.
class AuditLeaves {
 public:
  AuditLeaves(const Frame& frame, std::vector<MortonKey> keys)
      : frame_(frame), keys_(std::move(keys)) {}
  std::size_t size() const { return keys_.size(); }
  MortonKey key(std::size_t leaf) const { return keys_[leaf]; }
  Box box(std::size_t leaf) const { return box(keys_[leaf]); }
  Box box(MortonKey key) const { return frame_.box(key); }
  bool tile_the_root() const;
  // The leaves whose closed boxes are at most `distance` from `box`, in order. REQUIRES:
  // tile_the_root()
  std::vector<std::size_t> within(const Box& box, double distance) const;

 private:
  void collect(MortonKey node, std::span<const MortonKey> below, const Box& box, double squared,
               std::vector<std::size_t>& found) const;

  Frame frame_;
  std::vector<MortonKey> keys_;
};

// Unresolved sites of a leaf.
struct SitesOfLeaf {
  MortonKey leaf;
  std::vector<Point> sites;
};

// The records of leaves, each as the rank has it whose leaf it is.
class AuditRecords {
 public:
  // The records of a store that has all of the run.
  explicit AuditRecords(const Reader& own) : own_(&own) {}
  // The records that a rank has. `store_beside`: those of leaves near its own, as others have told
  AuditRecords(const Reader& own, const Store& store_beside, const RankRecord& rank,
               std::vector<SitesOfLeaf> sites_beside)
      : own_(&own),
        store_beside_(&store_beside),
        beside_(store_beside.snapshot()),
        shares_(rank.first),
        rank_(static_cast<int>(rank.rank)),
        sites_beside_(std::move(sites_beside)) {}

  const Shares& shares() const { return shares_; }
  bool is_own(MortonKey leaf) const { return shares_.owner_of(leaf) == rank_; }
  const Reader& of(MortonKey leaf) const { return is_own(leaf) ? *own_ : *beside_; }
  const Reader& own() const { return *own_; }
  const Store* store_beside() const { return store_beside_; }  // null: there are no others
  std::span<const SitesOfLeaf> sites_beside() const { return sites_beside_; }

 private:
  const Reader* own_;
  const Store* store_beside_ = nullptr;
  std::optional<Snapshot> beside_;
  Shares shares_;
  int rank_ = 0;
  std::vector<SitesOfLeaf> sites_beside_;
};

struct LocalPoint {
  Point position;
  std::uint64_t id = 0;
  std::uint32_t leaf = 0;
  bool is_core = false;  // known by its place in the lattice alone
  PointKind kind = PointKind::kLattice;
  BodyId body = kOnlyBody;  // of a core point
};

// The points of a leaf and those within 2λ of its box, in lexicographic order.
class LocalPoints {
 public:
  LocalPoints() = default;
  explicit LocalPoints(std::vector<LocalPoint> points);

  std::size_t size() const { return points_.size(); }
  const LocalPoint& operator[](LocalIndex i) const { return points_[i]; }
  const Point& position(LocalIndex i) const { return points_[i].position; }
  // The index of each id, or kUnknownPoint.
  std::vector<LocalIndex> find(std::span<const std::uint64_t> ids) const;
  LocalIndex at(const Point& position) const;  // or kUnknownPoint
  // Pairs that share an id or a position.
  std::vector<std::array<LocalIndex, 2>> repetitions() const;

 private:
  struct Name {
    std::uint64_t id;
    LocalIndex index;
    friend auto operator<=>(const Name&, const Name&) = default;
  };
  std::vector<LocalPoint> points_;
  std::vector<Name> by_id_;
};

// Four different points in positive orientation.
struct LocalCell {
  std::array<LocalIndex, 4> vertices;
  BodyId body = kOnlyBody;
};

// A facet of the star with some own vertex; vertices ascend.
struct LocalFacet {
  std::array<LocalIndex, 3> vertices;
  std::int32_t side = 0;  // of the cell: +1 if it lies where the vertices turn counterclockwise
  BodyId body = kOnlyBody, beyond = kNoBody;  // of the cell, and on the other side
  friend auto operator<=>(const LocalFacet&, const LocalFacet&) = default;
};

// All that the checks of one leaf need. Its cells are checked one by one; the star, that is all
// cells at its own points, whichever leaf keeps them, for how they fit together.
struct AuditLeaf {
  std::uint32_t leaf = 0;
  MortonKey key;
  LocalPoints points;
  LeafCells cells;                      // as stored, then those of the core
  std::vector<LocalIndex> cell_vertex;  // index of each of cells.vertices
  LeafFacets facets;                    // as stored
  std::vector<LocalCell> star;          // without flat cells and those with unknown vertices
  // In a run of the surface alone, which has no cells: the facets at own points, whichever leaf
  // lists them, without those with unknown vertices.
  bool is_surface_only = false;
  std::vector<LocalFacet> star_facets;
  AuditSizes sizes;  // around them
  double reach = 0;  // so far around the leaf's box points are known
  // If the run keeps them: the crease edges that come so close, and the leaf's own corners.
  std::vector<CreaseEdge> creases;
  std::vector<CornerPoint> corners;

  bool is_own(LocalIndex i) const { return points[i].leaf == leaf; }
};

// Reads the records; keeps the borders of the leaves near the last one loaded.
class AuditLoader {
 public:
  AuditLoader(const Store& store, const AuditRecords& records, const AuditLeaves& leaves,
              const RunRecord& run);
  AuditLoader(const AuditLoader&) = delete;
  AuditLoader& operator=(const AuditLoader&) = delete;
  // Reports misplaced and repeated points on the way. Nothing if the leaf has no points nor cells,
  // and no creases.
  std::optional<AuditLeaf> load(std::size_t leaf, AuditFindings& findings);

 private:
  // What a leaf has within 2λ of its border: points, and the cells that name points of others.
  struct Border {
    std::vector<LocalPoint> points;
    std::vector<std::uint64_t> vertices;
    std::vector<std::array<std::uint32_t, 4>> cells;
    std::vector<BodyId> bodies;       // of the cells
    LeafFacets facets;                // in a run of the surface alone, likewise
    std::vector<SizeCube> cubes;      // all of the leaf, where sizes vary
    std::vector<CreaseEdge> creases;  // all of the leaf, if the run keeps them

    std::size_t bytes() const {
      return sizeof *this + points.capacity() * sizeof(LocalPoint) + vertices.capacity() * 8 +
             cells.capacity() * 16 + bodies.capacity() * sizeof(BodyId) +
             facets.vertices.capacity() * 8 + facets.facets.capacity() * sizeof(MeshFacet) +
             cubes.capacity() * sizeof(SizeCube) + creases.capacity() * sizeof(CreaseEdge);
    }
  };
  Border load_border(std::size_t leaf);
  std::vector<LocalPoint> core_points(std::size_t leaf, const LatticeCore& core) const;
  void add_core_cells(AuditLeaf& here) const;

  const AuditRecords* records_;
  const AuditLeaves* leaves_;
  Lattice lattice_;
  double reach(std::size_t leaf) const { return kCellReach * kBoundSlack * scale_.of(leaf); }

  SizeLaw law_;
  Frame frame_;
  LeafScale scale_;
  bool has_creases_, is_surface_only_;
  PageRelease pages_, pages_beside_;
  LeafWindow<Border> borders_;
};

struct AuditBounds {
  double size = 0;  // λ
  double radius_edge = 0;
  double min_dihedral = 0;   // in degrees; 0: any
  double rounding = 0;       // a few units in the last place of the largest coordinate
  bool has_sheets = false;   // else all is of sheet 1
  bool has_creases = false;  // which are to be kept
  double crease_floor = 0;   // what of creases is shorter is not told apart
  double growth = 0;         // of h
  Point origin = {};         // of volumes
  // Of each sheet, the bodies on its sides, the larger first; empty: there is one body.
  std::vector<std::array<BodyId, 2>> bodies_of_sheets = {};
  bool has_bodies() const { return !bodies_of_sheets.empty(); }
};

class AuditCreases;

// Each cell by itself: orientation, circumball, shape, place.
void check_cells(const AuditLeaf& leaf, const AuditCreases& creases, const AuditBounds& bounds,
                 AuditFindings& findings);

// Facets at own points that are in one cell only, or in two of different bodies: then that of the
// larger body. In a run of the surface alone, those that are listed.
std::vector<LocalFacet> boundary_facets(const AuditLeaf& leaf, AuditFindings& findings);

// Of a run of the surface alone, each facet whose smallest vertex is own by itself: size and shape.
// Do those that meet at an edge face the same way?
void check_facets(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                  const AuditBounds& bounds, AuditFindings& findings);

// Are the facets that the leaf lists those whose smallest vertex is own?
void check_listed_facets(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                         AuditFindings& findings);

// Is each that it lists of the sheet of a triangle closest to its centroid, and between the bodies
// that this sheet parts?
void check_sheets(const AuditLeaf& leaf, const AuditLeaves& leaves, const AuditRecords& records,
                  const AuditBounds& bounds, AuditFindings& findings);

// Edges and links of the boundary at own points.
// Of each body by itself.
void check_boundary_links(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                          AuditFindings& findings);

// Distance of own boundary vertices from the triangles near the leaf.
void check_boundary_on_surface(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                               const AuditLeaves& leaves, const AuditRecords& records,
                               const AuditBounds& bounds, AuditFindings& findings);

// Vertices of a facet between two bodies lie where the surface parts these two.
void check_between_bodies(const AuditLeaf& leaf, std::span<const LocalFacet> boundary,
                          const AuditLeaves& leaves, const AuditRecords& records,
                          const AuditBounds& bounds, AuditFindings& findings);

// Disjoint sets of 0 … n-1.
class UnionFind {
 public:
  explicit UnionFind(std::size_t n = 0);
  std::size_t add();  // a new element, alone; returns its number
  std::size_t find(std::size_t i);
  void unite(std::size_t i, std::size_t j);
  std::size_t num_sets() const { return num_sets_; }

 private:
  std::vector<std::size_t> parents_;
  std::size_t num_sets_ = 0;
};

// Counts the components of the boundary leaf by leaf. Each component of a leaf's own boundary
// vertices gets a label; a vertex that shares a facet with a later leaf's is remembered until then.
class BoundaryComponents {
 public:
  // An own vertex that shares a facet with one of another rank's leaf.
  struct Crossing {
    std::uint64_t own = 0, other = 0;  // ids
    std::uint32_t other_leaf = 0;
    std::size_t label = 0;  // of the own one's component
  };

  explicit BoundaryComponents(const AuditRecords& records) : records_(&records) {}
  // Leaves must come in Morton order.
  void add(const AuditLeaf& leaf, std::span<const LocalFacet> boundary, const AuditLeaves& leaves);
  std::size_t size() const { return labels_.num_sets(); }
  // The vertices that facets across borders have, with the labels that components have at last.
  // Memory: 32 bytes each.
  std::vector<Crossing> crossings();

 private:
  void forget_before(std::uint32_t leaf);

  UnionFind labels_;
  std::unordered_map<std::uint64_t, std::size_t> seams_;        // labels by id of a vertex
  std::map<std::uint32_t, std::vector<std::uint64_t>> expiry_;  // ids by the last leaf to ask
  std::vector<Crossing> crossings_;
  const AuditRecords* records_;
};

}  // namespace locvol
