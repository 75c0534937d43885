#include "engine/ingest/surface_source.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/ingest/cad_file.h"
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

// An input's bytes, opened anew each time, but for what can be read only once; and of a CAD file,
// its bodies.
class InputState {
 public:
  InputState(OpenInput open, std::filesystem::path directory)
      : open_(std::move(open)), directory_(std::move(directory)) {}

  std::string parse(SurfaceSink& sink, const StopToken* stop) {
    if (CadFile* const file = cad_file(0, stop)) {
      file->parse(cut_, sink, stop);
      return file->digest();
    }
    return parse_surface(bytes(stop), sink, stop);
  }
  std::string digest(const StopToken* stop) {
    if (cad_) return cad_->digest();
    const auto opened = bytes(stop);
    return cad_format_of(opened) ? digest_of_cad(opened, stop) : InputFile(opened, stop).digest();
  }
  // Null: it is none.
  CadFile* cad_file(std::uint64_t cap, const StopToken* stop) {
    if (cad_) return &*cad_;
    const auto opened = bytes(stop);
    if (const auto format = cad_format_of(opened))
      cad_.emplace(opened, *format, existing_directory(directory_), cap, stop);
    return cad_ ? &*cad_ : nullptr;
  }
  void cut_faces(const CadCut& cut) { cut_ = cut; }
  void release() {
    copy_.reset();
    cad_.reset();
  }

 private:
  std::shared_ptr<const InputBytes> bytes(const StopToken* stop) {
    if (copy_) return copy_;
    auto opened = std::make_shared<const InputBytes>(open_(stop));
    if (opened->is_copy()) copy_ = opened;
    return opened;
  }

  OpenInput open_;
  std::filesystem::path directory_;
  std::shared_ptr<const InputBytes> copy_;
  std::optional<CadFile> cad_;
  CadCut cut_;
};

Box box_of(const CadFacts& facts) {
  return {{facts.min[0], facts.min[1], facts.min[2]}, {facts.max[0], facts.max[1], facts.max[2]}};
}

SurfaceSource source_of_input(std::string name, std::filesystem::path file,
                              const std::filesystem::path& directory, const OpenInput& open) {
  const auto state = std::make_shared<InputState>(open, directory);
  return {.name = std::move(name),
          .file = std::move(file),
          .parse = [state](SurfaceSink& sink,
                           const StopToken* stop) { return state->parse(sink, stop); },
          .digest = [state](const StopToken* stop) { return state->digest(stop); },
          .release = [state] { state->release(); },
          .curved =
              [state](std::uint64_t cap, const StopToken* stop) {
                const CadFile* const cad = state->cad_file(cap, stop);
                return cad == nullptr ? std::nullopt
                                      : std::optional(CurvedFaces{box_of(cad->facts()),
                                                                  cad->facts().num_bodies});
              },
          .cut_faces = [state](const CadCut& cut) { state->cut_faces(cut); }};
}

}  // namespace

SurfaceSource surface_in_file(const std::filesystem::path& file,
                              const std::filesystem::path& directory) {
  return source_of_input(file.string(), file, directory, [file, directory](const StopToken* stop) {
    return InputBytes(file, existing_directory(directory), stop);
  });
}

SurfaceSource surface_in_standard_input(const std::filesystem::path& directory) {
  return source_of_input(kStandardInput, {}, directory, [directory](const StopToken* stop) {
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

// The box of what is parsed.
class BoxSink : public SurfaceSink {
 public:
  void vertex(const Point& position) override { add(position); }
  void polygon(std::span<const std::uint64_t>, const FilePlace&) override {}
  void facet(const std::array<Point, 3>& corners) override {
    for (const Point& p : corners) add(p);
  }
  std::optional<Box> box;

 private:
  void add(const Point& p) { box = box ? box->joined({p, p}) : Box{p, p}; }
};

// If one has curved faces; the box is of all.
std::optional<CurvedFaces> curved_faces(const std::vector<BodyFile>& files, std::uint64_t cap,
                                        const StopToken* stop) {
  std::vector<const SurfaceSource*> others;
  BoxSink all;
  std::uint64_t num_bodies = 0;
  for (const BodyFile& file : files) {
    const auto curved = file.source.curved(cap, stop);
    if (!curved) {
      others.push_back(&file.source);
      continue;
    }
    num_bodies += curved->num_bodies;
    all.box = all.box ? all.box->joined(curved->box) : curved->box;
  }
  if (others.size() == files.size()) return std::nullopt;
  for (const SurfaceSource* other : others) other->parse(all, stop);
  return CurvedFaces{*all.box, num_bodies + others.size()};
}

// A file of several bodies tells of each itself.
bool has_own_bodies(const SurfaceSource& source, const StopToken* stop) {
  const auto curved = source.curved(0, stop);
  return curved && curved->num_bodies > 1;
}

SurfaceSource surface_in_files(std::vector<BodyFile> bodies) {
  std::vector<std::string> names;
  for (const BodyFile& body : bodies) names.push_back(body.file);
  const auto files = std::make_shared<const std::vector<BodyFile>>(std::move(bodies));
  return {.name = fmt::format("{}", fmt::join(names, ", ")),
          .file = {},
          .parse =
              [files](SurfaceSink& sink, const StopToken* stop) {
                std::vector<std::string> digests;
                for (const auto& [body, file, source] : *files) {
                  if (!has_own_bodies(source, stop)) sink.body(body, file);
                  digests.push_back(source.parse(sink, stop));
                }
                return digest_of_files(*files, digests);
              },
          .digest =
              [files](const StopToken* stop) {
                std::vector<std::string> digests;
                for (const BodyFile& body : *files) digests.push_back(body.source.digest(stop));
                return digest_of_files(*files, digests);
              },
          .release =
              [files] {
                for (const BodyFile& body : *files) body.source.release();
              },
          .curved = [files](std::uint64_t cap,
                            const StopToken* stop) { return curved_faces(*files, cap, stop); },
          .cut_faces =
              [files](const CadCut& cut) {
                for (const BodyFile& body : *files) body.source.cut_faces(cut);
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
  return {.name = kInMemory,
          .file = {},
          .parse = [triangles](
                       SurfaceSink& sink,
                       const StopToken* stop) { return parse_triangles(triangles, sink, stop); },
          .digest =
              [triangles](const StopToken* stop) { return digest_of_triangles(triangles, stop); }};
}

}  // namespace locvol
