// What the kernels of refine/ cost on the leaves of a real run, without store and engine.
//
//   leaf_benchmark SURFACE SIZE [Google Benchmark's options]
//
// SIZE (λ) is a length, or a percentage of the smallest side of the bounding box. The run is one of
// cover mode over cubes as wide as the engine's, one after another, until all are clean; the visits
// of the first and of the second round are then timed again and again, with the building of their
// domains. Of a large surface, only the first leaves (in lexicographic order) with points are
// visited.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "engine/ingest/surface_reader.h"
#include "engine/locvol.h"
#include "engine/shared/standard_streams.h"
#include "octree/octree.h"
#include "octree/site_block.h"
#include "refine/cover_leaf.h"
#include "refine/delaunay.h"
#include "refine/fill_leaf.h"
#include "refine/refine_leaf.h"

namespace locvol {
namespace {

constexpr double kLeafSide = 31;  // over λ
constexpr std::size_t kMaxLeaves = 12;

struct PolygonList : SurfaceSink {
  void vertex(const Point& position) override { vertices.push_back(position); }
  void polygon(std::span<const std::uint64_t> corners, const FilePlace&) override {
    for (std::size_t i = 2; i < corners.size(); ++i)
      indices.push_back({corners[0], corners[i - 1], corners[i]});
  }
  void facet(const std::array<Point, 3>& corners) override {
    const std::uint64_t first = vertices.size();
    vertices.insert(vertices.end(), corners.begin(), corners.end());
    indices.push_back({first, first + 1, first + 2});
  }
  std::vector<Point> vertices;
  std::vector<std::array<std::uint64_t, 3>> indices;
};

struct Leaf {
  Box box;
  SiteBox sites;
  DomainPiece domain;
  FillInput fill;                 // as it was when the leaf was filled
  std::vector<LeafInput> visits;  // with last_visit, from the second on
  std::optional<LastVisit> last_visit = std::nullopt;
};

class Run {
 public:
  Run(const std::string& file, const std::string& size) {
    PolygonList list;
    parse_surface(file, list);
    for (const auto& [a, b, c] : list.indices)
      triangles_.push_back(
          {triangles_.size(), {list.vertices[a], list.vertices[b], list.vertices[c]}});
    Box box = triangles_.front().box();
    for (const Triangle& t : triangles_) box = box.joined(t.box());
    const Point d = box.max - box.min;
    const bool is_percent = size.ends_with('%');
    size_ = std::stod(size) * (is_percent ? std::min({d.x, d.y, d.z}) / 100 : 1);
    const Box around = box.expanded(size_);
    const LeafDomain whole({triangles_, around, around.min, {}});
    frame_ = Frame::around(box, 0.5 * size_, kLeafSide * size_);
    lattice_ = Lattice(frame_, size_, kLeafSide * size_);
    cut(box.expanded(0.5 * size_), whole);
    cover();
    for (int round = 0; round < 10 && visit_all(); ++round) {
    }
    std::printf(
        "%zu leaves, %zu points, %zu cells; %zu holes filled; insertions C5 %zu, in all %zu; %zu "
        "core points "
        "met\n",
        leaves_.size(), points_.size(), num_cells_, num_holes_, num_c5_, num_insertions_, num_met_);
  }

  double size() const { return size_; }
  const std::vector<Leaf>& leaves() const { return leaves_; }
  CoverInput cover_input(const Leaf& leaf) const {
    return {size_, 0, lattice_, leaf.box, leaf.domain, {}};
  }

 private:
  void cut(const Box& box, const LeafDomain& whole) {
    const int level = frame_.level_of_side(kLeafSide * size_);
    const LinearOctree octree = LinearOctree::uniform(level);
    for (const MortonKey key : octree.leaves()) {
      Leaf leaf;
      leaf.box = frame_.box(key);
      if (!leaf.box.overlaps(box) || leaves_.size() == kMaxLeaves) continue;
      leaf.sites = lattice_.sites_in(leaf.box);
      const Point center = leaf.box.center();
      leaf.domain = {.triangles = {},
                     .region = leaf.box.expanded(1.01 * kCoreDepth * size_),
                     .reference = center,
                     .reference_state = *whole.state(center),
                     .fineness = {size_}};
      std::ranges::copy_if(triangles_, std::back_inserter(leaf.domain.triangles),
                           [&](const Triangle& t) { return t.box().overlaps(leaf.domain.region); });
      if (leaf.domain.has_surface()) leaves_.push_back(std::move(leaf));
    }
  }

