#include "tests/tools/cad/cad_shapes.h"

#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepBuilderAPI_MakeEdge.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakePolygon.hxx>
#include <BRepBuilderAPI_MakeWire.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepFilletAPI_MakeFillet.hxx>
#include <BRepGProp.hxx>
#include <BRepOffsetAPI_MakeThickSolid.hxx>
#include <BRepOffsetAPI_ThruSections.hxx>
#include <BRepPrimAPI_MakeBox.hxx>
#include <BRepPrimAPI_MakeCone.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <BRepPrimAPI_MakePrism.hxx>
#include <BRepPrimAPI_MakeRevol.hxx>
#include <BRepPrimAPI_MakeSphere.hxx>
#include <BRepTools.hxx>
#include <BRep_Builder.hxx>
#include <GProp_GProps.hxx>
#include <IGESControl_Writer.hxx>
#include <Interface_Static.hxx>
#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Quantity_Color.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <STEPConstruct.hxx>
#include <STEPControl_Controller.hxx>
#include <STEPControl_Writer.hxx>
#include <StepRepr_RepresentationItem.hxx>
#include <TCollection_HAsciiString.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopTools_ListOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Shell.hxx>
#include <Transfer_FinderProcess.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <XSControl_TransferWriter.hxx>
#include <XSControl_WorkSession.hxx>
#include <algorithm>
#include <cmath>
#include <gp_Ax2.hxx>
#include <gp_Circ.hxx>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace locvol {
namespace {

using std::numbers::pi;

gp_Ax2 upright(double x, double y, double z) { return {gp_Pnt(x, y, z), gp_Dir(0, 0, 1)}; }

TopoDS_Shape cylinder(double x, double y, double z, double radius, double height) {
  return BRepPrimAPI_MakeCylinder(upright(x, y, z), radius, height).Shape();
}
TopoDS_Shape box(double x, double y, double z, double dx, double dy, double dz) {
  return BRepPrimAPI_MakeBox(gp_Pnt(x, y, z), dx, dy, dz).Shape();
}
TopoDS_Shape cut(const TopoDS_Shape& a, const TopoDS_Shape& b) {
  return BRepAlgoAPI_Cut(a, b).Shape();
}

TopoDS_Shape only_solid(const TopoDS_Shape& shape) {
  TopExp_Explorer solids(shape, TopAbs_SOLID);
  if (!solids.More()) throw std::runtime_error("OpenCASCADE made no solid");
  return solids.Current();
}

TopoDS_Shape plate() {
  TopoDS_Shape shape = box(0, 0, 0, 80, 50, 10);
  for (const auto& [x, y] : {std::pair(15.0, 15.0), {65.0, 15.0}, {40.0, 35.0}})
    shape = cut(shape, cylinder(x, y, -1, 6, 12));
  return only_solid(shape);
}

TopoDS_Shape flange() {
  TopoDS_Shape shape =
      BRepAlgoAPI_Fuse(cylinder(0, 0, 0, 50, 12), cylinder(0, 0, 12, 25, 30)).Shape();
  shape = cut(shape, cylinder(0, 0, -1, 15, 50));
  for (int k = 0; k < 6; ++k)
    shape = cut(shape, cylinder(38 * std::cos(k * pi / 3), 38 * std::sin(k * pi / 3), -1, 4, 20));
  return only_solid(shape);
}

// Bent, so that it has a torus.
TopoDS_Shape pipe() {
  const auto swept = [](double radius) {
    const TopoDS_Wire ring = BRepBuilderAPI_MakeWire(
        BRepBuilderAPI_MakeEdge(gp_Circ(gp_Ax2(gp_Pnt(60, 0, 0), gp_Dir(0, 1, 0)), radius)));
    const TopoDS_Face disk = BRepBuilderAPI_MakeFace(ring);
    return BRepPrimAPI_MakeRevol(disk, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), pi / 2).Shape();
  };
  return only_solid(cut(swept(12), swept(9)));
}

TopoDS_Shape gear() {
  constexpr int kTeeth = 18;
  BRepBuilderAPI_MakePolygon outline;
  for (int k = 0; k < kTeeth; ++k)
    for (const auto& [radius, share] :
         {std::pair(20.0, 0.0), {20.0, 0.45}, {24.0, 0.58}, {24.0, 0.87}}) {
      const double angle = 2 * pi * (k + share) / kTeeth;
      outline.Add(gp_Pnt(radius * std::cos(angle), radius * std::sin(angle), 0));
    }
  outline.Close();
  const TopoDS_Shape wheel =
      BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(outline.Wire()).Face(), gp_Vec(0, 0, 10));
  return only_solid(cut(wheel, cylinder(0, 0, -1, 8, 12)));
}

