// The library as its users see it, beside the engine under it.
#include "engine/locvol.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "engine/inspect/cell_mesh.h"
#include "tests/cube_off.h"
#include "tests/engine/closed_shapes.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/vtu_arrays.h"

namespace locvol {
namespace {

using testing_shapes::Shape;

struct Arrays {
  explicit Arrays(const Shape& shape) : triangles(shape.triangles) {
    for (const Point& p : shape.vertices) vertices.push_back({p.x, p.y, p.z});
  }
  Surface surface() const { return Surface::arrays(vertices, triangles); }

  std::vector<Coordinates> vertices;
  std::vector<TriangleIndices> triangles;
};

// A torus of many leaves, some of which hold part of the lattice core.
Arrays torus_arrays() { return Arrays(testing_shapes::torus(1, 0.45, 48, 24)); }
Options torus_options(const TempDir& dir) {
  return {.size = Size::length(0.1), .scratch = dir.path(), .leaf_capacity = 300};
}

// A wedge whose two large faces meet at two degrees.
Arrays wedge() {
  const double h = std::tan(std::numbers::pi / 180);
  return Arrays(
      {{{0, 0, 0}, {1, 0, h}, {1, 0, -h}, {0, 1, 0}, {1, 1, h}, {1, 1, -h}},
       {{0, 2, 1}, {3, 4, 5}, {0, 1, 4}, {0, 4, 3}, {0, 3, 5}, {0, 5, 2}, {1, 2, 5}, {1, 5, 4}}});
}

bool is_empty(const TempDir& dir) { return std::filesystem::is_empty(dir.path()); }

// The code of the Error that the action throws.
template <class Action>
ErrorCode code_of(const Action& action, const std::string& expected_in_message) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(expected_in_message), std::string::npos)
        << error.what();
    return error.code();
  }
  ADD_FAILURE() << "nothing was thrown";
  return ErrorCode::kInternal;
}

TEST(Library, MeshesAnArrayOfTrianglesAsTheSameSurfaceInAFile) {
  const TempDir dir;
  const Shape shape = testing_shapes::torus(1, 0.45, 48, 24);
  write_off(shape, dir / "torus.off");
  const Arrays arrays(shape);
  const Options options = torus_options(dir);

  const Mesh from_file = mesh_surface(Surface::file(dir / "torus.off"), options);
  const Mesh from_arrays = mesh_surface(arrays.surface(), options);
  const Mesh from_triangles =
      mesh_surface(Surface::triangles([&](const Surface::Visitor& visit) {
                     for (const auto& [a, b, c] : arrays.triangles)
                       visit({arrays.vertices[a], arrays.vertices[b], arrays.vertices[c]});
                   }),
                   options, {.num_threads = 1});
  const std::uint64_t num_bytes = from_arrays.write(dir / "arrays.vtu");
  EXPECT_EQ(num_bytes, std::filesystem::file_size(dir / "arrays.vtu"));
  from_file.write(dir / "file.vtu");
  from_triangles.write(dir / "triangles.vtu");
  EXPECT_EQ(bytes_of(dir / "arrays.vtu"), bytes_of(dir / "file.vtu"));
  EXPECT_EQ(bytes_of(dir / "arrays.vtu"), bytes_of(dir / "triangles.vtu"));
}

TEST(Library, SaysWhatTheSurfaceAndTheMeshAre) {
  const TempDir dir;
  std::vector<Stage> stages;
  std::uint64_t last_cells = 0;
  const Mesh mesh = mesh_surface(torus_arrays().surface(), torus_options(dir),
                                 {.on_progress = [&](const Status& status) {
                                   if (stages.empty() || stages.back() != status.stage)
                                     stages.push_back(status.stage);
                                   last_cells = status.num_cells;
                                 }});
  EXPECT_TRUE(mesh.is_complete());
  const Summary& summary = mesh.summary();
  EXPECT_EQ(summary.size, 0.1);
  EXPECT_EQ(summary.num_surface_triangles, 2u * 48 * 24);
  EXPECT_EQ(summary.num_surface_vertices, 48u * 24);
  EXPECT_EQ(summary.num_surface_components, 1u);
  EXPECT_EQ(summary.surface_euler_characteristic, 0);
  EXPECT_NEAR(summary.surface_volume, 2 * std::pow(std::numbers::pi * 0.45, 2), 0.1);
  EXPECT_EQ(summary.num_unresolved, 0u);
  EXPECT_TRUE(mesh.unresolved().empty());
  EXPECT_EQ(last_cells, summary.num_cells);
  EXPECT_LE(mesh.num_vertices(), summary.num_points);
  EXPECT_EQ(stages, (std::vector{Stage::kInitialize, Stage::kRefine, Stage::kDone}));
}

// Every chunk by itself, and all of them put together, are the mesh that write() writes.
TEST(Library, MakesCellsSmallerAtShapes) {
  const TempDir dir;
  Options options = torus_options(dir);
  options.size = Size::length(0.2);
  const auto num_cells = [&] {
    return static_cast<double>(mesh_surface(torus_arrays().surface(), options).summary().num_cells);
  };
  const double num_before = num_cells();
  const std::vector shapes{SizedShape::ball(Size::length(0.03), {1.45, 0, 0}, 0.05),
                           SizedShape::box(Size::percent(8), {-1, -0.2, -0.1}, {-0.9, 0.2, 0.1}),
                           SizedShape::segment(Size::length(0.05), {0, 1, 0}, {0, 1, 0.45})};
  for (const SizedShape& shape : shapes) {
    options.shapes = {shape};
    EXPECT_GT(num_cells(), 1.2 * num_before);
  }
  options.shapes = shapes;
  options.shapes[1].size = Size::length(0);
  EXPECT_EQ(code_of([&] { mesh_surface(torus_arrays().surface(), options); }, "shape 2: size 0"),
            ErrorCode::kInput);
}

