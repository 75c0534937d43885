#include "engine/ingest/polyline_edges.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <span>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "engine/ingest/polyline_file.h"
#include "engine/ingest/surface_text.h"
#include "engine/shared/input_error.h"
#include "engine/shared/number_text.h"
#include "engine/shared/sorted_spill.h"
#include "octree/sort_and_unite.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/closest_point.h"
#include "refine/domain/triangle_box.h"

namespace locvol {
namespace {

constexpr std::size_t kMostEdges = 100'000;  // of a piece
constexpr std::uint64_t kMostAsked = 10;  // for a triangle of a bucket, of which each takes three
constexpr std::uint64_t kNoId = std::numeric_limits<std::uint64_t>::max();

// Points and pieces of polylines have ids, in the order of the file; a piece leads from one point
// to the next.
struct PointAsked {
  std::uint64_t bucket = 0, id = 0;
  Point position;
  auto order() const { return std::tuple(bucket, id); }
};
struct VertexFound {
  std::uint64_t id = 0;  // of the point
  double squared = 0;    // distance from it
  Point position;
  auto order() const { return std::tuple(id, squared, position); }
};
struct Piece {
  std::uint64_t id = 0, line = 0;
  Point from, to;  // vertices
};
struct PieceAsked {
  std::uint64_t bucket = 0;
  Piece piece;
  auto order() const { return std::tuple(bucket, piece.id); }
};
struct EdgeFound {
  std::uint64_t id = 0;  // of the piece
  EdgeEnds ends;
  std::array<Point, 2> beyond;  // corners of its triangles
  auto order() const { return std::tuple(id, ends); }
};
struct EdgeInBucket {
  std::uint64_t bucket = 0;
  EdgeEnds ends;
  auto order() const { return std::tuple(bucket, ends); }
};

using PointsAsked = SortedSpill<PointAsked, &PointAsked::order>;
using VerticesFound = SortedSpill<VertexFound, &VertexFound::order>;
using Pieces = SortedSpill<Piece, &Piece::id>;
using PiecesAsked = SortedSpill<PieceAsked, &PieceAsked::order>;
using EdgesFound = SortedSpill<EdgeFound, &EdgeFound::order>;
using EdgesInBuckets = SortedSpill<EdgeInBucket, &EdgeInBucket::order>;

template <class Record>
std::string bytes_of(std::span<const Record> records) {
  static_assert(std::is_trivially_copyable_v<Record>);
  return {reinterpret_cast<const char*>(records.data()), records.size_bytes()};
}

// What all processes have said.
template <class Record>
std::vector<Record> records_in(const std::vector<std::string>& messages) {
  std::vector<Record> all;
  for (const std::string& message : messages) {
    const std::size_t num = all.size(), num_more = message.size() / sizeof(Record);
    all.resize(num + num_more);
    if (num_more > 0) std::memcpy(&all[num], message.data(), num_more * sizeof(Record));
  }
  return all;
}

// What all processes have found of points or pieces, id after id. All of them ask alike.
template <class Record>
class CommonRecords {
 public:
  CommonRecords(SortedSpill<Record, &Record::order>& own, const IngestShare& share)
      : own_(own), share_(share) {}

  // In order; of more than kMostEdges, one more. REQUIRES: an id above those before
  std::span<const Record> of(std::uint64_t id) {
    while (id >= end_) load();
    const auto [first, last] =
        std::ranges::equal_range(all_, id, {}, [](const Record& record) { return record.id; });
    return {first, last};
  }

 private:
  static constexpr std::size_t kBlock = 16'384;

