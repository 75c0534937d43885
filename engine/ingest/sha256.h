// SHA-256: the name by which a store knows its input.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace locvol {

class Sha256 {
 public:
  Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  ~Sha256();
  void update(const void* data, std::size_t bytes);
  // All that it has of what it was given, for another process of the same program to go on with.
  std::string state() const;
  static Sha256 from_state(std::string_view state);  // REQUIRES: it is a state()
  std::string hex_digest();  // 64 hexadecimal digits; ends the use of this object

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace locvol
