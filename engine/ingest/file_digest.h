// SHA-256 of a file's bytes: the name by which a store knows its input.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>

#include "octree/stop.h"

namespace locvol {

class Sha256 {
 public:
  Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  ~Sha256();
  void update(const void* data, std::size_t bytes);
  std::string hex_digest();  // 64 hexadecimal digits; ends the use of this object

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Throws InputError as InputFile does, Stopped.
std::string digest_of_file(const std::filesystem::path& file, const StopToken* stop = nullptr);

}  // namespace locvol