  // The next ones of all, up to an id below which each process has told all of its own.
  void load() {
    std::size_t num_alike = 0;
    while (!own_.is_empty()) {
      const Record& next = own_.front();
      const bool is_alike = !waiting_.empty() && waiting_.back().id == next.id;
      if (waiting_.size() >= kBlock && !is_alike) break;
      num_alike = is_alike ? num_alike + 1 : 0;
      if (num_alike <= kMostEdges) waiting_.push_back(next);
      own_.pop();
    }
    const std::array<std::uint64_t, 1> end = {own_.is_empty() ? kNoId : own_.front().id};
    end_ = std::ranges::min(
        records_in<std::uint64_t>(share_.gather(bytes_of(std::span<const std::uint64_t>(end)))));
    const auto told = std::ranges::lower_bound(waiting_, end_, {}, &Record::id);
    all_ = records_in<Record>(
        share_.gather(bytes_of(std::span<const Record>(waiting_.begin(), told))));
    waiting_.erase(waiting_.begin(), told);
    std::ranges::sort(all_, {}, &Record::order);
  }

  SortedSpill<Record, &Record::order>& own_;
  const IngestShare& share_;
  std::vector<Record> waiting_, all_;
  std::uint64_t end_ = 0;
};

// Finds the vertex closest to a place, of some.
class VertexFinder {
 public:
  VertexFinder(std::vector<Point> vertices, double tolerance)
      : vertices_(std::move(vertices)), tolerance_(tolerance) {}  // REQUIRES: ascending

  std::optional<Point> closest_to(const Point& p) {
    if (std::ranges::binary_search(vertices_, p)) return p;
    if (cubes_.empty()) fill_cubes();
    const Cube low = cube_of(p - Point{tolerance_, tolerance_, tolerance_}),
               high = cube_of(p + Point{tolerance_, tolerance_, tolerance_});
    std::optional<Point> closest;
    double least = tolerance_ * tolerance_;
    for (std::int64_t x = low[0]; x <= high[0]; ++x)
      for (std::int64_t y = low[1]; y <= high[1]; ++y)
        for (std::int64_t z = low[2]; z <= high[2]; ++z)
          for (const auto& [cube, v] :
               std::ranges::equal_range(cubes_, Cube{x, y, z}, {}, &InCube::first)) {
            const double squared = squared_distance(p, vertices_[v]);
            if (squared > least || (squared == least && closest && *closest < vertices_[v]))
              continue;
            least = squared;
            closest = vertices_[v];
          }
    return closest;
  }

 private:
  using Cube = std::array<std::int64_t, 3>;
  using InCube = std::pair<Cube, std::uint32_t>;

  Cube cube_of(const Point& p) const {
    const auto number = [&](double v) {
      return static_cast<std::int64_t>(std::floor(v / (2 * tolerance_)));
    };
    const Point from = p - vertices_.front();
    return {number(from.x), number(from.y), number(from.z)};
  }
  void fill_cubes() {
    for (std::uint32_t v = 0; v < vertices_.size(); ++v)
      cubes_.emplace_back(cube_of(vertices_[v]), v);
    std::ranges::sort(cubes_);
  }

