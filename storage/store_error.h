// How a store fails.
#pragma once

#include <stdexcept>
#include <string>

#include "octree/morton_key.h"

namespace locvol {

class StoreError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class CorruptRecord : public StoreError {
 public:
  CorruptRecord(const std::string& what, MortonKey leaf) : StoreError(what), leaf_(leaf) {}
  MortonKey leaf() const { return leaf_; }  // not valid: the record belongs to no leaf

 private:
  MortonKey leaf_;
};

// The end of every message about damage.
inline constexpr const char* kDamageCure =
    "; it cannot be mended: remove the store, and mesh the surface again, or put back a copy";

}  // namespace locvol
