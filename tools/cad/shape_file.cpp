#include "tools/cad/shape_file.h"

#include <BRepBndLib.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepClass3d_SolidClassifier.hxx>
#include <BRepTools.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <IGESCAFControl_Reader.hxx>
#include <IGESData_IGESEntity.hxx>
#include <IGESData_IGESModel.hxx>
#include <Interface_Static.hxx>
#include <Precision.hxx>
#include <Quantity_Color.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <StepRepr_NextAssemblyUsageOccurrence.hxx>
#include <StepRepr_RepresentationItem.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TCollection_HAsciiString.hxx>
#include <TDF_LabelSequence.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Iterator.hxx>
#include <TopoDS_Shell.hxx>
#include <TopoDS_Solid.hxx>
#include <TransferBRep.hxx>
#include <Transfer_TransientProcess.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_ColorTool.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <XSControl_TransferReader.hxx>
#include <XSControl_WorkSession.hxx>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <sstream>
#include <string_view>

#include "tools/cad/kept_messages.h"

namespace locvol::cad {
namespace {

// What writers put where a name is to be, and none is.
std::string real_name(std::string_view name) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
  while (!name.empty() && is_blank(name.front())) name.remove_prefix(1);
  while (!name.empty() && is_blank(name.back())) name.remove_suffix(1);
  if (name == "NONE" || name == "None" || name == "none" || name == "UNKNOWN") return {};
  return std::string(name);
}

std::string text_of(const TCollection_ExtendedString& name) {
  std::string text(static_cast<std::size_t>(name.LengthOfCString()) + 1, '\0');
  Standard_PCharacter place = text.data();
  name.ToUTF8CString(place);
  return real_name(text.c_str());
}

std::string name_of(const TDF_Label& label) {
  Handle(TDataStd_Name) name;
  if (!label.FindAttribute(TDataStd_Name::GetID(), name)) return {};
  const std::string text = text_of(name->Get());
  // What OpenCASCADE gives to what has no name.
  for (const char* made_up :
       {"SOLID", "COMPOUND", "SHELL", "COMPSOLID", "Open CASCADE STEP", "=>["})
    if (text.starts_with(made_up)) return {};
  return text;
}

CadColor color_of(const Quantity_Color& color) {
  double red = 0, green = 0, blue = 0;
  color.Values(red, green, blue, Quantity_TOC_sRGB);
  const auto byte = [](double v) {
    return static_cast<std::uint8_t>(std::lround(255 * std::clamp(v, 0.0, 1.0)));
  };
  return {1, byte(red), byte(green), byte(blue)};
}

// The faces that bound a shape, each one piece.
std::vector<BodyFace> faces_of(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape faces;
  TopExp::MapShapes(shape, TopAbs_FACE, faces);
  std::vector<BodyFace> bounding;
  for (int f = 1; f <= faces.Extent(); ++f)
    if (faces(f).Orientation() <= TopAbs_REVERSED)  // else it lies within
      bounding.push_back({faces(f).TShape().get(), {TopoDS::Face(faces(f))}});
  return bounding;
}

// ---- The document

// Solids, and shells that are closed, bound a body each. Faces that are in none are sewn where they
// nearly meet; what is closed then is a body each. If there is none at all, all are taken as they
// are.
class PartCollector {
 public:
  PartCollector(ShapeFile& file, Sink& sink) : file_(file), sink_(sink) {
    BRep_Builder().MakeCompound(loose_);
  }