  std::vector<Point> vertices_;
  double tolerance_;
  std::vector<InCube> cubes_;
};

// The edges of a cell's triangles whose smaller ends it owns, ascending.
std::vector<EdgeFound> owned_edges(const Box& cell, std::span<const Triangle> triangles) {
  std::vector<std::pair<EdgeEnds, Point>> sides;
  for (const Triangle& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const EdgeEnds ends = ends_of(t.corners[k], t.corners[(k + 1) % 3]);
      if (TriangleBuckets::owns(cell, ends[0])) sides.emplace_back(ends, t.corners[(k + 2) % 3]);
    }
  std::ranges::sort(sides);
  std::vector<EdgeFound> edges;
  for (std::size_t s = 1; s < sides.size(); s += 2)
    edges.push_back({0, sides[s].first, {sides[s - 1].second, sides[s].second}});
  return edges;
}

// Which edges pieces are.
std::vector<EdgeFound> edges_that_are(std::span<const Piece> pieces,
                                      std::span<const EdgeFound> edges) {
  std::vector<EdgeFound> found;
  for (const Piece& piece : pieces) {
    const EdgeEnds ends = ends_of(piece.from, piece.to);
    const auto edge = std::ranges::lower_bound(edges, ends, {}, &EdgeFound::ends);
    if (edge != edges.end() && edge->ends == ends) found.push_back({piece.id, ends, edge->beyond});
  }
  return found;
}

// Which edges lie along pieces, both ends no farther from one than the tolerance.
std::vector<EdgeFound> edges_along(std::span<const Piece> pieces, std::span<const EdgeFound> edges,
                                   double tolerance) {
  std::vector<Box> boxes;
  for (const Piece& piece : pieces) boxes.push_back(Box::around(piece.from).joined(piece.to));
  const BoxTree tree(std::move(boxes));
  const auto is_near = [&](const Piece& piece, const Point& p) {
    return squared_distance(p, closest_on_segment(piece.from, piece.to, p)) <=
           tolerance * tolerance;
  };
  std::vector<EdgeFound> found;
  std::vector<std::uint32_t> near;  // pieces, to the edge's smaller end
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto& [a, b] = edges[e].ends;
    if (e == 0 || edges[e - 1].ends[0] != a) {
      near.clear();
      double squared = 1.01 * tolerance * tolerance;
      tree.for_each_within(a, squared, [&](std::uint32_t n) {
        if (is_near(pieces[n], a)) near.push_back(n);
      });
    }
    for (const std::uint32_t n : near)
      if (is_near(pieces[n], b)) found.push_back({pieces[n].id, edges[e].ends, edges[e].beyond});
  }
  return found;
}

// The chain of edges that leads from a piece's one end to its other one, always onwards: the
// shortest. If there is none, how far one comes.
struct Chain {
  std::vector<EdgeFound> edges;
  std::optional<Point> end;  // where it goes on nowhere
};
Chain chain_along(const Piece& piece, std::span<const EdgeFound> edges) {
  const auto progress = [&](const Point& p) { return dot(p - piece.from, piece.to - piece.from); };
  struct Step {
    double from_progress = 0, to_progress = 0;
    Point from, to;
    std::size_t edge = 0;
  };
  std::vector<Step> steps;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    Step step{progress(edges[e].ends[0]), progress(edges[e].ends[1]), edges[e].ends[0],
              edges[e].ends[1], e};
    if (step.to_progress < step.from_progress) {
      std::swap(step.from, step.to);
      std::swap(step.from_progress, step.to_progress);
    }
    if (step.from_progress < step.to_progress) steps.push_back(step);
  }
  std::ranges::sort(steps, {}, [](const Step& s) { return std::tuple(s.from_progress, s.edge); });
  struct Reached {
    double length = 0;
    std::size_t step = 0;  // that leads there
  };
  std::map<Point, Reached> reached = {{piece.from, {}}};
  Point farthest = piece.from;
  double most = 0;
  for (std::size_t s = 0; s < steps.size(); ++s) {
    const auto from = reached.find(steps[s].from);
    if (from == reached.end()) continue;
    const double length = from->second.length + norm(steps[s].to - steps[s].from);
    const auto [to, is_new] = reached.try_emplace(steps[s].to, Reached{length, s});
    if (!is_new && length < to->second.length) to->second = {length, s};
    if (steps[s].to_progress > most) {
      most = steps[s].to_progress;
      farthest = steps[s].to;
    }
  }
  if (!reached.contains(piece.to)) return {{}, farthest};
  Chain chain;
  for (Point at = piece.to; at != piece.from;) {
    const Step& step = steps[reached.at(at).step];
    chain.edges.push_back(edges[step.edge]);
    at = step.from;
  }
  return chain;
}

class PolylineMatcher {
 public:
  PolylineMatcher(CheckedSurface& surface, const GivenPolylines& polylines, IngestWatch& watch,
                  Workers& workers, const IngestShare& share)
      : surface_(surface),
        polylines_(polylines),
        watch_(watch),
        workers_(workers),
        share_(share),
        directory_(surface.spill.directory()) {
    const Point sides = surface.facts.box.max - surface.facts.box.min;
    tolerance_ = std::max(kPolylineTolerance * std::max({sides.x, sides.y, sides.z}),
                          2 * polylines.weld.value_or(0));
  }

