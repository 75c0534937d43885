#include "tools/cad/contacts.h"

#include <BOPAlgo_Builder.hxx>
#include <BRepBndLib.hxx>
#include <BRepBuilderAPI_Transform.hxx>
#include <BRepGProp.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <GProp_GProps.hxx>
#include <TopExp.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_IndexedMapOfShape.hxx>
#include <TopTools_ListOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "octree/disjoint_sets.h"

namespace locvol::cad {
namespace {

// How much a body's volume may change, over it; and how precisely it is integrated, for faces that
// are splines are not to a few 10^-3 otherwise.
constexpr double kVolume = 2e-3, kPrecision = 1e-4;

Bnd_Box box_of(const TopoDS_Shape& shape) {
  Bnd_Box box;
  BRepBndLib::Add(shape, box, false);
  return box;
}

// A solid where it is in the assembly.
struct PlacedBody {
  std::size_t body;
  TopoDS_Shape shape;
  Bnd_Box box;
  std::vector<Bnd_Box> faces;  // their boxes; made when they are asked for
};

std::vector<PlacedBody> placed_solids(const ShapeFile& file) {
  std::vector<PlacedBody> placed;
  for (std::size_t b = 0; b < file.bodies.size(); ++b) {
    const Body& body = file.bodies[b];
    if (body.shape.ShapeType() != TopAbs_SOLID) continue;
    PlacedBody& one = placed.emplace_back();
    one.body = b;
    one.shape = body.shape.Moved(file.places[body.part], false);
    one.box = box_of(one.shape);
  }
  return placed;
}

class Contacts {
 public:
  explicit Contacts(const ShapeFile& file)
      : file_(file), placed_(placed_solids(file)), sets_(placed_.size()) {}

  // Bodies each of which may touch another of them. In order.
  ContactGroups groups() {
    // From left to right, those that have begun and not ended.
    std::vector<std::size_t> order(placed_.size()), open;
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto left = [&](std::size_t p) { return placed_[p].box.CornerMin().X(); };
    std::ranges::stable_sort(order, {}, left);
    for (const std::size_t p : order) {
      std::erase_if(open, [&](std::size_t o) { return placed_[o].box.CornerMax().X() < left(p); });
      for (const std::size_t o : open)
        if (sets_.find(o) != sets_.find(p) && may_touch(o, p)) sets_.unite(o, p);
      open.push_back(p);
    }
    std::map<std::size_t, std::vector<std::size_t>> groups;
    for (std::size_t p = 0; p < placed_.size(); ++p)
      groups[sets_.find(p)].push_back(placed_[p].body);
    ContactGroups several;
    for (auto& [first, bodies] : groups)
      if (bodies.size() > 1) several.push_back(std::move(bodies));
    return several;
  }

 private:
  // Solids of one part that have a face in common have been made so: they touch nowhere else.
  bool may_touch(std::size_t one, std::size_t other) {
    PlacedBody &a = placed_[one], &b = placed_[other];
    if (a.box.IsOut(b.box)) return false;
    if (file_.bodies[a.body].part == file_.bodies[b.body].part && have_common_face(a, b))
      return false;
    for (PlacedBody* body : {&a, &b})
      if (body->faces.empty())
        for (TopExp_Explorer f(body->shape, TopAbs_FACE); f.More(); f.Next())
          body->faces.push_back(box_of(f.Current()));
    return std::ranges::any_of(a.faces, [&](const Bnd_Box& face) {
      return !face.IsOut(b.box) && std::ranges::any_of(b.faces, [&](const Bnd_Box& of_other) {
        return !face.IsOut(of_other);
      });
    });
  }

  static bool have_common_face(const PlacedBody& a, const PlacedBody& b) {
    TopTools_IndexedMapOfShape faces;
    TopExp::MapShapes(a.shape, TopAbs_FACE, faces);
    for (TopExp_Explorer f(b.shape, TopAbs_FACE); f.More(); f.Next())
      if (faces.Contains(f.Current())) return true;
    return false;
  }

  const ShapeFile& file_;
  std::vector<PlacedBody> placed_;
  DisjointSets sets_;  // of those that are placed
};

double volume_of(const TopoDS_Shape& shape) {
  GProp_GProps facts;
  BRepGProp::VolumeProperties(shape, facts, kPrecision);
  return facts.Mass();
}

// Edges at which there are not two faces, or the two ends of one.
std::size_t num_bad_edges(const TopoDS_Shape& shape) {
  TopTools_IndexedMapOfShape edges;
  std::vector<int> uses;
  for (TopExp_Explorer f(shape, TopAbs_FACE); f.More(); f.Next())
    for (TopExp_Explorer e(f.Current(), TopAbs_EDGE); e.More(); e.Next()) {
      if (e.Current().Orientation() > TopAbs_REVERSED) continue;
      if (BRep_Tool::Degenerated(TopoDS::Edge(e.Current()))) continue;
      const auto edge = static_cast<std::size_t>(edges.Add(e.Current()) - 1);
      if (edge == uses.size()) uses.push_back(0);
      ++uses[edge];
    }
  return static_cast<std::size_t>(std::ranges::count_if(uses, [](int n) { return n != 2; }));
}

// Bodies that are fused, as they were and as they become.
class Fusion {
 public:
  Fusion(const ShapeFile& file, const std::vector<std::size_t>& bodies, std::size_t part) {
    for (const std::size_t b : bodies) {
      const Body& body = file.bodies[b];
      // In place, with geometry of its own: what lies twice in a model is cut once.
      BRepBuilderAPI_Transform placing(body.shape, file.places[body.part], true);
      Body& moved = bodies_.emplace_back(body);
      moved.part = part;
      moved.shape = placing.Shape();
      for (BodyFace& face : moved.faces)
        for (TopoDS_Face& piece : face.pieces) piece = TopoDS::Face(placing.ModifiedShape(piece));
    }
  }

