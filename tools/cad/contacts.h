// Bodies that touch, so that they meet in faces that both have.
#pragma once

#include <cstddef>
#include <vector>

#include "tools/cad/shape_file.h"
#include "tools/cad/sink.h"

namespace locvol::cad {

// Solids each of which may touch or cross another of its group, by their numbers among the file's
// bodies: a face of each is within the box around a face of the other.
using ContactGroups = std::vector<std::vector<std::size_t>>;
ContactGroups contact_groups(const ShapeFile& file);

// The faces of a group's solids are cut along each other's (general fuse), so that what they have
// in common is one piece of both, and is cut into the same triangles: a pin in a hole of its
// radius, a box that stands on a plate. Bodies that are cut are in a part of their own, in place;
// the faces of the file stay, each with its pieces. A group that OpenCASCADE cannot fuse, or of
// which it changes a body's volume, stays as it is, with a note.
void fuse_contacts(ShapeFile& file, const ContactGroups& groups, Sink& sink);

// Likewise of all groups.
void tell_unfused(const ContactGroups& groups, Sink& sink);

}  // namespace locvol::cad
