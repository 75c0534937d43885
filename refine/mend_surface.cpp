#include "refine/mend_surface.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "octree/sort_and_unite.h"
#include "refine/leaf_mesh.h"
#include "refine/mend_boundary.h"

namespace locvol {
namespace {

using Cell = LeafMesh::Cell;
using Facet = LeafMesh::Facet;

class SurfaceMending {
 public:
  SurfaceMending(const SurfaceMendInput& input, const Surroundings& around)
      : input_(input),
        mesh_(input.leaf, around, LeafMesh::OwnPoints::kInBox),
        other_body_(around.domain.only_body().value_or(kNoBody)) {
    if (!mesh_.has_cells()) return;
    body_.resize(mesh_.delaunay().cell_bound(), kNoBody);
    for (Cell c = 0; c < body_.size(); ++c)
      if (mesh_.delaunay().is_cell(c) && mesh_.has_own_vertex(c))
        body_[c] = has_gone(c) ? other_side(c) : mesh_.body(c);
  }

  // Where nothing can go from the inside, for two thick parts of it touch there, what lies outside
  // between them comes in: then the outside is that of which the mesh is the boundary.
  MendedSurface run() {
    MendedSurface result;
    for (const bool is_inside : {true, false}) {
      if (!is_inside && other_body_ == kNoBody) break;
      const MendInput input = mend_input(is_inside);
      for (const std::uint32_t place : mend_boundary(input)) {
        const Cell c = cells_[place];
        result.gone.push_back({named(c), corners_by_name(c)});
      }
      std::ranges::sort(result.gone, {}, &MendedSurface::Cell::cell);
      if (!result.gone.empty()) return result;
    }
    result.facets = facets();
    return result;
  }

 private:
  bool is_near(Cell c) const { return !is_far(mesh_.side(c)); }
  bool has_gone(Cell c) const {
    return !input_.gone.empty() && is_near(c) && std::ranges::binary_search(input_.gone, named(c));
  }
  BodyId other_side(Cell c) const { return mesh_.body(c) == kNoBody ? other_body_ : kNoBody; }

  NamedCell named(Cell c) const {
    NamedCell result{{}, mesh_.body(c)};
    for (std::size_t i = 0; i < 4; ++i)
      result.vertices[i] = mesh_.local(mesh_.delaunay().vertices(c)[i]).ref;
    std::ranges::sort(result.vertices);
    return result;
  }
  // In the order of its named vertices.
  std::array<Point, 4> corners_by_name(Cell c) const {
    std::array<std::pair<VertexRef, Point>, 4> corners;
    for (std::size_t i = 0; i < 4; ++i) {
      const LeafMesh::Local& local = mesh_.local(mesh_.delaunay().vertices(c)[i]);
      corners[i] = {local.ref, local.point.position};
    }
    std::ranges::sort(corners, {}, &std::pair<VertexRef, Point>::first);
    return {corners[0].second, corners[1].second, corners[2].second, corners[3].second};
  }

  // The cells at own points in bodies, or those outside of all. Own vertices first, in the order of
  // their ids. What has gone once stays where it is, and so it ends.
  MendInput mend_input(bool is_inside) {
    cells_.clear();
    std::vector<LocalIndex> order;
    for (LocalIndex i = 0; i < mesh_.num_locals(); ++i) order.push_back(i);
    std::ranges::sort(order, {}, [&](LocalIndex i) {
      return std::tuple(!mesh_.is_own(i), mesh_.local(i).ref, i);
    });
    std::vector<std::uint32_t> number(order.size());
    for (std::uint32_t n = 0; n < order.size(); ++n) number[order[n]] = n;
    MendInput input;
    input.num_own = static_cast<std::uint32_t>(mesh_.num_own());
    input.is_on_surface.assign(order.size(), true);
    for (Cell c = 0; c < body_.size(); ++c) {
      if (!mesh_.delaunay().is_cell(c) || !mesh_.has_own_vertex(c)) continue;
      if ((body_[c] != kNoBody) != is_inside) continue;
      cells_.push_back(c);
      input.bodies.push_back(is_inside ? body_[c] : kOnlyBody);
      input.is_kept.push_back(!is_near(c) || has_gone(c));
      auto& cell = input.cells.emplace_back();
      // An infinite vertex is no own one.
      for (std::size_t i = 0; i < 4; ++i) {
        const LocalIndex v = mesh_.delaunay().vertices(c)[i];
        cell[i] = v == kInfiniteVertex ? static_cast<std::uint32_t>(order.size()) : number[v];
      }
    }
    input.is_on_surface.push_back(true);
    return input;
  }

  // Whose smallest vertex is own.
  FacetList facets() const {
    const Delaunay& delaunay = mesh_.delaunay();
    FacetList list;
    std::vector<NamedFacet> found;
    for (Cell c = 0; c < body_.size(); ++c)
      for (int i = 0; i < 4 && body_[c] != kNoBody; ++i) {
        const Facet facet{c, i};
        if (delaunay.is_infinite(facet) || !mesh_.has_own_vertex(facet)) continue;
        const BodyId behind = body_[c], before = body_[delaunay.neighbor(c, i)];
        if (behind <= before) continue;
        const auto& [j, k, l] = kFacetCorners[std::size_t(i)];
        const std::array vertices = {delaunay.vertex(c, j), delaunay.vertex(c, l),
                                     delaunay.vertex(c, k)};
        const LocalIndex smallest =
            std::ranges::min(vertices, {}, [&](LocalIndex v) { return delaunay.point(v); });
        if (!mesh_.is_own(smallest)) continue;
        const LeafMesh::BoundaryFacet of_boundary{vertices, smallest, behind, before};
        NamedFacet& named = found.emplace_back();
        std::ranges::transform(vertices, named.vertices.begin(),
                               [&](LocalIndex v) { return mesh_.local(v).ref; });
        named.labels = mesh_.labels(of_boundary);
        list.vertices.insert(list.vertices.end(), named.vertices.begin(), named.vertices.end());
      }
    sort_and_unite(list.vertices);
    for (const NamedFacet& named : found) {
      MeshFacet& facet = list.facets.emplace_back();
      std::ranges::transform(named.vertices, facet.vertices.begin(), [&](VertexRef ref) {
        return static_cast<std::uint32_t>(std::ranges::lower_bound(list.vertices, ref) -
                                          list.vertices.begin());
      });
      facet.vertices = smallest_first(facet.vertices);
      facet.labels = named.labels;
    }
    std::ranges::sort(list.facets);
    return list;
  }

  const SurfaceMendInput& input_;
  LeafMesh mesh_;
  BodyId other_body_;         // of what comes in; none, where there are several
  std::vector<BodyId> body_;  // of cells with an own vertex, as far as the surface is mended
  std::vector<Cell> cells_;   // of the last mend_input()
};

}  // namespace

MendedSurface mend_surface(SurfaceMendInput input, const StopToken* stop) {
  const LeafDomain domain(std::move(input.leaf.domain), stop);
  const SizeField sizes = input.leaf.sizes.cubes.empty() ? SizeField(input.leaf.criteria.size)
                                                         : SizeField(input.leaf.sizes);
  const Surroundings around{
      .domain = domain, .sizes = sizes, .core = nullptr, .points = nullptr, .stop = stop};
  return SurfaceMending(input, around).run();
}

}  // namespace locvol
