#include "engine/audit/audit.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "engine/audit/audit_creases.h"
#include "engine/audit/audit_leaf.h"
#include "engine/audit/audit_ranks.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/ranks/move_leaves.h"
#include "engine/shared/scratch_directory.h"
#include "octree/mix.h"

namespace locvol {
namespace {

// Over λ. A site stands for others within λ, and for what lies within two radii of them; and it
// lies within a visit's reach of its leaf.
constexpr double kOpenAround = 3, kSiteReach = 2.25;

// How many units in the last place of the largest coordinate a constructed point may be off.
constexpr double kRoundingErrors = 16;

AuditBounds bounds_of(const RunRecord& run, const SurfaceSheets& sheets) {
  const Box root = run.frame.root_box();
  double largest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    largest = std::max({largest, std::abs(root.min[axis]), std::abs(root.max[axis])});
  }
  AuditBounds bounds{run.parameters.size,
                     run.parameters.radius_edge_bound,
                     run.parameters.min_dihedral,
                     kRoundingErrors * std::numeric_limits<double>::epsilon() * largest,
                     sheets.sheets.size() > 1,
                     keeps_creases(run),
                     run.parameters.spacing_floor * run.parameters.sizes().least,
                     run.parameters.growth,
                     root.center()};
  if (sheets.has_several_bodies())
    for (const SheetFacts& sheet : sheets.sheets) bounds.bodies_of_sheets.push_back(sheet.bodies);
  return bounds;
}

std::uint64_t num_used_own_points(const AuditLeaf& leaf) {
  std::vector<bool> is_used(leaf.points.size());
  const auto use_those_of = [&](const auto& items) {
    for (const auto& item : items)
      for (const LocalIndex i : item.vertices) is_used[i] = is_used[i] || leaf.is_own(i);
  };
  use_those_of(leaf.star);
  use_those_of(leaf.star_facets);
  return static_cast<std::uint64_t>(std::ranges::count(is_used, true));
}

// False if the store cannot be audited at all.
bool check_run(const std::optional<RunRecord>& run, const AuditLeaves& leaves, const Reader& reader,
               AuditFindings& findings) {
  if (!run) {
    findings.add_fault("the store holds no run");
    return false;
  }
  if (run->phase != Phase::kDone) findings.add_fault("the run is not finished");
  reader.for_each_queued([&](const QueueEntry&) {
    findings.add_fault("the run is not finished: leaves are waiting in the queue");
    return false;
  });
  if (!(run->parameters.size > 0)) {
    findings.add_fault("the size is not positive");
    return false;
  }
  if (!leaves.tile_the_root()) {
    findings.add_fault("the leaves do not cover the root exactly once");
    return false;
  }
  return true;
}

void copy_surface_facts(const RunRecord& run, const SurfaceSheets& sheets, AuditReport& report) {
  const SurfaceFacts& surface = run.surface;
  report.is_surface_only = run.parameters.is_surface_only;
  report.surface_volume = surface.volume;
  report.surface_euler_characteristic = surface.euler_characteristic;
  report.surface_num_components = surface.num_components;
  if (sheets.has_several_bodies())
    for (const BodyFacts& body : sheets.bodies) report.surface_body_volumes.push_back(body.volume);
  report.body_volumes.resize(report.surface_body_volumes.size());
  if (!keeps_creases(run)) return;
  for (const CreaseFacts& crease : sheets.creases) report.surface_crease_length += crease.length;
}

void set_sites_near(std::size_t leaf, const AuditLeaves& leaves, const AuditRecords& records,
                    double size, AuditFindings& findings) {
  const Box box = leaves.box(leaf);
  const double distance = (kOpenAround + kSiteReach) * size;
  std::vector<Point> sites;
  for (const std::size_t other : leaves.within(box, distance))
    if (records.is_own(leaves.key(other)))
      for (const UnresolvedSite& site : records.own().unresolved(leaves.key(other)).sites)
        sites.push_back(site.position);
  for (const auto& [other, of_leaf] : records.sites_beside())
    if (leaves.box(other).squared_distance(box) <= distance * distance)
      sites.insert(sites.end(), of_leaf.begin(), of_leaf.end());
  findings.set_sites(std::move(sites), kOpenAround * size);
}

// Of own leaves. Returns the components of their boundary.
BoundaryComponents check_leaves(const Store& store, const AuditRecords& records,
                                const AuditLeaves& leaves, const RunRecord& run,
                                AuditFindings& findings, const StepProgress& on_step,
                                std::uint64_t one_in) {
  const AuditBounds bounds = bounds_of(run, records.own().sheets());
  AuditReport& report = findings.report();
  report.min_dihedral_bound = bounds.min_dihedral;
  AuditLoader loader(store, records, leaves, run);
  BoundaryComponents components(records);
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (on_step) on_step(i, leaves.size());
    if (!records.is_own(leaves.key(i))) continue;
    ++report.num_leaves;
    if (mix(leaves.key(i).bits()) % one_in != 0) continue;
    ++report.num_checked_leaves;
    report.num_unresolved += records.own().unresolved(leaves.key(i)).sites.size();
    if (run.counts.num_unresolved > 0) set_sites_near(i, leaves, records, bounds.size, findings);
    const std::optional<AuditLeaf> leaf = loader.load(i, findings);
    if (!leaf) continue;
    report.num_vertices += num_used_own_points(*leaf);
    const AuditCreases creases(*leaf, leaves, records, bounds);
    check_cells(*leaf, creases, bounds, findings);
    check_creases(*leaf, creases, leaves.box(i), bounds, findings);
    const std::vector<LocalFacet> boundary = boundary_facets(*leaf, findings);
    check_listed_facets(*leaf, boundary, findings);
    if (leaf->is_surface_only) check_facets(*leaf, boundary, bounds, findings);
    check_sheets(*leaf, leaves, records, bounds, findings);
    check_boundary_links(*leaf, boundary, findings);
    check_boundary_on_surface(*leaf, boundary, leaves, records, bounds, findings);
    check_between_bodies(*leaf, boundary, leaves, records, bounds, findings);
    components.add(*leaf, boundary, leaves);
  }
  report.num_components = components.size();
  return components;
}

