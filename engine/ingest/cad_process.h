// The program that reads CAD files, while it runs (cad_protocol.h).
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>

#include "engine/ingest/cad_protocol.h"
#include "engine/shared/partial_file.h"
#include "octree/stop.h"

namespace locvol {

// Ended with its owner, whatever it is doing. Errors: std::system_error where it cannot be started.
class CadProcess {
 public:
  // Where the program is: beside the running one as it is installed or built, or where the
  // environment's LOCVOL_CAD says. Nothing: it is not there.
  static std::optional<std::filesystem::path> program();

  // `bytes`: read instead of the file, of which there is no path.
  CadProcess(const std::filesystem::path& program, const std::filesystem::path& file,
             CadFormat format, const OpenFile* bytes);
  CadProcess(const CadProcess&) = delete;
  CadProcess& operator=(const CadProcess&) = delete;
  ~CadProcess();

  struct Record {
    CadRecord kind;
    std::string bytes;
  };
  // Waits for the next. Nothing: the program has ended without a word, for a fault of its own.
  // Throws Stopped.
  std::optional<Record> next(const StopToken* stop);
  void ask(const CadLaw& law);

 private:
  bool read(void* bytes, std::size_t count, const StopToken* stop);

  pid_t process_ = -1;
  std::optional<OpenFile> to_, from_;
};

}  // namespace locvol
