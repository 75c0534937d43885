// What the XML of VTK's files says of their arrays.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "engine/ingest/input_file.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/vtk_values.h"
#include "engine/ingest/xml_tags.h"

namespace locvol {

struct VtkXml {
  XmlTag file;  // VTKFile
  std::optional<XmlTag> appended;
  std::uint64_t appended_place = 0;  // of offset 0
};

// Throws InputError if what comes next is no XML; `what` would be right.
void require_xml(InputFile& file, std::string_view what);

// Of an attribute, which may be absent. Throws InputError.
template <std::size_t N>
std::array<double, N> numbers_in(const InputFile& file, const XmlTag& tag, const char* attribute,
                                 std::string_view otherwise) {
  const std::string text = tag.get(attribute, otherwise);
  const auto refuse = [&] {
    file.refuse(fmt::format("{} {}=\"{}\" is no list of {} finite numbers; correct it", tag.name,
                            attribute, shown(text), N));
  };
  std::array<double, N> values{};
  std::size_t begin = 0;
  for (double& value : values) {
    begin = std::min(text.find_first_not_of(" \t\r\n", begin), text.size());
    const std::size_t end = std::min(text.find_first_of(" \t\r\n", begin), text.size());
    const auto number = parse_number(std::string_view(text).substr(begin, end - begin));
    if (!number || !std::isfinite(*number)) refuse();
    value = *number;
    begin = end;
  }
  if (text.find_first_not_of(" \t\r\n", begin) != text.npos) refuse();
  return values;
}

// Where offset 0 is. REQUIRES: the tag AppendedData was taken last. Throws InputError.
std::uint64_t place_of_appended_data(InputFile& file);

// How and where the values of a DataArray are written. `text`: what stands between its tags. Its
// type is known. Throws InputError.
VtkArray array_in(const InputFile& file, const VtkXml& xml, const XmlTag& tag,
                  std::optional<std::uint64_t> text, std::uint64_t num_values);

}  // namespace locvol
