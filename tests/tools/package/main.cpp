// Uses something of every exported library, so that each one must link.
#include <cstdio>

#include "engine/surface_input.h"
#include "octree/octree.h"
#include "refine/cover_leaf.h"
#include "storage/store.h"

int main() {
  const bool has_leaves = locvol::LinearOctree::uniform(1).size() == 8;
  const locvol::Frame frame({0, 0, 0}, 1);
  const locvol::Lattice lattice(frame, 0.1 * frame.side(0), 0.5 * frame.side(0));
  const locvol::SurfacePatch nothing({}, frame.root_box(), frame.root_box().center(), true);
  const bool has_lattice = locvol::cover_leaf({.size = 0.1 * frame.side(0),
                                               .seed = 1,
                                               .lattice = &lattice,
                                               .box = frame.root_box(),
                                               .surface = &nothing,
                                               .nearby_samples = {}})
                               .core.is_whole;
  const bool has_store = locvol::Store::exists("no-such-store");
  bool is_refused = false;
  try {
    locvol::IngestWatch watch;
    locvol::read_surface("no-such-surface.off", ".", watch);
  } catch (const locvol::InputError& error) {
    std::puts(error.what());
    is_refused = true;
  }
  return has_leaves && has_lattice && !has_store && is_refused ? 0 : 1;
}
