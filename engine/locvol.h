/// \file
/// The library's face: fill a closed surface with tetrahedra, out of core.
///
/// This header is all that a program includes; it needs the standard library alone. With CMake,
/// `find_package(locvol REQUIRED)` and `target_link_libraries(... locvol::locvol)`.
///
/// \code
/// const locvol::Surface surface = locvol::Surface::file("bunny.stl");
/// const locvol::Mesh mesh = locvol::mesh_surface(surface, {.size = locvol::Size::percent(2)});
/// mesh.for_each_chunk([](const locvol::Chunk& chunk) { use(chunk.vertices, chunk.cells); });
/// mesh.write("bunny.vtu");
/// \endcode
///
/// surface_info() chooses a size for who has none in mind, and estimate_run() tells what a run will
/// take.
///
/// A run keeps its state in a store, a directory on a local disk. If Options::store names it, an
/// interrupted run goes on where it stopped: call mesh_surface() as before, or resume_run().
/// The mesh is a function of the surface and of Options: not of Control, and not of interruptions.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/plan/library_options.h"
#include "storage/run_choices.h"

namespace locvol {

/// Why something failed, for programs; Error::what() says it to people, with the cure.
enum class ErrorCode {
  kInput,     ///< The surface, or an option: not closed, intersects itself, size out of range ...
  kMismatch,  ///< The store holds a run of another surface or under other options.
  kMemory,    ///< Control::memory_bytes is too small (the message has the least that would do), or
              ///< the system gives no more. What was committed is kept.
  kStore,     ///< The store: not there, in use by another process, damaged, of another version.
  kSystem,    ///< The disk is full, a file cannot be written ... What was committed is kept.
  kCanceled,  ///< Control::is_canceled ended it before it knew the run. Nothing is changed.
  kInternal,  ///< A bug of locvol.
};

/// All that this library throws. What a callback throws comes out as it is.
class Error : public std::runtime_error {
 public:
  /// An error of that kind, with its message.
  Error(ErrorCode code, const std::string& what) : std::runtime_error(what), code_(code) {}
  /// What kind it is.
  ErrorCode code() const { return code_; }

 private:
  ErrorCode code_;
};

/// Three indices into a list of vertices.
using TriangleIndices = std::array<std::uint32_t, 3>;

/// A closed surface: triangles that do not intersect each other, each edge in two of them. They may
/// come in any order and orientation, and several components may lie within each other. Corners
/// with the same coordinates are one vertex.
///
/// The surface is read while it is meshed, and a store knows it by a digest. Nothing of it stays in
/// memory, so it may be larger than that.
class Surface {
 public:
  /// Takes the corners of one triangle.
  using Visitor = std::function<void(const std::array<Coordinates, 3>& corners)>;
  /// Calls the visitor for each triangle: the same ones in the same order whenever it is called,
  /// which is once or twice a run.
  using Source = std::function<void(const Visitor& visit)>;
  /// Takes the corners of one triangle, and the name of its group, which is empty if it has none.
  using GroupedVisitor =
      std::function<void(const std::array<Coordinates, 3>& corners, std::string_view group)>;
  /// As Source.
  using GroupedSource = std::function<void(const GroupedVisitor& visit)>;

  /// STEP, IGES, BREP (by the package locvol-cad), STL, OBJ, OFF, PLY, VTK polydata, Gmsh, 3MF or
  /// glTF, also packed by gzip, or a pipe with a name. What the file holds decides, not what it is
  /// called.
  static Surface file(std::filesystem::path path);
  /// Several files, each of which is a body, called as the file without its extension: a part of
  /// the domain that is closed by itself, see Options::has_bodies. Files that are closed together
  /// alone are one body. Throws Error (kInput) without any.
  static Surface files(std::vector<std::filesystem::path> paths);
  /// Triangles in memory, which must stay where they are while they are meshed. Throws
  /// Error (kInput) for an index that is out of range.
  static Surface arrays(std::span<const Coordinates> vertices,
                        std::span<const TriangleIndices> triangles);
  /// Likewise, with a group for each triangle: an index into `names`. What has a name keeps it: see
  /// Mesh::sheets().
  static Surface arrays(std::span<const Coordinates> vertices,
                        std::span<const TriangleIndices> triangles,
                        std::span<const std::uint32_t> groups, std::vector<std::string> names);
  /// Triangles that a function gives one by one.
  static Surface triangles(Source source);
  /// Likewise, with the names of their groups.
  static Surface grouped_triangles(GroupedSource source);

