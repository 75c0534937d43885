#include "tools/cad/triangulator.h"

#include <BRepBndLib.hxx>
#include <BRepMesh_Context.hxx>
#include <BRepMesh_MeshAlgoFactory.hxx>
#include <BRepTools.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <IMeshData_Curve.hxx>
#include <IMeshData_Edge.hxx>
#include <IMeshData_Face.hxx>
#include <IMeshData_Model.hxx>
#include <IMeshData_PCurve.hxx>
#include <IMeshData_Wire.hxx>
#include <Poly_Triangulation.hxx>
#include <Precision.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <algorithm>
#include <map>
#include <numbers>
#include <numeric>

namespace locvol::cad {
namespace {

// Bodies that have faces or edges in common are cut together, so that these are cut once.
std::vector<std::vector<std::size_t>> joined_bodies(const Part& part) {
  std::vector<std::size_t> parents(part.bodies.size());
  std::iota(parents.begin(), parents.end(), std::size_t{0});
  const auto root_of = [&](std::size_t b) {
    while (parents[b] != b) b = parents[b] = parents[parents[b]];
    return b;
  };
  TopTools_IndexedMapOfShape edges;
  std::vector<std::size_t> first_with;  // by edge
  for (std::size_t b = 0; b < part.bodies.size(); ++b)
    for (TopExp_Explorer e(part.bodies[b].shape, TopAbs_EDGE); e.More(); e.Next()) {
      const auto edge = static_cast<std::size_t>(edges.Add(e.Current()) - 1);
      if (edge == first_with.size()) first_with.push_back(b);
      const std::size_t one = root_of(first_with[edge]), other = root_of(b);
      parents[std::max(one, other)] = std::min(one, other);
    }
  std::vector<std::vector<std::size_t>> joined(part.bodies.size());
  for (std::size_t b = 0; b < part.bodies.size(); ++b) joined[root_of(b)].push_back(b);
  std::erase_if(joined, [](const auto& bodies) { return bodies.empty(); });
  return joined;
}

class PartTriangulator {
 public:
  PartTriangulator(const ShapeFile& file, const CadLaw& law, Sink& sink)
      : file_(file), law_(law), sink_(sink) {}

  void run(const Part& part) {
    for (const std::vector<std::size_t>& bodies : joined_bodies(part)) {
      cut_edges(part, bodies);
      for (const std::size_t b : bodies) cut_faces(part.bodies[b], part.place);
      clear();
    }
  }

  std::size_t num_failed() const { return num_failed_; }

 private:
  void cut_edges(const Part& part, const std::vector<std::size_t>& bodies) {
    TopoDS_Compound all;
    BRep_Builder().MakeCompound(all);
    for (const std::size_t b : bodies) BRep_Builder().Add(all, part.bodies[b].shape);
    BRepTools::Clean(all);  // of triangles that the file has
    count_uses(part, bodies);
    context_ = new BRepMesh_Context;
    IMeshTools_Parameters& parameters = context_->ChangeParameters();
    parameters.Deflection = parameters.DeflectionInterior = law_.deflection * file_.unit_mm;
    parameters.Angle = parameters.AngleInterior = law_.angle_degrees * std::numbers::pi / 180;
    parameters.MinSize = std::max(IMeshTools_Parameters::RelMinSize() * parameters.Deflection,
                                  Precision::Confusion());
    parameters.CleanModel = false;
    context_->SetShape(all);
    const bool has_edges = context_->BuildModel() && context_->DiscretizeEdges();
    if (!has_edges || !context_->HealModel() || !context_->PreProcessModel())
      throw Refusal("has edges that cannot be cut into segments: repair it in a CAD program");
    const Handle(IMeshData_Model)& model = context_->GetModel();
    for (int f = 0; f < model->FacesNb(); ++f)
      places_.emplace(faces_.Add(model->GetFace(f)->GetFace()), f);
  }

  void count_uses(const Part& part, const std::vector<std::size_t>& bodies) {
    for (const std::size_t b : bodies) {
      TopTools_IndexedMapOfShape faces;
      TopExp::MapShapes(part.bodies[b].shape, TopAbs_FACE, faces);
      for (int f = 1; f <= faces.Extent(); ++f) {
        const auto face = static_cast<std::size_t>(used_.Add(faces(f)) - 1);
        if (face == num_uses_.size()) num_uses_.push_back(0);
        ++num_uses_[face];
      }
    }
  }

