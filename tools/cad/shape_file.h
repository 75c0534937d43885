// A CAD file as it is read: bodies that are bounded by curved faces, their names and colors.
#pragma once

#include <Standard_Failure.hxx>
#include <TopoDS_Face.hxx>
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

// A face of the file.
struct BodyFace {
  const void* key;                  // its TopoDS_TShape as it was read
  std::vector<TopoDS_Face> pieces;  // the body is on their inner side
};

struct Body {
  TopoDS_Shape shape;  // a solid; of loose faces, or of those of a fused solid, a compound
  std::vector<BodyFace> faces;
  std::string name;  // empty: it has none
  CadColor color;
  std::size_t part = 0;
};

struct ShapeFile {
  std::vector<Body> bodies;
  // Parts of an assembly, whose bodies may have faces in common: where each is in it.
  std::vector<gp_Trsf> places;
  // By TopoDS_TShape. Names are looked up, and nothing depends on their order.
  std::unordered_map<const void*, std::string> names;
  std::unordered_map<const void*, CadColor> colors;
  double unit_mm = 1;  // of the file's lengths; shapes are in millimeters
  std::string unit;    // its name; empty: the format has none
};

// Notes go to the sink. Throws Refusal, Standard_Failure, std::bad_alloc.
ShapeFile read_shapes(const std::string& file, CadFormat format, Sink& sink);

}  // namespace locvol::cad
