// What the engine and the program that reads CAD files (tools/cad/) say to each other. It is a
// program of its own, so that only who reads such files needs OpenCASCADE, and so that a damaged
// file which OpenCASCADE does not survive is an error like others.
//
// The program is started with the file's path and its format. It writes records to the descriptor
// kCadOutput:
//
//   | kind u8 | length u64 | so many bytes |
//
// in the machine's byte order, for both sides are of one build: notes, then the facts; and for each
// CadLaw that it reads from its standard input, bodies, faces and triangles, and the end. A refusal
// ends it, as the end of its input does.
#pragma once

#include <array>
#include <cstdint>

namespace locvol {

enum class CadFormat : std::uint8_t { kStep, kIges, kBrep };
inline constexpr std::array<const char*, 3> kCadFormatNames = {"STEP", "IGES", "BREP"};

enum class CadRecord : std::uint8_t {
  kNote,       // text
  kFacts,      // CadFacts
  kBody,       // name: what comes from here on is another body
  kFace,       // CadColor, and its name, which may be empty: what comes from here on is on it
  kTriangles,  // CadTriangle, so many; seen from outside, corners turn counterclockwise
  kEnd,        // of what a law asked for
  kRefusal,    // what is wrong with the file, and the cure
  kOutOfMemory
};

// As it is known before faces are cut into triangles. Lengths are in the file's own unit.
struct CadFacts {
  std::array<double, 3> min = {}, max = {};  // of the box around its bodies
  std::uint64_t num_bodies = 0, num_faces = 0;
  double precision = 0;            // points that are closer are one
  std::array<char, 32> unit = {};  // "mm", "inch", …, and zeros; empty: the format has none
};

// How finely faces are cut.
struct CadLaw {
  double deflection = 0;     // how far a triangle or an edge may be from the face or the curve
  double angle_degrees = 0;  // how much an edge may turn from its neighbor
};

struct CadColor {
  std::uint8_t is_given = 0, red = 0, green = 0, blue = 0;
};

using CadTriangle = std::array<double, 9>;

inline constexpr int kCadOutput = 3;             // a descriptor of the program
inline constexpr int kCadInput = 4;              // that of the file, where it has no path
inline constexpr const char* kCadVersion = "2";  // its third argument: both are of one build
inline constexpr const char* kCadProgram = "locvol-cad";

}  // namespace locvol
