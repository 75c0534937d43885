#include "tools/generate.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

#include "engine/ingest/surface_bodies.h"
#include "engine/shared/unfinished_name.h"
#include "octree/geometry.h"
#include "octree/mix.h"
#include "refine/grains/voronoi_grains.h"

namespace locvol {
namespace {

static_assert(std::endian::native == std::endian::little, "both file formats are little-endian");

constexpr double kPi = std::numbers::pi;

// ---- Where a surface goes -----------------------------------------------------------------------

struct Vertex {
  std::uint64_t id = 0;
  Point position;
};

// Takes the vertices and triangles of a surface in any order, each vertex before its triangles.
// Both are numbered 0, 1, 2, … as they come.
class SurfaceSink {
 public:
  virtual ~SurfaceSink() = default;

  Vertex add_vertex(const Point& position) {
    write_vertex(position);
    return {num_vertices_++, position};
  }
  void add_triangle(const Vertex& a, const Vertex& b, const Vertex& c) {
    write_triangle(a, b, c);
    ++num_triangles_;
  }
  // The triangles that follow are of this one, in files that have groups.
  void begin_group(std::uint32_t number) { group_ = number; }
  std::uint64_t num_vertices() const { return num_vertices_; }
  std::uint64_t num_triangles() const { return num_triangles_; }

 protected:
  std::uint32_t group() const { return group_; }

 private:
  virtual void write_vertex(const Point& position) = 0;
  virtual void write_triangle(const Vertex& a, const Vertex& b, const Vertex& c) = 0;
  std::uint64_t num_vertices_ = 0, num_triangles_ = 0;
  std::uint32_t group_ = 0;
};

class CountingSink : public SurfaceSink {
  void write_vertex(const Point&) override {}
  void write_triangle(const Vertex&, const Vertex&, const Vertex&) override {}
};

// A file under a temporary name, removed again unless it is published.
class GeneratedFile {
 public:
  explicit GeneratedFile(std::filesystem::path path)
      : path_(std::move(path)), unfinished_(path_), file_(std::fopen(path_.c_str(), "w+b")) {
    if (!file_) fail("create");
    std::setvbuf(file_.get(), buffer_.get(), _IOFBF, kBufferBytes);
  }
  GeneratedFile(const GeneratedFile&) = delete;
  GeneratedFile& operator=(const GeneratedFile&) = delete;
  ~GeneratedFile() {
    if (!file_) return;
    std::error_code ignored;  // nothing is left to be done about it
    std::filesystem::remove(path_, ignored);
  }

  void append(const void* data, std::size_t num_bytes) {
    if (std::fwrite(data, 1, num_bytes, file_.get()) != num_bytes) fail("write");
    num_bytes_ += num_bytes;
  }

  void append_contents_of(GeneratedFile& other) {
    other.rewind();
    std::vector<char> buffer(kBufferBytes);
    while (const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), other.file_.get()))
      append(buffer.data(), n);
    if (std::ferror(other.file_.get())) other.fail("read back");
  }

  void overwrite_start(const std::string& bytes) {
    rewind();
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size()) fail("write");
  }

  // Durable before it is renamed: a whole file or none, whenever the power fails.
  void publish(const std::filesystem::path& name) {
    if (std::fflush(file_.get()) != 0 || fsync(fileno(file_.get())) != 0) fail("write");
    std::filesystem::rename(path_, name);
    file_.reset();
  }

  std::uint64_t num_bytes() const { return num_bytes_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  static constexpr std::size_t kBufferBytes = std::size_t{1} << 20;

  void rewind() {
    if (std::fseek(file_.get(), 0, SEEK_SET) != 0) fail("write");
  }
  [[noreturn]] void fail(const char* what) const {
    throw std::runtime_error("cannot " + std::string(what) + " " + path_.string() + ": " +
                             std::strerror(errno));
  }

  std::filesystem::path path_;
  UnfinishedName unfinished_;
  std::unique_ptr<char[]> buffer_ = std::make_unique<char[]>(kBufferBytes);  // outlives the file
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t num_bytes_ = 0;
};

std::filesystem::path with_suffix(std::filesystem::path path, const char* suffix) {
  return path += suffix;
}

class SurfaceWriter : public SurfaceSink {
 public:
  virtual std::uint64_t finish() = 0;  // the file gets its name; returns its bytes
};

// Binary STL: 80 bytes of text, the number of triangles (32 bits), then for each of them 50 bytes:
// the normal and three corners in float32, and 16 bits unused.
class StlWriter : public SurfaceWriter {
 public:
  static constexpr std::uint64_t kMaxTriangles = 0xffffffff;

  explicit StlWriter(const std::filesystem::path& name)
      : name_(name), file_(with_suffix(name, ".partial")) {
    const std::string head = header();
    file_.append(head.data(), head.size());
  }

  std::uint64_t finish() override {
    file_.overwrite_start(header());
    file_.publish(name_);
    return file_.num_bytes();
  }

 private:
  using Float3 = std::array<float, 3>;

  static Float3 rounded(const Point& p) {
    return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
  }

  std::string header() const {
    std::string bytes = "binary STL by locvol generate";  // must not begin with "solid"
    bytes.resize(84, ' ');
    const auto count = static_cast<std::uint32_t>(num_triangles());
    std::memcpy(bytes.data() + 80, &count, 4);
    return bytes;
  }

  void write_vertex(const Point&) override {}

