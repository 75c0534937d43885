#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/number_bytes.h"
#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/value_reader.h"
#include "engine/ingest/vertex_cache.h"

namespace locvol {
namespace {

constexpr std::array<std::pair<std::string_view, NumberType>, 18> kTypeNames = {{
    {"char", NumberType::kInt8},
    {"int8", NumberType::kInt8},
    {"uchar", NumberType::kUint8},
    {"uint8", NumberType::kUint8},
    {"short", NumberType::kInt16},
    {"int16", NumberType::kInt16},
    {"ushort", NumberType::kUint16},
    {"uint16", NumberType::kUint16},
    {"int", NumberType::kInt32},
    {"int32", NumberType::kInt32},
    {"uint", NumberType::kUint32},
    {"uint32", NumberType::kUint32},
    {"int64", NumberType::kInt64},
    {"uint64", NumberType::kUint64},
    {"float", NumberType::kFloat32},
    {"float32", NumberType::kFloat32},
    {"double", NumberType::kFloat64},
    {"float64", NumberType::kFloat64},
}};

struct Property {
  std::string name;
  std::optional<NumberType> count_type;    // of a list
  NumberType type = NumberType::kFloat32;  // of a value
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
};

class HeaderParser {
 public:
  explicit HeaderParser(InputFile& file) : file_(file) {}

  Header parse() {
    file_.set_line_end(line_end());
    next_line();
    if (word() != "ply") file_.refuse_line("is no PLY file: its first line must be \"ply\"");
    bool has_format = false;
    for (;;) {
      next_line();
      const std::string_view keyword = word();
      if (keyword == "end_header") break;
      if (keyword == "format") {
        header_.encoding = encoding();
        has_format = true;
      } else if (keyword == "element") {
        header_.elements.push_back(element());
      } else if (keyword == "property") {
        if (header_.elements.empty()) file_.refuse_line("a property stands before any element");
        header_.elements.back().properties.push_back(property());
      } else if (keyword != "comment" && keyword != "obj_info" && !keyword.empty()) {
        file_.refuse_line("is no line of a PLY header; the file is damaged");
      }
    }
    if (!has_format) file_.refuse("its PLY header lacks the line \"format\"");
    file_.set_line_end(InputFile::LineEnd::kAny);
    return std::move(header_);
  }

 private:
  // That of the first line: what follows the header may be bytes of any value.
  InputFile::LineEnd line_end() {
    constexpr std::size_t kFirstLineBytes = 64;
    const std::string_view head = file_.peek(kFirstLineBytes);
    const std::size_t end = head.find_first_of("\r\n");
    return end != std::string_view::npos && head[end] == '\r' && head.substr(end, 2) != "\r\n"
               ? InputFile::LineEnd::kReturn
               : InputFile::LineEnd::kLineFeed;
  }

  void next_line() {
    if (!file_.next_line(line_))
      file_.refuse("ends inside its PLY header: it is cut off; fetch or export it again");
  }

  // Cuts the next word off the line; empty at its end.
  std::string_view word() {
    line_.remove_prefix(std::min(line_.find_first_not_of(" \t"), line_.size()));
    const std::string_view found = line_.substr(0, line_.find_first_of(" \t"));
    line_.remove_prefix(found.size());
    return found;
  }

  Encoding encoding() {
    const std::string_view name = word();
    if (name == "ascii") return Encoding::kAscii;
    if (name == "binary_little_endian") return Encoding::kLittleEndian;
    if (name == "binary_big_endian") return Encoding::kBigEndian;
    file_.refuse_line(
        "is no format of PLY; known are ascii, binary_little_endian and "
        "binary_big_endian");
  }

  Element element() {
    Element element;
    element.name = word();
    const std::int64_t count = TextScanner(file_).integer(word(), "number of elements");
    if (count < 0) file_.refuse_line("the number of elements is negative");
    element.count = static_cast<std::uint64_t>(count);
    for (const Element& other : header_.elements)
      if (other.name == element.name) file_.refuse_line("an element of this name is there already");
    return element;
  }

  Property property() {
    Property property;
    std::string_view first = word();
    if (first == "list") {
      property.count_type = type(word());
      if (!is_integer(*property.count_type)) file_.refuse_line("the count of a list is no integer");
      first = word();
    }
    property.type = type(first);
    property.name = word();
    return property;
  }

