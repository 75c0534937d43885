#include "engine/ingest/cad_file.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "engine/ingest/gzip_reader.h"
#include "engine/ingest/input_file.h"
#include "engine/ingest/sha256.h"
#include "engine/ingest/surface_groups.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/partial_file.h"
#include "octree/geometry.h"

namespace locvol {
namespace {

constexpr std::string_view kDigestPrefix = "locvol faces\n";  // so that no mesh has the same

std::string_view format_name(CadFormat format) {
  switch (format) {
    case CadFormat::kStep:
      return "STEP";
    case CadFormat::kIges:
      return "IGES";
    case CadFormat::kBrep:
      break;
  }
  return "BREP";
}

// The module's file, beside the program as it is installed or built; or the one that the
// environment names.
std::vector<std::filesystem::path> module_places() {
  if (const char* given = std::getenv("LOCVOL_CAD_MODULE")) return {given};
  std::vector<std::filesystem::path> places;
  std::error_code unknown;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", unknown);
  if (!unknown)
    for (const char* folder : {LOCVOL_LIBDIR, "lib"})
      places.push_back(program.parent_path().parent_path() / folder / "locvol" / kCadFile);
  places.push_back(std::filesystem::path(LOCVOL_FULL_LIBDIR) / "locvol" / kCadFile);
  return places;
}

// Loaded once, for good. Nothing: what is wrong is told in `obstacle`.
const CadModule* load_module(std::string& obstacle) {
  for (const std::filesystem::path& place : module_places()) {
    std::error_code absent;
    if (!std::filesystem::exists(place, absent)) continue;
    void* const library = dlopen(place.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
      obstacle = dlerror();
      continue;
    }
    const auto entry = reinterpret_cast<const CadModule* (*)()>(dlsym(library, kCadEntry));
    if (entry == nullptr || entry()->version != kCadVersion)
      obstacle = place.string() + " is of another version";
    else
      return entry();
  }
  return nullptr;
}

const CadModule& module_for(const InputBytes& bytes, CadFormat format) {
  static std::string obstacle;
  static const CadModule* const module = load_module(obstacle);
  if (module == nullptr)
    bytes.refuse(fmt::format(
        "is a {} file, which the package locvol-cad reads, and that is not installed: install it "
        "(apt install ./locvol-cad_*.deb), or export the model as STL{}",
        format_name(format), obstacle.empty() ? "" : ". (" + obstacle + ")"));
  return *module;
}

// What comes through the module's calls, which nothing may be thrown through.
template <class Face>
class Guarded : public Face {
 public:
  explicit Guarded(const StopToken* stop) : stop_(stop) {}
  bool may_go_on() override { return stop_ == nullptr || !stop_->is_stopped(); }
  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 protected:
  template <class Work>
  bool guarded(const Work& work) {
    try {
      work();
      return may_go_on();
    } catch (...) {
      error_ = std::current_exception();
      return false;
    }
  }

 private:
  const StopToken* stop_;
  std::exception_ptr error_;
};

class NotesTaken : public Guarded<CadWatch> {
 public:
  NotesTaken(std::vector<std::string>& notes, const StopToken* stop)
      : Guarded(stop), notes_(notes) {}
  bool note(const std::string& text) override {
    return guarded([&] { notes_.push_back(text); });
  }

 private:
  std::vector<std::string>& notes_;
};

class FacesTaken : public Guarded<CadSink> {
 public:
  FacesTaken(SurfaceSink& sink, const std::string& file, const CadCut& cut, const CadFacts& facts,
             const StopToken* stop)
      : Guarded(stop),
        sink_(sink),
        file_(file),
        has_bodies_(cut.has_bodies && facts.num_bodies > 1),
        has_numbers_(facts.num_faces <= SurfaceGroups::kMaxGroups) {}

  bool note(const std::string& text) override {
    return guarded([&] { sink_.note(text); });
  }
  bool body(const std::string& name) override {
    if (!has_bodies_) return may_go_on();
    ++num_bodies_;
    return guarded(
        [&] { sink_.body(name.empty() ? fmt::format("body {}", num_bodies_) : name, file_); });
  }
  bool face(const std::string& name, const CadColor* color) override {
    ++num_faces_;
    return guarded([&] {
      if (!name.empty() || !has_numbers_)
        sink_.group(name);
      else
        sink_.group(fmt::format("face {}", num_faces_));
      if (color != nullptr) sink_.color({color->red, color->green, color->blue});
    });
  }
  bool triangles(std::span<const std::array<double, 9>> triangles) override {
    return guarded([&] {
      for (const std::array<double, 9>& c : triangles) {
        if (!std::ranges::all_of(c, [](double v) { return std::isfinite(v); }))
          throw InputError(
              fmt::format("{}: face {} has a point that is not finite; repair it in a "
                          "CAD program",
                          file_, num_faces_));
        sink_.facet({Point{c[0], c[1], c[2]}, Point{c[3], c[4], c[5]}, Point{c[6], c[7], c[8]}});
      }
    });
  }