  void write_triangle(const Vertex& a, const Vertex& b, const Vertex& c) override {
    if (num_triangles() == kMaxTriangles)
      throw std::runtime_error(name_.string() + ": STL holds at most " +
                               std::to_string(kMaxTriangles) + " triangles; write PLY");
    const Point normal = cross(b.position - a.position, c.position - a.position);
    const std::array<Float3, 4> values = {rounded((1 / norm(normal)) * normal), rounded(a.position),
                                          rounded(b.position), rounded(c.position)};
    if (values[1] == values[2] || values[2] == values[3] || values[3] == values[1])
      throw std::runtime_error(name_.string() +
                               ": at this resolution the float32 coordinates of STL cannot tell "
                               "neighboring vertices apart; write PLY");
    std::array<char, 50> record{};
    std::memcpy(record.data(), values.data(), sizeof values);
    file_.append(record.data(), record.size());
  }

  std::filesystem::path name_;
  GeneratedFile file_;
};

// Binary PLY: a header of text, 24 bytes for each vertex (three doubles), 13 for each triangle (the
// byte 3, three 32-bit indices), 17 with the number of its group. Triangles come while vertices
// still do, so they wait in a file of their own.
class PlyWriter : public SurfaceWriter {
 public:
  static constexpr std::uint64_t kMaxVertices = 0xffffffff;

  explicit PlyWriter(const std::filesystem::path& name, bool has_groups = false)
      : name_(name),
        has_groups_(has_groups),
        file_(with_suffix(name, ".partial")),
        faces_(with_suffix(name, ".partial.faces")) {
    const std::string head = header();
    file_.append(head.data(), head.size());
  }

  std::uint64_t finish() override {
    file_.append_contents_of(faces_);
    file_.overwrite_start(header());
    file_.publish(name_);
    return file_.num_bytes();
  }

 private:
  // The same length whatever the counts: the comment takes up the slack.
  std::string header() const {
    constexpr std::size_t kHeaderBytes = 256;
    const std::string end = "\nend_header\n";
    std::string text =
        "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(num_vertices()) +
        "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
        std::to_string(num_triangles()) + "\nproperty list uchar uint vertex_indices" +
        (has_groups_ ? "\nproperty uint region" : "") + "\ncomment by locvol generate ";
    text.resize(kHeaderBytes - end.size(), '.');
    return text + end;
  }

  void write_vertex(const Point& p) override {
    if (num_vertices() == kMaxVertices)
      throw std::runtime_error(name_.string() + ": PLY holds at most " +
                               std::to_string(kMaxVertices) + " vertices");
    const std::array<double, 3> record = {p.x, p.y, p.z};
    file_.append(record.data(), sizeof record);
  }

  void write_triangle(const Vertex& a, const Vertex& b, const Vertex& c) override {
    const std::array<std::uint32_t, 3> ids = {static_cast<std::uint32_t>(a.id),
                                              static_cast<std::uint32_t>(b.id),
                                              static_cast<std::uint32_t>(c.id)};
    std::array<char, 13> record{3};
    std::memcpy(record.data() + 1, ids.data(), sizeof ids);
    faces_.append(record.data(), record.size());
    if (const std::uint32_t number = group(); has_groups_) faces_.append(&number, sizeof number);
  }

  std::filesystem::path name_;
  bool has_groups_;
  GeneratedFile file_, faces_;
};

// ---- Surfaces with parameters, row by row -------------------------------------------------------

// The unit sphere is two pyramids with `sides` sides and `rows` rows, blown up: row k, counted from
// a pole, has sides · k vertices.
std::vector<Vertex> add_sphere_row(std::uint64_t sides, std::uint64_t rows, std::uint64_t k,
                                   SurfaceSink& sink) {
  if (k == 0) return {sink.add_vertex({0, 0, 1})};
  if (k == 2 * rows) return {sink.add_vertex({0, 0, -1})};
  const double polar = kPi * static_cast<double>(k) / static_cast<double>(2 * rows);
  const double radius = std::sin(polar), z = std::cos(polar);
  std::vector<Vertex> row(sides * std::min(k, 2 * rows - k));
  for (std::uint64_t j = 0; j < row.size(); ++j) {
    const double a = 2 * kPi * static_cast<double>(j) / static_cast<double>(row.size());
    row[j] = sink.add_vertex({radius * std::cos(a), radius * std::sin(a), z});
  }
  return row;
}

// Each side has `steps` edges on the row nearer to its pole and one more on the other row.
void join_sphere_rows(const std::vector<Vertex>& near, const std::vector<Vertex>& far,
                      std::uint64_t sides, std::uint64_t steps, bool is_north, SurfaceSink& sink) {
  const auto add = [&](const Vertex& a, const Vertex& b, const Vertex& c) {
    is_north ? sink.add_triangle(a, b, c) : sink.add_triangle(a, c, b);
  };
  for (std::uint64_t side = 0; side < sides; ++side) {
    for (std::uint64_t j = 0; j <= steps; ++j) {
      const Vertex& apex = near[(side * steps + j) % near.size()];
      const std::uint64_t base = side * (steps + 1) + j;
      const Vertex& base_end = far[(base + 1) % far.size()];
      add(apex, far[base], base_end);
      if (j < steps) add(apex, base_end, near[(side * steps + j + 1) % near.size()]);
    }
  }
}

void emit_sphere_rows(std::uint64_t sides, std::uint64_t rows, SurfaceSink& sink) {
  std::vector<Vertex> previous = add_sphere_row(sides, rows, 0, sink);
  for (std::uint64_t k = 1; k <= 2 * rows; ++k) {
    std::vector<Vertex> row = add_sphere_row(sides, rows, k, sink);
    if (k <= rows)
      join_sphere_rows(previous, row, sides, k - 1, true, sink);
    else
      join_sphere_rows(row, previous, sides, 2 * rows - k, false, sink);
    previous = std::move(row);
  }
}

