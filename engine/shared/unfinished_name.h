// Names of files that a process is not to leave behind when a signal ends it.
#pragma once

#include <filesystem>

namespace locvol {

// While it lives, a signal handler can remove the file of this name. A process has a few of them at
// a time; what is beyond that is not remembered.
class UnfinishedName {
 public:
  explicit UnfinishedName(const std::filesystem::path& file);
  UnfinishedName(const UnfinishedName&) = delete;
  UnfinishedName& operator=(const UnfinishedName&) = delete;
  ~UnfinishedName();

  // Removes all such files before the process ends. Safe in a signal handler.
  static void remove_all() noexcept;

 private:
  struct Slot;
  static Slot slots[];
  Slot* slot_ = nullptr;  // null: not remembered
};

}  // namespace locvol
