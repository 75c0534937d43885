// Revisit: what of a leaf must be done again. Internal to refine/.
//
// A leaf that was clean after its last visit is visited again because of a few points near its
// border. Only own points close to those (`active`) can have other stars than then; the others keep
// their cells. So the visit is one of the active points, with what is within reach of them.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "refine/leaf.h"
#include "refine/point_cubes.h"

namespace locvol {

class Revisit {
 public:
  // Empty if all of the leaf must be visited, or nearly all.
  static std::optional<Revisit> of(const LeafInput& input, const SizeField& sizes);

  // The visit's input. Its own points are the active ones; the leaf's others are among its ghosts.
  // Points inserted into the box are own. Its surface and core are the leaf's, and are left out.
  const LeafInput& part() const { return part_; }
  // Tells whether what the visit of part() changed leaves the stars of all other own points as they
  // were, and all points around what it inserted were there.
  bool is_complete(const LeafDelta& delta) const;
  // Completes its cells and facets by those that the leaf keeps. `core`: null if none is near
  void add_kept(LeafDelta& delta, const CoreIndex* core) const;

 private:
  struct Numbered {
    Point position;
    std::uint32_t number = 0;  // own, ghosts
  };

  Revisit(const LeafInput& input, const SizeField& sizes);
  template <class Item>
  static CubesOf<Item> cubes_of(const LeafInput& input, std::span<const Item> items);
  static CubesOf<Numbered> cubes_of_all(const LeafInput& input);
  std::size_t num_points() const { return input_->own.size() + input_->ghosts.size(); }
  const MeshPoint& point(std::size_t i) const;  // own, ghosts
  // Calls visit(number) for each point closer to q than `distance`, until it returns false.
  template <class Visit>
  void for_each_near(const Point& q, double distance, Visit visit) const;
  void find_active();
  void gather_part();
  enum class VertexKind : std::uint8_t { kOther, kActive, kInactive };  // own: active or not
  std::vector<VertexKind> kinds_of(const std::vector<VertexRef>& vertices) const;
  // For both kinds of lists. `others_gone`, `others_made`: of the part, to which the leaf's other
  // points are others'
  template <class List>
  void add_kept(const List& last, std::vector<OfOther<List>>& others_gone,
                std::vector<OfOther<List>>& others_made, const CoreIndex* core, List& list) const;
  template <class List>
  std::vector<typename List::Name> taken_own(std::vector<OfOther<List>>& items) const;
  Point place_among_smallest(VertexRef id, const CoreIndex* core) const;

  double insertion_matters(const Point& q) const {  // to points up to this distance from q
    return sizes_->reach_of_balls(q, kNeighborhood);
  }
  double deletion_matters(const Point& q) const;

  const LeafInput* input_;
  const SizeField* sizes_;
  std::optional<CubesOf<Numbered>> cubes_;  // once there is a part
  std::vector<bool> is_active_;             // of own points
  std::size_t num_active_ = 0;
  std::vector<bool> is_in_part_;  // of all points
  LeafInput part_;
};

}  // namespace locvol