void emit_sphere(std::uint64_t num_triangles, SurfaceSink& sink) {
  const auto wanted = static_cast<double>(num_triangles);
  double best_sides = 0, best_rows = 0, best_error = wanted;
  for (const double sides : {6, 5, 7}) {  // 6 has the best triangles
    const double rows = std::max(1.0, std::round(std::sqrt(wanted / (2 * sides))));
    const double error = std::abs(2 * sides * rows * rows - wanted);
    if (error >= best_error) continue;
    best_error = error;
    best_sides = sides;
    best_rows = rows;
  }
  emit_sphere_rows(static_cast<std::uint64_t>(best_sides), static_cast<std::uint64_t>(best_rows),
                   sink);
}

// A ring of a curve's cross-sections: frame_at(u), 0 <= u < 1, gives the center and the two radii
// (as vectors, the first turning to the second around the direction of the curve).
struct CrossSection {
  Point center, radius_1, radius_2;
};

template <typename FrameAt>
void emit_tube(std::uint64_t num_sections, std::uint64_t num_sides, const FrameAt& frame_at,
               SurfaceSink& sink) {
  std::vector<std::pair<double, double>> circle(num_sides);
  for (std::uint64_t j = 0; j < num_sides; ++j) {
    const double a = 2 * kPi * static_cast<double>(j) / static_cast<double>(num_sides);
    circle[j] = {std::cos(a), std::sin(a)};
  }
  const auto ring_at = [&](std::uint64_t i) {
    const CrossSection s = frame_at(static_cast<double>(i) / static_cast<double>(num_sections));
    std::vector<Vertex> ring;
    ring.reserve(num_sides);
    for (const auto& [cosine, sine] : circle)
      ring.push_back(sink.add_vertex(s.center + cosine * s.radius_1 + sine * s.radius_2));
    return ring;
  };
  const auto join = [&](const std::vector<Vertex>& back, const std::vector<Vertex>& front) {
    for (std::uint64_t j = 0; j < num_sides; ++j) {
      const std::uint64_t next = (j + 1) % num_sides;
      sink.add_triangle(back[j], back[next], front[next]);
      sink.add_triangle(back[j], front[next], front[j]);
    }
  };
  const std::vector<Vertex> first = ring_at(0);
  std::vector<Vertex> previous = first;
  for (std::uint64_t i = 1; i < num_sections; ++i) {
    std::vector<Vertex> ring = ring_at(i);
    join(previous, ring);
    previous = std::move(ring);
  }
  join(previous, first);
}

// `length_ratio`: the curve's length over the circumference of its tube.
template <typename FrameAt>
void emit_tube_of(std::uint64_t num_triangles, double length_ratio, double min_sections,
                  const FrameAt& frame_at, SurfaceSink& sink) {
  const double num_quads = static_cast<double>(num_triangles) / 2;
  const double sides = std::clamp(std::round(std::sqrt(num_quads / length_ratio)), 3.0,
                                  std::max(3.0, std::floor(num_quads / min_sections)));
  const double sections = std::max(min_sections, std::round(num_quads / sides));
  emit_tube(static_cast<std::uint64_t>(sections), static_cast<std::uint64_t>(sides), frame_at,
            sink);
}

void emit_torus(std::uint64_t num_triangles, SurfaceSink& sink) {
  constexpr double kRingRadius = 0.7, kTubeRadius = 0.3;
  const auto section = [](double u) {
    const Point outward = {std::cos(2 * kPi * u), std::sin(2 * kPi * u), 0};
    return CrossSection{kRingRadius * outward, kTubeRadius * outward, {0, 0, -kTubeRadius}};
  };
  emit_tube_of(num_triangles, kRingRadius / kTubeRadius, 3, section, sink);
}

// The trefoil (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t) with its Frenet frame: its curvature is
// nowhere 0.
void emit_knot(std::uint64_t num_triangles, SurfaceSink& sink) {
  constexpr double kScale = 1.0 / 3, kTubeRadius = 0.16, kMinSections = 60;
  constexpr double kLength = 28.826290175493135 * kScale;
  const auto section = [](double u) {
    const double t = 2 * kPi * u;
    const Point position = {std::sin(t) + 2 * std::sin(2 * t), std::cos(t) - 2 * std::cos(2 * t),
                            -std::sin(3 * t)};
    const Point velocity = {std::cos(t) + 4 * std::cos(2 * t), -std::sin(t) + 4 * std::sin(2 * t),
                            -3 * std::cos(3 * t)};
    const Point acceleration = {-std::sin(t) - 8 * std::sin(2 * t),
                                -std::cos(t) + 8 * std::cos(2 * t), 9 * std::sin(3 * t)};
    const Point binormal = cross(velocity, acceleration);
    const Point normal = cross(binormal, velocity);
    return CrossSection{kScale * position, (kTubeRadius / norm(normal)) * normal,
                        (kTubeRadius / norm(binormal)) * binormal};
  };
  emit_tube_of(num_triangles, kLength / (2 * kPi * kTubeRadius), kMinSections, section, sink);
}

// ---- Implicit shapes: negative inside, slope at most 1 ------------------------------------------

struct Implicit {
  double (*value)(const Point&);
  double radius;  // of a ball around 0 that contains the shape
};

// The smaller (larger) of two, rounded where they differ by less than `width`: no creases.
double smooth_min(double a, double b, double width) {
  const double overlap = std::max(width - std::abs(a - b), 0.0);
  return std::min(a, b) - overlap * overlap / (4 * width);
}
double smooth_max(double a, double b, double width) { return -smooth_min(-a, -b, width); }

// Nothing here overflows: no need for std::hypot, which is slower.
double length(double x, double y) { return std::sqrt(x * x + y * y); }

// Around the z-axis; the shapes below turn and move it by permuting its arguments.
double torus_distance(double x, double y, double z, double ring_radius, double tube_radius) {
  return length(length(x, y) - ring_radius, z) - tube_radius;
}

