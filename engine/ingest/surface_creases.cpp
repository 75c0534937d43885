#include "engine/ingest/surface_creases.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <span>
#include <tuple>
#include <type_traits>
#include <utility>

#include "engine/ingest/cell_creases.h"
#include "engine/ingest/sharp_edges.h"
#include "engine/shared/compensated_sum.h"

namespace locvol {
namespace {

static_assert(std::is_trivially_copyable_v<CellEdge> &&
              std::is_trivially_copyable_v<SurfaceCorner>);

// Puts what cells have of creases together, cell after cell.
class CreaseCollector {
 public:
  explicit CreaseCollector(std::size_t most) : most_(most) {}

  // From here on, edges' parts are numbered over all cells, from 1 on.
  void add(CellParts& cell) {
    if (is_too_many()) return;
    std::vector<bool> is_shared(cell.parts.size());
    for (const SharedEdge& edge : cell.shared) is_shared[edge.part - 1] = true;
    num_whole_ += static_cast<std::size_t>(std::ranges::count(is_shared, false));
    const std::uint32_t first = num_parts_;
    for (const CreasePart& part : cell.parts) num_parts_ = joiner_.add_part(part) + 1;
    for (const auto& [name, part, is_last] : cell.shared)
      joiner_.join(name, first + part - 1, false, is_last);
    for (CellEdge& edge : cell.creases.edges)
      if (edge.edge.crease != kNoPart) edge.edge.crease += first;
    corners_.insert(corners_.end(), cell.owned.begin(), cell.owned.end());
  }

  // Of all processes.
  CreasePieces take(const IngestShare& share) && {
    CreasePieces pieces;
    pieces.is_too_many = is_too_many();
    pieces.corners = std::move(corners_);
    std::vector<std::uint32_t> numbers;
    pieces.joined = joiner_.take(numbers);
    pieces.places.resize(pieces.joined.components.size());
    std::iota(pieces.places.begin(), pieces.places.end(), std::uint32_t{0});
    share.join_creases(pieces);
    if (pieces.is_too_many) return pieces;
    for (std::uint32_t& number : numbers) number = pieces.places[number];
    pieces.places = std::move(numbers);
    return pieces;
  }

 private:
  // What is counted is in no other cell: so whoever sees too many has a part of too many.
  bool is_too_many() const { return num_whole_ > most_ || corners_.size() > most_; }

