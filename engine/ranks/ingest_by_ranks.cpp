#include "engine/ranks/ingest_by_ranks.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "engine/exchange/pack.h"
#include "engine/ingest/sha256.h"
#include "engine/ingest/surface_groups.h"
#include "engine/ingest/surface_reader.h"
#include "engine/plan/octree_plan.h"
#include "engine/ranks/common_stop.h"
#include "engine/ranks/deal_triangles.h"
#include "engine/ranks/rank_share.h"
#include "storage/codec.h"

namespace locvol {

// What a rank has read of a surface.
struct PartFacts {
  std::uint64_t num_triangles = 0, num_collapsed = 0;
  Box box;  // of triangles, if there are any
};
// What tells two files apart.
struct FileFacts {
  std::uint64_t num_bytes = 0, num_faces = 0, num_vertices = 0;
  friend bool operator==(const FileFacts&, const FileFacts&) = default;
};

auto fields(Maybe<PartFacts> auto& part) {
  auto& [num_triangles, num_collapsed, box] = part;
  return std::tuple(Field("num_triangles", num_triangles), Field("num_collapsed", num_collapsed),
                    Field("box", box));
}
auto fields(Maybe<WallProbe> auto& probe) {
  auto& [order, place, direction, corners] = probe;
  return std::tuple(Field("order", order), Field("place", place), Field("direction", direction),
                    Field("corners", corners));
}
auto fields(Maybe<FileFacts> auto& file) {
  auto& [num_bytes, num_faces, num_vertices] = file;
  return std::tuple(Field("num_bytes", num_bytes), Field("num_faces", num_faces),
                    Field("num_vertices", num_vertices));
}

namespace {

// Does read() find nothing wrong? Who reads all of the file will say what it is.
template <class Read>
bool is_sound(const Read& read) try {
  read();
  return true;
} catch (const InputError&) {
  return false;
}

class IngestByRanks {
 public:
  IngestByRanks(std::filesystem::path file, std::filesystem::path directory, IngestWatch& watch,
                Exchange& exchange)
      : file_(std::move(file)),
        directory_(std::move(directory)),
        watch_(watch),
        exchange_(exchange),
        rank_(static_cast<std::uint64_t>(exchange.rank())),
        num_ranks_(static_cast<std::uint64_t>(exchange.num_ranks())),
        stop_(exchange) {}

  // Throws NeedsOneProcess.
  Store run(const std::function<RunRecord(const std::string&, const Box&)>& planned,
            IngestCalls calls, Workers& workers, const DiskOf& disk,
            std::uint64_t bucket_capacity) try {
    open();
    check_on_all(exchange_, [&] {
      require_ingest_room(ranges_->name(), ranges_->num_faces(), directory_, 0, disk);
    });
    RawSurface surface = read();
    const RunRecord run = planned_by_first(planned, surface);
    if (run.parameters.has_bodies) throw NeedsOneProcess();
    const OctreePlan plan = plan_octree(run.parameters, surface.box);
    const Shares shares =
        shares_of_triangles(surface, first_id_, num_triangles_, plan.frame, plan.level, exchange_);
    deal_triangles(surface, first_id_, groups_, plan.frame, shares, exchange_, stop_, watch_);
    calls.check = [this, check = calls.check](const RunRecord& known, std::uint64_t spilled) {
      stop_.meet();
      check_on_all(exchange_, [&] { check(known, spilled); });
    };
    Store store = ingest(std::move(surface), run, calls, watch_, workers, bucket_capacity,
                         RankShare(shares, exchange_, stop_));
    stop_.meet(store.snapshot().run()->phase == Phase::kIngest);
    return store;
  } catch (const Stopped&) {
    stop_.tell();
    throw;
  }

 private:
  void open() {
    FileFacts facts;
    const auto find_ranges = [&] { ranges_ = ranges_of_surface(file_, watch_.stop()); };
    if (!file_.empty() && is_sound(find_ranges) && ranges_)
      facts = {ranges_->num_bytes(), ranges_->num_faces(), ranges_->num_vertices()};
    stop_.meet();
    for (const FileFacts& of_rank : gather_values(exchange_, facts))
      if (of_rank.num_faces == 0 || of_rank != facts) throw NeedsOneProcess();
  }

