// A crew is who works on a run: one process, or several ranks, each in a process of its own.
#pragma once

#include <cstdint>

#include "engine/exchange/one_rank.h"
#include "engine/run/leaf_stage.h"
#include "engine/run/run_work.h"

namespace locvol {

class Crew {
 public:
  virtual ~Crew() = default;
  virtual Exchange& exchange() = 0;  // for what is said within steps
  // Is this step of the phase still to be done: steps are counted from 0 on, and its visits are one
  // of them. A crew that does not remember tells by the leaves that wait.
  virtual bool is_due(std::uint32_t step, bool is_before_visits) = 0;
  virtual void visit(LeafVisits& visits) = 0;
  // Ends a round of a step, or all there is of it: has any rank more to do?
  virtual bool end_round(bool has_more) = 0;
  virtual void end_phase(Phase next) = 0;
  // In seconds of all threads, if visits and their application are told apart.
  virtual double cpu_of_visits() const { return 0; }
};

// Has a run to itself.
class OneProcess : public Crew {
 public:
  explicit OneProcess(RunWork& work) : work_(work) {}
  Exchange& exchange() override { return alone(); }
  bool is_due(std::uint32_t step, bool is_before_visits) override;
  void visit(LeafVisits& visits) override;
  bool end_round(bool has_more) override;
  void end_phase(Phase next) override;

 private:
  bool has_leaves_of_phase();

  RunWork& work_;
};

}  // namespace locvol