  std::size_t most_, num_whole_ = 0;  // parts that no other cell has
  PartJoiner<CreasePart> joiner_;
  std::uint32_t num_parts_ = 0;
  std::vector<SurfaceCorner> corners_;
};

// All edges that may be part of creases go to `cells`. Returns their parts' pieces.
CreasePieces find_edges(const CheckedSurface& surface, const CreaseLaw& law, IngestWatch& watch,
                        Workers& workers, const IngestShare& share, CreasesOfCells& cells) {
  const SharpAngle angle(law.sharp_angle, surface.first_over_hole);
  const NeedleNormals needles(surface.sharp.needles);
  CreaseCollector collector(law.most);
  std::size_t bucket = 0;
  for_each_in_order(
      workers, surface.buckets.all(),
      [&](const TriangleBucket& b) {
        return std::tuple(surface.load(b), surface.pieces_of(b), surface.given_in(b));
      },
      [&](const TriangleBucket& b, auto loaded) {
        throw_if_stopped(watch.stop());
        auto& [triangles, pieces, given] = loaded;
        return edges_of_cell(std::move(triangles), pieces, b.cell, surface.buckets, angle, needles,
                             given, surface.has_contacts, law.least_extent);
      },
      [&](const TriangleBucket& b, CellParts& cell) {
        collector.add(cell);
        cells.put(bucket++, cell.creases);
        watch.advance(b.triangles.count);
      });
  return std::move(collector).take(share);
}

// Of these, all that are no noise become chains.
CreasePieces find_chains(const CheckedSurface& surface, const CreasePieces& pieces,
                         const CreaseLaw& law, IngestWatch& watch, Workers& workers,
                         const IngestShare& share, CreasesOfCells& cells) {
  const auto is_noise = [&](const CellEdge& edge) {
    if (edge.edge.crease == kNoPart) return false;
    const std::uint32_t component = pieces.places[edge.edge.crease - 1];
    return pieces.joined.components[component].is_noise(law.least_extent);
  };
  CreaseCollector collector(law.most);
  std::size_t loaded = 0, bucket = 0;
  for_each_in_order(
      workers, surface.buckets.all(), [&](const TriangleBucket&) { return cells.load(loaded++); },
      [&](const TriangleBucket& b, CellCreases creases) {
        throw_if_stopped(watch.stop());
        std::erase_if(creases.edges, is_noise);
        return chains_of_cell(std::move(creases), b.cell, surface.buckets);
      },
      [&](const TriangleBucket&, CellParts& cell) {
        collector.add(cell);
        cells.put(bucket++, cell.creases);
      });
  return std::move(collector).take(share);
}

// How far creases are from each other on average, if that is too close. Those that are given alone
// are kept however close they are.
std::optional<double> distance_below(const CreaseLaw& law, double area,
                                     const CreasePieces& chains) {
  CompensatedSum length;
  for (const CreasePart& crease : chains.joined.components) length.add(crease.length);
  if (!(law.sharp_angle > 0) || !(length.value() * law.least_distance > area)) return std::nullopt;
  return area / length.value();
}

CreaseFacts facts_of(const CreasePart& crease, std::span<const SurfaceCorner> corners) {
  CreaseFacts facts{.num_edges = crease.num_edges,
                    .length = crease.length.value(),
                    .corners = {},
                    .sheets = crease.sheets};
  if (crease.corners[0] == kNoName) return facts;
  for (std::size_t end = 0; end < 2; ++end)
    facts.corners[end] = static_cast<std::uint32_t>(
        1 + std::ranges::lower_bound(corners, crease.corners[end], {}, &SurfaceCorner::name) -
        corners.begin());
  std::ranges::sort(facts.corners);
  return facts;
}

// In the order of their first edges, and corners in that of their names.
void number_creases(CreasePieces pieces, CreasesOfCells& cells, SurfaceSheets& sheets) {
  std::ranges::sort(pieces.corners, {}, &SurfaceCorner::name);
  const std::vector<CreasePart>& creases = pieces.joined.components;
  std::vector<std::uint32_t> order(creases.size());
  std::iota(order.begin(), order.end(), std::uint32_t{0});
  std::ranges::sort(order, {}, [&](std::uint32_t c) { return creases[c].first_edge; });
  std::vector<CreaseId> ids(creases.size());
  for (const std::uint32_t crease : order) {
    sheets.creases.push_back(facts_of(creases[crease], pieces.corners));
    ids[crease] = static_cast<CreaseId>(sheets.creases.size());
  }
  sheets.num_corners = pieces.corners.size();
  std::vector<CreaseId> of_part;
  for (const std::uint32_t place : pieces.places) of_part.push_back(ids[place]);
  cells.number(std::move(of_part), sheets.creases, std::move(pieces.corners));
}

}  // namespace

void CreasesOfCells::put(std::size_t bucket, const CellCreases& creases) {
  if (bucket >= places_.size()) {
    places_.resize(bucket + 1);
    places_[bucket].offset = size_;
    size_ += std::span(creases.edges).size_bytes() + std::span(creases.corners).size_bytes();
    // Each end may yet turn out to be a corner.
    size_ += 2 * creases.edges.size() * sizeof(SurfaceCorner);
  }
  Place& place = places_[bucket];
  place.num_edges = creases.edges.size();
  place.num_corners = creases.corners.size();
  if (place.num_edges + place.num_corners == 0) return;
  if (!file_) file_.emplace(OpenFile::temporary(directory_ / "locvol-creases"));
  const auto edges = std::as_bytes(std::span(creases.edges));
  file_->write_at(place.offset, edges);
  file_->write_at(place.offset + edges.size(), std::as_bytes(std::span(creases.corners)));
}

CellCreases CreasesOfCells::load(std::size_t bucket) const {
  CellCreases creases;
  if (bucket >= places_.size()) return creases;
  const Place& place = places_[bucket];
  creases.edges.resize(place.num_edges);
  creases.corners.resize(place.num_corners);
  if (place.num_edges + place.num_corners == 0) return creases;
  const auto edges = std::as_writable_bytes(std::span(creases.edges));
  file_->read_at(place.offset, edges);
  file_->read_at(place.offset + edges.size(), std::as_writable_bytes(std::span(creases.corners)));
  return creases;
}

void CreasesOfCells::number(std::vector<CreaseId> of_part, std::vector<CreaseFacts> facts,
                            std::vector<SurfaceCorner> corners) {
  of_part_ = std::move(of_part);
  facts_ = std::move(facts);
  corners_ = std::move(corners);
}

void CreasesOfCells::add_to(std::size_t bucket, LeafSurface& surface) const {
  CellCreases creases = load(bucket);
  for (CellEdge& cell_edge : creases.edges) {
    CreaseEdge& edge = surface.creases.emplace_back(cell_edge.edge);
    edge.crease = of_part_[edge.crease - 1];
    const auto& ends = facts_[edge.crease - 1].corners;
    for (std::size_t end = 0; end < 2; ++end)
      edge.is_corner[end] = std::ranges::any_of(ends, [&](std::uint32_t corner) {
        return corner > 0 && corners_[corner - 1].position == edge.ends[end];
      });
  }
  std::ranges::sort(surface.creases, {}, &CreaseEdge::ends);
  for (const auto& [name, position] : creases.corners) {
    const auto place = std::ranges::lower_bound(corners_, name, {}, &SurfaceCorner::name);
    surface.corners.push_back(
        {position, static_cast<std::uint32_t>(1 + (place - corners_.begin()))});
  }
  std::ranges::sort(surface.corners, {}, &CornerPoint::corner);
}

CreasesOfCells find_creases(CheckedSurface& surface, const CreaseLaw& law, IngestWatch& watch,
                            Workers& workers, const IngestShare& share, SurfaceSheets& sheets) {
  CreasesOfCells cells(surface.spill.directory());
  const bool has_given = surface.given.is_given() || surface.has_contacts;
  const bool is_smooth =
      surface.sharp.num_edges == 0 && surface.sharp.num_pointed == 0 && sheets.sheets.size() < 2;
  if (!has_given && (!(law.sharp_angle > 0) || is_smooth)) return cells;
  const CreasePieces edges = find_edges(surface, law, watch, workers, share, cells);
  CreasePieces chains{.joined = {}, .places = {}, .corners = {}, .is_too_many = true};
  if (!edges.is_too_many) chains = find_chains(surface, edges, law, watch, workers, share, cells);
  const std::optional<double> distance = distance_below(law, surface.facts.area, chains);
  if (chains.is_too_many || chains.joined.components.size() > law.most ||
      chains.corners.size() > law.most || distance) {
    if (has_given && !(law.sharp_angle > 0))
      share.refuse(
          surface.given.is_given()
              ? fmt::format("{}: makes more than {} creases or corners of the surface: give less",
                            surface.given.name(), law.most)
              : fmt::format("{}: its bodies meet in more than {} creases or corners; unite some",
                            surface.facts.file, law.most));
    const char* const kept = surface.given.is_given() ? " but those that are given"
                             : has_given              ? " but those where bodies meet"
                                                      : "";
    surface.facts.notes.push_back(
        distance
            ? fmt::format("took no creases{}, for they are {:.3g} apart on average, too close for "
                          "this size: "
                          "one below {:.3g} keeps them",
                          kept, *distance, *distance / kLeastCreaseDistance)
            : fmt::format("took no creases{}, for there would be more than {}", kept, law.most));
    CreaseLaw of_given = law;
    of_given.sharp_angle = 0;
    return has_given ? find_creases(surface, of_given, watch, workers, share, sheets)
                     : CreasesOfCells(surface.spill.directory());
  }
  number_creases(std::move(chains), cells, sheets);
  return cells;
}

}  // namespace locvol
