#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "engine/ingest/polygon_triangulation.h"
#include "engine/ingest/surface_groups.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_reader.h"
#include "engine/ingest/surface_repair.h"
#include "engine/ingest/vertex_spill.h"
#include "refine/domain/exact_predicates.h"

namespace locvol {
namespace {

// Outside these, products of six lengths overflow or underflow.
constexpr double kMinDiagonal = 1e-50, kMaxDiagonal = 1e50;
// The least number of steps between representable coordinates along the diagonal.
constexpr double kMinResolution = 1 << 20;

Point without_negative_zero(const Point& p) { return {p.x + 0.0, p.y + 0.0, p.z + 0.0}; }

[[noreturn]] void refuse(const RawSurface& surface, const std::string& what) {
  throw InputError(surface.file + ": " + what);
}

void require_triangles(const RawSurface& surface) {
  if (surface.num_triangles() > 0) return;
  if (surface.num_collapsed > 0)
    refuse(surface, "has only faces whose corners coincide; it bounds no volume");
  const std::uint64_t n = surface.num_numbered_vertices;
  if (n == 0) refuse(surface, "is empty: it has no vertices and no faces");
  refuse(surface, fmt::format("has {} {} but no faces; reconstruct a surface from its points first",
                              n, n == 1 ? "vertex" : "vertices"));
}

// Polygons that name vertices which had not come yet, in a temporary file until all have.
class DeferredPolygons {
 public:
  explicit DeferredPolygons(std::filesystem::path directory) : directory_(std::move(directory)) {}

  void append(std::span<const std::uint64_t> corners, const FilePlace& place, std::uint32_t group) {
    waiting_.push_back(static_cast<std::uint64_t>(place.unit));
    waiting_.push_back(place.number);
    waiting_.push_back(group);
    waiting_.push_back(corners.size());
    waiting_.insert(waiting_.end(), corners.begin(), corners.end());
    if (waiting_.size() >= kBufferWords) flush();
  }

  void clear() {
    waiting_.clear();
    num_words_ = 0;
  }

  template <class Visit>
  void for_each(const Visit& visit) {
    flush();
    std::vector<std::uint64_t> corners;
    Cursor cursor{*this};
    while (!cursor.is_at_end()) {
      FilePlace place;
      place.unit = static_cast<FilePlace::Unit>(cursor.next());
      place.number = cursor.next();
      const auto group = static_cast<std::uint32_t>(cursor.next());
      corners.resize(cursor.next());
      for (std::uint64_t& c : corners) c = cursor.next();
      visit(corners, place, group);
    }
  }

 private:
  static constexpr std::size_t kBufferWords = std::size_t{1} << 16;

  struct Cursor {
    bool is_at_end() const { return place == of.num_words_; }
    std::uint64_t next() {
      if (place == loaded_end) {
        buffer.resize(std::min<std::uint64_t>(of.num_words_ - place, kBufferWords));
        of.file_->read_at(place * sizeof(std::uint64_t), std::as_writable_bytes(std::span(buffer)));
        loaded_end = place + buffer.size();
      }
      return buffer[buffer.size() - (loaded_end - place++)];
    }

    const DeferredPolygons& of;
    std::uint64_t place = 0, loaded_end = 0;  // words
    std::vector<std::uint64_t> buffer{};
  };

  void flush() {
    if (waiting_.empty()) return;
    if (!file_) file_.emplace(OpenFile::temporary(directory_ / "locvol-faces"));
    file_->write_at(num_words_ * sizeof(std::uint64_t), std::as_bytes(std::span(waiting_)));
    num_words_ += waiting_.size();
    waiting_.clear();
  }

  std::filesystem::path directory_;
  std::optional<OpenFile> file_;
  std::uint64_t num_words_ = 0;
  std::vector<std::uint64_t> waiting_;
};

class RawSurfaceBuilder : public SurfaceSink {
 public:
  RawSurfaceBuilder(const std::string& name, const std::filesystem::path& directory,
                    IngestWatch& watch, const DiskOf& disk)
      : watch_(watch),
        directory_(directory),
        disk_(disk),
        surface_(directory),
        vertices_(directory),
        deferred_(directory) {
    surface_.file = name;
  }

  void announce(std::uint64_t num_faces) override {
    require_ingest_room(surface_.file, num_faces, directory_, 0, disk_);
  }