 private:
  friend struct SurfaceAccess;
  std::filesystem::path file_;
  std::vector<std::filesystem::path> more_files_;
  GroupedSource source_;  // empty: it is in the files
};

/// What a run is doing.
enum class Stage {
  kIngest,      ///< Reads, checks and cuts the surface.
  kInitialize,  ///< Puts the first points on the surface and inside.
  kRefine,      ///< Restores what is violated, leaf by leaf.
  kDone,        ///< The mesh is whole.
};

/// How far a run is.
struct Status {
  Stage stage = Stage::kIngest;     ///< What it is doing.
  std::uint64_t num_triangles = 0;  ///< Read, checked and cut, one after another; of kIngest.
  std::uint64_t num_leaves = 0;     ///< Of the octree.
  std::uint64_t num_waiting = 0;    ///< Leaves that have yet to be visited.
  std::uint64_t num_visits = 0;     ///< Made so far.
  std::uint64_t num_points = 0;     ///< So far.
  std::uint64_t num_cells = 0;      ///< So far.
};

/// How a run is carried out; no influence on the mesh. The functions may be empty. They are called
/// by one thread at a time, not always the same one (with `num_threads` 1, the caller), and must
/// not call back into the run; what they throw ends the run, which keeps what was committed.
struct Control {
  /// What the library may take, heap and mapped pages, besides what the program has by itself. 0:
  /// half of what is free.
  std::uint64_t memory_bytes = 0;
  int num_threads = 0;  ///< 0: as many as the process may use.
  /// Called after each visit and each commit, and now and then while the surface is read.
  std::function<void(const Status&)> on_progress = {};
  /// Asked between visits, and ten times a second wherever something takes long: true ends the run
  /// at once, after a commit. Visits in hand are dropped and will be made again, so a run that is
  /// always canceled before its longest visit is over never ends. Seldom, a step that cannot be
  /// interrupted takes a second more.
  std::function<bool()> is_canceled = {};
  /// Told what was repaired in the surface.
  std::function<void(const std::string&)> on_note = {};
};

/// A part of the surface, and of the mesh's boundary, that conditions can be given for: what hangs
/// together of a named group, or of all where there are none, up to edges where the surface turns
/// by more than Options::sharp_angle.
struct Sheet {
  /// What it is exactly, to 10^-5 of the diagonal of the surface's box.
  enum class Form {
    kOther,     ///< None of these.
    kPlane,     ///< With a normal, which points outward.
    kCylinder,  ///< With an axis and a radius.
    kSphere,    ///< With a center and a radius.
    kCone,      ///< With an axis from its tip, which is the center, and an angle.
    kTorus      ///< With an axis, a center and two radii.
  };
  std::uint32_t id = 0;             ///< From 1 on: its place in Mesh::sheets(), plus one.
  std::string name = {};            ///< That of its group, which ends in _1, _2, ... of several.
  std::string group = {};           ///< As the surface calls it; empty: it has no name there.
  std::uint64_t num_facets = 0;     ///< Of the mesh's boundary.
  double area = 0;                  ///< Of these.
  std::uint64_t num_triangles = 0;  ///< Of the surface.
  double surface_area = 0;          ///< Of these.
  Coordinates centroid = {};        ///< Likewise.
  Coordinates box_min = {};         ///< Likewise, the smallest coordinates.
  Coordinates box_max = {};         ///< Likewise, the largest coordinates.
  Form form = Form::kOther;         ///< Likewise.
  Coordinates direction = {};       ///< Of a plane its normal, of others their axis.
  Coordinates center = {};          ///< Of a cylinder a point of its axis, of a cone its tip.
  double radius = 0;                ///< Of a torus, of the circle in the middle of its tube.
  double tube_radius = 0;           ///< Of a torus.
  double half_angle = 0;            ///< Of a cone, between axis and surface, in radians.
  bool is_hollow = false;           ///< Likewise: the surface faces the axis or the center.
  /// The bodies on its sides, by Body::id, the larger one first; 0: the outside.
  std::array<std::uint32_t, 2> bodies = {1, 0};
};

/// A part of the domain, of several: a material. Cells know theirs by Chunk::bodies.
struct Body {
  std::uint32_t id = 0;             ///< From 1 on: its place in Mesh::bodies(), plus one.
  std::string name = {};            ///< Of its file or its group; else "body 2", by its number.
  std::uint32_t around = 0;         ///< The body that it lies in; 0: none, or several.
  std::uint64_t num_triangles = 0;  ///< Of the surface, all around it.
  double surface_volume = 0;        ///< That they bound, without what lies in it.
};

/// What is known of a surface without a run.
struct SurfaceInfo {
  std::uint64_t num_triangles = 0;        ///< Repaired.
  std::uint64_t num_vertices = 0;         ///< Different places of corners.
  std::uint64_t num_components = 0;       ///< Connected parts.
  std::int64_t euler_characteristic = 0;  ///< Vertices - edges + triangles.
  double area = 0;                        ///< Of all its triangles.
  double volume = 0;                      ///< Of what it bounds.
  Coordinates box_min = {};               ///< The smallest coordinates.
  Coordinates box_max = {};               ///< The largest coordinates.
  /// λ for who has none in mind, a length: for about half a million cells, or for more where walls
  /// and gaps take them at any size that does not lose walls. 0 if there is no volume.
  double default_size = 0;
  bool has_sharp_edges = false;  ///< It turns by more than the sharp angle, or some are given.

