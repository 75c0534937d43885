#include "engine/ingest/cured_surface.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <span>
#include <string_view>
#include <utility>

#include "engine/ingest/loose_surface.h"
#include "engine/plan/run_setup.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/partial_file.h"

namespace locvol {
namespace {

// Bytes at the peak, measured; see README.md. What reads and checks takes the rest.
constexpr std::uint64_t kCheckBytes = std::uint64_t{64} << 20;
constexpr std::uint64_t kRepairBytes = 700;       // of a triangle
constexpr std::uint64_t kWrapInputBytes = 500;    // of a triangle that is wrapped
constexpr std::uint64_t kWrapOutputBytes = 1500;  // of one that comes of it
constexpr double kWrapTriangles = 16;             // times area over alpha²

void require_memory(const std::string& file, const char* what, double bytes, std::uint64_t cap) {
  if (bytes <= static_cast<double>(cap)) return;
  const double mib = std::ceil(bytes / (1 << 20));
  throw OverBudget(fmt::format("{}: to {} it may take {:.0f} MiB of memory, but the cap is {} MiB; "
                               "raise it, by --memory {:.0f}M{}",
                               file, what, mib, cap >> 20, mib,
                               std::string_view(what) == "wrap" ? ", or give a larger alpha" : ""),
                   static_cast<std::uint64_t>(bytes));
}

// Those of the result, which has to be a surface that can be meshed.
SurfaceFacts check(const std::string& file, const CuredSurface& cured, const char* done,
                   const std::filesystem::path& directory, IngestWatch& watch, Workers& workers) {
  const LooseSurface& s = cured.surface;
  const SurfaceSource source = surface_in_memory([&](const TriangleVisitor& visit) {
    for (const auto& [a, b, c] : s.triangles)
      visit({s.vertices[a], s.vertices[b], s.vertices[c]}, {});
  });
  try {
    RawSurface raw = read_surface(source, directory, watch);
    const Frame frame = frame_of(raw.box);
    SurfaceFacts facts =
        check_surface(std::move(raw), frame, watch, workers, kBucketCapacity, IngestShare(), 0.0)
            .facts;
    facts.file = file;
    return facts;
  } catch (const InputError& error) {
    std::string_view what = error.what();
    if (const std::string name = source.name + ": "; what.starts_with(name))
      what.remove_prefix(name.size());
    throw InputError(fmt::format("{}: {}, it would still be wrong: {}", file, done, what));
  }
}

}  // namespace

CuredSurface repaired_surface(const SurfaceSource& source, const std::optional<Size>& weld,
                              const std::filesystem::path& directory, std::uint64_t cap,
                              IngestWatch& watch, Workers& workers) {
  CuredSurface cured;
  RepairLaw law;
  LooseSurface before;
  {
    RawSurface raw = read_surface(source, directory, watch);
    cured.num_before = raw.num_triangles();
    require_memory(source.name, "repair",
                   static_cast<double>(kCheckBytes + kRepairBytes * cured.num_before), cap);
    law.weld = kMostWeld * max_norm(raw.box.max - raw.box.min);
    law.is_weld_given = weld.has_value();
    if (weld) law.weld = *weld_length(weld, raw.box);
    before = loose_surface(raw.spill, raw.triangles);
    cured.groups = std::move(raw.groups);
  }
  try {
    cured.surface = repair_surface(std::move(before), law, cured.changes);
    cured.facts = check(source.name, cured, "repaired", directory, watch, workers);
  } catch (const CureError& error) {
    throw InputError(
        fmt::format("{}: cannot be repaired: {}; wrap it, by locvol wrap {} -o "
                    "WRAPPED.ply",
                    source.name, error.what(), source.name));
  } catch (const InputError& error) {
    throw InputError(
        fmt::format("{}; wrap it, by locvol wrap {} -o WRAPPED.ply", error.what(), source.name));
  }
  return cured;
}

namespace {

struct Wrapped {
  CuredSurface cured;  // without facts
  std::string digest;  // of the source
};

Wrapped wrapped(const SurfaceSource& source, const std::optional<Size>& alpha,
                const std::optional<Size>& offset, const std::filesystem::path& directory,
                std::uint64_t cap, IngestWatch& watch) {
  constexpr double kAlphaShare = 50, kOffsetShare = 30;
  Wrapped result;
  CuredSurface& cured = result.cured;
  LooseSurface before;
  {
    RawSurface raw = read_surface(source, directory, watch);
    result.digest = raw.digest;
    cured.num_before = raw.num_triangles();
    cured.alpha = alpha ? absolute_size(*alpha, raw.box, "alpha")
                        : max_norm(raw.box.max - raw.box.min) / kAlphaShare;
    cured.offset = offset ? absolute_size(*offset, raw.box, "offset") : cured.alpha / kOffsetShare;
    double area = 0;
    for (const TriangleList& list : raw.triangles)
      raw.spill.for_each(list, [&](const Triangle& t) {
        area += 0.5 * norm(cross(t.corners[1] - t.corners[0], t.corners[2] - t.corners[0]));
      });
    const double num_after = kWrapTriangles * area / (cured.alpha * cured.alpha);
    require_memory(source.name, "wrap",
                   static_cast<double>(kCheckBytes + kWrapInputBytes * cured.num_before) +
                       static_cast<double>(kWrapOutputBytes) * num_after,
                   cap);
    before = loose_surface(raw.spill, raw.triangles);
  }
  cured.surface = wrap_surface(before.vertices, before.triangles, cured.alpha, cured.offset);
  if (cured.surface.triangles.empty())
    throw InputError(
        fmt::format("{}: wrapped with alpha {}, nothing is left of it; give a smaller alpha",
                    source.name, cured.alpha));
  return result;
}

std::optional<Size> unless_zero(const Size& size) {
  return size.value == 0 ? std::nullopt : std::optional(size);
}

}  // namespace

CuredSurface wrapped_surface(const SurfaceSource& source, const std::optional<Size>& alpha,
                             const std::optional<Size>& offset,
                             const std::filesystem::path& directory, std::uint64_t cap,
                             IngestWatch& watch, Workers& workers) {
  CuredSurface cured = wrapped(source, alpha, offset, directory, cap, watch).cured;
  cured.facts = check(source.name, cured, "wrapped", directory, watch, workers);
  return cured;
}

SurfaceSource source_to_mesh(const SurfaceSource& source, InsideRule inside, const WrapLaw& law,
                             const std::filesystem::path& directory) {
  if (inside != InsideRule::kWrap) return source;
  SurfaceSource wrap = source;
  wrap.file.clear();
  wrap.parse = [source, law, directory](SurfaceSink& sink, const StopToken* stop) {
    const StopSource asked([stop] { return stop != nullptr && stop->is_stopped(); });
    IngestWatch watch(&asked, {});
    const auto [cured, digest] = wrapped(source, unless_zero(law.alpha), unless_zero(law.offset),
                                         existing_directory(directory), law.cap, watch);
    sink.note(fmt::format("wrapped {} triangles, with alpha {:.4g} and offset {:.4g}",
                          cured.num_before, cured.alpha, cured.offset));
    const LooseSurface& s = cured.surface;
    sink.announce(s.triangles.size());
    for (const auto& [a, b, c] : s.triangles)
      sink.facet({s.vertices[a], s.vertices[b], s.vertices[c]});
    return digest;
  };
  return wrap;
}

// ---- Files

namespace {

class SurfaceWriter {
 public:
  SurfaceWriter(const CuredSurface& cured, const std::filesystem::path& file)
      : surface_(cured.surface), names_(cured.groups), file_(file), out_(file_, 0) {}