  NumberType type(std::string_view name) const {
    for (const auto& [known, type] : kTypeNames)
      if (name == known) return type;
    file_.refuse_line("has a property of unknown type; the file is damaged");
  }

  InputFile& file_;
  std::string_view line_;
  Header header_;
};

void skip(ValueReader& values, const Property& property) {
  const std::uint64_t n =
      property.count_type ? values.count(*property.count_type, "length of a list") : 1;
  for (std::uint64_t i = 0; i < n; ++i) values.skip(property.type);
}

// The least bytes that one element takes: a list may be empty; a value in ASCII is a digit and a
// blank or the end of the line.
std::uint64_t min_bytes(const Element& element, Encoding encoding) {
  std::uint64_t bytes = 0;
  for (const Property& property : element.properties)
    bytes +=
        encoding == Encoding::kAscii ? 2 : bytes_of(property.count_type.value_or(property.type));
  return bytes;
}

void check_counts(const InputFile& file, const Header& header) {
  std::uint64_t available = file.remaining() + 1;  // the last line may lack its end
  for (const Element& element : header.elements) {
    if (element.count == 0) continue;
    const std::uint64_t bytes = min_bytes(element, header.encoding);
    if (bytes == 0) file.refuse(fmt::format("its element {} has no properties", element.name));
    if (element.count > available / bytes)
      file.refuse(
          fmt::format("its header promises {} elements \"{}\", more than the remaining {} bytes "
                      "can hold; the file "
                      "is cut off or its header is wrong",
                      element.count, element.name, file.remaining()));
    available -= element.count * bytes;
  }
}

const Element* find(const Header& header, std::string_view name) {
  for (const Element& element : header.elements)
    if (element.name == name) return &element;
  return nullptr;
}

// Of a vertex' properties, each one's axis; -1: none.
std::vector<int> axes_of(const InputFile& file, const Element& element) {
  std::vector<int> axes;
  for (const Property& p : element.properties)
    axes.push_back(p.count_type    ? -1
                   : p.name == "x" ? 0
                   : p.name == "y" ? 1
                   : p.name == "z" ? 2
                                   : -1);
  for (int axis = 0; axis < 3; ++axis)
    if (std::count(axes.begin(), axes.end(), axis) != 1)
      file.refuse("its vertices must have one property each of the names x, y and z");
  return axes;
}

// The next elements of a kind, by their numbers.
struct NumberRange {
  std::uint64_t first = 0, end = 0;
};

void read_vertices(const InputFile& file, const Element& element, NumberRange numbers,
                   ValueReader& values, SurfaceSink& sink) {
  const std::vector<int> axes = axes_of(file, element);
  for (std::uint64_t v = numbers.first; v < numbers.end; ++v) {
    Point p;
    for (std::size_t i = 0; i < axes.size(); ++i) {
      if (axes[i] < 0)
        skip(values, element.properties[i]);
      else
        p[axes[i]] = values.number(element.properties[i].type);
    }
    give_vertex(file, v, p, sink);
  }
}

// Which of a face's properties is the list of its corners.
std::size_t list_of_corners(const InputFile& file, const Element& element,
                            const char* things = "faces") {
  std::optional<std::size_t> list;
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const Property& p = element.properties[i];
    if (p.name == "vertex_indices" || p.name == "vertex_index") list = i;
  }
  if (!list || !element.properties[*list].count_type || !is_integer(element.properties[*list].type))
    file.refuse(fmt::format(
        "its {} must have a list of integers named vertex_indices or vertex_index", things));
  return *list;
}

// The property whose values tell faces' groups apart, as "region 3".
std::optional<std::size_t> property_of_groups(const Element& element) {
  for (const std::string_view name : kGroupProperties)
    for (std::size_t i = 0; i < element.properties.size(); ++i) {
      const Property& p = element.properties[i];
      if (p.name == name && !p.count_type && is_integer(p.type)) return i;
    }
  return std::nullopt;
}

constexpr std::uint64_t kAnyCorners = ~std::uint64_t{0};

// Throws InputError for faces of more than `most_corners`.
void read_faces(const InputFile& file, const Element& element, NumberRange numbers,
                ValueReader& values, SurfaceSink& sink, std::uint64_t most_corners = kAnyCorners) {
  const std::size_t list = list_of_corners(file, element);
  const std::optional<std::size_t> group_property = property_of_groups(element);
  std::optional<std::int64_t> group;
  std::vector<std::uint64_t> corners;
  for (std::uint64_t f = numbers.first; f < numbers.end; ++f) {
    for (std::size_t i = 0; i < element.properties.size(); ++i) {
      const Property& p = element.properties[i];
      if (i == group_property) {
        const std::int64_t value = values.integer(p.type, "number of a group");
        if (group != value) sink.group(fmt::format("{} {}", p.name, value));
        group = value;
        continue;
      }
      if (i != list) {
        skip(values, p);
        continue;
      }
      const std::uint64_t num_corners = values.count(*p.count_type, "number of corners");
      if (num_corners > most_corners)
        file.refuse(
            fmt::format("face {} has {} corners, more than {}", f + 1, num_corners, most_corners));
      corners.clear();
      for (std::uint64_t c = 0; c < num_corners; ++c)
        corners.push_back(values.count(p.type, "number of a vertex"));
    }
    sink.polygon(corners, values.place(f));
  }
}

// `length`: of the list that holds the strip, or several.
void read_strip(std::uint64_t length, std::uint64_t strip, NumberType type, ValueReader& values,
                SurfaceSink& sink) {
  std::array<std::uint64_t, 3> corners{};
  for (std::uint64_t i = 0, num_corners = 0; i < length; ++i) {
    const std::int64_t number = values.integer(type, "number of a vertex");
    if (number < 0) {
      num_corners = 0;
      continue;
    }
    corners = {corners[1], corners[2], static_cast<std::uint64_t>(number)};
    if (++num_corners < 3) continue;
    const auto [a, b, c] = corners;
    if (a == b || b == c || c == a) continue;  // which strips turn around by
    const std::array<std::uint64_t, 3> turned = {b, a, c};
    sink.polygon(num_corners % 2 == 1 ? corners : turned, values.place(strip));
  }
}

// Strips of triangles, as files of the Stanford 3D Scanning Repository have them: of each, three
// corners in a row are a triangle, every other one the other way around; -1 begins another strip.
void read_strips(const InputFile& file, const Element& element, ValueReader& values,
                 SurfaceSink& sink) {
  const std::size_t list = list_of_corners(file, element, "triangle strips");
  for (std::uint64_t s = 0; s < element.count; ++s)
    for (std::size_t i = 0; i < element.properties.size(); ++i) {
      const Property& p = element.properties[i];
      if (i == list)
        read_strip(values.count(*p.count_type, "length of a strip"), s, p.type, values, sink);
      else
        skip(values, p);
    }
}

// Of a binary file in which all elements of a kind take as many bytes, and faces are triangles:
// what begins where.
struct Block {
  Element element;
  std::uint64_t begin = 0, stride = 0;  // bytes
};
struct Blocks {
  Encoding encoding = Encoding::kLittleEndian;
  Block vertices, faces;
};

// `list`: of a face's corners, which are three.
std::optional<std::uint64_t> stride_of(const Element& element, std::optional<std::size_t> list) {
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < element.properties.size(); ++i) {
    const Property& p = element.properties[i];
    if (p.count_type && i != list) return std::nullopt;
    bytes += p.count_type ? bytes_of(*p.count_type) + 3 * bytes_of(p.type) : bytes_of(p.type);
  }
  return bytes;
}

