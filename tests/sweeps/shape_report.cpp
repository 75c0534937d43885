#include "tests/sweeps/shape_report.h"

#include <fmt/format.h>

#include <algorithm>

#include "tests/sweeps/shapes/families.h"

namespace locvol::sweeps {
namespace {

constexpr double kStartSeconds = 0.02;  // what a run takes that does nothing
constexpr std::size_t kNumSlowest = 12;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::ranges::nth_element(values, values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2));
  return values[values.size() / 2];
}

}  // namespace

double ShapeReport::Run::seconds_per_thousand() const {
  const auto num_vertices =
      static_cast<double>(std::max<std::uint64_t>(result.num_boundary_vertices, 1));
  return 1000 * std::max(result.seconds - kStartSeconds, 0.0) / num_vertices;
}

void ShapeReport::add(const ShapeCase& shape_case, const TrialResult& result) {
  runs_.push_back({shape_case.family, shape_case.number, shape_case.size, result});
}

std::size_t ShapeReport::num_failures() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(runs_, [](const Run& run) { return is_failure(run.result.verdict); }));
}

std::string ShapeReport::row(std::string_view family, const std::vector<const Run*>& runs) const {
  std::array<std::size_t, kVerdictNames.size()> counts = {};
  std::vector<double> seconds;
  double largest = 0, shift = 0, creases = 0, lost = 0;
  for (const Run* run : runs) {
    ++counts[static_cast<std::size_t>(run->result.verdict)];
    if (run->result.verdict == Verdict::kRefused) continue;
    seconds.push_back(run->result.seconds);
    largest = std::max(largest, run->result.seconds);
    shift = std::max(shift, run->result.volume_shift);
    creases += run->result.crease_length / run->size;
    lost += run->result.lost_crease_length / run->size;
  }
  std::string text = fmt::format("{:<8}{:>7}", family, runs.size());
  for (const std::size_t count : counts) text += fmt::format("{:>8}", count);
  return text + fmt::format("{:>9.2f}{:>9.2f}{:>8.3f}{:>10.0f}{:>8.1f}\n", median(seconds), largest,
                            shift, creases, lost);
}

std::string ShapeReport::table() const {
  std::string text = fmt::format("{:<8}{:>7}", "", "cases");
  for (const std::string_view verdict : kVerdictNames) text += fmt::format("{:>8}", verdict);
  text +=
      fmt::format("{:>9}{:>9}{:>8}{:>10}{:>8}\n", "median s", "max s", "shift", "creases", "lost");
  std::vector<const Run*> all;
  std::vector<Family> every(families().begin(), families().end());
  every.insert(every.end(), families_of_bodies().begin(), families_of_bodies().end());
  for (const Family& family : every) {
    std::vector<const Run*> of_family;
    for (const Run& run : runs_)
      if (run.family == family.name) of_family.push_back(&run);
    if (!of_family.empty()) text += row(family.name, of_family);
    all.insert(all.end(), of_family.begin(), of_family.end());
  }
  return text + row("all", all);
}

double ShapeReport::smooth_seconds_per_thousand() const {
  std::vector<double> values;
  for (const Run& run : runs_)
    if ((run.family == "sphere" || run.family == "torus") && run.result.num_boundary_vertices > 500)
      values.push_back(run.seconds_per_thousand());
  return median(values);
}

std::string ShapeReport::slowest() const {
  std::vector<const Run*> runs;
  for (const Run& run : runs_)
    if (run.result.num_boundary_vertices > 0) runs.push_back(&run);
  const auto num_listed = static_cast<std::ptrdiff_t>(std::min(kNumSlowest, runs.size()));
  std::ranges::partial_sort(runs, runs.begin() + num_listed, std::greater(),
                            &Run::seconds_per_thousand);
  runs.resize(static_cast<std::size_t>(num_listed));
  std::string text =
      fmt::format("CPU seconds per thousand boundary vertices: spheres and tori {:.3f} (median)\n",
                  smooth_seconds_per_thousand());
  for (const Run* run : runs)
    text += fmt::format(
        "{:>8.3f}  {} case {}: {:.2f} s, {} cells, {} boundary vertices, {} unresolved\n",
        run->seconds_per_thousand(), run->family, run->number, run->result.seconds,
        run->result.num_cells, run->result.num_boundary_vertices, run->result.num_unresolved);
  return text;
}

}  // namespace locvol::sweeps
