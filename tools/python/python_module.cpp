// locvol._locvol: the library for Python's package `locvol`, which has the documentation.
#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/formats/mesh_format.h"
#include "engine/formats/writer.h"
#include "engine/inspect/run_part.h"
#include "engine/library_errors.h"
#include "engine/locvol.h"
#include "engine/shared/memory_budget.h"
#include "tools/arguments.h"
#include "tools/faces.h"
#include "tools/inspect_summary.h"
#include "tools/page/page.h"
#include "tools/python/python_options.h"
#include "tools/python/watched.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {
namespace py = pybind11;
namespace {

// -- What is behind the library's face

// Does it with the engine and the command's own functions; errors are the library's.
template <class Action>
auto as_library(const Action& action) -> decltype(action()) try {
  return action();
} catch (const Stopped&) {
  throw;
} catch (...) {
  rethrow_as_error();
}

void require_file(const std::filesystem::path& file) {
  try {
    require_writable(file);
  } catch (const std::runtime_error& error) {
    throw Error(ErrorCode::kSystem, error.what());
  }
}

// As the command opens it to be looked into.
Store open_done(const Mesh& mesh) {
  if (!mesh.is_complete())
    throw Error(ErrorCode::kStore,
                "the store " + mesh.store().string() + " holds an unfinished run: resume it first");
  return open_whole(mesh.store());
}

// -- Arrays

template <class T, std::size_t kWidth>
py::array array_of(const std::span<const std::array<T, kWidth>> rows, const py::object& owner) {
  const T* first = rows.empty() ? nullptr : rows.front().data();
  py::array_t<T> array({rows.size(), kWidth}, first, owner);
  array.attr("flags").attr("writeable") = false;
  return array;
}

template <class T>
py::array array_of(const std::span<const T> values, const py::object& owner) {
  py::array_t<T> array(static_cast<py::ssize_t>(values.size()), values.data(), owner);
  array.attr("flags").attr("writeable") = false;
  return array;
}

// A C-contiguous array of that type, as long as it is held; see the package, which makes it so.
template <class T>
using Rows = py::array_t<T, py::array::c_style>;

template <class T, std::size_t kWidth>
std::span<const std::array<T, kWidth>> rows_of(const Rows<T>& array) {
  using Row = std::array<T, kWidth>;
  static_assert(sizeof(Row) == kWidth * sizeof(T));
  if (array.ndim() != 2 || array.shape(1) != static_cast<py::ssize_t>(kWidth))
    throw py::value_error(fmt::format("an array of shape (n, {}) is needed", kWidth));
  return {reinterpret_cast<const Row*>(array.data()), static_cast<std::size_t>(array.shape(0))};
}

// -- Surfaces

// With the arrays that it is read from.
struct HeldSurface {
  Surface surface;
  std::vector<py::object> arrays = {};
};

HeldSurface surface_of_arrays(const Rows<double>& vertices, const Rows<std::uint32_t>& triangles,
                              const std::optional<Rows<std::uint32_t>>& groups,
                              std::vector<std::string> names) {
  const auto points = rows_of<double, 3>(vertices);
  const auto corners = rows_of<std::uint32_t, 3>(triangles);
  if (!groups) return {Surface::arrays(points, corners), {vertices, triangles}};
  return {
      Surface::arrays(points, corners, {groups->data(), static_cast<std::size_t>(groups->size())},
                      std::move(names)),
      {vertices, triangles, *groups}};
}

// -- Meshes

// A mesh that several threads of Python may have: one at a time uses it.
class HeldMesh {
 public:
  explicit HeldMesh(Mesh mesh) : mesh_(std::move(mesh)) {}

  const Mesh& unguarded() const { return mesh_; }  // for what nothing changes
  // Calls use(mesh) without Python's lock.
  template <class Use>
  auto with(const Use& use) -> decltype(use(std::declval<const Mesh&>())) {
    const py::gil_scoped_release release;
    const std::lock_guard lock(mutex_);
    return use(mesh_);
  }
  // Calls use(mesh, watch) where a signal can stop it.
  template <class Use>
  auto watched(const Use& use) {
    std::optional<decltype(use(mesh_, std::declval<const Watch&>()))> result;
    watch_over([&](const Watch& watch) {
      const std::lock_guard lock(mutex_);
      result = use(mesh_, watch);
    });
    return *std::move(result);
  }