TEST(Library, MakesCellsSmallerWhereTheSurfaceAsksForIt) {
  const TempDir dir;
  Options options = torus_options(dir);
  options.size = Size::length(0.3);
  const auto num_cells = [&](const std::function<void(Options&)>& change) {
    Options changed = options;
    change(changed);
    return static_cast<double>(mesh_surface(torus_arrays().surface(), changed).summary().num_cells);
  };
  const double num_before = num_cells([](Options&) {});
  const double num_around = num_cells([](Options& o) { o.per_circle = 24; });
  EXPECT_GT(num_around, 2 * num_before);
  EXPECT_LT(num_cells([](Options& o) { o.per_circle = 24, o.min_size = Size::length(0.2); }),
            0.7 * num_around);
  EXPECT_GT(num_cells([](Options& o) { o.deviation = Size::percent(2); }), 2 * num_before);
  EXPECT_GT(num_cells([](Options& o) { o.layers = 4; }), 2 * num_before);
  options.min_size = Size::length(0.1);
  EXPECT_EQ(code_of([&] { mesh_surface(torus_arrays().surface(), options); }, "smallest size"),
            ErrorCode::kInput);
}

TEST(Library, HandsOutTheMeshInChunks) {
  const TempDir dir;
  Options options = torus_options(dir);
  options.size = Size::length(0.06);
  const Mesh mesh = mesh_surface(torus_arrays().surface(), options);
  mesh.write(dir / "torus.vtu");
  const VtuArrays vtu(dir / "torus.vtu");
  const auto positions = vtu.array<Coordinates>("Float64", "Points");
  std::vector<std::array<std::uint64_t, 4>> connectivity;
  for (const auto& [a, b, c, d] : vtu.array<std::array<std::uint32_t, 4>>("Int32", "connectivity"))
    connectivity.push_back({a, b, c, d});

  std::uint64_t num_vertices = 0, num_chunks = 0, num_foreign = 0;
  std::vector<std::array<std::uint64_t, 4>> cells;
  double volume = 0;
  mesh.for_each_chunk([&](const Chunk& chunk) {
    ++num_chunks;
    EXPECT_EQ(chunk.first_vertex, num_vertices);
    EXPECT_EQ(chunk.first_cell, cells.size());
    ASSERT_EQ(chunk.vertices.size(), chunk.vertex_numbers.size());
    ASSERT_LE(chunk.num_own, chunk.vertices.size());
    num_vertices += chunk.num_own;
    num_foreign += chunk.vertices.size() - chunk.num_own;
    std::vector<std::uint64_t> numbers(chunk.vertex_numbers.begin(), chunk.vertex_numbers.end());
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (i < chunk.num_own) {
        EXPECT_EQ(numbers[i], chunk.first_vertex + i);
      }
      EXPECT_EQ(chunk.vertices[i], positions.at(numbers[i]));
    }
    std::ranges::sort(numbers);
    EXPECT_EQ(std::ranges::adjacent_find(numbers), numbers.end()) << "a vertex came twice";
    for (const auto& [a, b, c, d] : chunk.cells) {
      cells.push_back({chunk.vertex_numbers[a], chunk.vertex_numbers[b], chunk.vertex_numbers[c],
                       chunk.vertex_numbers[d]});
      const auto corner = [&](std::uint32_t i) {
        return Point{chunk.vertices[i][0], chunk.vertices[i][1], chunk.vertices[i][2]};
      };
      const double six_volumes =
          dot(cross(corner(b) - corner(a), corner(c) - corner(a)), corner(d) - corner(a));
      EXPECT_GT(six_volumes, 0);
      volume += six_volumes / 6;
    }
  });
  EXPECT_GE(num_chunks, 3u);
  EXPECT_GT(num_foreign, 0u);
  EXPECT_EQ(num_vertices, positions.size());
  EXPECT_EQ(mesh.num_vertices(), positions.size());
  EXPECT_EQ(mesh.summary().num_cells, cells.size());
  EXPECT_NEAR(volume, mesh.summary().surface_volume, 0.02 * volume);
  EXPECT_EQ(cells, connectivity);
}

// A stream gives what a callback is given, in chunks as large as is asked for. Chunks that are held
// stay, whatever is read after them, and a stream may outlive its mesh.
TEST(Library, GivesChunksOneByOne) {
  const TempDir dir;
  Options options = torus_options(dir);
  options.size = Size::length(0.06);
  std::optional<Mesh> mesh(mesh_surface(torus_arrays().surface(), options));
  for (const int order : {1, 2}) {
    std::vector<std::array<std::uint64_t, 4>> visited, given;
    const auto append = [](const Chunk& chunk, auto& cells) {
      for (const auto& [a, b, c, d] : chunk.cells)
        cells.push_back({chunk.vertex_numbers[a], chunk.vertex_numbers[b], chunk.vertex_numbers[c],
                         chunk.vertex_numbers[d]});
    };
    mesh->for_each_chunk([&](const Chunk& chunk) { append(chunk, visited); }, order);
    std::vector<std::shared_ptr<const Chunk>> held;
    Stream<Chunk> chunks = mesh->chunks(order, 1 << 14);
    while (auto chunk = chunks.next()) held.push_back(std::move(chunk));
    EXPECT_EQ(chunks.next(), nullptr);
    for (const auto& chunk : held) append(*chunk, given);
    EXPECT_EQ(given, visited);
    Stream<Chunk> whole = mesh->chunks(1, std::uint64_t{1} << 40);
    EXPECT_EQ(whole.next()->cells.size(), visited.size());
    EXPECT_EQ(whole.next(), nullptr);
    if (order == 1) {
      EXPECT_GT(held.size(), 10U);
    }

    std::uint64_t num_facets = 0, num_given = 0;
    mesh->for_each_boundary_chunk(
        [&](const BoundaryChunk& chunk) { num_facets += chunk.facets.size(); }, order);
    Stream<BoundaryChunk> boundary = mesh->boundary_chunks(order);
    if (order == 2) mesh.reset();
    while (const auto chunk = boundary.next()) {
      EXPECT_EQ(chunk->first_facet, num_given);
      num_given += chunk->facets.size();
    }
    EXPECT_EQ(num_given, num_facets);
  }
  EXPECT_TRUE(is_empty(dir));
}

