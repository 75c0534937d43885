// What Store needs of the operating system besides LMDB: the writer's lock, directories that
// survive a power cut, and file systems on which a memory map cannot be trusted.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

namespace locvol {

class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int number) : number_(number) {}
  FileDescriptor(FileDescriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~FileDescriptor();
  int number() const { return number_; }
  bool is_open() const { return number_ >= 0; }

 private:
  int number_ = -1;
};

// The right to write to a store, for one process at a time; the kernel takes it back when the
// process ends, however it ends.
class WriterLock {
 public:
  // Throws StoreError: another process has it (named by its id), or the lock cannot be made.
  static WriterLock acquire(const std::filesystem::path& directory);
  // The id of the process that has it, if one has.
  static std::optional<std::string> holder(const std::filesystem::path& directory);

 private:
  explicit WriterLock(FileDescriptor file) : file_(std::move(file)) {}
  FileDescriptor file_;
};

// Makes the directory, durably. REQUIRES: it does not exist. Throws StoreError.
void make_directory(const std::filesystem::path& directory);

// Makes the names of the files in `directory` durable. Throws StoreError.
void sync_directory(const std::filesystem::path& directory);

// The network file system that holds `path`, if it is one: memory maps and locks there are not
// coherent between machines. Throws StoreError when the system cannot tell.
std::optional<std::string> network_file_system(const std::filesystem::path& path);

// The network file system, if it is one, that statfs(2) and /proc/self/mountinfo name: magic number
// and type's name.
std::optional<std::string> network_file_system_named(std::uint32_t magic, const std::string& type);

}  // namespace locvol
