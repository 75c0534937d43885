#include "engine/run/run_state.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "engine/run/coloring.h"
#include "engine/shared/leaf_name.h"
#include "refine/cover_leaf.h"
#include "refine/fill_leaf.h"
#include "refine/measure_leaf.h"
#include "refine/refine_leaf.h"
#include "refine/size_leaf.h"

namespace locvol {
namespace {

constexpr int kMaxVisitsOfCommit = 64;  // what a crash may cost
constexpr std::chrono::seconds kMaxTimeOfCommit{1};

constexpr double kConflictSlack = 1.01;

// How far apart visits are independent for what they read and write of the core. Others are too far
// from it (kCoreMargin) to read of it, or to insert close to it.
double conflict_at_core(const RunParameters& p, const LeafInfo& info) {
  if (info.largest_size < p.max_size) return 0;  // which may be infinite
  const double read = std::max(kCoreReach, reach_factor(p.growth, kReach));
  return kConflictSlack * (kInsertion + kLatticeStar + read) * p.max_size;
}

// Of visits that refine, where sizes vary. `reached`: LeafInfo::reached_size, or more
double graded_conflict(const RunParameters& p, const LeafInfo& info, double reached) {
  const double reach = reach_factor(p.growth, kReach);
  return std::max({conflict_at_core(p, info), kConflictSlack * 2 * reach * info.largest_size,
                   kConflictSlack * (0.5 * kReach + reach) * reached});
}

RunRecord read_run(const Store& store) {
  const auto run = store.snapshot().run();
  assert(run && run->phase != Phase::kIngest);
  return *run;
}

}  // namespace

double touch_distance(const RunRecord& run, const LeafInfo& info) {
  const RunParameters& p = run.parameters;
  if (p.growth == 0) return kTouch * p.size;
  if (run.phase <= Phase::kSize) {
    const SizeRules rules{p.per_circle, p.deviation,     p.layers,
                          p.min_size,   p.spacing_floor, p.growth};
    return kConflictSlack * std::max(kExactDistance * p.size, measure_reach(rules, p.size));
  }
  // As long as it is not known, no more than twice as large (find_reached_size()).
  const double reached = info.reached_size > 0 ? info.reached_size : 2 * info.largest_size;
  const double reach = reach_factor(p.growth, kReach);
  // A visit moves the vertices of balls that are centered as far as it puts points, and deletes as
  // near to those; others look around where these were.
  const double of_moved = (0.5 * kReach + 1 + reach * (1 + p.growth)) * reached;
  return std::max({graded_conflict(p, info, reached), kConflictSlack * of_moved,
                   kConflictSlack * 2 * reach * info.largest_size + p.size,   // merge_sites()
                   kConflictSlack * 0.5 * reach * (1 + p.growth) * p.size});  // triangles
}

RunState::RunState(Store& store, std::size_t cache_bytes, std::size_t max_unwritten_bytes)
    : store_(store),
      rank_(store.snapshot().rank()),
      shares_(rank_ ? Shares(rank_->first) : Shares()),
      run_(read_run(store)),
      lattice_(lattice_of(run_)),
      octree_(store.snapshot().leaf_keys()),
      leaves_(store, cache_bytes),
      queue_(store.snapshot()),
      max_unwritten_bytes_(max_unwritten_bytes) {
  const auto is_share = [&](MortonKey leaf) {
    return !rank_ || shares_.owner_of(leaf) == static_cast<int>(rank_->rank);
  };
  num_own_leaves_ = static_cast<std::uint64_t>(std::ranges::count_if(octree_.leaves(), is_share));
  num_own_queued_ = queue_.count_if(is_share);
}

std::vector<int> RunState::others_touched(MortonKey leaf) {
  if (run_.phase <= Phase::kCover) return others_holding(leaf);
  std::vector<int> ranks;
  const double distance = touch_distance(run_, leaves_.info(leaf));
  for (const MortonKey other : octree_.leaves_within(run_.frame, box(leaf), distance))
    for (const int rank : others_holding(other))
      if (const auto place = std::ranges::lower_bound(ranks, rank);
          place == ranks.end() || *place != rank)
        ranks.insert(place, rank);
  return ranks;
}

std::vector<int> RunState::others_holding(MortonKey leaf) {
  std::vector<int> ranks;
  for (const std::uint32_t rank : leaves_.info(leaf).ranks)
    if (rank != rank_->rank) ranks.push_back(static_cast<int>(rank));
  return ranks;
}

void RunState::put_count(MortonKey leaf, std::uint64_t LeafInfo::*count, std::uint64_t now,
                         std::uint64_t RunCounts::*total) {
  LeafInfo& info = leaves_.edit_info(leaf);
  if (info.holding == Holding::kOwn) run_.counts.*total += now - info.*count;
  info.*count = now;
}

void RunState::begin_phase(Phase next) {
  run_.phase = next;
  if (rank_) rank_->stage = 0;
}

void RunState::enqueue(MortonKey leaf, std::uint32_t epoch) {
  if (is_beyond(leaf) || leaves_.info(leaf).queued) return;
  const QueuePosition position{epoch, kNoColor};
  leaves_.edit_info(leaf).queued = position;
  queue_.put({position, leaf});
  if (is_own(leaf)) ++num_own_queued_;
}

void RunState::dequeue(MortonKey leaf) {
  if (is_beyond(leaf)) return;
  auto& queued = leaves_.edit_info(leaf).queued;
  assert(queued);
  queue_.erase({*queued, leaf});
  queued.reset();
  if (is_own(leaf)) --num_own_queued_;
}

bool RunState::open_epoch(const StopToken* stop) {
  if (queue_.is_empty() || queue_.front().color != kNoColor) return false;
  const QueuePosition waiting = queue_.front();
  const std::vector<MortonKey> epoch = queue_.front_leaves();
  const std::vector<std::uint32_t> colors = colors_of(epoch, stop);
  open_epoch(waiting.epoch, epoch, colors);
  return true;
}

void RunState::put_color(MortonKey leaf, const QueuePosition& waiting, std::uint32_t color) {
  const QueuePosition position{waiting.epoch, color};
  queue_.erase({waiting, leaf});
  queue_.put({position, leaf});
  leaves_.edit_info(leaf).queued = position;
}

std::vector<RunState::Waiting> RunState::waiting(std::uint32_t epoch) {
  std::vector<Waiting> waiting;
  if (queue_.is_empty() || queue_.front() != QueuePosition{epoch, kNoColor}) return waiting;
  for (const MortonKey leaf : queue_.front_leaves())
    if (is_own(leaf)) waiting.push_back({leaf, conflict_distance(leaf)});
  return waiting;
}

void RunState::open_epoch(std::uint32_t epoch, std::span<const MortonKey> leaves,
                          std::span<const std::uint32_t> colors) {
  const QueuePosition waiting{epoch, kNoColor};
  std::size_t num_held = 0;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (!octree_.is_leaf(leaves[i]) || is_beyond(leaves[i])) continue;
    if (leaves_.info(leaves[i]).queued != waiting)
      throw RefineError(leaf_name(leaves[i]) + ": waits on its rank, and not where it is a copy");
    ++num_held;
    put_color(leaves[i], waiting, colors[i]);
  }
  if (queue_.num_in_epoch(epoch) != num_held)
    throw RefineError(std::to_string(queue_.num_in_epoch(epoch) - num_held) +
                      " leaves wait where they are copies, and not on their ranks");
  run_.epoch = epoch;
}

