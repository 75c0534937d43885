#include "tests/sweeps/shape_trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "tests/file_bytes.h"

namespace locvol::sweeps {
namespace {

using Json = nlohmann::json;

// Parts of the messages with which a surface or a size is refused.
constexpr std::array<std::string_view, 8> kRefusals = {
    "intersects itself",     "is not manifold", "is not closed",
    "bounds no volume",      "no cell fits",    "is too small for this surface",
    "no unambiguous repair", "give --memory"};

class Trial {
 public:
  Trial(const ShapeCase& shape_case, const std::filesystem::path& directory, double limit)
      : case_(shape_case), directory_(directory), limit_(limit) {}

  TrialResult result() {
    case_.write_surface(directory_);
    if (mesh(case_.num_threads)) judge(audit());
    if (!is_failure(result_.verdict) && result_.verdict != Verdict::kRefused && case_.is_repeated)
      compare_with_other_threads();
    start_anew();
    std::filesystem::remove(directory_ / case_.file_name());
    return result_;
  }

 private:
  // Whether there is a mesh; if not, the verdict is final.
  bool mesh(int num_threads) {
    start_anew();
    std::vector<std::string> words = mesh_command(case_, directory_, num_threads);
    words.push_back("--json");
    const LimitedRun ending = run_limited(words, limit_);
    result_.seconds = ending.process.cpu_seconds;
    if (ending.is_hung) return conclude(Verdict::kHung, fmt::format("after {} s", limit_));
    const auto& [code, number, peak, cpu, out, err] = ending.process;
    if (number > 0)
      return conclude(Verdict::kError, fmt::format("signal {}: {}", number, last_words(err)));
    if (code == 0 || code == 3) {
      exit_code_ = code;
      const Json summary = Json::parse(out, nullptr, false);
      if (!summary.is_object()) return conclude(Verdict::kError, "no JSON: " + last_words(out));
      result_.num_forced_cells = summary.at("statistics").at("num_forced_cells");
      return true;
    }
    const bool is_refused = code == 1 && std::ranges::any_of(kRefusals, [&err](const auto& part) {
                              return err.find(part) != std::string::npos;
                            });
    return conclude(is_refused ? Verdict::kRefused : Verdict::kError,
                    fmt::format("exit code {}: {}", code, last_words(err)));
  }

  bool conclude(Verdict verdict, const std::string& reason) {
    result_.verdict = verdict;
    result_.reason = reason;
    return false;
  }

  // Empty where the audit itself failed.
  std::optional<Json> audit() {
    const LimitedRun ending = run_limited({"audit", store().string(), "--json", "--quiet"}, limit_);
    const Json report = Json::parse(ending.process.out, nullptr, false);
    if (!ending.is_hung && ending.process.signal == 0 && report.is_object()) return report;
    conclude(ending.is_hung ? Verdict::kHung : Verdict::kError,
             fmt::format("the audit: exit code {}, signal {}: {}", ending.process.exit_code,
                         ending.process.signal, last_words(ending.process.err)));
    return std::nullopt;
  }

  void judge(const std::optional<Json>& report) {
    if (!report) return;
    const Json& mesh = report->at("mesh");
    result_.num_cells = mesh.at("num_cells");
    result_.num_boundary_vertices = mesh.at("num_boundary_vertices");
    result_.num_unresolved = report->at("num_unresolved");
    result_.lost_crease_length = report->at("lost_crease_length");
    result_.crease_length = mesh.at("crease_length").get<double>() + result_.lost_crease_length;
    result_.min_dihedral_degrees = report->at("min_dihedral_degrees");
    result_.num_poor_cells = report->at("num_poor_cells");
    static_cast<Judgment&>(result_) = judgment_of(exit_code_, *report);
    if (result_.verdict == Verdict::kDone) compare_with_input(*report);
  }