  void cover() {
    for (const Leaf& leaf : leaves_) {
      CoverInput input = cover_input(leaf);
      for (const MeshPoint& p : points_)
        if (p.kind == PointKind::kSurface &&
            std::sqrt(leaf.box.squared_distance(p.position)) <= kSampleRadius * size_)
          input.nearby_samples.push_back(p.position);
      const CoverPoints cover = cover_leaf(input);
      for (const Point& p : cover.samples) points_.push_back({next_id_++, p, PointKind::kSurface});
      for (const LatticeSite& site : cover.lattice) add(site);
      for_each_core_site(cover.core, leaf.sites, leaf.sites,
                         [&](const LatticeSite& site, std::uint64_t) { core_.insert(site); });
    }
    for (Leaf& leaf : leaves_) {
      leaf.fill = fill_input(leaf);
      const FillPoints fill = fill_leaf(leaf.fill);
      for (const Point& p : fill.centers) points_.push_back({next_id_++, p, PointKind::kVolume});
      for (const std::uint64_t id : fill.met_core) make_explicit(site_of(id));
      num_holes_ += fill.centers.size();
    }
  }

  FillInput fill_input(const Leaf& leaf) const {
    FillInput input{size_, leaf.box, {}, core_around(leaf), leaf.domain};
    const double reach = kFillReach * size_;
    std::ranges::copy_if(points_, std::back_inserter(input.points), [&](const MeshPoint& p) {
      return leaf.box.squared_distance(p.position) <= reach * reach;
    });
    return input;
  }

  void add(const LatticeSite& site) {
    const MeshPoint point = lattice_.point(site);
    points_.insert(std::ranges::lower_bound(points_, point.id, {}, &MeshPoint::id), point);
  }
  void make_explicit(const LatticeSite& site) {
    core_.erase(site);
    add(site);
  }
  CoreRows core_around(const Leaf& leaf) const {
    const SiteBox around = lattice_.sites_in(leaf.box.expanded(kCoreReach * size_));
    LatticeCore core;
    for (const LatticeSite& site : core_)
      if (around.contains(site)) add_row({site, 1}, core);
    return {lattice_, core.rows};
  }

  LeafInput load(const Leaf& leaf) const {
    LeafInput input;
    input.criteria = Criteria::of_cover(size_, 2, 0.02);
    input.box = leaf.box;
    input.domain = leaf.domain;
    input.core = core_around(leaf);
    input.last_visit = leaf.last_visit;
    const double reach = input.criteria.reach;
    for (const MeshPoint& p : points_)
      if (is_in_leaf(leaf.box, p.position))
        input.own.push_back(p);
      else if (leaf.box.squared_distance(p.position) <= reach * reach)
        input.ghosts.push_back(p);
    return input;
  }
  // Visits of leaves within `distance` of p are to be of the whole leaf.
  void forbid_shorter_visits(const Point& p, double distance) {
    for (Leaf& leaf : leaves_)
      if (leaf.box.squared_distance(p) <= distance * distance) leaf.last_visit.reset();
  }

  bool visit_all() {
    bool is_changed = false;
    num_cells_ = 0;
    for (Leaf& leaf : leaves_) {
      leaf.visits.push_back(load(leaf));
      const LeafDelta delta = refine_leaf(leaf.visits.back());
      is_changed |= !delta.inserted.empty();
      num_cells_ += delta.cells.size();
      num_c5_ += delta.stats.insertions[4];
      num_insertions_ += delta.inserted.size();
      std::erase_if(points_, [&](const MeshPoint& p) {
        return std::ranges::find(delta.deleted, p) != delta.deleted.end();
      });
      std::vector<std::uint64_t> ids;
      for (const InsertedPoint& p : delta.inserted) {
        ids.push_back(next_id_);
        if (!p.is_deleted) points_.push_back({next_id_++, p.position, p.kind});
      }
      for (const MeshPoint& p : delta.deleted) forbid_shorter_visits(p.position, kReach * size_);
      leaf.last_visit.reset();
      if (delta.unresolved.empty()) {
        leaf.last_visit = LastVisit{next_id_, delta.cells};
        for (VertexRef& ref : leaf.last_visit->cells.vertices)
          if (ref & kNewPoint) ref = ids[ref & ~kNewPoint];
      }
      for (const std::uint64_t id : delta.met_core) {
        make_explicit(site_of(id));
        forbid_shorter_visits(lattice_.position(site_of(id)), kNeighborhood * size_);
        ++num_met_;
        is_changed = true;
      }
    }
    return is_changed;
  }

