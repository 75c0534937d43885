#include "engine/ingest/body_cuts.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <utility>

#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "engine/shared/sorted_spill.h"
#include "octree/disjoint_sets.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/cut_triangle.h"
#include "refine/domain/exact_predicates.h"
#include "refine/domain/self_intersection.h"

namespace locvol {
namespace {

// A triangle, and one of another body that meets it. Each cell that has both may tell.
struct Cutter {
  std::uint64_t triangle = 0, id = 0;
  std::array<Point, 3> corners;
  std::uint32_t body = 0;
  std::pair<std::uint64_t, std::uint64_t> key() const { return {triangle, id}; }
};
using Cutters = SortedSpill<Cutter, &Cutter::key>;
using Triangles = SortedSpill<Triangle, &Triangle::id>;

struct CellMeetings {
  std::vector<Triangle> owned;
  std::vector<Cutter> cutters;
  std::vector<MeetingBodies> parts;  // of one body: they are closed together alone
};

class MeetingsOfCell {
 public:
  MeetingsOfCell(std::vector<Triangle> triangles, const Box& box,
                 std::span<const std::uint32_t> given, const NearLaw& near, const StopToken* stop)
      : triangles_(std::move(triangles)),
        box_(box),
        given_(given),
        near_(near),
        stop_(stop),
        soup_(soup_of(triangles_)) {}

  CellMeetings run() && {
    throw_if_stopped(stop_);
    find_parts();
    if (near_.distance > 0)
      find_near();
    else
      find_cutters();
    std::ranges::copy_if(triangles_, std::back_inserter(found_.owned),
                         [&](const Triangle& t) { return owns_triangle(box_, t); });
    return std::move(found_);
  }

 private:
  std::uint32_t body_of(std::uint32_t t) const { return given_body(given_, triangles_[t]); }

  void find_parts() {
    const auto body_at = [&](std::uint32_t h) { return body_of(h / 3); };
    std::vector<std::uint32_t> of_body;
    EdgeTable(soup_.vertices.size(), soup_.triangles)
        .for_each_edge([&](std::span<const std::uint32_t> uses) {
          if (!TriangleBuckets::meets_edge(box_, soup_.vertices[origin(soup_.triangles, uses[0])],
                                           soup_.vertices[target(soup_.triangles, uses[0])]))
            return;
          for_each_body_at(uses, body_at, of_body, [&](std::span<const std::uint32_t> own) {
            for (const std::uint32_t h : own)
              if (body_at(h) != body_at(own[0]))
                found_.parts.push_back(
                    {std::min(body_at(h), body_at(own[0])), std::max(body_at(h), body_at(own[0]))});
          });
        });
    sort_and_unite(found_.parts);
  }

  void find_cutters() {
    const TriangleTree tree(soup_.vertices, soup_.triangles, box_);
    for_each_intersection(
        soup_.vertices, soup_.triangles, tree,
        [&](std::uint32_t s, std::uint32_t t) { return body_of(s) != body_of(t); },
        [&](std::uint32_t s, std::uint32_t t) {
          add_cutter(s, t);
          add_cutter(t, s);
        },
        stop_);
  }

  void find_near() {
    const double distance = near_.distance;
    const TriangleTree tree(soup_.vertices, soup_.triangles, box_.expanded(distance), distance);
    std::vector<bool> is_needle(triangles_.size());
    for (std::size_t t = 0; near_.has_needles && t < is_needle.size(); ++t)
      is_needle[t] = height_of(triangles_[t].corners) < distance;
    StopPoll poll(stop_);
    tree.for_each_pair(
        std::numeric_limits<std::uint32_t>::max(), [&](std::uint32_t s, std::uint32_t t) {
          poll();
          for (const auto& [of, by] : {std::pair(s, t), {t, s}})
            if ((body_of(s) != body_of(t) || is_needle[by]) &&
                leaves_print(triangles_[of].corners, triangles_[by].corners, distance))
              add_cutter(of, by);
        });
  }