  void compare_with_input(const Json& report) {
    const Json &mesh = report.at("mesh"), &input = report.at("input");
    const double volume = input.at("volume"), area = area_of(case_.solid.shape);
    result_.volume_shift = std::abs(mesh.at("volume").get<double>() - volume) / (area * case_.size);
    check_claimed_volume(volume);
    if (!case_.is_resolved()) return;
    compare_bodies(mesh, input);
    for (const char* what : {"num_components", "euler_characteristic"})
      if (mesh.at(what) != input.at(what))
        conclude(Verdict::kDiffers,
                 fmt::format("{} is {}, the input's {}", what, mesh.at(what).get<std::int64_t>(),
                             input.at(what).get<std::int64_t>()));
    if (result_.volume_shift > kMaxVolumeShift)
      conclude(Verdict::kDiffers, fmt::format("volume is {}, the input's {}",
                                              mesh.at("volume").get<double>(), volume));
  }

  void compare_bodies(const Json& mesh, const Json& input) {
    if (case_.solid.bodies.empty()) return;
    const Json &volumes = mesh.at("body_volumes"), &expected = input.at("body_volumes");
    const std::size_t num = std::ranges::max(case_.solid.bodies);
    if (volumes.size() != num || expected.size() != num)
      conclude(Verdict::kDiffers, fmt::format("{} bodies, of {}", volumes.size(), num));
    for (std::size_t b = 0; b < std::min(volumes.size(), expected.size()); ++b) {
      const double shift = std::abs(volumes[b].get<double>() - expected[b].get<double>()) /
                           (area_of(case_.solid.shape) * case_.size);
      if (shift > kMaxVolumeShift)
        conclude(Verdict::kDiffers,
                 fmt::format("volume of body {} is {}, the input's {}", b + 1,
                             volumes[b].get<double>(), expected[b].get<double>()));
    }
  }

  // What the program takes the input's volume to be.
  void check_claimed_volume(double volume) {
    if (!case_.solid.volume || case_.has_noise) return;
    const Box box = box_of(case_.solid.shape);
    const double rounding = (case_.is_float ? 1e-6 : 1e-12) *
                            std::max(max_norm(box.min), max_norm(box.max)) *
                            area_of(case_.solid.shape);
    if (std::abs(volume - *case_.solid.volume) > 1e-9 * volume + rounding)
      conclude(Verdict::kDiffers, fmt::format("the input's volume is {}, and said to be {}",
                                              *case_.solid.volume, volume));
  }

  void compare_with_other_threads() {
    const TrialResult first = result_;
    const std::string bytes = bytes_of(output());
    const int num_threads = 3 - case_.num_threads;  // 1 or 2
    const int exit_code = exit_code_;
    if (mesh(num_threads) && (exit_code_ != exit_code || bytes_of(output()) != bytes))
      conclude(Verdict::kError, fmt::format("--threads {} gives another mesh", num_threads));
    else if (!is_failure(result_.verdict))
      result_ = first;
  }

  void start_anew() const {
    std::filesystem::remove_all(store());
    std::filesystem::remove(output());
  }

  std::filesystem::path output() const { return directory_ / "mesh.vtu"; }
  std::filesystem::path store() const { return directory_ / "mesh.vtu.locvol"; }

  static constexpr double kMaxVolumeShift = 0.15;  // over area and λ

  const ShapeCase& case_;
  std::filesystem::path directory_;
  double limit_;
  int exit_code_ = 0;
  TrialResult result_;
};

}  // namespace

std::vector<std::string> mesh_command(const ShapeCase& shape_case,
                                      const std::filesystem::path& directory, int num_threads) {
  std::vector<std::string> words = {"mesh", (directory / shape_case.file_name()).string(), "-o",
                                    (directory / "mesh.vtu").string()};
  const auto arguments = shape_case.mesh_arguments();
  words.insert(words.end(), arguments.begin(), arguments.end());
  words.insert(words.end(),
               {"--threads", std::to_string(num_threads), "--keep-store", "--force", "--quiet"});
  return words;
}

TrialResult try_case(const ShapeCase& shape_case, const std::filesystem::path& directory,
                     double limit) {
  return Trial(shape_case, directory, limit).result();
}

}  // namespace locvol::sweeps
