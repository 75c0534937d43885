#include "engine/plan/same_run.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <bit>
#include <ctime>
#include <optional>
#include <string>
#include <vector>

#include "engine/plan/option_table.h"
#include "engine/shared/number_text.h"
#include "engine/shared/standard_input.h"
#include "octree/mix.h"

namespace locvol {
namespace {

// What tells the values of a parameter apart, and people read. Of shapes it is a number, and so it
// is of a file.
std::string text_of(double value) { return decimal(value); }
std::string text_of(std::uint64_t value) { return std::to_string(value); }
std::string text_of(Initialization init) { return std::string(init_name(init)); }
std::string text_of(InsideRule inside) { return std::string(inside_name(inside)); }
std::string text_of(const std::optional<double>& weld) { return weld ? decimal(*weld) : "auto"; }
std::string text_of(const std::vector<SizeShape>& shapes) {
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

std::string text_of(bool value) { return value ? "given" : "not given"; }
std::string text_of(const std::vector<std::string>& names) {
  return names.empty() ? "for no body" : fmt::format("{}", fmt::join(names, ", "));
}
template <class Value>
std::string text_of(const OptionText&, const Value& value) {
  return text_of(value);
}
std::string text_of(const OptionText& option, const std::vector<PartSize>& parts) {
  if (parts.empty()) return fmt::format("for no {}", option.noun);
  std::vector<std::string> all;
  for (const auto& [name, size] : parts)
    all.push_back(fmt::format("{} at {}", decimal(size), name));
  return fmt::format("{}", fmt::join(all, ", "));
}
std::string text_of(const OptionText& option, const std::string& digest) {
  return digest.empty() ? fmt::format("no {}", option.noun)
                        : fmt::format("the {} {}", option.noun, digest);
}

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
  if (held.surface.more_files != asked.surface.more_files)
    return fmt::format("its surface is in {} files, and not in the {} of now, or not in these",
                       1 + held.surface.more_files.size(), 1 + asked.surface.more_files.size());
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
  for_each_option([&](const auto& option) {
    const std::string in_store = text_of(option, held.*option.kept),
                      here = text_of(option, asked.*option.kept);
    if (in_store != here)
      all.push_back(fmt::format("{} is {} in it, and {} here", option.name.typed, in_store, here));
  });
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
