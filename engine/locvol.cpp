#include "engine/locvol.h"

#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cerrno>
#include <exception>
#include <new>
#include <optional>
#include <system_error>
#include <type_traits>
#include <utility>

#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "engine/ingest/option_files.h"
#include "engine/ingest/surface_survey.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/sheet_table.h"
#include "engine/library_errors.h"
#include "engine/output/boundary_surface.h"
#include "engine/output/mesh_chunks.h"
#include "engine/plan/run_estimate.h"
#include "engine/plan/run_setup.h"
#include "engine/plan/same_run.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/scratch_directory.h"
#include "engine/shared/standard_input.h"
#include "engine/shared/standard_streams.h"
#include "engine/shared/workers.h"
#include "refine/leaf.h"

namespace locvol {

// What a callback of the program has thrown, on its way through the library.
struct Thrown {
  std::exception_ptr exception;
};

struct SurfaceAccess {
  // `directory`: see surface_in_file()
  static SurfaceSource source(const Surface& surface, const std::filesystem::path& directory,
                              Thrown& thrown);
  static const std::filesystem::path& file(const Surface& surface) { return surface.file_; }
  static const std::vector<std::filesystem::path>& more_files(const Surface& surface) {
    return surface.more_files_;
  }
};

void rethrow_as_error() try { throw; } catch (const Error&) {
  throw;
} catch (const InputError& e) {
  throw Error(ErrorCode::kInput, e.what());
} catch (const StoreMismatch& e) {
  throw Error(ErrorCode::kMismatch, e.what());
} catch (const OverBudget& e) {
  throw Error(ErrorCode::kMemory, e.what());
} catch (const std::bad_alloc&) {
  throw Error(ErrorCode::kMemory, "the system gives no more memory");
} catch (const Stopped&) {
  throw Error(ErrorCode::kCanceled, "canceled while the surface was read");
} catch (const StoreError& e) {
  throw Error(ErrorCode::kStore, e.what());
} catch (const std::system_error& e) {
  throw Error(ErrorCode::kSystem, e.what());
} catch (const std::exception& e) {
  throw Error(ErrorCode::kInternal, e.what());
}

namespace {

// Each entry to the library: does the action; what it throws comes out as an Error, or as the
// callback has thrown it.
template <class Action>
auto translated(const Thrown& thrown, const Action& action) -> decltype(action()) try {
  open_standard_streams();
  return action();
} catch (...) {
  if (thrown.exception) std::rethrow_exception(thrown.exception);
  rethrow_as_error();
}

// The callback, which leaves what it throws in `thrown`, too. Empty if it is.
template <class Result, class... Arguments>
std::function<Result(Arguments...)> watched(std::function<Result(Arguments...)> callback,
                                            Thrown& thrown) {
  if (!callback) return nullptr;
  return [callback = std::move(callback), &thrown](Arguments... arguments) -> Result {
    try {
      return callback(std::forward<Arguments>(arguments)...);
    } catch (...) {
      thrown.exception = std::current_exception();
      throw;
    }
  };
}

Coordinates coordinates(const Point& p) { return {p.x, p.y, p.z}; }
Point point(const Coordinates& c) { return {c[0], c[1], c[2]}; }

// The program's source in the engine's terms. The visitor's errors are the engine's, though they
// pass through the program, which cannot hold them back.
TriangleSource triangle_source(const Surface::GroupedSource& source, Thrown& thrown) {
  return [source, &thrown](const TriangleVisitor& visit) {
    std::exception_ptr refused;
    const auto pass = [&](const std::array<Coordinates, 3>& corners, std::string_view group) {
      try {
        visit({point(corners[0]), point(corners[1]), point(corners[2])}, group);
      } catch (...) {
        refused = std::current_exception();
        throw;
      }
    };
    try {
      source(pass);
    } catch (...) {
      if (!refused) {
        thrown.exception = std::current_exception();
        throw;
      }
    }
    if (refused) std::rethrow_exception(refused);
  };
}

std::filesystem::path scratch_directory(const std::filesystem::path& named) {
  return named.empty() ? temporary_directory() : named;
}

Stage public_stage(Phase phase) {
  if (phase == Phase::kDone) return Stage::kDone;
  switch (stage_of(phase)) {
    case RunStage::kIngest:
      return Stage::kIngest;
    case RunStage::kInitialize:
      return Stage::kInitialize;
    default:
      return Stage::kRefine;
  }
}

Status status_of(const Progress& progress) {
  return {.stage = public_stage(progress.phase),
          .num_triangles = progress.num_triangles,
          .num_leaves = progress.num_leaves,
          .num_waiting = progress.num_queued,
          .num_visits = progress.counts.num_visits,
          .num_points = progress.counts.num_points,
          .num_cells = progress.counts.num_cells};
}

RunControl run_control(const Control& control, Thrown& thrown) {
  RunControl run;
  if (control.on_progress)
    run.on_progress = [tell = watched(control.on_progress, thrown)](const Progress& progress) {
      tell(status_of(progress));
    };
  run.is_stopped = watched(control.is_canceled, thrown);
  run.on_note = watched(control.on_note, thrown);
  run.memory_bytes = control.memory_bytes;
  run.num_threads = control.num_threads;
  return run;
}

MeshOptions mesh_options(const Surface& surface, const Options& options,
                         const std::filesystem::path& store) {
  MeshOptions all{options, SurfaceAccess::file(surface), SurfaceAccess::more_files(surface)};
  all.store = store;
  for (std::size_t i = 0; i < all.shapes.size(); ++i)
    if (all.shapes[i].place.empty()) all.shapes[i].place = "shape " + std::to_string(i + 1);
  return all;
}

SurfaceInfo info_of(const SurveyedSurface& survey) {
  const SurfaceFacts& surface = survey.facts;
  SurfaceInfo info{.num_triangles = surface.num_triangles,
                   .num_vertices = surface.num_vertices,
                   .num_components = surface.num_components,
                   .euler_characteristic = surface.euler_characteristic,
                   .area = surface.area,
                   .volume = surface.volume,
                   .box_min = coordinates(surface.box.min),
                   .box_max = coordinates(surface.box.max),
                   .default_size = survey.default_size(),
                   .has_sharp_edges = survey.has_sharp_edges,
                   .num_facing_places = surface.facing.num_places};
  for (const auto& [step, num_walls, num_rods, num_gaps, num_holes] : surface.facing.places)
    info.facing.push_back({step, num_walls, num_rods, num_gaps, num_holes});
  return info;
}

SurfaceFacts facts_of(const SurfaceInfo& surface) {
  FacingFacts facing{.num_places = surface.num_facing_places, .places = {}};
  for (const auto& [step, num_walls, num_rods, num_gaps, num_holes] : surface.facing)
    facing.places.push_back({step, num_walls, num_rods, num_gaps, num_holes});
  return {.file = kInMemory,
          .num_vertices = surface.num_vertices,
          .num_triangles = surface.num_triangles,
          .num_components = surface.num_components,
          .euler_characteristic = surface.euler_characteristic,
          .area = surface.area,
          .volume = surface.volume,
          .box = {point(surface.box_min), point(surface.box_max)},
          .notes = {},
          .facing = std::move(facing)};
}

static_assert(Estimate::kCountFactor == kCellsFactor && Estimate::kBytesFactor == kBytesFactor &&
              Estimate::kSecondsFactor == kSecondsFactor);

Estimate public_estimate(const RunEstimate& estimate, std::uint64_t memory) {
  const auto seconds = [&](RunStage stage) {
    return estimate.seconds[static_cast<std::size_t>(stage)];
  };
  return {.size = estimate.size,
          .num_cells = estimate.num_cells,
          .num_vertices = estimate.num_vertices,
          .store_bytes = estimate.store_bytes,
          .vtu_bytes = estimate.output.file_bytes,
          .run_seconds = seconds(RunStage::kIngest) + seconds(RunStage::kInitialize) +
                         seconds(RunStage::kRefine),
          .write_seconds = seconds(RunStage::kWrite),
          .least_memory_bytes = memory,
          .is_thin = estimate.is_thin,
          .num_narrow_cells = std::max(0.0, estimate.narrow.num_cells),
          .lost_area = estimate.narrow.lost_area};
}

Distribution distribution(const Histogram& histogram) {
  return {histogram.edges, histogram.counts};
}

Distribution by_octave(const std::map<int, std::uint64_t>& num_cells) {
  Distribution result;
  if (num_cells.empty()) return result;
  const int first = num_cells.begin()->first, last = num_cells.rbegin()->first;
  for (int octave = first; octave <= last + 1; ++octave)
    result.edges.push_back(std::ldexp(1.0, octave));
  result.counts.resize(static_cast<std::size_t>(last - first) + 1);
  for (const auto& [octave, num] : num_cells)
    result.counts[static_cast<std::size_t>(octave - first)] = num;
  return result;
}

Statistics statistics_of(const MeshStatistics& mesh, double size) {
  std::vector<Statistics> bodies;
  for (const MeshStatistics& body : mesh.bodies) bodies.push_back(statistics_of(body, size));
  return {.num_cells = mesh.num_cells,
          .volume = mesh.volume,
          .min_dihedral_degrees = mesh.min_dihedral_degrees,
          .max_dihedral_degrees = mesh.max_dihedral_degrees,
          .num_poor_cells = mesh.num_poor_cells,
          .num_forced_cells = mesh.num_forced_cells,
          .max_radius_edge_ratio = mesh.max_radius_edge_ratio,
          .max_circumradius = mesh.max_circumradius * size,
          .max_circumradius_over_size = mesh.max_radius_over_size,
          .max_ratio_of_neighbors = mesh.max_neighbor_ratio,
          .dihedral_angles = distribution(mesh.dihedral_angles),
          .min_dihedral_angles = distribution(mesh.min_dihedral_angles),
          .radius_edge_ratios = distribution(mesh.radius_edge_ratios),
          .circumradii_over_size = distribution(mesh.radii_over_size),
          .cells_by_size = by_octave(mesh.num_cells_by_octave),
          .bodies = std::move(bodies)};
}

Summary summary_of(const RunSummary& run) {
  const SurfaceFacts& surface = run.run.surface;
  return {.size = run.run.parameters.size,
          .num_cells = run.run.parameters.is_surface_only ? 0 : run.run.counts.num_cells,
          .num_points = run.run.counts.num_points,
          .num_leaves = run.num_leaves,
          .num_visits = run.run.counts.num_visits,
          .num_unresolved = run.run.counts.num_unresolved,
          .min_dihedral = run.run.parameters.min_dihedral,
          .num_surface_triangles = surface.num_triangles,
          .num_surface_vertices = surface.num_vertices,
          .num_surface_components = surface.num_components,
          .surface_euler_characteristic = surface.euler_characteristic,
          .surface_area = surface.area,
          .surface_volume = surface.volume};
}

void require_vertices(std::span<const Coordinates> vertices,
                      std::span<const TriangleIndices> triangles) {
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (const std::uint32_t v : triangles[t])
      if (v >= vertices.size())
        throw Error(ErrorCode::kInput,
                    fmt::format("{}: triangle {} names vertex {} (both counted from 0), but there "
                                "are only {}",
                                kInMemory, t, v, vertices.size()));
}

void require_groups(std::span<const std::uint32_t> groups, std::size_t num_triangles,
                    std::size_t num_names) {
  if (groups.size() != num_triangles)
    throw Error(ErrorCode::kInput, fmt::format("{}: {} triangles, and the groups of {}", kInMemory,
                                               num_triangles, groups.size()));
  for (std::size_t t = 0; t < groups.size(); ++t)
    if (groups[t] >= num_names)
      throw Error(ErrorCode::kInput,
                  fmt::format("{}: triangle {} is of group {} (both counted from 0), but there are "
                              "only {} names",
                              kInMemory, t, groups[t], num_names));
}

Sheet::Form public_form(SheetForm form) {
  switch (form) {
    case SheetForm::kPlane:
      return Sheet::Form::kPlane;
    case SheetForm::kCylinder:
      return Sheet::Form::kCylinder;
    case SheetForm::kSphere:
      return Sheet::Form::kSphere;
    case SheetForm::kCone:
      return Sheet::Form::kCone;
    case SheetForm::kTorus:
      return Sheet::Form::kTorus;
    case SheetForm::kOther:
      break;
  }
  return Sheet::Form::kOther;
}

Sheet public_sheet(std::size_t place, const SheetFacts& surface) {
  Sheet sheet;
  sheet.id = static_cast<std::uint32_t>(place + 1);
  sheet.name = surface.name;
  sheet.group = surface.group;
  sheet.num_triangles = surface.num_triangles;
  sheet.surface_area = surface.area;
  sheet.centroid = coordinates(surface.centroid);
  sheet.box_min = coordinates(surface.box.min);
  sheet.box_max = coordinates(surface.box.max);
  sheet.bodies = surface.bodies;
  return sheet;
}

std::vector<Body> public_bodies(const SurfaceSheets& of_surface) {
  std::vector<Body> bodies;
  for (const BodyFacts& facts : of_surface.bodies)
    bodies.push_back({.id = static_cast<std::uint32_t>(bodies.size() + 1),
                      .name = facts.name,
                      .around = facts.around,
                      .num_triangles = facts.num_triangles,
                      .surface_volume = facts.volume});
  return bodies;
}

std::vector<Sheet> public_sheets(const SurfaceSheets& of_surface) {
  std::vector<Sheet> sheets;
  for (const SheetFacts& facts : of_surface.sheets)
    sheets.push_back(public_sheet(sheets.size(), facts));
  return sheets;
}

std::vector<Sheet> public_sheets(const SheetTable& table) {
  std::vector<Sheet> sheets;
  for (const auto& [surface, behind, before, num_facets, facet_area, shape] : table.rows) {
    Sheet& sheet = sheets.emplace_back(public_sheet(sheets.size(), surface));
    sheet.num_facets = num_facets;
    sheet.area = facet_area;
    sheet.form = public_form(shape.form);
    sheet.direction = coordinates(shape.direction);
    sheet.center = coordinates(shape.place);
    sheet.radius = shape.radius;
    sheet.tube_radius = shape.tube_radius;
    sheet.half_angle = shape.half_angle;
    sheet.is_hollow = shape.is_hollow;
  }
  return sheets;
}

// A chunk with what its spans are of.
struct HeldChunk {
  explicit HeldChunk(MeshChunk the_chunk) : held(std::move(the_chunk)) {
    chunk = {.first_cell = held.first_cell,
             .first_vertex = held.first_vertex,
             .num_own = held.num_own,
             .vertices = held.vertices,
             .vertex_numbers = held.numbers,
             .cells = held.cells,
             .bodies = held.bodies,
             .first_node = held.first_node,
             .num_own_nodes = held.num_own_nodes,
             .nodes = held.nodes,
             .node_numbers = held.node_numbers,
             .cell_nodes = held.cell_nodes};
  }
  MeshChunk held;
  Chunk chunk;
};

struct HeldBoundaryChunk {
  explicit HeldBoundaryChunk(BoundarySurface::Facets some) : nodes(std::move(some.nodes)) {
    for (const BoundaryFacet& facet : some.facets) {
      facets.push_back(facet.vertices);
      cells.push_back(facet.cell);
      sheets.push_back(facet.labels.sheet);
      bodies.push_back({facet.labels.behind, facet.labels.before});
    }
    for (const auto& [a, b, c] : some.corners)
      corners.push_back({coordinates(a), coordinates(b), coordinates(c)});
    chunk = {.first_facet = some.first,
             .facets = facets,
             .corners = corners,
             .cells = cells,
             .sheets = sheets,
             .bodies = bodies,
             .nodes = nodes};
  }
  std::vector<std::array<std::uint64_t, 3>> facets;
  std::vector<std::array<Coordinates, 3>> corners;
  std::vector<std::uint64_t> cells;
  std::vector<std::uint32_t> sheets;
  std::vector<std::array<std::uint32_t, 2>> bodies;
  std::vector<std::array<std::uint64_t, 3>> nodes;
  BoundaryChunk chunk;
};

template <class Held>
auto shared_chunk(auto some) {
  const auto held = std::make_shared<const Held>(std::move(some));
  return std::shared_ptr<const decltype(Held::chunk)>(held, &held->chunk);
}

bool is_second(int order) {
  if (order != 1 && order != 2)
    throw InputError("cells of order " + std::to_string(order) + ": give 1 or 2");
  return order == 2;
}

}  // namespace

Surface Surface::file(std::filesystem::path path) {
  Surface surface;
  surface.file_ = path == kFromStandardInput ? "." / path : std::move(path);
  return surface;
}

Surface Surface::files(std::vector<std::filesystem::path> paths) {
  if (paths.empty()) throw Error(ErrorCode::kInput, "a surface of no file: give one or more");
  Surface surface = file(paths.front());
  for (std::size_t i = 1; i < paths.size(); ++i)
    surface.more_files_.push_back(file(std::move(paths[i])).file_);
  return surface;
}

Surface Surface::grouped_triangles(GroupedSource source) {
  Surface surface;
  surface.source_ = std::move(source);
  return surface;
}

Surface Surface::triangles(Source source) {
  return grouped_triangles([source = std::move(source)](const GroupedVisitor& visit) {
    source([&](const std::array<Coordinates, 3>& corners) { visit(corners, {}); });
  });
}

Surface Surface::arrays(std::span<const Coordinates> vertices,
                        std::span<const TriangleIndices> triangles) {
  require_vertices(vertices, triangles);
  return Surface::triangles([vertices, triangles](const Visitor& visit) {
    for (const auto& [a, b, c] : triangles) visit({vertices[a], vertices[b], vertices[c]});
  });
}

Surface Surface::arrays(std::span<const Coordinates> vertices,
                        std::span<const TriangleIndices> triangles,
                        std::span<const std::uint32_t> groups, std::vector<std::string> names) {
  require_vertices(vertices, triangles);
  require_groups(groups, triangles.size(), names.size());
  return grouped_triangles(
      [vertices, triangles, groups, names = std::move(names)](const GroupedVisitor& visit) {
        for (std::size_t t = 0; t < triangles.size(); ++t) {
          const auto& [a, b, c] = triangles[t];
          visit({vertices[a], vertices[b], vertices[c]}, names[groups[t]]);
        }
      });
}

SurfaceSource SurfaceAccess::source(const Surface& surface, const std::filesystem::path& directory,
                                    Thrown& thrown) {
  if (!surface.source_) return surface_at(surface.file_, surface.more_files_, directory);
  return surface_in_memory(triangle_source(surface.source_, thrown));
}

struct Mesh::Impl {
  Impl(std::unique_ptr<ScratchDirectory> the_scratch, std::filesystem::path the_store,
       const RunSummary& run, const Control& control)
      : scratch(std::move(the_scratch)),
        store(std::move(the_store)),
        summary(summary_of(run)),
        is_complete(run.outcome != RunOutcome::kInterrupted),
        num_threads(num_streaming_threads(control.num_threads, memory_cap(control.memory_bytes))) {}

