// PartialFile is a file that appears under its name only when it is whole.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "engine/shared/unfinished_name.h"
#include "octree/stop.h"

namespace locvol {

// An open file descriptor, closed with its owner. `name` is for messages.
// Errors: std::system_error (a std::runtime_error), "cannot write NAME: REASON".
class OpenFile {
 public:
  OpenFile(int descriptor, std::filesystem::path name);
  OpenFile(OpenFile&& other) noexcept;
  OpenFile& operator=(OpenFile&&) = delete;
  ~OpenFile();

  // A file without a name in the directory of `neighbor`, gone when it is closed.
  static OpenFile temporary(const std::filesystem::path& neighbor);

  const std::filesystem::path& name() const { return name_; }
  int descriptor() const { return descriptor_; }
  void write_at(std::uint64_t offset, std::span<const std::byte> bytes);
  void read_at(std::uint64_t offset, std::span<std::byte> bytes) const;  // all of them, or throws
  void close();  // reports what the system found out late
  // Closes a file that is to be given up in a child, when this process is to end soon: the system
  // takes seconds to give back gigabytes, and the end of a process waits for that.
  void close_in_child();

 private:
  int descriptor_;
  std::filesystem::path name_;
};

// Written as NAME.partial beside its place. publish() makes it durable, then renames it; without
// publish() nothing is left behind. What writes throws Stopped, and publish() before it renames.
class PartialFile {
 public:
  explicit PartialFile(std::filesystem::path file, const StopToken* stop = nullptr);
  // Opens a file that another process has begun, to write a part of it, too. Who began it publishes
  // it, or removes it.
  static PartialFile of_another(std::filesystem::path file, const StopToken* stop = nullptr);
  PartialFile(const PartialFile&) = delete;
  PartialFile& operator=(const PartialFile&) = delete;
  ~PartialFile();

  const std::filesystem::path& name() const { return file_; }
  const std::filesystem::path& partial_name() const { return partial_; }  // while it is written
  void reserve(std::uint64_t bytes);  // so that a disk too full is known before the work is done
  void write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
    throw_if_stopped(stop_);
    out_.write_at(offset, bytes);
    num_written_ += bytes.size();
    if (num_written_ >= next_step_) write_behind();
  }
  void finish();  // makes it durable, so that publish() has nothing to do but to rename
  void publish();
  void finish_part();  // of another's: durable on return
  // Publishes all files or none, but for a crash between two names.
  static void publish_all(std::span<PartialFile* const> files);

 private:
  PartialFile(std::filesystem::path file, const StopToken* stop, OpenFile out);
  void write_to_disk();  // piece by piece, as far as the system can
  void write_behind();
  void give_up();
  void rename();

  std::filesystem::path file_, partial_;
  const StopToken* stop_;
  std::optional<UnfinishedName> unfinished_;  // absent: it is another's
  OpenFile out_;
  std::uint64_t num_written_ = 0, next_step_ = std::uint64_t{1} << 30;
  bool is_finished_ = false, is_published_ = false;
};

// A run of bytes at a known place of a PartialFile, written front to back through a buffer.
class FileSection {
 public:
  FileSection(PartialFile& out, std::uint64_t offset);
  void append(std::span<const std::byte> bytes);
  template <class T>
  void append_value(const T& value) {
    append(std::as_bytes(std::span(&value, 1)));
  }
  void flush();                                                      // must be called at the end
  std::uint64_t offset() const { return offset_ + buffer_.size(); }  // of the next byte

 private:
  PartialFile* out_;
  std::uint64_t offset_;
  std::vector<std::byte> buffer_;
};

}  // namespace locvol
