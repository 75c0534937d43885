// GzipReader unpacks, as a stream, what gzip has packed: one member after another, as `cat a.gz
// b.gz` makes them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "engine/ingest/input_bytes.h"
#include "engine/ingest/unpacked_stream.h"

namespace locvol {

// Holds 40 KB, and a buffer of 64 KB. Throws InputError: the packed bytes are damaged, cut off, or
// followed by something else than zeros.
class GzipReader : public UnpackedStream {
 public:
  static bool is_gzip(const InputBytes& bytes);

  explicit GzipReader(const InputBytes& bytes);  // which outlives it
  GzipReader(GzipReader&&) noexcept;
  GzipReader& operator=(GzipReader&&) noexcept;
  ~GzipReader() override;

  std::size_t read(std::span<char> unpacked) override;

 private:
  struct Stream;
  bool load();  // false: all packed bytes are taken
  void end_member();

  const InputBytes* bytes_;
  std::vector<char> packed_;
  std::uint64_t num_loaded_ = 0;  // packed bytes
  bool is_at_end_ = false;
  std::unique_ptr<Stream> stream_;
};

}  // namespace locvol
