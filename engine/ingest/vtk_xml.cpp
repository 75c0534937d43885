#include "engine/ingest/vtk_xml.h"

namespace locvol {

void require_xml(InputFile& file, std::string_view what) {
  if (file.size() == 0) file.refuse("is empty; export it again");
  std::string_view start = file.peek(256);
  if (start.starts_with("\xef\xbb\xbf")) start.remove_prefix(3);
  start.remove_prefix(std::min(start.find_first_not_of(" \t\r\n"), start.size()));
  if (!start.starts_with('<'))
    file.refuse(fmt::format("is no XML, for it begins with \"{}\"; export it as {}",
                            shown(start.substr(0, 20)), what));
}

std::uint64_t place_of_appended_data(InputFile& file) {
  while (file.remaining() > 0) {
    const unsigned char c = *file.take(1);
    if (c == '_') return file.position();
    if (std::string_view(" \t\r\n").find(static_cast<char>(c)) == std::string_view::npos)
      file.refuse(
          fmt::format("its appended data begin with byte {}, not with '_'; the file is "
                      "damaged: export it again",
                      c));
  }
  file.refuse_truncated();
}

namespace {

bool choice(const InputFile& file, const XmlTag& tag, const char* attribute, std::string_view no,
            std::string_view yes) {
  const std::string value = tag.get(attribute, no);
  if (value != yes && value != no)
    file.refuse(fmt::format("{} {}=\"{}\" is unknown; it must be {} or {}", tag.name, attribute,
                            shown(value), no, yes));
  return value == yes;
}

bool is_compressed(const InputFile& file, const XmlTag& tag) {
  const std::string compressor = tag.get("compressor", "");
  if (!compressor.empty() && compressor != "vtkZLibDataCompressor")
    file.refuse(fmt::format("is compressed by {}; save it without compression or with zlib",
                            shown(compressor)));
  return !compressor.empty();
}

std::uint64_t place_of_appended(const InputFile& file, const VtkXml& xml, const XmlTag& tag) {
  if (!xml.appended) file.refuse("has no element AppendedData; export it again");
  const auto offset = numbers_in<1>(file, tag, "offset", "")[0];
  if (!(offset >= 0) || offset != std::floor(offset))
    file.refuse(fmt::format("DataArray offset=\"{}\" is no place; export it again", offset));
  if (offset >= static_cast<double>(file.size() - xml.appended_place)) file.refuse_truncated();
  return xml.appended_place + static_cast<std::uint64_t>(offset);
}

}  // namespace

VtkArray array_in(const InputFile& file, const VtkXml& xml, const XmlTag& tag,
                  std::optional<std::uint64_t> text, std::uint64_t num_values) {
  VtkArray array{.name = tag.get("Name", ""),
                 .type = *vtk_type_named(tag.get("type", "")),
                 .num_values = num_values};
  const std::string format = tag.get("format", "ascii");
  if (format == "appended") {
    array.place = place_of_appended(file, xml, tag);
    array.is_inline = false;
    array.encoding = choice(file, *xml.appended, "encoding", "base64", "raw")
                         ? VtkArray::Encoding::kRaw
                         : VtkArray::Encoding::kBase64;
  } else if (format == "ascii" || format == "binary") {
    if (!text)
      file.refuse(fmt::format("array \"{}\" has no values; export the file again",
                              shown(tag.get("Name", ""))));
    array.place = *text;
    if (format == "binary") array.encoding = VtkArray::Encoding::kBase64;
  } else {
    file.refuse(
        fmt::format("DataArray format=\"{}\" is unknown; it must be ascii, binary or "
                    "appended",
                    shown(format)));
  }
  if (format == "ascii") return array;
  array.is_big_endian = choice(file, xml.file, "byte_order", "LittleEndian", "BigEndian");
  array.has_wide_head = choice(file, xml.file, "header_type", "UInt32", "UInt64");
  array.is_compressed = is_compressed(file, xml.file);
  return array;
}

}  // namespace locvol
