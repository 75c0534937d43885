// One case of the sweep: a surface, and how it is meshed; a function of a seed and a number.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

struct ShapeCase {
  std::uint64_t seed = 0, number = 0;
  double share = 1;  // of the cells that it would have
  std::string_view family;
  Solid solid;
  std::string changes = {};  // what was done to what the family made, in words
  bool has_noise = false;
  bool is_float = false;  // coordinates are float32, and the file is an STL

  double size = 0;  // λ
  std::uint64_t leaf_capacity = 0;
  int num_threads = 1;
  std::string memory = {};              // empty: the default
  bool is_repeated = false;             // with another number of threads, for the same bytes
  std::uint64_t refine_seed = 0;        // --seed
  std::vector<std::string> sizes = {};  // --growth and its like

  std::string file_name() const;
  void write_surface(const std::filesystem::path& directory) const;
  // Of `locvol mesh`: all that decides about the mesh, then how the run is carried out.
  std::vector<std::string> mesh_arguments() const;
  // All features are a few λ thick, so the mesh must have the topology of the surface.
  bool is_resolved() const;
};

// `has_sizes`: the same, with sizes that vary. `share`: with λ for so many times the cells.
// `has_bodies`: another, of several bodies.
ShapeCase make_case(std::uint64_t seed, std::uint64_t number, bool has_sizes = false,
                    double share = 1, bool has_bodies = false);

// How much there is to mesh.
class MeshingWork {
 public:
  MeshingWork(const Shape& shape, Dice& dice);
  // With this λ, to within a factor of two or so.
  double num_cells(double size) const;

 private:
  double volume_, area_;
  std::vector<double> widths_;  // of material or of a gap, at places all over the surface
};

}  // namespace locvol::sweeps
