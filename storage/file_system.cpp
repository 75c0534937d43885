#include "storage/file_system.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statfs.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <fstream>
#include <sstream>
#include <system_error>
#include <thread>

#include "storage/store_error.h"

namespace locvol {
namespace {

constexpr const char* kLockName = "writer.lock";
constexpr std::uint32_t kFuseMagic = 0x65735546;

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what) {
  throw StoreError(path.string() + ": cannot " + what + ": " +
                   std::generic_category().message(errno) +
                   "; mend that, and give the same command again");
}

std::string text_of(const FileDescriptor& file) {
  std::array<char, 32> text{};
  const ssize_t size = pread(file.number(), text.data(), text.size(), 0);
  return std::string(text.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
}

// Tries again for a moment: holder() takes the lock for some microseconds.
bool try_lock(const FileDescriptor& file) {
  constexpr int kTries = 20;
  for (int i = 0; i < kTries; ++i) {
    if (flock(file.number(), LOCK_EX | LOCK_NB) == 0) return true;
    if (errno != EWOULDBLOCK) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  errno = EWOULDBLOCK;
  return false;
}

// Only for the message that another process gets: the lock holds without it.
void write_process_id(const FileDescriptor& file) {
  const std::string id = std::to_string(getpid());
  if (ftruncate(file.number(), 0) != 0) return;
  [[maybe_unused]] const ssize_t written = pwrite(file.number(), id.data(), id.size(), 0);
}

// The type of the file system on `device`, like "ext4" or "fuse.sshfs"; empty if not listed.
std::string mounted_type(dev_t device) {
  const std::string wanted = std::to_string(major(device)) + ":" + std::to_string(minor(device));
  std::ifstream mounts("/proc/self/mountinfo");
  for (std::string line; std::getline(mounts, line);) {
    std::istringstream words(line);
    std::string id, parent, numbers, word;
    words >> id >> parent >> numbers;
    if (numbers != wanted) continue;
    while (words >> word && word != "-") continue;  // optional fields end with a dash
    words >> word;
    return word;
  }
  return {};
}

}  // namespace

FileDescriptor::~FileDescriptor() {
  if (is_open()) ::close(number_);
}

WriterLock WriterLock::acquire(const std::filesystem::path& directory) {
  const std::filesystem::path path = directory / kLockName;
  FileDescriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!file.is_open()) fail(path, "open for writing");
  if (!try_lock(file)) {
    if (errno != EWOULDBLOCK) fail(path, "lock");
    const std::string process = text_of(file);
    throw StoreError("store " + directory.string() + " is in use by " +
                     (process.empty() ? "another process" : "process " + process));
  }
  write_process_id(file);
  return WriterLock(std::move(file));
}

std::optional<std::string> WriterLock::holder(const std::filesystem::path& directory) {
  const FileDescriptor file(::open((directory / kLockName).c_str(), O_RDONLY | O_CLOEXEC));
  const bool is_held =
      file.is_open() && flock(file.number(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  return is_held ? std::optional(text_of(file)) : std::nullopt;
}

void make_directory(const std::filesystem::path& directory) {
  if (::mkdir(directory.c_str(), 0755) != 0) fail(directory, "make the directory");
  const auto parent = std::filesystem::absolute(directory).lexically_normal().parent_path();
  sync_directory(parent);
}

void sync_directory(const std::filesystem::path& directory) {
  const FileDescriptor file(::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!file.is_open()) fail(directory, "open the directory");
  if (fsync(file.number()) != 0) fail(directory, "write the directory to disk");
}

std::optional<std::string> network_file_system(const std::filesystem::path& path) {
  struct statfs file_system;
  struct stat status;
  if (statfs(path.c_str(), &file_system) != 0 || stat(path.c_str(), &status) != 0)
    fail(path, "find out its file system");
  const auto magic = static_cast<std::uint32_t>(file_system.f_type);
  return network_file_system_named(magic, magic == kFuseMagic ? mounted_type(status.st_dev) : "");
}

std::optional<std::string> network_file_system_named(std::uint32_t magic, const std::string& type) {
  constexpr std::array<std::pair<std::uint32_t, const char*>, 10> kNetworks = {{
      {0x6969, "NFS"},
      {0x517B, "SMB"},
      {0xFF534D42, "CIFS"},
      {0xFE534D42, "SMB2"},
      {0x01021997, "9p"},
      {0x5346414F, "AFS"},
      {0x6B414653, "AFS"},
      {0x00C36400, "Ceph"},
      {0x73757245, "Coda"},
      {0x0BD00BD0, "Lustre"},
  }};
  // FUSE serves local file systems too (overlays of containers, NTFS, encryption): those may stay.
  constexpr std::array kFuseNetworks = {
      "fuse.sshfs",     "fuse.rclone",    "fuse.s3fs",  "fuse.gcsfuse", "fuse.glusterfs",
      "fuse.ceph-fuse", "fuse.curlftpfs", "fuse.davfs", "fuse.juicefs", "fuse.mount-s3"};
  if (magic == kFuseMagic && std::ranges::find(kFuseNetworks, type) != kFuseNetworks.end())
    return type;
  const auto found =
      std::ranges::find(kNetworks, magic, &std::pair<std::uint32_t, const char*>::first);
  if (found == kNetworks.end()) return std::nullopt;
  return found->second;
}

}  // namespace locvol
