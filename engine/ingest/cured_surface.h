// A surface that cannot be meshed as it is, cured in memory: see refine/cure/cure_surface.h.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/ingest/ingest_watch.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_source.h"
#include "engine/plan/options.h"
#include "engine/shared/workers.h"
#include "refine/cure/cure_surface.h"

namespace locvol {

struct CuredSurface {
  LooseSurface surface;
  std::vector<std::string> groups;  // names, see RawSurface
  SurfaceFacts facts;               // of the surface as it is now
  std::uint64_t num_before = 0;     // triangles
  RepairChanges changes;            // of what is repaired
  double alpha = 0, offset = 0;     // of what is wrapped
};

// Unless it is given, points at open edges are joined that are closer than a tenth of the shortest
// of these edges, and than this part of the longest side of the box.
inline constexpr double kMostWeld = 1e-4;

// Read, repaired, and checked as any surface that is to be meshed. Temporary files are made in
// `directory`. Throws InputError: it cannot be read, or repaired, or what comes of it cannot be
// meshed; OverBudget: `cap` is less than that may take; as read_surface() and check_surface().
CuredSurface repaired_surface(const SurfaceSource& source, const std::optional<Size>& weld,
                              const std::filesystem::path& directory, std::uint64_t cap,
                              IngestWatch& watch, Workers& workers);
// Read, wrapped and checked. Unless they are given, alpha is a 50th of the longest side of the box,
// and the offset a 30th of alpha. Throws as the former.
CuredSurface wrapped_surface(const SurfaceSource& source, const std::optional<Size>& alpha,
                             const std::optional<Size>& offset,
                             const std::filesystem::path& directory, std::uint64_t cap,
                             IngestWatch& watch, Workers& workers);

// How a surface is wrapped that is to be meshed. Lengths of value 0: as of wrapped_surface().
struct WrapLaw {
  Size alpha = {}, offset = {};
  std::uint64_t cap = 0;  // of memory
};
// What a run takes in: the source; or, if `inside` says so, what wraps it, which is made in memory
// whenever it is parsed, and is one file to nobody. The digest is the source's. Then parse() throws
// as wrapped_surface().
SurfaceSource source_to_mesh(const SurfaceSource& source, InsideRule inside, const WrapLaw& law,
                             const std::filesystem::path& directory);

// As .stl (text, a solid for each group), .obj (a group for each) or .ply (binary, by numbers of
// groups); coordinates with all their digits.
void write_surface(const CuredSurface& surface, const std::filesystem::path& file);

}  // namespace locvol
