#include "engine/plan/disk_room.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include "engine/plan/run_estimate.h"
#include "engine/shared/input_error.h"

namespace locvol {
namespace {

std::string gigabytes(double bytes) { return fmt::format("{:.3g} GB", bytes / 1e9); }

// What one disk has to take.
struct Load {
  explicit Load(const Disk& the_disk) : disk(the_disk) {}

  Disk disk;
  double bytes = 0;
  std::string text;

  bool fits() const { return bytes <= disk.free_bytes; }
  void add(double more, const std::string& what) {
    bytes += more;
    text += (text.empty() ? "" : ", and ") + what;
  }
};

class RoomCheck {
 public:
  RoomCheck(const RunRecord& run, const std::filesystem::path& store,
            const std::filesystem::path& output, const OutputOptions& options, const DiskOf& disk)
      : run_(run),
        store_(store),
        output_(output),
        options_(options),
        store_disk_(disk(store)),
        bytes_held_(bytes_held(store)) {
    if (!output.empty()) output_disk_ = disk(output);
  }

  bool is_done() const { return run_.phase == Phase::kDone; }

  // At the moment when most is there: the end.
  std::vector<Load> loads(double size) const {
    const RunEstimate estimate = estimate_run(run_of(size), options_);
    std::vector<Load> loads;
    if (!is_done()) {
      const double bytes = std::max(0.0, estimate.store_bytes - bytes_held_);
      loads.emplace_back(store_disk_);
      loads.back().add(bytes, fmt::format("the store {} would take about {}", store_.string(),
                                          gigabytes(bytes)));
    }
    if (!output_disk_) return loads;
    if (loads.empty() || output_disk_->id != store_disk_.id) loads.emplace_back(*output_disk_);
    const OutputEstimate& output = estimate.output;
    loads.back().add(output.disk_bytes(),
                     fmt::format("the mesh {} would take about {} as {}, with temporary files {}",
                                 output_.string(), gigabytes(output.file_bytes),
                                 info_of(options_.format).name, gigabytes(output.disk_bytes())));
    return loads;
  }
  bool fits(double size) const { return std::ranges::all_of(loads(size), &Load::fits); }
  // Within a tenth; none, where not even a few cells fit, or all of the walls.
  std::optional<double> least_size() const {
    constexpr double kFewCells = 100, kLost = 0.01;
    if (run_.parameters.sizes().has_shapes()) return std::nullopt;  // shapes may ask for most
    double size = run_.parameters.size;
    while (!fits(size)) {
      size *= 1.1;
      const RunEstimate estimate = estimate_run(run_of(size), options_);
      if (estimate.num_cells < kFewCells || estimate.narrow.lost_area > kLost) return std::nullopt;
    }
    return size;
  }

 private:
  RunRecord run_of(double size) const {
    RunRecord run = run_;
    run.parameters.size = size;
    return run;
  }

  const RunRecord& run_;
  std::filesystem::path store_, output_;
  OutputOptions options_;
  Disk store_disk_;
  std::optional<Disk> output_disk_;
  double bytes_held_;
};

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

double bytes_held(const std::filesystem::path& store) {
  std::error_code none;
  const std::uintmax_t bytes = std::filesystem::file_size(store / "data.mdb", none);
  return none ? 0 : static_cast<double>(bytes);
}

void require_room(const RunRecord& run, const std::filesystem::path& store,
                  const std::filesystem::path& output, const OutputOptions& options,
                  const DiskOf& disk) {
  const RoomCheck check(run, store, output, options, disk);
  const double size = run.parameters.size;
  if (check.fits(size)) return;
  std::string why;
  for (const Load& load : check.loads(size)) {
    if (load.fits()) continue;
    why += fmt::format("{}{}, on a disk where {} are free", why.empty() ? "" : "; ", load.text,
                       gigabytes(load.disk.free_bytes));
  }
  if (check.is_done()) throw InputError(why + "; choose another format, or a larger disk");
  const auto least_size = check.least_size();
  const RunEstimate estimate = estimate_run(run, options);
  const std::string narrow = narrow_text(estimate);
  throw InputError(fmt::format(
      "size {} makes about {:.3g} tetrahedra of {}{}: {}; choose {}a larger disk", size,
      estimate.num_cells, run.surface.file, narrow.empty() ? "" : " (" + narrow + ")", why,
      least_size ? fmt::format("a size of at least {:.3g}, or ", *least_size) : ""));
}

void require_format(const RunRecord& run, const std::filesystem::path& output,
                    const OutputOptions& options) {
  const bool is_second = options.order == 2;  // a mesh has more edges than cells
  if (run.phase == Phase::kDone)
    return check_limits(
        options.format,
        {run.counts.num_points + (is_second ? run.counts.num_cells : 0), run.counts.num_cells},
        output, is_second ? "there are more than" : "there are");
  constexpr double kMostError = 2;  // the mesh has more than the estimate over this
  const RunEstimate estimate = estimate_run(run, options);
  const auto least = [](double estimated) {
    return static_cast<std::uint64_t>(std::min(estimated / kMostError, 1e18));
  };
  check_limits(options.format,
               {least(estimate.num_vertices + (is_second ? estimate.num_cells : 0)),
                least(estimate.num_cells), least(estimate.num_boundary_facets),
                least(estimate.num_boundary_facets / 2)},
               output, "there would be more than");
}

void require_ingest_room(const std::string& surface, std::uint64_t num_triangles,
                         const std::filesystem::path& directory, std::uint64_t bytes_written,
                         const DiskOf& disk) {
  const double need = kIngestBytesPerTriangle * static_cast<double>(num_triangles);
  const double free = disk(directory).free_bytes;
  if (need - static_cast<double>(bytes_written) <= free) return;
  throw InputError(fmt::format(
      "{} has {} triangles: to take them in, temporary files in {} would take about {}, on a disk "
      "where {} are free; make room there, or choose a larger disk",
      surface, num_triangles, directory.string(), gigabytes(need), gigabytes(free)));
}

}  // namespace locvol
