// Unions of boxes whose faces lie on a grid with any coordinates: what booleans of boxes make, with
// many coplanar faces.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

class Blocks {
 public:
  // The planes of the grid on the three axes, ascending.
  explicit Blocks(std::array<std::vector<double>, 3> planes);

  std::array<std::size_t, 3> size() const { return size_; }  // in cells
  bool is_full(std::size_t i, std::size_t j, std::size_t k) const { return full_[at(i, j, k)]; }
  void set(std::size_t i, std::size_t j, std::size_t k, bool is_full) {
    full_[at(i, j, k)] = is_full;
  }
  // All cells between two corners; the second one's cell is left out.
  void fill(const std::array<std::size_t, 3>& from, const std::array<std::size_t, 3>& to,
            bool is_full = true);

  // Fills cells until no two parts touch along an edge or at a vertex only, and triangulates what
  // bounds them. REQUIRES: some cell is full.
  Solid solid();

 private:
  std::size_t at(std::size_t i, std::size_t j, std::size_t k) const {
    return (k * size_[1] + j) * size_[0] + i;
  }
  bool make_manifold_at(const std::array<std::size_t, 3>& vertex);
  double width(int axis, std::size_t cell) const;
  void add_face(ShapeBuilder& builder, const std::array<std::size_t, 3>& cell, std::size_t axis,
                bool is_upper) const;

  std::array<std::vector<double>, 3> planes_;
  std::array<std::size_t, 3> size_;
  std::vector<bool> full_;
};

}  // namespace locvol::sweeps