  void require_complete() const {
    if (!is_complete)
      throw Error(ErrorCode::kStore,
                  "the store " + store.string() + " holds an unfinished run: resume it first");
  }
  // Not open between calls: resume_run() may want to write to it.
  Store open() const { return Store::open(store, {.read_only = true}); }

  std::unique_ptr<ScratchDirectory> scratch;  // of a store without a name
  std::filesystem::path store;
  Summary summary;
  bool is_complete;
  int num_threads;
  mutable std::optional<std::uint64_t> num_vertices;  // once they have been counted
};

namespace {

// A finished mesh of first order, numbered, with what it is read from.
struct NumberedMesh {
  NumberedMesh(Store the_store, const std::filesystem::path& directory)
      : store(std::move(the_store)),
        snapshot(store.snapshot()),
        pages(store),
        numbering(snapshot, snapshot.run().value(), directory, pages) {}

  Store store;
  Snapshot snapshot;
  PageRelease pages;
  VertexNumbering numbering;
};

struct ChunksOfFirstOrder : NumberedMesh {
  ChunksOfFirstOrder(Store the_store, const std::filesystem::path& directory, std::size_t bytes)
      : NumberedMesh(std::move(the_store), directory),
        reader(snapshot, numbering, pages, bytes > 0 ? bytes : kChunkBytes) {}
  std::optional<MeshChunk> next() { return reader.next(); }
  std::uint64_t num_vertices() const { return numbering.num_vertices(); }