  // This rank's part of the triangles; all else is of the whole surface.
  RawSurface read() {
    std::optional<RawSurface> part;
    const bool is_whole = is_sound([&] {
      part.emplace(read_part_of_surface(*ranges_, rank_, num_ranks_, directory_, watch_));
    });
    stop_.meet();
    if (any(exchange_, !is_whole || !part->collinear.empty())) throw NeedsOneProcess();
    const auto facts =
        gather_values(exchange_, PartFacts{part->num_triangles(), part->num_collapsed, part->box});
    part->num_collapsed = 0;
    for (std::uint64_t rank = 0; rank < num_ranks_; ++rank) {
      const PartFacts& of_rank = facts[rank];
      part->num_collapsed += of_rank.num_collapsed;
      if (rank == rank_) first_id_ = num_triangles_;
      if (of_rank.num_triangles == 0) continue;
      part->box = num_triangles_ == 0 ? of_rank.box : part->box.joined(of_rank.box);
      num_triangles_ += of_rank.num_triangles;
    }
    if (num_triangles_ == 0 || !is_sound([&] { require_extent(*part); })) throw NeedsOneProcess();
    part->probes = probes_of_all(part->probes);
    part->groups = groups_of_all(part->groups);
    part->digest = digest();
    return std::move(*part);
  }

  // In the order of their first triangles, which lower ranks have before others.
  std::vector<std::string> groups_of_all(const std::vector<std::string>& own) {
    std::map<std::string, SheetId> numbers;
    std::vector<std::string> all;
    for (const std::string& name : gather_all(exchange_, own))
      if (numbers.emplace(name, static_cast<SheetId>(all.size() + 1)).second) all.push_back(name);
    if (all.size() > SurfaceGroups::kMaxGroups) throw NeedsOneProcess();
    for (const std::string& name : own) groups_.push_back(numbers.at(name));
    return all;
  }

  // Those that come first, of all ranks' triangles.
  std::vector<WallProbe> probes_of_all(const std::vector<WallProbe>& own) {
    std::vector<double> orders;
    for (const WallProbe& probe : own) orders.push_back(probe.order);
    orders = gather_all(exchange_, orders);
    std::ranges::sort(orders);
    const double last =
        orders.size() > ProbePicker::kNumProbes ? orders[ProbePicker::kNumProbes - 1] : kEndless;
    std::vector<WallProbe> first;
    std::ranges::copy_if(own, std::back_inserter(first),
                         [&](const WallProbe& probe) { return probe.order <= last; });
    ProbePicker picker;
    for (const WallProbe& probe : gather_all(exchange_, first)) picker.add(probe);
    return picker.take();
  }

  // One rank after the other goes on with what those before it have hashed.
  std::string digest() {
    std::string state = Sha256().state();
    for (std::uint64_t turn = 0; turn < num_ranks_; ++turn) {
      if (turn == rank_) {
        const std::uint64_t num_bytes = ranges_->num_bytes();
        Sha256 hash = Sha256::from_state(state);
        hash_bytes(file_, begin_of_part(num_bytes, turn, num_ranks_),
                   begin_of_part(num_bytes, turn + 1, num_ranks_), hash, watch_.stop());
        state = hash.state();
      }
      stop_.meet();
      state = exchange_.gather(turn == rank_ ? state : std::string())[turn];
    }
    return Sha256::from_state(state).hex_digest();
  }

  RunRecord planned_by_first(
      const std::function<RunRecord(const std::string&, const Box&)>& planned,
      const RawSurface& surface) {
    std::string run;
    if (rank_ == 0) run = encode(planned(surface.digest, surface.box), MortonKey());
    stop_.meet();
    return decode<RunRecord>(exchange_.gather(run).front(), MortonKey());
  }

  std::filesystem::path file_, directory_;
  IngestWatch& watch_;
  Exchange& exchange_;
  std::uint64_t rank_, num_ranks_;
  CommonStop stop_;
  std::unique_ptr<SurfaceRanges> ranges_;
  std::uint64_t first_id_ = 0, num_triangles_ = 0;  // of all ranks, the latter
  std::vector<SheetId> groups_;                     // of the whole surface, by those of the part
};

}  // namespace

std::optional<Store> ingest_by_ranks(
    const std::filesystem::path& file, const std::filesystem::path& directory,
    const std::function<RunRecord(const std::string& digest, const Box& box)>& planned,
    const IngestCalls& calls, IngestWatch& watch, Workers& workers, Exchange& exchange,
    const DiskOf& disk, std::uint64_t bucket_capacity) try {
  return IngestByRanks(file, directory, watch, exchange)
      .run(planned, calls, workers, disk, bucket_capacity);
} catch (const NeedsOneProcess&) {
  return std::nullopt;
}

}  // namespace locvol