  std::vector<Triangle> triangles_;
  double size_ = 0;
  std::vector<Leaf> leaves_;
  Frame frame_;
  Lattice lattice_;
  std::set<LatticeSite> core_;
  std::vector<MeshPoint> points_;  // ids ascend
  std::uint64_t next_id_ = kFirstOtherId;
  std::size_t num_cells_ = 0, num_holes_ = 0, num_c5_ = 0, num_insertions_ = 0, num_met_ = 0;
};

void domains(benchmark::State& state, const Run& run) {
  std::size_t num = 0;
  for (auto _ : state)
    for (const Leaf& leaf : run.leaves()) {
      benchmark::DoNotOptimize(LeafDomain(leaf.domain).triangles().size());
      num += leaf.domain.triangles.size();
    }
  state.counters["triangles/s"] = benchmark::Counter(double(num), benchmark::Counter::kIsRate);
}

void covers(benchmark::State& state, const Run& run) {
  std::size_t num = 0;
  for (auto _ : state)
    for (const Leaf& leaf : run.leaves()) num += cover_leaf(run.cover_input(leaf)).samples.size();
  state.counters["samples/s"] = benchmark::Counter(double(num), benchmark::Counter::kIsRate);
}

void fills(benchmark::State& state, const Run& run) {
  std::size_t num = 0;
  for (auto _ : state)
    for (const Leaf& leaf : run.leaves()) num += fill_leaf(leaf.fill).centers.size();
  state.counters["holes/s"] = benchmark::Counter(double(num), benchmark::Counter::kIsRate);
}

void triangulations(benchmark::State& state, const Run& run) {
  std::vector<std::vector<Point>> points;
  for (const Leaf& leaf : run.leaves()) {
    points.emplace_back();
    for (const auto* some : {&leaf.visits.back().own, &leaf.visits.back().ghosts})
      for (const MeshPoint& p : *some) points.back().push_back(p.position);
  }
  std::size_t num = 0;
  for (auto _ : state)
    for (const auto& some : points) {
      Delaunay delaunay;
      delaunay.build(some);
      num += some.size();
    }
  state.counters["points/s"] = benchmark::Counter(double(num), benchmark::Counter::kIsRate);
}

void visits(benchmark::State& state, const Run& run, std::size_t round, bool is_whole) {
  std::vector<LeafInput> inputs;
  for (const Leaf& leaf : run.leaves()) {
    if (leaf.visits.size() <= round) continue;
    inputs.push_back(leaf.visits[round]);
    if (is_whole) inputs.back().last_visit.reset();
  }
  std::size_t num = 0;
  for (auto _ : state)
    for (const LeafInput& input : inputs) num += refine_leaf(input).cells.size();
  state.counters["cells/s"] = benchmark::Counter(double(num), benchmark::Counter::kIsRate);
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  using namespace locvol;
  open_standard_streams();
  share_one_heap();
  benchmark::Initialize(&argc, argv);
  if (argc != 3) {
    std::fprintf(stderr, "usage: leaf_benchmark SURFACE SIZE [--benchmark_…]\n");
    return 2;
  }
  const Run run(argv[1], argv[2]);
  const auto add = [&](const char* name, auto function, auto... arguments) {
    benchmark::RegisterBenchmark(name, [=, &run](benchmark::State& state) {
      function(state, run, arguments...);
    })->Unit(benchmark::kMillisecond);
  };
  add("domains", domains);
  add("covers", covers);
  add("fills", fills);
  add("triangulations", triangulations);
  add("first visits", visits, std::size_t{0}, true);
  add("second visits, whole", visits, std::size_t{1}, true);
  add("second visits, of what changed", visits, std::size_t{1}, false);
  benchmark::RunSpecifiedBenchmarks();
}