double rounded_box_distance(const Point& p, const Point& half, double rounding) {
  const Point q = {std::abs(p.x) - half.x + rounding, std::abs(p.y) - half.y + rounding,
                   std::abs(p.z) - half.z + rounding};
  const Point outside = {std::max(q.x, 0.0), std::max(q.y, 0.0), std::max(q.z, 0.0)};
  return norm(outside) + std::min(std::max({q.x, q.y, q.z}), 0.0) - rounding;
}

// The mirror image in the plane through the z-axis at `angle`, if p lies beyond it.
Point folded(const Point& p, double cosine, double sine) {
  const double beyond = cosine * p.y - sine * p.x;
  if (beyond <= 0) return p;
  return {p.x + 2 * beyond * sine, p.y - 2 * beyond * cosine, p.z};
}

constexpr double kCos15 = 0.9659258262890683, kSin15 = 0.25881904510252074;
constexpr double kCos30 = 0.8660254037844387, kSin30 = 0.5;
constexpr double kCos45 = 0.7071067811865476;

// Eight tori in a ring, each grown together with its neighbors.
double nine_handle_torus(const Point& p) {
  constexpr double kCenter = 0.7, kRing = 0.2, kTube = 0.1;
  const Point q = folded({std::abs(p.x), std::abs(p.y), p.z}, kCos45, kCos45);
  const double here = torus_distance(q.x - kCenter, q.y, q.z, kRing, kTube);
  const double next =
      torus_distance(q.x - kCenter * kCos45, q.y - kCenter * kCos45, q.z, kRing, kTube);
  return smooth_min(here, next, 0.06);
}

// Tubes along the twelve edges of an octahedron. Only the four edges at the nearest corner count.
double octahandles(const Point& p) {
  constexpr double kCorner = 0.85, kTube = 0.13, kBlend = 0.03;
  std::array<double, 3> v = {std::abs(p.x), std::abs(p.y), std::abs(p.z)};
  std::ranges::sort(v, std::greater());
  const auto distance_to_edge = [&](double across, double other) {
    const double along = std::clamp((kCorner - v[0] + across) / (2 * kCorner), 0.0, 1.0);
    return norm({v[0] - kCorner * (1 - along), across - kCorner * along, other});
  };
  const std::array<double, 4> distances = {
      distance_to_edge(v[1], v[2]), distance_to_edge(v[2], v[1]), distance_to_edge(-v[2], v[1]),
      distance_to_edge(-v[1], v[2])};
  const double nearest = std::ranges::min(distances);
  double sum = 0;
  for (const double d : distances) sum += std::exp((nearest - d) / kBlend);
  return nearest - kBlend * std::log(sum) - kTube;
}

// A band with twelve holes drilled through it, toward its axis.
double holed_ring(const Point& p) {
  constexpr double kRadius = 0.82, kHole = 0.11;
  const double band =
      rounded_box_distance({length(p.x, p.y) - kRadius, 0, p.z}, {0.13, 1, 0.3}, 0.07);
  Point q = folded({std::abs(p.x), std::abs(p.y), p.z}, kCos45, kCos45);
  q = folded(folded(q, kCos30, kSin30), kCos15, kSin15);
  return smooth_max(band, kHole - length(q.y, q.z), 0.05);
}

// Twelve links in a ring, by turns lying and upright, each grown together with its neighbors.
double bracelet(const Point& p) {
  constexpr double kCenter = 0.8, kRing = 0.165, kTube = 0.06;
  const Point q =
      folded(folded({std::abs(p.x), std::abs(p.y), p.z}, kSin30, kCos30), kCos30, kSin30);
  const double lying = torus_distance(q.x - kCenter, q.y, q.z, kRing, kTube);
  const double outward = kCos30 * q.x + kSin30 * q.y - kCenter, along = kCos30 * q.y - kSin30 * q.x;
  const double upright = torus_distance(along, q.z, outward, kRing, kTube);
  return smooth_min(lying, upright, 0.04);
}

// A rounded block with three holes.
double three_holes(const Point& p) {
  constexpr double kSpacing = 0.62, kHole = 0.19;
  const double block = rounded_box_distance(p, {1, 0.42, 0.26}, 0.14);
  const double x = std::abs(p.x) < kSpacing / 2 ? p.x : std::abs(p.x) - kSpacing;
  return smooth_max(block, kHole - length(x, p.y), 0.08);
}

// One of the two labyrinths of a gyroid, cut out by a ball. Frequency and phase keep its channels
// from just touching the sphere, so that the genus is the same at all resolutions.
double gyroid_ball(const Point& p) {
  constexpr double kFrequency = 9.1, kPhase = kPi / 4, kMaxSlope = std::numbers::sqrt3;
  const Point q = kFrequency * p + Point{kPhase, kPhase, kPhase};
  const double gyroid =
      std::sin(q.x) * std::cos(q.y) + std::sin(q.y) * std::cos(q.z) + std::sin(q.z) * std::cos(q.x);
  return smooth_max(gyroid / (kFrequency * kMaxSlope), norm(p) - 1, 0.08);
}

// ---- Implicit shapes to triangles ---------------------------------------------------------------

