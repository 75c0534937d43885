#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/cell_sections.h"
#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/value_reader.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMostLegacyCount = std::uint64_t{1} << 48;

// As legacy files spell them. On all systems that write them now a long has 8 bytes.
constexpr std::array<std::pair<std::string_view, NumberType>, 15> kLegacyTypes = {{
    {"char", NumberType::kInt8},
    {"signed_char", NumberType::kInt8},
    {"unsigned_char", NumberType::kUint8},
    {"short", NumberType::kInt16},
    {"unsigned_short", NumberType::kUint16},
    {"int", NumberType::kInt32},
    {"unsigned_int", NumberType::kUint32},
    {"vtkidtype", NumberType::kInt32},
    {"long", NumberType::kInt64},
    {"unsigned_long", NumberType::kUint64},
    {"vtktypeint64", NumberType::kInt64},
    {"vtktypeuint64", NumberType::kUint64},
    {"vtktypeint32", NumberType::kInt32},
    {"float", NumberType::kFloat32},
    {"double", NumberType::kFloat64},
}};

// Where numbers of one type begin, and how many there are.
struct LegacyNumbers {
  NumberType type = NumberType::kInt32;
  std::uint64_t count = 0;
  std::uint64_t place = 0, line = 0;
};

struct LegacySection {
  std::string keyword;  // VERTICES, LINES, POLYGONS or TRIANGLE_STRIPS
  std::uint64_t num_cells = 0;
  // Each cell's number of corners and they; or, if there are offsets, all corners.
  LegacyNumbers corners;
  std::optional<LegacyNumbers> offsets;
};

struct LegacyData {
  Encoding encoding = Encoding::kAscii;
  LegacyNumbers points;  // three of each
  std::vector<LegacySection> sections;
  std::optional<LegacyNumbers> groups;
  std::size_t group_rank = kGroupProperties.size();
};

constexpr std::array<std::string_view, 4> kLegacySections = {"VERTICES", "LINES", "POLYGONS",
                                                             "TRIANGLE_STRIPS"};

// Goes through the file, past the values, to find out where they are.
class LegacyScan {
 public:
  LegacyScan(InputFile& file, SurfaceSink& sink) : file_(file), sink_(sink) {}

  LegacyData run() {
    read_head();
    while (next_line()) {
      const std::string keyword(word());
      if (!take(keyword)) {
        sink_.note(
            fmt::format("left out what comes from byte {} on, for it begins with \"{}\", "
                        "which is not known",
                        file_.position(), shown(keyword)));
        break;
      }
    }
    return std::move(data_);
  }

 private:
  TextScanner& text() { return values_->text(); }
  std::string_view word() { return text().word(); }
  bool next_line() { return !text().at_line_end() || text().next_line(); }

  void read_head() {
    std::string_view line;
    file_.set_line_end(InputFile::LineEnd::kLineFeed);
    if (file_.peek(1024).find('\n') == std::string_view::npos)
      file_.set_line_end(InputFile::LineEnd::kAny);
    file_.next_line(line);  // by which it is known
    const auto version = parse_number(trimmed(line.substr(line.rfind(' ') + 1)));
    if (!version) file_.refuse_line("has no version of legacy VTK files; export it again");
    version_ = *version;
    file_.next_line(line);  // its title
    if (!file_.next_line(line)) file_.refuse_truncated();
    line = trimmed(line);
    if (line == "BINARY")
      data_.encoding = Encoding::kBigEndian;
    else if (line != "ASCII")
      file_.refuse_line(fmt::format("must be ASCII or BINARY, but is \"{}\"; export the file again",
                                    shown(line)));
    if (data_.encoding == Encoding::kAscii) file_.set_line_end(InputFile::LineEnd::kAny);
    values_.emplace(file_, data_.encoding);
  }

  std::uint64_t count(const char* what) {
    const std::int64_t value = text().integer(word(), what);
    if (value < 0 || static_cast<std::uint64_t>(value) > kMostLegacyCount)
      file_.refuse_line(fmt::format("the {} is {}; the file is damaged", what, value));
    return static_cast<std::uint64_t>(value);
  }

  std::optional<NumberType> type_named(std::string_view name) const {
    std::string lower(name);
    for (char& c : lower)
      if ('A' <= c && c <= 'Z') c = static_cast<char>(c | 0x20);
    for (const auto& [known, type] : kLegacyTypes)
      if (lower == known) return type;
    return std::nullopt;
  }
  NumberType type() {
    const std::string_view name = word();
    const auto type = type_named(name);
    if (!type)
      file_.refuse_line(
          fmt::format("\"{}\" is no type of numbers; export the file again", shown(name)));
    return *type;
  }

  // Those that begin on the next line; goes on after them.
  LegacyNumbers take_numbers(NumberType type, std::uint64_t count) {
    text().skip_line();
    const LegacyNumbers numbers{type, count, file_.position(), file_.line_number()};
    if (values_->is_text()) {
      for (std::uint64_t i = 0; i < count; ++i) values_->skip(type);
    } else {
      if (count > file_.remaining() / bytes_of(type)) file_.refuse_truncated();
      file_.skip_to(file_.position() + count * bytes_of(type), file_.line_number());
    }
    return numbers;
  }

