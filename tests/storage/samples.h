// Records to test with: fixed ones, one of each kind, and random ones.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "octree/morton_key.h"
#include "octree/octree.h"
#include "octree/sort_and_unite.h"
#include "storage/codec.h"
#include "storage/records.h"

namespace locvol::testing_samples {

inline MortonKey sample_leaf() { return MortonKey::from_bits(0x0123456789abc000); }

inline RunRecord sample_run() {
  RunRecord run;
  run.parameters = {"00ff17", 0.125, 2.0, 15, 0.02, 20000, Initialization::kPaper, 42, 0.2, 8};
  run.parameters.shapes = {{ShapeKind::kBall, 0.01, {1, 2, 3}, {}, 0.5},
                           {ShapeKind::kBox, 0.02, {0, 0, 0}, {1, 2, 3}}};
  run.parameters.per_circle = 24, run.parameters.deviation = 0.01, run.parameters.layers = 3;
  run.parameters.min_size = 0.003;
  run.parameters.size_image = "00ff", run.parameters.image_least = 0.05;
  run.parameters.weld = 1e-6;
  run.parameters.sharp_angle = 40;
  run.parameters.sharp_polylines = "0f0f", run.sharp_file = "given.polylines.txt";
  run.parameters.sheet_sizes = {{"inlet", 0.01}, {"Wand 2", 0.25}};
  run.parameters.body_sizes = {{"Läufer", 0.02}};
  run.surface.file = "modèle.stl";
  run.surface.num_vertices = 10002;
  run.surface.num_triangles = 20000;
  run.surface.num_components = 2;
  run.surface.euler_characteristic = -2816;
  run.surface.area = 12.5;
  run.surface.volume = 1.0 / 3;
  run.surface.box = {{-1, -2, -3}, {4, 5, 6.5}};
  run.surface.notes = {"merged 3 vertices", ""};
  run.parameters.has_bodies = true;
  run.parameters.voids = {"Loch", ""};
  run.parameters.gap = 0.001;
  run.parameters.inside = InsideRule::kWrap;
  run.parameters.wrap_alpha = 0.3, run.parameters.wrap_offset = 0.01;
  run.parameters.is_surface_only = true;
  run.surface.more_files = {"b.stl"};
  run.surface.facing = {1024, {{-107, 3, 0, 0, 1}, {-106, 700, 2, 0, 0}, {64, 0, 0, 5, 0}}};
  run.frame = Frame({-1.5, -2.5, -3.5}, 0x1p-17);
  run.phase = Phase::kRefine;
  run.epoch = 3;
  run.next_point_id = 123456789012;
  run.counts.num_visits = 77;
  run.sizes = {1.5e6, 2.5e4, 6e5, 5e5};
  run.image_file = "field.vti";
  run.has_creases = true;
  return run;
}

inline LeafInfo sample_info() {
  LeafInfo info;
  info.center = DomainState::in(DomainState::kMostBody);
  info.num_visits = 2;
  info.num_points = 1000;
  info.num_cells = 4000;
  info.num_triangles = 300;
  info.num_insertions = {1, 2, 3, 4, 5, 6, 7};
  info.num_deletions = 9;
  info.num_moves = 8;
  info.num_unresolved = 1;
  info.queued = QueuePosition{3, 5};
  info.first_new_id = 4711;
  info.num_core_points = 120;
  info.num_core_cells = 512;
  info.num_left_out = 17;
  info.least_size = 0.25;
  info.largest_size = 3;
  info.surface_size = 2;
  info.reached_size = 4;
  info.holding = Holding::kCopy;
  info.ranks = {1, 3};
  return info;
}

inline LeafPoints sample_points() {
  return {{{5, {0.1, -0.0, 1e300}, PointKind::kSurface},
           {6, {0.1, 5e-324, -1}, PointKind::kVolume},
           {std::uint64_t{1} << 40, {1.0 / 3, 2, 3}, PointKind::kLattice},
           {std::uint64_t{1} << 41, {1.0 / 3, 2, 4}, PointKind::kInserted}},
          {.is_whole = false,
           .rows = {{{-3, 5, -7}, 4}, {{-3, 5, 9}, 1, 2}, {{0, -2, 0}, 300, 1u << 31}}}};
}

inline LeafCells sample_cells() {
  return {{3, 8, 9, std::uint64_t{1} << 63, ~std::uint64_t{0}},
          {{{0, 1, 2, 3}}, {{4, 2, 1, 3}}},
          {{0.5, -0.0, 3}},
          {1u << 31, 2}};
}

inline LeafFacets sample_facets() {
  return {{3, 8, 9, std::uint64_t{1} << 63, ~std::uint64_t{0}},
          {{{0, 1, 2}, {}}, {{1, 4, 2}, {7, 0, 3}}, {{1, 4, 3}, {7, 2, 1u << 31}}}};
}

inline LeafSurface sample_surface() {
  const Point a{0, 0, 0}, b{1, 0, -0.0}, c{0, 1, 0.1}, d{1, 1, 7};
  return {{{2, {a, b, c}},
           {3, {b, d, c}, 7, DomainState::between(2, 1)},
           {90, {a, a, d}, 1u << 31, DomainState::in(DomainState::kMostBody)}},
          {{{a, c}, {true, false}, {1, 7}, 3}, {{c, b}, {false, false}, {2, 2}, 1u << 31}},
          {{a, 4}, {d, 1u << 31}}};
}

inline SurfaceSheets sample_sheets() {
  return {{{"Einlaß",
            "Einlaß",
            0,
            12,
            1.0 / 3,
            {1, 2, 3},
            {{0, 0, -1}, {1, 1, 9}},
            {2, 1},
            Color{255, 0, 7}},
           {"sheet 2", "", 7, 1, 1e-9, {0, -0.0, 3}, {{}, {}}}},
          {{4, 1.5, {1, 3}, {1, 2}}, {1, -0.0, {}, {2, 1u << 31}}},
          3,
          {{"Gehäuse", 12, 2, 1.0 / 3, 0}, {"", 1, 1, -0.0, 1}},
          {0, 2}};
}

inline LeafUnresolved sample_unresolved() {
  return {{{3, {1, 2, 3}, 0.5}, {6, {-1, 0.1, 3}, 1e-9}}};
}

inline LeafSizes sample_sizes() {
  const MortonKey node = MortonKey::root().child(5);
  return {{{node.child(0), {-1, 0.5F, 1e-30F, 3, 4, 5, 6, 7}, 0.125F, {0, 0, 0.25F, 3}},
           {node.child(3).child(1), {-0.0F, 1, 2, 3, 4, 5, 6, 1e30F}, 0, {}}},
          {{node.child(0).child(7), 0.25F}, {node, 0.5F}}};
}

inline MemoryRecord sample_memory() {
  return {512 << 20, 20 << 20, 100000, 64 << 20, 90 << 20, 300 << 20, 480 << 20};
}

inline RankRecord sample_rank() {
  RankRecord record;
  record.first = {MortonKey::root().range_min(), sample_leaf().range_min()};
  record.rank = 1;
  record.superstep = 42;
  record.applied = QueuePosition{3, 1};
  record.is_all_sent = true, record.num_sent = 17;
  record.next_id = 1000, record.end_id = 1234;
  record.num_moves = 2, record.moved_at = Phase::kCover, record.stage = 1;
  return record;
}

inline TimelineRecord sample_timeline() {
  TimelineSample first{.milliseconds = 1200,
                       .started = 1700000000,
                       .num_threads = 2,
                       .memory_cap = 512 << 20,
                       .resident = 40 << 20,
                       .phase = Phase::kCover,
                       .num_leaves = 64,
                       .num_queued = 30,
                       .counts = {.num_visits = 5,
                                  .num_points = 1000,
                                  .num_insertions = {},
                                  .num_deletions = 3,
                                  .num_moves = 4}};
  TimelineSample last = first;
  last.milliseconds = 65000;
  last.sitting = 1;
  last.phase = Phase::kDone;
  last.resident = 30 << 20;
  last.epoch = 2;
  last.counts.num_cells = 123456;
  last.counts.num_unresolved = 1;
  last.counts.num_insertions = {1, 2, 3, 4, 5, 6, 7};
  return {{first, last}};
}

inline QueueEntry sample_queue_entry() { return {{3, 5}, sample_leaf()}; }

// Random records; a Generator gives the same ones for the same seed.
class Generator {
 public:
  explicit Generator(std::uint64_t seed) : random_(seed) {}