// What is open cannot be meshed but by winding numbers, which know it to be nearly closed.
TEST(Library, MeshesWhatTrianglesWindAround) {
  const TempDir dir;
  Arrays open = torus_arrays();
  open.triangles.pop_back();
  Options options = torus_options(dir);
  EXPECT_EQ(code_of([&] { mesh_surface(open.surface(), options); }, "is not closed"),
            ErrorCode::kInput);
  options.inside = InsideRule::kWinding;
  const Mesh mesh = mesh_surface(open.surface(), options);
  EXPECT_NEAR(mesh.statistics().volume, 2 * std::pow(std::numbers::pi * 0.45, 2), 0.2);
  const SurfaceInfo info =
      surface_info(open.surface(), {}, dir.path(), {}, 40, {}, false, {}, {}, options.inside);
  EXPECT_NEAR(info.volume, mesh.statistics().volume, 0.1 * info.volume);
}

// Half of a torus is a sheet, around which a wrap goes.
TEST(Library, MeshesWhatWrapsASheet) {
  const TempDir dir;
  Arrays open = torus_arrays();
  open.triangles.resize(open.triangles.size() / 2);
  Options options = torus_options(dir);
  options.wrap_alpha = Size::length(0.1);
  EXPECT_EQ(code_of([&] { mesh_surface(open.surface(), options); }, "give --wrap"),
            ErrorCode::kInput);
  options.inside = InsideRule::kWrap;
  options.wrap_alpha = Size::percent(10);
  EXPECT_EQ(code_of([&] { mesh_surface(open.surface(), options); }, "give a length"),
            ErrorCode::kInput);
  options.wrap_alpha = Size::length(0.1);
  options.wrap_offset = Size::length(0.05);
  options.store = dir / "store";
  std::vector<std::string> notes;
  Control control;
  control.on_note = [&](const std::string& note) { notes.push_back(note); };
  const std::uint64_t num_cells =
      mesh_surface(open.surface(), options, control).summary().num_cells;
  EXPECT_GT(num_cells, 0u);
  ASSERT_FALSE(notes.empty());
  EXPECT_NE(notes.front().find("wrapped"), std::string::npos) << notes.front();
  EXPECT_NE(notes.front().find("alpha 0.1 and offset 0.05"), std::string::npos) << notes.front();
  // It goes on with what the store holds, but for another wrap.
  notes.clear();
  EXPECT_EQ(mesh_surface(open.surface(), options, control).summary().num_cells, num_cells);
  EXPECT_TRUE(notes.empty());
  EXPECT_EQ(resume_run(options.store).summary().num_cells, num_cells);
  options.wrap_offset = Size::length(0.06);
  EXPECT_EQ(code_of([&] { mesh_surface(open.surface(), options); }, "--wrap-offset is 0.05 in it"),
            ErrorCode::kMismatch);
  const SurfaceInfo info = surface_info(open.surface(), {}, dir.path(), {}, 40, {}, false, {}, {},
                                        options.inside, options.wrap_alpha, Size::length(0.05));
  EXPECT_GT(info.volume, 0);
}

TEST(Library, HandsOutCellsOfSecondOrder) {
  const TempDir dir;
  Options options = torus_options(dir);
  options.size = Size::length(0.06);
  const Mesh mesh = mesh_surface(torus_arrays().surface(), options);
  mesh.write(dir / "torus.vtu", {.order = 2});
  const VtuArrays vtu(dir / "torus.vtu");
  const auto positions = vtu.array<Coordinates>("Float64", "Points");
  const auto expected = vtu.array<std::array<std::int32_t, 10>>("Int32", "connectivity");
  std::uint64_t num_nodes = 0, num_foreign = 0, num_cells = 0;
  mesh.for_each_chunk(
      [&](const Chunk& chunk) {
        EXPECT_EQ(chunk.first_cell, num_cells);
        EXPECT_EQ(chunk.first_node, mesh.num_vertices() + num_nodes);
        num_nodes += chunk.num_own_nodes;
        num_foreign += chunk.nodes.size() - chunk.num_own_nodes;
        for (std::size_t i = 0; i < chunk.vertices.size(); ++i)
          EXPECT_EQ(chunk.vertices[i], positions.at(chunk.vertex_numbers[i]));
        for (std::size_t i = 0; i < chunk.nodes.size(); ++i)
          EXPECT_EQ(chunk.nodes[i], positions.at(chunk.node_numbers[i]));
        ASSERT_EQ(chunk.cell_nodes.size(), chunk.cells.size());
        for (std::size_t c = 0; c < chunk.cells.size(); ++c) {
          std::array<std::int32_t, 10> cell{};
          for (std::size_t k = 0; k < 10; ++k)
            cell[k] =
                static_cast<std::int32_t>(k < 4 ? chunk.vertex_numbers[chunk.cells[c][k]]
                                                : chunk.node_numbers[chunk.cell_nodes[c][k - 4]]);
          EXPECT_EQ(cell, expected.at(num_cells++));
        }
      },
      2);
  EXPECT_EQ(num_cells, expected.size());
  EXPECT_EQ(mesh.num_vertices() + num_nodes, positions.size());
  EXPECT_GT(num_foreign, 0U);
  mesh.for_each_boundary_chunk(
      [&](const BoundaryChunk& chunk) {
        ASSERT_EQ(chunk.nodes.size(), chunk.facets.size());
        for (const auto& nodes : chunk.nodes)
          for (const std::uint64_t node : nodes) EXPECT_GE(node, mesh.num_vertices());
      },
      2);
  EXPECT_EQ(code_of([&] { mesh.write(dir / "torus.vtu", {.order = 3}); }, "order 3"),
            ErrorCode::kInput);
  EXPECT_EQ(code_of([&] { mesh.write(dir / "torus.stl", {.order = 2}); }, "no cells of order 2"),
            ErrorCode::kInput);
}

