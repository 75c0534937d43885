#include "tools/stored_run.h"

#include <fmt/format.h>

#include <stdexcept>

#include "tools/progress.h"

namespace locvol {

Store open_to_read(const std::filesystem::path& directory) {
  return Store::open(directory, {.read_only = true});
}

RunRecord run_of(const Store& store) {
  auto run = store.snapshot().run();
  if (!run) {
    throw std::runtime_error(
        fmt::format("no run has begun in the store {}", store.directory().string()));
  }
  return *std::move(run);
}

void require_done(const Store& store) {
  const Phase phase = run_of(store).phase;
  if (phase == Phase::kDone) return;
  const std::string directory = store.directory().string();
  throw std::runtime_error(
      fmt::format("the run in {} is not done (phase: {}); `locvol resume {}` goes on with it",
                  directory, phase_name(phase), directory));
}

std::vector<LeafSite> unresolved_sites(const Reader& reader) {
  std::vector<LeafSite> sites;
  reader.for_each_leaf([&](MortonKey key, const LeafInfo& info) {
    if (info.num_unresolved == 0) return true;
    for (const UnresolvedSite& site : reader.unresolved(key).sites) sites.push_back({key, site});
    return true;
  });
  return sites;
}

}  // namespace locvol
