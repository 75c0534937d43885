// SHA-256 (FIPS 180-4).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace locvol {

class Sha256 {
 public:
  void update(const void* data, std::size_t bytes);
  std::string hex_digest();  // 64 hexadecimal digits; ends the use of this object

 private:
  void compress(const unsigned char* block);

  std::array<std::uint32_t, 8> state_ = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                         0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<unsigned char, 64> block_{};  // what waits for a whole block
  std::uint64_t num_bytes_ = 0;
};

}  // namespace locvol
