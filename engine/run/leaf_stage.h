// A stage is what is done to the leaves of a run in one of its phases: which are visited, and how;
// what comes before and after, by all ranks at once; what ends it. A file each in engine/stages/.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "octree/morton_key.h"
#include "storage/records.h"

namespace locvol {

// All that a visit reads, copied from the run.
template <class Input>
struct Loaded {
  std::uint64_t bytes = 0;  // that the visit takes at its peak
  Input input;
};

// A visit that has been loaded.
class Visit {
 public:
  virtual ~Visit() = default;
  virtual std::uint64_t bytes() const = 0;  // that it takes at its peak
  virtual void compute() = 0;               // once, by any thread
  // After compute(): the run has what was found.
  virtual void apply() = 0;
  // The same later, by LeafVisits::apply(); or on other ranks.
  virtual std::string result() const = 0;
  virtual std::string result_for_others() const = 0;
};

class LeafVisits {
 public:
  virtual ~LeafVisits() = default;
  // The leaves that wait for the phase's first epoch, once each; or epoch after epoch, until none
  // waits.
  virtual bool is_once() const { return true; }
  // Do visits change what is known of other leaves, or read what others change? If they do not,
  // others need to know the visited leaf's own new records alone.
  virtual bool changes_others() const { return true; }
  // Leaves farther apart than this of both can be visited at once.
  virtual double conflict_distance(MortonKey leaf) const = 0;
  virtual std::unique_ptr<Visit> load(MortonKey leaf) = 0;
  virtual void apply(MortonKey leaf, std::string_view result) = 0;
};

class LeafStage {
 public:
  virtual ~LeafStage() = default;

  // A step is done round by round, by all ranks at once, until none has more: does this one? What a
  // round changes is committed. A step that was begun before an end of the process is done again.
  using Step = std::function<bool()>;
  virtual std::vector<Step> steps_before() { return {}; }
  // What visits need to know that is in no store: all ranks tell each other of it, when all are so
  // far; and again after each start, as long as one has not begun the next stage.
  virtual bool has_shared_knowledge() const { return false; }
  virtual void share_knowledge() {}
  // Null: it has none.
  virtual LeafVisits* visits() { return nullptr; }
  virtual std::vector<Step> steps_after() { return {}; }
  // What the next phase builds on. Tells which that is.
  virtual Phase end() = 0;
};

}  // namespace locvol