  void write(const std::string& extension) {
    if (extension == ".stl")
      write_stl();
    else if (extension == ".obj")
      write_obj();
    else
      write_ply();
    out_.flush();
    file_.publish();
  }

 private:
  void put(std::string_view text) { out_.append(std::as_bytes(std::span(text))); }
  bool has_groups() const { return names_.size() > 1 && !surface_.groups.empty(); }
  SheetId group(std::size_t t) const { return has_groups() ? surface_.groups[t] : 1; }
  std::string name(SheetId group) const {
    return group >= 1 && group <= names_.size() ? names_[group - 1] : "";
  }

  // Groups come one after another.
  void write_stl() {
    const auto num_groups = static_cast<SheetId>(has_groups() ? names_.size() : 1);
    for (SheetId g = 1; g <= num_groups; ++g) {
      put(fmt::format("solid {}\n", name(g)));
      for (std::size_t t = 0; t < surface_.triangles.size(); ++t) {
        if (group(t) != g) continue;
        put("facet normal 0 0 0\nouter loop\n");
        for (const std::uint32_t v : surface_.triangles[t]) {
          const Point& p = surface_.vertices[v];
          put(fmt::format("vertex {} {} {}\n", p.x, p.y, p.z));
        }
        put("endloop\nendfacet\n");
      }
      put(fmt::format("endsolid {}\n", name(g)));
    }
  }

  void write_obj() {
    for (const Point& p : surface_.vertices) put(fmt::format("v {} {} {}\n", p.x, p.y, p.z));
    SheetId last = 0;
    for (std::size_t t = 0; t < surface_.triangles.size(); ++t) {
      if (group(t) != last) put(fmt::format("g {}\n", name(group(t))));
      last = group(t);
      const auto& [a, b, c] = surface_.triangles[t];
      put(fmt::format("f {} {} {}\n", a + 1, b + 1, c + 1));
    }
  }

  void write_ply() {
    put(
        fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\n"
                    "property double y\nproperty double z\nelement face {}\nproperty list uchar "
                    "uint vertex_indices\n{}end_header\n",
                    surface_.vertices.size(), surface_.triangles.size(),
                    has_groups() ? "property uint group\n" : ""));
    for (const Point& p : surface_.vertices)
      for (const double c : {p.x, p.y, p.z}) out_.append_value(c);
    for (std::size_t t = 0; t < surface_.triangles.size(); ++t) {
      out_.append_value(std::uint8_t{3});
      for (const std::uint32_t v : surface_.triangles[t]) out_.append_value(v);
      if (has_groups()) out_.append_value(group(t));
    }
  }

  const LooseSurface& surface_;
  const std::vector<std::string>& names_;
  PartialFile file_;
  FileSection out_;
};

}  // namespace

void write_surface(const CuredSurface& surface, const std::filesystem::path& file) {
  SurfaceWriter(surface, file).write(file.extension().string());
}

}  // namespace locvol
