// Shapes that OpenCASCADE makes, in files of its own: what CAD programs export.
#pragma once

#include <TopoDS_Shape.hxx>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace locvol {

struct NamedFace {
  std::string name;
  std::array<double, 3> place{};  // the face whose center this is the closest to
};

// In millimeters.
struct CadShape {
  std::string name;
  std::vector<TopoDS_Shape> solids;
  std::vector<std::string> solid_names = {};  // by solid, or none
  std::vector<NamedFace> face_names = {};
  bool is_assembly = false;  // solids are instances of one part
};

// plate, flange, pipe, gear, box with a shell, loft, fillets, two in contact, twelve in an
// assembly, names and colors.
std::vector<CadShape> cad_shapes();
CadShape cad_shape(const std::string& name);

// One of its faces is missing.
TopoDS_Shape shell_without_a_face(const TopoDS_Shape& solid);

double volume_of(const TopoDS_Shape& shape);
int num_faces_of(const TopoDS_Shape& shape);

// `unit`: MM, INCH, M, …
void write_step(const CadShape& shape, const std::filesystem::path& file,
                const std::string& unit = "MM");
void write_iges(const CadShape& shape, const std::filesystem::path& file);
void write_brep(const CadShape& shape, const std::filesystem::path& file);

}  // namespace locvol
