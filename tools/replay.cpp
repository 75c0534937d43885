// `locvol replay`: one leaf's visit again, step by step.
#include "engine/replay.h"

#include <fmt/format.h>

#include "tools/commands.h"
#include "tools/report.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

using Action = RefineStep::Action;

std::string_view action_name(Action action) {
  switch (action) {
    case Action::kInsert:
      return "insert";
    case Action::kDelete:
      return "delete";
    case Action::kTakeIn:
      return "take in";
    case Action::kBlocked:
      return "unresolved";
  }
  return "unknown";
}

// What the point is that a step is about.
std::string_view place_name(const RefineStep& step) {
  if (step.action == Action::kBlocked) return "";
  if (step.action != Action::kInsert) return kind_name(step.kind);
  if (step.kind != PointKind::kSurface) return "circumcenter";
  return step.condition >= 5 ? "ball center" : "surface";
}

// A step by its number: what an insertion deletes has the insertion's.
class StepCount {
 public:
  std::uint64_t number(const RefineStep& step) {
    const std::uint64_t number = num_done_ + 1;
    if (step.action != Action::kDelete) ++num_done_;
    return number;
  }

 private:
  std::uint64_t num_done_ = 0;
};

Json to_json(const RefineStep& step, std::uint64_t number, double size) {
  Json json = {{"step", number},
               {"condition", fmt::format("C{}", step.condition)},
               {"action", action_name(step.action)},
               {"place", nullptr},
               {"position", to_json(step.position)},
               {"radius_over_size", step.radius / size},
               {"point", nullptr}};
  if (step.action != Action::kBlocked) json["place"] = place_name(step);
  const bool has_id = step.action != Action::kBlocked && (step.point & kNewPoint) == 0;
  if (has_id) json["point"] = step.point;
  return json;
}

std::array<std::uint64_t, 4> num_steps(const Replay& replay) {
  std::array<std::uint64_t, 4> counts{};
  for (const RefineStep& step : replay.steps) ++counts[static_cast<std::size_t>(step.action)];
  return counts;
}

// A clean leaf has nothing left to do.
bool is_as_it_should_be(const Replay& replay) {
  return replay.error.empty() && (!replay.is_clean() || replay.reproduces());
}

std::string verdict(const Replay& replay) {
  if (!replay.error.empty()) return "the visit broke off: " + replay.error;
  if (replay.reproduces()) return "the same cells as in the store, and no point changed";
  if (replay.is_clean()) return "NOT what the store holds, though the leaf is clean";
  if (replay.delta.is_overfull) return "the leaf is to be split";
  return "the leaf waits: this is what its visit would do now";
}

Json to_json(const Replay& replay, std::optional<std::uint64_t> limit) {
  const auto [inserted, deleted, taken_in, unresolved] = num_steps(replay);
  Json json = {{"leaf", key_text(replay.leaf)},
               {"is_clean", replay.is_clean()},
               {"num_visits", replay.info.num_visits},
               {"box", to_json(replay.box)},
               {"size", replay.size},
               {"input",
                {{"num_own", replay.num_own},
                 {"num_ghosts", replay.num_ghosts},
                 {"num_triangles", replay.num_triangles}}},
               {"num_inserted", inserted},
               {"num_deleted", deleted},
               {"num_taken_in", taken_in},
               {"num_blocked", unresolved},
               {"num_unresolved", replay.delta.unresolved.size()},
               {"is_split", replay.delta.is_overfull},
               {"num_cells", replay.mesh.cells.size()},
               {"num_stored_cells", replay.num_stored_cells},
               {"num_cells_gone", replay.num_cells_gone},
               {"num_cells_new", replay.num_cells_new},
               {"reproduces", replay.reproduces()},
               {"error", nullptr},
               {"steps", Json::array()}};
  if (!replay.error.empty()) json["error"] = replay.error;
  if (!replay.mesh.cells.empty())
    json["quality"] = to_json(worst_quality(replay.mesh), replay.size);
  StepCount count;
  for (const RefineStep& step : replay.steps) {
    if (limit && json["steps"].size() == *limit) break;
    json["steps"].push_back(to_json(step, count.number(step), replay.size));
  }
  return json;
}

void print_steps(const Replay& replay, std::optional<std::uint64_t> limit) {
  if (replay.steps.empty()) return;
  fmt::print("\n{:>6} {:<4} {:<10} {:<12} {:>8}  place\n", "step", "", "what", "point", "radius/λ");
  StepCount count;
  std::uint64_t num_printed = 0;
  for (const RefineStep& step : replay.steps) {
    if (limit && num_printed == *limit) {
      fmt::print("  and {} more\n", replay.steps.size() - num_printed);
      break;
    }
    ++num_printed;
    fmt::print("{:>6} C{:<3} {:<10} {:<12} {:>8.4f}  {}\n", count.number(step), step.condition,
               action_name(step.action), place_name(step), step.radius / replay.size,
               point_text(step.position));
  }
  fmt::print("\n");
}

void print(const Replay& replay, std::optional<std::uint64_t> limit) {
  fmt::print(
      "{}{}{}",
      line_text("leaf", fmt::format("{}, level {}; {} visits, {}", key_text(replay.leaf),
                                    replay.leaf.level(), replay.info.num_visits,
                                    replay.is_clean() ? "clean" : "waiting")),
      line_text("box", box_text(replay.box)),
      line_text("input", fmt::format("{} points, {} ghost points, {} triangles", replay.num_own,
                                     replay.num_ghosts, replay.num_triangles)));
  print_steps(replay, limit);
  const auto [inserted, deleted, taken_in, blocked] = num_steps(replay);
  fmt::print("{}{}",
             line_text("steps", fmt::format("{} inserted, {} deleted, {} taken in, {} unresolved",
                                            inserted, deleted, taken_in, blocked)),
             line_text("cells", fmt::format("{}; the store holds {}, of which {} go; {} come",
                                            replay.mesh.cells.size(), replay.num_stored_cells,
                                            replay.num_cells_gone, replay.num_cells_new)));
  if (!replay.mesh.cells.empty())
    fmt::print("{}", line_text("at worst", quality_text(worst_quality(replay.mesh), replay.size)));
  fmt::print("{}", line_text("result", verdict(replay)));
}

MortonKey leaf_of(const Store& store, const LeafSpec& spec) {
  return find_leaf(store.snapshot(), run_of(store), spec, store.directory());
}

}  // namespace

int run_replay(const ReplayCommand& command) {
  if (!command.vtu.empty()) require_writable(command.vtu);
  const Store store = open_to_read(command.store);
  const Replay result = replay(store, leaf_of(store, command.leaf));
  std::uint64_t bytes = 0;
  if (!command.vtu.empty()) bytes = write_vtu(result.mesh, result.size, command.vtu);
  if (command.is_json) {
    Json json = to_json(result, command.limit);
    if (bytes > 0) json["written"] = {{"file", command.vtu.string()}, {"bytes", bytes}};
    print_json(json);
  } else {
    print(result, command.limit);
    if (bytes > 0) fmt::print("{}", line_text("written", command.vtu.string()));
  }
  return is_as_it_should_be(result) ? kExitDone : kExitError;
}

}  // namespace locvol