  void cut_faces(const Body& body, const gp_Trsf& place) {
    sink_.body(body.name);
    TopTools_IndexedMapOfShape faces;
    TopExp::MapShapes(body.shape, TopAbs_FACE, faces);
    for (int f = 1; f <= faces.Extent(); ++f) {
      const TopoDS_Face& face = TopoDS::Face(faces(f));
      if (face.Orientation() > TopAbs_REVERSED) continue;  // it lies within, and bounds nothing
      const void* key = face.TShape().get();
      const auto name = file_.names.find(key);
      const auto own = file_.colors.find(key);
      sink_.face(name == file_.names.end() ? std::string() : name->second,
                 own == file_.colors.end() ? body.color : own->second);
      sink_.triangles(placed(corners_of(face), place));
    }
  }

  // Of a face that two bodies have, they are kept until the second has got them.
  std::vector<CadTriangle> corners_of(const TopoDS_Face& face) {
    const int number = used_.FindIndex(face);
    if (const auto held = held_.find(number); held != held_.end()) {
      std::vector<CadTriangle> corners = held->second;
      // The other body is on its other side.
      for (CadTriangle& c : corners)
        for (std::size_t axis = 0; axis < 3; ++axis) std::swap(c[axis], c[3 + axis]);
      if (--num_uses_[static_cast<std::size_t>(number - 1)] == 0) held_.erase(held);
      return corners;
    }
    std::vector<CadTriangle> corners = triangulated(face);
    if (--num_uses_[static_cast<std::size_t>(number - 1)] > 0) held_.emplace(number, corners);
    return corners;
  }

  std::vector<CadTriangle> triangulated(const TopoDS_Face& face) {
    const auto place = places_.find(faces_.FindIndex(face));
    if (place == places_.end()) {  // it has no surface
      ++num_failed_;
      return {};
    }
    const IMeshData::IFaceHandle& cut = context_->GetModel()->GetFace(place->second);
    if (!cut->IsSet(IMeshData_Failure)) try {
        const Handle(IMeshTools_MeshAlgo) algorithm =
            algorithms_->GetAlgo(cut->GetSurface()->GetType(), context_->GetParameters());
        if (!algorithm.IsNull())
          algorithm->Perform(cut, context_->GetParameters(), Message_ProgressRange());
      } catch (const Standard_Failure&) {
        // There is no triangulation then.
      }
    TopLoc_Location location;
    const Handle(Poly_Triangulation) triangles = BRep_Tool::Triangulation(face, location);
    if (triangles.IsNull() || triangles->NbTriangles() == 0) {
      ++num_failed_;
      return {};
    }
    const std::vector<gp_Pnt> nodes = nodes_of(*triangles, location, cut);
    std::vector<CadTriangle> corners;
    corners.reserve(static_cast<std::size_t>(triangles->NbTriangles()));
    const bool is_turned = face.Orientation() == TopAbs_REVERSED;
    for (int t = 1; t <= triangles->NbTriangles(); ++t) {
      std::array<int, 3> of{};
      triangles->Triangle(t).Get(of[0], of[1], of[2]);
      if (is_turned) std::swap(of[0], of[1]);
      CadTriangle& c = corners.emplace_back();
      for (std::size_t i = 0; i < 3; ++i) {
        const gp_Pnt& p = nodes[static_cast<std::size_t>(of[i])];
        c[3 * i] = p.X(), c[3 * i + 1] = p.Y(), c[3 * i + 2] = p.Z();
      }
    }
    BRep_Builder().UpdateFace(face, Handle(Poly_Triangulation)());
    return corners;
  }