  std::uint64_t integer(std::uint64_t below) { return random_() % below; }
  std::uint64_t bits() { return random_() >> integer(64); }
  double real() { return std::uniform_real_distribution<double>(-10, 10)(random_); }
  Point point() { return {real(), real(), real()}; }
  Box box() { return Box::around(point()).joined(point()); }
  std::string text() {
    std::string text(integer(40), '\0');
    for (char& c : text) c = static_cast<char>(integer(256));
    return text;
  }

  MortonKey leaf() {
    const auto cell = [this] { return static_cast<std::uint32_t>(integer(1u << 21)); };
    return MortonKey::containing({cell(), cell(), cell()}, static_cast<int>(integer(22)));
  }

  QueuePosition position() {
    return {static_cast<std::uint32_t>(integer(4)), static_cast<std::uint32_t>(integer(9))};
  }
  QueueEntry queue_entry() { return {position(), leaf()}; }

  LeafInfo info() {
    LeafInfo info;
    info.center = DomainState::in(static_cast<BodyId>(integer(3)));
    info.num_visits = static_cast<std::uint32_t>(bits());
    info.num_points = bits();
    info.num_cells = bits();
    info.num_triangles = bits();
    for (auto& count : info.num_insertions) count = bits();
    info.num_deletions = bits();
    info.num_moves = bits();
    info.num_unresolved = bits();
    if (integer(2) != 0) info.queued = position();
    info.first_new_id = bits();
    info.num_core_points = bits();
    info.num_core_cells = bits();
    info.num_left_out = bits();
    return info;
  }