TEST(Library, HandsOutTheBoundaryInChunks) {
  const TempDir dir;
  const Mesh mesh = mesh_surface(torus_arrays().surface(), torus_options(dir));
  std::vector<Coordinates> positions(mesh.num_vertices());
  std::vector<std::array<std::uint64_t, 4>> cells;
  std::map<std::array<std::uint64_t, 3>, int> cells_of_facet;
  mesh.for_each_chunk([&](const Chunk& chunk) {
    for (std::size_t i = 0; i < chunk.vertices.size(); ++i)
      positions[chunk.vertex_numbers[i]] = chunk.vertices[i];
    for (const auto& cell : chunk.cells) {
      auto& numbered = cells.emplace_back();
      for (std::size_t i = 0; i < 4; ++i) numbered[i] = chunk.vertex_numbers[cell[i]];
      for (std::size_t across = 0; across < 4; ++across) {
        std::array<std::uint64_t, 3> facet{};
        for (std::size_t i = 0; i < 3; ++i) facet[i] = numbered[(across + 1 + i) % 4];
        std::ranges::sort(facet);
        ++cells_of_facet[facet];
      }
    }
  });

  std::uint64_t num_facets = 0;
  double six_volumes = 0;
  mesh.for_each_boundary_chunk([&](const BoundaryChunk& chunk) {
    EXPECT_EQ(chunk.first_facet, num_facets);
    ASSERT_EQ(chunk.corners.size(), chunk.facets.size());
    ASSERT_EQ(chunk.cells.size(), chunk.facets.size());
    ASSERT_EQ(chunk.sheets.size(), chunk.facets.size());
    num_facets += chunk.facets.size();
    for (std::size_t f = 0; f < chunk.facets.size(); ++f) {
      std::array<Point, 3> corners;
      for (std::size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(chunk.corners[f][i], positions.at(chunk.facets[f][i]));
        EXPECT_EQ(std::ranges::count(cells.at(chunk.cells[f]), chunk.facets[f][i]), 1);
        corners[i] = {chunk.corners[f][i][0], chunk.corners[f][i][1], chunk.corners[f][i][2]};
      }
      six_volumes += dot(corners[0], cross(corners[1], corners[2]));
      auto facet = chunk.facets[f];
      std::ranges::sort(facet);
      EXPECT_EQ(cells_of_facet[facet], 1);
    }
  });
  const auto in_one_cell =
      std::ranges::count_if(cells_of_facet, [](const auto& facet) { return facet.second == 1; });
  EXPECT_EQ(num_facets, static_cast<std::uint64_t>(in_one_cell));
  EXPECT_NEAR(six_volumes / 6, mesh.summary().surface_volume, 0.06 * six_volumes / 6) << "outward";
}

double total(const Distribution& distribution) {
  EXPECT_EQ(distribution.edges.size(), distribution.counts.size() + 1);
  EXPECT_TRUE(std::ranges::is_sorted(distribution.edges));
  double sum = 0;
  for (const std::uint64_t count : distribution.counts) sum += static_cast<double>(count);
  return sum;
}

TEST(Library, MeasuresTheCells) {
  const TempDir dir;
  const Mesh mesh = mesh_surface(torus_arrays().surface(), torus_options(dir));
  double six_volumes = 0, max_circumradius = 0, max_ratio = 0;
  mesh.for_each_chunk([&](const Chunk& chunk) {
    for (const auto& cell : chunk.cells) {
      std::array<Point, 4> corners;
      for (std::size_t i = 0; i < 4; ++i) {
        const Coordinates& c = chunk.vertices[cell[i]];
        corners[i] = {c[0], c[1], c[2]};
      }
      six_volumes +=
          dot(cross(corners[1] - corners[0], corners[2] - corners[0]), corners[3] - corners[0]);
      const CellQuality quality = quality_of(corners);
      max_circumradius = std::max(max_circumradius, quality.circumradius);
      max_ratio = std::max(max_ratio, quality.radius_edge_ratio);
    }
  });
  const Statistics statistics = mesh.statistics();
  EXPECT_NEAR(statistics.volume, six_volumes / 6, 1e-7 * statistics.volume);
  EXPECT_NEAR(statistics.max_circumradius, max_circumradius, 1e-5 * max_circumradius);
  EXPECT_NEAR(statistics.max_radius_edge_ratio, max_ratio, 1e-4);
  EXPECT_EQ(mesh.summary().min_dihedral, 15);
  EXPECT_LT(statistics.num_poor_cells, 3u);
  double least = 180;
  for (const PoorCellPlace& cell : mesh.poor_cells()) {
    EXPECT_LT(cell.min_dihedral_degrees, 15);
    EXPECT_LT(cell.radius, 0.1);
    least = std::min(least, cell.min_dihedral_degrees);
  }
  EXPECT_EQ(mesh.poor_cells().size(), statistics.num_poor_cells);
  if (statistics.num_poor_cells > 0) {
    EXPECT_EQ(statistics.min_dihedral_degrees, least);
  } else {
    EXPECT_GE(statistics.min_dihedral_degrees, 15);
  }
  EXPECT_LT(statistics.min_dihedral_degrees, 60);
  EXPECT_GT(statistics.max_dihedral_degrees, 90);
  EXPECT_LT(statistics.max_dihedral_degrees, 180);
  const auto num_cells = static_cast<double>(mesh.summary().num_cells);
  EXPECT_EQ(total(statistics.dihedral_angles), 6 * num_cells);
  EXPECT_EQ(total(statistics.min_dihedral_angles), num_cells);
  EXPECT_EQ(total(statistics.radius_edge_ratios), num_cells);
  // The lattice has angles of 90 degrees, but no cell has nothing below.
  EXPECT_GT(statistics.dihedral_angles.counts[45], num_cells / 4);
  EXPECT_EQ(statistics.min_dihedral_angles.counts[45], 0u);
}

