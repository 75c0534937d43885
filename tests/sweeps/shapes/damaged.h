// Sound surfaces, damaged as scanners, exporters and people do it: each damage of one kind, by a
// measure that goes through its range.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tests/sweeps/shapes/solid.h"

namespace locvol::sweeps {

struct Damage {
  std::string_view kind;
  double measure = 0;  // triangles, percent or a length, as the kind has it
  // It leaves enough to know all of the inside by, so it must be meshed without a site.
  bool is_to_be_whole = false;

  std::string name() const;  // such as "hole 100"
};

// All, in a fixed order; the first does nothing.
std::vector<Damage> damages();

struct DamagedSurface {
  Shape shape;
  // The inside is that of all of these together, each of which is closed.
  std::vector<Shape> sound;
  double lost_volume = 0;  // by how much what the damaged surface encloses may differ from that
};

// A function of all three. Nothing: the surface has too few triangles for that.
std::optional<DamagedSurface> damaged(const Shape& sound, const Damage& damage, std::uint64_t seed);

}  // namespace locvol::sweeps