// Marching tetrahedra over a body-centered cubic grid, a slab of cells at a time.
//
// Grid points have integer coordinates in half cells: all even (a cell's corner) or all odd (its
// center). The four tetrahedra between two neighboring centers surround the line that joins them:
//
//         v3 ------ v2        each is (center, next center, v_i, v_i+1), positively oriented if the
//          |  c  c' |         corners v turn right-handed around the line
//         v0 ------ v1
//
// A surface of one or two triangles in each tetrahedron, with vertices on its edges, is closed and
// a manifold whatever the signs, and cannot meet itself. A grid point nearer to the surface than
// kClearance cells is moved away from it, so that no triangle becomes tiny; the tetrahedra, at
// least half a cell thick, stay proper, as kClearance is less than a quarter.
//
// Slabs are cut into blocks, and a block is skipped if the slope bound says that the surface cannot
// reach it. So the work grows with the surface, not with the volume. Vertices on edges shared with
// other blocks are kept by edge, until the slab after theirs is done.
class Marcher {
 public:
  Marcher(const Implicit& shape, double cell_side, SurfaceSink& sink)
      : shape_(shape),
        cell_side_(cell_side),
        blocks_per_side_(static_cast<int>(std::ceil(2 * (shape.radius / cell_side + 2) / kBlock))),
        sink_(sink) {
    assert(2 * kBlock * blocks_per_side_ + kSide < 1 << kCoordinateBits);
    // The grid is turned against the axes: flat parts of a shape spread over many slabs, and no
    // symmetry of a shape makes ties.
    const double scale = cell_side / 2 / 39;
    axes_ = {scale * Point{19, 26, 22}, scale * Point{-34, 13, 14}, scale * Point{2, -26, 29}};
    const double half = -kBlock * blocks_per_side_;
    origin_ = half * (axes_[0] + axes_[1] + axes_[2]);
  }

  void run() {
    for (int slab = 0; slab < blocks_per_side_; ++slab) {
      march_blocks(0, blocks_per_side_, 0, blocks_per_side_, slab);
      shared_ = std::exchange(shared_with_next_slab_, {});
    }
  }

 private:
  static constexpr int kBlock = 8;              // cells on each side
  static constexpr int kSide = 2 * kBlock + 2;  // grid coordinates in a block: 0 … 2 kBlock + 1
  static constexpr int kCoordinateBits = 20;
  static constexpr int kEdgeKinds = 7;
  static constexpr double kClearance = 0.15;     // in cells
  static constexpr double kMinEdgeShare = 0.02;  // from a vertex to the ends of its edge
  static constexpr std::uint32_t kNone = 0xffffffff;

  struct GridCoordinates {
    int x = 0, y = 0, z = 0;
    friend GridCoordinates operator+(GridCoordinates a, GridCoordinates b) {
      return {a.x + b.x, a.y + b.y, a.z + b.z};
    }
  };
  struct Sample {
    Point position;
    double value = 0;
  };

  Point position(double x, double y, double z) const {
    return origin_ + x * axes_[0] + y * axes_[1] + z * axes_[2];
  }

  static std::size_t sample_index(GridCoordinates g) {  // the parity, then cells in order
    constexpr int kCells = kBlock + 1;
    const int cell = (g.z / 2 * kCells + g.y / 2) * kCells + g.x / 2;
    return static_cast<std::size_t>((g.x & 1) * kCells * kCells * kCells + cell);
  }
  const Sample& sample(GridCoordinates g) const { return samples_[sample_index(g)]; }
  bool is_inside(GridCoordinates g) const { return sample(g).value < 0; }

  // All blocks of a rectangle of one slab, halved until it can be skipped or is a single one.
  void march_blocks(int x0, int x1, int y0, int y1, int z) {
    if (is_clear_of_surface(x0, x1, y0, y1, z)) return;
    if (x1 - x0 == 1 && y1 - y0 == 1) return march_block(x0, y0, z);
    if (x1 - x0 >= y1 - y0) {
      const int middle = (x0 + x1) / 2;
      march_blocks(x0, middle, y0, y1, z);
      march_blocks(middle, x1, y0, y1, z);
    } else {
      const int middle = (y0 + y1) / 2;
      march_blocks(x0, x1, y0, middle, z);
      march_blocks(x0, x1, middle, y1, z);
    }
  }

  bool is_clear_of_surface(int x0, int x1, int y0, int y1, int z) const {
    const auto half = [](int blocks) { return blocks * kBlock + 0.5; };  // of the coordinate range
    const Point center = position(2 * kBlock * x0 + half(x1 - x0), 2 * kBlock * y0 + half(y1 - y0),
                                  2 * kBlock * z + half(1));
    const double reach = norm({half(x1 - x0), half(y1 - y0), half(1)}) / 2 + kClearance;
    return std::abs(shape_.value(center)) > reach * cell_side_;
  }

  void march_block(int x, int y, int z) {
    base_ = {2 * kBlock * x, 2 * kBlock * y, 2 * kBlock * z};
    for (int parity = 0; parity < 2; ++parity)
      for (int k = parity; k < kSide; k += 2)
        for (int j = parity; j < kSide; j += 2)
          for (int i = parity; i < kSide; i += 2)
            samples_[sample_index({i, j, k})] = sample_at(base_ + GridCoordinates{i, j, k});
    std::ranges::fill(vertex_of_edge_, kNone);
    block_vertices_.clear();
    for (int k = 1; k < 2 * kBlock; k += 2)
      for (int j = 1; j < 2 * kBlock; j += 2)
        for (int i = 1; i < 2 * kBlock; i += 2) march_center({i, j, k});
  }

  Sample sample_at(GridCoordinates g) const {
    Sample s;
    s.position = position(g.x, g.y, g.z);
    s.value = shape_.value(s.position);
    const double clearance = kClearance * cell_side_;
    if (std::abs(s.value) >= clearance) return s;
    const Point slope = gradient(s.position);
    const double steepness = norm(slope);
    if (std::abs(s.value) >= clearance * steepness) return s;
    const double missing = clearance - std::abs(s.value) / steepness;
    s.position = s.position + (std::copysign(missing, s.value) / steepness) * slope;
    s.value = shape_.value(s.position);
    return s;
  }

  Point gradient(const Point& p) const {
    const double step = 0.01 * cell_side_;
    Point slope;
    for (int axis = 0; axis < 3; ++axis) {
      Point low = p, high = p;
      low[axis] -= step;
      high[axis] += step;
      slope[axis] = (shape_.value(high) - shape_.value(low)) / (2 * step);
    }
    return slope;
  }

