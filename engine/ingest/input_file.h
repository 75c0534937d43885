// InputFile reads an input front to back through one buffer, as bytes or as lines. What gzip has
// packed is unpacked, where it is asked for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/input_bytes.h"
#include "engine/ingest/sha256.h"
#include "engine/ingest/unpacked_stream.h"
#include "octree/stop.h"

namespace locvol {

// Whatever reads on throws Stopped.
class InputFile {
 public:
  // A regular file as it is. Throws InputError, see InputBytes.
  explicit InputFile(const std::filesystem::path& path, const StopToken* stop = nullptr);
  // If gzip has packed them, what they are unpacked: what follows is said of that. All that reads
  // throws InputError where they are damaged.
  explicit InputFile(std::shared_ptr<const InputBytes> bytes, const StopToken* stop = nullptr);

  // What a part of them is unpacked, of which is known how many bytes it is: `part` is its name,
  // for messages, and `open` begins to unpack it.
  using OpenStream = std::function<std::unique_ptr<UnpackedStream>()>;
  InputFile(std::shared_ptr<const InputBytes> bytes, std::string part, OpenStream open,
            std::uint64_t size, const StopToken* stop = nullptr);
  // The same file from its beginning, whatever has been taken from this one.
  InputFile another() const;

  const std::filesystem::path& path() const { return bytes_->path(); }
  const std::shared_ptr<const InputBytes>& bytes() const { return bytes_; }
  const StopToken* stop() const { return stop_; }
  bool is_unpacked() const { return open_ != nullptr; }
  // Bytes, when it was opened. Of a packed file this takes as long as to unpack it, the first time.
  std::uint64_t size() const;
  std::uint64_t position() const { return loaded_ - (end_ - begin_); }  // bytes taken so far
  std::uint64_t remaining() const { return size() > position() ? size() - position() : 0; }
  std::uint64_t line_number() const { return line_number_; }  // of the last line taken, from 1

  // Up to `bytes` of what comes next, fewer at the end of the file; nothing is taken. This view and
  // those below are valid until the next call.
  std::string_view peek(std::size_t bytes);
  // Exactly `bytes`. Throws InputError if the file ends before.
  const unsigned char* take(std::size_t bytes);
  // What ends a line. kAny: LF, CR LF, or CR alone, as on old Macs; kLineFeed: LF or CR LF.
  enum class LineEnd { kAny, kLineFeed, kReturn };
  void set_line_end(LineEnd line_end) { line_end_ = line_end; }
  // The next line without its end; false at the end of the file. The last line may lack its end,
  // and what old systems pad files with (NUL, control-Z) is left out. Throws InputError for a line
  // longer than 16 MiB, which no text format has.
  bool next_line(std::string_view& line);
  // The next byte taken is the one at `position`, at most size(). The file then has no digest().
  // REQUIRES: !is_unpacked(), also of the next
  void seek(std::uint64_t position);
  // Goes on to `position`, which lies no less far, and in that line of a text. Of what is unpacked
  // all up to there is. The file then has no digest(). Throws InputError if it ends before.
  void skip_to(std::uint64_t position, std::uint64_t line_number = 0);
  // Reads the bytes at `position`, without taking them. Throws InputError if they are not there.
  void read_at(std::uint64_t position, std::span<unsigned char> bytes) const;

  // SHA-256 of the whole file, as it was read; takes what is left of it. To be called once, of a
  // file in which nobody has sought.
  std::string digest();

  // Throws InputError with the file's name before the message.
  [[noreturn]] void refuse(const std::string& what) const;
  [[noreturn]] void refuse_line(const std::string& what) const;  // and the line's number
  [[noreturn]] void refuse_truncated() const;

 private:
  std::string_view take_line(std::size_t length);
  bool load_more();  // appends to the buffer; false at the end of the file

  std::shared_ptr<const InputBytes> bytes_;
  const StopToken* stop_;
  std::string part_;  // of the bytes
  OpenStream open_;   // null: they are not packed
  std::unique_ptr<UnpackedStream> unpacked_;
  mutable std::optional<std::uint64_t> size_;
  LineEnd line_end_ = LineEnd::kAny;
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
// The digest of what a file holds: its bytes, unless gzip has packed it. Throws InputError as
// InputFile does, Stopped.
std::string digest_of_file(const std::filesystem::path& file, const StopToken* stop = nullptr);

}  // namespace locvol
