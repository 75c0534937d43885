// Trial runs `locvol mesh` on one generated surface again and again, disturbed and undisturbed, and
// says what came of it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "storage/records.h"

namespace locvol::sweeps {

// A claim that did not hold. What was being tried is in the message.
class Failure : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
void require(bool holds, const std::string& otherwise);

inline constexpr int kNumThreads = 2;  // of each run
// Between two commits, and under way.
inline constexpr std::uint64_t kMaxVisitsInHand = 64 + 4 * kNumThreads;

struct Model {
  std::string shape;
  std::string num_triangles;
  std::string size;
  std::string leaf_capacity;
  std::vector<std::string> options = {};  // others
  std::string name() const;
};

struct Ending {
  int exit_code = -1;  // -1: a signal ended it
  int signal = 0;
  bool is_hung = false;  // it took too long, and was killed
  double seconds = 0;
  std::optional<double> stop_seconds;  // from SIGTERM to the end; absent: that came first
  std::string out, err;
  std::string fired;        // the call at which a fault happened; empty: none did
  long long num_calls = 0;  // that could have had the fault
  std::string steps;        // letters of kSteps

  std::string text() const;
};

struct Disturbance {
  std::map<std::string, std::string> environment;
  std::optional<double> kill_after_seconds;
  std::optional<double> stop_after_seconds = {};  // SIGTERM, once the process is prepared for it

  static Disturbance fault(const std::string& fault) { return {{{"LOCVOL_FAULT", fault}}, {}}; }
  static Disturbance kill_at(const std::string& step) { return {{{"LOCVOL_KILL_AT", step}}, {}}; }
  static Disturbance stop_after(double seconds) { return {{}, {}, seconds}; }
  static Disturbance fail_visits_from(std::uint64_t number) {
    return {{{"LOCVOL_FAIL_VISITS_FROM", std::to_string(number)}}, {}};
  }
};

// Runs the command, disturbed. Faults come in calls on files below the directory.
Ending run_locvol(const std::filesystem::path& directory, const std::vector<std::string>& arguments,
                  const Disturbance& disturbance = {});
// The first number from 1 to `count`, the last one and some between.
std::vector<std::uint64_t> some_of(std::uint64_t count, std::uint64_t how_many);
std::string content_of(const std::filesystem::path& file);

// What is known of a store from outside, after its process has gone.
struct StoreState {
  std::optional<Phase> phase;  // absent: no run has begun
  std::uint64_t num_visits = 0;
};

class Trial {
 public:
  // Generates the surface and meshes it undisturbed.
  Trial(const Model& model, const std::filesystem::path& directory);
  Trial(const Trial&) = delete;
  Trial& operator=(const Trial&) = delete;

  const Model& model() const { return model_; }
  const Ending& undisturbed() const { return undisturbed_; }
  std::uint64_t num_steps(char letter) const;  // of the undisturbed run

  void start_anew();  // neither store nor output
  // Runs the command, beside what the last one left.
  Ending run(const Disturbance& disturbance = {});
  StoreState store_state() const;
  // Runs the command undisturbed; it must end well, with the undisturbed run's bytes.
  Ending require_same_bytes(const std::string& after);
  // For a run that ended by itself.
  void require_undisturbed_bytes(const std::string& after) const;
  std::filesystem::path store() const;
  std::filesystem::path output() const;

 private:
  Model model_;
  std::filesystem::path directory_;
  std::string mesh_;  // the undisturbed run's bytes
  Ending undisturbed_;
};

}  // namespace locvol::sweeps
