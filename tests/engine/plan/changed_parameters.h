// A run's parameters with one option changed, for each row of the table of options.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/plan/option_table.h"

namespace locvol {

inline void change(double& value) { value = value == 7 ? 8 : 7; }
inline void change(std::uint64_t& value) { ++value; }
inline void change(Initialization& init) {
  init = init == Initialization::kCover ? Initialization::kPaper : Initialization::kCover;
}
inline void change(InsideRule& inside) { inside = InsideRule::kWinding; }
inline void change(std::optional<double>& weld) { weld = 7; }
inline void change(std::string& image) { image += "ef"; }
inline void change(std::vector<SizeShape>& shapes) {
  shapes.push_back({.kind = ShapeKind::kBall, .size = 0.01, .a = {}, .b = {}, .radius = 1});
}

inline void change(bool& value) { value = !value; }
inline void change(std::vector<std::string>& names) { names.push_back("hole"); }
inline void change(std::vector<PartSize>& sheets) { sheets.push_back({"inlet", 0.01}); }

// Calls visit(option, changed) for each.
template <class Visit>
void for_each_change(const RunParameters& parameters, const Visit& visit) {
  for_each_option([&](const auto& option) {
    RunParameters changed = parameters;
    change(changed.*option.kept);
    visit(option, changed);
  });
}

}  // namespace locvol
