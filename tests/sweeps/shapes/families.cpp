#include "tests/sweeps/shapes/families.h"

#include <array>

namespace locvol::sweeps {
namespace {

constexpr std::array kFamilies = {
    Family{"sphere", make_sphere}, Family{"torus", make_torus},   Family{"scan", make_scan},
    Family{"box", make_box},       Family{"stack", make_stack},   Family{"blocks", make_blocks},
    Family{"frame", make_frame},   Family{"hollow", make_hollow}, Family{"plate", make_plate},
    Family{"steps", make_steps},   Family{"ribs", make_ribs},     Family{"gear", make_gear},
    Family{"spiral", make_spiral}, Family{"fold", make_fold},     Family{"wedge", make_wedge},
    Family{"twist", make_twist},   Family{"shaft", make_shaft},   Family{"tube", make_tube},
    Family{"cone", make_cone},     Family{"needle", make_needle}, Family{"thread", make_thread},
    Family{"spring", make_spring}, Family{"shell", make_shell},   Family{"sheet", make_sheet},
    Family{"urchin", make_urchin}, Family{"hull", make_hull},     Family{"pair", make_pair},
    Family{"nested", make_nested},
};

constexpr std::array kFamiliesOfBodies = {
    Family{"bricks", make_bricks},
    Family{"onion", make_onion},
    Family{"apart", make_apart},
    Family{"grains", make_grains},
};

}  // namespace

std::span<const Family> families() { return kFamilies; }
std::span<const Family> families_of_bodies() { return kFamiliesOfBodies; }

}  // namespace locvol::sweeps
