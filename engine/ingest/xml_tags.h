// XmlTags cuts a file into the tags of its XML, as far as VTK's files need it: comments, processing
// instructions and declarations are skipped, entities stay as they are written, and nobody asks
// whether the ends of elements match their starts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/input_file.h"

namespace locvol {

struct XmlTag {
  std::string name;
  std::vector<std::pair<std::string, std::string>> attributes;
  bool is_start = false, is_end = false;  // of an element; <a/> is both
  std::optional<std::uint64_t> text;      // where in the file that before it starts, after blanks

  const std::string* find(std::string_view attribute) const;  // null: it has none
  std::string get(std::string_view attribute, std::string_view otherwise) const;
};

class XmlTags {
 public:
  explicit XmlTags(InputFile& file) : file_(file) {}

  // The next one, up to its '>'; none at the end of the file. Throws InputError: what begins with
  // '<' is no tag, or has no end within 64 KiB.
  std::optional<XmlTag> next();

 private:
  std::optional<std::uint64_t> skip_text();
  bool skip_other();  // a comment and the like
  void skip_past(std::string_view end);
  XmlTag take_tag();

  InputFile& file_;
};

}  // namespace locvol