  void add_cutter(std::uint32_t of, std::uint32_t by) {
    found_.cutters.push_back(
        {triangles_[of].id, triangles_[by].id, triangles_[by].corners, body_of(by)});
  }

  std::vector<Triangle> triangles_;
  Box box_;
  std::span<const std::uint32_t> given_;
  NearLaw near_;
  const StopToken* stop_;
  TriangleSoup soup_;
  CellMeetings found_;
};

// How far `other` is from the plane of a triangle that it lies on, but for less than `least`;
// nothing: it lies in that plane, or beside the triangle, or not on it.
std::optional<double> distance_of_near(const std::array<Point, 3>& triangle,
                                       const std::array<Point, 3>& other, double least) {
  constexpr double kBroad = 1000;  // times that: how far they are to overlap
  const auto& [a, b, c] = triangle;
  const Point across = cross(b - a, c - a);
  const double length = norm(across);
  double distance = 0;
  for (const Point& p : other) distance = std::max(distance, std::abs(dot(across, p - a)) / length);
  if (distance > least ||
      std::ranges::all_of(other, [&](const Point& p) { return orientation(a, b, c, p) == 0; }))
    return std::nullopt;
  for (const auto& corners : {triangle, other})
    for (std::size_t k = 0; k < 3; ++k) {
      const Point axis = cross(across, corners[(k + 1) % 3] - corners[k]);
      const auto reach = [&](const std::array<Point, 3>& of) {
        const auto [low, high] =
            std::minmax({dot(axis, of[0] - a), dot(axis, of[1] - a), dot(axis, of[2] - a)});
        return std::pair(low, high);
      };
      const auto [low, high] = reach(triangle);
      const auto [others_low, others_high] = reach(other);
      if (std::min(high, others_high) - std::max(low, others_low) < kBroad * least * norm(axis))
        return std::nullopt;
    }
  return distance;
}

// A triangle, and all that it is cut along.
struct MetTriangle {
  Triangle triangle;
  std::uint32_t body = 0;
  std::vector<std::array<Point, 3>> cutters = {};
  std::vector<std::uint32_t> bodies = {};  // of these
  std::uint64_t num_cutters = 0;           // of which there are kMostCutters at most here

  bool is_cut_into(const TrianglePieces& pieces) const {
    return pieces.corners.size() != 1 || pieces.num_collapsed > 0;
  }

  std::optional<CutObstacle> obstacle(const TrianglePieces& pieces, const NearLaw& near,
                                      double least) const {
    CutObstacle obstacle{.triangle = triangle, .num_cutters = num_cutters};
    if (num_cutters > kMostCutters) return obstacle;
    if (near.distance > 0) return std::nullopt;
    obstacle.kind = CutObstacle::Kind::kThin;
    for (std::size_t i = 0; i < cutters.size(); ++i)
      if (const auto distance = distance_of_near(triangle.corners, cutters[i], least)) {
        obstacle.other = bodies[i];
        obstacle.width = *distance;
        return obstacle;
      }
    if (!is_cut_into(pieces)) return std::nullopt;
    obstacle.other = bodies.front();
    if (pieces.num_collapsed > 0) return obstacle;
    for (const auto& corners : pieces.corners)
      if (const double height = height_of(corners); height < least) {
        obstacle.triangle.corners = corners;
        obstacle.width = height;
        return obstacle;
      }
    return std::nullopt;
  }

  // The smallest new vertex that is on the other body, but for a distance.
  std::optional<Point> place(const TrianglePieces& pieces, std::uint32_t other,
                             double distance) const {
    const auto is_on_other = [&](const Point& p) {
      for (std::size_t i = 0; i < cutters.size(); ++i)
        if (bodies[i] == other &&
            squared_distance(p, closest_on_triangle(cutters[i], p)) <= distance * distance)
          return true;
      return false;
    };
    std::optional<Point> place;
    for_each_new_vertex(pieces, [&](const Point& p) {
      if ((!place || p < *place) && is_on_other(p)) place = p;
    });
    return place;
  }

