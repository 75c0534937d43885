#include "refine/winding/holes_alone.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "octree/disjoint_sets.h"
#include "octree/sort_and_unite.h"
#include "octree/table_hash.h"
#include "refine/cure/near_points.h"
#include "refine/domain/box_tree.h"
#include "refine/domain/cut_triangle.h"
#include "refine/domain/exact_predicates.h"
#include "refine/domain/self_intersection.h"
#include "refine/domain/triangle_tree.h"
#include "refine/winding/chain.h"
#include "refine/winding/doubt.h"
#include "refine/winding/level_patch.h"
#include "refine/winding/rays_upward.h"
#include "refine/winding/winding_number.h"

namespace locvol {
namespace {

using Corners = PassingTriangles::Corners;
using PointTable = std::unordered_map<Point, std::uint32_t, TableHash>;

constexpr std::uint32_t kNoNumber = 0xffffffff;

Point vector_of(const Corners& t) { return cross(t[1] - t[0], t[2] - t[0]); }
double size_of(const Corners& t) { return 0.5 * norm(vector_of(t)); }

Box box_of(const Corners& t) { return Box::around(t[0]).joined(t[1]).joined(t[2]); }

// Boxes that triangles may meet.
class MetBoxes {
 public:
  MetBoxes(std::vector<Box> boxes, double margin)
      : is_empty_(boxes.empty()), margin_(margin), tree_(std::move(boxes)) {}

  // True of all triangles that come as near as the margin, and of some others.
  bool may_meet(const Corners& t) const {
    if (is_empty_) return false;
    const Box box = box_of(t);
    const Point center = box.center();
    const double reach = norm(box.max - center) + margin_;
    double squared = reach * reach;
    bool is_met = false;
    tree_.for_each_within(center, squared, [&](std::uint32_t) {
      is_met = true;
      squared = 0;
    });
    return is_met;
  }

 private:
  bool is_empty_;
  double margin_;
  BoxTree tree_;
};

class HoleClosing {
 public:
  HoleClosing(const PassingTriangles& triangles, std::span<const OpenSide> open, double spacing,
              double gap, WindingChanges& changes, const StopToken* stop)
      : source_(triangles),
        sides_(open),
        spacing_(spacing),
        gap_(gap),
        changes_(changes),
        stop_(stop),
        num_(triangles.num()) {}

  bool run(const std::function<void(const Corners&, SheetId)>& give) {
    measure();
    if (!turn_outwards()) return false;
    take_around_open_edges();
    if (joins_points()) return false;
    find_pieces();
    if (is_mostly_islands()) return false;
    tell_labels();
    if (!dropped_.empty()) {
      take_around_open_edges();
      find_pieces();
    }
    drop_islands();
    if (!fill() || meets_filling()) return false;
    tell_closed_parts();
    give_all(give);
    return true;
  }

 private:
  // What is around open edges: triangles with two vertices at them, the first of the chain's, in
  // their order.
  struct Around {
    Chain chain;
    std::uint32_t num_open = 0;            // vertices at open edges
    std::vector<std::uint32_t> triangles;  // by the chain's, their numbers
    // But for what goes on beyond.
    std::vector<OpenEdge> open_edges() const {
      std::vector<OpenEdge> open = locvol::open_edges(chain);
      std::erase_if(open,
                    [&](const OpenEdge& e) { return !is_around(e.from) || !is_around(e.to); });
      return open;
    }
    bool is_around(std::uint32_t v) const { return v < num_open; }
  };