TEST(Library, ChoosesASizeAndTellsWhatARunWillTake) {
  const TempDir dir;
  const Arrays arrays = torus_arrays();
  const SurfaceInfo info = surface_info(arrays.surface(), {}, dir.path());
  EXPECT_TRUE(is_empty(dir));
  EXPECT_EQ(info.num_triangles, 2u * 48 * 24);
  EXPECT_EQ(info.num_vertices, 48u * 24);
  EXPECT_EQ(info.num_components, 1u);
  EXPECT_EQ(info.euler_characteristic, 0);
  EXPECT_NEAR(info.box_max[0], 1.45, 0.01);
  EXPECT_NEAR(info.box_min[2], -0.45, 0.01);
  const Estimate usual = estimate_run(info, {.size = Size::length(info.default_size)});
  EXPECT_EQ(usual.size, info.default_size);
  EXPECT_NEAR(usual.num_cells, 5e5, 1e5);

  const Options options = torus_options(dir);
  const Estimate estimate = estimate_run(info, options, 1);
  const Mesh mesh = mesh_surface(arrays.surface(), options);
  EXPECT_EQ(mesh.summary().surface_area, info.area);
  EXPECT_EQ(mesh.summary().surface_volume, info.volume);
  const auto num_cells = static_cast<double>(mesh.summary().num_cells);
  EXPECT_GT(Estimate::kCountFactor * estimate.num_cells, num_cells);
  EXPECT_LT(estimate.num_cells, Estimate::kCountFactor * num_cells);
  EXPECT_NEAR(estimate.num_vertices, static_cast<double>(mesh.num_vertices()),
              0.15 * estimate.num_vertices);
  const auto vtu_bytes = static_cast<double>(mesh.write(dir / "torus.vtu"));
  EXPECT_NEAR(estimate.vtu_bytes, vtu_bytes, 0.15 * vtu_bytes);
  EXPECT_FALSE(estimate.is_thin);
  EXPECT_TRUE(estimate_run(info, {.size = Size::length(1)}).is_thin);
  EXPECT_GT(estimate.run_seconds, estimate_run(info, options, 4).run_seconds);
  EXPECT_GT(estimate.write_seconds, 0);

  // The least cap that is expected to do does, and is the least that is let begin.
  Options again = options;
  again.store = dir / "again";
  EXPECT_EQ(code_of(
                [&] {
                  mesh_surface(arrays.surface(), again,
                               {.memory_bytes = estimate.least_memory_bytes / 2});
                },
                "give 96M or more"),
            ErrorCode::kMemory);
  EXPECT_TRUE(mesh_surface(arrays.surface(), again, {.memory_bytes = estimate.least_memory_bytes})
                  .is_complete());
  EXPECT_EQ(code_of([&] { estimate_run(info, {.size = Size::length(-1)}); }, "size -1"),
            ErrorCode::kInput);
}

TEST(Library, JoinsPointsThatAreNearlyOne) {
  const TempDir dir;
  const Arrays sound = torus_arrays();
  const auto loose = Surface::triangles([&](const Surface::Visitor& visit) {
    double shift = 0;
    for (const TriangleIndices& t : sound.triangles) {
      std::array<Coordinates, 3> corners{sound.vertices[t[0]], sound.vertices[t[1]],
                                         sound.vertices[t[2]]};
      for (Coordinates& corner : corners) corner[1] += shift = 3e-10 - shift;
      visit(corners);
    }
  });
  std::vector<std::string> notes;
  const Control control{.on_note = [&](const std::string& note) { notes.push_back(note); }};
  const SurfaceInfo info = surface_info(loose, control, dir.path());
  EXPECT_EQ(info.num_vertices, sound.vertices.size());
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_NE(notes[0].find("points with others up to 3e-10 away"), std::string::npos) << notes[0];
  EXPECT_EQ(code_of([&] { surface_info(loose, {}, dir.path(), Size::length(0)); }, "not closed"),
            ErrorCode::kInput);
  EXPECT_EQ(code_of([&] { surface_info(loose, {}, dir.path(), Size::length(-1)); }, "weld -1"),
            ErrorCode::kInput);
  Options options = torus_options(dir);
  options.store = dir / "run";
  options.weld = Size::length(1e-9);
  EXPECT_TRUE(mesh_surface(loose, options).is_complete());
  options.weld.reset();
  EXPECT_EQ(code_of([&] { mesh_surface(loose, options); }, "--weld is 1e-09 in it, and auto here"),
            ErrorCode::kMismatch);
}

TEST(Library, RefusesASurfaceBeforeARunAndStopsReadingIt) {
  const TempDir dir;
  Arrays open = torus_arrays();
  open.triangles.pop_back();
  EXPECT_EQ(code_of([&] { surface_info(open.surface()); }, "is not closed"), ErrorCode::kInput);
  // Enough triangles for the question to be asked.
  const Arrays fine(testing_shapes::torus(1, 0.45, 400, 400));
  const Control canceling{.is_canceled = [] { return true; }};
  EXPECT_EQ(code_of([&] { surface_info(fine.surface(), canceling, dir.path()); }, "canceled"),
            ErrorCode::kCanceled);
  EXPECT_TRUE(is_empty(dir));
}