TopoDS_Shape shelled_box() {
  const TopoDS_Shape full = box(0, 0, 0, 60, 40, 30);
  TopTools_ListOfShape open;
  for (TopExp_Explorer f(full, TopAbs_FACE); f.More(); f.Next()) {
    GProp_GProps facts;
    BRepGProp::SurfaceProperties(f.Current(), facts);
    if (facts.CentreOfMass().Z() > 29) open.Append(f.Current());
  }
  BRepOffsetAPI_MakeThickSolid shell;
  shell.MakeThickSolidByJoin(full, open, -4, 1e-3);
  return only_solid(shell.Shape());
}

TopoDS_Shape loft() {
  BRepOffsetAPI_ThruSections sections(true, false);
  const auto circle = [](double z, double radius) {
    return BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(gp_Circ(upright(0.2 * z, 0, z), radius)))
        .Wire();
  };
  sections.AddWire(circle(0, 20));
  sections.AddWire(circle(25, 12));
  sections.AddWire(circle(50, 16));
  return only_solid(sections.Shape());
}

TopoDS_Shape filleted_box(double radius) {
  const TopoDS_Shape full = box(0, 0, 0, 60, 50, 40);
  BRepFilletAPI_MakeFillet fillets(full);
  TopTools_IndexedMapOfShape edges;
  TopExp::MapShapes(full, TopAbs_EDGE, edges);
  for (int e = 1; e <= edges.Extent(); ++e) fillets.Add(radius, TopoDS::Edge(edges(e)));
  return only_solid(fillets.Shape());
}

TopoDS_Shape moved(const TopoDS_Shape& shape, double x, double y, double z, double turn) {
  gp_Trsf about, along;
  about.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), turn);
  along.SetTranslation(gp_Vec(x, y, z));
  return shape.Moved(TopLoc_Location(along * about));
}

TopoDS_Shape compound_of(const CadShape& shape) {
  if (shape.solids.size() == 1) return shape.solids.front();
  TopoDS_Compound all;
  BRep_Builder().MakeCompound(all);
  for (const TopoDS_Shape& solid : shape.solids) BRep_Builder().Add(all, solid);
  return all;
}

gp_Pnt center_of(const TopoDS_Shape& face) {
  GProp_GProps facts;
  BRepGProp::SurfaceProperties(face, facts);
  return facts.CentreOfMass();
}

TopoDS_Shape face_at(const TopoDS_Shape& shape, const gp_Pnt& place) {
  TopoDS_Shape best;
  double least = std::numeric_limits<double>::infinity();
  for (TopExp_Explorer f(shape, TopAbs_FACE); f.More(); f.Next())
    if (const double d = center_of(f.Current()).Distance(place); d < least)
      least = d, best = f.Current();
  return best;
}

}  // namespace

std::vector<CadShape> cad_shapes() {
  std::vector<CadShape> all = {{"plate", {plate()}},       {"flange", {flange()}},
                               {"pipe", {pipe()}},         {"gear", {gear()}},
                               {"shell", {shelled_box()}}, {"loft", {loft()}}};
  // Of λ = 2% of 40.
  for (const double share : {0.1, 0.5, 1.0, 3.0, 10.0})
    all.push_back(
        {"fillet_" + std::to_string(static_cast<int>(10 * share)), {filleted_box(share * 0.8)}});
  all.push_back(
      {"contact", {box(0, 0, 0, 40, 40, 10), cylinder(20, 20, 10, 12, 25)}, {"base", "post"}});
  CadShape assembly{"assembly", {}, {}, {}, true};
  const TopoDS_Shape pin = only_solid(cut(cylinder(0, 0, 0, 5, 20), cylinder(0, 0, 8, 2, 20)));
  for (int k = 0; k < 12; ++k)
    assembly.solids.push_back(moved(pin, 15 * (k % 4), 15 * (k / 4), k, 0.3 * k));
  all.push_back(assembly);
  all.push_back({"names",
                 {plate()},
                 {"bracket"},
                 {{"bottom", {40, 25, 0}},
                  {"top", {40, 25, 10}},
                  {"bolt", {15, 15, 5}},
                  {"bolt", {65, 15, 5}}}});
  return all;
}

