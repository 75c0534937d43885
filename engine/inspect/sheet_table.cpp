#include "engine/inspect/sheet_table.h"

#include <algorithm>
#include <array>
#include <functional>
#include <iterator>
#include <string>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/formats/sheet_names.h"
#include "engine/ingest/surface_check.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/output/vertex_copies.h"
#include "engine/output/vertex_numbering.h"
#include "engine/output/vertex_positions.h"
#include "engine/shared/compensated_sum.h"
#include "octree/mesh_facet.h"

namespace locvol {
namespace {

// Of a sheet, the mesh's facets.
struct FacetSums {
  std::uint64_t num_facets = 0;
  CompensatedSum area;
  std::uint32_t behind = 1, before = 0;
};
auto fields(Maybe<FacetSums> auto& sums) {
  auto& [num_facets, area, behind, before] = sums;
  return std::tuple(Field("num_facets", num_facets), Field("area", area), Field("behind", behind),
                    Field("before", before));
}

class TableMaker {
 public:
  TableMaker(const Store& store, const StopToken* stop, Exchange& exchange)
      : snapshot_(store.snapshot()),
        run_(finished_run(store, snapshot_)),
        pages_(store),
        stop_(exchange.num_ranks() == 1 ? stop : nullptr),
        exchange_(exchange),
        sheets_(snapshot_.sheets()) {
    if (sheets_.sheets.empty()) {
      SheetFacts whole;
      whole.name = names_of_sheets(sheets_, {}).front();
      whole.num_triangles = run_.surface.num_triangles;
      whole.area = run_.surface.area;
      whole.box = run_.surface.box;
      whole.centroid = whole.box.center();  // until it is measured
      sheets_.sheets.push_back(whole);
      is_whole_ = true;
    }
  }

  SheetTable table(const std::filesystem::path& output) {
    const std::vector<ShapeSums> sums = measured();
    const std::vector<ShapeCheck> checks = checked(sums);
    const std::vector<FacetSums> facets = facets_measured(output);
    SheetTable table{{}, tolerance()};
    for (std::size_t s = 0; s < sums.size(); ++s) {
      SheetRow row{sheets_.sheets[s],    facets[s].behind,       facets[s].before,
                   facets[s].num_facets, facets[s].area.value(), checks[s].shape(table.tolerance)};
      if (is_whole_) row.surface.centroid = sums[s].centroid();
      table.rows.push_back(std::move(row));
    }
    return table;
  }

 private:
  void for_each_own_triangle(const std::function<void(std::size_t, const Triangle&)>& visit) {
    snapshot_.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
      throw_if_stopped(stop_);
      if (info.holding != Holding::kOwn || info.num_triangles == 0) return true;
      const LeafSurface surface = snapshot_.surface(leaf);
      const Box box = run_.frame.box(leaf);
      for (const Triangle& triangle : surface.triangles)
        if (owns_triangle(box, triangle)) visit(place_of(triangle.sheet), triangle);
      pages_.count(surface.bytes());
      return true;
    });
  }

  double tolerance() const {
    const Box& box = run_.surface.box;
    return kShapeTolerance * norm(box.max - box.min);
  }

  std::size_t place_of(SheetId sheet) const {
    if (sheet == 0 || sheet > sheets_.sheets.size())
      throw StoreError("the store is damaged: a triangle or facet is of a sheet that is not known");
    return sheet - 1;
  }

  std::vector<ShapeSums> measured() {
    std::vector<ShapeSums> own, all;
    for (const SheetFacts& sheet : sheets_.sheets) own.emplace_back(sheet.centroid);
    all = own;
    do_on_all(exchange_, [&] {
      for_each_own_triangle(
          [&](std::size_t place, const Triangle& t) { own[place].add(t.corners); });
    });
    std::vector<CompensatedSum> told;
    for (const ShapeSums& sums : own) std::ranges::copy(sums.sums(), std::back_inserter(told));
    for (const std::string& of_rank : exchange_.gather(pack(told))) {
      const auto values = unpack<std::vector<CompensatedSum>>(of_rank);
      for (std::size_t s = 0; s < all.size(); ++s)
        all[s].add(std::span(values).subspan(ShapeSums::kNumSums * s, ShapeSums::kNumSums));
    }
    std::vector<std::vector<Point>> samples;
    for (const ShapeSums& sums : own) samples.push_back(sums.samples());
    for (const std::string& of_rank : exchange_.gather(pack(samples))) {
      const auto theirs = unpack<std::vector<std::vector<Point>>>(of_rank);
      for (std::size_t s = 0; s < all.size(); ++s)
        for (const Point& corner : theirs.at(s)) all[s].add_sample(corner);
    }
    return all;
  }