  // As they are turned.
  template <class Visit>
  void for_each(const Visit& visit) const {
    StopPoll poll(stop_, 1024);
    source_.for_each([&](std::uint32_t t, Corners corners, SheetId group) {
      poll();
      if (is_turned_) std::swap(corners[1], corners[2]);
      visit(t, corners, group);
    });
  }
  // As they are kept.
  template <class Visit>
  void for_each_kept(const Visit& visit) {
    auto dropped = dropped_.begin();
    for_each([&](std::uint32_t t, const Corners& corners, SheetId group) {
      if (dropped != dropped_.end() && *dropped == t) {
        ++dropped;
        return;
      }
      if (!islands_.empty() && islands_.contains(pieces_.find(t))) return;
      visit(t, corners, group);
    });
  }
  bool is_dropped(std::uint32_t t) const { return std::ranges::binary_search(dropped_, t); }

  // ---- One orientation, outwards

  void measure() {
    double weights = 0;
    bool is_first = true;
    for_each([&](std::uint32_t, const Corners& t, SheetId) {
      if (is_first) box_ = Box::around(t[0]);
      is_first = false;
      for (const Point& p : t) box_ = box_.joined(p);
      const auto& [a, b, c] = t;
      const double its = norm(vector_of(t));
      center_ = center_ + (its / 3) * (a + b + c);
      weights += its;
      area_ += 0.5 * its;
    });
    center_ = (1 / weights) * center_;
    near_ = snapping_distance(box_);
  }

  bool turn_outwards() {
    double volume = 0;
    for_each([&](std::uint32_t, const Corners& t, SheetId) {
      volume += dot(t[0] - center_, cross(t[1] - center_, t[2] - center_));
    });
    if (volume < 0) {
      is_turned_ = true;
      changes_.num_turned = num_;
    }
    return std::isfinite(volume);
  }

  // ---- Open edges

  // Their vertices are numbered as they come, also on triangles that are dropped.
  void take_around_open_edges() {
    PointTable numbers;
    for (const OpenSide& side : sides_) {
      numbers.emplace(side.from, kNoNumber);
      numbers.emplace(side.to, kNoNumber);
    }
    for (const Corners& t : dropped_corners_)
      for (const Point& p : t) numbers.emplace(p, kNoNumber);
    struct Taken {
      std::uint32_t triangle;
      SheetId group;
      Corners corners;
    };
    std::vector<Taken> taken;
    Around around;
    for_each([&](std::uint32_t t, const Corners& corners, SheetId group) {
      int num = 0;
      // As they come, before they are turned.
      for (const std::size_t k :
           std::array<std::size_t, 3>{0, is_turned_ ? 2U : 1U, is_turned_ ? 1U : 2U}) {
        const Point& p = corners[k];
        const auto found = numbers.find(p);
        if (found == numbers.end()) continue;
        ++num;
        if (found->second != kNoNumber) continue;
        found->second = around.num_open++;
        around.chain.vertices.push_back(p);
      }
      if (num >= 2 && !is_dropped(t)) taken.push_back({t, group, corners});
    });
    for (const Taken& t : taken) {
      ChainTriangle triangle{{}, 1, t.group};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [place, is_new] =
            numbers.emplace(t.corners[k], static_cast<std::uint32_t>(around.chain.vertices.size()));
        if (is_new) around.chain.vertices.push_back(t.corners[k]);
        triangle.corners[k] = place->second;
      }
      around.chain.triangles.push_back(triangle);
      around.triangles.push_back(t.triangle);
    }
    around_ = std::move(around);
    open_ = around_.open_edges();
  }

  bool joins_points() const {
    std::vector<std::uint32_t> open;
    std::vector<double> reach(around_.num_open, gap_);
    if (!(gap_ > 0)) return false;
    const std::vector<Point>& points = around_.chain.vertices;
    for (const OpenEdge& e : open_)
      for (const std::uint32_t v : {e.from, e.to}) {
        open.push_back(v);
        reach[v] = std::min(reach[v], kOfShortestOpen * norm(points[e.to] - points[e.from]));
      }
    sort_and_unite(open);
    bool joins = false;
    for_each_near(std::span(points).first(around_.num_open), gap_,
                  [&](std::uint32_t u, std::uint32_t v) {
                    joins |= norm(points[u] - points[v]) < std::min(reach[u], reach[v]);
                  });
    return joins;
  }

