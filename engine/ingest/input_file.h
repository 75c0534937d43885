// InputFile reads a file front to back through one buffer, as bytes or as lines.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/sha256.h"
#include "octree/stop.h"

namespace locvol {

// Whatever reads on throws Stopped.
class InputFile {
 public:
  // Throws InputError: not there, a directory, no regular file, not readable.
  explicit InputFile(const std::filesystem::path& path, const StopToken* stop = nullptr);

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }                          // bytes, when it was opened
  std::uint64_t position() const { return loaded_ - (end_ - begin_); }  // bytes taken so far
  std::uint64_t remaining() const { return size_ > position() ? size_ - position() : 0; }
  std::uint64_t line_number() const { return line_number_; }  // of the last line taken, from 1

  // Up to `bytes` of what comes next, fewer at the end of the file; nothing is taken. This view and
  // those below are valid until the next call.
  std::string_view peek(std::size_t bytes);
  // Exactly `bytes`. Throws InputError if the file ends before.
  const unsigned char* take(std::size_t bytes);
  // The next line without its end (LF or CR LF); false at the end of the file. Throws InputError
  // for a line longer than 16 MiB, which no text format has.
  bool next_line(std::string_view& line);
  // The next byte taken is the one at `position`, at most size(). The file then has no digest().
  void seek(std::uint64_t position);
  // Those at `position`, without taking them. Throws InputError if they are not there.
  void read_at(std::uint64_t position, std::span<unsigned char> bytes) const;

  // SHA-256 of the whole file, as it was read; takes what is left of it. To be called once, of a
  // file in which nobody has sought.
  std::string digest();

  // Throws InputError with the file's name before the message.
  [[noreturn]] void refuse(const std::string& what) const;
  [[noreturn]] void refuse_line(const std::string& what) const;  // and the line's number
  [[noreturn]] void refuse_truncated() const;

 private:
  [[noreturn]] void refuse_unreadable(std::uint64_t position) const;
  bool load_more();  // appends to the buffer; false at the end of the file

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::filesystem::path path_;
  const StopToken* stop_;
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t size_ = 0;
  std::uint64_t loaded_ = 0;  // bytes read from the file
  std::uint64_t line_number_ = 0;
  std::vector<char> buffer_;
  Sha256 hash_;  // of the bytes loaded, if nobody has sought
  bool has_sought_ = false;
  std::size_t begin_ = 0, end_ = 0;  // of the bytes in the buffer that are not taken yet
};

// Adds its bytes [begin, end) to a hash. Throws InputError as InputFile does, Stopped.
void hash_bytes(const std::filesystem::path& file, std::uint64_t begin, std::uint64_t end,
                Sha256& hash, const StopToken* stop = nullptr);
// Of its bytes. Throws InputError as InputFile does, Stopped.
std::string digest_of_file(const std::filesystem::path& file, const StopToken* stop = nullptr);

}  // namespace locvol