TEST(Library, GoesOnWithACanceledRunToTheSameBytes) {
  const TempDir dir, scratch;
  const Arrays arrays = torus_arrays();
  Options options = torus_options(scratch);
  mesh_surface(arrays.surface(), options).write(dir / "undisturbed.vtu");

  options.store = dir / "run";
  int num_asked = 0;
  const Control canceling{.num_threads = 1, .is_canceled = [&] { return ++num_asked > 40; }};
  const Mesh canceled = mesh_surface(arrays.surface(), options, canceling);
  EXPECT_FALSE(canceled.is_complete());
  EXPECT_EQ(canceled.store(), dir / "run");
  EXPECT_EQ(code_of([&] { canceled.write(dir / "canceled.vtu"); }, "unfinished"),
            ErrorCode::kStore);
  EXPECT_EQ(code_of([&] { canceled.for_each_chunk([](const Chunk&) {}); }, "unfinished"),
            ErrorCode::kStore);
  EXPECT_EQ(code_of([&] { canceled.statistics(); }, "unfinished"), ErrorCode::kStore);
  const Mesh opened = open_run(dir / "run");
  EXPECT_FALSE(opened.is_complete());
  EXPECT_EQ(opened.summary().num_visits, canceled.summary().num_visits);
  EXPECT_EQ(code_of([&] { open_run(dir / "no_run"); }, "no_run"), ErrorCode::kStore);
  const Mesh resumed = resume_run(dir / "run");
  EXPECT_TRUE(resumed.is_complete());
  EXPECT_TRUE(open_run(dir / "run").is_complete());
  resumed.write(dir / "resumed.vtu");
  EXPECT_EQ(bytes_of(dir / "resumed.vtu"), bytes_of(dir / "undisturbed.vtu"));

  // The finished run is not made again, and is kept.
  const Mesh again = mesh_surface(arrays.surface(), options);
  EXPECT_EQ(again.summary().num_visits, resumed.summary().num_visits);
  options.size = Size::length(0.07);
  EXPECT_EQ(code_of([&] { mesh_surface(arrays.surface(), options); }, "size"),
            ErrorCode::kMismatch);
  Arrays moved = arrays;
  for (Coordinates& v : moved.vertices) v[0] += 1;
  options.size = Size::length(0.1);
  EXPECT_EQ(code_of([&] { mesh_surface(moved.surface(), options); }, "its surface is another one"),
            ErrorCode::kMismatch);
  options.is_forced = true;
  EXPECT_TRUE(mesh_surface(moved.surface(), options).is_complete());
}

TEST(Library, RemovesAStoreWithoutAName) {
  const TempDir scratch;
  {
    const Mesh mesh = mesh_surface(torus_arrays().surface(), torus_options(scratch));
    EXPECT_TRUE(std::filesystem::exists(mesh.store()));
    EXPECT_FALSE(is_empty(scratch));
  }
  EXPECT_TRUE(is_empty(scratch));
  Options options = torus_options(scratch);
  options.size = Size::length(100);
  EXPECT_EQ(code_of([&] { mesh_surface(torus_arrays().surface(), options); }, "no cell fits"),
            ErrorCode::kInput);
  EXPECT_TRUE(is_empty(scratch));
}

TEST(Library, RefusesWhatIsNoSurface) {
  const TempDir dir;
  const Options options = torus_options(dir);
  const auto refuses = [&](const Arrays& arrays, const std::string& why) {
    EXPECT_EQ(code_of([&] { mesh_surface(arrays.surface(), options); }, why), ErrorCode::kInput);
  };
  Arrays open = torus_arrays();
  open.triangles.pop_back();
  refuses(open, "surface in memory: is not closed");
  Arrays infinite = torus_arrays();
  infinite.vertices[7][1] = std::numeric_limits<double>::infinity();
  refuses(infinite, "not finite");
  Arrays dangling = torus_arrays();
  dangling.triangles[3][2] = 5000;
  refuses(dangling, "triangle 3 names vertex 5000");
  Arrays empty = torus_arrays();
  empty.triangles.clear();
  refuses(empty, "no vertices and no faces");
  EXPECT_EQ(code_of([&] { mesh_surface(Surface::file(dir / "none.stl"), options); }, "none.stl"),
            ErrorCode::kInput);
  EXPECT_EQ(
      code_of([&] { mesh_surface(torus_arrays().surface(), {.scratch = dir.path()}); }, "size 0"),
      ErrorCode::kInput);
  EXPECT_TRUE(is_empty(dir));
}