  ChunkReader reader;
};

struct BoundaryOfFirstOrder : NumberedMesh {
  BoundaryOfFirstOrder(Store the_store, const std::filesystem::path& directory, int num_threads)
      : NumberedMesh(std::move(the_store), directory),
        positions(snapshot, numbering),
        workers(num_threads),
        boundary(snapshot, numbering, positions, directory, pages, workers),
        next(boundary.facets({.has_corners = true})) {}
  std::uint64_t num_vertices() const { return numbering.num_vertices(); }

  VertexPositions positions;
  Workers workers;
  BoundarySurface boundary;
  std::function<std::optional<BoundarySurface::Facets>()> next;
};

struct MeshOfSecondOrder {
  MeshOfSecondOrder(Store the_store, const std::filesystem::path& directory, int num_threads)
      : store(std::move(the_store)),
        mesh(store, directory, num_threads, {}, nullptr, alone(), {.order = 2}) {}
  std::uint64_t num_vertices() const { return mesh.num_vertices(); }

  Store store;
  MeshSource mesh;
};

struct ChunksOfSecondOrder : MeshOfSecondOrder {
  ChunksOfSecondOrder(Store the_store, const std::filesystem::path& directory, int num_threads)
      : MeshOfSecondOrder(std::move(the_store), directory, num_threads),
        next(chunks_of_second_order(mesh)) {}

