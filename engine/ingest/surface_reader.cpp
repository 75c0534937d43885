#include "engine/ingest/surface_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <optional>
#include <string_view>
#include <utility>

#include "engine/ingest/input_file.h"
#include "engine/ingest/surface_formats.h"

namespace locvol {
namespace {

enum class SurfaceFormat { kBinaryStl, kAsciiStl, kObj, kOff, kPly };

constexpr std::size_t kPeekBytes = std::size_t{1} << 16;

const char* name(SurfaceFormat format) {
  switch (format) {
    case SurfaceFormat::kBinaryStl:
      return "binary STL";
    case SurfaceFormat::kAsciiStl:
      return "ASCII STL";
    case SurfaceFormat::kObj:
      return "OBJ";
    case SurfaceFormat::kOff:
      return "OFF";
    case SurfaceFormat::kPly:
      return "PLY";
  }
  return "";
}

std::string_view extension(SurfaceFormat format) {
  switch (format) {
    case SurfaceFormat::kBinaryStl:
    case SurfaceFormat::kAsciiStl:
      return ".stl";
    case SurfaceFormat::kObj:
      return ".obj";
    case SurfaceFormat::kOff:
      return ".off";
    case SurfaceFormat::kPly:
      return ".ply";
  }
  return "";
}

// The first word that is not in a comment; empty if there is none in `text`.
std::string_view first_word(std::string_view text) {
  std::size_t i = 0;
  while (i < text.size()) {
    if (text[i] == '#')
      i = std::min(text.find('\n', i), text.size());
    else if (std::isspace(static_cast<unsigned char>(text[i])))
      ++i;
    else
      break;
  }
  std::size_t end = i;
  while (end < text.size() && !std::isspace(static_cast<unsigned char>(text[end]))) ++end;
  return text.substr(i, end - i);
}

std::optional<SurfaceFormat> format_of_content(InputFile& file) {
  if (is_binary_stl(file)) return SurfaceFormat::kBinaryStl;  // before "solid": those may begin so
  const std::string_view text = file.peek(kPeekBytes);
  if (text.starts_with("ply\n") || text.starts_with("ply\r")) return SurfaceFormat::kPly;
  const std::string_view word = first_word(text);
  if (is_off_keyword(word)) return SurfaceFormat::kOff;
  const bool is_text = text.find('\0') == std::string_view::npos;
  if (word == "solid" && is_text) return SurfaceFormat::kAsciiStl;
  if (is_obj_keyword(word) && is_text) return SurfaceFormat::kObj;
  return std::nullopt;
}

std::optional<SurfaceFormat> format_of_extension(const std::string& extension) {
  if (extension == ".stl") return SurfaceFormat::kBinaryStl;
  if (extension == ".obj") return SurfaceFormat::kObj;
  if (extension == ".off") return SurfaceFormat::kOff;
  if (extension == ".ply") return SurfaceFormat::kPly;
  return std::nullopt;
}

SurfaceFormat format_of(InputFile& file) {
  std::string named = file.path().extension().string();
  std::transform(named.begin(), named.end(), named.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto by_content = format_of_content(file);
  const auto by_name = format_of_extension(named);
  if (!by_content && !by_name)
    file.refuse("is in no known format; convert it to STL, OBJ, OFF or PLY");
  if (by_content && by_name && extension(*by_content) != named)
    file.refuse(fmt::format("holds {} data but is named {}; rename it to {}", name(*by_content),
                            named, extension(*by_content)));
  return by_content ? *by_content : *by_name;
}

InputFile opened(const std::filesystem::path& path, const StopToken* stop) {
  InputFile file(path, stop);
  if (file.size() == 0) file.refuse("is empty (0 bytes); fetch or export it again");
  return file;
}

}  // namespace

std::unique_ptr<SurfaceRanges> ranges_of_surface(const std::filesystem::path& path,
                                                 const StopToken* stop) {
  InputFile file = opened(path, stop);
  switch (format_of(file)) {
    case SurfaceFormat::kBinaryStl:
      return ranges_of_binary_stl(std::move(file));
    case SurfaceFormat::kPly:
      return ranges_of_ply(std::move(file));
    default:
      return nullptr;
  }
}

std::string parse_surface(const std::filesystem::path& path, SurfaceSink& sink,
                          const StopToken* stop) {
  InputFile file = opened(path, stop);
  switch (format_of(file)) {
    case SurfaceFormat::kBinaryStl:
      parse_binary_stl(file, sink);
      break;
    case SurfaceFormat::kAsciiStl:
      parse_ascii_stl(file, sink);
      break;
    case SurfaceFormat::kObj:
      parse_obj(file, sink);
      break;
    case SurfaceFormat::kOff:
      parse_off(file, sink);
      break;
    case SurfaceFormat::kPly:
      parse_ply(file, sink);
      break;
  }
  return file.digest();
}

}  // namespace locvol
