#include "engine/formats/deflate.h"

#include <libdeflate.h>

#include <memory>
#include <new>

namespace locvol {
namespace {

constexpr int kLevel = 1;

struct FreeCompressor {
  void operator()(libdeflate_compressor* compressor) const {
    libdeflate_free_compressor(compressor);
  }
};

struct FreeDecompressor {
  void operator()(libdeflate_decompressor* decompressor) const {
    libdeflate_free_decompressor(decompressor);
  }
};

}  // namespace

std::vector<std::byte> deflated(std::span<const std::byte> bytes) {
  const std::unique_ptr<libdeflate_compressor, FreeCompressor> compressor(
      libdeflate_alloc_compressor(kLevel));
  if (!compressor) throw std::bad_alloc();
  std::vector<std::byte> result(libdeflate_zlib_compress_bound(compressor.get(), bytes.size()));
  result.resize(libdeflate_zlib_compress(compressor.get(), bytes.data(), bytes.size(),
                                         result.data(), result.size()));
  result.shrink_to_fit();
  return result;
}

bool inflate(std::span<const std::byte> bytes, std::span<std::byte> result) {
  const std::unique_ptr<libdeflate_decompressor, FreeDecompressor> decompressor(
      libdeflate_alloc_decompressor());
  if (!decompressor) throw std::bad_alloc();
  return libdeflate_zlib_decompress(decompressor.get(), bytes.data(), bytes.size(), result.data(),
                                    result.size(), nullptr) == LIBDEFLATE_SUCCESS;
}

std::vector<std::byte> shuffled(std::span<const std::byte> bytes, std::size_t value_bytes) {
  std::vector<std::byte> result(bytes.size());
  const std::size_t num_values = bytes.size() / value_bytes;
  for (std::size_t b = 0; b < value_bytes; ++b)
    for (std::size_t i = 0; i < num_values; ++i)
      result[b * num_values + i] = bytes[i * value_bytes + b];
  return result;
}

}  // namespace locvol