  // ---- Pieces

  void find_pieces() {
    pieces_.reset(num_);
    source_.for_each_edge([&](std::uint32_t s, std::uint32_t t) {
      if (dropped_.empty() || (!is_dropped(s) && !is_dropped(t))) pieces_.unite(s, t);
    });
    found_.clear();
    for_each([&](std::uint32_t t, const Corners& corners, SheetId) {
      if (is_dropped(t)) return;
      ChainPiece& piece =
          found_.try_emplace(pieces_.find(t), ChainPiece{Box::around(corners[0])}).first->second;
      for (const Point& p : corners) piece.box = piece.box.joined(p);
      ++piece.num;
      piece.area += size_of(corners);
    });
    for_each_edge(edges_of(around_.chain), [&](std::span<const ChainEdge> uses) {
      if (uses.size() != 1 || !around_.is_around(uses[0].low) || !around_.is_around(uses[0].high))
        return;
      const std::uint32_t t = around_.triangles[uses[0].triangle];
      const std::vector<Point>& points = around_.chain.vertices;
      found_.at(pieces_.find(t)).border += norm(points[uses[0].high] - points[uses[0].low]);
    });
  }

  bool is_mostly_islands() const {
    double area = 0;
    for (const auto& [name, piece] : found_)
      if (piece.is_island(kWide * spacing_, kFewOnIsland)) area += piece.area;
    return area > kMostIslands * area_;
  }

  void drop_islands() {
    changes_.left_out_area = std::max(0.0, 1 - kept_area_ / area_);
    const PatchCounts counts = counts_of_holes(around_.chain, open_);
    changes_.num_holes = counts.num_holes;
    changes_.largest_hole = counts.largest_hole;
    for (const auto& [name, piece] : found_)
      if (piece.is_island(kWide * spacing_, 0)) islands_.insert(name);
    if (islands_.empty()) return;
    const auto goes = [&](std::uint32_t t) { return islands_.contains(pieces_.find(t)); };
    std::erase_if(around_.chain.triangles, [&, n = std::size_t{0}](const ChainTriangle&) mutable {
      return goes(around_.triangles[n++]);
    });
    std::erase_if(around_.triangles, goes);
    open_ = around_.open_edges();
  }

  // ---- Where the label changes

  // Along triangles that no cone meets, the whole number is the same. So one of these tells it for
  // all that hang together; and each other for itself.
  void tell_labels() {
    const Cones cones(around_.chain, open_);
    std::vector<Box> boxes;
    for (const Cones::Cone& cone : cones.all()) boxes.push_back(box_of(cone));
    const MetBoxes met(std::move(boxes), near_);
    std::vector<bool> is_met(num_);
    for_each([&](std::uint32_t t, const Corners& corners, SheetId) {
      is_met[t] = met.may_meet(corners);
    });
    DisjointSets sets(num_);
    source_.for_each_edge([&](std::uint32_t s, std::uint32_t t) {
      if (!is_met[s] && !is_met[t]) sets.unite(s, t);
    });
    // Of those that tell, the whole number behind.
    std::vector<std::int32_t> behind(num_told(sets));
    std::vector<std::uint32_t> tellers;
    tellers.reserve(behind.size());
    for (std::uint32_t t = 0; t < num_; ++t)
      if (sets.find(t) == t) tellers.push_back(t);
    count_behind(cones, tellers, behind);
    const auto behind_of = [&](std::uint32_t t) {
      const auto teller =
          std::ranges::lower_bound(tellers, static_cast<std::uint32_t>(sets.find(t)));
      return behind[static_cast<std::size_t>(teller - tellers.begin())];
    };
    for_each([&](std::uint32_t t, const Corners& corners, SheetId) {
      const Point p = place_on(corners);
      const int its = behind_of(t);
      if (is_surely_kept(cones, p, its)) {
        kept_area_ += size_of(corners);
        return;
      }
      const int whole = is_seen_before(corners, p) ? its - 1 : its;
      const BesideNumbers beside = beside_triangle(corners, 1, whole, cones);
      const bool is_inside_behind = beside.behind > kLeastInside,
                 is_inside_before = beside.before > kLeastInside;
      if (is_inside_behind && !is_inside_before) {
        kept_area_ += size_of(corners);
        return;
      }
      dropped_.push_back(t);
      dropped_corners_.push_back(corners);
      is_any_turned_ |= is_inside_before && !is_inside_behind;
    });
  }
  std::size_t num_told(DisjointSets& sets) const {
    std::size_t num = 0;
    for (std::uint32_t t = 0; t < num_; ++t) num += sets.find(t) == t;
    return num;
  }

