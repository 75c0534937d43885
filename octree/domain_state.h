// Which body a place is in, found by what a way there from outside crosses.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "octree/body_id.h"

namespace locvol {

// The state of a place: the body that it is in. What crossing a part of the surface changes is a
// state, too, and so is what a whole way changes, in whatever order it is walked. A part that has
// the body a on one side and b on the other changes the state by a + b, as numbers of bits that are
// added without a carry: from a to b and from b to a alike, so nobody needs to know which way the
// part faces. All that lies between two places of the same body cancels out. With one body, which
// has the number 1, that is a parity. Nobody but this type and refine/domain knows.
class DomainState {
 public:
  constexpr DomainState() = default;  // outside of all bodies
  static constexpr DomainState in(BodyId body) { return DomainState(body); }
  // What crossing a part of the surface between two bodies changes.
  static constexpr DomainState between(BodyId a, BodyId b) { return DomainState(a ^ b); }

  // At the end of a way that changes this.
  constexpr DomainState crossed(DomainState change) const {
    return DomainState(body_ ^ change.body_);
  }
  constexpr BodyId body() const { return body_; }

  // What makes it up, for those who store or send it. `state`: a DomainState or a const one
  template <class Self>
  static auto& member(Self& state) {
    return state.body_;
  }
  friend constexpr bool operator==(DomainState, DomainState) = default;

 private:
  explicit constexpr DomainState(BodyId body) : body_(body) {}

  BodyId body_ = kNoBody;
};

// What the ways from the center of a box to its corners change. Corner k has the upper x if bit 0
// of k is set, the upper y if bit 1 is, the upper z if bit 2 is.
class CornerStates {
 public:
  DomainState operator[](int corner) const { return states_[static_cast<std::size_t>(corner)]; }
  void cross(int corner, DomainState change) {
    DomainState& state = states_[static_cast<std::size_t>(corner)];
    state = state.crossed(change);
  }

  template <class Self>
  static auto& member(Self& states) {  // likewise
    return states.states_;
  }
  friend bool operator==(const CornerStates&, const CornerStates&) = default;

 private:
  std::array<DomainState, 8> states_{};
};

}  // namespace locvol
