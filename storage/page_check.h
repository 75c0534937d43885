// Checks the page structure of an LMDB file by plain reads, before LMDB, which trusts its pages,
// follows them through the memory map: there a damaged page number or a truncated file is a crash.
//
// Knows the file format of LMDB 0.9 (data version 1, 64 bits), which is drawn in page_check.cpp.
// Does not look into values: those have checksums of their own (codec.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

namespace locvol {

// The file is not one that LMDB wrote, or no longer. Says what is wrong; the caller knows where.
// (A file that cannot be read is no damage: std::system_error.)
class DamagedFile : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Tells whether anything was ever committed to the file. A file too damaged to tell counts as one
// to which something was.
bool has_content(int file);

// What opening the environment relies on: the two meta pages. Throws DamagedFile.
void check_meta_pages(int file);

// A number that tells keys apart.
std::uint64_t key_hash(std::string_view key);

// The sum modulo 2^64 of the key_hash() of all keys, for each named database.
using KeySumByName = std::map<std::string, std::uint64_t, std::less<>>;

// What following pages relies on, in the state that transaction `txn` left: every page that can be
// reached lies in the file, is in one place only, names itself, keeps its nodes inside, and has no
// key that a search would not find. Returns the sums of the keys found; nothing if the file holds
// that state no longer (a writer has gone on), so ask again with a newer one.
// Reads the trees' pages and the lists of free pages, about 1% of a store, in ascending order level
// by level; keeps 1 bit per page of the file. Throws DamagedFile.
// REQUIRES: check_meta_pages(file) passed; a read transaction keeps that state's pages in place.
std::optional<KeySumByName> check_pages(int file, std::uint64_t txn);

// What freeing a value relies on, which check_pages() does not read: the header of the overflow
// pages that it is on, if it is on such. `value` is `offset` bytes from the beginning of the file,
// or of its map. Throws DamagedFile.
void check_overflow_header(const char* value, std::uint64_t value_bytes, std::uint64_t offset,
                           std::uint32_t page_size);

}  // namespace locvol
