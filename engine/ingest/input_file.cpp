#include "engine/ingest/input_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cstring>
#include <utility>

#include "engine/ingest/gzip_reader.h"
#include "engine/shared/input_error.h"

namespace locvol {
namespace {

constexpr std::size_t kReadBytes = std::size_t{1} << 18;
constexpr std::size_t kMaxLineBytes = std::size_t{1} << 24;
constexpr std::string_view kPadding("\0\x1a", 2);

// The first character that ends a line, or may; npos: none is there. Lines are short: so little is
// searched for one kind of end that is not there.
std::size_t find_line_end(std::string_view text, std::size_t from, InputFile::LineEnd line_end) {
  constexpr std::size_t kWindowBytes = 512;
  if (line_end == InputFile::LineEnd::kLineFeed) return text.find('\n', from);
  if (line_end == InputFile::LineEnd::kReturn) return text.find('\r', from);
  for (; from < text.size(); from += kWindowBytes) {
    const std::string_view window = text.substr(from, kWindowBytes);
    const std::size_t feed = window.find('\n');
    const std::size_t end = std::min(feed, window.substr(0, feed).find('\r'));
    if (end != std::string_view::npos) return from + end;
  }
  return std::string_view::npos;
}

}  // namespace

InputFile::InputFile(const std::filesystem::path& path, const StopToken* stop)
    : bytes_(std::make_shared<InputBytes>(path)), stop_(stop), buffer_(kReadBytes) {}

InputFile::InputFile(std::shared_ptr<const InputBytes> bytes, const StopToken* stop)
    : bytes_(std::move(bytes)), stop_(stop), buffer_(kReadBytes) {
  if (!GzipReader::is_gzip(*bytes_)) return;
  open_ = [packed = bytes_] { return std::make_unique<GzipReader>(*packed); };
  unpacked_ = open_();
}

InputFile::InputFile(std::shared_ptr<const InputBytes> bytes, std::string part, OpenStream open,
                     std::uint64_t size, const StopToken* stop)
    : bytes_(std::move(bytes)),
      stop_(stop),
      part_(std::move(part)),
      open_(std::move(open)),
      unpacked_(open_()),
      size_(size),
      buffer_(kReadBytes) {}

InputFile InputFile::another() const {
  if (!part_.empty()) return {bytes_, part_, open_, size(), stop_};
  InputFile file(bytes_, stop_);
  file.size_ = size_;
  return file;
}

std::uint64_t InputFile::size() const {
  if (size_) return *size_;
  if (!is_unpacked()) return bytes_->size();
  const auto stream = open_();
  std::vector<char> unpacked(kReadBytes);
  std::uint64_t size = 0;
  while (const std::size_t count = stream->read(unpacked)) {
    throw_if_stopped(stop_);
    size += count;
  }
  size_ = size;
  return size;
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
    const std::string_view loaded(buffer_.data() + begin_, end_ - begin_);
    const std::size_t length = find_line_end(loaded, searched, line_end_);
    if (length != std::string_view::npos) {
      line = take_line(length);
      break;
    }
    searched = loaded.size();
    if (searched > kMaxLineBytes)
      refuse(fmt::format("line {} is longer than {} bytes: no text surface file", line_number_ + 1,
                         kMaxLineBytes));
    if (load_more()) continue;
    if (loaded.empty()) return false;
    line = {buffer_.data() + begin_, end_ - begin_};
    begin_ = end_;
    line = line.substr(0, line.find_last_not_of(kPadding) + 1);
    break;
  }
  ++line_number_;
  while (line.ends_with('\r')) line.remove_suffix(1);
  if (line.find_first_not_of('\x1a') == std::string_view::npos) line = {};
  return true;
}

// The next `length` bytes, and what ends them. A CR may be all of that, or go with an LF; what was
// made for Windows twice has CR CR LF.
std::string_view InputFile::take_line(std::size_t length) {
  std::size_t end_bytes = 1;
  if (line_end_ == LineEnd::kAny && buffer_[begin_ + length] == '\r') {
    const std::string_view end = peek(length + 3).substr(length);
    if (end.starts_with("\r\n")) end_bytes = 2;
    if (end.starts_with("\r\r\n")) end_bytes = 3;
  }
  const std::string_view line(buffer_.data() + begin_, length);
  begin_ += length + end_bytes;
  return line;
}

void InputFile::seek(std::uint64_t position) {
  assert(!is_unpacked());
  begin_ = end_ = 0;
  loaded_ = position;
  has_sought_ = true;
}

void InputFile::skip_to(std::uint64_t position, std::uint64_t line_number) {
  assert(position >= this->position());
  line_number_ = line_number;
  has_sought_ = true;
  if (position > size()) refuse_truncated();
  if (!is_unpacked() && position > loaded_) return seek(position);
  while (this->position() < position)
    take(std::min<std::uint64_t>(position - this->position(), kReadBytes));
}

void InputFile::read_at(std::uint64_t position, std::span<unsigned char> bytes) const {
  assert(!is_unpacked());
  while (!bytes.empty()) {
    const std::size_t count =
        bytes_->read_at(position, {reinterpret_cast<char*>(bytes.data()), bytes.size()});
    if (count == 0) refuse_truncated();
    position += count;
    bytes = bytes.subspan(count);
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
  const auto room = std::span(buffer_).subspan(end_);
  const std::size_t count = unpacked_ ? unpacked_->read(room) : bytes_->read_at(loaded_, room);
  if (!has_sought_) hash_.update(room.data(), count);
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
  bytes_->refuse(part_.empty() ? what : part_ + ": " + what);
}

void InputFile::refuse_line(const std::string& what) const {
  refuse(fmt::format("line {}: {}", line_number_, what));
}

void InputFile::refuse_truncated() const {
  refuse(
      fmt::format("ends too early, at byte {}: it is cut off; fetch or export it again", size()));
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
  return InputFile(std::make_shared<InputBytes>(file), stop).digest();
}

}  // namespace locvol
