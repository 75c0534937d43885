#include "engine/ingest/body_cuts.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "engine/ingest/surface_check.h"
#include "engine/ingest/surface_input.h"
#include "engine/ingest/surface_repair.h"
#include "engine/ingest/surface_topology.h"
#include "engine/ingest/triangle_soup.h"
#include "engine/shared/sorted_spill.h"
#include "octree/disjoint_sets.h"
#include "octree/sort_and_unite.h"
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
                 std::span<const std::uint32_t> given, const StopToken* stop)
      : triangles_(std::move(triangles)),
        box_(box),
        given_(given),
        stop_(stop),
        soup_(soup_of(triangles_)) {}

  CellMeetings run() && {
    throw_if_stopped(stop_);
    find_parts();
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
          for (const auto& [of, by] : {std::pair(s, t), {t, s}})
            found_.cutters.push_back(
                {triangles_[of].id, triangles_[by].id, triangles_[by].corners, body_of(by)});
        },
        stop_);
  }

  std::vector<Triangle> triangles_;
  Box box_;
  std::span<const std::uint32_t> given_;
  const StopToken* stop_;
  TriangleSoup soup_;
  CellMeetings found_;
};

// A triangle, and all that it is cut along.
struct MetTriangle {
  Triangle triangle;
  std::uint32_t body = 0;
  std::vector<std::array<Point, 3>> cutters;
  std::vector<std::uint32_t> bodies;  // of these; ascending

  Meeting meeting_along(const TrianglePieces& pieces, bool is_first) const {
    Meeting meeting;
    meeting.num_cut[is_first ? 0 : 1] = 1;
    for (const auto& corners : pieces.corners)
      for (const Point& p : corners)
        if (std::ranges::find(triangle.corners, p) == triangle.corners.end() &&
            (!meeting.place || p < *meeting.place))
          meeting.place = p;
    return meeting;
  }
};

class BodyCutter {
 public:
  BodyCutter(TriangleSpill& spill, const TriangleBuckets& buckets, bool has_copies,
             std::span<const std::uint32_t> given, bool has_pieces, IngestWatch& watch,
             Workers& workers)
      : spill_(spill),
        buckets_(buckets),
        has_copies_(has_copies),
        given_(given),
        has_pieces_(has_pieces),
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
    if (result_.num_cut > 0 && !result_.too_often) return std::move(result_);
    spill_.release(std::move(result_.triangles));
    CutSurface nothing;
    nothing.too_often = result_.too_often;
    nothing.num_cutters = result_.num_cutters;
    return nothing;
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
                                watch_.stop())
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
        pieces.push_back(met.cutters.empty() ? TrianglePieces{{met.triangle.corners}}
                                             : cut_triangle(met.triangle.corners, met.cutters));
      }
    }
    void apply() override {
      for (std::size_t i = 0; i < triangles.size(); ++i) cutter.add(triangles[i], pieces[i]);
      cutter.watch_.advance(triangles.size());
    }

    BodyCutter& cutter;
    std::vector<MetTriangle> triangles;
    std::vector<TrianglePieces> pieces;
  };

  std::unique_ptr<Task> next_task() {
    if (triangles_.is_empty() || result_.too_often) return nullptr;
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
    MetTriangle met;
    met.triangle = triangles_.front();
    triangles_.pop();
    met.body = given_body(given_, met.triangle);
    std::uint64_t num_cutters = 0, last = ~std::uint64_t{0};
    for (; !cutters_.is_empty() && cutters_.front().triangle == met.triangle.id; cutters_.pop()) {
      const Cutter& cutter = cutters_.front();
      if (cutter.id == std::exchange(last, cutter.id)) continue;  // another cell told, too
      if (parts_.find(cutter.body) == parts_.find(met.body)) continue;
      if (++num_cutters > kMostCutters) continue;
      met.cutters.push_back(cutter.corners);
      const auto place = std::ranges::lower_bound(met.bodies, cutter.body);
      if (place == met.bodies.end() || *place != cutter.body) met.bodies.insert(place, cutter.body);
    }
    if (num_cutters > kMostCutters && num_cutters > result_.num_cutters) {
      result_.too_often = met.triangle;
      result_.num_cutters = num_cutters;
      met.cutters.clear();
    }
    return met;
  }

  // Piece after piece of the same triangle of the file is numbered on.
  void add(const MetTriangle& met, const TrianglePieces& pieces) {
    const std::uint64_t in_file = number_in_file(met.triangle.id, has_pieces_);
    if (in_file != last_in_file_) num_pieces_ = 0;
    last_in_file_ = in_file;
    if (num_pieces_ + pieces.corners.size() > kMostPieces) {
      result_.too_often = met.triangle;
      result_.num_cutters = met.cutters.size();
      return;
    }
    result_.num_collapsed += pieces.num_collapsed;
    Triangle piece = met.triangle;
    for (const auto& corners : pieces.corners) {
      piece.id = in_file * kMostPieces + num_pieces_++;
      piece.corners = corners;
      if (result_.collinear.size() <= kMaxCollinear &&
          are_collinear(corners[0], corners[1], corners[2]))
        result_.collinear.push_back(piece);
      writer_->append(piece);
    }
    if (pieces.corners.size() == 1 && pieces.num_collapsed == 0) return;
    ++result_.num_cut;
    for (const std::uint32_t body : met.bodies)
      result_.meetings[{std::min(met.body, body), std::max(met.body, body)}].add(
          met.meeting_along(pieces, met.body < body));
  }

  static constexpr std::size_t kBatchTriangles = 4000, kBatchCutters = 2000;

  TriangleSpill& spill_;
  const TriangleBuckets& buckets_;
  bool has_copies_;
  std::span<const std::uint32_t> given_;
  bool has_pieces_;
  IngestWatch& watch_;
  Workers& workers_;
  DisjointSets parts_;  // of bodies that are given
  Triangles triangles_;
  Cutters cutters_;
  std::optional<TriangleWriter> writer_;
  std::uint64_t last_in_file_ = ~std::uint64_t{0}, num_pieces_ = 0;
  CutSurface result_;
};

}  // namespace

void Meeting::add(const Meeting& other) {
  for (std::size_t k = 0; k < 2; ++k) num_cut[k] += other.num_cut[k];
  if (!place) place = other.place;
}

CutSurface cut_bodies(TriangleSpill& spill, const TriangleBuckets& buckets, bool has_copies,
                      std::span<const std::uint32_t> given, bool has_pieces, IngestWatch& watch,
                      Workers& workers) {
  return BodyCutter(spill, buckets, has_copies, given, has_pieces, watch, workers).run();
}

}  // namespace locvol
