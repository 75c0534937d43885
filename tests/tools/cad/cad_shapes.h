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
// Solids whose faces lie on each other's, or cross them, and have no edge in common: pins in holes,
// one pressed into a hole that is too small, a ball in its socket, a cone in its hole, a box in
// another at its bottom, boxes on each other, instances of a bolt on each other.
std::vector<CadShape> cad_contacts();
CadShape cad_shape(const std::string& name);

// One of its faces is missing.
TopoDS_Shape shell_without_a_face(const TopoDS_Shape& solid);

double volume_of(const TopoDS_Shape& shape);
double united_volume_of(const std::vector<TopoDS_Shape>& shapes);
int num_faces_of(const TopoDS_Shape& shape);

// `unit`: MM, INCH, M, …
void write_step(const CadShape& shape, const std::filesystem::path& file,
                const std::string& unit = "MM");
void write_iges(const CadShape& shape, const std::filesystem::path& file);
void write_brep(const CadShape& shape, const std::filesystem::path& file);

}  // namespace locvol