  // `above`: of what it is a part of.
  void add_part(const TopoDS_Shape& placed, const std::string& name, const std::string& above,
                const CadColor& color) {
    const TopoDS_Shape shape = placed.Located(TopLoc_Location());
    const std::size_t first = file_.bodies.size();
    const auto add = [&](const TopoDS_Shape& body) {
      Body added =
          body_of(body.ShapeType() == TopAbs_SHELL ? solid_of({TopoDS::Shell(body)}) : body);
      added.name = name.empty() ? above : name;
      added.color = color;
      const void* key = body.TShape().get();
      if (const auto own = file_.names.find(key); own != file_.names.end())
        added.name = own->second;
      if (const auto own = file_.colors.find(key); own != file_.colors.end())
        added.color = own->second;
      file_.bodies.push_back(added);
    };
    for (TopExp_Explorer s(shape, TopAbs_SOLID); s.More(); s.Next())
      if (TopExp_Explorer(s.Current(), TopAbs_FACE).More()) add(s.Current());
    for (TopExp_Explorer s(shape, TopAbs_SHELL, TopAbs_SOLID); s.More(); s.Next())
      if (BRep_Tool::IsClosed(s.Current()))
        add(s.Current());
      else
        add_loose(s.Current().Moved(placed.Location()), TopAbs_SHAPE);
    add_loose(placed, TopAbs_SHELL);
    // Of a part that is one solid, the designer has named the part.
    if (file_.bodies.size() == first + 1 && !name.empty()) file_.bodies.back().name = name;
    if (file_.bodies.size() > first) file_.places.push_back(placed.Location().Transformation());
  }

  void finish() {
    if (num_loose_ == 0) return;
    const std::size_t num_sewn = sew_faces();
    if (file_.bodies.empty()) {
      file_.bodies.push_back(body_of(loose_));
      file_.places.emplace_back();
    } else if (const std::size_t num_left = num_loose_ - std::min(num_sewn, num_loose_);
               num_left > 0) {
      sink_.note("left out " + std::to_string(num_left) +
                 (num_left == 1 ? " face that bounds" : " faces that bound") + " no body");
    }
  }

 private:
  // Of the part that is at hand.
  Body body_of(const TopoDS_Shape& shape) const {
    return {shape, faces_of(shape), {}, {}, file_.places.size()};
  }
  void add_loose(const TopoDS_Shape& shape, TopAbs_ShapeEnum avoid) {
    for (TopExp_Explorer f(shape, TopAbs_FACE, avoid); f.More(); f.Next()) {
      BRep_Builder().Add(loose_, f.Current());
      ++num_loose_;
    }
  }

  // How many are of a body then. The tolerance is the file's own.
  std::size_t sew_faces() {
    constexpr double kLeast = 1e-6;  // millimeters
    double tolerance = kLeast;
    for (TopExp_Explorer e(loose_, TopAbs_EDGE); e.More(); e.Next())
      tolerance = std::max(tolerance, BRep_Tool::Tolerance(TopoDS::Edge(e.Current())));
    BRepBuilderAPI_Sewing sewing(tolerance);
    for (TopoDS_Iterator f(loose_); f.More(); f.Next()) sewing.Add(f.Value());
    sewing.Perform();
    std::vector<TopoDS_Shell> shells;
    TopTools_IndexedMapOfShape sewn;
    for (TopExp_Explorer s(sewing.SewedShape(), TopAbs_SHELL); s.More(); s.Next())
      if (BRep_Tool::IsClosed(s.Current())) {
        shells.push_back(TopoDS::Shell(s.Current()));
        TopExp::MapShapes(s.Current(), TopAbs_FACE, sewn);
      }
    if (shells.empty()) return 0;
    for (const TopoDS_Solid& body : bodies_of(shells)) file_.bodies.push_back(body_of(body));
    file_.places.emplace_back();
    for (TopoDS_Iterator f(loose_); f.More(); f.Next()) keep_name(f.Value(), sewing);
    std::ostringstream text;
    text << "sewed " << sewn.Extent() << " faces that were in no solid, where they are closer than "
         << tolerance / file_.unit_mm;
    sink_.note(text.str());
    return static_cast<std::size_t>(sewn.Extent());
  }

  static TopoDS_Solid solid_of(const std::vector<TopoDS_Shell>& shells) {
    TopoDS_Solid solid;
    BRep_Builder().MakeSolid(solid);
    for (const TopoDS_Shell& shell : shells) BRep_Builder().Add(solid, shell);
    return solid;
  }

