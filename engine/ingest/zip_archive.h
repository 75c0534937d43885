// ZipArchive: the files that a zip archive holds, of any size (Zip64), as streams.
//
// An archive ends in its directory, and that in a record which says where it begins. Each entry
// there names the place of a local head, which is followed by the packed bytes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/input_bytes.h"
#include "engine/ingest/input_file.h"
#include "octree/stop.h"

namespace locvol {

class ZipArchive {
 public:
  static bool is_zip(const InputBytes& bytes);

  // Memory: its directory, of 16 MiB at most. Throws InputError: it is damaged, cut off, or in
  // several files.
  explicit ZipArchive(std::shared_ptr<const InputBytes> bytes);

  struct Entry {
    std::string name;
    std::uint64_t size = 0, packed_size = 0;
    std::uint64_t head = 0;  // place of its local head
    std::uint32_t crc = 0;
    unsigned method = 0, flags = 0;
  };
  const std::vector<Entry>& entries() const { return entries_; }
  // Whatever the case of its letters; null: there is none.
  const Entry* find(std::string_view name) const;
  // What reads it to its end throws InputError where its bytes are damaged. Throws InputError: it
  // is encrypted, or packed in another way than zip's usual one.
  InputFile open(const Entry& entry, const StopToken* stop) const;

 private:
  struct Directory {
    std::uint64_t place = 0, bytes = 0, num_entries = 0;
  };
  Directory find_directory() const;
  void read_entries(const Directory& directory);
  std::vector<unsigned char> read(std::uint64_t place, std::uint64_t bytes) const;

  std::shared_ptr<const InputBytes> bytes_;
  std::vector<Entry> entries_;
};

}  // namespace locvol