  // By number, from 1 on. Those on edges are the edges' own points, whatever the face's surface has
  // there, so that neighbors agree to the last bit; an edge without length is a point.
  static std::vector<gp_Pnt> nodes_of(const Poly_Triangulation& triangles,
                                      const TopLoc_Location& location,
                                      const IMeshData::IFaceHandle& face) {
    std::vector<gp_Pnt> nodes(static_cast<std::size_t>(triangles.NbNodes()) + 1);
    for (int n = 1; n <= triangles.NbNodes(); ++n) {
      nodes[static_cast<std::size_t>(n)] = triangles.Node(n);
      if (!location.IsIdentity())
        nodes[static_cast<std::size_t>(n)].Transform(location.Transformation());
    }
    for (int w = 0; w < face->WiresNb(); ++w) {
      const IMeshData::IWireHandle& wire = face->GetWire(w);
      for (int e = 0; e < wire->EdgesNb(); ++e) {
        const IMeshData::IEdgePtr& edge = wire->GetEdge(e);
        const IMeshData::IPCurveHandle& points =
            edge->GetPCurve(face.get(), wire->GetEdgeOrientation(e));
        const IMeshData::ICurveHandle& curve = edge->GetCurve();
        const bool is_point = edge->GetDegenerated();
        if (!is_point && curve->ParametersNb() != points->ParametersNb()) continue;
        for (int i = 0; i < points->ParametersNb(); ++i) {
          const int node = points->GetIndex(i);
          if (node < 1 || node > triangles.NbNodes()) continue;
          nodes[static_cast<std::size_t>(node)] =
              is_point ? BRep_Tool::Pnt(TopExp::FirstVertex(edge->GetEdge())) : curve->GetPoint(i);
        }
      }
    }
    return nodes;
  }

  std::vector<CadTriangle> placed(std::vector<CadTriangle> triangles, const gp_Trsf& place) const {
    const bool is_moved = place.Form() != gp_Identity;
    for (CadTriangle& c : triangles) {
      for (std::size_t i = 0; i < 9; i += 3) {
        gp_XYZ p(c[i], c[i + 1], c[i + 2]);
        if (is_moved) place.Transforms(p);
        c[i] = p.X() / file_.unit_mm, c[i + 1] = p.Y() / file_.unit_mm,
        c[i + 2] = p.Z() / file_.unit_mm;
      }
      if (is_moved && place.IsNegative())
        for (std::size_t axis = 0; axis < 3; ++axis) std::swap(c[axis], c[3 + axis]);
    }
    return triangles;
  }

  void clear() {
    context_.Nullify();
    faces_.Clear();
    places_.clear();
    used_.Clear();
    num_uses_.clear();
    held_.clear();
  }

  const ShapeFile& file_;
  const CadLaw& law_;
  Sink& sink_;
  const Handle(BRepMesh_MeshAlgoFactory) algorithms_ = new BRepMesh_MeshAlgoFactory;
  // Of the bodies at hand.
  Handle(BRepMesh_Context) context_;
  TopTools_IndexedMapOfShape faces_, used_;
  std::map<int, int> places_;                     // in the model, by number in faces_
  std::vector<int> num_uses_;                     // that are still to come, by used_
  std::map<int, std::vector<CadTriangle>> held_;  // likewise
  std::size_t num_failed_ = 0;
};

}  // namespace

CadFacts facts_of(const ShapeFile& file) {
  CadFacts facts;
  Bnd_Box all;
  for (const Part& part : file.parts)
    for (const Body& body : part.bodies) {
      Bnd_Box box;
      BRepBndLib::AddOptimal(body.shape.Moved(part.place, false), box, false, false);
      all.Add(box);
      ++facts.num_bodies;
      TopTools_IndexedMapOfShape faces;
      TopExp::MapShapes(body.shape, TopAbs_FACE, faces);
      facts.num_faces += static_cast<std::uint64_t>(faces.Extent());
    }
  if (all.IsVoid() || all.IsOpen())
    throw Refusal("has faces without an end: export the solids of the model");
  all.SetGap(0);
  const gp_Pnt min = all.CornerMin(), max = all.CornerMax();
  const auto coordinates = [&](const gp_Pnt& p) {
    return std::array{p.X() / file.unit_mm, p.Y() / file.unit_mm, p.Z() / file.unit_mm};
  };
  facts.min = coordinates(min);
  facts.max = coordinates(max);
  facts.precision = Precision::Confusion() / file.unit_mm;
  file.unit.copy(facts.unit.data(), facts.unit.size() - 1);
  return facts;
}

void triangulate(const ShapeFile& file, const CadLaw& law, Sink& sink) {
  PartTriangulator triangulator(file, law, sink);
  for (const Part& part : file.parts) triangulator.run(part);
  if (const std::size_t failed = triangulator.num_failed(); failed > 0)
    sink.note("left out " + std::to_string(failed) + (failed == 1 ? " face" : " faces") +
              " that OpenCASCADE cannot cut into triangles");
}

}  // namespace locvol::cad
