#include "tests/sweeps/trial.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iterator>
#include <sstream>
#include <system_error>
#include <thread>

#include "storage/store.h"

extern char** environ;

namespace locvol::sweeps {
namespace {

using Clock = std::chrono::steady_clock;
constexpr double kHangSeconds = 300;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Built beside this program.
std::string built(const char* name) {
  static const auto directory = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  return (directory / name).string();
}

// Out of reach of the faults.
std::filesystem::path logs_of(const std::filesystem::path& directory) {
  return directory.parent_path() / ("logs-of-" + directory.filename().string());
}

// The library is preloaded in every run, so that all are the same but for the fault.
std::vector<std::string> environment_for(const std::filesystem::path& directory,
                                         const Disturbance& disturbance) {
  std::vector<std::string> all;
  for (char** entry = environ; *entry != nullptr; ++entry) all.emplace_back(*entry);
  all.push_back("LD_PRELOAD=" + built("liblocvol_faults.so"));
  // A sanitizer wants to come first; that it does not is of no harm to what is tried here.
  all.push_back("ASAN_OPTIONS=verify_asan_link_order=0:detect_leaks=0");
  all.push_back("LOCVOL_FAULT_DIR=" + directory.string());
  all.push_back("LOCVOL_FAULT_LOG=" + (logs_of(directory) / "faults.log").string());
  all.push_back("LOCVOL_STEP_LOG=" + (logs_of(directory) / "steps.log").string());
  for (const auto& [name, value] : disturbance.environment) all.push_back(name + "=" + value);
  return all;
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> all;
  for (std::string& text : texts) all.push_back(text.data());
  all.push_back(nullptr);
  return all;
}

bool has_ended(pid_t process) {
  siginfo_t info = {};  // si_pid stays 0 while the process runs
  waitid(P_PID, static_cast<id_t>(process), &info, WEXITED | WNOHANG | WNOWAIT);
  return info.si_pid != 0;
}

bool catches(pid_t process, int signal) {
  std::istringstream status(content_of(fmt::format("/proc/{}/status", process)));
  for (std::string word; status >> word;)
    if (word == "SigCgt:" && status >> word)
      return std::stoull(word, nullptr, 16) >> (signal - 1) & 1;
  return false;
}

// Before it catches the signal, a process has done nothing, and ends as any does. One that will go
// on another time catches SIGALRM as well, last.
void stop(pid_t process, Clock::time_point start, double after_seconds, int prepared_for,
          Ending& ending) {
  while (!has_ended(process) &&
         (seconds_since(start) < after_seconds || !catches(process, prepared_for)))
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  if (has_ended(process)) return;
  const auto stopped = Clock::now();
  kill(process, SIGTERM);
  while (!has_ended(process) && seconds_since(stopped) < kHangSeconds)
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  ending.stop_seconds = seconds_since(stopped);
}

// Waits for the end, and brings it about when it is time.
void end(pid_t process, bool may_go_on, const Disturbance& disturbance, Ending& ending) {
  const auto start = Clock::now();
  if (disturbance.stop_after_seconds)
    stop(process, start, *disturbance.stop_after_seconds, may_go_on ? SIGALRM : SIGTERM, ending);
  const double patience = disturbance.kill_after_seconds.value_or(kHangSeconds);
  while (!has_ended(process) && seconds_since(start) < patience)
    std::this_thread::sleep_for(std::chrono::microseconds(500));
  if (!has_ended(process)) {
    ending.is_hung = !disturbance.kill_after_seconds;
    kill(process, SIGKILL);
  }
  int status = 0;
  waitpid(process, &status, 0);
  ending.seconds = seconds_since(start);
  if (WIFEXITED(status)) ending.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) ending.signal = WTERMSIG(status);
}

void read_fault_log(const std::string& log, Ending& ending) {
  std::istringstream lines(log);
  for (std::string word; lines >> word;) {
    if (word == "fired") std::getline(lines >> std::ws, ending.fired);
    if (word == "calls") lines >> ending.num_calls;
  }
}

}  // namespace

void require(bool holds, const std::string& otherwise) {
  if (!holds) throw Failure(otherwise);
}

std::string Model::name() const {
  return fmt::format("{} -n {} --size {}{}{}", shape, num_triangles, size,
                     options.empty() ? "" : " ", fmt::join(options, " "));
}

std::string Ending::text() const {
  return fmt::format("{} after {:.2f} s{}{}{}",
                     is_hung      ? "hung"
                     : signal > 0 ? fmt::format("signal {}", signal)
                                  : fmt::format("exit code {}", exit_code),
                     seconds, fired.empty() ? "" : ", fault in " + fired, err.empty() ? "" : ": ",
                     err);
}

