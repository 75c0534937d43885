#include "tools/page/page_data.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <new>
#include <numeric>
#include <utility>

#include "engine/formats/sheet_names.h"
#include "tools/arguments.h"

namespace locvol {
namespace {

constexpr double kMaxIndex = 65535;

// Vertices in the order in which the triangles name them; others are dropped.
ViewSurface in_order_of_naming(const ViewSurface& surface) {
  constexpr std::uint32_t kNew = ~std::uint32_t{0};
  std::vector<std::uint32_t> place(surface.vertices.size(), kNew);
  ViewSurface ordered;
  ordered.grid = surface.grid;
  ordered.sheets = surface.sheets;
  for (std::array<std::uint32_t, 3> triangle : surface.triangles) {
    for (std::uint32_t& corner : triangle) {
      std::uint32_t& index = place[corner];
      if (index == kNew) {
        index = static_cast<std::uint32_t>(ordered.vertices.size());
        ordered.vertices.push_back(surface.vertices[corner]);
      }
      corner = index;
    }
    ordered.triangles.push_back(triangle);
  }
  return ordered;
}

template <class T>
std::string_view bytes_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

class ViewWriter {
 public:
  ViewWriter(const RunRecord& run, const PutArray& put_array)
      : run_(run), put_array_(put_array), grid_(run.surface.box) {}

  const char* default_color(const MeshView& view) const {
    if (view.cells.empty()) return run_.phase == Phase::kDone ? "leaf" : "state";
    return view.sheets.has_several_bodies() ? "body" : "leaf";
  }

  Json write(MeshView&& view) {
    const Frame& frame = run_.frame;
    Json json;
    json["is_done"] = run_.phase == Phase::kDone;
    json["origin"] = to_json(grid_.origin());
    json["step"] = grid_.step();
    json["extent"] = grid_.extent();
    json["root_side"] = frame.side(0) / grid_.step();
    json["root_min"] = Json::array();
    for (int axis = 0; axis < 3; ++axis)
      json["root_min"].push_back(grid_.steps(frame.origin()[axis], axis));
    const auto extent = grid_.extent();
    json["best_axis"] = std::ranges::min_element(extent) - extent.begin();
    json["default_color"] = default_color(view);
    json["quality"] = {{"angle", kAngleBounds}, {"ratio", kRatioBounds}};
    has_sizes_ = !run_.parameters.sizes().is_uniform() && !view.cells.empty();
    if (has_sizes_) {
      octaves_ = radius_octaves(view.cells);
      json["radius_octaves"] = octaves_;
    }
    json["leaves"] = leaves(view.leaves);
    json["are_leaves_merged"] =
        std::ranges::any_of(view.leaves, [](const ViewLeaf& leaf) { return leaf.num_leaves > 1; });
    json["sites"] = sites(view.sites);
    has_sheets_ = view.sheets.sheets.size() > 1;
    if (has_sheets_) json["sheets"] = sheets(view.sheets);
    if (view.sheets.bodies.size() > 1) {
      json["bodies"] = Json::array();
      for (const BodyFacts& body : view.sheets.bodies) json["bodies"].push_back(body.name);
    }
    if (!view.creases.empty() || !view.corners.empty()) json["creases"] = creases(view);
    json["cells"] = Json::array();
    const bool has_all = view.has_all_cells();
    for (ViewCells& set : view.cells) json["cells"].push_back(cells(std::exchange(set, {})));
    if (!has_all) json["surface"] = surface(in_order_of_naming(std::exchange(view.surface, {})));
    return json;
  }

 private:
  std::string array(std::string_view packed) {
    const std::string id = "array-" + std::to_string(num_arrays_++);
    put_array_(id, base64(deflated(packed)));
    return id;
  }

  static Json leaves(std::span<const ViewLeaf> leaves) {
    Json json = {
        {"key", Json::array()},   {"level", Json::array()},
        {"state", Json::array()}, {"visits", Json::array()},
        {"cells", Json::array()}, {"place", {Json::array(), Json::array(), Json::array()}}};
    for (const ViewLeaf& leaf : leaves) {
      json["key"].push_back(key_text(leaf.key));
      json["level"].push_back(leaf.key.level());
      json["state"].push_back(state_name(leaf.state));
      json["visits"].push_back(leaf.num_visits);
      json["cells"].push_back(leaf.num_cells);
      const GridPoint low = leaf.key.grid_min();
      const std::uint32_t side = leaf.key.grid_side();
      json["place"][0].push_back(low.x / side);
      json["place"][1].push_back(low.y / side);
      json["place"][2].push_back(low.z / side);
    }
    return json;
  }

