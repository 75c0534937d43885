// RecentMap holds values by key and knows in which order they were asked for: what caches are made
// of that forget the least recently used. References stay valid until their entry is erased.
#pragma once

#include <functional>
#include <list>
#include <unordered_map>
#include <utility>

namespace locvol {

template <class Key, class Value, class Hash = std::hash<Key>>
class RecentMap {
 public:
  // Now the most recently used; nullptr: there is none.
  Value* find(const Key& key) {
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    entries_.splice(entries_.begin(), entries_, found->second);
    return &found->second->second;
  }
  // REQUIRES: there is none
  Value& add(const Key& key, Value value = {}) {
    entries_.emplace_front(key, std::move(value));
    places_.emplace(key, entries_.begin());
    return entries_.front().second;
  }
  // The value, which stays as recently used as before. REQUIRES: there is one
  Value& at(const Key& key) { return places_.at(key)->second; }
  const Value& at(const Key& key) const { return places_.at(key)->second; }
  Value& oldest() { return entries_.back().second; }  // REQUIRES: there is one

  void erase(const Key& key) {
    if (const auto node = places_.extract(key)) entries_.erase(node.mapped());
  }
  void erase_oldest() { erase(Key(entries_.back().first)); }
  // Asks is_unwanted(key, value), the most recently used first.
  template <class Test>
  void erase_if(const Test& is_unwanted) {
    entries_.remove_if([&](const auto& entry) {
      const bool is_erased = is_unwanted(entry.first, entry.second);
      if (is_erased) places_.erase(entry.first);
      return is_erased;
    });
  }

 private:
  using Entries = std::list<std::pair<const Key, Value>>;
  Entries entries_;  // the most recently used first
  std::unordered_map<Key, typename Entries::iterator, Hash> places_;
};

}  // namespace locvol
