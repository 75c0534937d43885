// Curved faces become triangles: edges first and once, then face by face.
#pragma once

#include "cad/shape_file.h"

namespace locvol::cad {

// The box around all bodies, in the file's unit.
void measure(const ShapeFile& file, CadFacts& facts, CadWatch& watch);

// Of each part the edges are cut into segments, which all faces share; then each face is
// triangulated, given to the sink, and forgotten. So bodies are as closed as their shells are.
// Throws Ended, Standard_Failure, std::bad_alloc.
void triangulate(const ShapeFile& file, const CadLaw& law, CadSink& sink);

}  // namespace locvol::cad
