// Which body a place is in, found by what a way there from outside crosses.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "octree/body_id.h"

namespace locvol {

// The state of a place: the body that it is in. What crossing a part of the surface changes is a
// state, too, and so is what a whole way changes, in whatever order it is walked. A part that has
// the body a on one side and b on the other changes the state by code(a) + code(b), as numbers of
// bits that are added without a carry: from a to b and from b to a alike, so nobody needs to know
// which way the part faces. All that lies between two places of the same body cancels out. With one
// body, which has the number 1, that is a parity. Nobody but this type and refine/domain knows.
//
// A code is the body in the low half, and b³ + b in the high half, in the field of 2^16 elements
// (x^16 + x^12 + x^3 + x + 1; the codes are those of a code by Bose, Chaudhuri and Hocquenghem that
// corrects two errors): from s = a + b and t = a³ + b³ follows ab = t / s + s², so no two pairs of
// bodies have the same sum. The b beside b³ changes nothing in that, and makes 0 of 0 and 1 of 1.
class DomainState {
 public:
  static constexpr BodyId kMostBody = 0xffff;

  constexpr DomainState() = default;  // outside of all bodies
  // REQUIRES here and below: bodies are at most kMostBody
  static constexpr DomainState in(BodyId body) { return DomainState(code_of(body)); }
  // What crossing a part of the surface between two bodies changes: of each pair, something else.
  static constexpr DomainState between(BodyId a, BodyId b) {
    return DomainState(code_of(a) ^ code_of(b));
  }
  // While bodies are not known yet, the number of something that has a change stands in its place.
  static constexpr DomainState instead_of(std::uint32_t number) { return DomainState(number); }

  // At the end of a way that changes this.
  constexpr DomainState crossed(DomainState change) const {
    return DomainState(code_ ^ change.code_);
  }
  constexpr BodyId body() const { return code_ & kMostBody; }
  constexpr std::uint32_t number() const { return code_; }  // that stands in place of this

  // What makes it up, for those who store or send it. `state`: a DomainState or a const one
  template <class Self>
  static auto& member(Self& state) {
    return state.code_;
  }
  friend constexpr bool operator==(DomainState, DomainState) = default;

 private:
  explicit constexpr DomainState(std::uint32_t code) : code_(code) {}

  static constexpr std::uint32_t code_of(BodyId body) {
    if (body <= kOnlyBody) return body;
    return body | (product(product(body, body), body) ^ body) << 16;
  }
  // In the field of 2^16 elements.
  static constexpr std::uint32_t product(std::uint32_t a, std::uint32_t b) {
    constexpr std::uint32_t kModulus = 0x1100b;
    std::uint32_t sum = 0;
    for (; b != 0; b >>= 1) {
      if ((b & 1) != 0) sum ^= a;
      a <<= 1;
      if ((a & 0x10000) != 0) a ^= kModulus;
    }
    return sum;
  }

  std::uint32_t code_ = 0;
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
