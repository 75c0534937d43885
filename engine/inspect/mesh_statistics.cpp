#include "engine/inspect/mesh_statistics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include "engine/compensated_sum.h"
#include "engine/inspect/cell_mesh.h"
#include "engine/output/leaf_window.h"
#include "engine/output/stored_mesh.h"
#include "engine/run_state.h"
#include "engine/workers.h"
#include "octree/octree.h"

namespace locvol {
namespace {

constexpr std::size_t kNumAngleBins = 91, kNumRatioBins = 29;
constexpr double kFirstRatio = 0.6, kRatioStep = 0.05;
constexpr std::size_t kWindowBytes = std::size_t{8} << 20;
// Of a task, which measures leaf after leaf.
constexpr std::uint64_t kCellsPerPiece = 40'000;

double degrees(double cosine) {
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * (180 / std::numbers::pi);
}
double cosine_of(double degrees) { return std::cos(degrees * (std::numbers::pi / 180)); }

Histogram angle_histogram() {
  Histogram angles{{0}, std::vector<std::uint64_t>(kNumAngleBins)};
  for (int edge = 1; edge < 180; edge += 2) angles.edges.push_back(edge);
  angles.edges.push_back(180);
  return angles;
}

Histogram ratio_histogram() {
  Histogram ratios{{}, std::vector<std::uint64_t>(kNumRatioBins)};
  for (std::size_t i = 0; i <= kNumRatioBins; ++i)
    ratios.edges.push_back(static_cast<double>(12 + i) / 20);
  return ratios;
}

// Finds the bin of an angle from its cosine.
class AngleBins {
 public:
  AngleBins() {
    const std::vector<double> edges = angle_histogram().edges;
    for (std::size_t i = 0; i < kNumAngleBins; ++i) cosines_[i] = cosine_of(edges[i]);
    for (std::size_t k = 0; k < kSteps; ++k)
      first_[k] = search(0, 1 - 2 * static_cast<double>(k) / kSteps);
  }

  // REQUIRES: not NaN
  std::size_t bin(double cosine) const {
    const double place = (1 - std::clamp(cosine, -1.0, 1.0)) * (kSteps / 2);
    const std::size_t step = std::min(static_cast<std::size_t>(place), kSteps - 1);
    return search(first_[step] > 0 ? first_[step] - 1 : 0, cosine);
  }

 private:
  static constexpr std::size_t kSteps = 1024;

  std::size_t search(std::size_t bin, double cosine) const {
    while (bin + 1 < kNumAngleBins && cosine <= cosines_[bin + 1]) ++bin;
    return bin;
  }

  std::array<double, kNumAngleBins> cosines_{};  // of the bins' lower edges
  std::array<std::size_t, kSteps> first_{};      // bin of the smallest angle in each step of cosine
};

std::size_t ratio_bin(double ratio, std::span<const double> edges) {
  const double place = (ratio - kFirstRatio) / kRatioStep;
  auto bin = static_cast<std::size_t>(std::clamp(place, 0.0, kNumRatioBins - 1.0));
  if (ratio < edges[bin] && bin > 0) --bin;
  if (bin + 1 < kNumRatioBins && ratio >= edges[bin + 1]) ++bin;
  return bin;
}

// What is gathered of some cells. Sums of counts and extremes know no order; the volume is added up
// in Morton order.
struct Gathered {
  MeshStatistics statistics;
  CompensatedSum volume;
  double min_cosine = 1, max_cosine = -1;

  void add(const Gathered& other) {
    MeshStatistics& to = statistics;
    const MeshStatistics& from = other.statistics;
    to.num_cells += from.num_cells;
    for (const auto histogram :
         {&MeshStatistics::dihedral_angles, &MeshStatistics::min_dihedral_angles,
          &MeshStatistics::radius_edge_ratios}) {
      auto& counts = (to.*histogram).counts;
      std::ranges::transform(counts, (from.*histogram).counts, counts.begin(), std::plus());
    }
    volume.add(other.volume);
    min_cosine = std::min(min_cosine, other.min_cosine);
    max_cosine = std::max(max_cosine, other.max_cosine);
    to.max_circumradius = std::max(to.max_circumradius, from.max_circumradius);
    to.max_radius_edge_ratio = std::max(to.max_radius_edge_ratio, from.max_radius_edge_ratio);
  }
};

// Measures cells in units of λ, in which nothing overflows.
class CellGauge {
 public:
  CellGauge(double size, Gathered& gathered) : scale_(1 / size), out_(gathered) {}