  static bool is_surely_kept(const Cones& cones, const Point& p, int behind) {
    constexpr double kMost = 0.45;
    return behind == 1 && cones.is_surely_below(kMost, p);
  }

  // In as many passes as memory asks for. The first tells of the doubt, too.
  void count_behind(const Cones& cones, std::span<const std::uint32_t> tellers,
                    std::span<std::int32_t> behind) {
    constexpr std::size_t kMostPlaces = 1'000'000;
    std::vector<Point> doubted = places_of_doubt(box_);
    const std::size_t num_doubted = doubted.size();
    for (std::size_t first = 0; first < tellers.size(); first += kMostPlaces) {
      const std::size_t end = std::min(first + kMostPlaces, tellers.size());
      std::vector<Point> places = std::exchange(doubted, {});
      const std::size_t num_before = places.size();
      std::vector<bool> are_before;
      std::size_t next = first;
      for_each([&](std::uint32_t t, const Corners& corners, SheetId) {
        if (next == end || tellers[next] != t) return;
        ++next;
        places.push_back(place_on(corners));
        are_before.push_back(is_seen_before(corners, places.back()));
      });
      RaysUpward rays(std::move(places));
      for_each([&](std::uint32_t, const Corners& corners, SheetId) { rays.add(corners); });
      for (const Cones::Cone& cone : cones.all()) rays.add(cone);
      if (first == 0) {
        std::size_t num = 0;
        for (std::size_t n = 0; n < num_doubted; ++n)
          num += is_in_doubt(rays.sums()[n] - cones.angle_at(rays.places()[n], Cones::kRough));
        changes_.doubt = static_cast<double>(num) / static_cast<double>(num_doubted);
      }
      for (std::size_t n = first; n < end; ++n)
        behind[n] = rays.sums()[num_before + n - first] + (are_before[n - first] ? 1 : 0);
    }
  }

  // ---- Holes

  // False: one takes more.
  bool fill() {
    if (is_any_turned_) return false;
    const Chain before = around_.chain;
    num_vertices_before_ = static_cast<std::uint32_t>(before.vertices.size());
    std::vector<Point> places;
    const Cones cones(around_.chain, open_);
    if (fill_holes(around_.chain, open_, spacing_, [&](const Point& p) {
          places.push_back(p);
          return 0.5;
        }))
      return false;
    RaysUpward rays(std::move(places));
    if (!rays.places().empty()) {
      for_each_kept([&](std::uint32_t, const Corners& t, SheetId) { rays.add(t); });
      for (const Cones::Cone& cone : cones.all()) rays.add(cone);
    }
    for (std::size_t n = 0; n < rays.places().size(); ++n)
      if (!is_near_level(rays.sums()[n] - cones.angle_at(rays.places()[n], Cones::kFar)))
        return false;
    changed_.resize(around_.chain.triangles.size());
    for (std::size_t n = 0; n < changed_.size(); ++n)
      changed_[n] = n >= before.triangles.size() ||
                    before.triangles[n].corners != around_.chain.triangles[n].corners;
    return is_closed();
  }

