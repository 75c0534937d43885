// flip_sweep [--brief] [--seed N]: flips bits in the data files of small stores, finished ones and
// such as a run leaves that is interrupted, and then does what a user does: inspect, audit and
// export, or resume and export. Each must be refused with an error that names the store, or give
// the same mesh as the undamaged store; never a crash, a hang or another mesh.
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "storage/store.h"
#include "tests/file_bytes.h"
#include "tests/sweeps/trial.h"
#include "tests/temp_dir.h"
#include "tools/generate.h"

namespace locvol::sweeps {
namespace {

constexpr std::size_t kPageBytes = 4096;
constexpr unsigned kHangSeconds = 120;

// What is being tried, for the handler of the signal that ends the program.
std::array<char, 200> trying{};

void on_crash(int number) {
  [[maybe_unused]] const ssize_t written =
      write(STDERR_FILENO, trying.data(), strlen(trying.data()));
  std::signal(number, SIG_DFL);
  std::raise(number);
}

void write_content(const std::filesystem::path& file, const std::string& content) {
  std::ofstream(file, std::ios::binary) << content;
}

// A store as a run left it, and the mesh that it must lead to.
struct Sample {
  std::string name;
  std::string data;  // of data.mdb
  std::string mesh;
  bool is_finished = false;
};

class Samples {
 public:
  explicit Samples(const std::filesystem::path& directory) : directory_(directory) {
    generate("octahandles", 2000, directory_ / "surface.stl");
  }

  // Interrupted when it has asked this often whether it should stop; after its end: finished.
  Sample make(const std::string& name, int num_visits) {
    const auto store = directory_ / "made";
    std::filesystem::remove_all(store);
    int num_asked = 0;
    RunControl control;
    control.is_stopped = [&] { return ++num_asked > num_visits; };
    const RunSummary summary = mesh(options(store), control);
    Sample sample{
        name, bytes_of(store / "data.mdb"), {}, summary.outcome != RunOutcome::kInterrupted};
    resume(store);
    sample.mesh = mesh_of(store);
    require(summary.run.counts.num_unresolved == 0, "the sample has unresolved sites");
    return sample;
  }

  std::string mesh_of(const std::filesystem::path& store) const {
    const auto file = directory_ / "mesh.vtu";
    write_vtu(Store::open(store, {.read_only = true}), file);
    return bytes_of(file);
  }

 private:
  MeshOptions options(const std::filesystem::path& store) const {
    MeshOptions options;
    options.input = directory_ / "surface.stl";
    options.store = store;
    options.size = {10, true};
    options.leaf_capacity = 60;
    return options;
  }

  std::filesystem::path directory_;
};

// All that `locvol inspect` reads.
void inspect(const Store& store) {
  const Snapshot snapshot = store.snapshot();
  summarize(snapshot);
  for (const MortonKey leaf : snapshot.leaf_keys()) {
    const auto info = snapshot.leaf(leaf);
    require(info && snapshot.points(leaf).points.size() == info->num_points &&
                snapshot.cells(leaf).cells.size() == info->num_cells &&
                snapshot.surface(leaf).triangles.size() == info->num_triangles &&
                snapshot.unresolved(leaf).sites.size() == info->num_unresolved,
            "a leaf's records are not as many as it says");
    if (info->queued)
      require(snapshot.has_queue_entry({*info->queued, leaf}), "a queue entry is missing");
  }
  std::size_t num_queued = 0;
  snapshot.for_each_queued([&](const QueueEntry&) { return ++num_queued > 0; });
}

class FlipSweep {
 public:
  FlipSweep(const Sample& sample, const Samples& samples, const std::filesystem::path& directory)
      : sample_(sample), samples_(samples), store_(directory / "flipped") {
    std::filesystem::create_directories(store_);
  }

  void flip(std::size_t at, char mask) {
    std::snprintf(trying.data(), trying.size(), "flip_sweep: %s, byte %zu, mask %02x: crashed\n",
                  sample_.name.c_str(), at, mask & 0xff);
    std::string damaged = sample_.data;
    damaged[at] = static_cast<char>(damaged[at] ^ mask);
    try_data(damaged, fmt::format("byte {}, mask {:02x}", at, mask & 0xff));
  }

  void cut(std::size_t length) {
    std::snprintf(trying.data(), trying.size(), "flip_sweep: %s, cut to %zu bytes: crashed\n",
                  sample_.name.c_str(), length);
    try_data(sample_.data.substr(0, length), fmt::format("cut to {} bytes", length));
  }

  void print() const {
    fmt::print("{}, {} bytes: {} trials, {} harmless, {} refused\n", sample_.name,
               sample_.data.size(), num_trials_, num_trials_ - num_refused_, num_refused_);
    for (const auto& [message, count] : messages_) fmt::print("  {:>6} x {}\n", count, message);
  }
  int num_refused() const { return num_refused_; }