  void run() {
    EdgesInBuckets found(directory_);
    Asked chains(directory_);  // pieces that are more than an edge
    {
      Asked pieces(directory_);
      find_pieces(pieces);
      find_edges(pieces, chains, found);
    }
    chains.finish();
    if (!chains.pieces.is_empty()) find_chains(chains, found);
    found.finish();
    take(found);
  }

 private:
  // Pieces, and in which buckets edges of them are asked for.
  struct Asked {
    explicit Asked(const std::filesystem::path& directory)
        : pieces(directory), in_buckets(directory) {}
    void finish() {
      pieces.finish();
      in_buckets.finish();
    }
    Pieces pieces;
    PiecesAsked in_buckets;
  };

  // ---- Buckets ----

  // Calls visit(number) for each whose cell, and all that it is a part of, is_met(box).
  template <class IsMet, class Visit>
  void for_each_bucket(MortonKey node, const IsMet& is_met, const Visit& visit) const {
    const auto below = surface_.buckets.under(node);
    if (below.empty() || !is_met(surface_.buckets.frame().box(node))) return;
    if (below.front().cell.is_ancestor_or_self_of(node))
      return visit(surface_.number_of(below.front()));
    for (int octant = 0; octant < 8; ++octant) for_each_bucket(node.child(octant), is_met, visit);
  }

  // Does compute(cell, triangles, asked) for each bucket of which something is asked, and
  // take(found) with what each gives.
  template <class Asked, class Compute, class Take>
  void for_each_asked(SortedSpill<Asked, &Asked::order>& asked, const Compute& compute,
                      const Take& take) {
    struct Loaded {
      std::vector<Triangle> triangles;
      std::vector<Asked> asked;
    };
    bool is_crowded = false;
    using Found = std::invoke_result_t<Compute, const Box&, std::span<const Triangle>,
                                       std::span<const Asked>>;
    for_each_in_order(
        workers_, surface_.buckets.all(),
        [&](const TriangleBucket& bucket) {
          Loaded loaded;
          const std::size_t number = surface_.number_of(bucket);
          const std::uint64_t most = kMostAsked * (bucket.triangles.count + kMostAsked);
          for (; !asked.is_empty() && asked.front().bucket == number; asked.pop())
            if (loaded.asked.size() < most)
              loaded.asked.push_back(asked.front());
            else
              is_crowded = true;
          if (!loaded.asked.empty()) loaded.triangles = surface_.load(bucket);
          return loaded;
        },
        [&](const TriangleBucket& bucket, const Loaded& loaded) -> Found {
          throw_if_stopped(watch_.stop());
          if (loaded.asked.empty()) return {};
          const Box cell = surface_.buckets.frame().box(bucket.cell);
          return compute(cell, std::span(loaded.triangles), std::span(loaded.asked));
        },
        [&](const TriangleBucket&, const Found& found) {
          take(found);
          watch_.advance(found.size());
        });
    const std::vector<std::string> of_all = share_.gather(is_crowded ? "crowded" : "");
    if (std::ranges::any_of(of_all, [](const std::string& word) { return !word.empty(); }))
      share_.refuse(polylines_.file.string() +
                    ": runs along the same edges again and again; give each of them once");
  }

  // ---- Points ----

  // Throws InputError if the file is another one by now.
  void read(const std::function<void(const PolylinePoint&)>& take) const {
    if (read_polylines(polylines_.file, take, watch_.stop()) != polylines_.digest)
      throw InputError(polylines_.file.string() + ": it has changed while it was read; try again");
  }

