// What the engine and the module that reads CAD files say to each other. The module is a shared
// object of its own (cad/), so that only who reads such files needs OpenCASCADE. Both sides are of
// one build. No exception crosses: what fails is told by a CadResult.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace locvol {

enum class CadFormat { kStep, kIges, kBrep };

struct CadResult {
  enum class Kind { kDone, kStopped, kRefused, kOutOfMemory } kind = Kind::kDone;
  std::string what = {};  // of kRefused: what is wrong with the file, and the cure
};

// What a file holds, as it is known before its faces are cut into triangles. Lengths are in the
// file's own unit.
struct CadFacts {
  std::array<double, 3> min = {}, max = {};  // of the box around its bodies
  std::uint64_t num_bodies = 0, num_faces = 0;
  std::string unit = {};  // "mm", "inch", …; empty: the format has none
};

// How finely faces are cut.
struct CadLaw {
  double deflection = 0;     // how far a triangle or an edge may be from the face or the curve
  double angle_degrees = 0;  // how much an edge may turn from its neighbor
};

// The engine's side. No function throws, and each returns false if the module is to end.
class CadWatch {
 public:
  virtual ~CadWatch() = default;
  virtual bool may_go_on() = 0;
  virtual bool note(const std::string& text) = 0;
};

struct CadColor {
  std::uint8_t red = 0, green = 0, blue = 0;
};

class CadSink : public CadWatch {
 public:
  // What comes from here on is another body.
  virtual bool body(const std::string& name) = 0;
  // What comes from here on is on this face. `name`: empty if it has none. `color` may be null.
  virtual bool face(const std::string& name, const CadColor* color) = 0;
  // So many triangles, nine coordinates each; seen from outside, corners turn counterclockwise.
  virtual bool triangles(std::span<const std::array<double, 9>> corners) = 0;
};

// What has been read of a file: bodies that are bounded by curved faces.
class CadModel {
 public:
  virtual ~CadModel() = default;
  virtual const CadFacts& facts() const = 0;
  // Bodies, faces of a body and triangles come in an order that is a function of the file alone.
  virtual CadResult triangulate(const CadLaw& law, CadSink& sink) = 0;
};

struct CadModule {
  // Both sides are to be of one build: the engine compares it with its own.
  std::uint32_t version = 0;
  CadResult (*read)(const char* file, CadFormat format, CadWatch& watch,
                    std::unique_ptr<CadModel>& model) = nullptr;
};
inline constexpr std::uint32_t kCadVersion = 1;
inline constexpr char kCadEntry[] = "locvol_cad_module";  // const CadModule* (), extern "C"
inline constexpr char kCadFile[] = "locvol_cad.so";

}  // namespace locvol