  // Is each edge around what were holes in two triangles that have it in opposite ways?
  bool is_closed() const {
    bool is_closed = true;
    const auto is_known = [&](std::uint32_t v) {
      return around_.is_around(v) || v >= num_vertices_before_;
    };
    for_each_edge(edges_of(around_.chain), [&](std::span<const ChainEdge> uses) {
      if (is_known(uses[0].low) && is_known(uses[0].high))
        is_closed &= uses.size() == 2 && uses[0].is_upward != uses[1].is_upward;
    });
    return is_closed;
  }

  // Does what fills holes meet something else, or come so near that it is to be snapped?
  bool meets_filling() {
    std::vector<Corners> filling;
    for (std::size_t n = 0; n < changed_.size(); ++n)
      if (changed_[n]) filling.push_back(around_.chain.points_of(around_.chain.triangles[n]));
    std::vector<Box> boxes;
    for (const Corners& t : filling) {
      if (height_of(t) <= near_ || are_collinear(t[0], t[1], t[2])) return true;
      boxes.push_back(box_of(t));
    }
    const std::size_t num_filling = filling.size();
    const MetBoxes met(std::move(boxes), 2 * near_);
    auto kept = around_.triangles.begin();
    std::size_t n = 0;
    for_each_kept([&](std::uint32_t t, const Corners& corners, SheetId) {
      const bool is_around = kept != around_.triangles.end() && *kept == t;
      const bool has_changed = is_around && changed_[n];
      if (is_around) {
        ++kept;
        ++n;
      }
      if (!has_changed && met.may_meet(corners)) filling.push_back(corners);
    });
    Chain chain;
    PointTable numbers;
    for (const Corners& t : filling) {
      ChainTriangle triangle{};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [place, is_new] =
            numbers.emplace(t[k], static_cast<std::uint32_t>(chain.vertices.size()));
        if (is_new) chain.vertices.push_back(t[k]);
        triangle.corners[k] = place->second;
      }
      chain.triangles.push_back(triangle);
    }
    bool meets = false;
    for_each_near(chain.vertices, near_, [&](std::uint32_t, std::uint32_t) { meets = true; });
    const std::vector<std::array<std::uint32_t, 3>> corners = chain.corners();
    for_each_intersection(
        chain.vertices, corners, TriangleTree(chain.vertices, corners),
        [&](std::uint32_t s, std::uint32_t t) { return std::min(s, t) < num_filling; },
        [&](std::uint32_t, std::uint32_t) { meets = true; }, stop_);
    return meets;
  }

  // ---- What is closed

  struct ClosedPart {
    double height = -1;  // of its highest triangle, which tells the label
    Corners teller;
    Point origin;
    double area = 0, volume = 0;
    int kept = 0;
  };

  // Each triangle of the closed surface, in order, with that of the pieces which it is in.
  template <class Visit>
  void for_each_closed(const Visit& visit) {
    const Chain& chain = around_.chain;
    std::size_t n = 0;
    for_each_kept([&](std::uint32_t t, const Corners& corners, SheetId group) {
      if (n < around_.triangles.size() && around_.triangles[n] == t)
        visit(pieces_.find(t), chain.points_of(chain.triangles[n++]), group);
      else
        visit(pieces_.find(t), corners, group);
    });
    for (; n < chain.triangles.size(); ++n)
      visit(pieces_.find(number_of(n)), chain.points_of(chain.triangles[n]),
            chain.triangles[n].group);
  }
  // A triangle of the source in the same part.
  std::uint32_t number_of(std::size_t n) const {
    return n < around_.triangles.size() ? around_.triangles[n]
                                        : of_filling_[n - around_.triangles.size()];
  }

