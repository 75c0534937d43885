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
#include <tuple>
#include <utility>

#include "octree/disjoint_sets.h"

namespace locvol::cad {
namespace {

// Bodies of one part that have faces or edges in common are cut together, so that these are cut
// once. By body: the first of those that it is cut with.
std::vector<std::size_t> first_joined(const std::vector<Body>& bodies) {
  DisjointSets sets(bodies.size());
  struct Edges {
    TopTools_IndexedMapOfShape all;
    std::vector<std::size_t> first_with;  // by edge
  };
  std::map<std::size_t, Edges> edges_of;  // by part
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    auto& [edges, first_with] = edges_of[bodies[b].part];
    for (TopExp_Explorer e(bodies[b].shape, TopAbs_EDGE); e.More(); e.Next()) {
      const auto edge = static_cast<std::size_t>(edges.Add(e.Current()) - 1);
      if (edge == first_with.size()) first_with.push_back(b);
      sets.unite(first_with[edge], b);
    }
  }
  std::vector<std::size_t> firsts;
  for (std::size_t b = 0; b < bodies.size(); ++b) firsts.push_back(sets.find(b));
  return firsts;
}

// What bodies that are cut together have between them, while faces are given away one by one.
class JoinedFaces {
 public:
  // Cuts the edges. Throws Refusal.
  JoinedFaces(const std::vector<const Body*>& bodies, const IMeshTools_Parameters& parameters)
      : context_(new BRepMesh_Context), num_bodies_(bodies.size()) {
    TopoDS_Compound all;
    BRep_Builder().MakeCompound(all);
    for (const Body* body : bodies) BRep_Builder().Add(all, body->shape);
    BRepTools::Clean(all);  // of triangles that the file has
    for (const Body* body : bodies) count_uses(*body);
    context_->ChangeParameters() = parameters;
    context_->SetShape(all);
    const bool has_edges = context_->BuildModel() && context_->DiscretizeEdges();
    if (!has_edges || !context_->HealModel() || !context_->PreProcessModel())
      throw Refusal("has edges that cannot be cut into segments: repair it in a CAD program");
    const Handle(IMeshData_Model)& model = context_->GetModel();
    for (int f = 0; f < model->FacesNb(); ++f)
      places_.emplace(faces_.Add(model->GetFace(f)->GetFace()), f);
  }

  // As seen from where the face's body is not; nothing: the face cannot be cut. One that two bodies
  // have is kept until the second has got it.
  std::vector<CadTriangle> triangles_of(const TopoDS_Face& face) {
    const int number = used_.FindIndex(face);
    const bool is_last = --num_uses_[static_cast<std::size_t>(number - 1)] == 0;
    if (const auto held = held_.find(number); held != held_.end()) {
      std::vector<CadTriangle> triangles = held->second.triangles;
      if (face.Orientation() != held->second.orientation) turn(triangles);
      if (is_last) held_.erase(held);
      return triangles;
    }
    std::vector<CadTriangle> triangles = cut(face);
    if (!is_last) held_.emplace(number, Held{triangles, face.Orientation()});
    return triangles;
  }

  // True: the faces of all bodies have been given away.
  bool end_body() { return --num_bodies_ == 0; }

  static void turn(std::vector<CadTriangle>& triangles) {
    for (CadTriangle& c : triangles)
      for (std::size_t axis = 0; axis < 3; ++axis) std::swap(c[axis], c[3 + axis]);
  }

 private:
  struct Held {
    std::vector<CadTriangle> triangles;
    TopAbs_Orientation orientation;
  };

  void count_uses(const Body& body) {
    for (const BodyFace& face : body.faces)
      for (const TopoDS_Face& piece : face.pieces) {
        const auto number = static_cast<std::size_t>(used_.Add(piece) - 1);
        if (number == num_uses_.size()) num_uses_.push_back(0);
        ++num_uses_[number];
      }
  }

