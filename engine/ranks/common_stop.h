// CommonStop makes a stop of one rank one of all, while each works by itself between their words.
#pragma once

#include "engine/exchange/exchange.h"
#include "octree/stop.h"

namespace locvol {

class CommonStop {
 public:
  explicit CommonStop(Exchange& exchange) : exchange_(exchange) {}

  // Called by all ranks before they say anything else. Throws Stopped if one was stopped.
  void meet(bool is_stopped = false) {
    if (!is_told_) is_told_ = any(exchange_, is_stopped);
    if (is_told_) throw Stopped();
  }
  // By one that was stopped at its own work, instead of all that it would have said.
  void tell() {
    if (!is_told_) any(exchange_, true);
    is_told_ = true;
  }

 private:
  Exchange& exchange_;
  bool is_told_ = false;
};

}  // namespace locvol
