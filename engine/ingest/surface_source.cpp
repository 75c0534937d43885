#include "engine/ingest/surface_source.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/ingest/input_bytes.h"
#include "engine/ingest/input_file.h"
#include "engine/plan/disk_room.h"
#include "engine/shared/input_error.h"
#include "engine/shared/standard_input.h"
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
  // True: another group begins.
  bool add(const std::array<Point, 3>& corners, std::string_view group) {
    const bool begins = group != group_;
    if (begins) begin(group);
    waiting_.push_back(corners);
    if (waiting_.size() == kHashedAtOnce) flush();
    return begins;
  }
  std::string finish() {
    flush();
    return hash_.hex_digest();
  }

 private:
  // A mark that no coordinate is, and the name.
  void begin(std::string_view group) {
    flush();
    constexpr std::uint64_t kMark = 0xffffffffffffffff;  // of a double, no number
    const std::array<std::uint64_t, 2> head = {kMark, group.size()};
    hash_.update(head.data(), sizeof head);
    hash_.update(group.data(), group.size());
    group_ = group;
  }
  void flush() {
    throw_if_stopped(stop_);
    hash_.update(waiting_.data(), waiting_.size() * sizeof waiting_[0]);
    waiting_.clear();
  }

  const StopToken* stop_;
  Sha256 hash_;
  std::string group_;
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
  triangles([&](const std::array<Point, 3>& corners, std::string_view group) {
    check_finite(corners, num_triangles++);
    if (digest.add(corners, group)) sink.group(group);
    sink.facet(corners);
  });
  return digest.finish();
}

std::string digest_of_triangles(const TriangleSource& triangles, const StopToken* stop) {
  TriangleDigest digest(stop);
  triangles([&](const std::array<Point, 3>& corners, std::string_view group) {
    digest.add(corners, group);
  });
  return digest.finish();
}

using OpenInput = std::function<InputBytes(const StopToken* stop)>;

// Opened anew each time, but for what can be read only once.
SurfaceSource source_of_input(std::string name, std::filesystem::path file, const OpenInput& open) {
  const auto copy = std::make_shared<std::shared_ptr<const InputBytes>>();
  const auto bytes = [open, copy](const StopToken* stop) {
    if (*copy) return *copy;
    auto opened = std::make_shared<const InputBytes>(open(stop));
    if (opened->is_copy()) *copy = opened;
    return opened;
  };
  return {std::move(name), std::move(file),
          [bytes](SurfaceSink& sink, const StopToken* stop) {
            return parse_surface(bytes(stop), sink, stop);
          },
          [bytes](const StopToken* stop) { return InputFile(bytes(stop), stop).digest(); },
          [copy] { copy->reset(); }};
}

}  // namespace

SurfaceSource surface_in_file(const std::filesystem::path& file,
                              const std::filesystem::path& directory) {
  return source_of_input(file.string(), file, [file, directory](const StopToken* stop) {
    return InputBytes(file, existing_directory(directory), stop);
  });
}

SurfaceSource surface_in_standard_input(const std::filesystem::path& directory) {
  return source_of_input(kStandardInput, {}, [directory](const StopToken* stop) {
    return InputBytes::of_standard_input(existing_directory(directory), stop);
  });
}

SurfaceSource surface_at(const std::filesystem::path& input,
                         const std::filesystem::path& directory) {
  return input == kFromStandardInput ? surface_in_standard_input(directory)
                                     : surface_in_file(input, directory);
}

namespace {

// Begins what is hashed, so that no file has the digest of several.
constexpr std::string_view kDigestOfFiles = "locvol bodies\n";

// Without the extension, and that of a packed file.
std::string body_name(const std::filesystem::path& file) {
  const std::filesystem::path name = file.filename();
  return name.extension() == ".gz" ? name.stem().stem().string() : name.stem().string();
}

struct BodyFile {
  std::string body, file;
  SurfaceSource source;
};

std::string digest_of_files(const std::vector<BodyFile>& files,
                            const std::vector<std::string>& digests) {
  Sha256 hash;
  hash.update(kDigestOfFiles.data(), kDigestOfFiles.size());
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::string line = digests[i] + ' ' + files[i].body + '\n';
    hash.update(line.data(), line.size());
  }
  return hash.hex_digest();
}

SurfaceSource surface_in_files(std::vector<BodyFile> bodies) {
  std::vector<std::string> names;
  for (const BodyFile& body : bodies) names.push_back(body.file);
  const auto files = std::make_shared<const std::vector<BodyFile>>(std::move(bodies));
  return {fmt::format("{}", fmt::join(names, ", ")),
          {},
          [files](SurfaceSink& sink, const StopToken* stop) {
            std::vector<std::string> digests;
            for (const auto& [body, file, source] : *files) {
              sink.body(body, file);
              digests.push_back(source.parse(sink, stop));
            }
            return digest_of_files(*files, digests);
          },
          [files](const StopToken* stop) {
            std::vector<std::string> digests;
            for (const BodyFile& body : *files) digests.push_back(body.source.digest(stop));
            return digest_of_files(*files, digests);
          },
          [files] {
            for (const BodyFile& body : *files) body.source.release();
          }};
}

}  // namespace

SurfaceSource surface_at(const std::filesystem::path& input,
                         const std::vector<std::filesystem::path>& others,
                         const std::filesystem::path& directory) {
  if (others.empty()) return surface_at(input, directory);
  std::vector<BodyFile> bodies;
  const auto add = [&](const std::filesystem::path& file) {
    if (file == kFromStandardInput)
      throw InputError("the standard input is one surface: of several bodies give the files");
    for (const BodyFile& body : bodies) {
      std::error_code is_not_there;
      if (std::filesystem::equivalent(body.file, file, is_not_there))
        throw InputError(file.string() + ": this file is given twice; give each body once");
    }
    bodies.push_back({body_name(file), file.string(), surface_in_file(file, directory)});
  };
  add(input);
  for (const std::filesystem::path& file : others) add(file);
  return surface_in_files(std::move(bodies));
}

SurfaceSource surface_in_memory(TriangleSource triangles) {
  return {kInMemory,
          {},
          [triangles](SurfaceSink& sink, const StopToken* stop) {
            return parse_triangles(triangles, sink, stop);
          },
          [triangles](const StopToken* stop) { return digest_of_triangles(triangles, stop); }};
}

}  // namespace locvol