  void march_center(GridCoordinates center) {
    static constexpr std::array<std::array<GridCoordinates, 4>, 3> kCorners = {{
        {{{1, -1, -1}, {1, 1, -1}, {1, 1, 1}, {1, -1, 1}}},
        {{{-1, 1, -1}, {-1, 1, 1}, {1, 1, 1}, {1, 1, -1}}},
        {{{-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}}},
    }};
    static constexpr std::array<GridCoordinates, 3> kNext = {{{2, 0, 0}, {0, 2, 0}, {0, 0, 2}}};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const GridCoordinates next = center + kNext[axis];
      std::array<GridCoordinates, 4> corners;
      bool is_crossed = is_inside(next) != is_inside(center);
      for (std::size_t i = 0; i < 4; ++i) {
        corners[i] = center + kCorners[axis][i];
        is_crossed |= is_inside(corners[i]) != is_inside(center);
      }
      if (!is_crossed) continue;  // as nearly always
      for (std::size_t i = 0; i < 4; ++i)
        march_tetrahedron({center, next, corners[i], corners[(i + 1) % 4]});
    }
  }

  void march_tetrahedron(const std::array<GridCoordinates, 4>& corners) {
    // Even permutations that bring the corners inside to the front; with three inside, the one
    // outside, and the triangle is turned over.
    static constexpr std::array<std::array<std::size_t, 4>, 16> kOrder = {{{0, 1, 2, 3},
                                                                           {0, 1, 2, 3},
                                                                           {1, 0, 3, 2},
                                                                           {0, 1, 2, 3},
                                                                           {2, 3, 0, 1},
                                                                           {0, 2, 3, 1},
                                                                           {1, 2, 0, 3},
                                                                           {3, 2, 1, 0},
                                                                           {3, 2, 1, 0},
                                                                           {0, 3, 1, 2},
                                                                           {1, 3, 2, 0},
                                                                           {2, 3, 0, 1},
                                                                           {2, 3, 0, 1},
                                                                           {1, 0, 3, 2},
                                                                           {0, 1, 2, 3},
                                                                           {0, 1, 2, 3}}};
    unsigned inside = 0;
    for (unsigned i = 0; i < 4; ++i) inside |= unsigned{is_inside(corners[i])} << i;
    if (inside == 0 || inside == 15) return;
    const auto vertex = [&, &order = kOrder[inside]](std::size_t i, std::size_t j) {
      return vertex_on(corners[order[i]], corners[order[j]]);
    };
    if (std::popcount(inside) == 2) {
      add_quad({vertex(0, 2), vertex(0, 3), vertex(1, 3), vertex(1, 2)});
    } else {
      const std::array<Vertex, 3> t = {vertex(0, 1), vertex(0, 2), vertex(0, 3)};
      std::popcount(inside) == 1 ? sink_.add_triangle(t[0], t[1], t[2])
                                 : sink_.add_triangle(t[0], t[2], t[1]);
    }
  }

  // Along its shorter diagonal.
  void add_quad(const std::array<Vertex, 4>& v) {
    const double diagonal_02 = squared_distance(v[0].position, v[2].position);
    const double diagonal_13 = squared_distance(v[1].position, v[3].position);
    const std::size_t first = diagonal_02 <= diagonal_13 ? 0 : 1;
    sink_.add_triangle(v[first], v[first + 1], v[first + 2]);
    sink_.add_triangle(v[first], v[first + 2], v[(first + 3) % 4]);
  }

  // The same vertex, whichever tetrahedron, block or slab asks for it.
  Vertex vertex_on(GridCoordinates a, GridCoordinates b) {
    if (std::tie(b.z, b.y, b.x) < std::tie(a.z, a.y, a.x)) std::swap(a, b);
    const int place = (a.z * kSide + a.y) * kSide + a.x;
    const int kind = edge_kind(a, b);
    std::uint32_t& index = vertex_of_edge_[static_cast<std::size_t>(place * kEdgeKinds + kind)];
    if (index == kNone) {
      index = static_cast<std::uint32_t>(block_vertices_.size());
      block_vertices_.push_back(is_shared(a, b) ? shared_vertex(a, b, kind)
                                                : sink_.add_vertex(surface_point(a, b)));
    }
    return block_vertices_[index];
  }

  // REQUIRES: a before b in order of z, y, x
  static int edge_kind(GridCoordinates a, GridCoordinates b) {
    if (b.z - a.z == 1) return (b.x > a.x ? 1 : 0) + (b.y > a.y ? 2 : 0);
    return b.x > a.x ? 4 : b.y > a.y ? 5 : 6;
  }

  // The tetrahedra of a block reach one coordinate into the next one, so two blocks have in common
  // the edges that lie in the first or the last two layers on some axis.
  static bool is_shared(GridCoordinates a, GridCoordinates b) {
    const auto in_outer_layers = [](int u, int v) {
      return std::max(u, v) <= 1 || std::min(u, v) >= 2 * kBlock;
    };
    return in_outer_layers(a.x, b.x) || in_outer_layers(a.y, b.y) || in_outer_layers(a.z, b.z);
  }

  Vertex shared_vertex(GridCoordinates a, GridCoordinates b, int kind) {
    std::uint64_t key = 0;
    for (const int v : {base_.z + a.z, base_.y + a.y, base_.x + a.x})
      key = key << kCoordinateBits | static_cast<std::uint64_t>(v);
    key = key << 3 | static_cast<std::uint64_t>(kind);
    const auto [entry, is_new] = shared_.try_emplace(key);
    if (is_new) {
      entry->second = sink_.add_vertex(surface_point(a, b));
      if (a.z >= 2 * kBlock) shared_with_next_slab_.emplace(key, entry->second);
    }
    return entry->second;
  }

  // Where the surface crosses an edge: a few steps of the Illinois method, from a bracket.
  Point surface_point(GridCoordinates a, GridCoordinates b) const {
    const Sample &first = sample(a), &second = sample(b);
    const Point direction = second.position - first.position;
    double low = 0, high = 1, low_value = first.value, high_value = second.value, t = 0;
    for (int step = 0; step < 8; ++step) {
      t = (low * high_value - high * low_value) / (high_value - low_value);
      const double value = shape_.value(first.position + t * direction);
      if (std::abs(value) <= 1e-10 * cell_side_) break;
      if ((value < 0) == (high_value < 0)) {
        low_value *= 0.5;
      } else {
        low = high;
        low_value = high_value;
      }
      high = t;
      high_value = value;
    }
    t = std::clamp(t, kMinEdgeShare, 1 - kMinEdgeShare);
    return first.position + t * direction;
  }

  const Implicit& shape_;
  double cell_side_;
  int blocks_per_side_;
  SurfaceSink& sink_;
  Point origin_;
  std::array<Point, 3> axes_;  // half a cell long

  GridCoordinates base_;  // of the block in hand, whose points and edges are indexed from there
  std::array<Sample, 2 * (kBlock + 1) * (kBlock + 1) * (kBlock + 1)> samples_;
  std::array<std::uint32_t, std::size_t{kSide} * kSide * kSide * kEdgeKinds> vertex_of_edge_;
  std::vector<Vertex> block_vertices_;
  std::unordered_map<std::uint64_t, Vertex> shared_, shared_with_next_slab_;  // by global edge
};