  std::function<std::optional<MeshChunk>()> next;
};

struct BoundaryOfSecondOrder : MeshOfSecondOrder {
  BoundaryOfSecondOrder(Store the_store, const std::filesystem::path& directory, int num_threads)
      : MeshOfSecondOrder(std::move(the_store), directory, num_threads),
        next(mesh.boundary().facets({.has_corners = true})) {}

  std::function<std::optional<BoundarySurface::Facets>()> next;
};

// Gives what the source does, with errors as the library has them. `mesh`: what must outlive it.
template <class Held>
auto stream_of(std::shared_ptr<const void> mesh, auto source) {
  using Piece = std::shared_ptr<const decltype(Held::chunk)>;
  return [mesh = std::move(mesh), source = std::move(source)]() -> Piece {
    return translated({}, [&]() -> Piece {
      auto some = source->next();
      return some ? shared_chunk<Held>(*std::move(some)) : nullptr;
    });
  };
}

}  // namespace

struct MeshAccess {
  static Mesh of(std::unique_ptr<ScratchDirectory> scratch, std::filesystem::path store,
                 const RunSummary& run, const Control& control) {
    return Mesh(std::make_shared<Mesh::Impl>(std::move(scratch), std::move(store), run, control));
  }
};

Mesh::Mesh(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}
Mesh::Mesh(Mesh&&) noexcept = default;
Mesh& Mesh::operator=(Mesh&&) noexcept = default;
Mesh::~Mesh() = default;

bool Mesh::is_complete() const { return impl_->is_complete; }
const Summary& Mesh::summary() const { return impl_->summary; }
const std::filesystem::path& Mesh::store() const { return impl_->store; }

std::vector<UnresolvedPlace> Mesh::unresolved(std::uint64_t max) const {
  return translated({}, [&] {
    std::vector<UnresolvedPlace> places;
    const Store opened = impl_->open();
    const Snapshot snapshot = opened.snapshot();
    snapshot.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
      if (info.num_unresolved == 0) return true;
      for (const UnresolvedSite& site : snapshot.unresolved(leaf).sites) {
        if (places.size() == max) return false;
        places.push_back({site.condition, coordinates(site.position), site.radius});
      }
      return true;
    });
    return places;
  });
}