double RunState::size_at(const Point& p) {
  if (is_uniform()) return size();
  return locvol::size_at(run_.parameters.sizes(), run_.frame, leaves_.sizes(owner_of(p)).cubes, p);
}

double RunState::reach_of(MortonKey leaf, double k) {
  return is_uniform() ? k * size()
                      : reach_factor(run_.parameters.growth, k) * leaves_.info(leaf).largest_size;
}

double RunState::least_size(MortonKey leaf) {
  return is_uniform() ? size() : leaves_.info(leaf).least_size;
}

// Balls at points of the leaf have centers where h may be a little larger.
double RunState::surface_size(MortonKey leaf) {
  const RunParameters& p = run_.parameters;
  if (!p.sizes().has_shapes()) return size();
  return std::min(size(), leaves_.info(leaf).surface_size / (1 - 0.5 * kReach * p.growth));
}

void RunState::put_sizes(MortonKey leaf, LeafSizes sizes) {
  if (is_beyond(leaf)) return;
  LeafInfo& info = leaves_.edit_info(leaf);
  const SizeRange range = size_range(run_.parameters.sizes(), run_.frame, sizes.cubes);
  info.least_size = range.least;
  info.largest_size = range.most;
  info.surface_size = range.on_surface;
  leaves_.put_sizes(leaf, std::move(sizes));
}

