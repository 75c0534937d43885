// The crew of a run that one process has to itself.
#pragma once

#include "engine/exchange/one_rank.h"
#include "engine/run/crew.h"
#include "engine/run/run_work.h"

namespace locvol {

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
