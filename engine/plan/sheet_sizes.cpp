#include "engine/plan/sheet_sizes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "engine/plan/run_estimate.h"
#include "engine/shared/closest_word.h"
#include "engine/shared/input_error.h"

namespace locvol {
namespace {

bool is_called(const SheetFacts& sheet, const std::string& name) {
  return sheet.name == name || (!sheet.group.empty() && sheet.group == name);
}

// All names that sizes can be given for, a group's before those of its sheets.
std::vector<std::string> names_in(const SurfaceSheets& sheets) {
  std::vector<std::string> names;
  for (const SheetFacts& sheet : sheets.sheets)
    for (const std::string& name : {sheet.group, sheet.name})
      if (!name.empty() && std::ranges::find(names, name) == names.end()) names.push_back(name);
  return names;
}

[[noreturn]] void refuse_name(const std::string& name, const SurfaceSheets& sheets) {
  constexpr std::size_t kMostNames = 20;
  std::vector<std::string> names = names_in(sheets);
  std::string text = fmt::format("a size is given for the sheet '{}', and ", name);
  if (names.empty())
    throw InputError(text + "the surface has no sheets: neither names nor sharp edges part it");
  const std::string closest = closest_word(name, names);
  const std::size_t num_others = names.size() - std::min(names.size(), kMostNames);
  names.resize(names.size() - num_others);
  text +=
      fmt::format("no sheet of the surface has that name: there are {}{}", fmt::join(names, ", "),
                  num_others > 0 ? fmt::format(" and {} more", num_others) : "");
  if (!closest.empty()) text += fmt::format("; is '{}' meant?", closest);
  throw InputError(text);
}

}  // namespace

std::vector<double> sizes_by_sheet(const RunParameters& parameters, const SurfaceSheets& sheets) {
  if (parameters.sheet_sizes.empty()) return {};
  std::vector<double> sizes(sheets.sheets.size(), std::numeric_limits<double>::infinity());
  for (const auto& [name, size] : parameters.sheet_sizes)
    for (std::size_t s = 0; s < sizes.size(); ++s)
      if (is_called(sheets.sheets[s], name)) sizes[s] = std::min(sizes[s], size);
  return sizes;
}

void require_sized_sheets(const RunParameters& parameters, const SurfaceSheets& sheets) {
  for (const auto& [name, size] : parameters.sheet_sizes) {
    double area = 0;
    bool is_known = false;
    for (const SheetFacts& sheet : sheets.sheets)
      if (is_called(sheet, name)) is_known = true, area += sheet.area;
    if (!is_known) refuse_name(name, sheets);
    if (!(area / (size * size) < kMostCells))
      throw InputError(fmt::format(
          "size {} at the sheet '{}' asks for more than {:.2g} cells there: choose a size of at "
          "least {:.3g}",
          size, name, area / (size * size), 1.01 * std::sqrt(area / kMostCells)));
  }
}

}  // namespace locvol