 private:
  void try_data(const std::string& data, const std::string& what) {
    ++num_trials_;
    std::filesystem::remove(store_ / "lock.mdb");
    write_content(store_ / "data.mdb", data);
    alarm(kHangSeconds);
    try {
      use(what);
    } catch (const StoreError& error) {
      refuse(error.what(), what);
    }
    alarm(0);
  }

  // Anything but a StoreError is a failure: other errors would blame the input or the program.
  void use(const std::string& what) try {
    if (sample_.is_finished) {
      const Store store = Store::open(store_, {.read_only = true});
      inspect(store);
      require(audit(store).is_valid(), "the audit finds faults");
    } else {
      { inspect(Store::open(store_, {.read_only = true})); }
      resume(store_);
    }
    require(samples_.mesh_of(store_) == sample_.mesh, "another mesh");
  } catch (const StoreError&) {
    throw;
  } catch (const std::exception& error) {
    throw Failure(sample_.name + ", " + what + ": " + error.what());
  }

  void refuse(const std::string& message, const std::string& what) {
    ++num_refused_;
    require(message.find(store_.string()) != std::string::npos,
            sample_.name + ", " + what + ": the error does not name the store: " + message);
    // Without what differs from leaf to leaf.
    std::string kind = message.substr(message.find(store_.string()) + store_.string().size());
    if (const auto leaf = kind.find(" of the leaf"); leaf != std::string::npos)
      kind.erase(leaf, kind.find(": ", leaf) - leaf);
    for (char& c : kind)
      if (c >= '0' && c <= '9') c = '#';
    if (const auto cure = kind.find("; it cannot be mended"); cure != std::string::npos)
      kind.resize(cure);
    ++messages_[kind.substr(0, 100)];
  }

  const Sample& sample_;
  const Samples& samples_;
  std::filesystem::path store_;
  int num_trials_ = 0, num_refused_ = 0;
  std::map<std::string, int> messages_;
};

// Pages that LMDB's trust in can do most harm: meta pages and pages of trees.
bool is_structure(const std::string& data, std::size_t page) {
  std::uint16_t flags = 0;
  std::memcpy(&flags, data.data() + page + 10, sizeof flags);
  return flags != 0x04;
}

void sweep(const Sample& sample, const Samples& samples, const std::filesystem::path& directory,
           bool is_brief, std::mt19937_64& random) {
  FlipSweep flips(sample, samples, directory);
  const auto mask = [&] { return static_cast<char>(1 << random() % 8); };
  // How many bytes are passed over, on average: a resume costs more than an export.
  const std::uint64_t factor =
      is_brief ? (sample.is_finished ? 480 : 1200) : (sample.is_finished ? 1 : 10);
  for (std::size_t page = 0; page < sample.data.size(); page += kPageBytes) {
    const bool is_dense = is_structure(sample.data, page);
    const std::size_t header = page < 2 * kPageBytes ? 160 : 32;
    for (std::size_t i = 0; i < kPageBytes && page + i < sample.data.size(); ++i) {
      const std::uint64_t stride = factor * (i < header ? 1 : is_dense ? 4 : 40);
      if (random() % stride == 0) flips.flip(page + i, mask());
      if (is_brief) continue;
      if (i < header && random() % factor == 0) flips.flip(page + i, static_cast<char>(0xff));
    }
  }
  const std::size_t step = is_brief ? 16 * kPageBytes : kPageBytes / 2;
  for (std::size_t length = 0; length < sample.data.size(); length += step) flips.cut(length);
  flips.print();
  require(flips.num_refused() > (is_brief ? 1 : 100),
          sample.name + ": next to nothing was noticed");
}

void run(bool is_brief, std::uint64_t seed) {
  for (const int number : {SIGSEGV, SIGBUS, SIGABRT, SIGALRM, SIGFPE})
    std::signal(number, on_crash);
  fmt::print("flipped bits, seed {}\n", seed);
  std::mt19937_64 random(seed);
  const TempDir directory;
  Samples samples(directory.path());
  for (const auto& [name, num_visits] : std::map<std::string, int>{
           {"finished", 1 << 30}, {"interrupted while refining", 60}, {"while initializing", 3}})
    sweep(samples.make(name, num_visits), samples, directory.path(), is_brief, random);
  fmt::print("nothing broke\n");
}

}  // namespace
}  // namespace locvol::sweeps

int main(int argc, char** argv) {
  CLI::App app("Flips bits in stores");
  bool is_brief = false;
  std::uint64_t seed = std::random_device()();
  app.add_flag("--brief", is_brief, "Some hundred flips of each store");
  app.add_option("--seed", seed, "Which bits (default: others each time)");
  CLI11_PARSE(app, argc, argv);
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  try {
    locvol::sweeps::run(is_brief, seed);
    return 0;
  } catch (const std::exception& failure) {
    fmt::print(stderr, "flip_sweep: {}\n", failure.what());
    return 1;
  }
}
