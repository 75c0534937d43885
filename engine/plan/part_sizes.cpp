#include "engine/plan/part_sizes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "engine/plan/run_estimate.h"
#include "engine/shared/closest_word.h"
#include "engine/shared/input_error.h"

namespace locvol {
namespace {

// Is sheet `s` the one that size `i` is given for?
bool is_meant(const SurfaceSheets& sheets, std::size_t s, const RunParameters& parameters,
              std::size_t i) {
  const SheetId id = static_cast<SheetId>(s + 1);
  if (i < sheets.nearest.size() && sheets.nearest[i] != 0) return sheets.nearest[i] == id;
  const std::string& name = parameters.sheet_sizes[i].name;
  const SheetFacts& sheet = sheets.sheets[s];
  return sheet.name == name || (!sheet.group.empty() && sheet.group == name) ||
         name == fmt::format("#{}", id);
}

// All names that sizes can be given for, a group's before those of its sheets.
std::vector<std::string> names_in(const SurfaceSheets& sheets) {
  std::vector<std::string> names;
  for (const SheetFacts& sheet : sheets.sheets)
    for (const std::string& name : {sheet.group, sheet.name})
      if (!name.empty() && std::ranges::find(names, name) == names.end()) names.push_back(name);
  return names;
}

// `kind`: a sheet or a body; `names`: of all of these. `none`: why there are none.
[[noreturn]] void refuse_name(const std::string& kind, const std::string& name,
                              std::vector<std::string> names, const std::string& none) {
  constexpr std::size_t kMostNames = 20;
  std::string text = fmt::format("a size is given for the {} '{}', and ", kind, name);
  if (names.empty()) throw InputError(text + none);
  const std::string closest = closest_word(name, names);
  const std::size_t num_others = names.size() - std::min(names.size(), kMostNames);
  names.resize(names.size() - num_others);
  text += fmt::format("no {} of the surface has that name: there are {}{}", kind,
                      fmt::join(names, ", "),
                      num_others > 0 ? fmt::format(" and {} more", num_others) : "");
  if (!closest.empty()) text += fmt::format("; is '{}' meant?", closest);
  throw InputError(text);
}

std::vector<double> sizes_by_body(const RunParameters& parameters, const SurfaceSheets& sheets) {
  std::vector<double> sizes(sheets.bodies.size(), std::numeric_limits<double>::infinity());
  for (const auto& [name, size] : parameters.body_sizes)
    for (std::size_t b = 0; b < sizes.size(); ++b)
      if (sheets.bodies[b].name == name) sizes[b] = std::min(sizes[b], size);
  return sizes;
}

void require_sheet(const RunParameters& parameters, std::size_t i, const SurfaceSheets& sheets) {
  const auto& [name, size] = parameters.sheet_sizes[i];
  double area = 0;
  bool is_known = false;
  for (std::size_t s = 0; s < sheets.sheets.size(); ++s)
    if (is_meant(sheets, s, parameters, i)) is_known = true, area += sheets.sheets[s].area;
  if (!is_known)
    refuse_name("sheet", name, names_in(sheets),
                "the surface has no sheets: neither names nor sharp edges part it");
  if (!(area / (size * size) < kMostCells))
    throw InputError(fmt::format(
        "size {} at the sheet '{}' asks for more than {:.2g} cells there: choose a size of at "
        "least {:.3g}",
        size, name, area / (size * size), 1.01 * std::sqrt(area / kMostCells)));
}

void require_body(const PartSize& given, const SurfaceSheets& sheets) {
  const auto& [name, size] = given;
  const auto body = std::ranges::find(sheets.bodies, name, &BodyFacts::name);
  if (body == sheets.bodies.end()) {
    std::vector<std::string> names;
    for (const BodyFacts& other : sheets.bodies) names.push_back(other.name);
    refuse_name("body", name, std::move(names), "the surface has no bodies");
  }
  const double cubes = body->volume / (size * size * size);
  if (!(cubes < kMostCells))
    throw InputError(fmt::format(
        "size {} in the body '{}' asks for more than {:.2g} cells there: choose a size of at "
        "least {:.3g}",
        size, name, cubes, 1.01 * std::cbrt(body->volume / kMostCells)));
}

}  // namespace

std::optional<Point> place_meant_by(const std::string& name) {
  constexpr std::string_view kNear = "near ";
  if (!name.starts_with(kNear)) return std::nullopt;
  std::array<double, 3> place{};
  const char* next = name.data() + kNear.size();
  const char* const end = name.data() + name.size();
  for (double& coordinate : place) {
    while (next != end && (*next == ' ' || *next == ',')) ++next;
    const auto [after, error] = std::from_chars(next, end, coordinate);
    if (error != std::errc() || !std::isfinite(coordinate)) return std::nullopt;
    next = after;
  }
  if (next != end) return std::nullopt;
  return Point{place[0], place[1], place[2]};
}

std::vector<double> sizes_by_sheet(const RunParameters& parameters, const SurfaceSheets& sheets) {
  if (parameters.sheet_sizes.empty() && parameters.body_sizes.empty()) return {};
  const std::vector<double> by_body = sizes_by_body(parameters, sheets);
  if (sheets.sheets.empty()) return by_body;  // the surface is one sheet, around one body
  std::vector<double> sizes(sheets.sheets.size(), std::numeric_limits<double>::infinity());
  for (std::size_t s = 0; s < sizes.size(); ++s) {
    for (std::size_t i = 0; i < parameters.sheet_sizes.size(); ++i)
      if (is_meant(sheets, s, parameters, i))
        sizes[s] = std::min(sizes[s], parameters.sheet_sizes[i].size);
    for (const BodyId body : sheets.sheets[s].bodies)
      if (body != kNoBody && body <= by_body.size())
        sizes[s] = std::min(sizes[s], by_body[body - 1]);
  }
  return sizes;
}

std::vector<double> sizes_throughout_bodies(const RunParameters& parameters,
                                            const SurfaceSheets& sheets) {
  if (parameters.body_sizes.empty() || parameters.max_size > parameters.size) return {};
  return sizes_by_body(parameters, sheets);
}

void require_sized_parts(const RunParameters& parameters, const SurfaceSheets& sheets) {
  for (std::size_t i = 0; i < parameters.sheet_sizes.size(); ++i)
    require_sheet(parameters, i, sheets);
  for (const PartSize& given : parameters.body_sizes) require_body(given, sheets);
}

}  // namespace locvol
