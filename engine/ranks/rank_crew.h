// The crew of a run that several ranks work on: this one's part of the work.
#pragma once

#include <optional>

#include "engine/exchange/recorded_exchange.h"
#include "engine/ranks/rank_visits.h"
#include "engine/run/crew.h"
#include "engine/run/run_work.h"

namespace locvol {

class RankCrew : public Crew {
 public:
  // `is_behind`: others say again what they said while this one ended (HeldRun).
  RankCrew(RunWork& work, Exchange& exchange, bool is_behind)
      : work_(work), exchange_(exchange), turns_(work.state(), exchange_), is_behind_(is_behind) {}

  Exchange& exchange() override { return exchange_; }
  bool is_due(std::uint32_t step, bool is_before_visits) override;
  // Color after color: what a color's visits find is sent to whom it matters to, and then applied.
  void visit(LeafVisits& visits) override;
  bool end_round(bool has_more) override;
  void end_phase(Phase next) override;

  // Of the rank's own visits, without applying them.
  double cpu_of_visits() const override { return cpu_of_visits_; }

 private:
  class Colors;

  bool is_balanced();
  void end_superstep();

  RunWork& work_;
  RecordedExchange exchange_;  // of what is said in supersteps
  RankVisits turns_;
  double cpu_of_visits_ = 0;  // in seconds of all threads
  // Until the first commit: others say what they said before, and cannot hear of a stop.
  bool is_behind_;
};

}  // namespace locvol
