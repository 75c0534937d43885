// Compression as zlib's format has it, for VTK and HDF5.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace locvol {

// Level 1 is fast; the bytes are the same on any machine with the same libdeflate.
std::vector<std::byte> deflated(std::span<const std::byte> bytes);
// The inverse, into `result`. False: `bytes` are damaged, or stand for fewer bytes or more.
bool inflate(std::span<const std::byte> bytes, std::span<std::byte> result);
// HDF5's shuffle: the first bytes of all values, then the second ones, and so on.
std::vector<std::byte> shuffled(std::span<const std::byte> bytes, std::size_t value_bytes);

}  // namespace locvol