std::vector<CadShape> cad_contacts() {
  // Pins are turned, so that nothing of their circles is at the same place as in the holes.
  const auto pin = [](double x, double y, double radius, double turn) {
    return only_solid(BRepBuilderAPI_Transform(
                          cylinder(0, 0, -3, radius, 18),
                          moved(box(0, 0, 0, 1, 1, 1), x, y, 0, turn).Location().Transformation(),
                          true)
                          .Shape());
  };
  const TopoDS_Shape block = box(0, 0, 0, 40, 40, 40);
  const TopoDS_Shape ball = BRepPrimAPI_MakeSphere(gp_Pnt(20, 20, 40), 9).Shape();
  const TopoDS_Shape peg = BRepPrimAPI_MakeCone(upright(20, 20, -5), 12, 6, 50).Shape();
  const TopoDS_Shape bolt = only_solid(cylinder(0, 0, 0, 5, 20));
  return {{"pins",
           {plate(), pin(15, 15, 6, 0.1), pin(65, 15, 6, 0.47), pin(40, 35, 6, 1.1)},
           {"plate", "pin", "pin", "pin"}},
          {"pressed", {plate(), pin(15, 15, 6.3, 0.1)}},
          {"ball", {only_solid(cut(block, ball)), ball}},
          {"peg", {only_solid(cut(block, peg)), peg}},
          {"within", {block, box(10, 10, 0, 20, 20, 20)}},
          {"stacked", {block, box(25, 25, 40, 30, 30, 10), box(-10, 5, 50, 45, 45, 8)}},
          {"rack",
           {moved(bolt, 0, 0, 0, 0), moved(bolt, 0, 0, 20, 0.4), moved(bolt, 3, 0, 40, 0)},
           {},
           {},
           true}};
}

CadShape cad_shape(const std::string& name) {
  for (const CadShape& shape : cad_contacts())
    if (shape.name == name) return shape;
  for (const CadShape& shape : cad_shapes())
    if (shape.name == name) return shape;
  throw std::invalid_argument("there is no shape " + name);
}

double volume_of(const TopoDS_Shape& shape) {
  GProp_GProps facts;
  BRepGProp::VolumeProperties(shape, facts);
  return facts.Mass();
}

double united_volume_of(const std::vector<TopoDS_Shape>& shapes) {
  TopoDS_Shape all = shapes.front();
  for (std::size_t s = 1; s < shapes.size(); ++s) all = BRepAlgoAPI_Fuse(all, shapes[s]).Shape();
  return volume_of(all);
}

TopoDS_Shape shell_without_a_face(const TopoDS_Shape& solid) {
  TopoDS_Shell shell;
  BRep_Builder().MakeShell(shell);
  TopExp_Explorer faces(solid, TopAbs_FACE);
  for (faces.Next(); faces.More(); faces.Next()) BRep_Builder().Add(shell, faces.Current());
  return shell;
}

int num_faces_of(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  return faces.Extent();
}

void write_step(const CadShape& shape, const std::filesystem::path& file, const std::string& unit) {
  Message::DefaultMessenger()->ChangePrinters().Clear();
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  const auto shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const auto colors = XCAFDoc_DocumentTool::ColorTool(document->Main());
  const auto name = [](const TDF_Label& label, const std::string& text) {
    TDataStd_Name::Set(label, text.c_str());
  };
  if (shape.is_assembly) {
    name(shapes->AddShape(compound_of(shape), true), shape.name);
  } else {
    for (std::size_t s = 0; s < shape.solids.size(); ++s) {
      const TDF_Label label = shapes->AddShape(shape.solids[s], false);
      name(label, shape.solid_names.empty() ? shape.name : shape.solid_names[s]);
    }
  }
  STEPControl_Controller::Init();
  Interface_Static::SetCVal("write.step.unit", unit.c_str());
  STEPCAFControl_Writer writer;
  for (const NamedFace& face : shape.face_names) {
    const TopoDS_Shape named =
        face_at(compound_of(shape), gp_Pnt(face.place[0], face.place[1], face.place[2]));
    colors->SetColor(named, Quantity_Color(1, 0, 0, Quantity_TOC_sRGB), XCAFDoc_ColorSurf);
  }
  writer.Transfer(document, STEPControl_AsIs);
  const auto process = writer.Writer().WS()->TransferWriter()->FinderProcess();
  for (const NamedFace& face : shape.face_names) {
    const TopoDS_Shape named =
        face_at(compound_of(shape), gp_Pnt(face.place[0], face.place[1], face.place[2]));
    const auto item = STEPConstruct::FindEntity(process, named);
    if (!item.IsNull()) item->SetName(new TCollection_HAsciiString(face.name.c_str()));
  }
  if (writer.Write(file.c_str()) != IFSelect_RetDone)
    throw std::runtime_error("cannot write " + file.string());
  document->Close();
}

void write_iges(const CadShape& shape, const std::filesystem::path& file) {
  Message::DefaultMessenger()->ChangePrinters().Clear();
  IGESControl_Writer writer("MM", 0);  // faces alone
  writer.AddShape(compound_of(shape));
  writer.ComputeModel();
  if (!writer.Write(file.c_str())) throw std::runtime_error("cannot write " + file.string());
}

void write_brep(const CadShape& shape, const std::filesystem::path& file) {
  BRepTools::Write(compound_of(shape), file.c_str());
}

}  // namespace locvol

// What OpenCASCADE keeps to the end is none of ours.
extern "C" const char* __lsan_default_suppressions() { return "leak:libTK\n"; }