std::optional<Blocks> blocks_in(InputFile& file) {
  const Header header = HeaderParser(file).parse();
  check_counts(file, header);
  const Element* const vertices = find(header, "vertex");
  const Element* const faces = find(header, "face");
  if (header.encoding == Encoding::kAscii || !vertices || !faces) return std::nullopt;
  Blocks blocks{.encoding = header.encoding, .vertices = {}, .faces = {}};
  std::uint64_t position = file.position();
  for (const Element& element : header.elements) {
    std::optional<std::size_t> list;
    if (&element == faces) list = list_of_corners(file, element);
    const auto stride = stride_of(element, list);
    if (!stride || (*stride > 0 && element.count > (file.size() - position) / *stride))
      return std::nullopt;
    if (&element == vertices) blocks.vertices = {element, position, *stride};
    if (&element == faces) blocks.faces = {element, position, *stride};
    position += element.count * *stride;
  }
  return position == file.size() ? std::optional(std::move(blocks)) : std::nullopt;
}

// Gives triangles to a sink as facets, with the vertices that they name.
class FacetsOfFaces : public SurfaceSink {
 public:
  FacetsOfFaces(const InputFile& file, const Blocks& blocks, SurfaceSink& sink)
      : file_(file),
        encoding_(blocks.encoding),
        vertices_(blocks.vertices),
        axes_(axes_of(file, vertices_.element)),
        sink_(sink) {}

