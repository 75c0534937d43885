// CGAL's surface mesher on the unit sphere, given as a function: what `locvol mesh --surface-only`
// is compared with. Prints JSON, see README.md beside this file.
//
//   cgal_surface --lambda L [-o MESH.off]
//
// The bound is that of locvol: Delaunay balls on the surface up to L. There is none on angles and
// distances, and the result is a manifold.
#include <CGAL/Complex_2_in_triangulation_3.h>
#include <CGAL/IO/Complex_2_in_triangulation_3_file_writer.h>
#include <CGAL/Implicit_surface_3.h>
#include <CGAL/Surface_mesh_default_criteria_3.h>
#include <CGAL/Surface_mesh_default_triangulation_3.h>
#include <CGAL/make_surface_mesh.h>
#include <sys/resource.h>

#include <chrono>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>

namespace {

using Triangulation = CGAL::Surface_mesh_default_triangulation_3;
using Complex = CGAL::Complex_2_in_triangulation_3<Triangulation>;
using Traits = Triangulation::Geom_traits;
using Json = nlohmann::ordered_json;

double distance_to_sphere(const Traits::Point_3& p) {
  return p.x() * p.x() + p.y() * p.y() + p.z() * p.z() - 1;
}

struct Options {
  double lambda = 0;
  std::string output;
};

Options parsed(int argc, char** argv) {
  Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string_view name = argv[i];
    if (name == "--lambda")
      options.lambda = std::stod(argv[i + 1]);
    else if (name == "-o")
      options.output = argv[i + 1];
    else
      throw std::invalid_argument("unknown option " + std::string(name));
  }
  if (!(options.lambda > 0)) throw std::invalid_argument("give --lambda, above 0");
  return options;
}

Json meshed(const Options& options) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  const std::clock_t cpu = std::clock();
  Triangulation triangulation;
  Complex complex(triangulation);
  const CGAL::Implicit_surface_3<Traits, double (*)(const Traits::Point_3&)> surface(
      distance_to_sphere, Traits::Sphere_3(CGAL::ORIGIN, 2), 1e-6);
  const CGAL::Surface_mesh_default_criteria_3<Triangulation> criteria(0, options.lambda, 10);
  CGAL::make_surface_mesh(complex, surface, criteria, CGAL::Manifold_tag());
  const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
  const double cpu_seconds = static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC;
  if (!options.output.empty()) {
    std::ofstream file(options.output);
    CGAL::output_surface_facets_to_off(file, complex);
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return {{"triangles", complex.number_of_facets()},
          {"vertices", triangulation.number_of_vertices()},
          {"seconds", seconds},
          {"cpu_seconds", cpu_seconds},
          {"peak_mib", usage.ru_maxrss / 1024}};
}

}  // namespace

int main(int argc, char** argv) {
  try {
    std::cout << meshed(parsed(argc, argv)).dump() << '\n';
  } catch (const std::exception& error) {
    std::cerr << "cgal_surface: error: " << error.what() << '\n';
    return EXIT_FAILURE;
  }
}