  RunRecord run() {
    RunRecord run = sample_run();
    run.parameters = {text(), real(), real(), real(), real(), bits(), Initialization::kCover,
                      bits()};
    run.parameters.shapes.resize(integer(5));
    for (SizeShape& shape : run.parameters.shapes)
      shape = {static_cast<ShapeKind>(integer(3)), 0.01 + std::abs(real()), point(), point(),
               std::abs(real())};
    run.parameters.per_circle = real(), run.parameters.deviation = real();
    run.parameters.layers = real(), run.parameters.min_size = real();
    if (integer(2) == 0) run.parameters.weld = std::abs(real());
    run.surface.file = text();
    run.surface.facing.num_places = bits();
    run.surface.facing.places.resize(integer(5));
    for (std::int32_t step = -99; FacingPlaces & places : run.surface.facing.places)
      places = {step += 1 + static_cast<std::int32_t>(integer(50)),
                static_cast<std::uint32_t>(integer(9)), 1, 2, 3};
    run.surface.notes.resize(integer(5));
    for (std::string& note : run.surface.notes) note = text();
    run.surface.box = box();
    run.surface.euler_characteristic = -static_cast<std::int64_t>(integer(1000));
    run.phase = static_cast<Phase>(integer(7));
    return run;
  }

  TimelineRecord timeline(std::size_t count) {
    TimelineRecord record;
    for (std::size_t i = 0; i < count; ++i) {
      TimelineSample sample{.milliseconds = bits(),
                            .sitting = bits(),
                            .started = bits(),
                            .num_threads = bits(),
                            .memory_cap = bits(),
                            .resident = bits(),
                            .phase = static_cast<Phase>(integer(7)),
                            .epoch = bits(),
                            .num_leaves = bits(),
                            .num_queued = bits(),
                            .counts = {.num_visits = bits(),
                                       .num_points = bits(),
                                       .num_cells = bits(),
                                       .num_unresolved = bits(),
                                       .num_insertions = {},
                                       .num_deletions = bits(),
                                       .num_moves = bits()}};
      for (auto& number : sample.counts.num_insertions) number = bits();
      record.samples.push_back(sample);
    }
    return record;
  }