  std::vector<CadTriangle> cut(const TopoDS_Face& face) {
    const auto place = places_.find(faces_.FindIndex(face));
    if (place == places_.end()) return {};  // it has no surface
    const IMeshData::IFaceHandle& model = context_->GetModel()->GetFace(place->second);
    if (!model->IsSet(IMeshData_Failure)) try {
        const Handle(IMeshTools_MeshAlgo) algorithm =
            algorithms_->GetAlgo(model->GetSurface()->GetType(), context_->GetParameters());
        if (!algorithm.IsNull())
          algorithm->Perform(model, context_->GetParameters(), Message_ProgressRange());
      } catch (const Standard_Failure&) {
        // There is no triangulation then.
      }
    TopLoc_Location location;
    const Handle(Poly_Triangulation) triangles = BRep_Tool::Triangulation(face, location);
    if (triangles.IsNull()) return {};
    const std::vector<gp_Pnt> nodes = nodes_of(*triangles, location, model);
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

  const Handle(BRepMesh_MeshAlgoFactory) algorithms_ = new BRepMesh_MeshAlgoFactory;
  Handle(BRepMesh_Context) context_;
  std::size_t num_bodies_;  // that are still to come
  TopTools_IndexedMapOfShape faces_, used_;
  std::map<int, int> places_;  // in the model, by number in faces_
  std::vector<int> num_uses_;  // that are still to come, by used_
  std::map<int, Held> held_;   // likewise
};

// Bodies in the order of the file.
class Triangulator {
 public:
  Triangulator(const ShapeFile& file, const CadLaw& law, Sink& sink)
      : file_(file), sink_(sink), firsts_(first_joined(file.bodies)) {
    for (std::size_t b = 0; b < file.bodies.size(); ++b)
      with_[firsts_[b]].push_back(&file.bodies[b]);
    parameters_.Deflection = parameters_.DeflectionInterior = law.deflection * file.unit_mm;
    parameters_.Angle = parameters_.AngleInterior = law.angle_degrees * std::numbers::pi / 180;
    parameters_.MinSize = std::max(IMeshTools_Parameters::RelMinSize() * parameters_.Deflection,
                                   Precision::Confusion());
    parameters_.CleanModel = false;
  }

  void run() {
    for (std::size_t b = 0; b < file_.bodies.size(); ++b) {
      JoinedFaces& joined = joined_with(b);
      cut_faces(file_.bodies[b], joined);
      if (joined.end_body()) joined_.erase(firsts_[b]);
    }
    if (num_failed_ > 0)
      sink_.note("left out " + std::to_string(num_failed_) +
                 (num_failed_ == 1 ? " face" : " faces") +
                 " that OpenCASCADE cannot cut into triangles");
  }

 private:
  JoinedFaces& joined_with(std::size_t body) {
    if (firsts_[body] == body)
      joined_.emplace(std::piecewise_construct, std::tuple(body),
                      std::tuple(with_.at(body), parameters_));
    return joined_.at(firsts_[body]);
  }

  void cut_faces(const Body& body, JoinedFaces& joined) {
    sink_.body(body.name);
    for (const BodyFace& face : body.faces) {
      const auto name = file_.names.find(face.key);
      const auto own = file_.colors.find(face.key);
      sink_.face(name == file_.names.end() ? std::string() : name->second,
                 own == file_.colors.end() ? body.color : own->second);
      for (const TopoDS_Face& piece : face.pieces) {
        const std::vector<CadTriangle> triangles = joined.triangles_of(piece);
        if (triangles.empty()) ++num_failed_;
        sink_.triangles(placed(triangles, file_.places[body.part]));
      }
    }
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
    }
    if (is_moved && place.IsNegative()) JoinedFaces::turn(triangles);
    return triangles;
  }

  const ShapeFile& file_;
  Sink& sink_;
  IMeshTools_Parameters parameters_;
  std::vector<std::size_t> firsts_;                       // by body: with which it is cut
  std::map<std::size_t, std::vector<const Body*>> with_;  // by the first
  std::map<std::size_t, JoinedFaces> joined_;             // those that are at hand, likewise
  std::size_t num_failed_ = 0;
};

}  // namespace

CadFacts facts_of(const ShapeFile& file) {
  CadFacts facts;
  Bnd_Box all;
  for (const Body& body : file.bodies) {
    Bnd_Box box;
    BRepBndLib::AddOptimal(body.shape.Moved(file.places[body.part], false), box, false, false);
    all.Add(box);
    ++facts.num_bodies;
    facts.num_faces += body.faces.size();
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
  Triangulator(file, law, sink).run();
}

}  // namespace locvol::cad