  double widest(const TrianglePieces& pieces) const {
    double squared = 0;
    for_each_new_vertex(pieces, [&](const Point& p) {
      squared = std::max(squared, squared_distance(triangle, p));
    });
    return std::sqrt(squared);
  }

  template <class Visit>
  void for_each_new_vertex(const TrianglePieces& pieces, const Visit& visit) const {
    for (const auto& corners : pieces.corners)
      for (const Point& p : corners)
        if (std::ranges::find(triangle.corners, p) == triangle.corners.end()) visit(p);
  }
};

class BodyCutter {
 public:
  BodyCutter(TriangleSpill& spill, const TriangleBuckets& buckets, bool has_copies,
             std::span<const std::uint32_t> given, const Box& box, bool has_pieces,
             const NearLaw& near, IngestWatch& watch, Workers& workers)
      : spill_(spill),
        buckets_(buckets),
        has_copies_(has_copies),
        given_(given),
        least_width_(kLeastWidth * std::max(max_norm(box.min), max_norm(box.max))),
        has_pieces_(has_pieces),
        near_(near),
        watch_(watch),
        workers_(workers),
        parts_(*std::ranges::max_element(given) + std::size_t{1}),
        triangles_(spill.directory()),
        cutters_(spill.directory()) {}

  CutSurface run() {
    find_meetings();
    triangles_.finish();
    cutters_.finish();
    writer_.emplace(spill_, result_.triangles);
    workers_.run_in_order([&] { return next_task(); });
    writer_->flush();
    if (result_.num_cut > 0 && !result_.obstacle) return std::move(result_);
    spill_.release(std::move(result_.triangles));
    return {.obstacle = result_.obstacle};
  }

 private:
  void find_meetings() {
    for_each_in_order(
        workers_, buckets_.all(),
        [&](const TriangleBucket& bucket) {
          std::vector<Triangle> triangles = spill_.load(bucket.triangles);
          if (has_copies_) drop_copies(triangles, given_);
          return triangles;
        },
        [&](const TriangleBucket& bucket, std::vector<Triangle> triangles) {
          return MeetingsOfCell(std::move(triangles), buckets_.frame().box(bucket.cell), given_,
                                near_, watch_.stop())
              .run();
        },
        [&](const TriangleBucket& bucket, const CellMeetings& found) {
          for (const Triangle& triangle : found.owned) triangles_.append(triangle);
          for (const Cutter& cutter : found.cutters) cutters_.append(cutter);
          for (const auto& [one, other] : found.parts) parts_.unite(one, other);
          watch_.advance(bucket.triangles.count);
        });
  }

  struct Batch : Task {
    explicit Batch(BodyCutter& the_cutter) : cutter(the_cutter) {}
    void compute() override {
      for (const MetTriangle& met : triangles) {
        throw_if_stopped(cutter.watch_.stop());
        pieces.push_back(cutter.pieces_of(met));
        obstacles.push_back(met.obstacle(pieces.back(), cutter.near_, cutter.least_width_));
      }
    }
    void apply() override {
      for (std::size_t i = 0; i < triangles.size() && !cutter.result_.obstacle; ++i) {
        cutter.result_.obstacle = obstacles[i];
        cutter.add(triangles[i], pieces[i]);
      }
      cutter.watch_.advance(triangles.size());
    }

    BodyCutter& cutter;
    std::vector<MetTriangle> triangles;
    std::vector<TrianglePieces> pieces;
    std::vector<std::optional<CutObstacle>> obstacles;
  };

  std::unique_ptr<Task> next_task() {
    if (triangles_.is_empty() || result_.obstacle) return nullptr;
    auto batch = std::make_unique<Batch>(*this);
    std::size_t num_cutters = 0;
    while (!triangles_.is_empty() && num_cutters < kBatchCutters &&
           batch->triangles.size() < kBatchTriangles) {
      batch->triangles.push_back(next_triangle());
      num_cutters += batch->triangles.back().cutters.size();
    }
    return batch;
  }