  void note(const std::string& text) override { surface_.notes.push_back(text); }
  void precision(double length) override {
    surface_.precision = std::max(surface_.precision, length);
  }
  void body(std::string_view name, std::string_view file) override;
  void group(std::string_view name) override { groups_.begin(name); }
  void color(const Color& color) override {
    surface_.colors.try_emplace(groups_.current_name(), color);
  }
  void vertex(const Point& position) override { vertices_.append(without_negative_zero(position)); }
  void polygon(std::span<const std::uint64_t> corners, const FilePlace& place) override;
  void facet(const std::array<Point, 3>& corners) override {
    add_triangle(without_negative_zero(corners[0]), without_negative_zero(corners[1]),
                 without_negative_zero(corners[2]), current_group());
  }

  RawSurface finish(std::string digest);
  RawSurface finish_part(std::uint64_t num_numbered_vertices);

 private:
  // `group`: of SurfaceGroups::current()
  void add(std::span<const std::uint64_t> corners, const FilePlace& place, std::uint32_t group);
  void add_deferred();
  void require_triangles_of_file() const;
  void add_polygon(std::span<const std::uint64_t> corners, const FilePlace& place,
                   std::uint32_t group);
  void add_triangle(const Point& a, const Point& b, const Point& c, std::uint32_t group);
  std::uint32_t current_group();

  [[noreturn]] void refuse(const FilePlace& place, const std::string& what) const {
    refuse(to_string(place) + ": " + what);
  }
  [[noreturn]] void refuse(const std::string& what) const {
    throw InputError(surface_.file + ": " + what);
  }

