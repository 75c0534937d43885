// What an audit found, for the message of a test.
#pragma once

#include <string>

#include "engine/audit/audit.h"

namespace locvol {

inline std::string described(const AuditReport& report) {
  std::string text;
  for (const std::string& violation : report.violations) text += violation + "\n";
  return text;
}

}  // namespace locvol
