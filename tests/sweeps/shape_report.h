// What a sweep of shapes found, family by family.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sweeps/shape_trial.h"

namespace locvol::sweeps {

class ShapeReport {
 public:
  void add(const ShapeCase& shape_case, const TrialResult& result);
  std::size_t num_cases() const { return runs_.size(); }
  std::size_t num_failures() const;
  std::string table() const;
  // The runs that took the longest for what they listed, beside smooth surfaces.
  std::string slowest() const;

 private:
  struct Run {
    std::string_view family;
    std::uint64_t number = 0;
    double size = 0;  // λ
    TrialResult result;
    double seconds_per_thousand() const;  // boundary vertices
  };

  std::string row(std::string_view family, const std::vector<const Run*>& runs) const;
  double smooth_seconds_per_thousand() const;

  std::vector<Run> runs_;
};

}  // namespace locvol::sweeps
