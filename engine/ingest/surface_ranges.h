// SurfaceRanges reads parts of a surface file, each of which may be read by another process: of a
// format, and a file, in which all faces are triangles that take as many bytes.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "engine/ingest/input_file.h"
#include "engine/ingest/surface_sink.h"

namespace locvol {

class SurfaceRanges {
 public:
  virtual ~SurfaceRanges() = default;
  std::string name() const { return file_.path().string(); }
  std::uint64_t num_bytes() const { return file_.size(); }
  std::uint64_t num_faces() const { return num_faces_; }
  std::uint64_t num_vertices() const { return num_vertices_; }  // 0 where faces name none
  // Gives the sink the triangles of one of `num_parts` parts of about as many faces, as facets, and
  // looks at as much of the vertices. Memory: 25 MB where faces name vertices. Throws InputError
  // for what is wrong there, or if it is no file of triangles alone; Stopped.
  virtual void read_part(std::uint64_t part, std::uint64_t num_parts, SurfaceSink& sink) = 0;

 protected:
  SurfaceRanges(InputFile file, std::uint64_t num_faces, std::uint64_t num_vertices)
      : file_(std::move(file)), num_faces_(num_faces), num_vertices_(num_vertices) {}

  InputFile file_;

 private:
  std::uint64_t num_faces_, num_vertices_;
};

// The place where one of `num_parts` parts of `num` things begins.
inline std::uint64_t begin_of_part(std::uint64_t num, std::uint64_t part, std::uint64_t num_parts) {
  return num / num_parts * part + num % num_parts * part / num_parts;
}

}  // namespace locvol
