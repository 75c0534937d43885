#include "engine/surface_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "engine/sha256.h"
#include "engine/surface_orientation.h"
#include "engine/surface_reader.h"
#include "engine/surface_repair.h"
#include "engine/surface_topology.h"
#include "engine/triangle_soup.h"
#include "refine/self_intersection.h"

namespace locvol {
namespace {

// Outside these, products of six lengths overflow or underflow.
constexpr double kMinDiagonal = 1e-50, kMaxDiagonal = 1e50;
// The least number of steps between representable coordinates along the diagonal.
constexpr double kMinResolution = 1 << 20;

std::string text(const Point& p) { return fmt::format("({}, {}, {})", p.x, p.y, p.z); }

std::string counted(std::uint64_t count, std::string_view one, std::string_view many) {
  return fmt::format("{} {}", count, count == 1 ? one : many);
}

// Takes a surface as read through repairs and checks, in an order in which each may rely on those
// before it.
class SurfacePreparation {
 public:
  SurfacePreparation(const std::filesystem::path& file, SurfaceFormat format, TriangleSoup soup)
      : file_(file.string()), format_(format), soup_(std::move(soup)) {}

  InputSurface run() {
    drop_what_is_unused();
    check_extent();
    pair_edges_once();
    orient_consistently();
    repair_collinear_triangles();
    check_fans();
    check_self_intersection();
    orient_outward();
    return result();
  }

 private:
  void drop_what_is_unused() {
    const bool is_stl = format_ == SurfaceFormat::kBinaryStl || format_ == SurfaceFormat::kAsciiStl;
    if (soup_.num_merged_points > 0 && !is_stl)  // STL has no other way to say what is connected
      note("merged {} with one at the same place", soup_.num_merged_points, "point", "points");
    if (soup_.triangles.empty()) {
      if (soup_.vertices.empty()) refuse("is empty: it has no vertices and no faces");
      refuse("has {} but no faces; reconstruct a surface from its points first",
             counted(soup_.vertices.size(), "vertex", "vertices"));
    }
    note("dropped {} with two equal corners", drop_collapsed_triangles(soup_), "triangle",
         "triangles");
    if (soup_.triangles.empty())
      refuse("has only faces whose corners coincide; it bounds no volume");
    note("dropped {} without a face", drop_unused_vertices(soup_), "vertex", "vertices");
  }

  void check_extent() {
    box_ = Box::around(soup_.vertices[0]);
    for (const Point& p : soup_.vertices) box_ = box_.joined(p);
    const Point size = box_.max - box_.min;
    const double diagonal = std::hypot(size.x, size.y, size.z);
    if (!(diagonal >= kMinDiagonal && diagonal <= kMaxDiagonal))
      refuse(
          "its bounding box, {} to {}, has a diagonal of {}, outside {} to {}; choose another unit",
          text(box_.min), text(box_.max), diagonal, kMinDiagonal, kMaxDiagonal);
    double largest = 0;
    for (int axis = 0; axis < 3; ++axis)
      largest = std::max({largest, std::abs(box_.min[axis]), std::abs(box_.max[axis])});
    const double step = std::nextafter(largest, std::numeric_limits<double>::infinity()) - largest;
    if (step * kMinResolution > diagonal)
      refuse(
          "lies so far from the origin ({} to {}) that its coordinates cannot tell its points "
          "apart; move it to the origin",
          text(box_.min), text(box_.max));
  }

  void pair_edges_once() {
    pairing_ = pair_edges(soup_.vertices.size(), soup_.triangles);
    if (pairing_.num_overused_edges > 0) {
      const std::uint64_t num_dropped = drop_repeated_triangles(soup_);
      note("dropped {} that repeated another", num_dropped, "triangle", "triangles");
      if (num_dropped > 0) pairing_ = pair_edges(soup_.vertices.size(), soup_.triangles);
    }
    if (pairing_.num_border_edges > 0)
      refuse("is not closed: {}, for example that from {}; close the holes",
             counted(pairing_.num_border_edges, "edge belongs to one triangle only",
                     "edges belong to one triangle only"),
             text_of_edge(pairing_.first_border));
    if (pairing_.num_overused_edges > 0)
      refuse(
          "is not manifold: {}, for example that from {}; separate the parts that touch there, or "
          "remove inner and doubled faces",
          counted(pairing_.num_overused_edges, "edge belongs to more than two triangles",
                  "edges belong to more than two triangles"),
          text_of_edge(pairing_.first_overused));
  }

  void orient_consistently() {
    components_ = find_components(soup_.triangles, pairing_);
    if (components_.conflict != kNoHalfEdge)
      refuse("is not orientable, as a Klein bottle is, at the edge from {}; it has no inside",
             text_of_edge(components_.conflict));
    turn_triangles(components_.is_turned, soup_.triangles, pairing_);
  }

  void repair_collinear_triangles() {
    const auto collinear = find_collinear_triangles(soup_);
    if (collinear.empty()) return;
    const FlipResult flips = flip_collinear_triangles(soup_, pairing_, collinear);
    if (flips.remaining)
      refuse(
          "{} has no area, its corners lie on a line, and there is no unambiguous repair; remove "
          "degenerate faces",
          text_of_triangle(*flips.remaining));
    note("flipped an edge of {} without area", collinear.size(), "triangle", "triangles");
  }