  bool take(const std::string& keyword) {
    if (keyword == "DATASET") return take_dataset();
    if (keyword == "METADATA") return skip_metadata();
    if (keyword == "FIELD") return take_field();
    if (keyword == "POINTS") {
      if (data_.points.count > 0) file_.refuse_line("has points for the second time");
      const std::uint64_t num_points = count("number of points");
      data_.points = take_numbers(type(), 3 * num_points);
      return true;
    }
    if (std::ranges::find(kLegacySections, keyword) != kLegacySections.end())
      return take_section(keyword);
    if (keyword == "CELL_DATA" || keyword == "POINT_DATA") {
      is_of_cells_ = keyword == "CELL_DATA";
      num_tuples_ = count("number of values");
      return true;
    }
    return take_attribute(keyword);
  }

  bool take_dataset() {
    const std::string_view name = word();
    if (name != "POLYDATA")
      file_.refuse_line(
          fmt::format("has the data set {}, not POLYDATA; extract its surface, and "
                      "save that",
                      shown(name)));
    return true;
  }

  // Up to an empty line.
  bool skip_metadata() {
    text().skip_line();
    std::string_view line;
    while (file_.next_line(line) && !trimmed(line).empty()) {
    }
    return true;
  }

  bool take_section(const std::string& keyword) {
    LegacySection section;
    section.keyword = keyword;
    const std::uint64_t first = count("number of cells"), second = count("number of corners");
    if (first == 0) return true;
    if (version_ < 5) {
      if (second < first) file_.refuse_line("has cells without corners; export the file again");
      section.num_cells = first;
      section.corners = take_numbers(NumberType::kInt32, second);
    } else {
      section.num_cells = first - 1;
      section.offsets = take_part("OFFSETS", first);
      section.corners = take_part("CONNECTIVITY", second);
    }
    data_.sections.push_back(std::move(section));
    return true;
  }

  LegacyNumbers take_part(std::string_view name, std::uint64_t count) {
    text().skip_line();
    if (!next_line()) file_.refuse_truncated();
    if (const auto found = word(); found != name)
      file_.refuse_line(
          fmt::format("\"{}\" stands where {} must; the file is damaged", shown(found), name));
    const NumberType of = type();
    if (!is_integer(of)) file_.refuse_line("cells are named by numbers that are no integers");
    return take_numbers(of, count);
  }

  // True: they could be taken, or passed by.
  bool take_array(std::string_view name, std::string_view type_name, std::uint64_t components,
                  std::uint64_t tuples, bool is_of_cells) {
    if (components > 0 && tuples > kMostLegacyCount / components)
      file_.refuse_line("has more values than a file can hold; the file is damaged");
    if (type_name == "bit" && !values_->is_text()) {
      take_numbers(NumberType::kUint8, (components * tuples + 7) / 8);
      return true;
    }
    const auto type = type_name == "bit" ? NumberType::kUint8 : type_named(type_name);
    if (!type) return false;
    const auto rank = static_cast<std::size_t>(std::ranges::find(kGroupProperties, name) -
                                               kGroupProperties.begin());
    const bool may_be_groups = is_of_cells && components == 1 && is_integer(*type);
    const LegacyNumbers numbers = take_numbers(*type, components * tuples);
    if (may_be_groups && rank < data_.group_rank) {
      data_.groups = numbers;
      data_.group_rank = rank;
    }
    return true;
  }

  bool take_field() {
    word();  // its name
    const std::uint64_t num_arrays = count("number of arrays");
    for (std::uint64_t i = 0; i < num_arrays; ++i) {
      text().skip_line();
      if (!next_line()) file_.refuse_truncated();
      const std::string name(word());
      if (name == "METADATA") {
        skip_metadata();
        --i;
        continue;
      }
      const std::uint64_t components = count("number of components");
      const std::uint64_t tuples = count("number of values");
      const std::string type_name(word());
      if (!take_array(name, type_name, components, tuples, is_of_cells_)) return false;
    }
    return true;
  }

  bool take_attribute(const std::string& keyword) {
    const std::string name(word());
    if (keyword == "SCALARS") {
      const std::string type_name(word());
      const std::uint64_t components = text().at_line_end() ? 1 : count("number of components");
      if (!next_line()) file_.refuse_truncated();
      if (word() != "LOOKUP_TABLE")
        file_.refuse_line("a lookup table must be named here; export the file again");
      return take_array(name, type_name, components, num_tuples_, is_of_cells_);
    }
    if (keyword == "LOOKUP_TABLE" || keyword == "COLOR_SCALARS") {
      const std::uint64_t number = count("number of colors");
      return keyword == "LOOKUP_TABLE"
                 ? take_array("", "unsigned_char", 4, number, false)
                 : take_array("", "unsigned_char", number, num_tuples_, false);
    }
    if (keyword == "TEXTURE_COORDINATES") {
      const std::uint64_t dimension = count("dimension");
      return take_array("", std::string(word()), dimension, num_tuples_, false);
    }
    const std::uint64_t components =
        keyword == "VECTORS" || keyword == "NORMALS"                                      ? 3
        : keyword == "TENSORS"                                                            ? 9
        : keyword == "TENSORS6"                                                           ? 6
        : keyword == "GLOBAL_IDS" || keyword == "EDGE_FLAGS" || keyword == "PEDIGREE_IDS" ? 1
                                                                                          : 0;
    if (components == 0) return false;
    return take_array("", std::string(word()), components, num_tuples_, false);
  }

