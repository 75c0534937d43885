// A CAD file as it is read: bodies that are bounded by curved faces, their names and colors.
#pragma once

#include <Standard_Failure.hxx>
#include <TopoDS_Shape.hxx>
#include <gp_Trsf.hxx>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "engine/ingest/cad_protocol.h"
#include "tools/cad/sink.h"

namespace locvol::cad {

// The file is at fault.
class Refusal : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
struct Body {
  TopoDS_Shape shape;  // a solid or a shell; where there is none that is closed, loose faces
  std::string name;    // empty: it has none
  CadColor color;
};

// Bodies of one part of an assembly, which may have faces in common.
struct Part {
  std::vector<Body> bodies;
  gp_Trsf place;  // of the part in the assembly
};

struct ShapeFile {
  std::vector<Part> parts;
  // By TopoDS_TShape. Names are looked up, and nothing depends on their order.
  std::unordered_map<const void*, std::string> names;
  std::unordered_map<const void*, CadColor> colors;
  double unit_mm = 1;  // of the file's lengths; shapes are in millimeters
  std::string unit;    // its name; empty: the format has none
};

// Notes go to the sink. Throws Refusal, Standard_Failure, std::bad_alloc.
ShapeFile read_shapes(const std::string& file, CadFormat format, Sink& sink);

}  // namespace locvol::cad
