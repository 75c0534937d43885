// Numbers as files keep them: their types, and what bytes of a file say.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace locvol {

enum class NumberType {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kInt64,
  kUint64,
  kFloat32,
  kFloat64
};

constexpr std::size_t bytes_of(NumberType type) {
  constexpr std::array<std::size_t, 10> kBytes = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kBytes[static_cast<std::size_t>(type)];
}
constexpr bool is_integer(NumberType type) {
  return type != NumberType::kFloat32 && type != NumberType::kFloat64;
}

// Of 8 bytes or less.
template <class Byte>
std::uint64_t bits_in(const Byte* bytes, std::size_t num_bytes, bool is_big_endian) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < num_bytes; ++i)
    bits = bits << 8 | static_cast<std::uint64_t>(bytes[is_big_endian ? i : num_bytes - 1 - i]);
  return bits;
}

// Below 0 also for what is above 2^63 - 1. REQUIRES: is_integer(type)
template <class Byte>
std::int64_t integer_in(const Byte* bytes, NumberType type, bool is_big_endian) {
  const std::uint64_t bits = bits_in(bytes, bytes_of(type), is_big_endian);
  switch (type) {
    case NumberType::kInt8:
      return static_cast<std::int8_t>(bits);
    case NumberType::kInt16:
      return static_cast<std::int16_t>(bits);
    case NumberType::kInt32:
      return static_cast<std::int32_t>(bits);
    default:
      return static_cast<std::int64_t>(bits);
  }
}

template <class Byte>
double number_in(const Byte* bytes, NumberType type, bool is_big_endian) {
  if (type == NumberType::kFloat32)
    return std::bit_cast<float>(static_cast<std::uint32_t>(bits_in(bytes, 4, is_big_endian)));
  if (type == NumberType::kFloat64) return std::bit_cast<double>(bits_in(bytes, 8, is_big_endian));
  if (type == NumberType::kUint64) return static_cast<double>(bits_in(bytes, 8, is_big_endian));
  return static_cast<double>(integer_in(bytes, type, is_big_endian));
}

}  // namespace locvol
