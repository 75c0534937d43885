#include "engine/shared/memory_budget.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <charconv>
#include <fstream>
#include <limits>
#include <optional>
#include <string_view>

#include "engine/shared/workers.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMiB = std::uint64_t{1} << 20;

// Code and libraries, what they set up, and the pages of LMDB's map between two releases.
constexpr std::uint64_t kProgramBytes = 32 * kMiB;
// To read, check and cut a surface of any size.
constexpr std::uint64_t kIngestBytes = 64 * kMiB;
// More threads than visits find memory would only take it from them, for their stacks.
constexpr std::uint64_t kLeastHeapOfThread = 16 * kMiB;
// For each thread besides the first that checks a bucket of the surface, or writes a piece of the
// output, and for one that waits.
constexpr std::uint64_t kBytesPerStreamingThread = 24 * kMiB;
// In the octree, the queue with its colors, and the writer's tables.
constexpr std::uint64_t kBytesPerLeaf = 256;
// What a changed record takes from its change until the commit is over, over its decoded size:
// itself, its encoded form, and LMDB's dirty pages, each of the latter at most half as large.
constexpr std::uint64_t kCommitFactor = 2;
// Free blocks between used ones; pages that malloc keeps.
constexpr double kHeapSlack = 1.2;
constexpr std::uint64_t kLeastUnwritten = 4 * kMiB, kMostUnwritten = 32 * kMiB;

std::uint64_t with_slack(std::uint64_t bytes) {
  return static_cast<std::uint64_t>(kHeapSlack * static_cast<double>(bytes));
}
std::uint64_t without_slack(std::uint64_t bytes) {
  return static_cast<std::uint64_t>(static_cast<double>(bytes) / kHeapSlack);
}

// The number after `name` in a file of lines such as "VmHWM:    1234 kB", in bytes.
std::optional<std::uint64_t> bytes_in(const char* file, std::string_view name) {
  std::ifstream lines(file);
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with(name)) continue;
    const std::size_t digit = line.find_first_of("0123456789", name.size());
    std::uint64_t kilobytes = 0;
    if (digit == std::string::npos) return std::nullopt;
    std::from_chars(line.data() + digit, line.data() + line.size(), kilobytes);
    return 1024 * kilobytes;
  }
  return std::nullopt;
}

// The first number in a file; nothing for "max".
std::optional<std::uint64_t> number_in(const std::string& file) {
  std::ifstream in(file);
  std::uint64_t value = 0;
  return in >> value ? std::optional(value) : std::nullopt;
}

// What is left of the limits on the control groups that the process is in, as far as it sees them.
std::uint64_t free_in_control_groups() {
  std::uint64_t free = std::numeric_limits<std::uint64_t>::max();
  const auto apply = [&](const std::string& directory, const char* limit, const char* usage) {
    const auto most = number_in(directory + limit);
    const auto used = number_in(directory + usage);
    if (most && used) free = std::min(free, *most > *used ? *most - *used : 0);
  };
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const std::size_t path = line.rfind(':') + 1;
    const bool is_unified = line.starts_with("0::");
    if (!is_unified && line.find(":memory:") == std::string::npos) continue;
    for (const std::string& group : {line.substr(path), std::string()}) {
      if (is_unified)
        apply("/sys/fs/cgroup" + group, "/memory.max", "/memory.current");
      else
        apply("/sys/fs/cgroup/memory" + group, "/memory.limit_in_bytes", "/memory.usage_in_bytes");
    }
  }
  return free;
}

std::uint64_t free_within_limit(int resource, std::string_view used_name) {
  rlimit limit{};
  if (getrlimit(static_cast<__rlimit_resource>(resource), &limit) != 0 ||
      limit.rlim_cur == RLIM_INFINITY)
    return std::numeric_limits<std::uint64_t>::max();
  const std::uint64_t used = bytes_in("/proc/self/status", used_name).value_or(0);
  return limit.rlim_cur > used ? limit.rlim_cur - used : 0;
}

std::uint64_t unwritten_of(std::uint64_t rest) {
  return std::clamp(rest / (8 * kCommitFactor), kLeastUnwritten, kMostUnwritten);
}

// The heap under a cap, negative if the cap does not even hold the rest.
std::int64_t heap_under(std::uint64_t cap, std::uint64_t leaves) {
  const std::uint64_t fixed = kProgramBytes + leaves;
  const std::uint64_t rest = cap > fixed ? cap - fixed : 0;
  return static_cast<std::int64_t>(cap) - static_cast<std::int64_t>(fixed) -
         static_cast<std::int64_t>(with_slack(kCommitFactor * unwritten_of(rest)));
}

}  // namespace