  /// Places that face a part of the surface across about the same distance.
  struct Facing {
    std::int32_t step = 0;  ///< The distance is 2^(step / 32) or more, and less than the next.
    std::uint32_t num_walls = 0;  ///< Across the inside, between two sheets.
    std::uint32_t num_rods = 0;   ///< Across the inside, where it is narrow all around.
    std::uint32_t num_gaps = 0;   ///< Across the outside, where that is closer, between two sheets.
    std::uint32_t num_holes = 0;  ///< Likewise, where it is narrow all around.
  };
  /// Of places that are spread evenly over the area, in order of distance: where walls are thin, a
  /// mesh takes many cells.
  std::vector<Facing> facing = {};
  std::uint64_t num_facing_places = 0;  ///< With those that face nothing. 0: nothing is known.
  /// Those that a run with default_size would have, and with the angle that was given; none, if the
  /// surface is one without a name. Of facets nothing is known, and no form was looked for.
  std::vector<Sheet> sheets = {};
  std::vector<Body> bodies = {};  ///< Empty: there is one.
};

/// What a run will take, told before it by laws that were fitted to runs of many models.
struct Estimate {
  /// 9 of 10 runs lie between an estimate over this and times this: counts of cells and vertices.
  static constexpr double kCountFactor = 1.15;
  /// Likewise, the bytes of the store.
  static constexpr double kBytesFactor = 1.7;
  /// Likewise, seconds.
  static constexpr double kSecondsFactor = 2.5;

