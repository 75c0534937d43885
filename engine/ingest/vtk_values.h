// The numbers of one array of a VTK XML file, whichever of the many ways they are written in.
//
// As bytes (binary and appended), in base64 or raw, after a head of words of 4 or 8 bytes:
//
//   not compressed   num_bytes | the values
//   by zlib          num_blocks, block_bytes, last_bytes, compressed_bytes of each | the blocks
//
// block_bytes are those of a block once it is decompressed; the last block has last_bytes, or, if
// that is 0, is no different. In base64 the head may end with padding, or not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "engine/ingest/input_file.h"
#include "engine/ingest/number_bytes.h"

namespace locvol {

// The type that VTK spells so, such as "Float32".
std::optional<NumberType> vtk_type_named(std::string_view name);

struct VtkArray {
  enum class Encoding { kAscii, kBase64, kRaw };

  std::string name;
  NumberType type = NumberType::kFloat32;
  std::uint64_t num_values = 0;                // 1 or more, 8 bytes each below 2^64
  std::string_view counted_by = "its extent";  // which needs so many, for messages
  Encoding encoding = Encoding::kAscii;
  std::uint64_t place = 0;  // in the file, of its first character or byte
  bool is_inline = true;    // in an element of its own: a '<' ends it
  bool is_big_endian = false;
  bool has_wide_head = false;  // words of 8 bytes
  bool is_compressed = false;  // unless it is ASCII
};

// Holds a block of at most 64 MiB and its compressed form, a table with 4 bytes for each block, of
// at most 2^24, and a buffer.
class VtkValues {
 public:
  virtual ~VtkValues() = default;
  // The next ones. REQUIRES: no more, over all calls, than array.num_values. Throws InputError:
  // fewer are there; they are damaged.
  virtual void read(std::span<double> values) = 0;
  // Throws InputError: there are more.
  virtual void check_end() = 0;
};

// The file outlives the result, and is used by nobody else. Throws InputError: its head contradicts
// the number of values, or itself; more than the file can hold. Both it and the result: Stopped.
std::unique_ptr<VtkValues> open_vtk_values(InputFile& file, const VtkArray& array);

}  // namespace locvol
