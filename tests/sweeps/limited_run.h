// Runs the command within a limit of time, and judges what it says of a mesh.
#pragma once

#include <array>
#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "tests/tools/process.h"

namespace locvol::sweeps {

enum class Verdict {
  kDone,        // exit code 0, and the audit finds the mesh valid
  kUnresolved,  // exit code 3, likewise
  kRefused,     // for a reason that a user could act on: the case is void
  kTorn,        // exit code 3, and the mesh's boundary is no 2-manifold
  kHung,
  kError,    // any other end, or any other fault that the audit finds
  kDiffers,  // well resolved, but not of the input's volume or topology
};
inline constexpr std::array<std::string_view, 7> kVerdictNames = {
    "exit 0", "exit 3", "refused", "torn", "hung", "error", "differs"};
inline std::string_view name(Verdict verdict) {
  return kVerdictNames[static_cast<std::size_t>(verdict)];
}
inline bool is_failure(Verdict verdict) { return verdict > Verdict::kRefused; }

struct Judgment {
  Verdict verdict = Verdict::kDone;
  std::string reason;  // if there is one
};

struct LimitedRun {
  ProcessResult process;
  bool is_hung = false;  // it took longer than the limit, and was ended
};
// `limit`: seconds of CPU time, for others may be at work
LimitedRun run_limited(const std::vector<std::string>& arguments, double limit);

// What it said of an error, as one line.
std::string last_words(const std::string& err);

// Of a run that ended with exit code 0 or 3, by the audit's report of its mesh.
Judgment judgment_of(int exit_code, const nlohmann::json& report);

}  // namespace locvol::sweeps