  IngestWatch& watch_;
  std::filesystem::path directory_;
  const DiskOf& disk_;
  RawSurface surface_;
  VertexSpill vertices_;
  DeferredPolygons deferred_;
  SurfaceGroups groups_;
  ProbePicker probes_;
  TriangleWriter writer_{surface_.spill, surface_.triangles.emplace_back()};
  std::uint64_t next_id_ = 0, first_vertex_ = 0;  // the latter of the body at hand
  // Scratch of add_polygon().
  std::vector<Point> ring_;
  std::vector<std::array<std::uint32_t, 3>> ring_triangles_;
};

void RawSurfaceBuilder::polygon(std::span<const std::uint64_t> corners, const FilePlace& place) {
  if (corners.size() < 3)
    refuse(place, fmt::format("a face has {} corners; remove it, or correct it to at least 3",
                              corners.size()));
  if (corners.size() > kMaxPolygonCorners)
    refuse(place, fmt::format("a face has {} corners, more than {}; cut it into triangles",
                              corners.size(), kMaxPolygonCorners));
  const std::uint64_t num_vertices = vertices_.size() - first_vertex_;
  if (std::ranges::all_of(corners, [&](std::uint64_t c) { return c < num_vertices; }))
    add(corners, place, current_group());
  else
    deferred_.append(corners, place, current_group());
}

void RawSurfaceBuilder::add_deferred() {
  const std::uint64_t num_vertices = vertices_.size() - first_vertex_;
  deferred_.for_each(
      [&](std::span<const std::uint64_t> corners, const FilePlace& place, std::uint32_t group) {
        for (const std::uint64_t c : corners)
          if (c >= num_vertices)
            refuse(place, fmt::format("a face names vertex {} (counted from 0), but there are only "
                                      "{}; the file is damaged",
                                      c, num_vertices));
        add(corners, place, group);
      });
}

void RawSurfaceBuilder::require_triangles_of_file() const {
  if (!surface_.files.empty() && surface_.files.back().first_triangle == next_id_)
    throw InputError(surface_.files.back().file + ": has no triangles; leave it out");
}

void RawSurfaceBuilder::body(std::string_view name, std::string_view file) {
  add_deferred();
  deferred_.clear();
  require_triangles_of_file();
  first_vertex_ = vertices_.size();
  groups_.begin_body(name);
  surface_.files.push_back({shown_name(name), std::string(file), next_id_});
}

RawSurface RawSurfaceBuilder::finish(std::string digest) {
  add_deferred();
  require_triangles_of_file();
  RawSurface surface = finish_part(vertices_.size());
  require_triangles(surface);
  require_extent(surface);
  const std::uint64_t num_triangles = surface.num_triangles();
  require_ingest_room(surface.file, num_triangles, directory_, num_triangles * sizeof(Triangle),
                      disk_);
  surface.digest = std::move(digest);
  return surface;
}

RawSurface RawSurfaceBuilder::finish_part(std::uint64_t num_numbered_vertices) {
  writer_.flush();
  surface_.num_numbered_vertices = num_numbered_vertices;
  surface_.probes = probes_.take();
  surface_.groups = groups_.take_names();
  surface_.file_of_group = groups_.take_bodies();
  if (groups_.has_cut_names())
    surface_.notes.push_back(
        fmt::format("cut names of groups to {} bytes", SurfaceGroups::kMaxNameBytes));
  return std::move(surface_);
}

std::uint32_t RawSurfaceBuilder::current_group() {
  const std::uint32_t group = groups_.current();
  if (groups_.has_too_many())
    refuse(fmt::format("has more than {} groups with names; unite some, or export it without names",
                       SurfaceGroups::kMaxGroups));
  return group;
}

void RawSurfaceBuilder::add(std::span<const std::uint64_t> corners, const FilePlace& place,
                            std::uint32_t group) {
  if (corners.size() == 3)
    add_triangle(vertices_.at(first_vertex_ + corners[0]), vertices_.at(first_vertex_ + corners[1]),
                 vertices_.at(first_vertex_ + corners[2]), group);
  else
    add_polygon(corners, place, group);
}

void RawSurfaceBuilder::add_polygon(std::span<const std::uint64_t> corners, const FilePlace& place,
                                    std::uint32_t group) {
  ring_.clear();
  for (const std::uint64_t c : corners) {
    const Point p = vertices_.at(first_vertex_ + c);
    if (ring_.empty() || ring_.back() != p) ring_.push_back(p);
  }
  while (ring_.size() > 1 && ring_.front() == ring_.back()) ring_.pop_back();
  if (ring_.size() < 3) {
    ++surface_.num_collapsed;
    return;
  }
  if (!triangulate_polygon(ring_, ring_triangles_))
    refuse(place,
           fmt::format("a face with {} corners crosses itself, seen along its normal; cut it "
                       "into triangles",
                       corners.size()));
  for (const auto& [a, b, c] : ring_triangles_) add_triangle(ring_[a], ring_[b], ring_[c], group);
}

void RawSurfaceBuilder::add_triangle(const Point& a, const Point& b, const Point& c,
                                     std::uint32_t group) {
  if (a == b || b == c || c == a) {
    ++surface_.num_collapsed;
    return;
  }
  const Triangle triangle{next_id_++, {a, b, c}, groups_.number_of(group)};
  surface_.box = triangle.id == 0 ? triangle.box() : surface_.box.joined(triangle.box());
  if (are_collinear(a, b, c)) {
    if (surface_.collinear.size() == kMaxCollinear)
      refuse(
          fmt::format("has more than {} triangles without area, for example triangle {}; remove "
                      "degenerate faces",
                      kMaxCollinear, triangle.id));
    surface_.collinear.push_back(triangle);
  }
  probes_.add(triangle);
  writer_.append(triangle);
  watch_.advance();
}

}  // namespace

void require_extent(const RawSurface& surface) {
  const auto text = [](const Point& p) { return fmt::format("({}, {}, {})", p.x, p.y, p.z); };
  const Box& box = surface.box;
  const Point size = box.max - box.min;
  const double diagonal = std::hypot(size.x, size.y, size.z);
  if (!(diagonal >= kMinDiagonal && diagonal <= kMaxDiagonal))
    refuse(surface,
           fmt::format("its bounding box, {} to {}, has a diagonal of {}, outside {} to "
                       "{}; choose another unit",
                       text(box.min), text(box.max), diagonal, kMinDiagonal, kMaxDiagonal));
  double largest = 0;
  for (int axis = 0; axis < 3; ++axis)
    largest = std::max({largest, std::abs(box.min[axis]), std::abs(box.max[axis])});
  const double step = std::nextafter(largest, std::numeric_limits<double>::infinity()) - largest;
  if (step * kMinResolution > diagonal)
    refuse(surface,
           fmt::format("lies so far from the origin ({} to {}) that its coordinates cannot tell "
                       "its points apart; move it to the origin",
                       text(box.min), text(box.max)));
}

RawSurface read_part_of_surface(SurfaceRanges& ranges, std::uint64_t part, std::uint64_t num_parts,
                                const std::filesystem::path& directory, IngestWatch& watch) {
  const DiskOf disk = disk_of;
  RawSurfaceBuilder builder(ranges.name(), directory, watch, disk);
  ranges.read_part(part, num_parts, builder);
  return builder.finish_part(ranges.num_vertices());
}

RawSurface read_surface(const SurfaceSource& source, const std::filesystem::path& directory,
                        IngestWatch& watch, const DiskOf& disk) {
  RawSurfaceBuilder builder(source.name, directory, watch, disk);
  return builder.finish(source.parse(builder, watch.stop()));
}

RawSurface read_surface(const std::filesystem::path& file, const std::filesystem::path& directory,
                        IngestWatch& watch, const DiskOf& disk) {
  return read_surface(surface_in_file(file, directory), directory, watch, disk);
}

}  // namespace locvol