  InputFile& file_;
  SurfaceSink& sink_;
  std::optional<ValueReader> values_;
  LegacyData data_;
  double version_ = 0;
  bool is_of_cells_ = false;
  std::uint64_t num_tuples_ = 0;
};

// Some of the file's numbers, one after the other, through a file of its own.
class LegacyReader {
 public:
  LegacyReader(const InputFile& file, Encoding encoding, const LegacyNumbers& numbers)
      : numbers_(numbers),
        file_(std::make_unique<InputFile>(file.another())),
        values_(*file_, encoding) {
    if (encoding != Encoding::kAscii) file_->set_line_end(InputFile::LineEnd::kLineFeed);
    file_->skip_to(numbers.place, numbers.line);
  }

  double number() { return values_.number(numbers_.type); }
  std::uint64_t count(const char* what) { return values_.count(numbers_.type, what); }
  std::int64_t integer(const char* what) { return values_.integer(numbers_.type, what); }

 private:
  LegacyNumbers numbers_;
  std::unique_ptr<InputFile> file_;
  ValueReader values_;
};

void give_section(const InputFile& file, const LegacyData& data, const LegacySection& section,
                  std::uint64_t first_face, std::optional<LegacyReader>& groups,
                  SurfaceSink& sink) {
  CellSection cells;
  cells.num_cells = section.num_cells;
  cells.kind = section.keyword == "POLYGONS"          ? CellSection::Kind::kPolygons
               : section.keyword == "TRIANGLE_STRIPS" ? CellSection::Kind::kStrips
                                                      : CellSection::Kind::kOther;
  std::optional<LegacyReader> corners, offsets;
  std::uint64_t end = 0;
  if (cells.kind != CellSection::Kind::kOther) {
    corners.emplace(file, data.encoding, section.corners);
    cells.num_corners = section.corners.count - (section.offsets ? 0 : section.num_cells);
    if (section.offsets) {
      offsets.emplace(file, data.encoding, *section.offsets);
      end = offsets->count("place of a cell");
      if (end != 0)
        file.refuse(
            fmt::format("its first cell begins at corner {}, not 0; the file is damaged", end));
    }
  }
  cells.next_length = [&] {
    if (!offsets) return corners->count("number of corners");
    const std::uint64_t begin = std::exchange(end, offsets->count("place of a cell"));
    if (end < begin)
      file.refuse(fmt::format("the places of its cells decrease from {} to {}; the file is damaged",
                              begin, end));
    return end - begin;
  };
  cells.next_corner = [&] { return corners->count("number of a vertex"); };
  const auto next_group = [&] { return groups->integer("number of a group"); };
  give_cells(file, cells, 0, first_face, groups ? next_group : std::function<std::int64_t()>(),
             groups ? std::string(kGroupProperties[data.group_rank]) : "", sink);
}

}  // namespace

void parse_vtk(const InputFile& file, SurfaceSink& sink) {
  InputFile scanned = file.another();
  LegacyData data = LegacyScan(scanned, sink).run();
  std::ranges::stable_sort(data.sections, {}, [](const LegacySection& section) {
    return std::ranges::find(kLegacySections, section.keyword) - kLegacySections.begin();
  });
  std::uint64_t num_cells = 0, num_faces = 0;
  for (const LegacySection& section : data.sections) {
    num_cells += section.num_cells;
    if (section.keyword == "POLYGONS") num_faces += section.num_cells;
  }
  if (data.groups && data.groups->count != num_cells)
    file.refuse(fmt::format("has groups of {} cells, but {} cells; export it again",
                            data.groups->count, num_cells));
  sink.announce(num_faces);
  LegacyReader points(file, data.encoding, data.points);
  for (std::uint64_t v = 0; v < data.points.count / 3; ++v) {
    const double x = points.number(), y = points.number(), z = points.number();
    give_vertex(file, v, {x, y, z}, sink);
  }
  std::optional<LegacyReader> groups;
  if (data.groups) groups.emplace(file, data.encoding, *data.groups);
  std::uint64_t first_face = 0;
  for (const LegacySection& section : data.sections) {
    give_section(file, data, section, first_face, groups, sink);
    if (section.keyword == "POLYGONS") first_face += section.num_cells;
  }
}

}  // namespace locvol
