#include "engine/ingest/weld_trials.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "engine/ingest/surface_repair.h"
#include "engine/ingest/surface_text.h"
#include "engine/shared/number_text.h"

namespace locvol {
namespace {

// Of the longest side: what is tried, to be told, and what is taken for the length of no edge.
constexpr double kMostTried = 1e-2, kLeastEdge = 1e-30;

// Some length above `width`, with as few digits as it takes to be at most `most`.
std::string length_between(double width, double most) {
  const double unit = std::pow(10.0, std::floor(std::log10(width)) - 1);
  const std::string text = fmt::format("{:.2g}", (std::floor(width / unit) + 1) * unit);
  const double length = std::stod(text);
  return width < length && length <= most ? text : decimal(most);
}

}  // namespace

std::string obstacle_to(const WeldedSurface& welded) {
  if (welded.is_crowded)
    return fmt::format("takes too much memory: more than {} triangles lie within {} times that",
                       kMaxWeldTriangles, kLeastWeldCell);
  if (welded.too_wide)
    return fmt::format("would make one of a row of them, at {}, that is more than twice as wide",
                       text(*welded.too_wide));
  if (welded.num_joined > 0 && welded.triangles.count == 0) return "would leave nothing of it";
  if (welded.collinear.size() > kMaxCollinear)
    return fmt::format("would leave more than {} triangles without area", kMaxCollinear);
  return {};
}

WeldTrials::WeldTrials(TriangleSpill& spill, const TriangleBuckets& buckets, const Box& box,
                       std::span<const std::uint32_t> given, IngestWatch& watch, Workers& workers)
    : spill_(spill),
      buckets_(buckets),
      box_(box),
      given_(given),
      watch_(watch),
      workers_(workers),
      extent_(max_norm(box.max - box.min)) {}

std::optional<WeldedSurface> WeldTrials::closed_surface() {
  const EdgeLengths lengths =
      edge_lengths(spill_, buckets_, WeldPoints::kOfOpenEdges, watch_, workers_);
  double distance = 0;
  while (const auto next =
             lengths.next_distance(distance, kLeastEdge * extent_, kMostJoined * extent_)) {
    distance = *next;
    auto tried = trial(distance, WeldPoints::kOfOpenEdges, CheckScope::kNeighbors);
    if (!tried) continue;
    if (tried->flaw.empty()) return std::move(tried->surface);
    tried_ =
        fmt::format("Joining their ends that are closer to each other than {} (--weld auto) {}",
                    rounded(distance), tried->flaw);
  }
  if (tried_.empty())
    tried_ = fmt::format("None of their ends are closer to each other than {} (--weld auto)",
                         rounded(distance));
  return std::nullopt;
}

// As --weld with that length will do it. If none does, what the largest that joins points leaves.
std::string WeldTrials::cure() {
  const EdgeLengths lengths = edge_lengths(spill_, buckets_, WeldPoints::kAll, watch_, workers_);
  const double least = kLeastEdge * extent_, most = kMostTried * extent_;
  std::string in_vain;
  double distance = 0;
  while (const auto next = lengths.next_distance(distance, least, most)) {
    distance = *next;
    if (const std::string length = length_that_closes(distance, in_vain); !length.empty())
      return length;
  }
  // Edges are longer, so that both of their ends go into one point only by way of others.
  constexpr double kOfShortest = 0.5;
  const double last = kOfShortest * lengths.shortest_above(least);
  std::string also_in_vain;
  const bool is_new = distance < last && last <= most;
  const std::string length = is_new ? length_that_closes(last, also_in_vain) : std::string();
  return length.empty() ? in_vain : length;
}

// What is to be told of it; empty: it does not, and `in_vain` says why, if it joins points that
// are not joined unasked.
std::string WeldTrials::length_that_closes(double distance, std::string& in_vain) {
  auto tried = trial(distance, WeldPoints::kAll, CheckScope::kAll);
  if (!tried) return {};
  if (tried->flaw.empty()) {
    spill_.release(std::move(tried->surface.triangles));
    // Groups as wide as the widest at most hang together by such steps, and no others do.
    return "--weld " + length_between(tried->surface.width, distance) + " would close it";
  }
  if (distance > kMostJoined * extent_)
    in_vain = fmt::format("joining all that are closer than {} (--weld) {}", rounded(distance),
                          tried->flaw);
  return {};
}

// Nothing: no points are to be joined.
std::optional<WeldTrials::Trial> WeldTrials::trial(double distance, WeldPoints points,
                                                   CheckScope scope) {
  Trial trial{welded_surface(spill_, buckets_, points, distance, watch_, workers_), {}};
  WeldedSurface& surface = trial.surface;
  // Others may be enough.
  if (points == WeldPoints::kOfOpenEdges) surface.too_wide.reset();
  trial.flaw = obstacle_to(surface);
  if (surface.num_joined == 0 && trial.flaw.empty()) return std::nullopt;
  if (trial.flaw.empty()) trial.flaw = flaw_of(surface, scope);
  if (!trial.flaw.empty()) spill_.release(std::move(surface.triangles));
  return trial;
}

std::string WeldTrials::flaw_of(WeldedSurface& surface, CheckScope scope) {
  TriangleBuckets buckets = buckets_.empty_ones();
  std::vector<TriangleList> all{std::move(surface.triangles)};
  buckets.distribute(spill_, all, box_, {}, true, watch_);
  surface.triangles = std::move(all.front());
  const SurfaceFindings findings = check_cells(
      spill_, buckets, box_, {}, SharpAngle(0),
      surface.collinear.empty() ? scope : CheckScope::kNeighbors, watch_, workers_, given_);
  buckets.release(spill_);
  const auto& [open, overused] = findings.edges_that_count();
  if (open.count > 0)
    return fmt::format("leaves {} open, for example that from {}",
                       counted(open.count, "edge", "edges"), text(open));
  if (overused.count > 0)
    return fmt::format("puts {} in more than two triangles, for example that from {}",
                       counted(overused.count, "edge", "edges"), text(overused));
  if (findings.num_copies > surface.num_copies)
    return fmt::format("lays {} on {}", text(findings.first_copy->second),
                       text(findings.first_copy->first));
  if (findings.conflicts.count > 0) return "makes it one that has no inside";
  if (findings.num_pinched > 0)
    return fmt::format("has parts of it touch at {}", text(findings.first_pinched));
  if (findings.intersection)
    return fmt::format("has {} meet {}", text(findings.intersection->first),
                       text(findings.intersection->second));
  return {};
}

}  // namespace locvol