 private:
  std::mutex mutex_;
  Mesh mesh_;
};

// A stream that several threads of Python may have, one at a time.
template <class Piece>
class HeldStream {
 public:
  explicit HeldStream(Stream<Piece> stream) : stream_(std::move(stream)) {}

  std::shared_ptr<const Piece> next() {
    std::shared_ptr<const Piece> piece;
    {
      const py::gil_scoped_release release;
      const std::lock_guard lock(mutex_);
      piece = stream_.next();
    }
    if (!piece) throw py::stop_iteration();
    return piece;
  }

 private:
  std::mutex mutex_;
  Stream<Piece> stream_;
};

struct HeldChunk {
  std::shared_ptr<const Chunk> chunk;
};
struct HeldBoundaryChunk {
  std::shared_ptr<const BoundaryChunk> chunk;
};

// Fills arrays that are large enough; `bodies` may be empty. False: it was stopped.
bool fill(const Mesh& mesh, const Watch& watch, double* points, std::int64_t* cells,
          std::uint32_t* bodies) {
  Stream<Chunk> chunks = mesh.chunks();
  while (const auto chunk = chunks.next()) {
    throw_if_stopped(&watch);
    std::copy_n(chunk->vertices.begin(), chunk->num_own,
                reinterpret_cast<Coordinates*>(points) + chunk->first_vertex);
    auto* cell = reinterpret_cast<std::array<std::int64_t, 4>*>(cells) + chunk->first_cell;
    for (const auto& corners : chunk->cells)
      std::ranges::transform(corners, (cell++)->begin(), [&](std::uint32_t i) {
        return static_cast<std::int64_t>(chunk->vertex_numbers[i]);
      });
    if (bodies == nullptr) continue;
    std::ranges::copy(chunk->bodies, bodies + chunk->first_cell);
  }
  return true;
}

bool fill_boundary(const Mesh& mesh, const Watch& watch, std::int64_t* facets,
                   std::uint32_t* sheets, std::int64_t* cells) {
  Stream<BoundaryChunk> chunks = mesh.boundary_chunks();
  while (const auto chunk = chunks.next()) {
    throw_if_stopped(&watch);
    auto* facet = reinterpret_cast<std::array<std::int64_t, 3>*>(facets) + chunk->first_facet;
    for (const auto& corners : chunk->facets)
      std::ranges::transform(corners, (facet++)->begin(),
                             [](std::uint64_t v) { return static_cast<std::int64_t>(v); });
    std::ranges::copy(chunk->sheets, sheets + chunk->first_facet);
    std::ranges::transform(chunk->cells, cells + chunk->first_facet,
                           [](std::uint64_t c) { return static_cast<std::int64_t>(c); });
  }
  return true;
}

std::uint64_t num_facets(const Mesh& mesh, const Watch& watch) {
  std::uint64_t num = 0;
  Stream<BoundaryChunk> chunks = mesh.boundary_chunks();
  while (const auto chunk = chunks.next()) {
    throw_if_stopped(&watch);
    num += chunk->facets.size();
  }
  return num;
}

template <class T>
T* data_of(py::array_t<T>& array, std::size_t num) {
  if (static_cast<std::size_t>(array.size()) != num)
    throw py::value_error("an array of another size is needed");
  return array.mutable_data();
}

std::uint64_t write(const Mesh& mesh, const Watch& watch, const std::filesystem::path& file,
                    const OutputOptions& output, int num_threads) {
  return as_library([&] {
    const Store store = open_done(mesh);
    require_file(file);
    const WriteSummary written = write_mesh(store, file, output, num_threads, {}, &watch);
    if (output.has_faces) write_faces(store, file, output.splits_interfaces, &watch);
    return written.bytes;
  });
}

OutputOptions output_options(const std::filesystem::path& file, const std::string& format,
                             int order, bool boundary, bool quality, bool faces,
                             bool split_interfaces) {
  return as_library([&] {
    OutputOptions output;
    try {
      output.format = format.empty() ? format_meant_by(file) : parse_format(format);
    } catch (const std::invalid_argument& error) {
      throw Error(ErrorCode::kInput, fmt::format("format '{}': {}", format, error.what()));
    }
    output.order = order;
    output.has_boundary = boundary;
    output.has_quality = quality;
    output.has_faces = faces;
    output.splits_interfaces = split_interfaces;
    if (order != 1 && order != 2)
      throw Error(ErrorCode::kInput, fmt::format("cells of order {}: give 1 or 2", order));
    require_cell_data(output);
    require_order(output);
    return output;
  });
}

std::string inspect_json(const Mesh& mesh, bool reads_all) {
  return as_library(
      [&] { return json_line(inspected(whole_run(open_whole(mesh.store())), reads_all)); });
}

std::string audit_json(const Mesh& mesh, const Watch& watch, std::uint64_t one_in) {
  return as_library([&] {
    const auto on_step = [&](std::uint64_t, std::uint64_t) { throw_if_stopped(&watch); };
    return json_line(to_json(audit(open_done(mesh), on_step, one_in)));
  });
}

std::uint64_t write_report(const Mesh& mesh, const std::filesystem::path& file,
                           std::uint64_t max_cells, int num_threads) {
  return as_library([&] {
    require_file(file);
    ViewLimits limits;
    if (max_cells > 0) limits.max_cells = max_cells;
    return write_page(open_whole(mesh.store()), file, limits, num_threads).bytes;
  });
}

// -- Runs

// The mesh of a run that may have been stopped, or None if the surface was not read to its end; and
// what Python has thrown meanwhile, or None.
template <class Run>
py::tuple run_watched(const py::object& progress, const py::object& on_note,
                      std::uint64_t memory_bytes, int num_threads, const Run& run) {
  Watch watch;
  const Control control = watch.control(memory_bytes, num_threads);
  std::optional<Mesh> mesh;
  const py::object refused =
      watch_over(watch, progress, on_note, [&] { mesh.emplace(run(control)); });
  // The thread that they were called from is over.
  return py::make_tuple(mesh ? py::cast(std::make_shared<HeldMesh>(*std::move(mesh))) : py::none(),
                        refused);
}

Options options_of(const py::dict& given) {
  Options options;
  set_options(given, options);
  return options;
}

// What is told of a surface depends on these alone.
SurfaceInfo survey(const HeldSurface& surface, const py::dict& given,
                   const std::filesystem::path& scratch, std::uint64_t memory_bytes,
                   int num_threads, const py::object& on_note) {
  const Options options = options_of(given);
  Watch watch;
  const Control control = watch.control(memory_bytes, num_threads);
  std::optional<SurfaceInfo> info;
  const py::object refused = watch_over(watch, py::none(), on_note, [&] {
    info = surface_info(surface.surface, control, scratch, options.weld, options.sharp_angle,
                        options.sharp_polylines, options.has_bodies, options.voids, options.gap,
                        options.inside, options.wrap_alpha, options.wrap_offset);
  });
  if (!refused.is_none()) {
    PyErr_SetObject(py::type::handle_of(refused).ptr(), refused.ptr());
    throw py::error_already_set();
  }
  return *std::move(info);
}

// -- Classes of plain values: their members are attributes, and all of them their repr().

py::object value_of(const Coordinates& place) {
  return py::make_tuple(place[0], place[1], place[2]);
}
py::object value_of(const std::array<std::uint32_t, 2>& pair) {
  return py::make_tuple(pair[0], pair[1]);
}
py::object value_of(const Stage& stage) {
  constexpr std::array<const char*, 4> kNames = {"ingest", "initialize", "refine", "done"};
  return py::str(kNames[static_cast<std::size_t>(stage)]);
}
py::object value_of(const Sheet::Form& form) {
  constexpr std::array<const char*, 6> kNames = {"other",  "plane", "cylinder",
                                                 "sphere", "cone",  "torus"};
  return py::str(kNames[static_cast<std::size_t>(form)]);
}
template <class T>
py::object value_of(const T& value) {
  return py::cast(value);
}

template <class T>
class Values {
 public:
  Values(py::module_& module, const char* name, const char* text) : class_(module, name, text) {}
  template <class Member>
  Values& with(const char* name, Member T::*member, const char* text) {
    class_.def_property_readonly(
        name, [member](const T& value) { return value_of(value.*member); }, text);
    names_.append(name);
    return *this;
  }
  py::class_<T>& end() {
    class_.attr("__match_args__") = py::tuple(names_);
    class_.def("__repr__", [](const py::object& self) {
      std::string text = py::str(self.attr("__class__").attr("__name__"));
      text += '(';
      bool is_first = true;
      for (const py::handle name : self.attr("__match_args__")) {
        if (!std::exchange(is_first, false)) text += ", ";
        text += fmt::format("{}={}", std::string(py::str(name)),
                            std::string(py::repr(self.attr(name))));
      }
      return text + ")";
    });
    return class_;
  }

