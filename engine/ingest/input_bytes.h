// InputBytes: the bytes of an input, which can be read anywhere and as often as needed. They are a
// regular file's; or those of a pipe, which can be read only once, in a nameless copy.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "engine/shared/partial_file.h"
#include "octree/stop.h"

namespace locvol {

// Errors: InputError, with the input's name, where it is not there, a directory, a device or a
// terminal, or cannot be read; std::system_error where the copy cannot be written.
class InputBytes {
 public:
  // Opens a regular file.
  explicit InputBytes(const std::filesystem::path& file);
  // Opens a regular file, or anything that ends, such as a named pipe. A pipe is read to its end,
  // and copied into `directory`, which must exist. While it waits for the pipe it throws Stopped.
  InputBytes(const std::filesystem::path& file, const std::filesystem::path& directory,
             const StopToken* stop);
  // Takes the standard input, from where it stands, as a pipe is taken; it is called
  // kStandardInput.
  static InputBytes of_standard_input(const std::filesystem::path& directory,
                                      const StopToken* stop);

  const std::filesystem::path& path() const { return path_; }  // for messages
  std::uint64_t size() const { return size_; }                 // when it was opened
  bool is_copy() const { return is_copy_; }
  // Up to that many, fewer at the end only. Returns how many.
  std::size_t read_at(std::uint64_t position, std::span<char> bytes) const;

  // Throws InputError with the input's name before the message.
  [[noreturn]] void refuse(const std::string& what) const;

 private:
  InputBytes(std::filesystem::path path, OpenFile file);
  void copy_into(const std::filesystem::path& directory, const StopToken* stop);

  std::filesystem::path path_;
  std::optional<OpenFile> file_;
  std::uint64_t begin_ = 0, size_ = 0;
  bool is_copy_ = false;
};

}  // namespace locvol