  // A shell in another is a cavity of it.
  static std::vector<TopoDS_Solid> bodies_of(const std::vector<TopoDS_Shell>& shells) {
    std::vector<Bnd_Box> boxes(shells.size());
    for (std::size_t s = 0; s < shells.size(); ++s) BRepBndLib::Add(shells[s], boxes[s]);
    const auto lies_in = [&](std::size_t s, std::size_t other) {
      double x0 = 0, y0 = 0, z0 = 0, x1 = 0, y1 = 0, z1 = 0;
      boxes[s].Get(x0, y0, z0, x1, y1, z1);
      if (boxes[other].IsOut(gp_Pnt(x0, y0, z0)) || boxes[other].IsOut(gp_Pnt(x1, y1, z1)))
        return false;
      const gp_Pnt p =
          BRep_Tool::Pnt(TopoDS::Vertex(TopExp_Explorer(shells[s], TopAbs_VERTEX).Current()));
      BRepClass3d_SolidClassifier classifier(solid_of({shells[other]}));
      classifier.PerformInfinitePoint(Precision::Confusion());
      const TopAbs_State outside = classifier.State();
      classifier.Perform(p, Precision::Confusion());
      return classifier.State() != TopAbs_ON && classifier.State() != outside;
    };
    std::vector<std::size_t> outer;  // by shell: the one around it, or none
    for (std::size_t s = 0; s < shells.size(); ++s) {
      std::size_t around = 0;
      while (around < shells.size() && (around == s || !lies_in(s, around))) ++around;
      outer.push_back(around);
    }
    std::vector<TopoDS_Solid> made;
    for (std::size_t s = 0; s < shells.size(); ++s) {
      if (outer[s] < shells.size()) continue;
      std::vector<TopoDS_Shell> body = {shells[s]};
      for (std::size_t in = 0; in < shells.size(); ++in)
        if (outer[in] == s) body.push_back(shells[in]);
      made.push_back(solid_of(body));
    }
    return made;
  }

  void keep_name(const TopoDS_Shape& face, BRepBuilderAPI_Sewing& sewing) {
    const void* before = face.TShape().get();
    const void* now = sewing.Modified(face).TShape().get();
    if (const auto name = file_.names.find(before); name != file_.names.end())
      file_.names.emplace(now, std::string(name->second));
    if (const auto color = file_.colors.find(before); color != file_.colors.end())
      file_.colors.emplace(now, CadColor(color->second));
  }

  ShapeFile& file_;
  Sink& sink_;
  TopoDS_Compound loose_;
  std::size_t num_loose_ = 0;
};

class DocumentReader {
 public:
  // `no_names`: what else stands for the name of an instance, and is none.
  DocumentReader(const Handle(TDocStd_Document) & document, PartCollector& parts, ShapeFile& file,
                 std::set<std::string> no_names = {})
      : shapes_(XCAFDoc_DocumentTool::ShapeTool(document->Main())),
        colors_(XCAFDoc_DocumentTool::ColorTool(document->Main())),
        parts_(parts),
        file_(file),
        no_names_(std::move(no_names)) {}

  void run() {
    TDF_LabelSequence labels;
    shapes_->GetFreeShapes(labels);
    for (int i = 1; i <= labels.Length(); ++i)
      visit(labels.Value(i), TopLoc_Location(), {}, {}, {});
  }

 private:
  // `name`: of the instance of it; `above`: of what that is in.
  void visit(const TDF_Label& label, const TopLoc_Location& place, std::string name,
             const std::string& above, CadColor color) {
    const bool is_instance = XCAFDoc_ShapeTool::IsReference(label);
    if (const std::string own = name_of(label);
        !own.empty() && !(is_instance && no_names_.contains(own)))
      name = own;
    if (const CadColor own = color_at(label); own.is_given) color = own;
    TDF_Label referred;
    if (is_instance && XCAFDoc_ShapeTool::GetReferredShape(label, referred))
      return visit(referred, place * XCAFDoc_ShapeTool::GetLocation(label), name, above, color);
    if (XCAFDoc_ShapeTool::IsAssembly(label)) {
      TDF_LabelSequence components;
      XCAFDoc_ShapeTool::GetComponents(label, components);
      for (int i = 1; i <= components.Length(); ++i)
        visit(components.Value(i), place, {}, name.empty() ? above : name, color);
      return;
    }
    const TopoDS_Shape shape = XCAFDoc_ShapeTool::GetShape(label);
    if (shape.IsNull()) return;
    take_subshapes(label);
    parts_.add_part(shape.Located(place * shape.Location()), name, above, color);
  }

