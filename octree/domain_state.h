// Which bodies a place is in, found by what a way there from outside crosses.
#pragma once

#include <cstdint>

#include "octree/mesh_facet.h"

namespace locvol {

// What there is of each, so far. Who names them relies on that.
inline constexpr BodyId kOnlyBody = 1;
inline constexpr SheetId kOnlySheet = 1;

// The state of a place: the set of bodies that it is in. What crossing a part of the surface
// changes is a state, too, the bodies that end there; and so is what a whole way changes, in
// whatever order it is walked, for to cross the same twice changes nothing. With one body that is a
// parity: nobody but this type and refine/domain knows.
class DomainState {
 public:
  constexpr DomainState() = default;  // outside of all bodies
  static constexpr DomainState in(BodyId body) { return DomainState(body != kNoBody); }

  // At the end of a way that changes this.
  constexpr DomainState crossed(DomainState change) const {
    return DomainState(is_odd_ != change.is_odd_);
  }
  constexpr BodyId body() const { return is_odd_ ? kOnlyBody : kNoBody; }

  // What makes it up, for those who store or send it. `state`: a DomainState or a const one
  template <class Self>
  static auto& member(Self& state) {
    return state.is_odd_;
  }
  friend constexpr bool operator==(DomainState, DomainState) = default;

 private:
  friend class CornerStates;
  explicit constexpr DomainState(bool is_odd) : is_odd_(is_odd) {}

  bool is_odd_ = false;
};

// What the ways from the center of a box to its corners change. Corner k has the upper x if bit 0
// of k is set, the upper y if bit 1 is, the upper z if bit 2 is.
class CornerStates {
 public:
  DomainState operator[](int corner) const { return DomainState((bits_ >> corner & 1) != 0); }
  void cross(int corner, DomainState change) {
    bits_ = static_cast<std::uint8_t>(bits_ ^ (int{change.is_odd_} << corner));
  }

  template <class Self>
  static auto& member(Self& states) {  // likewise
    return states.bits_;
  }
  friend bool operator==(CornerStates, CornerStates) = default;

 private:
  std::uint8_t bits_ = 0;
};

}  // namespace locvol