 private:
  py::class_<T> class_;
  py::list names_;
};

void add_values(py::module_& module) {
  Values<Status>(module, "Status", "How far a run is: what `progress` is called with.")
      .with("stage", &Status::stage, "'ingest', 'initialize', 'refine' or 'done'.")
      .with("num_triangles", &Status::num_triangles,
            "Triangles read, checked and cut, one after another; of 'ingest'.")
      .with("num_leaves", &Status::num_leaves, "Leaves of the octree.")
      .with("num_waiting", &Status::num_waiting, "Leaves that have yet to be visited.")
      .with("num_visits", &Status::num_visits, "Visits of leaves so far.")
      .with("num_points", &Status::num_points, "Points so far.")
      .with("num_cells", &Status::num_cells, "Cells so far.")
      .end();
  Values<Summary>(module, "Summary", "What is known of a run and its mesh; `Mesh.summary`.")
      .with("size", &Summary::size, "λ, a length.")
      .with("num_cells", &Summary::num_cells, "Tetrahedra.")
      .with("num_points", &Summary::num_points, "Of the triangulation; a few may be in no cell.")
      .with("num_leaves", &Summary::num_leaves, "Leaves of the octree.")
      .with("num_visits", &Summary::num_visits, "Visits of leaves.")
      .with("num_unresolved", &Summary::num_unresolved, "Places in `Mesh.unresolved()`.")
      .with("min_dihedral", &Summary::min_dihedral, "Of the options, in degrees; 0: any.")
      .with("num_surface_triangles", &Summary::num_surface_triangles, "Of the input, repaired.")
      .with("num_surface_vertices", &Summary::num_surface_vertices, "Of the input.")
      .with("num_surface_components", &Summary::num_surface_components, "Of the input.")
      .with("surface_euler_characteristic", &Summary::surface_euler_characteristic,
            "Of the input: vertices - edges + triangles.")
      .with("surface_area", &Summary::surface_area, "Of the input.")
      .with("surface_volume", &Summary::surface_volume, "Of what the input bounds.")
      .end();
  Values<Sheet>(module, "Sheet", "A part of the boundary that has a name; of `Mesh.sheet_list`.")
      .with("id", &Sheet::id, "From 1 on; `Mesh.sheets` has it for each facet.")
      .with("name", &Sheet::name, "That of its group, which ends in _1, _2, ... of several.")
      .with("group", &Sheet::group, "As the surface calls it; empty: it has no name there.")
      .with("num_facets", &Sheet::num_facets, "Of the mesh's boundary.")
      .with("area", &Sheet::area, "Of these facets.")
      .with("num_triangles", &Sheet::num_triangles, "Of the surface.")
      .with("surface_area", &Sheet::surface_area, "Of these triangles.")
      .with("centroid", &Sheet::centroid, "Of these triangles, (x, y, z).")
      .with("box_min", &Sheet::box_min, "Of these triangles, the smallest coordinates.")
      .with("box_max", &Sheet::box_max, "Of these triangles, the largest coordinates.")
      .with("form", &Sheet::form, "'plane', 'cylinder', 'sphere', 'cone', 'torus' or 'other'.")
      .with("direction", &Sheet::direction, "Of a plane its normal, of others their axis.")
      .with("center", &Sheet::center, "Of a cylinder a point of its axis, of a cone its tip.")
      .with("radius", &Sheet::radius, "A length.")
      .with("tube_radius", &Sheet::tube_radius, "Of a torus, a length.")
      .with("half_angle", &Sheet::half_angle, "Of a cone, between axis and surface, in radians.")
      .with("is_hollow", &Sheet::is_hollow, "The surface faces the axis or the center.")
      .with("bodies", &Sheet::bodies,
            "Ids of the bodies on its sides, the larger first; 0: outside.")
      .end();
  Values<Body>(module, "Body", "One of several parts of the domain; of `Mesh.body_list`.")
      .with("id", &Body::id, "From 1 on; `Mesh.bodies` has it for each cell.")
      .with("name", &Body::name, "Of its file or its group; else 'body 2', by its number.")
      .with("around", &Body::around, "Id of the body that it lies in; 0: none, or several.")
      .with("num_triangles", &Body::num_triangles, "Of the surface, all around it.")
      .with("surface_volume", &Body::surface_volume, "That they bound, without what lies in it.")
      .end();
  Values<SurfaceInfo>(module, "SurfaceInfo", "What is known of a surface without a run.")
      .with("num_triangles", &SurfaceInfo::num_triangles, "Repaired.")
      .with("num_vertices", &SurfaceInfo::num_vertices, "Different places of corners.")
      .with("num_components", &SurfaceInfo::num_components, "Connected parts.")
      .with("euler_characteristic", &SurfaceInfo::euler_characteristic,
            "Vertices - edges + triangles.")
      .with("area", &SurfaceInfo::area, "Of all its triangles.")
      .with("volume", &SurfaceInfo::volume, "Of what it bounds.")
      .with("box_min", &SurfaceInfo::box_min, "The smallest coordinates.")
      .with("box_max", &SurfaceInfo::box_max, "The largest coordinates.")
      .with("default_size", &SurfaceInfo::default_size,
            "λ that `mesh` chooses for it, a length; 0 if there is no volume.")
      .with("has_sharp_edges", &SurfaceInfo::has_sharp_edges,
            "It turns by more than the sharp angle, or some edges are given.")
      .with("sheets", &SurfaceInfo::sheets, "A list of Sheet, without what is known of facets.")
      .with("bodies", &SurfaceInfo::bodies, "A list of Body; empty: there is one.")
      .end();
  Values<Estimate>(module, "Estimate",
                   "What a run will take. 9 of 10 runs lie between an estimate over a factor and "
                   "times it: 1.15 for counts, 1.7 for the store, 2.5 for seconds.")
      .with("size", &Estimate::size, "λ, a length.")
      .with("num_cells", &Estimate::num_cells, "Tetrahedra.")
      .with("num_vertices", &Estimate::num_vertices, "Of the mesh.")
      .with("store_bytes", &Estimate::store_bytes, "Of the store at the end.")
      .with("vtu_bytes", &Estimate::vtu_bytes, "Of the mesh as a .vtu file.")
      .with("run_seconds", &Estimate::run_seconds, "Of `mesh`, on cores of 2.6 GHz.")
      .with("write_seconds", &Estimate::write_seconds, "Of `Mesh.write` of a .vtu file.")
      .with("least_memory_bytes", &Estimate::least_memory_bytes,
            "The least `memory` that is expected to do.")
      .with("is_thin", &Estimate::is_thin, "The surface is thinner than λ on average.")
      .with("num_narrow_cells", &Estimate::num_narrow_cells,
            "Cells that are there for the sake of narrow walls and gaps.")
      .with("lost_area", &Estimate::lost_area,
            "The part of the area whose walls are too thin to be resolved.")
      .end();
  Values<Distribution>(module, "Distribution", "How many values lie in each of some ranges.")
      .with("edges", &Distribution::edges, "Ascending, one more than `counts`.")
      .with("counts", &Distribution::counts, "From edges[i] to below edges[i + 1].")
      .end();
  Values<Statistics>(module, "Statistics", "What the cells of a mesh are like.")
      .with("num_cells", &Statistics::num_cells, "Measured.")
      .with("volume", &Statistics::volume, "Of all cells.")
      .with("min_dihedral_degrees", &Statistics::min_dihedral_degrees, "The smallest angle.")
      .with("max_dihedral_degrees", &Statistics::max_dihedral_degrees, "The largest angle.")
      .with("num_poor_cells", &Statistics::num_poor_cells, "Those of `Mesh.poor_cells()`.")
      .with("num_forced_cells", &Statistics::num_forced_cells,
            "Of these, those that have no room for larger angles.")
      .with("max_radius_edge_ratio", &Statistics::max_radius_edge_ratio,
            "Circumradius over shortest edge: at most 2 where no place is unresolved.")
      .with("max_circumradius", &Statistics::max_circumradius, "A length, below λ.")
      .with("max_circumradius_over_size", &Statistics::max_circumradius_over_size,
            "Of a cell, over the size at its circumcenter: below 1.")
      .with("max_ratio_of_neighbors", &Statistics::max_ratio_of_neighbors,
            "Circumradii of two cells that share a facet; 0 where sizes do not vary.")
      .with("dihedral_angles", &Statistics::dihedral_angles, "All angles, in degrees.")
      .with("min_dihedral_angles", &Statistics::min_dihedral_angles,
            "The smallest angle of each cell, in degrees.")
      .with("radius_edge_ratios", &Statistics::radius_edge_ratios, "One a cell.")
      .with("circumradii_over_size", &Statistics::circumradii_over_size, "One a cell.")
      .with("cells_by_size", &Statistics::cells_by_size, "By the size at their circumcenters.")
      .with("bodies", &Statistics::bodies, "Of each of several, by id; empty: there is one.")
      .end();
  Values<UnresolvedPlace>(module, "UnresolvedPlace",
                          "A place where the surface is not smooth enough at the scale λ.")
      .with("condition", &UnresolvedPlace::condition, "1 to 6: which of C1 to C6 is not met.")
      .with("position", &UnresolvedPlace::position, "(x, y, z).")
      .with("radius", &UnresolvedPlace::radius, "Of the ball in question.")
      .end();
  Values<PoorCellPlace>(module, "PoorCellPlace",
                        "A cell with a dihedral angle below `min_dihedral`.")
      .with("min_dihedral_degrees", &PoorCellPlace::min_dihedral_degrees, "Its smallest angle.")
      .with("position", &PoorCellPlace::position, "The center of its circumball.")
      .with("radius", &PoorCellPlace::radius, "Of its circumball.")
      .with("is_forced", &PoorCellPlace::is_forced, "By a thin wall or an acute crease.")
      .end();
}

// Arrays of a chunk are its own memory: it stays as long as one of them.
template <class Held>
class Arrays {
 public:
  Arrays(py::module_& module, const char* name, const char* text) : class_(module, name, text) {}
  template <class Get>
  Arrays& with(const char* name, const Get& get, const char* text) {
    class_.def_property_readonly(
        name,
        [get](const py::object& self) { return array_of(get(*self.cast<Held&>().chunk), self); },
        text);
    return *this;
  }
  template <class Get>
  Arrays& with_number(const char* name, const Get& get, const char* text) {
    class_.def_property_readonly(
        name, [get](const Held& held) { return get(*held.chunk); }, text);
    return *this;
  }

