#include "engine/shared/partial_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <system_error>
#include <utility>

namespace locvol {
namespace {

constexpr std::size_t kBufferBytes = std::size_t{4} << 20;

[[noreturn]] void fail(const char* action, const std::filesystem::path& name, int error = errno) {
  throw std::system_error(error, std::generic_category(),
                          std::string("cannot ") + action + " " + name.string());
}

std::filesystem::path with_suffix(std::filesystem::path file, const char* suffix) {
  file += suffix;
  return file;
}

std::filesystem::path directory_of(const std::filesystem::path& file) {
  return file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
}

// Under the umask, as any file that a program creates.
int create(const std::filesystem::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0) fail("write", file);
  return descriptor;
}

// A rename is durable once its directory is. Some file systems cannot sync a directory, and need
// not.
void sync_directory(const std::filesystem::path& directory) {
  const int descriptor = ::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) fail("open", directory);
  const OpenFile owner(descriptor, directory);
  if (::fsync(descriptor) != 0 && errno != EINVAL && errno != EROFS) fail("write", directory);
}

}  // namespace

OpenFile::OpenFile(int descriptor, std::filesystem::path name)
    : descriptor_(descriptor), name_(std::move(name)) {}

OpenFile::OpenFile(OpenFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), name_(std::move(other.name_)) {}

OpenFile::~OpenFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

OpenFile OpenFile::temporary(const std::filesystem::path& neighbor) {
  std::string name = with_suffix(neighbor, ".XXXXXX").string();
  const int nameless = ::open(directory_of(neighbor).c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (nameless >= 0) return OpenFile(nameless, name);  // not on every file system
  const int descriptor = ::mkostemp(name.data(), O_CLOEXEC);
  if (descriptor < 0) fail("write", name);
  ::unlink(name.c_str());
  return OpenFile(descriptor, name);
}

void OpenFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written =
        ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail("write", name_);
    offset += static_cast<std::uint64_t>(written);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

void OpenFile::read_at(std::uint64_t offset, std::span<std::byte> bytes) const {
  while (!bytes.empty()) {
    const ssize_t got =
        ::pread(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) fail("read", name_, got < 0 ? errno : EIO);
    offset += static_cast<std::uint64_t>(got);
    bytes = bytes.subspan(static_cast<std::size_t>(got));
  }
}

void OpenFile::close() {
  if (::close(std::exchange(descriptor_, -1)) != 0) fail("write", name_);
}

// The child has the file and the end of a pipe, and ends once the pipe is closed: after the file is
// in this process, so that the child is the last to have it.
void OpenFile::close_in_child() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) return;
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(descriptor_, 0);
    ::dup2(ends[0], 1);
    ::close_range(2, ~0U, 0);
    char nothing = 0;
    [[maybe_unused]] const auto end = ::read(1, &nothing, 1);
    ::_exit(0);
  }
  if (child > 0) ::close(std::exchange(descriptor_, -1));
  for (const int end : ends) ::close(end);
}

PartialFile::PartialFile(std::filesystem::path file, const StopToken* stop)
    : file_(std::move(file)),
      partial_(with_suffix(file_, ".partial")),
      stop_(stop),
      unfinished_(partial_),
      out_(create(partial_), partial_) {}

PartialFile::PartialFile(std::filesystem::path file, const StopToken* stop, OpenFile out)
    : file_(std::move(file)), partial_(out.name()), stop_(stop), out_(std::move(out)) {}

PartialFile PartialFile::of_another(std::filesystem::path file, const StopToken* stop) {
  std::filesystem::path partial = with_suffix(file, ".partial");
  const int descriptor = ::open(partial.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) fail("write", partial);
  return PartialFile(std::move(file), stop, OpenFile(descriptor, std::move(partial)));
}

PartialFile::~PartialFile() {
  if (unfinished_ && !is_published_) give_up();
}