  static Json sheets(const SurfaceSheets& sheets) {
    Json json = {{"name", Json::array()}, {"area", Json::array()}, {"bodies", Json::array()}};
    for (const SheetFacts& sheet : sheets.sheets) {
      json["name"].push_back(sheet.name);
      json["area"].push_back(sheet.area);
      json["bodies"].push_back(sheet.bodies);
    }
    return json;
  }

  // Edges two vertices after two, and corners after them.
  Json creases(const MeshView& view) {
    std::vector<Point> vertices;
    std::vector<std::uint32_t> ids;
    for (const CreaseEdge& edge : view.creases) {
      vertices.insert(vertices.end(), edge.ends.begin(), edge.ends.end());
      ids.push_back(edge.crease);
    }
    for (const CornerPoint& corner : view.corners) {
      vertices.push_back(corner.position);
      ids.push_back(corner.corner);
    }
    Json json = {{"num_vertices", vertices.size()},
                 {"num_edges", view.creases.size()},
                 {"vertices", array(packed_positions(vertices, grid_))},
                 {"ids", array(bytes_of(ids))},
                 {"name", crease_names(view.sheets)},
                 {"length", Json::array()}};
    for (const CreaseFacts& crease : view.sheets.creases) json["length"].push_back(crease.length);
    return json;
  }

  Json sites(std::span<const ViewSite> sites) const {
    Json json = Json::array();
    for (const auto& [site, leaf] : sites) {
      Json place;
      for (int axis = 0; axis < 3; ++axis)
        place.push_back(std::round(grid_.steps(site.position[axis], axis)));
      json.push_back({{"place", place}, {"condition", site.condition}});
    }
    return json;
  }

  Json cells(const ViewCells& set) {
    Json json = {
        {"axis", set.axis}, {"num_vertices", set.vertices.size()}, {"num_cells", set.cells.size()}};
    if (set.axis >= 0) json["at"] = grid_.steps(set.position, set.axis);
    json["vertices"] = array(packed_positions(set.vertices, grid_));
    json["cells"] = array(packed_references(std::span(set.cells)));
    json["leaves"] = array(bytes_of(set.leaves));
    if (!set.bodies.empty()) json["bodies"] = array(bytes_of(set.bodies));
    json["min_dihedral_degrees"] =
        array(packed_levels(set.min_dihedral_degrees, kAngleBounds[0], kAngleBounds[1]));
    json["radius_edge_ratios"] =
        array(packed_levels(set.radius_edge_ratios, kRatioBounds[0], kRatioBounds[1]));
    if (has_sizes_) json["circumradii"] = array(packed_octaves(set.circumradii));
    if (!set.boundary.empty()) json["boundary"] = array(bytes_of(set.boundary));
    if (has_sheets_ && !set.sheets.empty()) json["sheets"] = array(bytes_of(set.sheets));
    return json;
  }

  // Logarithms to base 2, but for the few of extreme radius: one slim cell would take all colors.
  static std::array<double, 2> radius_octaves(std::span<const ViewCells> sets) {
    std::vector<float> radii;
    for (const ViewCells& set : sets)
      std::ranges::copy_if(set.circumradii, std::back_inserter(radii),
                           [](float radius) { return std::isfinite(radius) && radius > 0; });
    std::array<double, 2> octaves{};
    if (radii.empty()) return octaves;
    const std::size_t few = radii.size() / 1000;
    for (const auto& [end, place] : {std::pair{0, few}, {1, radii.size() - 1 - few}}) {
      const auto at = radii.begin() + static_cast<std::ptrdiff_t>(place);
      std::ranges::nth_element(radii, at);
      octaves[static_cast<std::size_t>(end)] = std::log2(static_cast<double>(*at));
    }
    return octaves;
  }

  std::string packed_octaves(std::span<const float> radii) const {
    std::vector<float> logarithms(radii.size());
    std::ranges::transform(radii, logarithms.begin(), [](float r) { return std::log2(r); });
    return packed_levels(logarithms, octaves_[0], octaves_[1]);
  }