  void find_pieces(Asked& asked) {
    VerticesFound vertices(directory_);
    find_vertices(vertices);
    CommonRecords<VertexFound> known(vertices, share_);
    std::uint64_t id = 0;
    Point last;
    read([&](const PolylinePoint& point) {
      const auto closest = known.of(id++);
      if (closest.empty()) refuse_point(point);
      const Point& vertex = closest.front().position;
      if (!point.is_first && vertex != last)
        ask_owner({asked.pieces.size(), point.line, last, vertex}, asked);
      last = vertex;
      watch_.advance();
    });
    asked.finish();
  }

  // Whoever owns an edge's smaller end has both of its triangles.
  void ask_owner(const Piece& piece, Asked& asked) const {
    asked.pieces.append(piece);
    const auto owner =
        surface_.buckets.under(surface_.buckets.frame().key_of(std::min(piece.from, piece.to)));
    if (!owner.empty()) asked.in_buckets.append({surface_.number_of(owner.front()), piece});
  }

  void find_vertices(VerticesFound& vertices) {
    PointsAsked asked(directory_);
    std::uint64_t id = 0;
    const Box around = surface_.facts.box.expanded(tolerance_);
    read([&](const PolylinePoint& point) {
      const Point& p = point.position;
      if (around.contains(p))
        for_each_bucket(
            MortonKey::root(),
            [&](const Box& box) { return box.squared_distance(p) <= tolerance_ * tolerance_; },
            [&](std::uint64_t bucket) {
              asked.append({bucket, id, p});
            });
      ++id;
      watch_.advance();
    });
    asked.finish();
    for_each_asked(
        asked,
        [&](const Box& cell, std::span<const Triangle> triangles,
            std::span<const PointAsked> points) {
          std::vector<Point> owned;
          for (const Triangle& t : triangles)
            for (const Point& p : t.corners)
              if (TriangleBuckets::owns(cell, p)) owned.push_back(p);
          sort_and_unite(owned);
          std::vector<VertexFound> found;
          if (owned.empty()) return found;
          VertexFinder finder(std::move(owned), tolerance_);
          for (const PointAsked& point : points)
            if (const auto vertex = finder.closest_to(point.position))
              found.push_back({point.id, squared_distance(point.position, *vertex), *vertex});
          return found;
        },
        [&](const std::vector<VertexFound>& found) {
          for (const VertexFound& vertex : found) vertices.append(vertex);
        });
    vertices.finish();
  }

  // ---- Edges ----

  void find_edges(Asked& asked, Asked& chains, EdgesInBuckets& found) {
    EdgesFound edges(directory_);
    answer(asked.in_buckets, edges_that_are, edges);
    CommonRecords<EdgeFound> known(edges, share_);
    for (Pieces& pieces = asked.pieces; !pieces.is_empty(); pieces.pop()) {
      const auto edge = known.of(pieces.front().id);
      if (edge.empty())
        ask_all_along(pieces.front(), chains);
      else
        add(edge.front(), found);
      watch_.advance();
    }
  }

  void ask_all_along(const Piece& piece, Asked& asked) const {
    asked.pieces.append(piece);
    const CreaseEdge edge{.ends = ends_of(piece.from, piece.to)};
    for_each_bucket(
        MortonKey::root(),
        [&](const Box& box) { return touches(edge, box.expanded(2 * tolerance_)); },
        [&](std::uint64_t bucket) {
          asked.in_buckets.append({bucket, piece});
        });
  }

  void find_chains(Asked& asked, EdgesInBuckets& found) {
    EdgesFound edges(directory_);
    answer(
        asked.in_buckets,
        [&](std::span<const Piece> pieces, std::span<const EdgeFound> of_cell) {
          return edges_along(pieces, of_cell, tolerance_);
        },
        edges);
    CommonRecords<EdgeFound> known(edges, share_);
    for (Pieces& pieces = asked.pieces; !pieces.is_empty(); pieces.pop()) {
      const Piece& piece = pieces.front();
      const auto along = known.of(piece.id);
      if (along.size() > kMostEdges)
        refuse(piece,
               fmt::format("runs along more than {} edges: give points between", kMostEdges));
      const Chain chain = chain_along(piece, along);
      if (chain.end)
        refuse(piece,
               *chain.end == piece.from
                   ? std::string("runs along no edges of the surface")
                   : fmt::format("runs along edges of the surface to {} alone", text(*chain.end)));
      for (const EdgeFound& edge : chain.edges) add(edge, found);
      watch_.advance();
    }
  }