  // What fills holes goes with what is around them.
  void unite_over_holes() {
    const Chain& chain = around_.chain;
    DisjointSets sets(chain.triangles.size());
    for_each_edge(edges_of(chain), [&](std::span<const ChainEdge> uses) {
      for (const ChainEdge& use : uses) sets.unite(use.triangle, uses[0].triangle);
    });
    // Names are the smallest of their members: those of before come first.
    for (std::uint32_t n = 0; n < chain.triangles.size(); ++n) {
      const std::uint32_t its = around_.triangles[sets.find(n)];
      if (n < around_.triangles.size())
        pieces_.unite(around_.triangles[n], its);
      else
        of_filling_.push_back(its);
    }
  }

  void tell_closed_parts() {
    constexpr double kFlat = 1e-6;  // of what is as thick as wide
    unite_over_holes();
    double area = 0;
    for_each_closed([&](std::size_t piece, const Corners& t, SheetId) {
      ClosedPart& its =
          parts_.try_emplace(piece, ClosedPart{.teller = t, .origin = t[0]}).first->second;
      if (const double height = height_of(t); height > its.height) {
        its.height = height;
        its.teller = t;
      }
      its.area += size_of(t);
      its.volume += dot(t[0] - its.origin, cross(t[1] - its.origin, t[2] - its.origin)) / 6;
      area += size_of(t);
    });
    double closing = 0;
    for (std::size_t n = around_.triangles.size(); n < around_.chain.triangles.size(); ++n)
      closing += size_of(around_.chain.points_of(around_.chain.triangles[n]));
    changes_.closing_area = closing / area;
    std::vector<Point> places;
    for (const auto& [name, part] : parts_) places.push_back(place_on(part.teller));
    RaysUpward rays(std::move(places));
    for_each_closed([&](std::size_t, const Corners& t, SheetId) { rays.add(t); });
    std::size_t n = 0;
    for (auto& [name, part] : parts_) {
      const BesideNumbers beside = beside_triangle(part.teller, 1, rays.sums()[n++], Cones());
      part.kept = (beside.behind > kLeastInside) - (beside.before > kLeastInside);
      if (std::abs(part.volume) < kFlat * part.area * std::sqrt(part.area)) part.kept = 0;
    }
  }

  void give_all(const std::function<void(const Corners&, SheetId)>& give) {
    for_each_closed([&](std::size_t piece, Corners t, SheetId group) {
      const int kept = parts_.at(piece).kept;
      if (kept == 0) return;
      if (kept < 0) std::swap(t[1], t[2]);
      give(t, group);
    });
  }

  const PassingTriangles& source_;
  std::span<const OpenSide> sides_;
  double spacing_, gap_;
  WindingChanges& changes_;
  const StopToken* stop_;
  std::uint32_t num_;
  bool is_turned_ = false;
  Box box_;
  Point center_;
  double near_ = 0, area_ = 0, kept_area_ = 0;
  Around around_;
  std::vector<OpenEdge> open_;
  DisjointSets pieces_;
  std::map<std::size_t, ChainPiece> found_;  // by the names of pieces
  std::set<std::size_t> islands_;            // the names of those that go
  std::vector<std::uint32_t> dropped_;       // triangles where the label is the same on both sides
  std::vector<Corners> dropped_corners_;
  bool is_any_turned_ = false;
  std::uint32_t num_vertices_before_ = 0;  // holes were filled
  std::vector<bool> changed_;              // by the chain's triangles: are they others, or new?
  std::vector<std::uint32_t> of_filling_;
  std::map<std::size_t, ClosedPart> parts_;  // by the names of pieces
};

}  // namespace

bool close_holes_alone(const PassingTriangles& triangles, std::span<const OpenSide> open,
                       double spacing, double gap, WindingChanges& changes,
                       const std::function<void(const Corners&, SheetId)>& give,
                       const StopToken* stop) {
  WindingChanges its;
  if (!HoleClosing(triangles, open, spacing, gap, its, stop).run(give)) return false;
  changes = its;
  return true;
}

}  // namespace locvol
