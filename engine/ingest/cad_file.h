// CAD files: STEP, IGES, BREP. A program that is started when there is one reads them
// (cad_protocol.h), and cuts their faces into triangles.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/cad_process.h"
#include "engine/ingest/cad_protocol.h"
#include "engine/ingest/input_bytes.h"
#include "engine/ingest/surface_sink.h"
#include "octree/stop.h"

namespace locvol {

// By what the file begins with; nothing: it is no CAD file.
std::optional<CadFormat> cad_format_of(std::string_view head);
// Likewise of a file, which may be packed by gzip. Throws InputError.
std::optional<CadFormat> cad_format_of(const std::shared_ptr<const InputBytes>& bytes);

// How the faces of a file are to be cut.
struct CadCut {
  CadLaw law = {};
  bool has_bodies = false;  // of several bodies, each is one
};

// A file whose bodies are in the memory of the program that reads it. Throws InputError where it
// cannot be read, also for want of the program; Stopped; OverBudget.
class CadFile {
 public:
  // What is packed is unpacked into `directory`, which exists. `cap`: on the memory of the process;
  // 0: any.
  CadFile(std::shared_ptr<const InputBytes> bytes, CadFormat format,
          const std::filesystem::path& directory, std::uint64_t cap, const StopToken* stop);

  const CadFacts& facts() const { return facts_; }
  const std::string& digest() const { return digest_; }
  // Gives all to the sink: bodies, and faces as groups. A face without a name is called by its
  // number in the file, "face 7", as far as there are not too many.
  void parse(const CadCut& cut, SurfaceSink& sink, const StopToken* stop);

 private:
  CadProcess::Record next(const StopToken* stop);

  std::shared_ptr<const InputBytes> bytes_;
  std::optional<OpenFile> copy_;
  std::vector<std::string> notes_;
  std::string digest_;
  std::optional<CadProcess> process_;
  CadFacts facts_;
};

// Of the file's bytes. How faces are cut is a function of other parameters of a run.
std::string digest_of_cad(const std::shared_ptr<const InputBytes>& bytes, const StopToken* stop);

}  // namespace locvol
