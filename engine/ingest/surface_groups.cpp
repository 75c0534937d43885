#include "engine/ingest/surface_groups.h"

#include <algorithm>
#include <utility>

#include "engine/ingest/text_scanner.h"

namespace locvol {
namespace {

// How many bytes the character of UTF-8 has that the text begins with; 0: it begins with none.
std::size_t character_bytes(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t length = byte(0) < 0x80                       ? 1
                             : byte(0) >= 0xc2 && byte(0) <= 0xdf ? 2
                             : (byte(0) & 0xf0) == 0xe0           ? 3
                             : byte(0) >= 0xf0 && byte(0) <= 0xf4 ? 4
                                                                  : 0;
  if (length == 0 || length > text.size()) return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((byte(i) & 0xc0) != 0x80) return 0;
  if (length < 3) return length;
  // Longer than need be, a half of a pair of UTF-16, or beyond Unicode.
  const unsigned first_two = byte(0) << 8 | byte(1);
  const bool is_none = first_two < 0xe0a0 || (first_two >= 0xeda0 && first_two < 0xee00) ||
                       (first_two >= 0xf000 && first_two < 0xf090) || first_two >= 0xf490;
  return is_none ? 0 : length;
}

}  // namespace

std::string shown_name(std::string_view text) {
  text = trimmed(text);
  std::string name;
  while (!text.empty()) {
    const std::size_t length = character_bytes(text);
    if (name.size() + std::max<std::size_t>(length, 1) > SurfaceGroups::kMaxNameBytes) break;
    const bool is_seen = length > 1 || (length == 1 && text[0] >= ' ' && text[0] != '\x7f');
    name += is_seen ? text.substr(0, length) : "_";
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return std::string(trimmed(name));
}

void SurfaceGroups::begin(std::string_view name) {
  name_ = shown_name(name);
  has_cut_names_ |= trimmed(name).size() > kMaxNameBytes;
  current_ = kUnknown;
}

void SurfaceGroups::begin_body(std::string_view name) {
  body_name_ = shown_name(name);
  ++num_bodies_;
  name_.clear();
  current_ = kUnknown;
}

std::uint32_t SurfaceGroups::current() {
  if (current_ != kUnknown) return current_;
  const auto next = static_cast<std::uint32_t>(numbers_.size());
  const std::uint32_t body = num_bodies_ == 0 ? 0 : num_bodies_ - 1;
  const auto [group, is_new] = groups_.emplace(Key{body, name_.empty() ? body_name_ : name_}, next);
  if (is_new) {
    numbers_.push_back(0);
    keys_.push_back(&group->first);
  }
  return current_ = group->second;
}

void SurfaceGroups::give_number(std::uint32_t group) {
  const auto& [body, name] = *keys_[group];
  names_.push_back(name);
  bodies_.push_back(body);
  numbers_[group] = static_cast<SheetId>(names_.size());
}

}  // namespace locvol
