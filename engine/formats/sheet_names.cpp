#include "engine/formats/sheet_names.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <map>
#include <set>
#include <utility>

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

std::vector<std::string> sheet_names(const SurfaceSheets& sheets, const NameRule& rule,
                                     UsedNames& used) {
  if (sheets.sheets.empty()) return {"boundary"};
  std::vector<std::string> names;
  for (const SheetFacts& sheet : sheets.sheets)
    names.push_back(used.unused(allowed(sheet.name, rule)));
  return names;
}

}  // namespace

std::vector<std::string> names_of_sheets(const SurfaceSheets& sheets, const NameRule& rule) {
  UsedNames used(rule);
  return sheet_names(sheets, rule, used);
}

bool has_name(const SurfaceSheets& sheets, SheetId sheet) {
  return 0 < sheet && sheet <= sheets.sheets.size() && !sheets.sheets[sheet - 1].group.empty();
}

std::vector<std::string> crease_names(const SurfaceSheets& sheets) {
  std::map<std::array<SheetId, 2>, std::pair<int, int>> num;  // in all, and so far
  for (const CreaseFacts& crease : sheets.creases) ++num[crease.sheets].first;
  std::vector<std::string> names;
  for (const CreaseFacts& crease : sheets.creases) {
    const auto& [a, b] = crease.sheets;
    if (!has_name(sheets, a) || !has_name(sheets, b)) {
      names.push_back("crease " + std::to_string(names.size() + 1));
      continue;
    }
    auto& [all, so_far] = num[crease.sheets];
    names.push_back(sheets.sheets[a - 1].name + '/' + sheets.sheets[b - 1].name);
    if (all > 1) names.back() += '_' + std::to_string(++so_far);
  }
  return names;
}

MeshNames names_of_mesh(const SurfaceSheets& sheets, bool has_creases, const NameRule& rule) {
  UsedNames used(rule);
  MeshNames names;
  if (sheets.has_several_bodies())
    for (const BodyFacts& body : sheets.bodies)
      names.bodies.push_back(used.unused(allowed(body.name, rule)));
  else
    names.bodies.push_back("volume");
  names.sheets = sheet_names(sheets, rule, used);
  if (!has_creases) return names;
  for (const std::string& name : crease_names(sheets))
    names.creases.push_back(used.unused(allowed(name, rule)));
  for (std::uint64_t corner = 1; corner <= sheets.num_corners; ++corner)
    names.corners.push_back(used.unused(allowed("corner " + std::to_string(corner), rule)));
  return names;
}

}  // namespace locvol