std::uint64_t Mesh::num_vertices() const {
  return translated({}, [&] {
    impl_->require_complete();
    if (!impl_->num_vertices)
      impl_->num_vertices = NumberedMesh(impl_->open(), impl_->store).numbering.num_vertices();
    return impl_->num_vertices.value();
  });
}

Statistics Mesh::statistics() const {
  return translated({}, [&] {
    impl_->require_complete();
    return statistics_of(mesh_statistics(impl_->open(), impl_->num_threads), impl_->summary.size);
  });
}

std::vector<PoorCellPlace> Mesh::poor_cells(std::uint64_t max) const {
  return translated({}, [&] {
    impl_->require_complete();
    std::vector<PoorCellPlace> places;
    for (const LeafPoorCell& cell : first_poor_cells(impl_->open(), max, impl_->num_threads))
      places.push_back({cell.degrees, coordinates(cell.position), cell.radius, cell.is_forced});
    return places;
  });
}

Stream<Chunk> Mesh::chunks(int order, std::uint64_t bytes) const {
  return translated({}, [&] {
    impl_->require_complete();
    const auto made = [&](auto source) {
      impl_->num_vertices = source->num_vertices();
      return Stream<Chunk>(stream_of<HeldChunk>(impl_, std::move(source)));
    };
    if (is_second(order))
      return made(
          std::make_shared<ChunksOfSecondOrder>(impl_->open(), impl_->store, impl_->num_threads));
    return made(std::make_shared<ChunksOfFirstOrder>(impl_->open(), impl_->store, bytes));
  });
}