std::string content_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::vector<std::uint64_t> some_of(std::uint64_t count, std::uint64_t how_many) {
  std::vector<std::uint64_t> numbers;
  for (std::uint64_t i = 0; i < how_many && count > 0; ++i)
    numbers.push_back(1 + i * (count - 1) / std::max<std::uint64_t>(how_many - 1, 1));
  const auto repeated = std::ranges::unique(numbers);
  numbers.erase(repeated.begin(), repeated.end());
  return numbers;
}

Ending run_locvol(const std::filesystem::path& directory, const std::vector<std::string>& arguments,
                  const Disturbance& disturbance) {
  std::filesystem::create_directories(logs_of(directory));
  for (const char* name : {"out", "err", "faults.log", "steps.log"})
    std::filesystem::remove(logs_of(directory) / name);
  std::vector<std::string> words = {built("locvol_steps")};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<std::string> environment = environment_for(directory, disturbance);

  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  const std::string out = (logs_of(directory) / "out").string();
  const std::string err = (logs_of(directory) / "err").string();
  posix_spawn_file_actions_addopen(&files, 1, out.c_str(), O_WRONLY | O_CREAT, 0600);
  posix_spawn_file_actions_addopen(&files, 2, err.c_str(), O_WRONLY | O_CREAT, 0600);
  pid_t process = 0;
  const int error = posix_spawn(&process, words[0].c_str(), &files, nullptr, pointers(words).data(),
                                pointers(environment).data());
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) throw std::system_error(error, std::generic_category(), words[0]);

  Ending ending;
  end(process, arguments.front() == "mesh", disturbance, ending);
  ending.out = content_of(out);
  ending.err = content_of(err);
  ending.steps = content_of(logs_of(directory) / "steps.log");
  read_fault_log(content_of(logs_of(directory) / "faults.log"), ending);
  return ending;
}

Trial::Trial(const Model& model, const std::filesystem::path& directory)
    : model_(model), directory_(directory) {
  std::filesystem::create_directories(directory_);
  const Ending generated = run_locvol(directory_,
                                      {"generate", model.shape, "-n", model.num_triangles, "-o",
                                       (directory_ / "surface.stl").string()},
                                      {});
  require(generated.exit_code == 0, "cannot generate " + model.name() + ": " + generated.text());
  start_anew();
  // A fault that never comes, so that the calls are counted.
  undisturbed_ = run();
  require(undisturbed_.exit_code == 0, model.name() + " undisturbed: " + undisturbed_.text());
  mesh_ = content_of(output());
}

std::uint64_t Trial::num_steps(char letter) const {
  return static_cast<std::uint64_t>(std::ranges::count(undisturbed_.steps, letter));
}

std::filesystem::path Trial::output() const { return directory_ / "mesh.vtu"; }
std::filesystem::path Trial::store() const { return directory_ / "mesh.vtu.locvol"; }

void Trial::start_anew() {
  std::filesystem::remove_all(store());
  std::filesystem::remove(output());
}

Ending Trial::run(const Disturbance& disturbance) {
  std::vector<std::string> words = {"mesh",
                                    (directory_ / "surface.stl").string(),
                                    "-o",
                                    output().string(),
                                    "--size",
                                    model_.size,
                                    "--leaf-capacity",
                                    model_.leaf_capacity,
                                    "--threads",
                                    std::to_string(kNumThreads),
                                    "--quiet"};
  words.insert(words.end(), model_.options.begin(), model_.options.end());
  return run_locvol(directory_, words, disturbance);
}

StoreState Trial::store_state() const {
  if (!Store::exists(store())) return {};
  std::optional<RunRecord> run;
  try {
    run = Store::open(store(), {.read_only = true}).snapshot().run();
  } catch (const StoreError& error) {
    // A creation that was cut short; anything else is damage.
    if (std::string(error.what()).find("not a locvol store") == std::string::npos) throw;
  }
  if (!run) return {};
  return {run->phase, run->counts.num_visits};
}

Ending Trial::require_same_bytes(const std::string& after) {
  Ending ending = run();
  require(ending.exit_code == 0,
          model_.name() + " after " + after + ": the same command ends with " + ending.text());
  require_undisturbed_bytes(after);
  return ending;
}

void Trial::require_undisturbed_bytes(const std::string& after) const {
  require(content_of(output()) == mesh_, model_.name() + " after " + after + ": another mesh");
  for (const auto& entry : std::filesystem::directory_iterator(directory_))
    require(entry.path() == output() || !entry.path().filename().string().starts_with("mesh.vtu"),
            model_.name() + " after " + after + ": " + entry.path().string() + " is left behind");
}

}  // namespace locvol::sweeps