  double size = 0;           ///< λ as a length.
  double num_cells = 0;      ///< Tetrahedra.
  double num_vertices = 0;   ///< Of the mesh.
  double store_bytes = 0;    ///< Of the run's store at its end; it has been larger at no time.
  double vtu_bytes = 0;      ///< Of the mesh as a .vtu file.
  double run_seconds = 0;    ///< Of mesh_surface(), on cores of 2.6 GHz.
  double write_seconds = 0;  ///< Of Mesh::write() of that file, to a disk of 1 GB a second.
  std::uint64_t least_memory_bytes =
      0;                 ///< The least Control::memory_bytes that is expected to do.
  bool is_thin = false;  ///< The surface is thinner than λ on average.
  /// Of the cells, those that are there for the sake of walls and gaps that are narrower than λ.
  /// All may be up to twice as many, or half, where these are most.
  double num_narrow_cells = 0;
  /// The part of the area that has walls too thin to be resolved at this size: they may be missing.
  double lost_area = 0;
};

/// What is known of a run and its mesh.
struct Summary {
  double size = 0;                           ///< λ as a length.
  std::uint64_t num_cells = 0;               ///< Tetrahedra.
  std::uint64_t num_points = 0;              ///< Of the triangulation; a few may be in no cell.
  std::uint64_t num_leaves = 0;              ///< Of the octree.
  std::uint64_t num_visits = 0;              ///< Of leaves.
  std::uint64_t num_unresolved = 0;          ///< See Mesh::unresolved().
  double min_dihedral = 0;                   ///< Of the options: in degrees; 0: any.
  std::uint64_t num_surface_triangles = 0;   ///< Of the input, repaired.
  std::uint64_t num_surface_vertices = 0;    ///< Of the input.
  std::uint64_t num_surface_components = 0;  ///< Of the input.
  std::int64_t surface_euler_characteristic = 0;  ///< Of the input: vertices - edges + triangles.
  double surface_area = 0;                        ///< Of the input.
  double surface_volume = 0;                      ///< Of what the input bounds.
};

/// A place where the surface is not smooth enough at the scale λ: the promise is not kept there.
struct UnresolvedPlace {
  int condition = 0;          ///< 1 to 6: which of the conditions C1 to C6 could not be met.
  Coordinates position = {};  ///< Where.
  double radius = 0;          ///< Of the ball in question.
};

/// A cell with a dihedral angle below Options::min_dihedral, which nothing improved.
struct PoorCellPlace {
  double min_dihedral_degrees = 0;  ///< Its smallest angle.
  Coordinates position = {};        ///< The center of its circumball.
  double radius = 0;                ///< Of its circumball.
  bool is_forced = false;           ///< Counted by Statistics::num_forced_cells.
};

/// Some cells with all their vertices. Spans are valid until the next chunk.
///
/// Vertices have numbers from 0 in the whole mesh, in the order in which chunks bring them. Most of
/// a chunk's are its own; the others are of chunks before or after it, and are repeated here so
/// that a chunk can be dealt with alone.
struct Chunk {
  std::uint64_t first_cell = 0;    ///< The number of cells[0] in the whole mesh.
  std::uint64_t first_vertex = 0;  ///< The number of vertices[0] in the whole mesh.
  std::uint32_t num_own = 0;       ///< So many vertices come first: numbers from first_vertex on.
  std::span<const Coordinates> vertices = {};          ///< Own ones, then the others.
  std::span<const std::uint64_t> vertex_numbers = {};  ///< The number of each, in the whole mesh.
  /// Four indices into `vertices`, positively oriented: (b - a) × (c - a) · (d - a) > 0.
  std::span<const std::array<std::uint32_t, 4>> cells = {};
  std::span<const std::uint32_t> bodies =
      {};  ///< Of each cell, from 1 on. Empty: there is one body.

  /// Of second order: the number of nodes[0] in the whole mesh. Nodes, in the middle of edges, have
  /// the numbers after those of all vertices, and come as vertices do, own ones first.
  std::uint64_t first_node = 0;
  std::uint32_t num_own_nodes = 0;          ///< So many nodes come first.
  std::span<const Coordinates> nodes = {};  ///< On boundary edges, they are on the surface.
  std::span<const std::uint64_t> node_numbers = {};  ///< The number of each, in the whole mesh.
  /// Of each cell, six indices into `nodes`: of its edges 0 1, 1 2, 0 2, 0 3, 1 3, 2 3.
  std::span<const std::array<std::uint32_t, 6>> cell_nodes = {};
};

/// How many values lie in each of some ranges.
struct Distribution {
  std::vector<double> edges = {};  ///< Ascending, one more than `counts`.
  /// counts[i]: from edges[i] to below edges[i + 1]. The last one also has all values above.
  std::vector<std::uint64_t> counts = {};
};

/// What the cells of a mesh are like. Angles are in degrees. A cell has six dihedral angles; its
/// radius-edge ratio is its circumradius over its shortest edge, 0.612 if it is regular.
struct Statistics {
  std::uint64_t num_cells = 0;       ///< Measured.
  double volume = 0;                 ///< Of all cells.
  double min_dihedral_degrees = 0;   ///< The smallest angle of all.
  double max_dihedral_degrees = 0;   ///< The largest angle of all.
  std::uint64_t num_poor_cells = 0;  ///< See Mesh::poor_cells(). Normally 0.
  /// Of these, those that have no room for larger angles: in walls thinner than about λ/4, and at
  /// creases sharper than 30°.
  std::uint64_t num_forced_cells = 0;
  double max_radius_edge_ratio = 0;  ///< At most 2 where no place is unresolved.
  double max_circumradius = 0;       ///< A length: below λ where no place is unresolved.
  /// Of a cell, its circumradius over the size at its circumcenter: below 1 where no place is
  /// unresolved. Where sizes do not vary, that size is λ.
  double max_circumradius_over_size = 0;
  /// The circumradii of two cells that share a facet, the larger over the smaller. 0 where sizes do
  /// not vary.
  double max_ratio_of_neighbors = 0;
  Distribution dihedral_angles = {};        ///< All angles, six a cell; in steps of two degrees.
  Distribution min_dihedral_angles = {};    ///< The smallest angle of each cell.
  Distribution radius_edge_ratios = {};     ///< One a cell, in steps of 0.05.
  Distribution circumradii_over_size = {};  ///< One a cell, in steps of 0.05, up to 1.
  /// Of the size at their circumcenters, a length: edges are powers of two, from the least that
  /// there are cells of.
  Distribution cells_by_size = {};
  std::vector<Statistics> bodies = {};  ///< Of each of several, by Body::id. Empty: there is one.
};

/// Some facets of the mesh's boundary, and of what lies between two bodies: they are in one cell
/// each, or in one cell of each body, and there once. Spans are valid until the next chunk.
struct BoundaryChunk {
  std::uint64_t first_facet = 0;  ///< The number of facets[0] among all.
  /// Three vertices each, by their numbers in the whole mesh, counterclockwise from outside;
  /// between bodies, from that with the smaller id.
  std::span<const std::array<std::uint64_t, 3>> facets = {};
  std::span<const std::array<Coordinates, 3>> corners = {};  ///< Where these vertices lie.
  std::span<const std::uint64_t> cells = {};   ///< The number of each facet's cell; of two, that
                                               ///< of the body with the larger id.
  std::span<const std::uint32_t> sheets = {};  ///< Of which sheet each is: Sheet::id.
  /// On the sides of each, by Body::id, the larger one first; 0: the outside.
  std::span<const std::array<std::uint32_t, 2>> bodies = {};
  /// Of second order: the numbers of the nodes of each, of its edges 0 1, 1 2, 2 0.
  std::span<const std::array<std::uint64_t, 3>> nodes = {};
};

/// Gives what a mesh hands out, one piece after another. It keeps the store open to be read, and
/// may outlive the Mesh. Threads: used by one at a time.
template <class Piece>
class Stream {
 public:
  /// The next one, which stays as long as it is held; null: there are no more. Throws Error.
  std::shared_ptr<const Piece> next() { return next_(); }