std::uint64_t free_memory() {
  const auto pages = static_cast<std::uint64_t>(std::max(sysconf(_SC_PHYS_PAGES), 0L));
  const auto page_bytes = static_cast<std::uint64_t>(std::max(sysconf(_SC_PAGESIZE), 0L));
  const std::uint64_t available =
      bytes_in("/proc/meminfo", "MemAvailable:").value_or(pages * page_bytes / 2);
  return std::min({available, free_in_control_groups(), free_within_limit(RLIMIT_DATA, "VmData:"),
                   free_within_limit(RLIMIT_AS, "VmSize:")});
}

const std::uint64_t kLeastMemory = kProgramBytes + kIngestBytes;

std::uint64_t memory_cap(std::uint64_t asked, std::uint64_t besides) {
  const std::uint64_t cap = asked > 0 ? asked : free_memory() / 2, least = kLeastMemory + besides;
  if (cap < least)
    throw OverBudget("a memory cap of " + memory_text(cap) + " is too small for any run: give " +
                         memory_text(least) + " or more",
                     least);
  return cap - besides;
}

int num_streaming_threads(int asked, std::uint64_t cap) {
  const int num_threads = asked > 0 ? asked : num_usable_threads();
  const std::uint64_t for_others = cap - std::min(cap, kProgramBytes + kIngestBytes);
  return static_cast<int>(std::min<std::uint64_t>(static_cast<std::uint64_t>(num_threads),
                                                  1 + for_others / kBytesPerStreamingThread));
}

std::uint64_t peak_resident_memory() { return bytes_in("/proc/self/status", "VmHWM:").value_or(0); }

std::uint64_t resident_memory() { return bytes_in("/proc/self/status", "VmRSS:").value_or(0); }

MemoryPlan::MemoryPlan(std::uint64_t cap, std::uint64_t num_leaves, std::uint64_t largest_visit)
    : cap_(cap), leaves_(num_leaves * kBytesPerLeaf) {
  const std::uint64_t least_heap = largest_visit + kLeastCacheBytes;
  const std::int64_t heap = heap_under(cap, leaves_);
  if (heap < static_cast<std::int64_t>(with_slack(least_heap)))
    throw OverBudget("a memory cap of " + memory_text(cap) + " is too small for this run: give " +
                         memory_text(cap_with_heap(least_heap)) +
                         " or more, or begin anew with a smaller leaf capacity",
                     least_heap);
  unwritten_ = unwritten_of(cap - kProgramBytes - leaves_);
  heap_ = without_slack(static_cast<std::uint64_t>(heap));
}

std::uint64_t MemoryPlan::cap_with_heap(std::uint64_t heap) const {
  const auto wanted = static_cast<std::int64_t>(with_slack(heap));
  std::uint64_t cap = kProgramBytes + leaves_;
  while (heap_under(cap, leaves_) < wanted) cap += kMiB;
  return cap;
}

int MemoryPlan::num_threads(int asked) const {
  return static_cast<int>(
      std::min<std::uint64_t>(static_cast<std::uint64_t>(asked), 1 + heap_ / kLeastHeapOfThread));
}

MemoryRecord MemoryPlan::record() const {
  return {.cap = cap_,
          .program = kProgramBytes,
          .leaves = leaves_,
          .commits = with_slack(kCommitFactor * unwritten_)};
}

MemoryBudget::Reservation::~Reservation() {
  if (!budget_) return;
  {
    const std::lock_guard lock(budget_->mutex_);
    budget_->free_ += bytes_;
  }
  budget_->given_back_.notify_all();
}

void MemoryBudget::take(std::unique_lock<std::mutex>& lock, std::uint64_t bytes) {
  if (bytes > total_)
    throw OverBudget("its visit takes " + memory_text(bytes) + ", and the memory cap leaves " +
                         memory_text(total_),
                     bytes + kept_ + kLeastCacheBytes);
  given_back_.wait(lock, [&] { return free_ >= bytes; });
  free_ -= bytes;
}

MemoryBudget::Reservation MemoryBudget::reserve(std::uint64_t bytes) {
  std::unique_lock lock(mutex_);
  take(lock, bytes);
  largest_ = std::max(largest_, bytes);
  return {this, bytes};
}

void MemoryBudget::keep(std::uint64_t bytes) {
  std::unique_lock lock(mutex_);
  take(lock, bytes);
  total_ -= bytes;
  kept_ += bytes;
}

std::uint64_t MemoryBudget::total() const {
  const std::lock_guard lock(mutex_);
  return total_;
}

std::uint64_t MemoryBudget::free_bytes() const {
  const std::lock_guard lock(mutex_);
  return free_;
}

std::uint64_t MemoryBudget::largest_reservation() const {
  const std::lock_guard lock(mutex_);
  return largest_;
}

std::string memory_text(std::uint64_t bytes) {
  return std::to_string((bytes + kMiB - 1) / kMiB) + "M";
}

}  // namespace locvol
