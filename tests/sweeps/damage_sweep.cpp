// damage_sweep [SURFACE...]: damages sound surfaces, meshes each by winding numbers, and tells what
// came of it, beside what the sound surface encloses. Exit code 1 if a mesh is wrong, or one is
// missing that can be had.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/loose_surface.h"
#include "engine/ingest/surface_input.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/triangle_tree.h"
#include "tests/sweeps/limited_run.h"
#include "tests/sweeps/shapes/damaged.h"
#include "tests/sweeps/sweep_jobs.h"
#include "tests/temp_dir.h"

namespace locvol::sweeps {
namespace {

using Json = nlohmann::json;

struct Options {
  std::vector<std::string> surfaces;  // none: those that are made here
  std::string kind;                   // empty: all
  std::string damage;                 // of one name
  double size = 3;                    // percent of the sound surface's shortest side
  std::uint64_t seed = 1;
  double limit = 60;  // seconds for a process
  int num_jobs = 2;
  std::filesystem::path keep;  // where damaged surfaces go; empty: nowhere
};

struct SoundSurface {
  std::string name;
  Shape shape;
};

Shape shape_in(const std::filesystem::path& file, const std::filesystem::path& directory) {
  IngestWatch watch;
  const RawSurface raw = read_surface(file, directory, watch);
  LooseSurface surface = loose_surface(raw.spill, raw.triangles);
  return {std::move(surface.vertices), std::move(surface.triangles)};
}

std::vector<SoundSurface> made_surfaces() {
  using namespace testing_shapes;
  return {{"sphere", sphere(1, 30, 60)},
          {"torus", torus(1, 0.4, 60, 30)},
          {"box", subdivided(subdivided(subdivided(subdivided(box({0, 0, 0}, {1, 1.1, 1.3})))))}};
}

// What encloses something, and how far it is.
class Enclosure {
 public:
  explicit Enclosure(const Shape& shape)
      : triangles_(shape.soup()), along_(shape.vertices, shape.triangles) {
    std::vector<Box> boxes;
    for (const Triangle& t : triangles_) boxes.push_back(t.box());
    near_ = BoxTree(std::move(boxes));
  }

  // By the parity of the triangles above. Places at random lie below no edge.
  bool has(const Point& p) const {
    bool is_in = false;
    along_.for_each_along(TriangleTree::Stretch(p, {0, 0, 1}, 0), 0, [&](std::uint32_t n) {
      const auto& [a, b, c] = triangles_[n].corners;
      const auto turn = [&](const Point& u, const Point& v) {
        return (u.x - p.x) * (v.y - p.y) - (u.y - p.y) * (v.x - p.x);
      };
      const double ab = turn(a, b), bc = turn(b, c), ca = turn(c, a);
      if ((ab > 0) != (bc > 0) || (bc > 0) != (ca > 0)) return;
      is_in ^= (bc * a.z + ca * b.z + ab * c.z) / (ab + bc + ca) > p.z;
    });
    return is_in;
  }

  double distance(const Point& p) const {
    double squared = std::numeric_limits<double>::infinity();
    near_.for_each_within(p, squared, [&](std::uint32_t n) {
      squared = std::min(squared, squared_distance(triangles_[n], p));
    });
    return std::sqrt(squared);
  }

 private:
  std::vector<Triangle> triangles_;
  TriangleTree along_;
  BoxTree near_;
};

struct Result : Judgment {
  bool is_tried = false;
  double seconds = 0;  // of CPU time
  std::uint64_t num_cells = 0, num_unresolved = 0;
  // Over λ: from the mesh's boundary to the sound surface, and back.
  double there = 0, back = 0;
  double differing = 0;  // volume that one of both encloses, over that of the sound surface
};

class Trial {
 public:
  Trial(const DamagedSurface& surface, double size, const std::filesystem::path& directory,
        double limit)
      : surface_(surface), size_(size), directory_(directory), limit_(limit) {}

  Result result() {
    result_.is_tried = true;
    std::filesystem::remove_all(store());
    std::filesystem::remove(boundary());
    write_off(surface_.shape, directory_ / "damaged.off");
    if (mesh() && audit()) measure();
    return result_;
  }

 private:
  std::filesystem::path boundary() const { return directory_ / "boundary.ply"; }
  std::filesystem::path store() const { return directory_ / "boundary.ply.locvol"; }

  bool conclude(Verdict verdict, const std::string& reason) {
    static_cast<Judgment&>(result_) = {verdict, reason};
    return false;
  }

