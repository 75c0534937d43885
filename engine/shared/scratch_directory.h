// A directory for the files of one run.
#pragma once

#include <stdlib.h>

#include <cerrno>
#include <filesystem>
#include <string>
#include <system_error>

#include "engine/shared/input_error.h"

namespace locvol {

// The directory for files that belong to no store. Throws InputError if the environment names none.
inline std::filesystem::path temporary_directory() {
  std::error_code error;
  std::filesystem::path directory = std::filesystem::temp_directory_path(error);
  if (error)
    throw InputError(
        "there is no directory for temporary files: set TMPDIR to one that exists, or unset it");
  return directory;
}

// A directory of its own, removed at the end. Throws std::system_error if none can be made.
class ScratchDirectory {
 public:
  explicit ScratchDirectory(const std::filesystem::path& parent) {
    std::string path = (parent / "locvol-XXXXXX").string();
    if (mkdtemp(path.data()) == nullptr)
      throw std::system_error(errno, std::generic_category(),
                              "cannot make a directory for the run in " + parent.string());
    path_ = path;
  }
  ScratchDirectory(const ScratchDirectory&) = delete;
  ScratchDirectory& operator=(const ScratchDirectory&) = delete;
  ~ScratchDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace locvol
