// SurfaceThinner makes a surface of fewer triangles, to be looked at.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "engine/shared/compensated_sum.h"
#include "octree/geometry.h"
#include "octree/table_hash.h"

namespace locvol {

// The input surface, closed and oriented as it is. Vertices that fall into one cube of a grid may
// have been joined: the triangles are then fewer, and still each edge has as many on one side as on
// the other.
struct ViewSurface {
  std::vector<Point> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<SheetId> sheets;  // of the triangles
  double grid = 0;              // side of these cubes; 0: the surface as it is
};

// Joins what falls into one cube of the grid, at the mean of its corners. Memory depends on the
// number of cubes that the surface passes.
class SurfaceThinner {
 public:
  // The corners in one cube.
  struct Vertex {
    std::uint64_t cube = 0;
    std::array<CompensatedSum, 3> sum;
    std::uint64_t count = 0;
  };
  // Counts the triangles with these vertices, less those turned around. Its sheet is the first one
  // that any of them is of.
  struct JoinedTriangle {
    std::array<std::uint32_t, 3> vertices{};
    int num = 0;
    SheetId sheet = 0;
  };
  // What has been added, for a thinner with the same grid.
  struct Part {
    std::vector<Vertex> vertices;
    std::vector<JoinedTriangle> triangles;
  };

  SurfaceThinner(const Point& origin, double grid) : origin_(origin), grid_(grid) {}
  void add(const Triangle& triangle);
  void add(const Part& part);
  std::size_t num_vertices() const { return vertices_.size(); }  // never falls
  std::size_t num_triangles() const { return num_triangles_; }   // that are not cancelled
  double grid() const { return grid_; }
  ViewSurface take();
  Part take_part();  // nothing is left

 private:
  std::uint64_t cube_at(const Point& p) const;
  std::uint32_t vertex_of(std::uint64_t cube);
  void add(JoinedTriangle triangle);

  Point origin_;
  double grid_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;  // of the cubes; asked, never listed
  std::vector<Vertex> vertices_;
  struct Joined {
    int num = 0;
    SheetId sheet = 0;
  };
  // JoinedTriangle by vertices, which ascend.
  std::unordered_map<std::array<std::uint32_t, 3>, Joined, TableHash> triangles_;
  std::size_t num_triangles_ = 0;
};

}  // namespace locvol