  Json surface(const ViewSurface& surface) {
    Json json = {{"num_vertices", surface.vertices.size()},
                 {"num_triangles", surface.triangles.size()},
                 {"vertices", array(packed_positions(surface.vertices, grid_))},
                 {"triangles", array(packed_references(std::span(surface.triangles)))}};
    if (has_sheets_) json["sheets"] = array(bytes_of(surface.sheets));
    return json;
  }

  const RunRecord& run_;
  const PutArray& put_array_;
  PageGrid grid_;
  bool has_sizes_ = false;           // cells have colors by size
  bool has_sheets_ = false;          // there are several
  std::array<double, 2> octaves_{};  // of their circumradii
  int num_arrays_ = 0;
};

}  // namespace

PageGrid::PageGrid(const Box& box) : origin_(box.min), side_(box.max - box.min) {
  const double longest = std::max({side_.x, side_.y, side_.z});
  step_ = longest > 0 ? longest / kMaxIndex : 1;
}

std::uint16_t PageGrid::index(const Point& p, int axis) const {
  return static_cast<std::uint16_t>(std::clamp(std::round(steps(p[axis], axis)), 0.0, kMaxIndex));
}

std::array<double, 3> PageGrid::extent() const {
  return {side_.x / step_, side_.y / step_, side_.z / step_};
}

std::string packed_positions(std::span<const Point> points, const PageGrid& grid) {
  const std::size_t n = points.size();
  std::string packed(6 * n, '\0');
  for (int axis = 0; axis < 3; ++axis) {
    char* const low = packed.data() + 2 * n * static_cast<std::size_t>(axis);
    std::uint16_t before = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const std::uint16_t index = grid.index(points[i], axis);
      const auto step = static_cast<std::uint16_t>(index - std::exchange(before, index));
      low[i] = static_cast<char>(step & 0xff);
      low[n + i] = static_cast<char>(step >> 8);
    }
  }
  return packed;
}

template <std::size_t N>
std::string packed_references(std::span<const std::array<std::uint32_t, N>> shapes) {
  constexpr std::size_t kPlanes = 4;
  const std::size_t n = shapes.size();
  std::string packed(kPlanes * N * n, '\0');
  std::uint32_t num_known = 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t corner = 0; corner < N; ++corner) {
      const std::uint32_t reference = num_known - shapes[i][corner];
      if (reference == 0) ++num_known;
      for (std::size_t plane = 0; plane < kPlanes; ++plane)
        packed[(kPlanes * corner + plane) * n + i] = static_cast<char>(reference >> (8 * plane));
    }
  return packed;
}
template std::string packed_references(std::span<const std::array<std::uint32_t, 3>>);
template std::string packed_references(std::span<const std::array<std::uint32_t, 4>>);

std::string packed_levels(std::span<const float> values, double low, double high) {
  std::string packed;
  packed.reserve(values.size());
  for (const double value : values) {
    const double level = 255 * (value - low) / (high - low);
    packed += static_cast<char>(level > 0 ? std::lround(std::min(level, 255.0)) : 0);
  }
  return packed;
}

std::string deflated(std::string_view bytes) {
  constexpr int kLevel = 5;
  uLongf size = compressBound(bytes.size());
  std::string result(size, '\0');
  const int code = compress2(reinterpret_cast<Bytef*>(result.data()), &size,
                             reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), kLevel);
  if (code != Z_OK) throw std::bad_alloc();  // all that is left to fail
  result.resize(size);
  return result;
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  const auto byte = [&](std::size_t i) -> std::uint32_t {
    return i < bytes.size() ? static_cast<unsigned char>(bytes[i]) : 0;
  };
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::uint32_t bits = byte(i) << 16 | byte(i + 1) << 8 | byte(i + 2);
    for (int shift = 18; shift >= 0; shift -= 6) text += kDigits[bits >> shift & 63];
  }
  const std::size_t num_missing = (3 - bytes.size() % 3) % 3;
  std::fill(text.end() - static_cast<std::ptrdiff_t>(num_missing), text.end(), '=');
  return text;
}

Json page_view(MeshView&& view, const RunRecord& run, const PutArray& put_array) {
  return ViewWriter(run, put_array).write(std::move(view));
}

}  // namespace locvol