  void take_subshapes(const TDF_Label& label) {
    TDF_LabelSequence labels;
    XCAFDoc_ShapeTool::GetSubShapes(label, labels);
    for (int i = 1; i <= labels.Length(); ++i) {
      const void* key = XCAFDoc_ShapeTool::GetShape(labels.Value(i)).TShape().get();
      if (const std::string name = name_of(labels.Value(i)); !name.empty()) file_.names[key] = name;
      if (const CadColor color = color_at(labels.Value(i)); color.is_given)
        file_.colors[key] = color;
    }
  }

  CadColor color_at(const TDF_Label& label) const {
    Quantity_Color color;
    for (const XCAFDoc_ColorType type : {XCAFDoc_ColorSurf, XCAFDoc_ColorGen})
      if (colors_->GetColor(label, type, color)) return color_of(color);
    return {};
  }

  Handle(XCAFDoc_ShapeTool) shapes_;
  Handle(XCAFDoc_ColorTool) colors_;
  PartCollector& parts_;
  ShapeFile& file_;
  std::set<std::string> no_names_;
};

Handle(TDocStd_Document) new_document() {
  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  return document;
}

// Names that entities have, for the faces and solids that were made of them.
template <class NameOf>
void take_names(const Handle(XSControl_WorkSession) & session, ShapeFile& file,
                const NameOf& name_of_entity) {
  const Handle(Transfer_TransientProcess)& process = session->TransferReader()->TransientProcess();
  if (process.IsNull()) return;
  for (int i = 1; i <= process->NbMapped(); ++i) {
    const std::string name = name_of_entity(process->Mapped(i));
    if (name.empty()) continue;
    const TopoDS_Shape shape = TransferBRep::ShapeResult(process, process->Mapped(i));
    if (shape.IsNull()) continue;
    if (shape.ShapeType() == TopAbs_FACE || shape.ShapeType() == TopAbs_SOLID)
      file.names.emplace(shape.TShape().get(), name);
  }
}

// ---- STEP

struct Unit {
  std::string_view spelled, name;
  double millimeters;
};
constexpr std::array<Unit, 16> kUnits = {{{"millimetre", "mm", 1},
                                          {"MILLIMETRE", "mm", 1},
                                          {"centimetre", "cm", 10},
                                          {"decimetre", "dm", 100},
                                          {"metre", "m", 1000},
                                          {"METRE", "m", 1000},
                                          {"kilometre", "km", 1e6},
                                          {"micrometre", "µm", 1e-3},
                                          {"nanometre", "nm", 1e-6},
                                          {"inch", "inch", 25.4},
                                          {"INCH", "inch", 25.4},
                                          {"INCHES", "inch", 25.4},
                                          {"foot", "ft", 304.8},
                                          {"FOOT", "ft", 304.8},
                                          {"MILLIMETER", "mm", 1},
                                          {"mile", "mile", 1609344}}};

// OpenCASCADE gives millimeters. If all of the file is in another unit, its own are made of them.
void take_unit(STEPControl_Reader& reader, ShapeFile& file, Sink& sink) {
  TColStd_SequenceOfAsciiString lengths, angles, solid_angles;
  reader.FileUnits(lengths, angles, solid_angles);
  file.unit = "mm";
  if (lengths.IsEmpty()) return;
  const std::string_view first = lengths.First().ToCString();
  for (int i = 2; i <= lengths.Length(); ++i)
    if (lengths.Value(i).ToCString() != first) {
      sink.note("has lengths of several units: its coordinates are taken in millimeters");
      return;
    }
  const auto unit = std::ranges::find(kUnits, first, &Unit::spelled);
  if (unit == kUnits.end()) {
    sink.note("has lengths in '" + std::string(first) +
              "': its coordinates are taken in millimeters");
    return;
  }
  file.unit = unit->name;
  file.unit_mm = unit->millimeters;
}

[[noreturn]] void refuse_unread(const char* format, const KeptMessages& messages) {
  const std::string place = messages.first_failure();
  throw Refusal("is no " + std::string(format) + " file that OpenCASCADE can read" +
                (place.empty() ? "" : " (" + place + ")") +
                ": it is cut off, or damaged; fetch or export it again");
}

// Instances of parts, where they have no name, are given their numbers in the file for one.
std::set<std::string> numbers_of_nameless(const Handle(Interface_InterfaceModel) & model) {
  std::set<std::string> numbers;
  for (int i = 1; i <= model->NbEntities(); ++i) {
    const auto instance = Handle(StepRepr_NextAssemblyUsageOccurrence)::DownCast(model->Value(i));
    if (instance.IsNull() || instance->Id().IsNull()) continue;
    if (instance->Name().IsNull() || real_name(instance->Name()->ToCString()).empty())
      numbers.insert(real_name(instance->Id()->ToCString()));
  }
  return numbers;
}

void read_step(const std::string& path, ShapeFile& file, PartCollector& parts, Sink& sink) {
  const KeptMessages messages;
  STEPCAFControl_Reader reader;
  reader.SetLayerMode(false);
  reader.SetPropsMode(false);
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  const IFSelect_ReturnStatus status = reader.ReadFile(path.c_str());
  if (status != IFSelect_RetDone) refuse_unread("STEP", messages);
  take_unit(reader.ChangeReader(), file, sink);
  Handle(TDocStd_Document) document = new_document();
  const bool is_done = reader.Transfer(document);
  if (!is_done) throw Refusal("has no shape: export the solids of the model");
  take_names(reader.Reader().WS(), file, [](const Handle(Standard_Transient) & entity) {
    const auto item = Handle(StepRepr_RepresentationItem)::DownCast(entity);
    return item.IsNull() || item->Name().IsNull() ? std::string()
                                                  : real_name(item->Name()->ToCString());
  });
  DocumentReader(document, parts, file, numbers_of_nameless(reader.Reader().Model())).run();
  document->Close();
}

// ---- IGES

void read_iges(const std::string& path, ShapeFile& file, PartCollector& parts) {
  const KeptMessages messages;
  IGESCAFControl_Reader reader;
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  const IFSelect_ReturnStatus status = reader.ReadFile(path.c_str());
  if (status != IFSelect_RetDone) refuse_unread("IGES", messages);
  const Handle(IGESData_IGESModel) model = reader.IGESModel();
  const double unit = model->GlobalSection().UnitValue();
  file.unit = "mm";
  if (unit > 0) {
    const auto known = std::ranges::find(kUnits, unit, &Unit::millimeters);
    file.unit_mm = unit;
    file.unit = known == kUnits.end() ? std::to_string(unit) + " mm" : std::string(known->name);
  }
  Handle(TDocStd_Document) document = new_document();
  const bool is_done = reader.Transfer(document);
  if (!is_done) throw Refusal("has no shape: export the solids of the model");
  take_names(reader.WS(), file, [](const Handle(Standard_Transient) & entity) {
    const auto item = Handle(IGESData_IGESEntity)::DownCast(entity);
    return item.IsNull() || !item->HasName() ? std::string()
                                             : real_name(item->NameValue()->ToCString());
  });
  DocumentReader(document, parts, file).run();
  document->Close();
}

// ---- BREP

void read_brep(const std::string& path, PartCollector& parts) {
  const KeptMessages messages;
  TopoDS_Shape shape;
  BRepTools::Read(shape, path.c_str(), BRep_Builder());
  if (shape.IsNull()) refuse_unread("BREP", messages);
  parts.add_part(shape, {}, {}, {});
}

}  // namespace

ShapeFile read_shapes(const std::string& path, CadFormat format, Sink& sink) {
  ShapeFile file;
  PartCollector parts(file, sink);
  switch (format) {
    case CadFormat::kStep:
      read_step(path, file, parts, sink);
      break;
    case CadFormat::kIges:
      read_iges(path, file, parts);
      break;
    case CadFormat::kBrep:
      read_brep(path, parts);
      break;
  }
  parts.finish();
  if (file.bodies.empty())
    throw Refusal("has no faces: export the solids of the model, not its lines or drawings");
  return file;
}

}  // namespace locvol::cad
