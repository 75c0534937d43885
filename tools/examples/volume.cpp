// Meshes a surface, adds up its cells, one chunk at a time, and lists its sheets; Ctrl-C stops it.
// Usage: volume SURFACE [PERCENT [STORE]]   of a file (STL, OBJ, OFF, PLY), λ = PERCENT of its box,
//                                           or the size that locvol chooses
//        volume                             of an octahedron made here
#include <locvol/locvol.h>

#include <array>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

namespace {

volatile std::sig_atomic_t is_interrupted = 0;

using locvol::Coordinates;

// Six times the volume of a cell; locvol's are positive.
double six_volumes(const std::array<Coordinates, 4>& corners) {
  const auto from_first = [&](int i) {
    return Coordinates{corners[i][0] - corners[0][0], corners[i][1] - corners[0][1],
                       corners[i][2] - corners[0][2]};
  };
  const Coordinates a = from_first(1), b = from_first(2), c = from_first(3);
  return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0]);
}

int run(const locvol::Surface& surface, locvol::Options options) {
  const locvol::SurfaceInfo info = locvol::surface_info(surface);
  if (options.size.value == 0) options.size = locvol::Size::length(info.default_size);
  const locvol::Estimate estimate = locvol::estimate_run(info, options);
  std::fprintf(stderr, "about %.0f cells, in %.1f s\n", estimate.num_cells, estimate.run_seconds);

  const locvol::Control control{
      .on_progress =
          [](const locvol::Status& status) {
            std::fprintf(stderr, "%llu cells, %llu leaves wait\n",
                         static_cast<unsigned long long>(status.num_cells),
                         static_cast<unsigned long long>(status.num_waiting));
          },
      .is_canceled = [] { return is_interrupted != 0; },
  };
  const locvol::Mesh mesh = locvol::mesh_surface(surface, options, control);
  if (!mesh.is_complete()) {
    std::fprintf(stderr, "canceled\n");
    return 1;
  }
  double sum = 0;
  mesh.for_each_chunk([&](const locvol::Chunk& chunk) {
    for (const auto& [a, b, c, d] : chunk.cells)
      sum +=
          six_volumes({chunk.vertices[a], chunk.vertices[b], chunk.vertices[c], chunk.vertices[d]});
  });
  std::printf("%llu cells, volume %g; the surface's %g\n",
              static_cast<unsigned long long>(mesh.summary().num_cells), sum / 6, info.volume);
  const locvol::Statistics statistics = mesh.statistics();
  std::printf("dihedral angles from %.1f to %.1f degrees, radius-edge ratios up to %.2f\n",
              statistics.min_dihedral_degrees, statistics.max_dihedral_degrees,
              statistics.max_radius_edge_ratio);
  for (const locvol::Sheet& sheet : mesh.sheets())
    std::printf("sheet %s: area %g, %llu facets\n", sheet.name.c_str(), sheet.area,
                static_cast<unsigned long long>(sheet.num_facets));
  return 0;
}

}  // namespace

int main(int argc, char** argv) try {
  std::signal(SIGINT, [](int) { is_interrupted = 1; });
  if (argc > 1)
    return run(locvol::Surface::file(argv[1]),
               {.size = locvol::Size::percent(argc > 2 ? std::atof(argv[2]) : 0),
                .store = argc > 3 ? argv[3] : ""});
  const std::vector<Coordinates> vertices = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                             {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
  const std::vector<locvol::TriangleIndices> triangles = {
      {0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  const std::vector<std::uint32_t> groups = {0, 0, 0, 0, 1, 1, 1, 1};
  return run(locvol::Surface::arrays(vertices, triangles, groups, {"upper", "lower"}),
             {.size = locvol::Size::length(0.1)});
} catch (const locvol::Error& error) {
  std::fprintf(stderr, "volume: %s\n", error.what());
  return 1;
}
