#include "tests/sweeps/limited_run.h"

#include <fmt/format.h>
#include <signal.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <thread>

namespace locvol::sweeps {
namespace {

std::string violations_text(const nlohmann::json& report) {
  std::string text;
  for (const auto& [name, count] : report.at("violations").items())
    if (count.is_number() && count > 0)
      text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count.get<std::uint64_t>(), name);
  const nlohmann::json& examples = report.at("violations").at("examples");
  if (!examples.empty()) text += ": " + examples[0].get<std::string>();
  return text.empty() ? "no cells" : text;
}

// Of a child, so far, on all threads.
double cpu_seconds_of(pid_t child) {
  clockid_t clock = 0;
  timespec time{};
  if (clock_getcpuclockid(child, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace

LimitedRun run_limited(const std::vector<std::string>& arguments, double limit) {
  constexpr double kMostOfClock = 10;  // times the limit: for one that waits for ever
  const auto deadline =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(kMostOfClock * limit);
  Process process(arguments);
  while (!process.has_ended() && std::chrono::steady_clock::now() < deadline &&
         cpu_seconds_of(process.id()) < limit)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  const bool is_hung = !process.has_ended();
  if (is_hung) process.send(SIGKILL);
  return {process.wait(), is_hung};
}

std::string last_words(const std::string& err) {
  std::string text = err.substr(0, err.find_last_not_of(" \n") + 1);
  std::ranges::replace(text, '\n', ' ');
  return text.substr(0, 400);
}

Judgment judgment_of(int exit_code, const nlohmann::json& report) {
  if (report.at("is_valid").get<bool>())
    return {exit_code == 0 ? Verdict::kDone : Verdict::kUnresolved, ""};
  bool is_torn = exit_code == 3 && report.at("mesh").at("num_cells") > 0;
  for (const auto& [name, count] : report.at("violations").items())
    if (count.is_number() && count > 0 && !name.starts_with("bad_boundary_")) is_torn = false;
  return {is_torn ? Verdict::kTorn : Verdict::kError,
          fmt::format("exit code {} and not valid: {}", exit_code, violations_text(report))};
}

}  // namespace locvol::sweeps