Stream<BoundaryChunk> Mesh::boundary_chunks(int order) const {
  return translated({}, [&] {
    impl_->require_complete();
    const auto made = [&](auto source) {
      impl_->num_vertices = source->num_vertices();
      return Stream<BoundaryChunk>(stream_of<HeldBoundaryChunk>(impl_, std::move(source)));
    };
    if (is_second(order))
      return made(
          std::make_shared<BoundaryOfSecondOrder>(impl_->open(), impl_->store, impl_->num_threads));
    return made(
        std::make_shared<BoundaryOfFirstOrder>(impl_->open(), impl_->store, impl_->num_threads));
  });
}

void Mesh::for_each_chunk(const std::function<void(const Chunk&)>& visit, int order) const {
  Stream<Chunk> all = chunks(order);
  while (const auto chunk = all.next()) visit(*chunk);
}

void Mesh::for_each_boundary_chunk(const std::function<void(const BoundaryChunk&)>& visit,
                                   int order) const {
  Stream<BoundaryChunk> all = boundary_chunks(order);
  while (const auto chunk = all.next()) visit(*chunk);
}

std::vector<Sheet> Mesh::sheets() const {
  return translated({}, [&] {
    impl_->require_complete();
    return public_sheets(sheet_table(impl_->open(), impl_->store));
  });
}

