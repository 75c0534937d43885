#include "engine/shared/unfinished_name.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <cstring>
#include <string>
#include <system_error>

namespace locvol {

struct UnfinishedName::Slot {
  enum class State { kFree, kTaken, kNamed };
  std::atomic<State> state = State::kFree;
  std::array<char, 4096> name{};  // ends with 0
};
static_assert(std::atomic<int>::is_always_lock_free);  // so a signal handler may ask for the state

UnfinishedName::Slot UnfinishedName::slots[8];

UnfinishedName::UnfinishedName(const std::filesystem::path& file) {
  std::error_code error;
  const std::string name = std::filesystem::absolute(file, error).string();
  if (error || name.size() >= Slot().name.size()) return;
  for (Slot& slot : slots) {
    auto free = Slot::State::kFree;
    if (!slot.state.compare_exchange_strong(free, Slot::State::kTaken)) continue;
    std::memcpy(slot.name.data(), name.c_str(), name.size() + 1);
    slot.state = Slot::State::kNamed;
    slot_ = &slot;
    return;
  }
}

UnfinishedName::~UnfinishedName() {
  if (slot_ != nullptr) slot_->state = Slot::State::kFree;
}

void UnfinishedName::remove_all() noexcept {
  for (const Slot& slot : slots)
    if (slot.state == Slot::State::kNamed) ::unlink(slot.name.data());
}

}  // namespace locvol