// Interpolated, h may change faster than it should, and jumps a little from cube to cube: so this
// is looked up. Even with that, it doubles nowhere within the distance that is looked at.
void RunState::find_reached_size(MortonKey leaf) {
  const Box box = this->box(leaf);
  const double largest = leaves_.info(leaf).largest_size;
  double most = largest;
  for (const MortonKey other : octree_.leaves_within(run_.frame, box, reach_of(leaf, kReach))) {
    if (leaves_.info(other).largest_size <= most) continue;
    for (const SizeCube& cube : leaves_.sizes(other).cubes) {
      const double size = size_range(run_.parameters.sizes(), run_.frame, {&cube, 1}).most;
      const double farthest = 0.5 * kReach * size;
      if (size > most && box.squared_distance(run_.frame.box(cube.key)) <= farthest * farthest)
        most = size;
    }
  }
  leaves_.edit_info(leaf).reached_size = most;
  leaves_.trim();
}

std::vector<std::uint32_t> RunState::colors_of(const std::vector<MortonKey>& its_leaves,
                                               const StopToken* stop) {
  if (is_cover() && is_uniform())
    return color_leaves(octree_, run_.frame, its_leaves, conflict_distance(its_leaves.front()),
                        stop);
  if (is_cover()) {
    std::vector<double> distances;
    distances.reserve(its_leaves.size());
    for (const MortonKey leaf : its_leaves) distances.push_back(conflict_distance(leaf));
    return color_leaves(octree_, run_.frame, its_leaves, distances, stop);
  }
  // Any leaf may write into the reach of any other.
  std::vector<std::uint32_t> colors(its_leaves.size());
  std::iota(colors.begin(), colors.end(), 0U);
  return colors;
}

// Leaves are measured each by itself. Where sizes vary, a visit inserts where h is at least
// 2 / kReach of the distance, and has those within the reach of that look; it reads within the
// reach, and mending writes as far.
double RunState::conflict_distance(MortonKey leaf) {
  if (run_.phase <= Phase::kSize) return -1;
  if (run_.phase == Phase::kCover)  // it reads samples within r_s of its box, and writes to its box
    return kConflictSlack *
           std::min(reach_of(leaf, sample_radius(is_uniform())),
                    reach_factor(run_.parameters.growth, sample_radius(is_uniform())) * size());
  if (is_uniform()) return kConflict * size();
  const LeafInfo& info = leaves_.info(leaf);
  if (run_.phase == Phase::kFill)
    return std::max(
        conflict_at_core(run_.parameters, info),
        kConflictSlack * reach_factor(run_.parameters.growth, kFillReach) * info.largest_size);
  return graded_conflict(run_.parameters, info, info.reached_size);
}

bool RunState::are_independent(const QueueEntry& a, const QueueEntry& b) {
  if (a.position == b.position) return true;
  if (!is_cover()) return false;
  const double distance = std::max(conflict_distance(a.leaf), conflict_distance(b.leaf));
  return box(a.leaf).squared_distance(box(b.leaf)) > distance * distance;
}

void RunState::begin_ids(std::uint64_t first) {
  run_.next_point_id = first;
  ids_end_ = first + kIdsOfVisit;
}

void RunState::end_ids() {
  run_.next_point_id = std::exchange(ids_end_, std::numeric_limits<std::uint64_t>::max());
}

MeshPoint RunState::add_point(const Point& position, PointKind kind) {
  if (run_.next_point_id == ids_end_)
    throw RefineError("a visit has more than " + std::to_string(kIdsOfVisit) + " new points");
  const MeshPoint point{run_.next_point_id++, position, kind};
  add_to_leaf(point);
  return point;
}

MeshPoint RunState::add_lattice_point(const LatticeSite& site) {
  const MeshPoint point = lattice_.point(site);
  add_to_leaf(point);
  return point;
}

MortonKey RunState::owner_of(const Point& p) const {
  if (!run_.frame.contains(p))
    throw RefineError("the point (" + std::to_string(p.x) + ", " + std::to_string(p.y) + ", " +
                      std::to_string(p.z) + ") lies outside the octree");
  return octree_.leaf_owning(run_.frame, p);
}

