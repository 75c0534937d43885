#include "engine/formats/sheet_names.h"

#include <algorithm>
#include <cctype>
#include <set>

namespace locvol {
namespace {

bool is_word_character(char c) {
  return ('a' <= (c | 0x20) && (c | 0x20) <= 'z') || ('0' <= c && c <= '9') || c == '_';
}

// Cuts no character of UTF-8.
std::string cut(std::string name, std::size_t most_bytes) {
  if (name.size() <= most_bytes) return name;
  std::size_t end = most_bytes;
  while (end > 0 && (static_cast<unsigned char>(name[end]) & 0xc0) == 0x80) --end;
  name.resize(end);
  return name;
}

std::string allowed(const std::string& name, const NameRule& rule) {
  std::string text;
  if (rule.is_identifier && !('a' <= (name[0] | 0x20) && (name[0] | 0x20) <= 'z')) text = "S_";
  for (const char c : name) {
    if (rule.is_identifier && (static_cast<unsigned char>(c) & 0xc0) == 0x80) continue;
    const bool is_allowed = rule.is_identifier ? is_word_character(c)
                                               : rule.forbidden.find(c) == std::string_view::npos;
    text += is_allowed ? c : '_';
  }
  return text;
}

class UsedNames {
 public:
  explicit UsedNames(const NameRule& rule) : rule_(rule) {
    for (const std::string& name : rule.taken) used_.insert(key(name));
  }
  std::string unused(const std::string& name) {
    std::string unused = cut(name, rule_.most_bytes);
    for (int i = 2; !used_.insert(key(unused)).second; ++i) {
      const std::string end = '_' + std::to_string(i);
      unused = cut(name, rule_.most_bytes - end.size()) + end;
    }
    return unused;
  }

 private:
  std::string key(std::string name) const {
    if (rule_.is_identifier)
      for (char& c : name) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return name;
  }

  const NameRule& rule_;
  std::set<std::string> used_;
};

}  // namespace

std::vector<std::string> names_of_sheets(const SurfaceSheets& sheets, const NameRule& rule) {
  if (sheets.sheets.empty()) return {"boundary"};
  UsedNames used(rule);
  std::vector<std::string> names;
  for (const SheetFacts& sheet : sheets.sheets)
    names.push_back(used.unused(allowed(sheet.name, rule)));
  return names;
}

}  // namespace locvol