 private:
  py::class_<Held> class_;
};

void add_chunks(py::module_& module) {
  Arrays<HeldChunk>(
      module, "Chunk",
      "Some cells with all their points. Its arrays are read-only and are not copied.")
      .with_number(
          "first_cell", [](const Chunk& c) { return c.first_cell; },
          "The number of cells[0] in the whole mesh.")
      .with_number(
          "first_point", [](const Chunk& c) { return c.first_vertex; },
          "The number of points[0] in the whole mesh.")
      .with_number(
          "num_own", [](const Chunk& c) { return c.num_own; },
          "So many points come first that no chunk before has brought: they have the "
          "numbers from first_point on.")
      .with(
          "points", [](const Chunk& c) { return c.vertices; }, "(n, 3) float64.")
      .with(
          "point_numbers", [](const Chunk& c) { return c.vertex_numbers; },
          "(n,) uint64: the number of each in the whole mesh.")
      .with(
          "cells", [](const Chunk& c) { return c.cells; },
          "(m, 4) uint32: indices into `points`, positively oriented.")
      .with(
          "bodies", [](const Chunk& c) { return c.bodies; },
          "(m,) uint32: ids of the cells' bodies; (0,) if there is one.")
      .with_number(
          "first_node", [](const Chunk& c) { return c.first_node; },
          "Of order 2: the number of nodes[0], after those of all points.")
      .with_number(
          "num_own_nodes", [](const Chunk& c) { return c.num_own_nodes; },
          "Of order 2: as num_own.")
      .with(
          "nodes", [](const Chunk& c) { return c.nodes; },
          "Of order 2: (k, 3) float64, in the middle of edges, those of boundary edges on the "
          "surface.")
      .with(
          "node_numbers", [](const Chunk& c) { return c.node_numbers; }, "Of order 2: (k,) uint64.")
      .with(
          "cell_nodes", [](const Chunk& c) { return c.cell_nodes; },
          "Of order 2: (m, 6) uint32, indices into `nodes`: of edges 01, 12, 02, 03, 13, 23.");
  Arrays<HeldBoundaryChunk>(module, "BoundaryChunk",
                            "Some facets of the boundary, and of what lies between bodies. Its "
                            "arrays are read-only and are not copied.")
      .with_number(
          "first_facet", [](const BoundaryChunk& c) { return c.first_facet; },
          "The number of facets[0] among all.")
      .with(
          "facets", [](const BoundaryChunk& c) { return c.facets; },
          "(n, 3) uint64: points by their numbers in the whole mesh, counterclockwise from "
          "outside; between bodies, from that with the smaller id.")
      .with(
          "corners",
          [](const BoundaryChunk& c) {
            static_assert(sizeof(std::array<Coordinates, 3>) == 9 * sizeof(double));
            return std::span(reinterpret_cast<const std::array<double, 9>*>(c.corners.data()),
                             c.corners.size());
          },
          "(n, 9) float64: where they lie, one after another.")
      .with(
          "cells", [](const BoundaryChunk& c) { return c.cells; },
          "(n,) uint64: the number of each facet's cell; of two, that of the body with the "
          "larger id.")
      .with(
          "sheets", [](const BoundaryChunk& c) { return c.sheets; }, "(n,) uint32: ids of sheets.")
      .with(
          "bodies", [](const BoundaryChunk& c) { return c.bodies; },
          "(n, 2) uint32: ids of the bodies on its sides, the larger first; 0: outside.")
      .with(
          "nodes", [](const BoundaryChunk& c) { return c.nodes; },
          "Of order 2: (n, 3) uint64, of edges 01, 12, 20.");
  py::class_<HeldStream<Chunk>>(module, "ChunkStream")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__", [](HeldStream<Chunk>& stream) { return HeldChunk{stream.next()}; });
  py::class_<HeldStream<BoundaryChunk>>(module, "BoundaryChunkStream")
      .def("__iter__", [](const py::object& self) { return self; })
      .def("__next__",
           [](HeldStream<BoundaryChunk>& stream) { return HeldBoundaryChunk{stream.next()}; });
}

void add_mesh(py::module_& module) {
  py::class_<HeldMesh, std::shared_ptr<HeldMesh>>(module, "Mesh")
      .def_property_readonly("is_complete",
                             [](const HeldMesh& m) { return m.unguarded().is_complete(); })
      .def_property_readonly("summary", [](const HeldMesh& m) { return m.unguarded().summary(); })
      .def_property_readonly("store", [](const HeldMesh& m) { return m.unguarded().store(); })
      .def("num_points",
           [](HeldMesh& m) {
             return m.watched([](const Mesh& mesh, const Watch&) { return mesh.num_vertices(); });
           })
      .def("num_facets", [](HeldMesh& m) { return m.watched(num_facets); })
      .def("unresolved",
           [](HeldMesh& m, std::uint64_t max) {
             return m.with([&](const Mesh& mesh) { return mesh.unresolved(max); });
           })
      .def("poor_cells",
           [](HeldMesh& m, std::uint64_t max) {
             return m.with([&](const Mesh& mesh) { return mesh.poor_cells(max); });
           })
      .def("statistics",
           [](HeldMesh& m) { return m.with([](const Mesh& mesh) { return mesh.statistics(); }); })
      .def("sheets",
           [](HeldMesh& m) { return m.with([](const Mesh& mesh) { return mesh.sheets(); }); })
      .def("bodies",
           [](HeldMesh& m) { return m.with([](const Mesh& mesh) { return mesh.bodies(); }); })
      .def("chunks",
           [](HeldMesh& m, int order, std::uint64_t bytes) {
             return std::make_unique<HeldStream<Chunk>>(
                 m.with([&](const Mesh& mesh) { return mesh.chunks(order, bytes); }));
           })
      .def("boundary_chunks",
           [](HeldMesh& m, int order) {
             return std::make_unique<HeldStream<BoundaryChunk>>(
                 m.with([&](const Mesh& mesh) { return mesh.boundary_chunks(order); }));
           })
      .def("fill",
           [](HeldMesh& m, py::array_t<double> points, py::array_t<std::int64_t> cells,
              std::optional<py::array_t<std::uint32_t>> bodies) {
             const std::uint64_t num_cells = m.unguarded().summary().num_cells;
             const std::uint64_t num_points =
                 m.with([](const Mesh& mesh) { return mesh.num_vertices(); });
             double* const to_points = data_of(points, 3 * num_points);
             std::int64_t* const to_cells = data_of(cells, 4 * num_cells);
             std::uint32_t* const to_bodies = bodies ? data_of(*bodies, num_cells) : nullptr;
             m.watched([&](const Mesh& mesh, const Watch& watch) {
               return fill(mesh, watch, to_points, to_cells, to_bodies);
             });
           })
      .def("fill_boundary",
           [](HeldMesh& m, py::array_t<std::int64_t> facets, py::array_t<std::uint32_t> sheets,
              py::array_t<std::int64_t> cells, std::uint64_t num) {
             std::int64_t* const to_facets = data_of(facets, 3 * num);
             std::uint32_t* const to_sheets = data_of(sheets, num);
             std::int64_t* const to_cells = data_of(cells, num);
             m.watched([&](const Mesh& mesh, const Watch& watch) {
               return fill_boundary(mesh, watch, to_facets, to_sheets, to_cells);
             });
           })
      .def("write",
           [](HeldMesh& m, const std::filesystem::path& file, const std::string& format, int order,
              bool boundary, bool quality, bool faces, bool split_interfaces, int num_threads) {
             const OutputOptions output =
                 output_options(file, format, order, boundary, quality, faces, split_interfaces);
             return m.watched([&](const Mesh& mesh, const Watch& watch) {
               return write(mesh, watch, file, output, num_threads);
             });
           })
      .def("inspect",
           [](HeldMesh& m, bool reads_all) {
             return m.with([&](const Mesh& mesh) { return inspect_json(mesh, reads_all); });
           })
      .def("audit",
           [](HeldMesh& m, std::uint64_t one_in) {
             return m.watched([&](const Mesh& mesh, const Watch& watch) {
               return audit_json(mesh, watch, one_in);
             });
           })
      .def("report", [](HeldMesh& m, const std::filesystem::path& file, std::uint64_t max_cells,
                        int num_threads) {
        return m.with(
            [&](const Mesh& mesh) { return write_report(mesh, file, max_cells, num_threads); });
      });
}

void add_runs(py::module_& module) {
  module.def("mesh", [](const HeldSurface& surface, const py::dict& given,
                        const std::filesystem::path& store, const std::filesystem::path& scratch,
                        bool force, std::uint64_t memory_bytes, int num_threads,
                        const py::object& progress, const py::object& on_note) {
    Options options = options_of(given);
    options.store = store;
    options.scratch = scratch;
    options.is_forced = force;
    return run_watched(progress, on_note, memory_bytes, num_threads, [&](const Control& control) {
      return mesh_surface(surface.surface, options, control);
    });
  });
  module.def("resume", [](const std::filesystem::path& store, std::uint64_t memory_bytes,
                          int num_threads, const py::object& progress, const py::object& on_note) {
    return run_watched(progress, on_note, memory_bytes, num_threads,
                       [&](const Control& control) { return resume_run(store, control); });
  });
  module.def("open",
             [](const std::filesystem::path& store, std::uint64_t memory_bytes, int num_threads) {
               const Control control{.memory_bytes = memory_bytes, .num_threads = num_threads};
               return std::make_shared<HeldMesh>(open_run(store, control));
             });
  module.def("info", survey);
  module.def("estimate", [](const SurfaceInfo& surface, const py::dict& given, int num_threads) {
    return estimate_run(surface, options_of(given), num_threads);
  });
  py::class_<HeldSurface>(module, "Surface")
      .def_static("files",
                  [](std::vector<std::filesystem::path> files) {
                    return HeldSurface{Surface::files(std::move(files))};
                  })
      .def_static("arrays", surface_of_arrays);
}

}  // namespace

PYBIND11_MODULE(_locvol, module) {
  static const py::object* const made =
      new py::object(py::module_::import("locvol._errors").attr("error_of"));  // to the very end
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      const py::object python = (*made)(static_cast<int>(error.code()), std::string(error.what()));
      PyErr_SetObject(py::type::handle_of(python).ptr(), python.ptr());
    }
  });
  add_values(module);
  add_chunks(module);
  add_mesh(module);
  add_runs(module);
  module.def("option_rows", option_rows);
  module.def("size_of", [](const py::object& size) {
    const Size given = size_given(size);
    return py::make_tuple(given.value, given.is_percent);
  });
  module.def("memory_bytes", [](const std::string& text) {
    try {
      return parse_memory(text);
    } catch (const std::invalid_argument& error) {
      throw Error(ErrorCode::kInput, fmt::format("memory '{}': {}", text, error.what()));
    }
  });
  module.def("memory_cap",
             [](std::uint64_t asked) { return as_library([&] { return memory_cap(asked); }); });
  module.def("streaming_threads",
             [](int asked, std::uint64_t cap) { return num_streaming_threads(asked, cap); });
  module.def("share_one_heap", share_one_heap);
  module.attr("version") = version();
}

}  // namespace locvol