  std::vector<ShapeCheck> checked(const std::vector<ShapeSums>& sums) {
    std::vector<ShapeCheck> own;
    for (const ShapeSums& of_sheet : sums) own.emplace_back(of_sheet, tolerance());
    std::vector<ShapeCheck> all = own;
    do_on_all(exchange_, [&] {
      for_each_own_triangle(
          [&](std::size_t place, const Triangle& t) { own[place].add(t.corners); });
    });
    std::vector<double> told;
    for (const ShapeCheck& check : own) std::ranges::copy(check.found(), std::back_inserter(told));
    for (const std::string& of_rank : exchange_.gather(pack(told))) {
      const auto values = unpack<std::vector<double>>(of_rank);
      for (std::size_t s = 0; s < all.size(); ++s)
        all[s].add_found(
            std::span(values).subspan(ShapeCheck::kNumFound * s, ShapeCheck::kNumFound));
    }
    return all;
  }

  std::vector<FacetSums> facets_measured(const std::filesystem::path& output) {
    const VertexNumbering numbering(snapshot_, run_, output, pages_, stop_, exchange_);
    NumberWindow numbers(snapshot_, numbering);
    VertexPositions positions(snapshot_, numbering);
    std::vector<FacetSums> own(sheets_.sheets.size());
    do_on_all(exchange_, [&] {
      for (std::size_t leaf = numbering.first_own(); leaf < numbering.end_own(); ++leaf) {
        throw_if_stopped(stop_);
        const auto [listed, number] = numbers.facets(leaf);
        if (listed.facets.empty()) continue;
        const std::vector<Point> at = positions.of(listed.vertices, number);
        for (const auto& [vertices, labels] : listed.facets) {
          const auto& [a, b, c] = vertices;
          FacetSums& sums = own[place_of(labels.sheet)];
          ++sums.num_facets;
          sums.area.add(0.5 * norm(cross(at[b] - at[a], at[c] - at[a])));
          sums.behind = labels.behind;
          sums.before = labels.before;
        }
        pages_.count(sizeof(listed.facets[0]) * listed.facets.size());
      }
    });
    std::vector<FacetSums> all(own.size());
    for (const std::string& of_rank : exchange_.gather(pack(own))) {
      const auto values = unpack<std::vector<FacetSums>>(of_rank);
      for (std::size_t s = 0; s < all.size(); ++s) {
        if (values[s].num_facets == 0) continue;
        all[s].num_facets += values[s].num_facets;
        all[s].area.add(values[s].area);
        all[s].behind = values[s].behind;
        all[s].before = values[s].before;
      }
    }
    return all;
  }

  const Snapshot snapshot_;
  const RunRecord run_;
  PageRelease pages_;
  const StopToken* stop_;
  Exchange& exchange_;
  SurfaceSheets sheets_;
  bool is_whole_ = false;
};

}  // namespace

SheetTable sheet_table(const Store& store, const std::filesystem::path& output,
                       const StopToken* stop, Exchange& exchange) {
  return TableMaker(store, stop, exchange).table(output);
}

SheetTable with_both_sides(SheetTable table, const SurfaceSheets& sheets) {
  const SheetSides sides(sheets);
  const auto& facts = sides.sheets().sheets;
  for (std::size_t s = 0; s < sheets.sheets.size(); ++s) {
    table.rows[s].surface.name = facts[s].name;
    const SheetId other = sides.other_side(static_cast<SheetId>(s + 1));
    if (other == s + 1) continue;
    SheetRow row = table.rows[s];
    row.surface.name = facts[other - 1].name;
    std::swap(row.behind, row.before);
    if (row.shape.form == SheetForm::kPlane)
      row.shape.direction = -1 * row.shape.direction;
    else
      row.shape.is_hollow = !row.shape.is_hollow;
    table.rows.push_back(row);
  }
  return table;
}

}  // namespace locvol