std::uint64_t count_triangles(const Implicit& shape, double cell_side) {
  CountingSink sink;
  std::make_unique<Marcher>(shape, cell_side, sink)->run();
  return sink.num_triangles();
}

// The count grows as the inverse square of the cell side, the better the finer. So a small surface
// is tried until its count is right, or near enough, for it comes in steps; a large one is judged
// from one of moderate size.
double cell_side_for(const Implicit& shape, std::uint64_t num_triangles) {
  constexpr double kMaxTrial = 100'000, kTolerance = 0.01;
  const auto wanted = static_cast<double>(num_triangles);
  const double trial = std::min(wanted, kMaxTrial);
  double cell_side = shape.radius / 30, best_side = 0, best_count = 0;
  for (int attempt = 0; attempt < 10; ++attempt) {
    const auto count = static_cast<double>(count_triangles(shape, cell_side));
    if (std::abs(count - trial) < std::abs(best_count - trial)) {
      best_count = count;
      best_side = cell_side;
    }
    if (std::abs(best_count - trial) < kTolerance * trial) break;
    cell_side *= std::sqrt(count / trial);
  }
  assert(best_side > 0);
  return trial < wanted ? best_side * std::sqrt(best_count / wanted) : best_side;
}

template <double (*value)(const Point&), int radius_percent>
void emit_implicit(std::uint64_t num_triangles, SurfaceSink& sink) {
  const Implicit shape = {value, radius_percent / 100.0};
  std::make_unique<Marcher>(shape, cell_side_for(shape, num_triangles), sink)->run();
}

// ---- Grains -------------------------------------------------------------------------------------

// A multiple of 2^-40 between -1 and 1.
double random_coordinate(std::uint64_t seed, std::uint64_t number) {
  constexpr int kBits = 40;
  const std::uint64_t odd = mix(mix(seed) ^ number) >> (64 - kBits) << 1 | 1;
  return std::ldexp(static_cast<double>(odd), -kBits) - 1;
}

// Of the ways to cut a convex polygon into triangles that whose worst triangle has the largest
// height over its longest edge: by dynamic programming, over the polygon's parts from corner i to
// corner k.
class EvenTriangulation {
 public:
  using Corners = std::array<std::size_t, 3>;

  explicit EvenTriangulation(std::span<const Point> corners)
      : corners_(corners), n_(corners.size()), best_(n_ * n_) {
    Point area;
    for (std::size_t i = 1; i + 1 < n_; ++i)
      area = area + cross(corners[i] - corners[0], corners[i + 1] - corners[0]);
    normal_ = (1 / norm(area)) * area;
    for (std::size_t width = 2; width < n_; ++width)
      for (std::size_t i = 0; i + width < n_; ++i) find_best(i, i + width);
    collect(0, n_ - 1);
  }

  // Above 0 unless some triangle is flat or turned over.
  double quality() const { return best_[n_ - 1].quality; }
  const std::vector<Corners>& triangles() const { return triangles_; }

 private:
  struct Best {
    double quality = std::numeric_limits<double>::infinity();
    std::size_t between = 0;
  };
  Best& best(std::size_t i, std::size_t k) { return best_[i * n_ + k]; }

  double quality_of(std::size_t i, std::size_t j, std::size_t k) const {
    const Point &a = corners_[i], &b = corners_[j], &c = corners_[k];
    return dot(cross(b - a, c - a), normal_) /
           std::max({squared_distance(a, b), squared_distance(b, c), squared_distance(c, a)});
  }
  void find_best(std::size_t i, std::size_t k) {
    Best& found = best(i, k);
    found.quality = -std::numeric_limits<double>::infinity();
    for (std::size_t j = i + 1; j < k; ++j) {
      const double quality =
          std::min({quality_of(i, j, k), best(i, j).quality, best(j, k).quality});
      if (quality > found.quality) found = {quality, j};
    }
  }
  void collect(std::size_t i, std::size_t k) {
    if (k - i < 2) return;
    const std::size_t j = best(i, k).between;
    triangles_.push_back({i, j, k});
    collect(i, j);
    collect(j, k);
  }

  std::span<const Point> corners_;
  std::size_t n_;
  std::vector<Best> best_;  // by first corner and last one
  Point normal_;
  std::vector<Corners> triangles_;
};

