// Where what is read of a file goes: to the engine, record by record.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/cad_protocol.h"

namespace locvol::cad {

// Once nobody reads any more, the process ends: nobody is there to be told.
class Sink {
 public:
  void note(const std::string& text) { write(CadRecord::kNote, text.data(), text.size()); }
  void facts(const CadFacts& facts) { write(CadRecord::kFacts, &facts, sizeof facts); }
  void body(const std::string& name) { write(CadRecord::kBody, name.data(), name.size()); }
  void face(const std::string& name, const CadColor& color);
  void triangles(std::span<const CadTriangle> triangles) {
    write(CadRecord::kTriangles, triangles.data(), triangles.size_bytes());
  }
  void end() { write(CadRecord::kEnd, nullptr, 0); }
  void refuse(const std::string& text) { write(CadRecord::kRefusal, text.data(), text.size()); }
  void tell_out_of_memory() { write(CadRecord::kOutOfMemory, nullptr, 0); }

 private:
  static void write(CadRecord kind, const void* bytes, std::uint64_t length);
};

}  // namespace locvol::cad
