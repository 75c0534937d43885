// CGAL Mesh_3 on a closed triangle surface, or on patches between bodies, with sharp edges and the
// borders of patches protected: what locvol is compared with where surfaces have creases. Prints
// JSON, see README.md beside this file.
//
//   cgal_features SURFACE --lambda L [-o MESH.vtu|.mesh] [--sharp-angle DEG] [--manifold]
//                 [--parallel --threads N]
//   cgal_features PATCH:FRONT:BACK... --lambda L ..., without --manifold
//
// PATCH is the file of a surface, FRONT and BACK are the bodies on the sides that its normals point
// to and away from; 0 is the outside. Patches have no more in common than edges of their borders.
//
// The bounds are those of locvol: edges on creases up to 0.84 L, circumradii and surface balls up
// to L, radius-edge ratios up to 2. Facets between bodies have all vertices on one patch: where
// they need not, some lie across two, and volumes are off by percents. CGAL's optimizers are left
// out.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/output_to_vtu.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Polygon_mesh_processing/IO/polygon_mesh_io.h>
#include <CGAL/Polyhedral_complex_mesh_domain_3.h>
#include <CGAL/Polyhedral_mesh_domain_with_features_3.h>
#include <CGAL/make_mesh_3.h>
#ifdef CGAL_LINKED_WITH_TBB
#include <tbb/global_control.h>
#endif
#include <sys/resource.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <fstream>
#include <iostream>
#include <iterator>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <regex>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Mesh_polyhedron_3<Kernel>::type;
using OneBody = CGAL::Polyhedral_mesh_domain_with_features_3<Kernel>;
using Bodies = CGAL::Polyhedral_complex_mesh_domain_3<Kernel>;
using Json = nlohmann::ordered_json;

constexpr double kCreaseStep = 0.84;  // over λ

template <class Domain>
constexpr CGAL::Mesh_facet_topology kFacetTopology =
    std::is_same_v<Domain, OneBody> ? CGAL::FACET_VERTICES_ON_SURFACE
                                    : CGAL::FACET_VERTICES_ON_SAME_SURFACE_PATCH;

struct Patch {
  std::string file;
  int front = 0, back = 0;  // bodies
};

struct Options {
  std::string surface, output;
  std::vector<Patch> patches;  // instead of the surface
  double lambda = 0, sharp_angle = 40;
  int num_threads = 1;
  bool is_parallel = false, is_manifold = false;
};

void add_surface(const std::string& text, Options& options) {
  static const std::regex form("(.+):([0-9]{1,9}):([0-9]{1,9})");
  std::smatch parts;
  if (std::regex_match(text, parts, form))
    options.patches.push_back({parts[1], std::stoi(parts[2]), std::stoi(parts[3])});
  else if (options.surface.empty())
    options.surface = text;
  else
    throw std::invalid_argument("give one surface, or patches as PATCH:FRONT:BACK");
}

Options parse(int argc, char** argv) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string_view name = argv[i];
    const auto value = [&] {
      if (++i >= argc) throw std::invalid_argument(std::string(name) + " needs a value");
      return argv[i];
    };
    if (name == "--lambda")
      options.lambda = std::atof(value());
    else if (name == "--sharp-angle")
      options.sharp_angle = std::atof(value());
    else if (name == "--threads")
      options.num_threads = std::atoi(value());
    else if (name == "-o")
      options.output = value();
    else if (name == "--parallel")
      options.is_parallel = true;
    else if (name == "--manifold")
      options.is_manifold = true;
    else if (!name.starts_with('-'))
      add_surface(argv[i], options);
    else
      throw std::invalid_argument("unknown argument " + std::string(name));
  }
  if (options.surface.empty() == options.patches.empty())
    throw std::invalid_argument("give a surface, or patches");
  if (options.is_manifold && !options.patches.empty())
    throw std::invalid_argument("--manifold goes with one surface: patches meet in edges");
  if (!(options.lambda > 0)) throw std::invalid_argument("give --lambda, a length above 0");
  if (options.num_threads < 1) throw std::invalid_argument("give --threads of 1 or more");
  return options;
}

