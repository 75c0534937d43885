#include "engine/output/mesh_source.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "engine/inspect/cell_mesh.h"
#include "engine/leaf_name.h"
#include "engine/output/stored_mesh.h"

namespace locvol {
namespace {

constexpr std::uint64_t kFullPieceBytes = std::uint64_t{1} << 20;

}  // namespace

MeshSource::MeshSource(const Store& store, const std::filesystem::path& output, int num_threads,
                       const StepProgress& on_step)
    : snapshot_(store.snapshot()),
      run_(finished_run(store, snapshot_)),
      output_(output),
      on_step_(on_step),
      pages_(store),
      numbering_(snapshot_, run_, output, pages_),
      positions_(snapshot_, numbering_),
      workers_(num_threads) {}

std::vector<std::uint32_t> MeshSource::leaves_of_cells(std::uint64_t first,
                                                       std::uint64_t count) const {
  std::vector<std::uint32_t> leaves;
  leaves.reserve(count);
  if (count == 0) return leaves;
  for (std::size_t leaf = numbering_.leaf_of_cell(first); leaves.size() < count; ++leaf) {
    const std::uint64_t end = std::min(numbering_.first_cell(leaf + 1), first + count);
    leaves.resize(end - first, static_cast<std::uint32_t>(leaf));
  }
  return leaves;
}

BoundarySurface& MeshSource::boundary() {
  if (!boundary_)
    boundary_ = std::make_unique<BoundarySurface>(snapshot_, numbering_, positions_, output_,
                                                  pages_, workers_);
  return *boundary_;
}

std::function<std::optional<MeshPiece>()> MeshSource::pieces(const PieceParts& parts) {
  return [this, parts, leaf = std::size_t{0}, num_vertices = std::uint64_t{0},
          num_cells = std::uint64_t{0}]() mutable -> std::optional<MeshPiece> {
    const std::size_t num_leaves = numbering_.leaves().size();
    if (leaf == num_leaves) return std::nullopt;
    MeshPiece piece;
    piece.first_vertex = num_vertices;
    piece.first_cell = num_cells;
    for (; leaf < num_leaves && piece.bytes() < kFullPieceBytes; ++leaf) {
      if (parts.has_points) add_points(leaf, piece);
      if (parts.has_cells) add_cells(leaf, parts.has_corners, piece);
    }
    num_vertices += piece.points.size();
    num_cells += piece.cells.size();
    pages_.count(piece.bytes());
    if (on_step_ && num_cells > num_told_) on_step_(num_told_ = num_cells, this->num_cells());
    return piece;
  };
}

void MeshSource::add_points(std::size_t leaf, MeshPiece& piece) {
  numbering_.for_each_vertex(leaf, [&](const Point& p) {
    piece.points.push_back({p.x, p.y, p.z});
  });
}

// The cells of the leaf's core, by formula. Returns how many there are.
std::uint64_t MeshSource::add_core_cells(std::size_t leaf, MeshPiece& piece) {
  // Not asked for leaves outside, which may be a thousand λ wide.
  if (numbering_.num_core_vertices(leaf) == 0) return 0;
  const SiteBlock<std::int64_t>* numbers = numbering_.core_numbers(leaf);
  const std::size_t num_before = piece.cells.size();
  for_each_site(numbering_.sites(leaf), [&](const LatticeSite& site) {
    const std::int64_t here = (*numbers)[site];
    if (here < 0) return;
    std::array<std::int64_t, kLargerNeighbors.size()> others{};
    for (std::size_t n = 0; n < others.size(); ++n)
      others[n] = (*numbers)[site + kLargerNeighbors[n]];
    for (const auto& [a, b, c] : kCellsOfLargerNeighbors) {
      if (others[a] < 0 || others[b] < 0 || others[c] < 0) continue;
      piece.cells.push_back({here, others[a], others[b], others[c]});
    }
  });
  return piece.cells.size() - num_before;
}

void MeshSource::add_cells(std::size_t leaf, bool has_corners, MeshPiece& piece) {
  const MortonKey key = numbering_.leaves()[leaf];
  const LeafCells cells = snapshot_.cells(key);
  const std::vector<std::int64_t> numbers = numbering_.numbers(leaf, cells);
  for (const auto& [a, b, c, d] : cells.cells)
    piece.cells.push_back({numbers[a], numbers[b], numbers[c], numbers[d]});
  if (has_corners) {
    const std::vector<Point> positions = positions_.of(cells.vertices, numbers);
    for (const auto& [a, b, c, d] : cells.cells)
      piece.corners.push_back({positions[a], positions[b], positions[c], positions[d]});
  }
  const std::uint64_t num_core = add_core_cells(leaf, piece);
  if (num_core != numbering_.num_core_cells(leaf))
    throw CorruptRecord(leaf_name(key) + ": its count of core cells is not theirs", key);
  piece.runs.push_back({static_cast<std::uint32_t>(leaf), cells.cells.size(), num_core});
}

std::vector<QualityValues> quality_of(const MeshPiece& piece) {
  static const QualityValues core = {static_cast<float>(std::sqrt(5.0 / 12)), 60};
  std::vector<QualityValues> values;
  values.reserve(piece.cells.size());
  auto corners = piece.corners.begin();
  for (const LeafRun& run : piece.runs) {
    for (std::uint64_t i = 0; i < run.num_listed; ++i) {
      const CellQuality q = quality_of(*corners++);
      values.push_back(
          {static_cast<float>(q.radius_edge_ratio), static_cast<float>(q.min_dihedral_degrees)});
    }
    values.insert(values.end(), run.num_core, core);
  }
  return values;
}

std::vector<std::uint32_t> leaves_of(const MeshPiece& piece) {
  std::vector<std::uint32_t> leaves;
  leaves.reserve(piece.cells.size());
  for (const LeafRun& run : piece.runs)
    leaves.insert(leaves.end(), run.num_listed + run.num_core, run.leaf);
  return leaves;
}

}  // namespace locvol