 private:
  friend class Mesh;
  explicit Stream(std::function<std::shared_ptr<const Piece>()> next) : next_(std::move(next)) {}
  std::function<std::shared_ptr<const Piece>()> next_;
};

/// What Mesh::write() puts into a file besides vertices and cells.
struct FileOptions {
  int order = 1;                   ///< 2: cells with a node in the middle of each edge.
  bool has_boundary = false;       ///< Facets, creases and corners, in formats that lack them else.
  bool has_quality = false;        ///< What measures each cell: .vtu and .vtkhdf.
  bool splits_interfaces = false;  ///< Each of several bodies has vertices of its own, for contact.
};

/// A run's result. It reads from the store, and holds no part of the mesh in memory.
/// Threads: used by one at a time, and not from within a function that it calls.
class Mesh {
 public:
  Mesh(Mesh&&) noexcept;             ///< Leaves nothing to be used behind.
  Mesh& operator=(Mesh&&) noexcept;  ///< Leaves nothing to be used behind.
  ~Mesh();  ///< Removes the store if it has no name, once no stream reads it.

  /// False: the run was canceled. resume_run(store()) goes on with it.
  bool is_complete() const;
  /// Counts and measures; of a canceled run, so far.
  const Summary& summary() const;
  /// Where the run is kept.
  const std::filesystem::path& store() const;
  /// At most `max` of the places that are counted by Summary::num_unresolved.
  std::vector<UnresolvedPlace> unresolved(std::uint64_t max = 1000) const;