  // By body, as they were given: what is cut now; nothing: it is as it was. False: OpenCASCADE
  // cannot do it, or has opened a body or changed its volume.
  bool run() {
    for (const Body& body : bodies_) builder_.AddArgument(body.shape);
    builder_.SetRunParallel(false);
    builder_.SetUseOBB(true);
    builder_.Perform();
    if (builder_.HasErrors()) return false;
    for (const Body& body : bodies_) {
      fused_.emplace_back();
      if (is_changed(body) && !(fused_.back() = fused(body))) return false;
    }
    return true;
  }

  std::vector<std::optional<Body>>& fused() { return fused_; }

 private:
  bool is_changed(const Body& body) {
    return std::ranges::any_of(body.faces, [&](const BodyFace& face) {
      return builder_.IsDeleted(face.pieces.front()) ||
             !builder_.Modified(face.pieces.front()).IsEmpty();
    });
  }

  std::optional<Body> fused(const Body& body) {
    // Of the solids that it consists of now, what two have lies within it.
    TopTools_IndexedMapOfShape sides;
    std::vector<int> uses;
    TopTools_ListOfShape solids = builder_.Modified(body.shape);
    if (solids.IsEmpty()) solids.Append(body.shape);
    for (const TopoDS_Shape& solid : solids)
      for (TopExp_Explorer f(solid, TopAbs_FACE); f.More(); f.Next()) {
        if (f.Current().Orientation() > TopAbs_REVERSED) continue;
        const auto side = static_cast<std::size_t>(sides.Add(f.Current()) - 1);
        if (side == uses.size()) uses.push_back(0);
        ++uses[side];
      }
    Body made = body;
    TopoDS_Compound all;
    BRep_Builder().MakeCompound(all);
    for (BodyFace& face : made.faces) {
      TopTools_ListOfShape pieces = builder_.Modified(face.pieces.front());
      if (pieces.IsEmpty() && !builder_.IsDeleted(face.pieces.front()))
        pieces.Append(face.pieces.front());
      face.pieces.clear();
      for (const TopoDS_Shape& piece : pieces) {
        const int side = sides.FindIndex(piece);
        if (side == 0) continue;
        if (int& num_uses = uses[static_cast<std::size_t>(side - 1)]; num_uses == 1)
          num_uses = 0;
        else
          continue;
        face.pieces.push_back(TopoDS::Face(sides(side)));
        BRep_Builder().Add(all, sides(side));
      }
    }
    made.shape = all;
    if (std::ranges::count(uses, 1) > 0) return std::nullopt;  // of no face of the file
    // Where all sides were turned inwards, they may be turned back.
    const double before = std::abs(volume_of(body.shape)), now = std::abs(volume_of(all));
    if (!(std::abs(now - before) <= kVolume * before)) return std::nullopt;
    if (num_bad_edges(all) > num_bad_edges(body.shape)) return std::nullopt;
    return made;
  }

  BOPAlgo_Builder builder_;
  std::vector<Body> bodies_;
  std::vector<std::optional<Body>> fused_;
};

bool fuse(ShapeFile& file, const std::vector<std::size_t>& bodies) {
  try {
    Fusion fusion(file, bodies, file.places.size());
    if (!fusion.run()) return false;
    for (std::size_t i = 0; i < bodies.size(); ++i)
      if (fusion.fused()[i]) file.bodies[bodies[i]] = *std::move(fusion.fused()[i]);
    file.places.emplace_back();
    return true;
  } catch (const Standard_Failure&) {
    return false;
  }
}

void tell_unfused(std::size_t num_bodies, Sink& sink) {
  sink.note("OpenCASCADE cannot fuse " + std::to_string(num_bodies) +
            " solids that touch or cross: where faces of two are one, their triangles differ");
}

}  // namespace

ContactGroups contact_groups(const ShapeFile& file) { return Contacts(file).groups(); }

void fuse_contacts(ShapeFile& file, const ContactGroups& groups, Sink& sink) {
  std::size_t num_left = 0;
  for (const std::vector<std::size_t>& bodies : groups)
    if (!fuse(file, bodies)) num_left += bodies.size();
  if (num_left > 0) tell_unfused(num_left, sink);
}

void tell_unfused(const ContactGroups& groups, Sink& sink) {
  std::size_t num_bodies = 0;
  for (const std::vector<std::size_t>& bodies : groups) num_bodies += bodies.size();
  tell_unfused(num_bodies, sink);
}

}  // namespace locvol::cad
