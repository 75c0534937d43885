// What tests of the store share: how it is opened, leaves by number, and the errors that it throws.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <string>

#include "octree/morton_key.h"
#include "storage/store.h"

namespace locvol {

inline constexpr StoreOptions kReadOnly{.read_only = true};

inline MortonKey leaf_number(int i) {
  return MortonKey::containing({static_cast<std::uint32_t>(i), 0, 0}, MortonKey::kMaxLevel);
}

// The message of the StoreError that `action` must throw.
template <class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const StoreError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no StoreError";
  return {};
}

template <class Action>
void expect_error(const Action& action, const std::string& words) {
  const std::string message = error_of(action);
  EXPECT_NE(message.find(words), std::string::npos) << message;
}

}  // namespace locvol