void RunState::add_to_leaf(const MeshPoint& point) {
  const MortonKey owner = owner_of(point.position);
  if (is_beyond(owner)) return;
  auto& points = leaves_.edit_points(owner).points;
  points.insert(std::ranges::upper_bound(points, point.id, {}, &MeshPoint::id), point);
  put_count(owner, &LeafInfo::num_points, points.size(), &RunCounts::num_points);
}

void RunState::remove_point(const MeshPoint& point) {
  const MortonKey owner = owner_of(point.position);
  if (is_beyond(owner)) return;
  auto& points = leaves_.edit_points(owner).points;
  const auto place = std::ranges::lower_bound(points, point.id, {}, &MeshPoint::id);
  if (place == points.end() || place->id != point.id)
    throw RefineError("deleted point " + std::to_string(point.id) + " is not in P");
  points.erase(place);
  put_count(owner, &LeafInfo::num_points, points.size(), &RunCounts::num_points);
}

void RunState::put_core(MortonKey leaf, const LatticeCore& core) {
  if (is_beyond(leaf)) return;
  leaves_.edit_points(leaf).core = core;
  put_count(leaf, &LeafInfo::num_core_points, num_points(core, sites(leaf)),
            &RunCounts::num_points);
}

void RunState::list_core_point(MortonKey leaf, const LatticeSite& site) {
  if (is_beyond(leaf)) return;
  LatticeCore& core = leaves_.edit_points(leaf).core;
  core = without(core, sites(leaf), site);
  put_count(leaf, &LeafInfo::num_core_points, leaves_.info(leaf).num_core_points - 1,
            &RunCounts::num_points);
  add_lattice_point(site);
}

void RunState::add_visit(MortonKey leaf, const VisitStats& stats) {
  if (is_beyond(leaf)) return;
  LeafInfo& info = leaves_.edit_info(leaf);
  ++info.num_visits;
  info.num_deletions += stats.deletions;
  info.num_moves += stats.moves;
  for (std::size_t c = 0; c < kNumConditions; ++c) info.num_insertions[c] += stats.insertions[c];
  if (info.holding != Holding::kOwn) return;
  ++run_.counts.num_visits;
  run_.counts.num_deletions += stats.deletions;
  run_.counts.num_moves += stats.moves;
  for (std::size_t c = 0; c < kNumConditions; ++c)
    run_.counts.num_insertions[c] += stats.insertions[c];
}

void RunState::allow_short_visit(MortonKey leaf) {
  if (!is_beyond(leaf)) leaves_.edit_info(leaf).first_new_id = run_.next_point_id;
}

void RunState::require_whole_visit(MortonKey leaf) {
  if (is_beyond(leaf)) return;
  if (leaves_.info(leaf).first_new_id != 0) leaves_.edit_info(leaf).first_new_id = 0;
}

void RunState::put_cells(MortonKey leaf, LeafCells cells) {
  if (is_own(leaf)) put_shared_cells(leaf, std::move(cells));
}

void RunState::put_shared_cells(MortonKey leaf, LeafCells cells) {
  put_count(leaf, &LeafInfo::num_cells, cells.cells.size(), &RunCounts::num_cells);
  leaves_.put_cells(leaf, std::move(cells));
}

void RunState::put_facets(MortonKey leaf, LeafFacets facets) {
  if (is_own(leaf)) leaves_.put_facets(leaf, std::move(facets));
}

void RunState::change(MortonKey leaf, const Changes<CellList>& changes) {
  if (!is_own(leaf)) return;
  LeafCells held = leaves_.cells(leaf);
  CellList list{std::move(held.vertices), std::move(held.cells)};
  apply(changes, list);
  put_cells(leaf, {std::move(list.vertices), std::move(list.cells), std::move(held.asked)});
}

void RunState::change(MortonKey leaf, const Changes<FacetList>& changes) {
  if (!is_own(leaf)) return;
  LeafFacets held = leaves_.facets(leaf);
  FacetList list{std::move(held.vertices), std::move(held.facets)};
  apply(changes, list);
  put_facets(leaf, {std::move(list.vertices), std::move(list.facets)});
}

void RunState::ask_for_visit(MortonKey leaf, const Point& place) {
  if (leaves_.info(leaf).num_points == 0) return;
  enqueue(leaf);
  if (leaves_.info(leaf).first_new_id == 0) return;
  LeafCells cells = leaves_.cells(leaf);
  cells.asked.push_back(place);
  put_cells(leaf, std::move(cells));
}

