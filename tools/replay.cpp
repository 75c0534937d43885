// `locvol replay`: one leaf's visit again, step by step.
#include "engine/inspect/replay.h"

#include <fmt/format.h>

#include "tools/commands.h"
#include "tools/results.h"
#include "tools/stored_run.h"
#include "tools/visit_file.h"

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
    case Action::kMove:
      return "move";
  }
  return "unknown";
}

// What the point is that a step is about.
std::string_view place_name(const RefineStep& step) {
  if (step.action == Action::kBlocked) return "";
  if (step.action != Action::kInsert) return kind_name(step.kind);
  if (step.kind == PointKind::kCrease) return "crease";
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

// By Action.
std::array<std::uint64_t, 5> num_steps(const Replay& replay) {
  std::array<std::uint64_t, 5> counts{};
  for (const RefineStep& step : replay.steps) ++counts[static_cast<std::size_t>(step.action)];
  return counts;
}

std::uint64_t num_core_points(const LeafInput& input) {
  std::uint64_t num = 0;
  for (const LatticeRow& row : input.core.rows) num += row.count;
  return num;
}

// A clean leaf has nothing left to do.
bool is_as_it_should_be(const StoredVisit& visit, const Replay& replay) {
  return replay.error.empty() && (!visit.is_clean || replay.reproduces());
}

std::string verdict(const StoredVisit& visit, const Replay& replay) {
  if (!replay.error.empty()) return "the visit broke off: " + replay.error;
  if (replay.reproduces()) return "the same cells as in the store, and no point changed";
  if (visit.is_clean) return "NOT what the store holds, though the leaf is clean";
  if (replay.delta.is_overfull) return "the leaf is to be split";
  return "the leaf waits: this is what its visit would do now";
}

Json to_json(const StoredVisit& visit, const Replay& replay, std::optional<std::uint64_t> limit) {
  const double size = visit.input.criteria.size;
  const auto [inserted, deleted, taken_in, unresolved, moved] = num_steps(replay);
  Json json = {{"leaf", key_text(visit.leaf)},
               {"is_clean", visit.is_clean},
               {"num_visits", visit.num_visits},
               {"box", to_json(visit.input.box)},
               {"size", size},
               {"input",
                {{"num_own", visit.input.own.size()},
                 {"num_ghosts", visit.input.ghosts.size()},
                 {"num_core", num_core_points(visit.input)},
                 {"num_triangles", visit.input.domain.surface_size()}}},
               {"num_inserted", inserted},
               {"num_deleted", deleted},
               {"num_moved", moved},
               {"num_taken_in", taken_in},
               {"num_blocked", unresolved},
               {"num_unresolved", replay.delta.unresolved.size()},
               {"is_split", replay.delta.is_overfull},
               {"num_cells", replay.mesh.cells.size()},
               {"num_stored_cells", visit.cells.size()},
               {"num_cells_gone", replay.num_cells_gone},
               {"num_cells_new", replay.num_cells_new},
               {"reproduces", replay.reproduces()},
               {"digest", fmt::format("{:016x}", replay.digest)},
               {"error", nullptr},
               {"steps", Json::array()}};
  if (!replay.error.empty()) json["error"] = replay.error;
  if (!replay.mesh.cells.empty()) json["quality"] = to_json(worst_quality(replay.mesh), size);
  StepCount count;
  for (const RefineStep& step : replay.steps) {
    if (limit && json["steps"].size() == *limit) break;
    json["steps"].push_back(to_json(step, count.number(step), size));
  }
  return json;
}

void print_steps(const Replay& replay, double size, std::optional<std::uint64_t> limit) {
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
               action_name(step.action), place_name(step), step.radius / size,
               point_text(step.position));
  }
  fmt::print("\n");
}

void print(const StoredVisit& visit, const Replay& replay, std::optional<std::uint64_t> limit) {
  const double size = visit.input.criteria.size;
  fmt::print("{}{}{}",
             line_text("leaf", fmt::format("{}, level {}; {} visits, {}", key_text(visit.leaf),
                                           visit.leaf.level(), visit.num_visits,
                                           visit.is_clean ? "clean" : "waiting")),
             line_text("box", box_text(visit.input.box)),
             line_text("input", fmt::format("{} points, {} ghost points, {} triangles",
                                            visit.input.own.size(), visit.input.ghosts.size(),
                                            visit.input.domain.surface_size())));
  print_steps(replay, size, limit);
  const auto [inserted, deleted, taken_in, blocked, moved] = num_steps(replay);
  fmt::print("{}{}",
             line_text("steps", fmt::format("{} inserted, {} deleted, {} moved, {} taken in, "
                                            "{} unresolved",
                                            inserted, deleted, moved, taken_in, blocked)),
             line_text("cells", fmt::format("{}; the store holds {}, of which {} go; {} come",
                                            replay.mesh.cells.size(), visit.cells.size(),
                                            replay.num_cells_gone, replay.num_cells_new)));
  if (!replay.mesh.cells.empty())
    fmt::print("{}", line_text("at worst", quality_text(worst_quality(replay.mesh), size)));
  fmt::print("{}", line_text("result", verdict(visit, replay)));
}

StoredVisit visit_of(const ReplayCommand& command) {
  if (!command.from.empty()) return read_visit(command.from);
  const Store store = open_whole(command.store);
  const MortonKey leaf =
      find_leaf(store.snapshot(), run_of(store), command.leaf.value(), store.directory());
  return stored_visit(store, leaf);
}

}  // namespace

int run_replay(const ReplayCommand& command) {
  for (const auto& file : {command.vtu, command.dump})
    if (!file.empty()) require_writable(file);
  const StoredVisit visit = visit_of(command);
  if (!command.dump.empty()) write_visit(visit, command.dump);  // first: the visit may crash
  const Replay result = replay(visit);
  if (!command.vtu.empty()) write_vtu(result.mesh, visit.input.criteria.size, command.vtu);
  if (command.is_json)
    print_json(to_json(visit, result, command.limit));
  else
    print(visit, result, command.limit);
  return is_as_it_should_be(visit, result) ? kExitDone : kExitError;
}

}  // namespace locvol