// What each step took, of time, and memory at its end.
class Steps {
 public:
  template <class Work>
  void run(const char* name, const Work& work) {
    const double wall = wall_seconds(), cpu = cpu_seconds();
    work();
    wall_[name] = wall_seconds() - wall;
    cpu_[name] = cpu_seconds() - cpu;
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    peak_[name] = static_cast<double>(usage.ru_maxrss) / 1024;
  }
  void put_into(Json& json) const {
    json["wall_s"] = wall_;
    json["cpu_s"] = cpu_;
    json["peak_rss_mb"] = peak_;
  }

 private:
  static double wall_seconds() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
  }
  static double cpu_seconds() {  // of all threads
    timespec time{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  }

  Json wall_ = Json::object(), cpu_ = Json::object(), peak_ = Json::object();
};

Surface read(const std::string& file) {
  Surface surface;
  if (!CGAL::Polygon_mesh_processing::IO::read_polygon_mesh(file, surface) || surface.empty())
    throw std::runtime_error("cannot read " + file);
  if (!surface.is_pure_triangle()) throw std::runtime_error(file + " has more than triangles");
  return surface;
}

std::vector<Surface> read_all(const Options& options) {
  std::vector<Surface> surfaces;
  for (const Patch& patch : options.patches) surfaces.push_back(read(patch.file));
  if (!surfaces.empty()) return surfaces;
  surfaces.push_back(read(options.surface));
  if (!surfaces.front().is_closed()) throw std::runtime_error(options.surface + " is not closed");
  return surfaces;
}

template <class Domain>
std::unique_ptr<Domain> make_domain(const std::vector<Surface>& surfaces, const Options& options) {
  std::unique_ptr<Domain> domain;
  if constexpr (std::is_same_v<Domain, OneBody>) {
    domain = std::make_unique<OneBody>(surfaces.front());
  } else {
    // The body behind comes first: so its code takes them, whatever its manual says.
    std::vector<std::pair<int, int>> sides;
    for (const Patch& patch : options.patches) sides.emplace_back(patch.back, patch.front);
    domain = std::make_unique<Bodies>(surfaces.begin(), surfaces.end(), sides.begin(), sides.end());
  }
  domain->detect_features(options.sharp_angle);
  return domain;
}

template <class Domain>
double sum_of_curves(const Domain& domain) {
  using Corner = std::pair<Kernel::Point_3, typename Domain::Index>;
  std::vector<std::tuple<typename Domain::Curve_index, Corner, Corner>> curves;
  domain.get_curves(std::back_inserter(curves));
  double length = 0;
  for (const auto& [curve, from, to] : curves) length += domain.curve_length(curve);
  return length;
}

// Along the crease, of its pieces that are edges of the mesh: of a cell that is in it, that is.
template <class Complex, class Domain>
double kept_length(const Complex& complex, const Domain& domain) {
  const auto& triangulation = complex.triangulation();
  const auto is_in_mesh = [&](const auto& edge) {
    auto cell = triangulation.incident_cells(edge);
    for (const auto end = cell;;) {
      if (complex.is_in_complex(cell)) return true;
      if (++cell == end) return false;
    }
  };
  double length = 0;
  for (auto edge = complex.edges_in_complex_begin(); edge != complex.edges_in_complex_end();
       ++edge) {
    if (!is_in_mesh(*edge)) continue;
    const auto v = edge->first->vertex(edge->second), w = edge->first->vertex(edge->third);
    const auto curve = complex.curve_index(v, w);
    const auto bare = triangulation.geom_traits().construct_point_3_object();
    const Kernel::Point_3 p = bare(v->point()), q = bare(w->point());
    length += std::abs(domain.signed_geodesic_distance(p, q, curve));
  }
  return length;
}