// Whatever ends the process, nothing is left of it: its files have no names any more.
Store nameless_store_beside(const Store& store) {
  const ScratchDirectory place(std::filesystem::absolute(store.directory()).parent_path());
  return Store::open(place.path() / "beside", {.create = true});
}

// Of a rank's store: are the leaves that it calls its own those of its share?
bool check_share(const Reader& reader, AuditFindings& findings) {
  const RankRecord rank = reader.rank().value();
  const Shares shares(rank.first);
  bool is_its_share = true;
  reader.for_each_leaf([&](MortonKey leaf, const LeafInfo& info) {
    const bool is_in_share = shares.owner_of(leaf) == static_cast<int>(rank.rank);
    return is_its_share = (info.holding == Holding::kOwn) == is_in_share;
  });
  if (!is_its_share) findings.add_fault("a rank has other leaves of its own than its share");
  return is_its_share;
}

}  // namespace

AuditReport audit(const Store& store, const StepProgress& on_step, std::uint64_t one_in) {
  AuditReport report;
  AuditFindings findings(report);
  const Snapshot snapshot = store.snapshot();
  const std::optional<RunRecord> run = snapshot.run();
  const AuditLeaves leaves(run ? run->frame : Frame(), snapshot.leaf_keys());
  if (!check_run(run, leaves, snapshot, findings)) return report;
  copy_surface_facts(*run, snapshot.sheets(), report);
  check_leaves(store, AuditRecords(snapshot), leaves, *run, findings, on_step, one_in);
  return report;
}

AuditReport audit_as_rank(const Store& own, Exchange& exchange, const StepProgress& on_step,
                          std::uint64_t one_in) {
  AuditReport report;
  AuditFindings findings(report);
  const Snapshot snapshot = own.snapshot();
  std::optional<RunRecord> run = snapshot.run();
  const AuditLeaves leaves(run ? run->frame : Frame(), snapshot.leaf_keys());
  const bool is_sound =
      check_run(run, leaves, snapshot, findings) && check_share(snapshot, findings);
  if (any(exchange, !is_sound)) return together(report, exchange);
  run->counts = total_counts(exchange, run->counts);
  copy_surface_facts(*run, snapshot.sheets(), report);

  Store beside = nameless_store_beside(own);
  tell_leaves_beside(own, beside, exchange);
  const AuditRecords records(
      snapshot, beside, snapshot.rank().value(),
      sites_beside(snapshot, *run, (kOpenAround + kSiteReach) * run->parameters.size, exchange));
  BoundaryComponents components =
      check_leaves(own, records, leaves, *run, findings, on_step, one_in);
  const std::uint64_t num_joined = num_joined_components(components, leaves, records, exchange);
  AuditReport all = together(report, exchange);
  all.num_components -= num_joined;
  return all;
}

}  // namespace locvol
