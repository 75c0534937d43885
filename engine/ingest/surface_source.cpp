#include "engine/ingest/surface_source.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/input_file.h"
#include "engine/shared/input_error.h"
#include "storage/records.h"

namespace locvol {
namespace {

// Begins what is hashed, so that no file has the digest of a surface in memory.
constexpr std::string_view kDigestPrefix = "locvol triangles\n";
constexpr std::size_t kHashedAtOnce = 256;  // triangles

class TriangleDigest {
 public:
  explicit TriangleDigest(const StopToken* stop) : stop_(stop) {
    hash_.update(kDigestPrefix.data(), kDigestPrefix.size());
    waiting_.reserve(kHashedAtOnce);
  }
  void add(const std::array<Point, 3>& corners) {
    waiting_.push_back(corners);
    if (waiting_.size() == kHashedAtOnce) flush();
  }
  std::string finish() {
    flush();
    return hash_.hex_digest();
  }

 private:
  void flush() {
    throw_if_stopped(stop_);
    hash_.update(waiting_.data(), waiting_.size() * sizeof waiting_[0]);
    waiting_.clear();
  }

  const StopToken* stop_;
  Sha256 hash_;
  std::vector<std::array<Point, 3>> waiting_;
};

void check_finite(const std::array<Point, 3>& corners, std::uint64_t triangle) {
  for (const Point& p : corners)
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
      throw InputError(
          fmt::format("{}: triangle {} (counted from 0) has a corner at ({}, {}, {}), which is not "
                      "finite; remove the triangle, then close the hole",
                      kInMemory, triangle, p.x, p.y, p.z));
}

std::string parse_triangles(const TriangleSource& triangles, SurfaceSink& sink,
                            const StopToken* stop) {
  TriangleDigest digest(stop);
  std::uint64_t num_triangles = 0;
  triangles([&](const std::array<Point, 3>& corners) {
    check_finite(corners, num_triangles++);
    digest.add(corners);
    sink.facet(corners);
  });
  return digest.finish();
}

std::string digest_of_triangles(const TriangleSource& triangles, const StopToken* stop) {
  TriangleDigest digest(stop);
  triangles([&](const std::array<Point, 3>& corners) { digest.add(corners); });
  return digest.finish();
}

}  // namespace

SurfaceSource surface_in_file(const std::filesystem::path& file) {
  return {
      file.string(),
      [file](SurfaceSink& sink, const StopToken* stop) { return parse_surface(file, sink, stop); },
      [file](const StopToken* stop) { return digest_of_file(file, stop); }};
}

SurfaceSource surface_in_memory(TriangleSource triangles) {
  return {kInMemory,
          [triangles](SurfaceSink& sink, const StopToken* stop) {
            return parse_triangles(triangles, sink, stop);
          },
          [triangles](const StopToken* stop) { return digest_of_triangles(triangles, stop); }};
}

}  // namespace locvol
