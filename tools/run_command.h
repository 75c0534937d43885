// What the subcommands have in common that go on with a run.
#pragma once

#include "engine/engine.h"

namespace locvol {

// What goes on with a run, and writes its mesh.
struct RunCommand {
  RunControl control;  // its functions are the command's
  bool is_quiet = false;
  bool is_json = false;
};

}  // namespace locvol
