// crease_sweep [--kind K]: meshes shapes with creases of one kind each, at λ = 1, and tells what
// the mesh keeps of them. Exit code 1 if one lost what it is to keep.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/sweeps/shape_trial.h"
#include "tests/sweeps/shapes/creased.h"
#include "tests/sweeps/sweep_jobs.h"

namespace locvol::sweeps {
namespace {

struct Options {
  std::string kind;  // empty: all
  std::string name;  // of one shape
  double size = 1;
  std::uint64_t leaf_capacity = 3000;
  double limit = 120;  // seconds for a process
  int num_jobs = 2;
  bool is_brief = false;
  std::filesystem::path keep;  // where all surfaces go; empty: nowhere
};

std::string file_stem(const CreasedShape& shape) {
  std::string text = shape.name();
  for (char& c : text)
    if (c == ' ') c = '-';
  return text;
}

class CreaseSweep {
 public:
  explicit CreaseSweep(const Options& options) : options_(options) {
    for (CreasedShape& shape : creased_shapes())
      if ((options.kind.empty() || shape.kind == options.kind) &&
          (options.name.empty() || shape.name() == options.name) &&
          (!options.is_brief || shape.is_to_be_whole()))
        shapes_.push_back(std::move(shape));
    results_.resize(shapes_.size());
  }

  bool run() {
    for_each_in_jobs(
        shapes_.size(), options_.num_jobs,
        [this](std::size_t i, const std::filesystem::path& directory) { try_shape(i, directory); });
    fmt::print("{:<26}{:>9}{:>10}{:>8}{:>8}{:>7}{:>8}{:>8}{:>8}{:>7}\n", "shape, λ = 1", "",
               "creases", "kept %", "cells", "sites", "degrees", "poor", "forced", "s");
    bool is_good = true;
    for (std::size_t i = 0; i < shapes_.size(); ++i) {
      fmt::print("{}", row(shapes_[i], results_[i]));
      is_good = is_good && !is_failure(results_[i].verdict) && is_as_expected(i);
    }
    return is_good;
  }

 private:
  void try_shape(std::size_t i, const std::filesystem::path& directory) {
    const std::string stem = file_stem(shapes_[i]);
    const ShapeCase made{.family = stem,
                         .solid = shapes_[i].solid,
                         .size = options_.size,
                         .leaf_capacity = options_.leaf_capacity};
    if (!options_.keep.empty()) made.write_surface(options_.keep);
    results_[i] = try_case(made, directory, options_.limit);
  }

  bool is_as_expected(std::size_t i) const {
    if (!shapes_[i].is_to_be_whole() || options_.size != 1) return true;
    const TrialResult& r = results_[i];
    if (r.verdict == Verdict::kDone && r.lost_crease_length == 0) return true;
    fmt::print("{}: was to be whole, and is not\n", shapes_[i].name());
    return false;
  }

  static std::string row(const CreasedShape& shape, const TrialResult& r) {
    const double kept =
        r.crease_length > 0 ? 100 * (1 - r.lost_crease_length / r.crease_length) : 100;
    return fmt::format("{:<26}{:>9}{:>10.2f}{:>8.2f}{:>8}{:>7}{:>8.2f}{:>8}{:>8}{:>7.2f}{}\n",
                       shape.name(), name(r.verdict), r.crease_length, kept, r.num_cells,
                       r.num_unresolved, r.min_dihedral_degrees, r.num_poor_cells,
                       r.num_forced_cells, r.seconds, r.reason.empty() ? "" : "  " + r.reason);
  }

  const Options options_;
  std::vector<CreasedShape> shapes_;
  std::vector<TrialResult> results_;
};

}  // namespace
}  // namespace locvol::sweeps

int main(int argc, char** argv) {
  using namespace locvol::sweeps;
  CLI::App app(
      "Meshes shapes with creases of one kind each, and tells what the mesh keeps of them");
  Options options;
  app.add_option("--kind", options.kind, "Only such shapes");
  app.add_option("--shape", options.name, "Only that one");
  app.add_option("--size", options.size, "λ (default: 1)")->check(CLI::PositiveNumber);
  app.add_option("--leaf-capacity", options.leaf_capacity, "As of locvol mesh (default: 3000)");
  app.add_flag("--brief", options.is_brief, "What ctest runs: all that is to be whole");
  app.add_option("--jobs", options.num_jobs, "Shapes at a time (default: 2)")
      ->check(CLI::PositiveNumber);
  app.add_option("--limit", options.limit, "Seconds after which a process hangs (default: 120)");
  app.add_option("--keep", options.keep, "Where all surfaces go")->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);
  try {
    return CreaseSweep(options).run() ? 0 : 1;
  } catch (const std::exception& failure) {
    fmt::print(stderr, "crease_sweep: {}\n", failure.what());
    return 1;
  }
}