 private:
  SurfaceSink& sink_;
  const std::string& file_;
  bool has_bodies_, has_numbers_;
  std::uint64_t num_bodies_ = 0, num_faces_ = 0;
};

void require_done(const CadResult& result, const InputBytes& bytes) {
  switch (result.kind) {
    case CadResult::Kind::kDone:
      return;
    case CadResult::Kind::kStopped:
      throw Stopped();
    case CadResult::Kind::kRefused:
      bytes.refuse(result.what);
    case CadResult::Kind::kOutOfMemory:
      throw std::bad_alloc();
  }
}

// What a file takes once it is read, and while it is: measured, see README.md.
void require_memory(const InputBytes& bytes, std::uint64_t num_bytes, CadFormat format,
                    std::uint64_t cap) {
  constexpr std::uint64_t kModule = std::uint64_t{64} << 20;
  const std::uint64_t needed = kModule + (format == CadFormat::kBrep ? 10 : 25) * num_bytes;
  if (cap == 0 || needed <= cap) return;
  throw OverBudget(
      fmt::format("{}: its {} bytes may take {} MiB of memory while they are read, but the cap is "
                  "{} MiB; raise it, by --memory {}M",
                  bytes.path().string(), num_bytes, (needed >> 20) + 1, cap >> 20,
                  (needed >> 20) + 1),
      needed);
}

// What the module is to open of what is packed, or came through a pipe.
OpenFile copied(InputFile& file, const std::filesystem::path& directory) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 18;
  OpenFile copy = OpenFile::temporary(directory / "locvol-cad");
  std::uint64_t place = 0;
  for (std::string_view next = file.peek(kAtOnce); !next.empty(); next = file.peek(kAtOnce)) {
    const std::size_t count = next.size();
    copy.write_at(place, std::as_bytes(std::span(next)));
    place += count;
    file.take(count);
  }
  return copy;
}

bool is_iges(std::string_view head) {
  constexpr std::size_t kLine = 80, kSection = 72;
  const std::string_view line = head.substr(0, head.find_first_of("\r\n"));
  if (line.size() != kLine || line[kSection] != 'S') return false;
  const std::string_view number = line.substr(kSection + 1);
  return number.ends_with('1') && std::ranges::all_of(number.substr(0, number.size() - 1),
                                                      [](char c) { return c == ' ' || c == '0'; });
}

}  // namespace

std::optional<CadFormat> cad_format_of(std::string_view head) {
  if (is_iges(head)) return CadFormat::kIges;
  for (bool is_comment = true; is_comment;) {
    while (!head.empty() && std::isspace(static_cast<unsigned char>(head.front())))
      head.remove_prefix(1);
    const std::size_t end = head.starts_with("/*") ? head.find("*/") : head.npos;
    is_comment = end != head.npos;
    if (is_comment) head.remove_prefix(end + 2);
  }
  if (head.starts_with("ISO-10303-21")) return CadFormat::kStep;
  if (head.starts_with("DBRep_DrawableShape") || head.starts_with("CASCADE Topology V"))
    return CadFormat::kBrep;
  return std::nullopt;
}

std::optional<CadFormat> cad_format_of(const std::shared_ptr<const InputBytes>& bytes) {
  constexpr std::size_t kHeadBytes = 4096;
  return cad_format_of(InputFile(bytes).peek(kHeadBytes));
}

std::string digest_of_cad(const std::shared_ptr<const InputBytes>& bytes, const StopToken* stop) {
  Sha256 hash;
  hash.update(kDigestPrefix.data(), kDigestPrefix.size());
  const std::string of_bytes = InputFile(bytes, stop).digest();
  hash.update(of_bytes.data(), of_bytes.size());
  return hash.hex_digest();
}

CadFile::CadFile(std::shared_ptr<const InputBytes> bytes, CadFormat format,
                 const std::filesystem::path& directory, std::uint64_t cap, const StopToken* stop)
    : bytes_(std::move(bytes)), digest_(digest_of_cad(bytes_, stop)) {
  const CadModule& module = module_for(*bytes_, format);
  InputFile file(bytes_, stop);
  require_memory(*bytes_, file.size(), format, cap);
  std::optional<OpenFile> copy;
  std::string path = bytes_->path();
  if (file.is_unpacked() || bytes_->is_copy()) {
    copy.emplace(copied(file, directory));
    path = fmt::format("/proc/self/fd/{}", copy->descriptor());
  }
  NotesTaken watch(notes_, stop);
  const CadResult result = module.read(path.c_str(), format, watch, model_);
  watch.rethrow();
  require_done(result, *bytes_);
}

void CadFile::parse(const CadCut& cut, SurfaceSink& sink, const StopToken* stop) {
  const std::string file = bytes_->path().string();
  for (const std::string& note : notes_) sink.note(note);
  const CadFacts& known = facts();
  if (!known.unit.empty()) sink.note(fmt::format("lengths are in the file's unit, {}", known.unit));
  if (known.num_faces > SurfaceGroups::kMaxGroups)
    sink.note(fmt::format("has {} faces, more than {}: those without a name get none",
                          known.num_faces, SurfaceGroups::kMaxGroups));
  FacesTaken taken(sink, file, cut, known, stop);
  const CadResult result = model_->triangulate(cut.law, taken);
  taken.rethrow();
  require_done(result, *bytes_);
}

}  // namespace locvol