TEST(Library, TellsErrorsApart) {
  const TempDir dir;
  const Options options = torus_options(dir);
  EXPECT_EQ(
      code_of([&] { mesh_surface(torus_arrays().surface(), options, {.memory_bytes = 1 << 20}); },
              "give 96M or more"),
      ErrorCode::kMemory);
  Options steep = options;
  for (const double angle : {50.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    steep.min_dihedral = angle;
    EXPECT_EQ(
        code_of([&] { mesh_surface(torus_arrays().surface(), steep); }, "smallest dihedral angle"),
        ErrorCode::kInput);
  }
  EXPECT_EQ(code_of([&] { resume_run(dir / "none"); }, "none"), ErrorCode::kStore);
  const Mesh mesh = mesh_surface(torus_arrays().surface(), options);
  EXPECT_EQ(code_of([&] { mesh.write(dir / "none/a.vtu"); }, "none/a.vtu"), ErrorCode::kSystem);
}

// Such as a program throws from its callbacks.
struct Outcry {};

TEST(Library, LetsThroughWhatACallbackThrows) {
  const TempDir dir;
  const Options options = torus_options(dir);
  const Arrays arrays = torus_arrays();
  const Control progress{.on_progress = [](const Status&) { throw Outcry(); }};
  EXPECT_THROW(mesh_surface(arrays.surface(), options, progress), Outcry);
  const Control cancel{.is_canceled = []() -> bool { throw Outcry(); }};
  EXPECT_THROW(mesh_surface(arrays.surface(), options, cancel), Outcry);
  const auto source = [&](const Surface::Visitor& visit) {
    visit({arrays.vertices[0], arrays.vertices[1], arrays.vertices[2]});
    throw Outcry();
  };
  EXPECT_THROW(mesh_surface(Surface::triangles(source), options), Outcry);
  EXPECT_TRUE(is_empty(dir));
  const Mesh mesh = mesh_surface(arrays.surface(), options);
  EXPECT_THROW(mesh.for_each_chunk([](const Chunk&) { throw Outcry(); }), Outcry);
}

// A refusal passes through the program's own function; it cannot be caught for good there.
TEST(Library, RefusesASourceThatHoldsErrorsBack) {
  const TempDir dir;
  const Arrays arrays = torus_arrays();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto source = [&](const Surface::Visitor& visit) {
    for (const auto& [a, b, c] : arrays.triangles)
      visit({arrays.vertices[a], arrays.vertices[b], arrays.vertices[c]});
    try {
      visit({Coordinates{nan, 0, 0}, {1, 0, 0}, {0, 1, 0}});
    } catch (...) {
    }
  };
  EXPECT_EQ(
      code_of([&] { mesh_surface(Surface::triangles(source), torus_options(dir)); }, "not finite"),
      ErrorCode::kInput);
}

TEST(Library, ListsPlacesWhereThePromiseIsNotKept) {
  const TempDir dir;
  const Mesh mesh = mesh_surface(
      wedge().surface(),
      {.size = Size::length(0.1), .scratch = dir.path(), .spacing_floor = 0.5, .sharp_angle = 0});
  ASSERT_GT(mesh.summary().num_unresolved, 1u);
  const std::vector<UnresolvedPlace> places = mesh.unresolved();
  EXPECT_EQ(places.size(), mesh.summary().num_unresolved);
  EXPECT_EQ(mesh.unresolved(1).size(), 1u);
  for (const UnresolvedPlace& place : places) {
    EXPECT_TRUE(place.condition >= 1 && place.condition <= 6) << place.condition;
    EXPECT_GT(place.radius, 0);
    EXPECT_GT(place.position[0], -0.2);
  }
}

TEST(Library, PolylinesOfAFileAreSharp) {
  const TempDir dir;
  std::ofstream(dir / "cube.off") << kCube;
  std::ofstream(dir / "given.txt") << "5  0 0 0  1 0 0  1 1 0  0 1 0  0 0 0\n";
  const Surface cube = Surface::file(dir / "cube.off");
  Options options{.size = Size::length(0.3), .scratch = dir.path(), .sharp_angle = 0};
  options.sharp_polylines = dir / "given.txt";
  const Mesh mesh = mesh_surface(cube, options);
  EXPECT_EQ(mesh.sheets().size(), 2U);
  const SurfaceInfo info =
      surface_info(cube, {}, dir.path(), {}, options.sharp_angle, options.sharp_polylines);
  EXPECT_EQ(info.sheets.size(), 2U);
  EXPECT_TRUE(info.has_sharp_edges);
  EXPECT_GT(estimate_run(info, options).num_cells, 0);
  options.sharp_polylines = dir / "absent.txt";
  EXPECT_EQ(code_of([&] { mesh_surface(cube, options); }, "absent.txt"), ErrorCode::kInput);
}

// Groups of a surface in memory are sheets of the mesh, and what a store knows the surface by.
// A cube in a cube: files, and groups of arrays, of which one has a size of its own.
TEST(Library, SeveralBodiesShareTheirVertices) {
  const TempDir dir;
  const auto cube_of = [](double half) {
    Shape shape;
    for (int k = 0; k < 8; ++k)
      shape.vertices.push_back({k & 1 ? half : -half, k & 2 ? half : -half, k & 4 ? half : -half});
    shape.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                       {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
    return shape;
  };
  Shape both = cube_of(1);
  std::vector<std::uint32_t> groups(12, 0);
  testing_shapes::write_off(both, dir / "casing.off");
  testing_shapes::write_off(cube_of(0.5), dir / "rotor.off");
  for (const Point& p : cube_of(0.5).vertices) both.vertices.push_back(p);
  for (const auto& [a, b, c] : cube_of(0.5).triangles) {
    both.triangles.push_back({a + 8, b + 8, c + 8});
    groups.push_back(1);
  }
  const Arrays arrays(both);
  const std::vector<std::string> names = {"casing", "rotor"};
  const Surface in_files = Surface::files({dir / "casing.off", dir / "rotor.off"}),
                in_groups = Surface::arrays(arrays.vertices, arrays.triangles, groups, names);
  const auto expect_bodies = [](const std::vector<Body>& bodies) {
    ASSERT_EQ(bodies.size(), 2u);
    EXPECT_EQ(bodies[0].name, "casing");
    EXPECT_EQ(bodies[1].name, "rotor");
    EXPECT_EQ(bodies[0].around, 0u);
    EXPECT_EQ(bodies[1].around, 1u);
    EXPECT_EQ(bodies[1].id, 2u);
    EXPECT_EQ(bodies[1].num_triangles, 12u);
    EXPECT_NEAR(bodies[0].surface_volume, 7, 1e-12);
    EXPECT_NEAR(bodies[1].surface_volume, 1, 1e-12);
  };
  expect_bodies(surface_info(in_files).bodies);
  EXPECT_TRUE(surface_info(in_groups).bodies.empty());
  expect_bodies(
      surface_info(in_groups, {}, {}, {}, Options().sharp_angle, {}, /*has_bodies=*/true).bodies);

  Options options{.size = Size::length(0.4), .scratch = dir.path()};
  options.bodies = {{"rotor", Size::length(0.15), {}}};
  const Mesh mesh = mesh_surface(in_files, options);
  expect_bodies(mesh.bodies());
  for (const Sheet& sheet : mesh.sheets())
    EXPECT_EQ(sheet.bodies, sheet.name.starts_with("rotor") ? (std::array<std::uint32_t, 2>{2, 1})
                                                            : (std::array<std::uint32_t, 2>{1, 0}))
        << sheet.name;
  const Statistics all = mesh.statistics();
  ASSERT_EQ(all.bodies.size(), 2u);
  EXPECT_EQ(all.num_cells, mesh.summary().num_cells);
  EXPECT_EQ(all.bodies[0].num_cells + all.bodies[1].num_cells, all.num_cells);
  EXPECT_NEAR(all.bodies[0].volume, 7, 1e-5);
  EXPECT_NEAR(all.bodies[1].volume, 1, 1e-5);
  EXPECT_LE(all.bodies[1].max_circumradius, 0.15 * (1 + 1e-9));
  EXPECT_GT(all.bodies[0].max_circumradius, 0.2);

  std::array<std::uint64_t, 2> num_cells{}, num_facets{};
  std::vector<std::uint32_t> body_of;
  mesh.for_each_chunk([&](const Chunk& chunk) {
    ASSERT_EQ(chunk.bodies.size(), chunk.cells.size());
    for (const std::uint32_t body : chunk.bodies) ++num_cells.at(body - 1);
    body_of.insert(body_of.end(), chunk.bodies.begin(), chunk.bodies.end());
  });
  EXPECT_EQ(num_cells[1], all.bodies[1].num_cells);
  mesh.for_each_boundary_chunk([&](const BoundaryChunk& chunk) {
    ASSERT_EQ(chunk.bodies.size(), chunk.facets.size());
    for (std::size_t f = 0; f < chunk.facets.size(); ++f) {
      const auto [behind, before] = chunk.bodies[f];
      EXPECT_EQ(body_of.at(chunk.cells[f]), behind);
      EXPECT_EQ(before, behind - 1);
      ++num_facets.at(before);
    }
  });
  EXPECT_GT(num_facets[0], 0u);
  EXPECT_GT(num_facets[1], 0u);

  // For contact each body has its own, and a vertex of theirs is there twice.
  std::set<std::uint64_t> on_interface;
  mesh.for_each_boundary_chunk([&](const BoundaryChunk& chunk) {
    for (std::size_t f = 0; f < chunk.facets.size(); ++f)
      if (chunk.bodies[f][1] != 0)
        on_interface.insert(chunk.facets[f].begin(), chunk.facets[f].end());
  });
  const auto num_in_file = [&](const FileOptions& asked) {
    mesh.write(dir / "parts.vtu", asked);
    return VtuArrays(dir / "parts.vtu").array<Coordinates>("Float64", "Points").size();
  };
  EXPECT_EQ(num_in_file({}), mesh.num_vertices());
  EXPECT_EQ(num_in_file({.splits_interfaces = true}), mesh.num_vertices() + on_interface.size());
  EXPECT_EQ(num_in_file({}), mesh.num_vertices());  // not what the last file had
  EXPECT_EQ(code_of([&] { mesh.write(dir / "parts.inp", {.has_quality = true}); },
                    "abaqus holds no cell data: write vtu, vtu-zlib, vtkhdf"),
            ErrorCode::kInput);

  options.has_bodies = true;
  EXPECT_EQ(mesh_surface(in_groups, options).summary().num_cells, mesh.summary().num_cells);
  options.bodies = {{"stator", Size::length(0.15), {}}};
  EXPECT_EQ(code_of([&] { mesh_surface(in_groups, options); }, "there are casing, rotor"),
            ErrorCode::kInput);
  EXPECT_EQ(code_of([&] { Surface::files({}); }, "of no file"), ErrorCode::kInput);
  EXPECT_EQ(code_of(
                [&] {
                  surface_info(Surface::files({dir / "rotor.off", dir / "rotor.off"}));
                },
                "given twice"),
            ErrorCode::kInput);
}

TEST(Library, GroupsOfASurfaceAreSheetsOfTheMesh) {
  const TempDir dir;
  const std::vector<Coordinates> vertices = {{0, 0, 0}, {3, 0, 0}, {0, 2, 0}, {3, 2, 0},
                                             {0, 0, 1}, {3, 0, 1}, {0, 2, 1}, {3, 2, 1}};
  const std::vector<TriangleIndices> triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6},
                                                  {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3},
                                                  {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  const std::vector<std::uint32_t> groups = {1, 1, 2, 2, 2, 2, 2, 2, 0, 0, 3, 3};
  const std::vector<std::string> names = {"inlet", "below", "wall", "outlet"};
  Options options{.size = Size::length(0.3), .store = dir / "store"};
  options.sheets = {{"inlet", Size::length(0.1), {}}};
  const Mesh mesh = mesh_surface(Surface::arrays(vertices, triangles, groups, names), options, {});
  const std::vector<Sheet> sheets = mesh.sheets();
  std::vector<std::string> found;
  for (const Sheet& sheet : sheets) {
    EXPECT_EQ(sheet.id, found.size() + 1);
    EXPECT_EQ(sheet.form, Sheet::Form::kPlane);
    found.push_back(sheet.name);
  }
  EXPECT_EQ(found,
            (std::vector<std::string>{"below", "wall_1", "wall_2", "wall_3", "inlet", "outlet"}));
  // They are known without a run, but for what is of the mesh.
  const SurfaceInfo info = surface_info(Surface::arrays(vertices, triangles, groups, names));
  ASSERT_EQ(info.sheets.size(), sheets.size());
  for (std::size_t s = 0; s < sheets.size(); ++s) {
    EXPECT_EQ(info.sheets[s].id, sheets[s].id);
    EXPECT_EQ(info.sheets[s].name, sheets[s].name);
    EXPECT_EQ(info.sheets[s].group, sheets[s].group);
    EXPECT_EQ(info.sheets[s].surface_area, sheets[s].surface_area);
    EXPECT_EQ(info.sheets[s].num_facets, 0u);
  }
  EXPECT_EQ(surface_info(Surface::arrays(vertices, triangles, groups, names), {}, {}, {}, 0)
                .sheets.size(),
            4u);
  EXPECT_EQ(sheets[4].direction, (Coordinates{-1, 0, 0}));
  EXPECT_EQ(sheets[4].centroid, (Coordinates{0, 1, 0.5}));
  EXPECT_GT(sheets[4].num_facets, 4 * sheets[5].num_facets);
  std::vector<std::uint64_t> num_facets(sheets.size());
  mesh.for_each_boundary_chunk([&](const BoundaryChunk& chunk) {
    for (const std::uint32_t sheet : chunk.sheets) ++num_facets.at(sheet - 1);
  });
  for (std::size_t s = 0; s < sheets.size(); ++s) EXPECT_EQ(num_facets[s], sheets[s].num_facets);

  const auto code_of = [&](const Surface& surface) {
    try {
      mesh_surface(surface, options, {});
    } catch (const Error& error) {
      return error.code();
    }
    return ErrorCode::kInternal;
  };
  EXPECT_EQ(code_of(Surface::arrays(vertices, triangles)), ErrorCode::kMismatch);
  EXPECT_EQ(
      code_of(Surface::arrays(vertices, triangles, groups, {"inlet", "below", "wall", "other"})),
      ErrorCode::kMismatch);
  EXPECT_THROW(Surface::arrays(vertices, triangles, groups, {"a", "b", "c"}), Error);
  EXPECT_THROW(Surface::arrays(vertices, triangles, std::span(groups).first(3), names), Error);
}

}  // namespace
}  // namespace locvol
