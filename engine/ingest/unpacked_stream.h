// UnpackedStream: what packed bytes are, from front to back.
#pragma once

#include <cstddef>
#include <span>

namespace locvol {

class UnpackedStream {
 public:
  virtual ~UnpackedStream() = default;
  // The next ones, up to that many; 0 at the end only. Throws InputError: they are damaged or cut
  // off. REQUIRES: !unpacked.empty()
  virtual std::size_t read(std::span<char> unpacked) = 0;
};

}  // namespace locvol