  void check_fans() {
    const PinchedVertices pinched =
        find_pinched_vertices(soup_.vertices.size(), soup_.triangles, pairing_);
    if (pinched.count > 0)
      refuse("is not manifold: {}, for example {}; separate the parts that touch there",
             counted(pinched.count, "vertex joins two parts that share no edge there",
                     "vertices join parts that share no edge there"),
             text(soup_.vertices[pinched.first]));
  }

  void check_self_intersection() {
    const auto pair = find_self_intersection(soup_.vertices, soup_.triangles);
    if (pair)
      refuse(
          "intersects itself: {} meets {}; repair the surface there, or unite the overlapping "
          "parts",
          text_of_triangle(pair->first), text_of_triangle(pair->second));
  }

  // Outer shells face outward, cavities inward.
  void orient_outward() {
    const auto volumes = component_volumes(soup_.vertices, soup_.triangles, components_);
    const auto is_cavity = find_cavities(soup_.vertices, soup_.triangles, components_);
    std::vector<bool> is_wrong(components_.count);
    for (std::uint32_t c = 0; c < components_.count; ++c) {
      if (!volumes[c].is_certain)
        refuse("bounds no volume, to within rounding errors{}",
               components_.count == 1 ? "" : fmt::format(", in its component {}", c));
      is_wrong[c] = (volumes[c].value < 0) != is_cavity[c];
      volume_ += is_cavity[c] ? -std::abs(volumes[c].value) : std::abs(volumes[c].value);
    }
    std::vector<bool> is_turned(soup_.triangles.size());
    std::uint64_t num_turned = 0;
    for (std::size_t t = 0; t < is_turned.size(); ++t) {
      is_turned[t] = is_wrong[components_.of_triangle[t]];
      if (is_turned[t] != components_.is_turned[t]) ++num_turned;
    }
    turn_triangles(is_turned, soup_.triangles, pairing_);
    note("turned {} over, so that all face away from the material", num_turned, "triangle",
         "triangles");
  }

  InputSurface result() {
    InputSurface surface;
    SurfaceFacts& facts = surface.facts;
    facts.file = file_;
    facts.num_vertices = soup_.vertices.size();
    facts.num_triangles = soup_.triangles.size();
    facts.num_components = components_.count;
    facts.euler_characteristic = static_cast<std::int64_t>(facts.num_vertices) -
                                 static_cast<std::int64_t>(facts.num_triangles / 2);
    facts.volume = volume_;
    facts.box = box_;
    facts.notes = std::move(notes_);
    surface.vertices = std::move(soup_.vertices);
    surface.triangles = std::move(soup_.triangles);
    for (const auto& [a, b, c] : surface.triangles)
      facts.area += 0.5 * norm(cross(surface.vertices[b] - surface.vertices[a],
                                     surface.vertices[c] - surface.vertices[a]));
    surface.digest = digest_of(surface);
    return surface;
  }

  // SHA-256 of the corners' coordinates as little-endian doubles, triangle by triangle.
  static std::string digest_of(const InputSurface& surface) {
    Sha256 hash;
    std::array<unsigned char, 72> bytes;
    for (const auto& corners : surface.triangles) {
      std::size_t i = 0;
      for (const std::uint32_t v : corners) {
        for (int axis = 0; axis < 3; ++axis) {
          const auto bits = std::bit_cast<std::uint64_t>(surface.vertices[v][axis]);
          for (int shift = 0; shift < 64; shift += 8)
            bytes[i++] = static_cast<unsigned char>(bits >> shift);
        }
      }
      hash.update(bytes.data(), bytes.size());
    }
    return hash.hex_digest();
  }

  std::string text_of_edge(std::uint32_t h) const {
    return fmt::format("{} to {} of triangle {}", text(soup_.vertices[origin(soup_.triangles, h)]),
                       text(soup_.vertices[target(soup_.triangles, h)]), h / 3);
  }

  std::string text_of_triangle(std::uint32_t t) const {
    const auto& [a, b, c] = soup_.triangles[t];
    return fmt::format("triangle {} with the corners {}, {}, {}", t, text(soup_.vertices[a]),
                       text(soup_.vertices[b]), text(soup_.vertices[c]));
  }

  void note(std::string_view pattern, std::uint64_t count, std::string_view one,
            std::string_view many) {
    if (count > 0) notes_.push_back(fmt::format(fmt::runtime(pattern), counted(count, one, many)));
  }

  template <typename... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> pattern, Args&&... args) const {
    throw InputError(
        fmt::format("{}: {}", file_, fmt::format(pattern, std::forward<Args>(args)...)));
  }

  std::string file_;
  SurfaceFormat format_;
  TriangleSoup soup_;
  Box box_;
  EdgePairing pairing_;
  Components components_;
  double volume_ = 0;
  std::vector<std::string> notes_;
};

}  // namespace

InputSurface read_surface(const std::filesystem::path& file) {
  SurfaceBuilder builder(file);
  const SurfaceFormat format = parse_surface(file, builder);
  return SurfacePreparation(file, format, builder.finish()).run();
}

}  // namespace locvol