  // Of each piece, where it is asked for, edges.
  template <class Find>
  void answer(PiecesAsked& asked, const Find& find, EdgesFound& edges) {
    for_each_asked(
        asked,
        [&](const Box& cell, std::span<const Triangle> triangles,
            std::span<const PieceAsked> asked_here) {
          std::vector<Piece> pieces;
          for (const PieceAsked& piece : asked_here) pieces.push_back(piece.piece);
          const std::vector<EdgeFound> owned = owned_edges(cell, triangles);
          return find(std::span<const Piece>(pieces), std::span<const EdgeFound>(owned));
        },
        [&](const std::vector<EdgeFound>& found) {
          for (const EdgeFound& edge : found) edges.append(edge);
        });
    edges.finish();
  }

  // To all buckets that both of its triangles are in.
  void add(const EdgeFound& edge, EdgesInBuckets& found) const {
    const auto& [a, b] = edge.ends;
    const Triangle one{.id = 0, .corners = {a, b, edge.beyond[0]}},
        other{.id = 0, .corners = {a, b, edge.beyond[1]}};
    for_each_bucket(
        MortonKey::root(), [&](const Box& box) { return touches(one, box) && touches(other, box); },
        [&](std::uint64_t bucket) {
          found.append({bucket, edge.ends});
        });
  }

  void take(EdgesInBuckets& found) {
    GivenEdges given(polylines_.file.string(), directory_);
    std::optional<EdgeInBucket> last;
    for (; !found.is_empty(); found.pop()) {
      const EdgeInBucket& edge = found.front();
      if (!last || last->order() != edge.order()) given.append(edge.bucket, edge.ends);
      last = edge;
    }
    given.finish();
    surface_.given = std::move(given);
  }

  // ---- What matches nothing ----

  [[noreturn]] void refuse_point(const PolylinePoint& point) const {
    const Point& p = point.position;
    VertexFound closest{0, std::numeric_limits<double>::infinity(), {}};
    for (const TriangleBucket& bucket : surface_.buckets.all()) {
      for (const Triangle& t : surface_.load(bucket))
        for (const Point& corner : t.corners)
          closest = std::min(
              {0, squared_distance(p, corner), corner}, closest,
              [](const VertexFound& a, const VertexFound& b) { return a.order() < b.order(); });
      watch_.advance(bucket.triangles.count);
    }
    const auto all =
        records_in<VertexFound>(share_.gather(bytes_of(std::span<const VertexFound>(&closest, 1))));
    closest = *std::ranges::min_element(all, {}, &VertexFound::order);
    share_.refuse(fmt::format(
        "{}: line {}: {} is no vertex of the surface; the closest one, {}, is {} away: polylines "
        "lead from vertex to vertex, along edges",
        polylines_.file.string(), point.line, text(p), text(closest.position),
        rounded(std::sqrt(closest.squared))));
  }

  [[noreturn]] void refuse(const Piece& piece, const std::string& what) const {
    share_.refuse(
        fmt::format("{}: line {}: the straight piece from {} to {} {}; polylines lead along edges",
                    polylines_.file.string(), piece.line, text(piece.from), text(piece.to), what));
  }

  CheckedSurface& surface_;
  const GivenPolylines& polylines_;
  IngestWatch& watch_;
  Workers& workers_;
  const IngestShare& share_;
  std::filesystem::path directory_;
  double tolerance_ = 0;
};

}  // namespace

void find_given_edges(CheckedSurface& surface, const GivenPolylines& polylines, IngestWatch& watch,
                      Workers& workers, const IngestShare& share) {
  if (polylines.file.empty()) return;
  PolylineMatcher(surface, polylines, watch, workers, share).run();
}

}  // namespace locvol