template <class Complex>
std::map<int, double> volumes_of_bodies(const Complex& complex) {
  const auto& triangulation = complex.triangulation();
  std::map<int, double> volumes;
  for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell)
    volumes[complex.subdomain_index(cell)] += triangulation.tetrahedron(cell).volume();
  return volumes;
}

template <class Complex>
void write(const Complex& complex, const std::string& file) {
  if (file.empty()) return;
  std::ofstream out(file, std::ios::binary);
  out.precision(17);
  if (file.ends_with(".vtu"))
    CGAL::IO::output_to_vtu(out, complex);
  else if (file.ends_with(".mesh"))
    complex.output_to_medit(out);
  else
    throw std::runtime_error(file + ": give a name that ends in .vtu or .mesh");
  if (!out.flush()) throw std::runtime_error("cannot write " + file);
}

template <class Domain, class Tag>
void mesh(const Options& options) {
  using Triangulation = typename CGAL::Mesh_triangulation_3<Domain, CGAL::Default, Tag>::type;
  using Complex =
      CGAL::Mesh_complex_3_in_triangulation_3<Triangulation, typename Domain::Corner_index,
                                              typename Domain::Curve_index>;
  using Criteria = CGAL::Mesh_criteria_3<Triangulation>;
  namespace params = CGAL::parameters;
  std::vector<Surface> surfaces;
  std::unique_ptr<Domain> domain;
  Complex complex;
  Steps steps;
  steps.run("load", [&] { surfaces = read_all(options); });
  steps.run("tree", [&] { domain = make_domain<Domain>(surfaces, options); });
  steps.run("refine", [&] {
    const double size = options.lambda;
    const Criteria criteria(typename Criteria::Edge_criteria(kCreaseStep * size),
                            typename Criteria::Facet_criteria(0, size, 0, kFacetTopology<Domain>),
                            typename Criteria::Cell_criteria(2, size));
    complex = CGAL::make_mesh_3<Complex>(
        *domain, criteria, params::no_perturb(), params::no_exude(),
        options.is_manifold ? params::manifold() : params::non_manifold());
  });
  steps.run("optimize", [] {});
  steps.run("write", [&] { write(complex, options.output); });

  Json json = {{"tool", "CGAL Mesh_3 " CGAL_STR(CGAL_VERSION) " with features"},
               {"lambda", options.lambda},
               {"sharp_angle", options.sharp_angle},
               {"parallel", options.is_parallel},
               {"threads", options.num_threads},
               {"n_tets", complex.number_of_cells_in_complex()},
               {"n_boundary_facets", complex.number_of_facets_in_complex()},
               {"n_corners", complex.number_of_vertices_in_complex()},
               {"n_crease_edges", complex.number_of_edges_in_complex()},
               {"crease_length", sum_of_curves(*domain)},
               {"kept_crease_length", kept_length(complex, *domain)}};
  for (const auto& [body, volume] : volumes_of_bodies(complex))
    json["volumes"][std::to_string(body)] = volume;
  steps.put_into(json);
  std::cout << json.dump(1) << '\n';
}

template <class Tag>
void mesh_bodies(const Options& options) {
  options.patches.empty() ? mesh<OneBody, Tag>(options) : mesh<Bodies, Tag>(options);
}

}  // namespace

int main(int argc, char** argv) try {
  const Options options = parse(argc, argv);
  if (!options.is_parallel) {
    mesh_bodies<CGAL::Sequential_tag>(options);
    return 0;
  }
#ifdef CGAL_LINKED_WITH_TBB
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(options.num_threads));
  mesh_bodies<CGAL::Parallel_tag>(options);
  return 0;
#else
  throw std::runtime_error("built without TBB: there is no --parallel");
#endif
} catch (const std::exception& error) {
  std::cerr << "cgal_features: " << error.what() << '\n';
  return 2;
}