std::vector<Body> Mesh::bodies() const {
  return translated({}, [&] { return public_bodies(impl_->open().snapshot().sheets()); });
}

std::uint64_t Mesh::write(const std::filesystem::path& file, const FileOptions& options) const {
  return translated({}, [&] {
    impl_->require_complete();
    const OutputOptions output = {.format = format_meant_by(file),
                                  .has_quality = options.has_quality,
                                  .has_boundary = options.has_boundary,
                                  .splits_interfaces = options.splits_interfaces,
                                  .order = is_second(options.order) ? 2 : 1};
    return write_mesh(impl_->open(), file, output, impl_->num_threads).bytes;
  });
}

Mesh mesh_surface(const Surface& surface, const Options& options, const Control& control) {
  Thrown thrown;
  return translated(thrown, [&] {
    std::unique_ptr<ScratchDirectory> scratch;
    std::filesystem::path store = options.store;
    if (store.empty()) {
      scratch = std::make_unique<ScratchDirectory>(scratch_directory(options.scratch));
      store = scratch->path() / "store";
    }
    const RunSummary run =
        mesh(SurfaceAccess::source(surface, store, thrown), mesh_options(surface, options, store),
             run_control(control, thrown));
    return MeshAccess::of(std::move(scratch), std::move(store), run, control);
  });
}

