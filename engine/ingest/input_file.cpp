#include "engine/ingest/input_file.h"

#include <fmt/format.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "engine/shared/input_error.h"

namespace locvol {
namespace {

constexpr std::size_t kReadBytes = std::size_t{1} << 18;
constexpr std::size_t kMaxLineBytes = std::size_t{1} << 24;

}  // namespace

InputFile::InputFile(const std::filesystem::path& path, const StopToken* stop)
    : path_(path), stop_(stop), buffer_(kReadBytes) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found)
    refuse("there is no such file; check the path");
  if (error) refuse(fmt::format("cannot be examined ({})", error.message()));
  if (std::filesystem::is_directory(status)) refuse("is a directory; name a file in it");
  if (!std::filesystem::is_regular_file(status))
    refuse("is not a regular file; save what it gives to a file first");
  size_ = std::filesystem::file_size(path, error);
  if (error) refuse(fmt::format("its size is unknown ({})", error.message()));
  file_.reset(std::fopen(path.c_str(), "rb"));
  if (!file_)
    refuse(fmt::format("cannot be opened ({}); check its permissions", std::strerror(errno)));
  std::setvbuf(file_.get(), nullptr, _IONBF, 0);
}

std::string_view InputFile::peek(std::size_t bytes) {
  while (end_ - begin_ < bytes && load_more()) {
  }
  return {buffer_.data() + begin_, std::min(bytes, end_ - begin_)};
}

const unsigned char* InputFile::take(std::size_t bytes) {
  if (end_ - begin_ < bytes) {
    if (bytes > remaining()) refuse_truncated();
    while (end_ - begin_ < bytes)
      if (!load_more()) refuse_truncated();
  }
  const auto* data = reinterpret_cast<const unsigned char*>(buffer_.data() + begin_);
  begin_ += bytes;
  return data;
}

bool InputFile::next_line(std::string_view& line) {
  std::size_t searched = 0;
  for (;;) {
    const char* const start = buffer_.data() + begin_;
    const std::size_t length = end_ - begin_;
    const void* const newline = std::memchr(start + searched, '\n', length - searched);
    if (newline) {
      line = {start, static_cast<std::size_t>(static_cast<const char*>(newline) - start)};
      begin_ += line.size() + 1;
      break;
    }
    searched = length;
    if (length > kMaxLineBytes)
      refuse(fmt::format("line {} is longer than {} bytes: no text surface file", line_number_ + 1,
                         kMaxLineBytes));
    if (load_more()) continue;
    if (length == 0) return false;
    line = {buffer_.data() + begin_, length};  // the last line may lack its end
    begin_ = end_;
    break;
  }
  ++line_number_;
  if (line.ends_with('\r')) line.remove_suffix(1);
  return true;
}

void InputFile::seek(std::uint64_t position) {
  if (fseeko(file_.get(), static_cast<off_t>(position), SEEK_SET) != 0)
    refuse(fmt::format("byte {} cannot be reached ({}); check the disk", position,
                       std::strerror(errno)));
  begin_ = end_ = 0;
  loaded_ = position;
  has_sought_ = true;
}

void InputFile::read_at(std::uint64_t position, std::span<unsigned char> bytes) const {
  while (!bytes.empty()) {
    const ssize_t count =
        ::pread(::fileno(file_.get()), bytes.data(), bytes.size(), static_cast<off_t>(position));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) refuse_unreadable(position);
    if (count == 0) refuse_truncated();
    position += static_cast<std::uint64_t>(count);
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
}

bool InputFile::load_more() {
  throw_if_stopped(stop_);
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  if (end_ == buffer_.size()) buffer_.resize(2 * buffer_.size());
  const std::size_t count =
      std::fread(buffer_.data() + end_, 1, buffer_.size() - end_, file_.get());
  if (count == 0 && std::ferror(file_.get())) refuse_unreadable(loaded_);
  if (!has_sought_) hash_.update(buffer_.data() + end_, count);
  end_ += count;
  loaded_ += count;
  return count > 0;
}

std::string InputFile::digest() {
  assert(!has_sought_);
  do begin_ = end_;
  while (load_more());
  return hash_.hex_digest();
}

void InputFile::refuse(const std::string& what) const {
  throw InputError(fmt::format("{}: {}", path_.string(), what));
}

void InputFile::refuse_line(const std::string& what) const {
  refuse(fmt::format("line {}: {}", line_number_, what));
}

void InputFile::refuse_unreadable(std::uint64_t position) const {
  refuse(fmt::format("cannot be read at byte {} ({}); check the disk", position,
                     std::strerror(errno)));
}

void InputFile::refuse_truncated() const {
  refuse(fmt::format("ends too early, at byte {}: it is cut off; fetch or export it again", size_));
}

void hash_bytes(const std::filesystem::path& file, std::uint64_t begin, std::uint64_t end,
                Sha256& hash, const StopToken* stop) {
  InputFile input(file, stop);
  input.seek(begin);
  while (begin < end) {
    const std::uint64_t bytes = std::min<std::uint64_t>(end - begin, kReadBytes);
    hash.update(input.take(bytes), bytes);
    begin += bytes;
  }
}

std::string digest_of_file(const std::filesystem::path& file, const StopToken* stop) {
  return InputFile(file, stop).digest();
}

}  // namespace locvol
