#include "engine/inspect/cell_gauge.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <vector>

#include "engine/inspect/cell_mesh.h"
#include "octree/lattice.h"

namespace locvol {
namespace {

constexpr std::size_t kNumAngleBins = 91, kNumRatioBins = 29, kNumRadiusBins = 20;
constexpr double kFirstRatio = 0.6, kRatioStep = 0.05;
// Of six times the volume, squared, over that of a box with the same edges at the first corner.
// Below that, a radius would show the rounding of a volume.
constexpr double kNearlyFlat = 1e-16;
// Of a bound on angles: what lies closer below it differs by rounding only.
constexpr double kAngleSlack = 1e-9;

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

Histogram radius_histogram() {
  Histogram radii{{}, std::vector<std::uint64_t>(kNumRadiusBins)};
  for (std::size_t i = 0; i <= kNumRadiusBins; ++i)
    radii.edges.push_back(static_cast<double>(i) / kNumRadiusBins);
  return radii;
}

// Finds the bin of an angle from its cosine, without branches.
class AngleBins {
 public:
  AngleBins() {
    const std::vector<double> edges = angle_histogram().edges;
    cosines_.fill(-std::numeric_limits<double>::infinity());
    for (std::size_t i = 0; i < kNumAngleBins; ++i) cosines_[i] = cosine_of(edges[i]);
    // Each step of cosines begins in this bin, or some rounding errors into it.
    for (std::size_t k = 0; k < kSteps; ++k)
      while (first_[k] + 1 < kNumAngleBins &&
             1 - (static_cast<double>(k) - 1e-6) / kStepsOfOne <= cosines_[first_[k] + 1])
        ++first_[k];
  }

  // REQUIRES: not NaN
  std::size_t bin(double cosine) const {
    const double place = (1 - std::clamp(cosine, -1.0, 1.0)) * kStepsOfOne;
    std::size_t bin = first_[std::min(static_cast<std::size_t>(place), kSteps - 1)];
    for (std::size_t i = 0; i < kMostEdges; ++i) bin += cosine <= cosines_[bin + 1];
    return bin;
  }

 private:
  static constexpr std::size_t kSteps = 1024;
  static constexpr double kStepsOfOne = kSteps / 2.0;
  static constexpr std::size_t kMostEdges = 2;  // of bins, within one step