void PartialFile::finish_part() {
  if (::fsync(out_.descriptor()) != 0) fail("write", partial_);
  out_.close();
}

void PartialFile::give_up() {
  constexpr off_t kLargeBytes = off_t{1} << 30;
  ::unlink(partial_.c_str());
  struct stat status {};
  const bool is_large = ::fstat(out_.descriptor(), &status) == 0 && status.st_size >= kLargeBytes;
  if (is_large && stop_ != nullptr && stop_->is_stopped()) out_.close_in_child();
}

void PartialFile::reserve(std::uint64_t bytes) {
  if (bytes == 0 || ::fallocate(out_.descriptor(), 0, 0, static_cast<off_t>(bytes)) == 0) return;
  if (errno == ENOSPC || errno == EDQUOT || errno == EFBIG) {
    throw std::system_error(
        errno, std::generic_category(),
        "cannot write " + file_.string() + ", which takes " + std::to_string(bytes) + " bytes");
  }  // anything else: this file system cannot reserve
}

void PartialFile::publish() {
  PartialFile* const self = this;
  publish_all({&self, 1});
}

void PartialFile::publish_all(std::span<PartialFile* const> files) {
  for (PartialFile* file : files) file->finish();
  for (PartialFile* file : files) file->rename();
  for (PartialFile* file : files) sync_directory(directory_of(file->file_));
}

// Of a large file, what was written goes to the disk from now on and not at the end, and the system
// keeps little of it in memory. So the end comes soon, and so does that of a file that is given up:
// each gigabyte in memory would take a tenth of a second.
void PartialFile::write_behind() {
  constexpr std::uint64_t kStepBytes = std::uint64_t{256} << 20,
                          kKeptBytes = std::uint64_t{4} << 30;
  next_step_ = num_written_ + kStepBytes;
  ::sync_file_range(out_.descriptor(), 0, 0, SYNC_FILE_RANGE_WRITE);  // begins it
  if (num_written_ > kKeptBytes)
    ::posix_fadvise(out_.descriptor(), 0, 0, POSIX_FADV_DONTNEED);  // but what is not written yet
}

// To write gigabytes takes the disk long, and fsync() cannot be stopped.
void PartialFile::write_to_disk() {
  constexpr off_t kPieceBytes = off_t{16} << 20;
  constexpr unsigned kWrite =
      SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER;
  struct stat status {};
  if (stop_ == nullptr || ::fstat(out_.descriptor(), &status) != 0) return;
  for (off_t offset = 0; offset < status.st_size; offset += kPieceBytes) {
    throw_if_stopped(stop_);
    if (::sync_file_range(out_.descriptor(), offset, kPieceBytes, kWrite) == 0) continue;
    if (errno == EIO || errno == ENOSPC || errno == EDQUOT) fail("write", partial_);
    return;  // this file system does without
  }
}

void PartialFile::finish() {
  if (std::exchange(is_finished_, true)) return;
  write_to_disk();
  if (::fsync(out_.descriptor()) != 0) fail("write", partial_);
  out_.close();
  if (std::filesystem::is_directory(file_)) fail("write", file_, EISDIR);
}

void PartialFile::rename() {
  if (::rename(partial_.c_str(), file_.c_str()) != 0) fail("write", file_);
  is_published_ = true;
}

FileSection::FileSection(PartialFile& out, std::uint64_t offset) : out_(&out), offset_(offset) {
  buffer_.reserve(kBufferBytes);
}

void FileSection::append(std::span<const std::byte> bytes) {
  if (buffer_.size() + bytes.size() > kBufferBytes) flush();
  if (bytes.size() >= kBufferBytes) {
    out_->write_at(offset_, bytes);
    offset_ += bytes.size();
  } else {
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  }
}

void FileSection::flush() {
  out_->write_at(offset_, buffer_);
  offset_ += buffer_.size();
  buffer_.clear();
}

}  // namespace locvol