  LeafPoints points(std::size_t count) {
    LeafPoints record;
    std::uint64_t id = 0;
    for (std::size_t i = 0; i < count; ++i)
      record.points.push_back({id += 1 + integer(3), point(), static_cast<PointKind>(integer(3))});
    record.core = core(integer(count + 1));
    return record;
  }

  // What a codec may meet: the rows need not be those of any leaf.
  LatticeCore core(std::size_t num_rows) {
    const bool has_bodies = integer(2) == 0;
    const auto body = [&] { return has_bodies ? static_cast<BodyId>(1 + integer(3)) : kOnlyBody; };
    if (integer(8) == 0) return {.is_whole = true, .rows = {}, .body = body()};
    LatticeCore core;
    const auto index = [this] { return static_cast<std::int32_t>(bits()); };
    for (std::size_t n = 0; n < num_rows; ++n)
      core.rows.push_back(
          {{index(), index(), index()}, static_cast<std::uint32_t>(bits()), body()});
    return core;
  }

  LeafCells cells(std::size_t count) {
    LeafCells record;
    std::uint64_t id = 0;
    for (std::size_t i = 0; i < 4 + count / 3; ++i) record.vertices.push_back(id += 1 + integer(9));
    const auto vertex = [&] { return static_cast<std::uint32_t>(integer(record.vertices.size())); };
    for (std::size_t i = 0; i < count; ++i)
      record.cells.push_back({vertex(), vertex(), vertex(), vertex()});
    for (std::size_t i = 0; i < integer(3); ++i) record.asked.push_back(point());
    if (integer(2) == 0)
      for (std::size_t i = 0; i < count; ++i)
        record.bodies.push_back(static_cast<BodyId>(1 + integer(3)));
    return record;
  }

  LeafFacets facets(std::size_t count) {
    const LeafCells some = cells(count);
    LeafFacets record{some.vertices, {}};
    for (const auto& [a, b, c, d] : some.cells)
      record.facets.push_back({{a, b, c}, {static_cast<BodyId>(integer(3)), d, 1}});
    return record;
  }

  LeafSurface surface(std::size_t count) {
    std::vector<Point> corners(3 + count / 2);
    for (Point& corner : corners) corner = point();
    const auto corner = [&] { return corners[integer(corners.size())]; };
    LeafSurface record;
    std::uint64_t id = 0;
    for (std::size_t i = 0; i < count; ++i)
      record.triangles.push_back({id += 1 + integer(5),
                                  {corner(), corner(), corner()},
                                  1,
                                  DomainState::in(static_cast<BodyId>(1 + integer(2)))});
    for (std::size_t i = 0; i < count / 3; ++i) {
      const Point a = corner(), b = corner();
      const std::uint32_t crease = 1 + static_cast<std::uint32_t>(integer(count));
      if (a != b) record.creases.push_back({{std::min(a, b), std::max(a, b)}, {}, {1, 2}, crease});
    }
    sort_and_unite(record.creases, &CreaseEdge::ends);
    for (std::uint32_t i = 1; i <= count / 20; ++i) record.corners.push_back({corner(), i});
    return record;
  }

  LeafSizes sizes(std::size_t count) {  // less than 8^5
    LeafSizes record;
    const LinearOctree octree = LinearOctree::uniform(5);
    for (std::size_t i = 0; i < count; ++i) {
      SizeCube& cube = record.cubes.emplace_back();
      cube.key = octree.leaves()[i];
      for (float& d : cube.distance) d = static_cast<float>(real());
      cube.excess = static_cast<float>(real());
      for (float& less : cube.less) less = integer(2) == 0 ? 0 : static_cast<float>(real());
      if (integer(2) == 0)
        record.nodes.push_back({cube.key, 0.01F + std::abs(static_cast<float>(real()))});
    }
    return record;
  }
  LeafUnresolved unresolved(std::size_t count) {
    LeafUnresolved record;
    for (std::size_t i = 0; i < count; ++i)
      record.sites.push_back({static_cast<std::uint8_t>(1 + integer(6)), point(), real()});
    return record;
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace locvol::testing_samples
