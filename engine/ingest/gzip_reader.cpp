#include "engine/ingest/gzip_reader.h"

#include <fmt/format.h>
#include <zlib.h>

#include <new>

namespace locvol {
namespace {

constexpr std::size_t kPackedBytes = std::size_t{1} << 16;
constexpr unsigned char kMagic[3] = {0x1f, 0x8b, 8};  // two bytes of gzip's, and its one method
constexpr int kWindowBits = 15 + 16;                  // the largest; and 16: a gzip header

}  // namespace

struct GzipReader::Stream {
  Stream() {
    if (inflateInit2(&z, kWindowBits) != Z_OK) throw std::bad_alloc();
  }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  ~Stream() { inflateEnd(&z); }

  z_stream z{};
};

bool GzipReader::is_gzip(const InputBytes& bytes) {
  char head[sizeof kMagic];
  if (bytes.read_at(0, head) < sizeof head) return false;
  for (std::size_t i = 0; i < sizeof head; ++i)
    if (static_cast<unsigned char>(head[i]) != kMagic[i]) return false;
  return true;
}

GzipReader::GzipReader(const InputBytes& bytes)
    : bytes_(&bytes), packed_(kPackedBytes), stream_(std::make_unique<Stream>()) {}
GzipReader::GzipReader(GzipReader&&) noexcept = default;
GzipReader& GzipReader::operator=(GzipReader&&) noexcept = default;
GzipReader::~GzipReader() = default;

std::size_t GzipReader::read(std::span<char> unpacked) {
  z_stream& z = stream_->z;
  z.next_out = reinterpret_cast<Bytef*>(unpacked.data());
  z.avail_out = static_cast<uInt>(unpacked.size());
  while (z.avail_out == unpacked.size() && !is_at_end_) {
    if (z.avail_in == 0 && !load())
      bytes_->refuse(
          fmt::format("is cut off: what gzip has packed goes on after its {} bytes; fetch or pack "
                      "it again",
                      num_loaded_));
    switch (inflate(&z, Z_NO_FLUSH)) {
      case Z_OK:
      case Z_BUF_ERROR:  // it needs more bytes
        break;
      case Z_STREAM_END:
        end_member();
        break;
      case Z_MEM_ERROR:
        throw std::bad_alloc();
      default:
        bytes_->refuse(
            fmt::format("what gzip has packed is damaged before byte {} ({}); fetch or "
                        "pack it again",
                        num_loaded_ - z.avail_in, z.msg ? z.msg : "unknown"));
    }
  }
  return unpacked.size() - z.avail_out;
}

bool GzipReader::load() {
  z_stream& z = stream_->z;
  const std::size_t count = bytes_->read_at(num_loaded_, packed_);
  z.next_in = reinterpret_cast<Bytef*>(packed_.data());
  z.avail_in = static_cast<uInt>(count);
  num_loaded_ += count;
  return count > 0;
}

// Another member follows, or zeros, as tapes have them, or nothing.
void GzipReader::end_member() {
  z_stream& z = stream_->z;
  bool has_zeros = false;
  for (;;) {
    if (z.avail_in == 0 && !load()) {
      is_at_end_ = true;
      return;
    }
    if (*z.next_in != 0) break;
    has_zeros = true;
    ++z.next_in;
    --z.avail_in;
  }
  if (has_zeros || *z.next_in != kMagic[0])
    bytes_->refuse(
        fmt::format("goes on after what gzip has packed, at byte {}; unpack it, and look at what "
                    "comes out",
                    num_loaded_ - z.avail_in));
  inflateReset(&z);
}

}  // namespace locvol