  void group(std::string_view name) override { sink_.group(name); }
  void vertex(const Point&) override {}
  void polygon(std::span<const std::uint64_t> corners, const FilePlace& place) override {
    if (corners.size() != 3) file_.refuse(to_string(place) + " is no triangle");
    std::array<Point, 3> points;
    for (std::size_t i = 0; i < 3; ++i) {
      if (corners[i] >= vertices_.element.count)
        file_.refuse(to_string(place) + " names a vertex that is not there");
      points[i] = cache_.at(corners[i], [&](std::uint64_t number, std::span<Point> vertices) {
        load(number * vertices.size(), vertices);
      });
    }
    sink_.facet(points);
  }
  void facet(const std::array<Point, 3>& corners) override { sink_.facet(corners); }

 private:
  void load(std::uint64_t first, std::span<Point> vertices) {
    const std::size_t count = std::min(vertices.size(), vertices_.element.count - first);
    bytes_.resize(count * vertices_.stride);
    file_.read_at(vertices_.begin + first * vertices_.stride, bytes_);
    const unsigned char* value = bytes_.data();
    for (Point& p : vertices.first(count))
      for (std::size_t i = 0; i < axes_.size(); ++i) {
        const NumberType type = vertices_.element.properties[i].type;
        if (axes_[i] >= 0) p[axes_[i]] = number_in(value, type, encoding_ == Encoding::kBigEndian);
        value += bytes_of(type);
      }
  }

  const InputFile& file_;
  Encoding encoding_;
  const Block& vertices_;
  std::vector<int> axes_;
  SurfaceSink& sink_;
  VertexCache cache_;
  std::vector<unsigned char> bytes_;
};

class PlyRanges : public SurfaceRanges {
 public:
  PlyRanges(InputFile file, Blocks blocks)
      : SurfaceRanges(std::move(file), blocks.faces.element.count, blocks.vertices.element.count),
        blocks_(std::move(blocks)) {}

  void read_part(std::uint64_t part, std::uint64_t num_parts, SurfaceSink& sink) override {
    FacetsOfFaces facets(file_, blocks_, sink);
    ValueReader values(file_, blocks_.encoding);
    const auto numbers_of = [&](const Block& block) {
      const std::uint64_t count = block.element.count;
      const NumberRange numbers{begin_of_part(count, part, num_parts),
                                begin_of_part(count, part + 1, num_parts)};
      file_.seek(block.begin + numbers.first * block.stride);
      return numbers;
    };
    const NumberRange vertices = numbers_of(blocks_.vertices);
    read_vertices(file_, blocks_.vertices.element, vertices, values, facets);
    const NumberRange faces = numbers_of(blocks_.faces);
    read_faces(file_, blocks_.faces.element, faces, values, facets, 3);
  }

 private:
  Blocks blocks_;
};

}  // namespace

std::unique_ptr<SurfaceRanges> ranges_of_ply(InputFile file) {
  auto blocks = blocks_in(file);
  if (!blocks) return nullptr;
  return std::make_unique<PlyRanges>(std::move(file), std::move(*blocks));
}

void parse_ply(InputFile& file, SurfaceSink& sink) {
  const Header header = HeaderParser(file).parse();
  check_counts(file, header);
  const Element* const vertices = find(header, "vertex");
  const Element* const faces = find(header, "face");
  const Element* const strips = find(header, "tristrips");

  if (faces) sink.announce(faces->count);
  ValueReader values(file, header.encoding);
  for (const Element& element : header.elements) {
    if (&element == vertices)
      read_vertices(file, element, {0, element.count}, values, sink);
    else if (&element == faces)
      read_faces(file, element, {0, element.count}, values, sink);
    else if (&element == strips)
      read_strips(file, element, values, sink);
    else
      for (std::uint64_t i = 0; i < element.count; ++i)
        for (const Property& property : element.properties) skip(values, property);
  }
  if (values.has_more())
    file.refuse("goes on after the elements that its header promises; correct the header");
}

}  // namespace locvol
