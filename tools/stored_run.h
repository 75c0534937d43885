// What several subcommands read from a store.
#pragma once

#include <filesystem>
#include <vector>

#include "storage/store.h"
#include "tools/report.h"

namespace locvol {

Store open_to_read(const std::filesystem::path& directory);
// Throws std::runtime_error if no run has begun in this store.
RunRecord run_of(const Store& store);
// Throws std::runtime_error if the run in this store is not done.
void require_done(const Store& store);
std::vector<LeafSite> unresolved_sites(const Reader& reader);  // leaf by leaf, in Morton order

}  // namespace locvol
