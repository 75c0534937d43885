// Damage to one record of a store on disk, as a failing disk would do it.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "storage/codec.h"
#include "tests/file_bytes.h"

namespace locvol {

// Flips a bit of each copy of the record in the file, so also of those that a later commit may have
// left behind. REQUIRES: the store is closed, and holds the record
template <class Record>
void damage_record(const std::filesystem::path& store, const Record& record, MortonKey leaf) {
  constexpr std::size_t kChunkBytes = 4072;  // of which a long record's first piece has no more
  const std::string bytes = encode(record, leaf).substr(0, kChunkBytes);
  const auto file = store / "data.mdb";
  std::string data = bytes_of(file);
  int num_copies = 0;
  for (std::size_t at = data.find(bytes); at != std::string::npos; at = data.find(bytes, at + 1)) {
    data[at + bytes.size() / 2] = static_cast<char>(data[at + bytes.size() / 2] ^ 16);
    ++num_copies;
  }
  if (num_copies == 0) throw std::runtime_error("the record is not in " + file.string());
  std::ofstream(file, std::ios::binary | std::ios::trunc) << data;
}

}  // namespace locvol