void emit_polycrystal(std::uint64_t num_grains, std::uint64_t seed, SurfaceSink& sink) {
  std::vector<Point> seeds(num_grains);
  for (std::uint64_t g = 0; g < num_grains; ++g)
    for (int axis = 0; axis < 3; ++axis)
      seeds[g][axis] = random_coordinate(seed, 3 * g + static_cast<std::uint64_t>(axis));
  const Grains grains = voronoi_grains(seeds);
  std::vector<Vertex> vertices;
  for (const Point& place : grains.vertices) vertices.push_back(sink.add_vertex(place));
  std::vector<std::vector<std::array<std::uint32_t, 3>>> triangles(num_grains);
  std::vector<Point> corners;
  for (const auto& [sides, ring] : grains.faces) {
    corners.clear();
    for (const std::uint32_t v : ring) corners.push_back(grains.vertices[v]);
    const EvenTriangulation even(corners);
    if (!(even.quality() > 0)) throw GrainError("a face between two grains is too thin");
    for (const auto& [i, j, k] : even.triangles()) {
      triangles[sides[0]].push_back({ring[i], ring[j], ring[k]});
      if (sides[1] != kNoGrain) triangles[sides[1]].push_back({ring[i], ring[k], ring[j]});
    }
  }
  for (std::uint32_t g = 0; g < num_grains; ++g) {
    sink.begin_group(g + 1);
    for (const auto& [a, b, c] : triangles[g])
      sink.add_triangle(vertices[a], vertices[b], vertices[c]);
  }
}

// ---- The shapes by name -------------------------------------------------------------------------

constexpr std::array kShapes = {
    ShapeInfo{"sphere", "the unit sphere", 0, 12},
    ShapeInfo{"torus", "a torus", 1, 18},
    ShapeInfo{"knot", "a tube along a trefoil knot", 1, 480},
    ShapeInfo{"three-holes", "a rounded block with three holes", 3, 1500},
    ShapeInfo{"octahandles", "tubes along the edges of an octahedron", 7, 2000},
    ShapeInfo{"nine-handle-torus", "eight tori in a ring", 9, 2000},
    ShapeInfo{"holed-ring", "a band with twelve holes", 13, 2500},
    ShapeInfo{"bracelet", "a chain of twelve links, grown together", 13, 5000},
    ShapeInfo{"gyroid-ball", "a gyroid labyrinth cut out by a ball", 39, 12000},
};

using Emit = void (*)(std::uint64_t, SurfaceSink&);
constexpr std::array<Emit, kShapes.size()> kEmit = {
    emit_sphere,
    emit_torus,
    emit_knot,
    emit_implicit<three_holes, 115>,
    emit_implicit<octahandles, 105>,
    emit_implicit<nine_handle_torus, 105>,
    emit_implicit<holed_ring, 105>,
    emit_implicit<bracelet, 105>,
    emit_implicit<gyroid_ball, 105>,
};

std::size_t index_of_shape(std::string_view name) {
  const auto found = std::ranges::find(kShapes, name, &ShapeInfo::name);
  if (found != kShapes.end()) return static_cast<std::size_t>(found - kShapes.begin());
  std::string message = "no shape is named '";
  message.append(name).append("'; there are");
  for (const ShapeInfo& shape : kShapes) message.append(" ").append(shape.name);
  throw std::invalid_argument(message);
}

void check_number(std::uint64_t num_triangles, std::uint64_t low, std::uint64_t high,
                  const std::string& what) {
  if (num_triangles < low || num_triangles > high)
    throw std::invalid_argument(what + " takes from " + std::to_string(low) + " to " +
                                std::to_string(high) + " triangles, not " +
                                std::to_string(num_triangles));
}

// What is written differs from what is asked for by a few percent; the limits leave room for it.
std::unique_ptr<SurfaceWriter> make_writer(const std::filesystem::path& out,
                                           std::uint64_t num_triangles) {
  const std::string extension = out.extension().string();
  if (extension == ".stl") {
    check_number(num_triangles, 0, StlWriter::kMaxTriangles / 20 * 19, "STL");
    return std::make_unique<StlWriter>(out);
  }
  if (extension == ".ply") {
    check_number(num_triangles, 0, PlyWriter::kMaxVertices / 20 * 38, "PLY");
    return std::make_unique<PlyWriter>(out);
  }
  throw std::invalid_argument("cannot tell the format of " + out.string() +
                              ": its name must end in .stl or .ply");
}

}  // namespace

std::span<const ShapeInfo> shapes() { return kShapes; }

GeneratedSurface generate(std::string_view shape, std::uint64_t num_triangles,
                          const std::filesystem::path& out) {
  const std::size_t index = index_of_shape(shape);
  check_number(num_triangles, kShapes[index].min_triangles, PlyWriter::kMaxVertices * 2,
               std::string(shape));
  const auto writer = make_writer(out, num_triangles);
  kEmit[index](num_triangles, *writer);
  GeneratedSurface surface{writer->num_vertices(), writer->num_triangles(), 0};
  surface.bytes = writer->finish();
  return surface;
}

GeneratedSurface generate_polycrystal(std::uint64_t num_grains, std::uint64_t seed,
                                      const std::filesystem::path& out) {
  if (num_grains < 1 || num_grains > kMaxBodies)
    throw std::invalid_argument("a polycrystal has from 1 to " + std::to_string(kMaxBodies) +
                                " grains, not " + std::to_string(num_grains));
  if (out.extension() != ".ply")
    throw std::invalid_argument(out.string() +
                                ": binary STL has no names for grains; write a .ply");
  PlyWriter writer(out, true);
  try {
    emit_polycrystal(num_grains, seed, writer);
  } catch (const GrainError& e) {
    throw std::invalid_argument(std::string(e.what()) + ": give another --seed");
  }
  GeneratedSurface surface{writer.num_vertices(), writer.num_triangles(), 0};
  surface.bytes = writer.finish();
  return surface;
}

}  // namespace locvol