  /// How many vertices have numbers: those in some cell. The first call reads all cells once.
  std::uint64_t num_vertices() const;
  /// Measures all cells, reading those that the store lists. Needs 10 MB besides for each thread of
  /// Control::num_threads. REQUIRES: is_complete()
  Statistics statistics() const;
  /// At most `max` of the cells that are counted by Statistics::num_poor_cells. Measures all cells
  /// up to those. REQUIRES: is_complete()
  std::vector<PoorCellPlace> poor_cells(std::uint64_t max = 1000) const;
  /// Hands out the whole mesh, leaf by leaf along the octree: always the same chunks in the same
  /// order. A chunk is one leaf, or several small ones, a few megabytes. Needs 60 MB besides, and
  /// a temporary file beside the store. `order`: 2 for cells with a node in the middle of each
  /// edge, which needs 60 MB more. REQUIRES: is_complete()
  void for_each_chunk(const std::function<void(const Chunk&)>& visit, int order = 1) const;
  /// The same chunks, for who asks for one after another. `bytes`: about so much has a chunk, and
  /// at least a leaf; 0: a mebibyte, as have those of second order always.
  /// REQUIRES: is_complete()
  Stream<Chunk> chunks(int order = 1, std::uint64_t bytes = 0) const;
  /// Hands out the boundary of the mesh, a closed surface with its vertices on the input's, and
  /// what lies between bodies, in the order of its cells. Needs 60 MB besides, and temporary files
  /// beside the store. `order`: as of for_each_chunk(). REQUIRES: is_complete()
  void for_each_boundary_chunk(const std::function<void(const BoundaryChunk&)>& visit,
                               int order = 1) const;
  /// The same chunks, for who asks for one after another. REQUIRES: is_complete()
  Stream<BoundaryChunk> boundary_chunks(int order = 1) const;
  /// The sheets of the surface, measured there and on the mesh's boundary. One that is called
  /// "boundary" if nothing parts it. Reads the surface twice; needs 30 MB besides, and a temporary
  /// file beside the store. REQUIRES: is_complete()
  std::vector<Sheet> sheets() const;
  /// The bodies, of several; Statistics::bodies measures them. Empty: there is one.
  std::vector<Body> bodies() const;
  /// Writes the mesh in the format that the file's extension means: .vtu, .vtkhdf, .msh (Gmsh 4.1),
  /// .mesh and .meshb (Medit), .inp (Abaqus), .node with .ele (TetGen); or its boundary: .stl,
  /// .ply, .obj. The file appears under its name only when it is whole. Returns its bytes. Throws
  /// Error (kInput) before a byte is written if the format cannot hold the mesh, or what is asked
  /// for; formats of the boundary have order 1 alone. REQUIRES: is_complete()
  std::uint64_t write(const std::filesystem::path& file, const FileOptions& options = {}) const;

 private:
  friend struct MeshAccess;
  struct Impl;
  explicit Mesh(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;  // of streams, too
};

/// Meshes the volume inside the surface: starts a run, or goes on with the one that the store holds
/// if it is of the same surface and options. Throws Error.
Mesh mesh_surface(const Surface& surface, const Options& options, const Control& control = {});

/// Goes on with the run in a store; if it is done, only opens it. Needs neither the surface nor the
/// options, but for a surface that was in no file and had not been read to its end. Throws Error.
Mesh resume_run(const std::filesystem::path& store, const Control& control = {});

/// Opens the run in a store as it is, finished or not: only to be looked into. `control`: its
/// memory and threads. Throws Error.
Mesh open_run(const std::filesystem::path& store, const Control& control = {});

/// Reads and checks a surface as mesh_surface() does, and refuses what that would refuse; once
/// read, it is forgotten. Temporary files lie in `scratch`; empty: the system's directory for them.
/// `weld`, `sharp_angle`, `sharp_polylines`, `has_bodies`, `voids`, `gap`, `inside`,
/// `wrap_alpha`, `wrap_offset`: see Options. Throws Error.
SurfaceInfo surface_info(const Surface& surface, const Control& control = {},
                         const std::filesystem::path& scratch = {},
                         const std::optional<Size>& weld = {},
                         double sharp_angle = Options().sharp_angle,
                         const std::filesystem::path& sharp_polylines = {}, bool has_bodies = false,
                         const std::vector<std::string>& voids = {}, const Size& gap = {},
                         InsideRule inside = InsideRule::kClosed, const Size& wrap_alpha = {},
                         const Size& wrap_offset = {});

/// What a run on that surface will take, on so many threads (0: as many as the process may use).
/// Reads nothing. Throws Error (kInput) for options out of range.
Estimate estimate_run(const SurfaceInfo& surface, const Options& options, int num_threads = 0);

/// Sets malloc's options for the whole process, as the command does, so that what a run takes stays
/// within Control::memory_bytes: glibc keeps a heap for each thread otherwise, with what its
/// largest visit took (twice the bound with eight threads). To be called before there are threads.
void share_one_heap();

/// "0.1.0".
const char* version();

}  // namespace locvol