  // Whether there is a mesh; if not, the verdict is final.
  bool mesh() {
    const LimitedRun run =
        run_limited({"mesh", (directory_ / "damaged.off").string(), "-o", boundary().string(),
                     "--inside", "winding", "--size", fmt::format("{}", size_), "--threads", "1",
                     "--keep-store", "--force", "--quiet"},
                    limit_);
    const ProcessResult& process = run.process;
    result_.seconds = process.cpu_seconds;
    exit_code_ = process.exit_code;
    if (run.is_hung) return conclude(Verdict::kHung, fmt::format("after {} s", limit_));
    if (process.signal > 0)
      return conclude(Verdict::kError,
                      fmt::format("signal {}: {}", process.signal, last_words(process.err)));
    if (exit_code_ == 0 || exit_code_ == 3) return true;
    // A refusal names what would do.
    const bool is_refused =
        exit_code_ == 1 && (process.err.find("locvol wrap") != std::string::npos ||
                            process.err.find("--memory") != std::string::npos);
    return conclude(is_refused ? Verdict::kRefused : Verdict::kError, last_words(process.err));
  }

  bool audit() {
    const LimitedRun run = run_limited({"audit", store().string(), "--json", "--quiet"}, limit_);
    const Json report = Json::parse(run.process.out, nullptr, false);
    if (!report.is_object())
      return conclude(Verdict::kError, "the audit: " + last_words(run.process.err));
    result_.num_cells = report.at("mesh").at("num_cells");
    result_.num_unresolved = report.at("num_unresolved");
    static_cast<Judgment&>(result_) = judgment_of(exit_code_, report);
    return result_.num_cells > 0;
  }

  void measure() {
    constexpr int kPlaces = 20'000;
    constexpr double kMaxShift = 0.15;   // of volume, over area and λ
    constexpr double kDeviations = 4.5;  // of what places at random tell
    const Shape shape = shape_in(boundary(), directory_);
    const Enclosure found(shape);
    std::vector<Enclosure> sound;
    double area = 0;
    Box box = box_of(shape);
    for (const Shape& one : surface_.sound) {
      sound.emplace_back(one);
      area += area_of(one);
      box = box.joined(box_of(one));
    }
    const auto is_in_other = [&](std::size_t own, const Point& p) {
      for (std::size_t n = 0; n < sound.size(); ++n)
        if (n != own && sound[n].has(p)) return true;
      return false;
    };
    for_each_place(shape, [&](const Point& p) {
      double least = std::numeric_limits<double>::infinity();
      for (const Enclosure& one : sound) least = std::min(least, one.distance(p));
      result_.there = std::max(result_.there, least / size_);
    });
    for (std::size_t n = 0; n < sound.size(); ++n)
      for_each_place(surface_.sound[n], [&](const Point& p) {
        if (!is_in_other(n, p)) result_.back = std::max(result_.back, found.distance(p) / size_);
      });
    Dice dice(1);
    int num_inside = 0, num_differing = 0;
    for (int n = 0; n < kPlaces; ++n) {
      const double x = dice.uniform(box.min.x, box.max.x), y = dice.uniform(box.min.y, box.max.y);
      const Point p{x, y, dice.uniform(box.min.z, box.max.z)};
      const bool is_inside = is_in_other(sound.size(), p);
      num_inside += is_inside;
      num_differing += is_inside != found.has(p);
    }
    result_.differing = num_differing / std::max(1.0, static_cast<double>(num_inside));
    const Point sides = box.max - box.min;
    const double whole = sides.x * sides.y * sides.z;
    const double allowed = (kMaxShift * area * size_ + surface_.lost_volume) / whole;
    if (num_differing / static_cast<double>(kPlaces) >
        allowed + kDeviations * std::sqrt((allowed + 1.0 / kPlaces) / kPlaces))
      if (!is_failure(result_.verdict))
        conclude(Verdict::kDiffers, "encloses something else than the sound surface");
  }

  // visit(p) for vertices of triangles, and their middles.
  static void for_each_place(const Shape& shape, const auto& visit) {
    std::vector<bool> is_used(shape.vertices.size());
    for (const auto& [a, b, c] : shape.triangles) {
      visit((1.0 / 3) * (shape.vertices[a] + shape.vertices[b] + shape.vertices[c]));
      is_used[a] = is_used[b] = is_used[c] = true;
    }
    for (std::size_t v = 0; v < is_used.size(); ++v)
      if (is_used[v]) visit(shape.vertices[v]);
  }

  const DamagedSurface& surface_;
  double size_;
  std::filesystem::path directory_;
  double limit_;
  int exit_code_ = 0;
  Result result_;
};

class DamageSweep {
 public:
  explicit DamageSweep(const Options& options) : options_(options) {
    const TempDir directory;
    if (options.surfaces.empty()) surfaces_ = made_surfaces();
    for (const std::string& file : options.surfaces)
      surfaces_.push_back(
          {std::filesystem::path(file).stem().string(), shape_in(file, directory.path())});
    for (const Damage& damage : damages())
      if ((options.kind.empty() || damage.kind == options.kind) &&
          (options.damage.empty() || damage.name() == options.damage))
        damages_.push_back(damage);
    results_.resize(surfaces_.size() * damages_.size());
  }