  MetTriangle next_triangle() {
    MetTriangle met{.triangle = triangles_.front()};
    triangles_.pop();
    met.body = given_body(given_, met.triangle);
    std::uint64_t last = ~std::uint64_t{0};
    for (; !cutters_.is_empty() && cutters_.front().triangle == met.triangle.id; cutters_.pop()) {
      const Cutter& cutter = cutters_.front();
      if (cutter.id == std::exchange(last, cutter.id)) continue;  // another cell told, too
      // What lies across a needle's longest edge gets its third corner, for the needle goes.
      if (parts_.find(cutter.body) == parts_.find(met.body) && !is_needle(cutter.corners)) continue;
      if (++met.num_cutters > kMostCutters) continue;
      met.cutters.push_back(cutter.corners);
      met.bodies.push_back(cutter.body);
    }
    return met;
  }

  TrianglePieces pieces_of(const MetTriangle& met) const {
    const std::array<Point, 3>& corners = met.triangle.corners;
    const bool is_met = !met.cutters.empty() && met.num_cutters <= kMostCutters;
    if (near_.distance == 0)
      return is_met ? cut_triangle(corners, met.cutters) : TrianglePieces{{corners}};
    return is_met || is_needle(corners) ? imprinted_triangle(corners, met.cutters, near_.distance)
                                        : TrianglePieces{{corners}};
  }

  bool is_needle(const std::array<Point, 3>& corners) const {
    return near_.has_needles && height_of(corners) < near_.distance;
  }

  // Piece after piece of one triangle of the file is numbered.
  void add(const MetTriangle& met, const TrianglePieces& pieces) {
    Triangle piece = met.triangle;
    const std::uint64_t in_file = number_in_file(met.triangle.id, has_pieces_);
    if (in_file != std::exchange(last_in_file_, in_file)) num_pieces_ = 0;
    for (const auto& corners : pieces.corners) {
      if (num_pieces_ == kMostPieces) {
        result_.obstacle = {.triangle = met.triangle, .num_cutters = met.num_cutters};
        return;
      }
      piece.id = kMostPieces * in_file + num_pieces_++;
      piece.corners = corners;
      writer_->append(piece);
    }
    if (!met.is_cut_into(pieces)) return;
    ++result_.num_cut;
    if (near_.distance > 0) result_.widest = std::max(result_.widest, met.widest(pieces));
    std::vector<std::uint32_t> others = met.bodies;
    sort_and_unite(others);
    for (const std::uint32_t other : others) {
      if (parts_.find(other) == parts_.find(met.body)) continue;
      Meeting& meeting = result_.meetings[{std::min(met.body, other), std::max(met.body, other)}];
      ++meeting.num_cut[met.body < other ? 0 : 1];
      if (!meeting.place)
        meeting.place = met.place(pieces, other, std::max(near_.distance, least_width_));
    }
  }

  static constexpr std::size_t kBatchTriangles = 4000, kBatchCutters = 2000;

  TriangleSpill& spill_;
  const TriangleBuckets& buckets_;
  bool has_copies_;
  std::span<const std::uint32_t> given_;
  double least_width_;
  bool has_pieces_;
  NearLaw near_;
  IngestWatch& watch_;
  Workers& workers_;
  DisjointSets parts_;  // of bodies that are given
  Triangles triangles_;
  Cutters cutters_;
  std::optional<TriangleWriter> writer_;
  std::uint64_t last_in_file_ = std::numeric_limits<std::uint64_t>::max(), num_pieces_ = 0;
  CutSurface result_;
};

}  // namespace

CutSurface cut_bodies(TriangleSpill& spill, const TriangleBuckets& buckets, bool has_copies,
                      std::span<const std::uint32_t> given, const Box& box, bool has_pieces,
                      const NearLaw& near, IngestWatch& watch, Workers& workers) {
  return BodyCutter(spill, buckets, has_copies, given, box, has_pieces, near, watch, workers).run();
}

}  // namespace locvol
