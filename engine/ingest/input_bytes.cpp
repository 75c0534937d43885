#include "engine/ingest/input_bytes.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

#include "engine/shared/input_error.h"
#include "engine/shared/standard_input.h"

namespace locvol {
namespace {

constexpr std::size_t kCopyBytes = std::size_t{1} << 18;
constexpr int kPollMilliseconds = 100;

enum class FileKind { kRegular, kPipe, kTerminal, kDevice, kDirectory };

FileKind kind_of(const struct stat& status, int descriptor) {
  if (S_ISREG(status.st_mode)) return FileKind::kRegular;
  if (S_ISDIR(status.st_mode)) return FileKind::kDirectory;
  if (S_ISFIFO(status.st_mode) || S_ISSOCK(status.st_mode)) return FileKind::kPipe;
  return descriptor >= 0 && ::isatty(descriptor) ? FileKind::kTerminal : FileKind::kDevice;
}

[[noreturn]] void refuse(const std::filesystem::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

// Opens it, of a kind that it may be.
OpenFile opened(const std::filesystem::path& path, bool may_be_pipe) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) {
    if (errno == ENOENT || errno == ENOTDIR) refuse(path, "there is no such file; check the path");
    refuse(path, fmt::format("cannot be examined ({})", std::strerror(errno)));
  }
  switch (kind_of(status, -1)) {
    case FileKind::kRegular:
      break;
    case FileKind::kDirectory:
      refuse(path, "is a directory; name a file in it");
    case FileKind::kPipe:
      if (may_be_pipe) break;
      refuse(path, "is not a regular file; save what it gives to a file first");
    default:
      refuse(path, "is a device; name a file");
  }
  // Nobody may have opened a pipe's other end yet, and to wait for that here could not be stopped.
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0)
    refuse(path, fmt::format("cannot be opened ({}); check its permissions", std::strerror(errno)));
  return {descriptor, path};
}

// Waits until there is something to read, or the end.
void wait_for(int descriptor, const StopToken* stop) {
  for (;;) {
    throw_if_stopped(stop);
    pollfd waiting{descriptor, POLLIN, 0};
    if (::poll(&waiting, 1, kPollMilliseconds) > 0) return;
  }
}

}  // namespace

InputBytes::InputBytes(std::filesystem::path path, OpenFile file)
    : path_(std::move(path)), file_(std::move(file)) {
  struct stat status {};
  if (::fstat(file_->descriptor(), &status) != 0)
    refuse(fmt::format("its size is unknown ({})", std::strerror(errno)));
  size_ = static_cast<std::uint64_t>(status.st_size);
}

InputBytes::InputBytes(const std::filesystem::path& file) : InputBytes(file, opened(file, false)) {}

InputBytes::InputBytes(const std::filesystem::path& file, const std::filesystem::path& directory,
                       const StopToken* stop)
    : InputBytes(file, opened(file, true)) {
  struct stat status {};
  if (::fstat(file_->descriptor(), &status) == 0 && !S_ISREG(status.st_mode))
    copy_into(directory, stop);
}

InputBytes InputBytes::of_standard_input(const std::filesystem::path& directory,
                                         const StopToken* stop) {
  struct stat status {};
  const int descriptor = ::fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3);
  if (descriptor < 0 || ::fstat(descriptor, &status) != 0) {
    const int error = errno;
    if (descriptor >= 0) ::close(descriptor);
    locvol::refuse(kStandardInput, fmt::format("cannot be read ({})", std::strerror(error)));
  }
  InputBytes input(kStandardInput, OpenFile(descriptor, kStandardInput));
  switch (kind_of(status, descriptor)) {
    case FileKind::kRegular: {
      const off_t begin = ::lseek(descriptor, 0, SEEK_CUR);
      input.begin_ = begin > 0 ? std::min(static_cast<std::uint64_t>(begin), input.size_) : 0;
      input.size_ -= input.begin_;
      break;
    }
    case FileKind::kPipe:
      input.copy_into(directory, stop);
      break;
    case FileKind::kTerminal:
      input.refuse(
          "is a terminal: give the name of a surface file, or send one in, as in \"zcat "
          "part.stl.gz "
          "| locvol mesh - -o part.vtu\"");
    default:
      input.refuse("is neither a file nor a pipe: send a surface in, or give the name of its file");
  }
  return input;
}

void InputBytes::copy_into(const std::filesystem::path& directory, const StopToken* stop) {
  OpenFile copy = OpenFile::temporary(directory / "locvol-input");
  std::vector<std::byte> buffer(kCopyBytes);
  std::uint64_t num_copied = 0;
  for (;;) {
    wait_for(file_->descriptor(), stop);
    const ssize_t count = ::read(file_->descriptor(), buffer.data(), buffer.size());
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count < 0)
      refuse(fmt::format("cannot be read after {} bytes ({})", num_copied, std::strerror(errno)));
    if (count == 0) break;
    copy.write_at(num_copied, std::span(buffer).first(static_cast<std::size_t>(count)));
    num_copied += static_cast<std::uint64_t>(count);
  }
  file_.emplace(std::move(copy));
  size_ = num_copied;
  is_copy_ = true;
}

std::size_t InputBytes::read_at(std::uint64_t position, std::span<char> bytes) const {
  for (;;) {
    const ssize_t count = ::pread(file_->descriptor(), bytes.data(), bytes.size(),
                                  static_cast<off_t>(begin_ + position));
    if (count >= 0) return static_cast<std::size_t>(count);
    if (errno != EINTR)
      refuse(fmt::format("cannot be read at byte {} ({}); check the disk", position,
                         std::strerror(errno)));
  }
}

void InputBytes::refuse(const std::string& what) const { locvol::refuse(path_, what); }

}  // namespace locvol
