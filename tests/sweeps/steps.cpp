// Linked into the locvol that the kill sweep runs, and only there: the linker sends the calls of
// some functions here (--wrap), which counts them and can kill the process at one of them.
//
//   LOCVOL_KILL_AT=STEP:N:before|after   kill -9 at the N-th call of the step (from 1)
//   LOCVOL_STEP_LOG=FILE                 a letter is appended for each call, even if it is killed
//   LOCVOL_FAIL_VISITS_FROM=N            from the N-th visit on (from 1), any with more than one
//                                        insertion fails
//
// The functions belong to the faces of the layers. When one changes its signature, its symbol is no
// longer referred to and its step never happens: the sweep says so. Then mend it here and in
// tests/CMakeLists.txt (nm -C shows the symbols).
#include "tests/sweeps/steps.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "octree/octree.h"
#include "refine/cover_leaf.h"
#include "refine/leaf.h"
#include "storage/store.h"

namespace locvol::sweeps {
namespace {

struct KillAt {
  std::string_view step;
  long number = 0;
  bool is_before = true;
};

KillAt read_kill_at() {
  const char* const text = std::getenv("LOCVOL_KILL_AT");
  if (text == nullptr) return {};
  const char* const colon = std::strchr(text, ':');
  return {std::string_view(text, colon), std::atol(colon + 1),
          std::strstr(colon, ":before") != nullptr};
}

int open_log() {
  const char* const file = std::getenv("LOCVOL_STEP_LOG");
  return file == nullptr ? -1 : open(file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
}

std::atomic<long> num_calls[std::size(kSteps)];

// Runs `call` as the next call of the step.
template <class Call>
auto step(Step which, const Call& call) {
  static const KillAt kill_at = read_kill_at();
  static const int log = open_log();
  const auto i = static_cast<std::size_t>(which);
  const bool is_it = kSteps[i].name == kill_at.step && ++num_calls[i] == kill_at.number;
  if (log >= 0 && write(log, &kSteps[i].letter, 1) != 1) std::abort();
  if (is_it && kill_at.is_before) raise(SIGKILL);
  struct KillAfter {
    bool is_due;
    ~KillAfter() {
      if (is_due) raise(SIGKILL);
    }
  } const kill_after{is_it && !kill_at.is_before};
  return call();
}

bool is_to_fail() {
  static const char* const text = std::getenv("LOCVOL_FAIL_VISITS_FROM");
  static std::atomic<long> num_visits = 0;
  return text != nullptr && ++num_visits >= std::atol(text);
}

}  // namespace
}  // namespace locvol::sweeps

using namespace locvol;
using sweeps::Step;

static LeafInput with_one_insertion(LeafInput input) {
  input.max_insertions = 1;
  return input;
}

// SYMBOL is the mangled name; the parameters of a member function begin with the object.
// Aligned, for an odd address in a pointer to a member function means a virtual one.
#define WRAP(which, Result, function, symbol, parameters, arguments)               \
  Result real_##function parameters asm("__real_" symbol);                         \
  [[gnu::aligned(16)]] Result wrapped_##function parameters asm("__wrap_" symbol); \
  Result wrapped_##function parameters {                                           \
    return sweeps::step(Step::which, [&] { return real_##function arguments; });   \
  }

WRAP(kIngest, void, put_surface, "_ZN6locvol5Batch11put_surfaceENS_9MortonKeyERKNS_11LeafSurfaceE",
     (Batch * batch, MortonKey leaf, const LeafSurface& surface), (batch, leaf, surface))
WRAP(kLoad, LeafPoints, points, "_ZNK6locvol6Reader6pointsENS_9MortonKeyE",
     (const Reader* reader, MortonKey leaf), (reader, leaf))
WRAP(kCover, CoverPoints, cover_leaf, "_ZN6locvol10cover_leafENS_10CoverInputEPKNS_9StopTokenE",
     (CoverInput input, const StopToken* stop), (std::move(input), stop))
WRAP(kRefine, LeafDelta, refine_leaf,
     "_ZN6locvol11refine_leafENS_9LeafInputERKNS_10VisitWatchERKNS_10WholeModelE",
     (LeafInput input, const VisitWatch& watch, const WholeModel& whole),
     (sweeps::is_to_fail() ? with_one_insertion(std::move(input)) : std::move(input), watch, whole))
WRAP(kSplit, void, split, "_ZN6locvol12LinearOctree5splitENS_9MortonKeyE",
     (LinearOctree * octree, MortonKey leaf), (octree, leaf))
WRAP(kCommit, void, commit, "_ZN6locvol5Batch6commitEv", (Batch * batch), (batch))
WRAP(kExport, LeafCells, cells, "_ZNK6locvol6Reader5cellsENS_9MortonKeyE",
     (const Reader* reader, MortonKey leaf), (reader, leaf))
