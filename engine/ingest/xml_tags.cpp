#include "engine/ingest/xml_tags.h"

#include <fmt/format.h>

#include <algorithm>

namespace locvol {
namespace {

constexpr std::size_t kMostTagBytes = std::size_t{1} << 16;
constexpr std::string_view kBlanks = " \t\r\n";

// Of a tag that starts with '<', with its '>', which is not one in quotes; npos: it has no end.
std::size_t length_of_tag(std::string_view text) {
  char quote = '\0';
  for (std::size_t i = 1; i < text.size(); ++i) {
    const char c = text[i];
    if (quote != '\0') {
      if (c == quote) quote = '\0';
    } else if (c == '"' || c == '\'') {
      quote = c;
    } else if (c == '>') {
      return i + 1;
    }
  }
  return text.npos;
}

// Cuts the front of a text off, to its first character of `ends`.
std::string_view cut(std::string_view& text, std::string_view ends) {
  const std::string_view front = text.substr(0, text.find_first_of(ends));
  text.remove_prefix(front.size());
  return front;
}

void skip_blanks(std::string_view& text) {
  text.remove_prefix(std::min(text.find_first_not_of(kBlanks), text.size()));
}

bool skip(std::string_view& text, char c) {
  if (!text.starts_with(c)) return false;
  text.remove_prefix(1);
  return true;
}

// Of what stands between '<' and '>'.
std::optional<XmlTag> parse_tag(std::string_view text) {
  XmlTag tag;
  tag.is_end = skip(text, '/');
  tag.is_start = !tag.is_end;
  if (tag.is_start && text.ends_with('/')) {
    tag.is_end = true;
    text.remove_suffix(1);
  }
  tag.name = cut(text, kBlanks);
  if (tag.name.empty() || tag.name.find_first_of("<=\"'/") != tag.name.npos) return std::nullopt;
  for (skip_blanks(text); !text.empty(); skip_blanks(text)) {
    const std::string_view name = cut(text, " \t\r\n=");
    skip_blanks(text);
    if (name.empty() || !skip(text, '=')) return std::nullopt;
    skip_blanks(text);
    const std::string_view quote = text.substr(0, 1);
    if (quote != "\"" && quote != "'") return std::nullopt;
    text.remove_prefix(1);
    tag.attributes.emplace_back(name, cut(text, quote));
    if (!skip(text, quote[0])) return std::nullopt;
  }
  return tag;
}

}  // namespace

const std::string* XmlTag::find(std::string_view attribute) const {
  for (const auto& [key, value] : attributes)
    if (key == attribute) return &value;
  return nullptr;
}

std::string XmlTag::get(std::string_view attribute, std::string_view otherwise) const {
  const std::string* const value = find(attribute);
  return value != nullptr ? *value : std::string(otherwise);
}

std::optional<XmlTag> XmlTags::next() {
  std::optional<std::uint64_t> text;
  do {
    const auto more = skip_text();
    if (!text) text = more;
    if (file_.peek(1).empty()) return std::nullopt;
  } while (skip_other());
  XmlTag tag = take_tag();
  tag.text = text;
  return tag;
}

std::optional<std::uint64_t> XmlTags::skip_text() {
  std::optional<std::uint64_t> place;
  for (;;) {
    const std::string_view view = file_.peek(kMostTagBytes);
    const std::string_view text = view.substr(0, view.find('<'));
    const std::size_t first = text.find_first_not_of(kBlanks);
    if (!place && first != text.npos) place = file_.position() + first;
    const bool is_all = text.size() < view.size() || view.empty();
    file_.take(text.size());
    if (is_all) return place;
  }
}

bool XmlTags::skip_other() {
  const std::string_view view = file_.peek(9);
  if (view.starts_with("<!--"))
    skip_past("-->");
  else if (view.starts_with("<![CDATA["))
    skip_past("]]>");
  else if (view.starts_with("<?"))
    skip_past("?>");
  else if (view.starts_with("<!"))
    skip_past(">");
  else
    return false;
  return true;
}

void XmlTags::skip_past(std::string_view end) {
  for (;;) {
    const std::string_view view = file_.peek(kMostTagBytes);
    const std::size_t found = view.find(end);
    if (found != view.npos) {
      file_.take(found + end.size());
      return;
    }
    if (view.size() < end.size()) file_.refuse_truncated();
    file_.take(view.size() - end.size() + 1);
  }
}

XmlTag XmlTags::take_tag() {
  const std::uint64_t place = file_.position();
  const std::string_view view = file_.peek(kMostTagBytes);
  const std::size_t length = length_of_tag(view);
  if (length == view.npos)
    file_.refuse(fmt::format(
        "the tag at byte {} has no end within {} bytes: the file is cut off or damaged; "
        "fetch or export it again",
        place, view.size()));
  std::optional<XmlTag> tag = parse_tag(view.substr(1, length - 2));
  if (!tag)
    file_.refuse(fmt::format(
        "what begins with '<' at byte {} is no tag of XML; the file is damaged: export it again",
        place));
  file_.take(length);
  return std::move(*tag);
}

}  // namespace locvol
