#include "engine/plan/same_run.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <bit>
#include <ctime>
#include <string>
#include <string_view>
#include <vector>

#include "engine/shared/number_text.h"
#include "engine/shared/standard_input.h"
#include "octree/mix.h"

namespace locvol {
namespace {

const char* name_of(Initialization init) {
  return init == Initialization::kCover ? "cover" : "paper";
}

// A number that tells lists of shapes apart.
std::string shapes_text(const std::vector<SizeShape>& shapes) {
  if (shapes.empty()) return "none";
  std::uint64_t hash = 0;
  for (const auto& [kind, size, a, b, radius] : shapes) {
    hash = mix(hash + static_cast<std::uint64_t>(kind));
    for (const double v : {size, radius, a.x, a.y, a.z, b.x, b.y, b.z})
      hash = mix(hash ^ std::bit_cast<std::uint64_t>(v));
  }
  return fmt::format("{} shape{} (hash {:016x})", shapes.size(), shapes.size() == 1 ? "" : "s",
                     hash);
}

std::string image_text(const RunParameters& p) {
  return p.has_image() ? "the image " + p.size_image : "no image";
}

std::string weld_text(const RunParameters& p) { return p.weld ? decimal(*p.weld) : "auto"; }

// In the user's own time.
std::string time_text(std::time_t seconds) {
  std::tm time{};
  if (localtime_r(&seconds, &time) == nullptr) return "at an unknown time";
  return fmt::format("{:%Y-%m-%d %H:%M:%S}", time);
}

// ", which has 1234 bytes and was written 2026-11-27 06:03:10"; nothing of what is no file.
std::string stamp_text(const std::string& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return {};
  return fmt::format(", which has {} bytes and was written {}", status.st_size,
                     time_text(status.st_mtime));
}

std::string began_text(std::uint64_t started) {
  return started == 0 ? "" : " at " + time_text(static_cast<std::time_t>(started));
}

std::string surface_difference(const RunRecord& held, const RunRecord& asked,
                               std::uint64_t started) {
  const std::string& file = asked.surface.file;
  if (held.surface.file != file)
    return fmt::format("its surface is {}, and not {}{}", held.surface.file, file,
                       stamp_text(file));
  if (file == kInMemory || file == kStandardInput) return "its surface is another one";
  return fmt::format("its surface was {} as it was when the run began{}, and not that of now{}",
                     file, began_text(started), stamp_text(file));
}

// What differs, an option each, with both values.
std::vector<std::string> differences(const RunRecord& held_run, const RunRecord& asked_run,
                                     std::uint64_t started) {
  const RunParameters &held = held_run.parameters, &asked = asked_run.parameters;
  std::vector<std::string> all;
  if (held.input_digest != asked.input_digest)
    all.push_back(surface_difference(held_run, asked_run, started));
  const auto compare = [&](std::string_view option, const std::string& held_value,
                           const std::string& asked_value) {
    if (held_value != asked_value)
      all.push_back(fmt::format("{} is {} in it, and {} here", option, held_value, asked_value));
  };
  compare("--size", decimal(held.size), decimal(asked.size));
  compare("the radius-edge bound", decimal(held.radius_edge_bound),
          decimal(asked.radius_edge_bound));
  compare("--min-dihedral", decimal(held.min_dihedral), decimal(asked.min_dihedral));
  compare("--spacing-floor", decimal(held.spacing_floor), decimal(asked.spacing_floor));
  compare("--leaf-capacity", std::to_string(held.leaf_capacity),
          std::to_string(asked.leaf_capacity));
  compare("--weld", weld_text(held), weld_text(asked));
  compare("--init", name_of(held.init), name_of(asked.init));
  compare("--seed", std::to_string(held.seed), std::to_string(asked.seed));
  compare("--growth", decimal(held.growth), decimal(asked.growth));
  compare("--max-size", decimal(held.max_size), decimal(asked.max_size));
  compare("--per-circle", decimal(held.per_circle), decimal(asked.per_circle));
  compare("--deviation", decimal(held.deviation), decimal(asked.deviation));
  compare("--layers", decimal(held.layers), decimal(asked.layers));
  compare("--min-size", decimal(held.min_size), decimal(asked.min_size));
  compare("--sizes", image_text(held), image_text(asked));
  compare("--sizes", shapes_text(held.shapes), shapes_text(asked.shapes));
  return all;
}

std::string state_text(const RunRecord& run) {
  if (run.phase != Phase::kDone)
    return fmt::format("which is not done, with {} cells so far", run.counts.num_cells);
  if (run.counts.num_unresolved == 0) return "which is done";
  return fmt::format("which is done, with {} unresolved sites", run.counts.num_unresolved);
}

}  // namespace

bool is_in_vain(const RunRecord& run) {
  return run.counts.num_points == 0 || (run.phase == Phase::kDone && run.counts.num_cells == 0);
}

void require_same_run(const RunRecord& held, const RunRecord& asked,
                      const std::filesystem::path& store, std::uint64_t started) {
  const std::vector<std::string> different = differences(held, asked, started);
  if (different.empty()) return;
  throw StoreMismatch(fmt::format(
      "the store {0} holds another run, {1}: {2}. Add --force to begin anew and lose that run, or "
      "name another --store to keep it; `resume {0}` {3}",
      store.string(), state_text(held), fmt::join(different, "; "),
      held.phase == Phase::kDone ? "writes its mesh again" : "goes on with it"));
}

void require_whole_run(const Store& store) {
  const auto rank = store.snapshot().rank();
  if (rank)
    throw StoreMismatch(
        fmt::format("the store {} has the part of rank {} of a run by {} processes: locvol-mpi "
                    "goes on with it, "
                    "and `locvol inspect` looks into it",
                    store.directory().string(), rank->rank, rank->first.size()));
}

}  // namespace locvol
