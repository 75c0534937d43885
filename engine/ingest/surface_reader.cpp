#include "engine/ingest/surface_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include "engine/ingest/cad_file.h"
#include "engine/ingest/gzip_reader.h"
#include "engine/ingest/input_file.h"
#include "engine/ingest/surface_formats.h"

namespace locvol {
namespace {

enum class SurfaceFormat {
  kBinaryStl,
  kAsciiStl,
  kObj,
  kOff,
  kPly,
  kVtk,
  kVtp,
  kGmsh,
  k3mf,
  kGlb,
  kGltf,
  kStep,  // these three are read by CadFile
  kIges,
  kBrep
};

constexpr std::size_t kPeekBytes = std::size_t{1} << 16;
constexpr std::uint64_t kLeastStlBytes = 84;  // of a binary file: its header

struct FormatNames {
  SurfaceFormat format;
  const char* name;
  std::string_view extension;
};
constexpr std::array<FormatNames, 17> kFormats = {{
    {SurfaceFormat::kBinaryStl, "binary STL", ".stl"},
    {SurfaceFormat::kAsciiStl, "ASCII STL", ".stl"},
    {SurfaceFormat::kObj, "OBJ", ".obj"},
    {SurfaceFormat::kOff, "OFF", ".off"},
    {SurfaceFormat::kPly, "PLY", ".ply"},
    {SurfaceFormat::kVtk, "legacy VTK", ".vtk"},
    {SurfaceFormat::kVtp, "VTK XML", ".vtp"},
    {SurfaceFormat::kGmsh, "Gmsh", ".msh"},
    {SurfaceFormat::k3mf, "3MF", ".3mf"},
    {SurfaceFormat::kGlb, "binary glTF", ".glb"},
    {SurfaceFormat::kGltf, "glTF", ".gltf"},
    {SurfaceFormat::kStep, "STEP", ".step"},
    {SurfaceFormat::kStep, "STEP", ".stp"},
    {SurfaceFormat::kIges, "IGES", ".igs"},
    {SurfaceFormat::kIges, "IGES", ".iges"},
    {SurfaceFormat::kBrep, "BREP", ".brep"},
    {SurfaceFormat::kBrep, "BREP", ".brp"},
}};

const FormatNames& names_of(SurfaceFormat format) {
  return *std::ranges::find(kFormats, format, &FormatNames::format);
}
const char* name(SurfaceFormat format) { return names_of(format).name; }
std::string_view extension(SurfaceFormat format) { return names_of(format).extension; }

// The first word that is not in a comment; empty if there is none in `text`.
std::string_view first_word(std::string_view text) {
  std::size_t i = 0;
  while (i < text.size()) {
    if (text[i] == '#')
      i = std::min(text.find_first_of("\r\n", i), text.size());
    else if (std::isspace(static_cast<unsigned char>(text[i])))
      ++i;
    else
      break;
  }
  std::size_t end = i;
  while (end < text.size() && !std::isspace(static_cast<unsigned char>(text[end]))) ++end;
  return text.substr(i, end - i);
}

// The first bytes tell: those of a binary STL file end in a count, whose highest byte is no
// character. No text in UTF-8 has the two largest bytes.
bool is_text(std::string_view head) {
  constexpr std::size_t kHeadBytes = 84;
  head = head.substr(0, kHeadBytes);
  if (head.size() < kHeadBytes)  // it may be padded
    head = head.substr(0, head.find_last_not_of(std::string_view("\0\x1a", 2)) + 1);
  return std::ranges::all_of(
      head, [](unsigned char c) { return (c >= ' ' && c < 0xfe) || std::isspace(c); });
}

// ---- What is to be made something else first

struct Packing {
  std::size_t place;  // of its mark
  std::string_view mark;
  const char* name;
  const char* command;  // which unpacks
};
constexpr std::array<Packing, 10> kPackings = {{
    {0, "PK\3\4", "a zip archive", "unzip"},
    {0,
     std::string_view("\xfd"
                      "7zXZ\0",
                      6),
     "packed by xz", "xz -dk"},
    {0, "BZh", "packed by bzip2", "bzip2 -dk"},
    {0, "\x28\xb5\x2f\xfd", "packed by zstd", "zstd -d"},
    {0, "\x1f\x8b", "packed by gzip twice", "gzip -dk"},
    {0, "\x1f\x9d", "packed by compress", "gzip -dk"},
    {0, "\x04\x22\x4d\x18", "packed by lz4", "lz4 -d"},
    {0, "7z\xbc\xaf\x27\x1c", "a 7z archive", "7z x"},
    {0, "Rar!\x1a\x07", "a rar archive", "unrar x"},
    {257, "ustar", "a tar archive", "tar -xf"},
}};

void refuse_packed(const InputFile& file, std::string_view head) {
  for (const auto& [place, mark, name, command] : kPackings)
    if (head.size() > place && head.substr(place).starts_with(mark))
      file.refuse(fmt::format("is {}; unpack it first, by {}", name, command));
}

// The name of an encoding in which a character takes two bytes or four; empty: it is none.
std::string_view wide_encoding(std::string_view head) {
  constexpr std::size_t kMostBytes = 64, kLeastBytes = 8;
  if (head.starts_with(std::string_view("\xff\xfe\0\0", 4))) return "UTF-32";
  if (head.starts_with(std::string_view("\0\0\xfe\xff", 4))) return "UTF-32";
  if (head.starts_with("\xff\xfe") || head.starts_with("\xfe\xff")) return "UTF-16";
  head = head.substr(0, std::min(kMostBytes, head.size() / 2 * 2));
  if (head.size() < kLeastBytes) return {};
  const auto is_ascii_at = [&](std::size_t first) {
    for (std::size_t i = 0; i < head.size(); ++i) {
      const auto c = static_cast<unsigned char>(head[i]);
      const bool is_character = (c >= ' ' && c <= '~') || std::isspace(c);
      if (i % 2 == first ? !is_character : c != 0) return false;
    }
    return true;
  };
  return is_ascii_at(0) ? "UTF-16LE" : is_ascii_at(1) ? "UTF-16BE" : "";
}

void refuse_wide_text(const InputFile& file, std::string_view head) {
  const std::string_view encoding = wide_encoding(head);
  if (encoding.empty()) return;
  file.refuse(
      fmt::format("is text in {}, as Windows writes it; make it UTF-8 first, by iconv -f {} -t "
                  "UTF-8",
                  encoding, encoding));
}

// ---- Its format

std::optional<SurfaceFormat> format_of_text(std::string_view text) {
  if (text.starts_with("ply") && text.size() > 3 &&
      std::isspace(static_cast<unsigned char>(text[3])))
    return SurfaceFormat::kPly;
  if (text.starts_with("# vtk DataFile Version")) return SurfaceFormat::kVtk;
  const std::string_view word = first_word(text);
  if (word == "$MeshFormat" || word == "$Comments") return SurfaceFormat::kGmsh;
  if (word.starts_with('<') && text.find("<VTKFile") != text.npos) return SurfaceFormat::kVtp;
  if (word.starts_with('{') && text.find("\"asset\"") != text.npos) return SurfaceFormat::kGltf;
  if (is_off_keyword(word)) return SurfaceFormat::kOff;
  if (!is_text(text)) return std::nullopt;
  if (has_stl_line(text)) return SurfaceFormat::kAsciiStl;
  if (is_obj_keyword(word)) return SurfaceFormat::kObj;
  return std::nullopt;
}

SurfaceFormat format_of_cad(CadFormat format) {
  switch (format) {
    case CadFormat::kStep:
      return SurfaceFormat::kStep;
    case CadFormat::kIges:
      return SurfaceFormat::kIges;
    case CadFormat::kBrep:
      break;
  }
  return SurfaceFormat::kBrep;
}

// Takes a byte order mark off what is text.
std::optional<SurfaceFormat> format_of_content(InputFile& file) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (is_binary_stl(file)) return SurfaceFormat::kBinaryStl;  // before "solid": those may begin so
  const std::string_view head = file.peek(kPeekBytes);
  if (head.starts_with("glTF")) return SurfaceFormat::kGlb;
  if (const auto cad = cad_format_of(head)) return format_of_cad(*cad);
  if (is_3mf(file)) return SurfaceFormat::k3mf;
  refuse_packed(file, head);
  refuse_wide_text(file, head);
  if (head.starts_with(kByteOrderMark) && is_text(head)) file.take(kByteOrderMark.size());
  return format_of_text(file.peek(kPeekBytes));
}

std::optional<SurfaceFormat> format_of_extension(const std::string& extension, bool has_text) {
  if (extension == ".stl") return has_text ? SurfaceFormat::kAsciiStl : SurfaceFormat::kBinaryStl;
  const auto named = std::ranges::find(kFormats, extension, &FormatNames::extension);
  if (named != kFormats.end()) return named->format;
  return std::nullopt;
}

std::string extension_of(std::filesystem::path path) {
  const auto extension = [&] {
    std::string text = path.extension().string();
    std::ranges::transform(text, text.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
  };
  if (extension() == ".gz") path.replace_extension();
  return extension();
}

SurfaceFormat format_of(InputFile& file) {
  const std::string named = extension_of(file.path());
  if (named == extension(SurfaceFormat::k3mf) && file.peek(2) == "PK") return SurfaceFormat::k3mf;
  const auto by_content = format_of_content(file);
  const bool has_text = is_text(file.peek(kPeekBytes));
  const auto by_name = format_of_extension(named, has_text);
  if (by_content && by_name && extension(*by_content) != extension(*by_name))
    file.refuse(fmt::format("holds {} data but is named {}; rename it to {}", name(*by_content),
                            named, extension(*by_content)));
  if (by_content) return *by_content;
  if (by_name) return *by_name;
  // What has no name, as from a pipe, may be binary STL that is odd or cut off.
  if (!named.empty() || has_text || file.size() < kLeastStlBytes)
    file.refuse(
        "is in no known format; convert it to STEP, STL, OBJ, OFF, PLY, VTP, Gmsh, 3MF "
        "or GLB");
  return SurfaceFormat::kBinaryStl;
}

// What holds faces goes to CadFile; here comes what is only named so.
[[noreturn]] void refuse_faces(const InputFile& file, const char* format, const char* begin) {
  file.refuse(
      fmt::format("is named as a {} file, but holds none: it does not begin with {}; fetch or "
                  "export it again",
                  format, begin));
}

InputFile opened(std::shared_ptr<const InputBytes> bytes, const StopToken* stop) {
  InputFile file(std::move(bytes), stop);
  if (file.size() == 0) file.refuse("is empty (0 bytes); fetch or export it again");
  return file;
}

}  // namespace

std::unique_ptr<SurfaceRanges> ranges_of_surface(const std::filesystem::path& path,
                                                 const StopToken* stop) {
  std::error_code not_there;  // which is told below
  if (std::filesystem::exists(path, not_there) && !std::filesystem::is_regular_file(path))
    return nullptr;
  auto bytes = std::make_shared<InputBytes>(path);
  if (GzipReader::is_gzip(*bytes)) return nullptr;
  InputFile file = opened(std::move(bytes), stop);
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
  return parse_surface(std::make_shared<InputBytes>(path), sink, stop);
}

std::string parse_surface(std::shared_ptr<const InputBytes> bytes, SurfaceSink& sink,
                          const StopToken* stop) {
  InputFile file = opened(std::move(bytes), stop);
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
    case SurfaceFormat::kVtk:
      parse_vtk(file, sink);
      break;
    case SurfaceFormat::kVtp:
      parse_vtp(file, sink);
      break;
    case SurfaceFormat::kGmsh:
      parse_gmsh(file, sink);
      break;
    case SurfaceFormat::k3mf:
      parse_3mf(file, sink);
      break;
    case SurfaceFormat::kGlb:
    case SurfaceFormat::kGltf:
      parse_gltf(file, sink);
      break;
    case SurfaceFormat::kStep:
      refuse_faces(file, "STEP", "ISO-10303-21;");
    case SurfaceFormat::kIges:
      refuse_faces(file, "IGES", "a line of section S");
    case SurfaceFormat::kBrep:
      refuse_faces(file, "BREP", "DBRep_DrawableShape, or CASCADE Topology");
  }
  return file.digest();
}

}  // namespace locvol