void RunState::leave_out_cells(MortonKey leaf, LeafCells left) {
  if (is_beyond(leaf)) return;
  LeafInfo& info = leaves_.edit_info(leaf);
  info.num_left_out += info.num_cells - left.cells.size();
  put_shared_cells(leaf, std::move(left));
}

void RunState::put_unresolved(MortonKey leaf, LeafUnresolved unresolved) {
  if (is_beyond(leaf)) return;
  put_count(leaf, &LeafInfo::num_unresolved, unresolved.sites.size(), &RunCounts::num_unresolved);
  leaves_.put_unresolved(leaf, std::move(unresolved));
}

void RunState::put_num_core_cells(MortonKey leaf, std::uint64_t num_cells) {
  // Of a copy, not all is known that it takes to count them.
  if (is_own(leaf) && leaves_.info(leaf).num_core_cells != num_cells)
    put_count(leaf, &LeafInfo::num_core_cells, num_cells, &RunCounts::num_cells);
}

void RunState::split(MortonKey leaf, std::array<Child, 8> children) {
  const LeafInfo parent = leaves_.info(leaf);
  if (parent.holding == Holding::kOwn) {
    run_.counts.num_cells -= parent.num_cells + parent.num_core_cells;
    run_.counts.num_unresolved -= parent.num_unresolved;
  }
  if (parent.queued) dequeue(leaf);
  leaves_.erase_leaf(leaf);
  octree_.split(leaf);
  if (parent.holding == Holding::kOwn) num_own_leaves_ += 7;
  for (int octant = 0; octant < 8; ++octant) {
    auto& [is_center_inside, points, surface, sizes] = children[static_cast<std::size_t>(octant)];
    const MortonKey key = leaf.child(octant);
    LeafInfo info;
    info.holding = parent.holding;
    info.ranks = parent.ranks;
    info.is_center_inside = is_center_inside;
    info.num_points = points.points.size();
    info.num_core_points = num_points(points.core, sites(key));
    info.num_triangles = surface.triangles.size();
    leaves_.add_leaf(key, info, std::move(points), std::move(surface));
    if (!is_uniform()) put_sizes(key, std::move(sizes));
    leaves_.edit_info(key).reached_size = parent.reached_size;
    if (info.num_points > 0) enqueue(key);
  }
}

void RunState::note_visit() {
  ++num_unwritten_visits_;
  leaves_.trim();
}

bool RunState::is_commit_due() const {
  return num_unwritten_visits_ >= kMaxVisitsOfCommit ||
         leaves_.unwritten_bytes() > max_unwritten_bytes_ ||
         std::chrono::steady_clock::now() - last_commit_ > kMaxTimeOfCommit;
}

void RunState::begin_applying(const QueuePosition& color, std::uint64_t first, std::uint64_t end) {
  rank_->applied = color;
  rank_->is_all_sent = false;
  rank_->num_sent = 0;
  rank_->next_id = first;
  rank_->end_id = end;
}

void RunState::end_applying() {
  rank_->applied.reset();
  end_ids();
  run_.next_point_id = rank_->end_id;
}

void RunState::keep_result(MortonKey leaf, RankResult result) {
  unwritten_results_[leaf] = std::move(result);
}

void RunState::drop_result(MortonKey leaf) { unwritten_results_[leaf] = std::nullopt; }

void RunState::end_superstep(std::string said) {
  ++rank_->superstep;
  unwritten_words_ = RankWords{std::move(said)};
}

void RunState::commit(const std::optional<MemoryRecord>& memory, const TimelineRecord* timeline) {
  Batch batch = store_.begin();
  leaves_.write_to(batch);
  queue_.write_to(batch);
  batch.put_run(run_);
  if (memory) batch.put_memory(*memory);
  if (timeline) batch.put_timeline(*timeline);
  if (rank_) batch.put_rank(*rank_);
  if (unwritten_words_) batch.put_words(*unwritten_words_);
  for (const auto& [leaf, result] : unwritten_results_)
    if (result)
      batch.put_result(leaf, *result);
    else
      batch.erase_result(leaf);
  batch.commit();
  unwritten_results_.clear();
  unwritten_words_.reset();
  num_unwritten_visits_ = 0;
  last_commit_ = std::chrono::steady_clock::now();
  leaves_.trim();
  store_.release_pages();
}

}  // namespace locvol