  std::array<double, kNumAngleBins + 1> cosines_{};  // of the bins' lower edges; none lies beyond
  std::array<std::size_t, kSteps> first_{};          // the bin that a step begins in
};

std::size_t ratio_bin(double ratio, std::span<const double> edges) {
  const double place = (ratio - kFirstRatio) / kRatioStep;
  auto bin = static_cast<std::size_t>(std::clamp(place, 0.0, kNumRatioBins - 1.0));
  if (ratio < edges[bin] && bin > 0) --bin;
  if (bin + 1 < kNumRatioBins && ratio >= edges[bin + 1]) ++bin;
  return bin;
}

// ---- Some cells side by side, one in each lane

using Lanes [[gnu::vector_size(CellGauge::kAtOnce * sizeof(double))]] = double;

Lanes root(const Lanes& v) {
  Lanes roots{};
  for (std::size_t lane = 0; lane < CellGauge::kAtOnce; ++lane) roots[lane] = std::sqrt(v[lane]);
  return roots;
}
Lanes least(const Lanes& a, const Lanes& b) { return b < a ? b : a; }

struct Vectors {
  Lanes x{}, y{}, z{};
  friend Vectors operator+(const Vectors& a, const Vectors& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
  }
  friend Vectors operator-(const Vectors& a, const Vectors& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
  }
  friend Vectors operator*(const Lanes& s, const Vectors& a) { return {s * a.x, s * a.y, s * a.z}; }
};
Lanes dot(const Vectors& a, const Vectors& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vectors cross(const Vectors& a, const Vectors& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Vectors unit(const Vectors& v) { return (1 / root(dot(v, v))) * v; }
Lanes squared_length(const Vectors& v) { return dot(v, v); }

// From the first corner of each cell to corner `k`.
Vectors edges_to(std::size_t k, std::span<const CellGauge::Corners> cells, double scale) {
  static_assert(CellGauge::kAtOnce == 2);
  const Point a = cells.front()[k] - cells.front()[0], b = cells.back()[k] - cells.back()[0];
  return (Lanes{} + scale) * Vectors{{a.x, b.x}, {a.y, b.y}, {a.z, b.z}};
}

}  // namespace

struct CellGauge::Measures {
  Lanes six_volumes, radius, ratio;
  Lanes is_flat_below;                 // six volumes, squared
  Vectors to_center;                   // of the circumball, from the first corner
  std::array<Lanes, 6> minus_cosines;  // of dihedral angles
};

CellGauge::Measures CellGauge::measures_of(std::span<const Corners> cells, double scale) {
  const Vectors a = edges_to(1, cells, scale), b = edges_to(2, cells, scale),
                c = edges_to(3, cells, scale);
  const Vectors bc = cross(b, c), ca = cross(c, a), ab = cross(a, b);
  Measures m{};
  m.six_volumes = dot(a, bc);
  // The angle between two facets is a straight one less that between their outward normals.
  const std::array<Vectors, 4> normals{unit(bc), unit(ca), unit(ab),
                                       unit(Vectors{} - (bc + ca + ab))};
  std::size_t n = 0;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = i + 1; j < 4; ++j) m.minus_cosines[n++] = dot(normals[i], normals[j]);

  const Lanes a2 = squared_length(a), b2 = squared_length(b), c2 = squared_length(c);
  const Lanes shortest2 =
      least(least(least(a2, b2), c2),
            least(least(squared_length(a - b), squared_length(b - c)), squared_length(c - a)));
  m.is_flat_below = kNearlyFlat * a2 * b2 * c2;
  m.to_center = 1 / (2 * m.six_volumes) * (a2 * bc + b2 * ca + c2 * ab);
  m.radius = root(squared_length(a2 * bc + b2 * ca + c2 * ab)) / (2 * m.six_volumes);
  m.radius = m.radius < 0 ? -m.radius : m.radius;
  m.ratio = m.radius / root(shortest2);
  return m;
}

MeshStatistics together(const MeshStatistics& a, const MeshStatistics& b) {
  MeshStatistics all = a;
  all.num_cells += b.num_cells;
  all.num_core_cells += b.num_core_cells;
  all.volume += b.volume;
  all.min_dihedral_degrees = std::min(a.min_dihedral_degrees, b.min_dihedral_degrees);
  all.num_poor_cells += b.num_poor_cells;
  all.num_forced_cells += b.num_forced_cells;
  all.num_above_ratio += b.num_above_ratio;
  all.max_neighbor_ratio = 0;
  for (const auto most :
       {&MeshStatistics::max_dihedral_degrees, &MeshStatistics::min_dihedral_bound,
        &MeshStatistics::max_radius_edge_ratio, &MeshStatistics::max_bounded_ratio,
        &MeshStatistics::max_circumradius, &MeshStatistics::max_radius_over_size})
    all.*most = std::max(a.*most, b.*most);
  for (const auto& [octave, num] : b.num_cells_by_octave) all.num_cells_by_octave[octave] += num;
  for (const auto histogram :
       {&MeshStatistics::dihedral_angles, &MeshStatistics::min_dihedral_angles,
        &MeshStatistics::radius_edge_ratios, &MeshStatistics::radii_over_size})
    for (std::size_t i = 0; i < (all.*histogram).counts.size(); ++i)
      (all.*histogram).counts[i] += (b.*histogram).counts[i];
  for (std::size_t body = 0; body < all.bodies.size(); ++body)
    all.bodies[body] = together(a.bodies[body], b.bodies.at(body));
  return all;
}

CellGauge::CellGauge(double size, double min_dihedral, double core_size, double ratio_bound)
    : size_(size),
      core_size_(core_size > 0 ? core_size : size),
      ratio_bound_(ratio_bound),
      poor_cosine_(min_dihedral > 0 ? cosine_of(min_dihedral * (1 - kAngleSlack))
                                    : std::numeric_limits<double>::infinity()) {
  counted_.min_dihedral_bound = min_dihedral;
}

CellGauge::Added CellGauge::add(std::span<const Corners> cells, const SizeField* sizes) {
  assert(cells.size() <= kAtOnce);
  Added added;
  if (cells.empty()) return added;
  auto& [radii, are_poor] = added;
  const Measures m = measures_of(cells, 1 / size_);
  counted_.num_cells += cells.size();
  for (std::size_t lane = 0; lane < cells.size(); ++lane) {
    const double six_volumes = m.six_volumes[lane];
    volume_.add(six_volumes / 6);
    std::array<double, 6> cosines{};
    for (std::size_t i = 0; i < 6; ++i) {
      const double minus_cosine = m.minus_cosines[i][lane];
      cosines[i] = minus_cosine >= -1 ? -minus_cosine : 1;  // 1 for a facet without area
    }
    are_poor[lane] = add_angles(cosines);
    const bool is_flat = !(six_volumes * six_volumes > m.is_flat_below[lane]);
    double ratio = m.ratio[lane];
    radii[lane] = m.radius[lane];
    if (is_flat) {
      Corners corners = cells[lane];
      for (Point& corner : corners) corner = 1 / size_ * (corner - cells[lane][0]);
      const CellQuality quality = quality_of(corners);
      radii[lane] = quality.circumradius;
      ratio = quality.radius_edge_ratio;
    }
    add_radius(radii[lane], ratio);
    const Point to_center{m.to_center.x[lane], m.to_center.y[lane], m.to_center.z[lane]};
    const Point& corner = cells[lane][0];
    add_radius_over_size(radii[lane],
                         sizes ? sizes->at(is_flat ? corner : corner + size_ * to_center) : size_);
  }
  return added;
}

bool CellGauge::add_angles(const std::array<double, 6>& cosines) {
  static const AngleBins bins;
  double of_least = -1, of_most = 1;  // cosines of the smallest angle and of the largest
  for (const double cosine : cosines) {
    ++counted_.dihedral_angles.counts[bins.bin(cosine)];
    of_least = std::max(of_least, cosine);
    of_most = std::min(of_most, cosine);
  }
  ++counted_.min_dihedral_angles.counts[bins.bin(of_least)];
  max_cosine_ = std::max(max_cosine_, of_least);
  min_cosine_ = std::min(min_cosine_, of_most);
  const bool is_poor = of_least > poor_cosine_;
  if (is_poor) ++counted_.num_poor_cells;
  return is_poor;
}

void CellGauge::add_radius(double radius, double ratio) {
  constexpr double kRounding = 1 + 1e-9;
  if (ratio > ratio_bound_ * kRounding)
    ++counted_.num_above_ratio;
  else
    counted_.max_bounded_ratio = std::max(counted_.max_bounded_ratio, ratio);
  counted_.max_circumradius = std::max(counted_.max_circumradius, radius);
  counted_.max_radius_edge_ratio = std::max(counted_.max_radius_edge_ratio, ratio);
  ++counted_.radius_edge_ratios.counts[ratio_bin(ratio, counted_.radius_edge_ratios.edges)];
}

// `size`: h
void CellGauge::add_radius_over_size(double radius, double size, std::uint64_t num_cells) {
  const double over_size = radius * size_ / size;
  constexpr double kLastBin = kNumRadiusBins - 1;
  const double place = std::clamp(over_size * kNumRadiusBins, 0.0, kLastBin);
  counted_.radii_over_size.counts[static_cast<std::size_t>(place)] += num_cells;
  counted_.max_radius_over_size = std::max(counted_.max_radius_over_size, over_size);
  counted_.num_cells_by_octave[std::ilogb(size)] += num_cells;
}

// Of spacing 1.75 times the size: four dihedral angles of 60 degrees and two of 90.
void CellGauge::add_core(std::uint64_t num_cells) {
  if (num_cells == 0) return;
  const double spacing = kLatticeSpacing * (core_size_ / size_);
  const double edge = std::sqrt(3.0) / 2 * spacing;  // the shortest
  const double radius = std::sqrt(5.0) / 4 * spacing, ratio = radius / edge;
  const AngleBins bins;
  const std::size_t bin60 = bins.bin(0.5), bin90 = bins.bin(0);
  counted_.num_cells += num_cells;
  counted_.num_core_cells += num_cells;
  counted_.dihedral_angles.counts[bin60] += 4 * num_cells;
  counted_.dihedral_angles.counts[bin90] += 2 * num_cells;
  counted_.min_dihedral_angles.counts[bin60] += num_cells;
  counted_.radius_edge_ratios.counts[ratio_bin(ratio, counted_.radius_edge_ratios.edges)] +=
      num_cells;
  counted_.max_circumradius = std::max(counted_.max_circumradius, radius);
  counted_.max_radius_edge_ratio = std::max(counted_.max_radius_edge_ratio, ratio);
  counted_.max_bounded_ratio = std::max(counted_.max_bounded_ratio, ratio);
  add_radius_over_size(radius, core_size_, num_cells);
  max_cosine_ = std::max(max_cosine_, 0.5);
  min_cosine_ = std::min(min_cosine_, 0.0);
  const double volume = spacing * spacing * spacing / 12;
  volume_.add(volume * static_cast<double>(num_cells));
}

void CellGauge::add(const CellGauge& other) {
  MeshStatistics& to = counted_;
  const MeshStatistics& from = other.counted_;
  to.num_cells += from.num_cells;
  to.num_core_cells += from.num_core_cells;
  to.num_poor_cells += from.num_poor_cells;
  to.num_forced_cells += from.num_forced_cells;
  for (const auto histogram :
       {&MeshStatistics::dihedral_angles, &MeshStatistics::min_dihedral_angles,
        &MeshStatistics::radius_edge_ratios, &MeshStatistics::radii_over_size}) {
    auto& counts = (to.*histogram).counts;
    std::ranges::transform(counts, (from.*histogram).counts, counts.begin(), std::plus());
  }
  to.max_circumradius = std::max(to.max_circumradius, from.max_circumradius);
  to.max_radius_edge_ratio = std::max(to.max_radius_edge_ratio, from.max_radius_edge_ratio);
  to.max_bounded_ratio = std::max(to.max_bounded_ratio, from.max_bounded_ratio);
  to.num_above_ratio += from.num_above_ratio;
  to.max_radius_over_size = std::max(to.max_radius_over_size, from.max_radius_over_size);
  for (const auto& [octave, num_cells] : from.num_cells_by_octave)
    to.num_cells_by_octave[octave] += num_cells;
  volume_.add(other.volume_);
  min_cosine_ = std::min(min_cosine_, other.min_cosine_);
  max_cosine_ = std::max(max_cosine_, other.max_cosine_);
}

MeshStatistics CellGauge::statistics() const {
  MeshStatistics all = counted_;
  all.volume = volume_.value() * std::pow(size_, 3);
  if (all.num_cells > 0) {
    all.min_dihedral_degrees = degrees(max_cosine_);
    all.max_dihedral_degrees = degrees(min_cosine_);
  }
  return all;
}

std::uint64_t Histogram::total() const {
  return std::reduce(counts.begin(), counts.end(), std::uint64_t{0});
}

MeshStatistics::MeshStatistics()
    : dihedral_angles(angle_histogram()),
      min_dihedral_angles(angle_histogram()),
      radius_edge_ratios(ratio_histogram()),
      radii_over_size(radius_histogram()) {}

}  // namespace locvol
