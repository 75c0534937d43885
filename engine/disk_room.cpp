#include "engine/disk_room.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "engine/input_error.h"
#include "engine/run_estimate.h"

namespace locvol {
namespace {

double bytes_held(const std::filesystem::path& store) {
  std::error_code none;
  const std::uintmax_t bytes = std::filesystem::file_size(store / "data.mdb", none);
  return none ? 0 : static_cast<double>(bytes);
}

class RoomCheck {
 public:
  RoomCheck(const RunRecord& run, const std::filesystem::path& store,
            const std::filesystem::path& output, const DiskOf& disk)
      : run_(run),
        is_done_(run.phase == Phase::kDone),
        store_disk_(disk(store)),
        bytes_held_(bytes_held(store)) {
    if (!output.empty()) output_disk_ = disk(output);
  }

  // What is written to the disks of the store and of the output, and does it fit?
  double store_bytes(double size) const {
    return is_done_ ? 0 : std::max(0.0, estimate(size).store_bytes - bytes_held_);
  }
  double output_bytes(double size) const { return output_disk_ ? estimate(size).file_bytes : 0; }
  bool is_shared() const { return output_disk_ && output_disk_->id == store_disk_.id; }
  bool store_fits(double size) const { return store_bytes(size) <= store_disk_.free_bytes; }
  bool output_fits(double size) const {
    return !output_disk_ || output_bytes(size) <= output_disk_->free_bytes;
  }
  bool fits(double size) const {
    return is_shared() ? store_bytes(size) + output_bytes(size) <= store_disk_.free_bytes
                       : store_fits(size) && output_fits(size);
  }
  // Within a tenth.
  double least_size() const {
    double size = run_.parameters.size;
    while (!fits(size)) size *= 1.1;
    return size;
  }
  const Disk& store_disk() const { return store_disk_; }
  const Disk& output_disk() const { return *output_disk_; }

 private:
  RunEstimate estimate(double size) const {
    RunParameters parameters = run_.parameters;
    parameters.size = size;
    return estimate_run(run_.surface, parameters);
  }

  const RunRecord& run_;
  bool is_done_;
  Disk store_disk_;
  std::optional<Disk> output_disk_;
  double bytes_held_;
};

std::string gigabytes(double bytes) { return fmt::format("{:.3g} GB", bytes / 1e9); }

}  // namespace

std::filesystem::path existing_directory(const std::filesystem::path& directory) {
  std::filesystem::path existing = std::filesystem::absolute(directory);
  while (!std::filesystem::is_directory(existing) && existing.has_relative_path())
    existing = existing.parent_path();
  return existing;
}

Disk disk_of(const std::filesystem::path& place) {
  const std::filesystem::path directory = existing_directory(place);
  struct stat status = {};
  if (::stat(directory.c_str(), &status) != 0)
    throw std::system_error(errno, std::generic_category(), directory.string());
  return {status.st_dev, static_cast<double>(std::filesystem::space(directory).available)};
}

void require_room(const RunRecord& run, const std::filesystem::path& store,
                  const std::filesystem::path& output, const DiskOf& disk) {
  const RoomCheck check(run, store, output, disk);
  const double size = run.parameters.size;
  if (check.fits(size)) return;
  const auto use = [](const char* what, const std::filesystem::path& place, double bytes) {
    return fmt::format("{} {} would take about {}", what, place.string(), gigabytes(bytes));
  };
  const std::string of_store = use("the store", store, check.store_bytes(size)),
                    of_output = use("the mesh", output, check.output_bytes(size));
  std::string why;
  if (check.is_shared())
    why = fmt::format("{}, and {}, on a disk where {} are free", of_store, of_output,
                      gigabytes(check.store_disk().free_bytes));
  else if (!check.store_fits(size))
    why = fmt::format("{} where {} are free", of_store, gigabytes(check.store_disk().free_bytes));
  else
    why = fmt::format("{} where {} are free", of_output, gigabytes(check.output_disk().free_bytes));
  throw InputError(fmt::format(
      "size {} makes about {:.3g} tetrahedra of {}: {}; choose a size of at least {:.3g}, or a "
      "larger disk",
      size, estimated_num_cells(run.surface, size), run.surface.file, why, check.least_size()));
}

}  // namespace locvol
