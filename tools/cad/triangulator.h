// Curved faces become triangles: edges first and once, then face by face.
#pragma once

#include "tools/cad/shape_file.h"

namespace locvol::cad {

// What is in it. Throws Refusal, Standard_Failure.
CadFacts facts_of(const ShapeFile& file);

// Of each part the edges are cut into segments, which all faces share; then each face is
// triangulated, given to the sink, and forgotten. So bodies are as closed as their shells are.
// Throws Refusal, Standard_Failure, std::bad_alloc.
void triangulate(const ShapeFile& file, const CadLaw& law, Sink& sink);

}  // namespace locvol::cad