  void add(const std::array<Point, 4>& corners) {
    const Point a = scale_ * (corners[1] - corners[0]), b = scale_ * (corners[2] - corners[0]),
                c = scale_ * (corners[3] - corners[0]);
    const Point bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
    const double six_volumes = dot(a, bc);
    ++out_.statistics.num_cells;
    out_.volume.add(six_volumes / 6);
    add_angles({unit(bc), unit(ca), unit(ab), unit(-1 * (bc + ca + ab))});

    const double a2 = dot(a, a), b2 = dot(b, b), c2 = dot(c, c);
    // Below that, a radius would show the rounding of a volume.
    if (!(six_volumes * six_volumes > kNearlyFlat * a2 * b2 * c2)) {
      const CellQuality quality = quality_of({Point{}, a, b, c});
      return add_radius(quality.circumradius, quality.radius_edge_ratio);
    }
    const double of_others =
        std::min(std::min(squared_distance(a, b), squared_distance(b, c)), squared_distance(c, a));
    const double shortest2 = std::min(std::min(std::min(a2, b2), c2), of_others);
    const double radius = norm(a2 * bc + b2 * ca + c2 * ab) / std::abs(2 * six_volumes);
    add_radius(radius, radius / std::sqrt(shortest2));
  }

 private:
  static constexpr double kNearlyFlat = 1e-16;

  static Point unit(const Point& p) { return (1 / norm(p)) * p; }

  void add_radius(double radius, double ratio) {
    MeshStatistics& to = out_.statistics;
    to.max_circumradius = std::max(to.max_circumradius, radius);
    to.max_radius_edge_ratio = std::max(to.max_radius_edge_ratio, ratio);
    ++to.radius_edge_ratios.counts[ratio_bin(ratio, to.radius_edge_ratios.edges)];
  }

  // Between two facets: a straight angle less that between their outward normals. A facet without
  // area makes an angle of 0.
  void add_angles(const std::array<Point, 4>& normals) {
    static const AngleBins bins;
    double of_least = -1, of_most = 1;  // cosines of the smallest angle and of the largest
    auto& counts = out_.statistics.dihedral_angles.counts;
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j) {
        const double minus_cosine = dot(normals[i], normals[j]);
        const double cosine = minus_cosine >= -1 ? -minus_cosine : 1;
        ++counts[bins.bin(cosine)];
        of_least = std::max(of_least, cosine);
        of_most = std::min(of_most, cosine);
      }
    ++out_.statistics.min_dihedral_angles.counts[bins.bin(of_least)];
    out_.max_cosine = std::max(out_.max_cosine, of_least);
    out_.min_cosine = std::min(out_.min_cosine, of_most);
  }

  double scale_;
  Gathered& out_;
};

// Neighboring leaves, measured by one thread from a snapshot of its own.
class Piece : public Task {
 public:
  Piece(const Store& store, const RunRecord& run, const LinearOctree& octree,
        std::vector<std::size_t> leaves, Gathered& total, const std::function<void()>& on_applied)
      : store_(store),
        run_(run),
        octree_(octree),
        leaves_(std::move(leaves)),
        total_(total),
        on_applied_(on_applied) {}

  void compute() override {
    const Snapshot snapshot = store_.snapshot();
    LeafWindow<PointTable> tables(kWindowBytes, [&](std::size_t leaf) {
      return PointTable(snapshot.points(octree_.leaves()[leaf]));
    });
    for (const std::size_t leaf : leaves_) measure(snapshot, leaf, tables);
  }
  void apply() override {
    total_.add(gathered_);
    on_applied_();
  }

 private:
  void measure(const Reader& reader, std::size_t leaf, LeafWindow<PointTable>& tables) {
    const LeafCells cells = reader.cells(octree_.leaves()[leaf]);
    const std::vector<Point> positions = positions_of(cells.vertices, leaf, tables);
    CellGauge gauge(run_.parameters.size, gathered_);
    for (const auto& [a, b, c, d] : cells.cells) {
      const std::array corners = {positions[a], positions[b], positions[c], positions[d]};
      for (const std::uint32_t i : {a, b, c, d})
        if (std::isnan(positions[i].x))
          throw_unknown_point(cells.vertices[i], octree_.leaves()[leaf]);
      gauge.add(corners);
    }
  }

  // NaN where no leaf near has the point.
  std::vector<Point> positions_of(std::span<const std::uint64_t> ids, std::size_t leaf,
                                  LeafWindow<PointTable>& tables) const {
    std::vector<Point> positions(ids.size(), {kUnknown, kUnknown, kUnknown});
    const std::size_t num_sites = num_site_ids(ids);
    for (std::size_t i = 0; i < num_sites; ++i) positions[i] = lattice_.position(site_of(ids[i]));
    const auto others = ids.subspan(num_sites);
    std::size_t num_left = others.size();
    const auto take_from = [&](std::size_t neighbor) {
      const auto table = tables.get(neighbor);
      for_each_common(others, table->ids, [&](auto id, auto place) {
        positions[num_sites + static_cast<std::size_t>(id)] =
            table->positions[static_cast<std::size_t>(place)];
        --num_left;
      });
    };
    take_from(leaf);
    if (num_left == 0) return positions;
    const double reach = kCellReach * run_.parameters.size;
    for (const std::size_t other : leaves_near(octree_, run_.frame, leaf, reach))
      if (other != leaf) take_from(other);
    return positions;
  }