Mesh resume_run(const std::filesystem::path& store, const Control& control) {
  Thrown thrown;
  return translated(thrown, [&] {
    const RunSummary run = resume(store, run_control(control, thrown));
    return MeshAccess::of(nullptr, store, run, control);
  });
}

Mesh open_run(const std::filesystem::path& store, const Control& control) {
  return translated({}, [&] {
    const Store opened = Store::open(store, {.read_only = true});
    require_whole_run(opened);
    RunSummary run = summarize(opened.snapshot());
    return MeshAccess::of(nullptr, store, run, control);
  });
}

SurfaceInfo surface_info(const Surface& surface, const Control& control,
                         const std::filesystem::path& scratch, const std::optional<Size>& weld,
                         double sharp_angle, const std::filesystem::path& sharp_polylines,
                         bool has_bodies, const std::vector<std::string>& voids, const Size& gap,
                         InsideRule inside, const Size& wrap_alpha, const Size& wrap_offset) {
  Thrown thrown;
  return translated(thrown, [&] {
    const RunControl run = run_control(control, thrown);
    const StopSource stop(run.is_stopped);
    IngestWatch watch(&stop, [&](std::uint64_t num_triangles) {
      if (run.on_progress)
        run.on_progress({.phase = Phase::kIngest, .num_triangles = num_triangles});
    });
    Workers workers(num_streaming_threads(run.num_threads, memory_cap(run.memory_bytes)));
    const std::filesystem::path directory = scratch_directory(scratch);
    const SurveyedSurface survey = survey_surface(
        SurfaceAccess::source(surface, directory, thrown), directory, watch, workers,
        {.weld = weld,
         .sharp_angle = sharp_angle,
         .sharp_polylines = sharp_polylines,
         .has_sheets = true,
         .bodies = body_law(has_bodies, voids, SurfaceAccess::more_files(surface).size()),
         .gap = gap,
         .inside = inside,
         .wrap_alpha = wrap_alpha,
         .wrap_offset = wrap_offset,
         .memory_cap = memory_cap(run.memory_bytes)});
    if (run.on_note)
      for (const std::string& note : survey.facts.notes) run.on_note(note);
    SurfaceInfo info = info_of(survey);
    info.sheets = public_sheets(survey.sheets);
    info.bodies = public_bodies(survey.sheets);
    return info;
  });
}

Estimate estimate_run(const SurfaceInfo& surface, const Options& options, int num_threads) {
  return translated({}, [&] {
    const SurfaceFacts facts = facts_of(surface);
    const MeshOptions asked = mesh_options({}, options, {});
    RunRecord run = planned_run(asked, {}, facts, survey_files(asked, facts.box));
    run.has_creases =
        (surface.has_sharp_edges && options.sharp_angle > 0) || !options.sharp_polylines.empty();
    if (num_threads <= 0) num_threads = num_usable_threads();
    return public_estimate(estimate_run(run, {}, num_threads), least_memory(run));
  });
}

// One heap costs no time that shows. Visits ask for few and large blocks, one visit as many as
// another: so the heap keeps what it has had, which the plan of memory counts as held anyway. Else
// the kernel takes the pages back after each, and clears others for the next: a fifth of the time
// of two ranks was measured. The largest blocks have pages of their own: between records of the
// cache they would leave gaps, of 50 MiB under a cap of 256.
void share_one_heap() {
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, 2 << 20);
  mallopt(M_TRIM_THRESHOLD, 128 << 20);
  mallopt(M_TOP_PAD, 1 << 20);
}

const char* version() { return LOCVOL_VERSION; }

}  // namespace locvol
