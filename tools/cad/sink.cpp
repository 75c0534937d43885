#include "tools/cad/sink.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace locvol::cad {
namespace {

void write_all(const void* bytes, std::uint64_t length) {
  const auto* place = static_cast<const char*>(bytes);
  while (length > 0) {
    const ssize_t count = ::write(kCadOutput, place, length);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) ::_exit(1);
    place += count;
    length -= static_cast<std::uint64_t>(count);
  }
}

}  // namespace

void Sink::write(CadRecord kind, const void* bytes, std::uint64_t length) {
  write_all(&kind, sizeof kind);
  write_all(&length, sizeof length);
  write_all(bytes, length);
}

void Sink::face(const std::string& name, const CadColor& color) {
  std::string bytes(sizeof color, '\0');
  std::memcpy(bytes.data(), &color, sizeof color);
  bytes += name;
  write(CadRecord::kFace, bytes.data(), bytes.size());
}

}  // namespace locvol::cad