  // How many of the ascending ids are those of lattice points, whose places the run knows.
  std::size_t num_site_ids(std::span<const std::uint64_t> ids) const {
    const bool has_site_ids = run_.parameters.init == Initialization::kCover &&
                              run_.next_point_id >= kFirstOtherId;  // not in stores of old
    if (!has_site_ids) return 0;
    return static_cast<std::size_t>(std::ranges::lower_bound(ids, kFirstOtherId) - ids.begin());
  }

  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

  const Store& store_;
  const RunRecord& run_;
  const LinearOctree& octree_;
  std::vector<std::size_t> leaves_;  // places in Morton order
  Gathered& total_;
  const std::function<void()>& on_applied_;
  Lattice lattice_ = lattice_of(run_);
  Gathered gathered_;
};

// Congruent cells of spacing 1.75 λ: four dihedral angles of 60 degrees and two of 90.
void add_core(std::uint64_t num_cells, Gathered& gathered) {
  if (num_cells == 0) return;
  const double edge = std::sqrt(3.0) / 2 * kLatticeSpacing;  // the shortest
  const double radius = std::sqrt(5.0) / 4 * kLatticeSpacing;
  const AngleBins bins;
  const std::size_t bin60 = bins.bin(0.5), bin90 = bins.bin(0);
  MeshStatistics& to = gathered.statistics;
  to.num_cells += num_cells;
  to.num_core_cells += num_cells;
  to.dihedral_angles.counts[bin60] += 4 * num_cells;
  to.dihedral_angles.counts[bin90] += 2 * num_cells;
  to.min_dihedral_angles.counts[bin60] += num_cells;
  to.radius_edge_ratios.counts[ratio_bin(radius / edge, to.radius_edge_ratios.edges)] += num_cells;
  to.max_circumradius = std::max(to.max_circumradius, radius);
  to.max_radius_edge_ratio = std::max(to.max_radius_edge_ratio, radius / edge);
  gathered.max_cosine = std::max(gathered.max_cosine, 0.5);
  gathered.min_cosine = std::min(gathered.min_cosine, 0.0);
  const double volume = kLatticeSpacing * kLatticeSpacing * kLatticeSpacing / 12;
  gathered.volume.add(volume * static_cast<double>(num_cells));
}

}  // namespace

std::uint64_t Histogram::total() const {
  return std::reduce(counts.begin(), counts.end(), std::uint64_t{0});
}

MeshStatistics::MeshStatistics()
    : dihedral_angles(angle_histogram()),
      min_dihedral_angles(angle_histogram()),
      radius_edge_ratios(ratio_histogram()) {}

MeshStatistics mesh_statistics(const Store& store, int num_threads, const StepProgress& on_step) {
  const Snapshot snapshot = store.snapshot();
  const RunRecord run = finished_run(store, snapshot);
  const LinearOctree octree = stored_octree(store, snapshot);
  std::vector<std::uint64_t> num_cells;
  num_cells.reserve(octree.size());
  Gathered all;
  std::uint64_t num_listed_cells = 0, num_core_cells = 0;
  snapshot.for_each_leaf([&](MortonKey, const LeafInfo& info) {
    num_cells.push_back(info.num_cells);
    num_listed_cells += info.num_cells;
    num_core_cells += info.num_core_cells;
    return true;
  });
  const std::function<void()> tell = [&] {
    if (on_step) on_step(all.statistics.num_cells, num_listed_cells);
  };
  std::size_t leaf = 0;
  Workers(num_threads).run_in_order([&]() -> std::unique_ptr<Task> {
    std::vector<std::size_t> leaves;
    for (std::uint64_t num = 0; leaf < num_cells.size() && num < kCellsPerPiece; ++leaf) {
      if (num_cells[leaf] > 0) leaves.push_back(leaf);
      num += num_cells[leaf];
    }
    if (leaves.empty()) return nullptr;
    return std::make_unique<Piece>(store, run, octree, std::move(leaves), all, tell);
  });
  add_core(num_core_cells, all);

  MeshStatistics& statistics = all.statistics;
  statistics.volume = all.volume.value() * std::pow(run.parameters.size, 3);
  if (statistics.num_cells > 0) {
    statistics.min_dihedral_degrees = degrees(all.max_cosine);
    statistics.max_dihedral_degrees = degrees(all.min_cosine);
  }
  return statistics;
}

}  // namespace locvol