  bool run() {
    fmt::print("{:<22}{:<16}{:>9}{:>7}{:>9}{:>7}{:>8}{:>8}{:>9}\n", "surface", "damage", "", "s",
               "cells", "sites", "there λ", "back λ", "differ %");
    for_each_in_jobs(
        results_.size(), options_.num_jobs,
        [this](std::size_t i, const std::filesystem::path& directory) { mesh(i, directory); });
    print_sums();
    bool is_good = true;
    for (std::size_t i = 0; i < results_.size(); ++i) is_good = is_good && is_as_expected(i);
    return is_good;
  }

 private:
  const SoundSurface& surface(std::size_t i) const { return surfaces_[i / damages_.size()]; }
  const Damage& damage(std::size_t i) const { return damages_[i % damages_.size()]; }

  void mesh(std::size_t i, const std::filesystem::path& directory) {
    const auto made = damaged(surface(i).shape, damage(i), options_.seed);
    if (!made) return;
    if (!options_.keep.empty()) write_off(made->shape, options_.keep / (stem(i) + ".off"));
    const Box box = box_of(surface(i).shape);
    const Point sides = box.max - box.min;
    const double size = options_.size / 100 * std::min({sides.x, sides.y, sides.z});
    Result result = Trial(*made, size, directory, options_.limit).result();
    const std::lock_guard lock(mutex_);
    results_[i] = std::move(result);
    print_row(i);
  }

  std::string stem(std::size_t i) const {
    std::string text = surface(i).name + "-" + damage(i).name();
    std::ranges::replace(text, ' ', '-');
    return text;
  }

  void print_row(std::size_t i) const {
    const Result& r = results_[i];
    fmt::print("{:<22}{:<16}{:>9}{:>7.2f}{:>9}{:>7}{:>8.3f}{:>8.3f}{:>9.2f}{}\n", surface(i).name,
               damage(i).name(), name(r.verdict), r.seconds, r.num_cells, r.num_unresolved, r.there,
               r.back, 100 * r.differing, r.reason.empty() ? "" : "  " + r.reason);
    std::fflush(stdout);
  }

  void print_sums() const {
    fmt::print("\n{:<16}", "damage");
    for (const std::string_view verdict : kVerdictNames) fmt::print("{:>9}", verdict);
    fmt::print("{:>10}{:>8}\n", "median s", "max s");
    for (std::size_t d = 0; d < damages_.size(); ++d) {
      std::array<std::size_t, kVerdictNames.size()> counts = {};
      std::vector<double> seconds;
      for (std::size_t i = d; i < results_.size(); i += damages_.size()) {
        if (!results_[i].is_tried) continue;
        ++counts[static_cast<std::size_t>(results_[i].verdict)];
        seconds.push_back(results_[i].seconds);
      }
      if (seconds.empty()) continue;
      std::ranges::sort(seconds);
      fmt::print("{:<16}", damages_[d].name());
      for (const std::size_t count : counts) fmt::print("{:>9}", count);
      fmt::print("{:>10.2f}{:>8.2f}\n", seconds[seconds.size() / 2], seconds.back());
    }
  }

  bool is_as_expected(std::size_t i) const {
    const Result& r = results_[i];
    if (!r.is_tried || r.verdict == Verdict::kDone) return true;
    if (is_failure(r.verdict)) return false;
    // What a surface does to a run without damage is its own affair.
    return !damage(i).is_to_be_whole || !options_.surfaces.empty();
  }

  const Options options_;
  std::vector<SoundSurface> surfaces_;
  std::vector<Damage> damages_;
  std::vector<Result> results_;
  std::mutex mutex_;  // of rows that are printed
};

}  // namespace
}  // namespace locvol::sweeps

int main(int argc, char** argv) {
  using namespace locvol::sweeps;
  CLI::App app("Damages sound surfaces, and meshes each by winding numbers");
  Options options;
  app.add_option("surfaces", options.surfaces, "Sound ones (default: some that are made)")
      ->check(CLI::ExistingFile);
  app.add_option("--kind", options.kind, "Only such damages");
  app.add_option("--damage", options.damage, "Only that one");
  app.add_option("--size", options.size, "λ in percent of the shortest side (default: 3)")
      ->check(CLI::PositiveNumber);
  app.add_option("--seed", options.seed, "Of the damages (default: 1)");
  app.add_option("--jobs", options.num_jobs, "Runs at a time (default: 2)")
      ->check(CLI::PositiveNumber);
  app.add_option("--limit", options.limit, "Seconds after which a process hangs (default: 60)");
  app.add_option("--keep", options.keep, "Where damaged surfaces go")
      ->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);
  try {
    return DamageSweep(options).run() ? 0 : 1;
  } catch (const std::exception& failure) {
    fmt::print(stderr, "damage_sweep: {}\n", failure.what());
    return 1;
  }
}
