// The subcommands that make a surface which can be meshed: repair and wrap.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/cured_surface.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/scratch_directory.h"
#include "tools/commands.h"
#include "tools/exit_code.h"
#include "tools/results.h"

namespace locvol {
namespace {

std::string counted_as(std::uint64_t count, std::string_view one, std::string_view many) {
  return fmt::format("{} {}", count, count == 1 ? one : many);
}

std::string changes_text(const RepairChanges& c) {
  std::vector<std::string> parts;
  const auto add = [&](std::uint64_t count, const std::string& text) {
    if (count > 0) parts.push_back(text);
  };
  add(c.num_doubled,
      counted_as(c.num_doubled, "doubled triangle", "doubled triangles") + " dropped");
  add(c.num_joined, fmt::format("{} joined, moved by {:.3g} at most",
                                counted_as(c.num_joined, "point", "points"), c.largest_move));
  add(c.num_fins, counted_as(c.num_fins, "triangle", "triangles") + " of fins dropped");
  add(c.num_loose, counted_as(c.num_loose, "loose triangle", "loose triangles") + " dropped");
  if (c.dropped_area > 0)
    parts.back() += fmt::format(" ({:.3g}% of the area went)", 100 * c.dropped_area);
  add(c.num_turned, counted_as(c.num_turned, "triangle", "triangles") + " turned");
  add(c.num_holes, fmt::format("{} filled with {}, the largest of {} edges",
                               counted_as(c.num_holes, "hole", "holes"),
                               counted_as(c.num_filling, "triangle", "triangles"), c.largest_hole));
  return parts.empty() ? "nothing had to be changed" : fmt::format("{}", fmt::join(parts, "; "));
}

Json to_json(const RepairChanges& c) {
  return {{"doubled_triangles", c.num_doubled}, {"joined_points", c.num_joined},
          {"largest_move", c.largest_move},     {"fin_triangles", c.num_fins},
          {"loose_triangles", c.num_loose},     {"dropped_area_share", c.dropped_area},
          {"turned_triangles", c.num_turned},   {"holes", c.num_holes},
          {"filling_triangles", c.num_filling}, {"largest_hole_edges", c.largest_hole}};
}

void print(const CureCommand& command, const CuredSurface& cured, Json json,
           const std::string& changes) {
  if (command.is_json) {
    json["surface"] = locvol::to_json(cured.facts);
    json["output"] = command.output.string();
    fmt::print("{}\n", json.dump(2));
  } else {
    fmt::print("{}{}{}", facts_text(cured.facts), line_text("changed", changes),
               line_text("file", command.output.string()));
  }
}

}  // namespace

int run_repair(const CureCommand& command) {
  IngestWatch watch;
  const std::uint64_t cap = memory_cap(command.memory_bytes);
  Workers workers(num_streaming_threads(0, cap));
  const CuredSurface cured =
      repaired_surface(surface_at(command.surface, temporary_directory()), command.weld,
                       temporary_directory(), cap, watch, workers);
  write_surface(cured, command.output);
  print(command, cured, Json{{"changes", to_json(cured.changes)}}, changes_text(cured.changes));
  return kExitDone;
}

int run_wrap(const CureCommand& command) {
  IngestWatch watch;
  const std::uint64_t cap = memory_cap(command.memory_bytes);
  Workers workers(num_streaming_threads(0, cap));
  const CuredSurface cured =
      wrapped_surface(surface_at(command.surface, temporary_directory()), command.alpha,
                      command.offset, temporary_directory(), cap, watch, workers);
  write_surface(cured, command.output);
  print(command, cured, Json{{"alpha", cured.alpha}, {"offset", cured.offset}},
        fmt::format("{} wrapped, with alpha {:.4g} and offset {:.4g}",
                    counted_as(cured.num_before, "triangle", "triangles"), cured.alpha,
                    cured.offset));
  return kExitDone;
}

}  // namespace locvol
