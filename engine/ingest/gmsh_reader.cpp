#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/surface_formats.h"
#include "engine/ingest/tag_runs.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/value_reader.h"

namespace locvol {
namespace {

constexpr std::size_t kMostNames = 100'000;  // of physical groups, and of entities with one

// What an element of Gmsh's has: its dimension, nodes and corners. Corners come first.
struct ElementType {
  int number;
  int dimension;
  std::uint64_t num_nodes, num_corners;
};
constexpr std::array<ElementType, 33> kElementTypes = {{
    {1, 1, 2, 2},   {2, 2, 3, 3},   {3, 2, 4, 4},    {4, 3, 4, 4},   {5, 3, 8, 8},   {6, 3, 6, 6},
    {7, 3, 5, 5},   {8, 1, 3, 2},   {9, 2, 6, 3},    {10, 2, 9, 4},  {11, 3, 10, 4}, {12, 3, 27, 8},
    {13, 3, 18, 6}, {14, 3, 14, 5}, {15, 0, 1, 1},   {16, 2, 8, 4},  {17, 3, 20, 8}, {18, 3, 15, 6},
    {19, 3, 13, 5}, {20, 2, 9, 3},  {21, 2, 10, 3},  {22, 2, 12, 3}, {23, 2, 15, 3}, {24, 2, 15, 3},
    {25, 2, 21, 3}, {26, 1, 4, 2},  {27, 1, 5, 2},   {28, 1, 6, 2},  {29, 3, 20, 4}, {30, 3, 35, 4},
    {31, 3, 56, 4}, {92, 3, 64, 8}, {93, 3, 125, 8},
}};

// The physical group that elements are of; below 0: they are the other way around in it.
using Physical = std::int64_t;

class GmshParser {
 public:
  GmshParser(InputFile& file, SurfaceSink& sink) : file_(file), sink_(sink) {}

  void run() {
    std::string_view line;
    while (next_line(line)) {
      const std::string section(trimmed(line));
      if (section.empty()) continue;
      if (!section.starts_with('$'))
        file_.refuse_line(fmt::format("\"{}\" begins no section; the file is damaged or cut off",
                                      shown(section)));
      take(section);
    }
    if (num_faces_ == 0 && num_volume_cells_ > 0)
      file_.refuse(
          fmt::format("has {} cells of volumes but no triangles; save its surface, too, or alone "
                      "(in Gmsh, a physical surface or Mesh.SaveAll)",
                      num_volume_cells_));
    if (num_volume_cells_ > 0)
      sink_.note(fmt::format("left out {} cells of volumes", num_volume_cells_));
  }

 private:
  bool next_line(std::string_view& line) { return file_.next_line(line); }
  bool is_old() const { return version_ < 3; }

  void take(const std::string& section) {
    if (section == "$MeshFormat") return take_format(section);
    if (!values_ && section != "$Comments")
      file_.refuse_line("has no section $MeshFormat before others; export it again");
    if (section == "$PhysicalNames")
      take_names();
    else if (section == "$Entities" && !is_old())
      take_entities();
    else if (section == "$Nodes")
      is_old() ? take_old_nodes() : take_nodes();
    else if (section == "$Elements")
      is_old() ? take_old_elements() : take_elements();
    else
      return skip_section(section);
    expect_end(section);
  }

  void take_format(const std::string& section) {
    std::string_view line;
    if (!next_line(line)) file_.refuse_truncated();
    TextWords words{line};
    const std::string version(words.next()), is_binary(words.next()), bytes(words.next());
    if (version == "2.2" || version == "2.1" || version == "2" || version == "2.0")
      version_ = 2.2;
    else if (version == "4.1")
      version_ = 4.1;
    else
      file_.refuse_line(
          fmt::format("is of version \"{}\" of Gmsh's format; save it as 4.1 or 2.2 "
                      "(gmsh FILE -save -format msh41 -o NEW)",
                      shown(version)));
    if ((is_binary != "0" && is_binary != "1") || (bytes != "8" && is_binary == "1"))
      file_.refuse_line("is no line of Gmsh's format, as \"4.1 0 8\"; export the file again");
    Encoding encoding = Encoding::kAscii;
    if (is_binary == "1") {
      const std::uint64_t one = bits_in(file_.take(4), 4, false);
      if (one != 1 && one != 0x1000000)
        file_.refuse(
            fmt::format("has no number 1 before byte {}, which would tell the order of "
                        "bytes; the file is damaged",
                        file_.position()));
      encoding = one == 1 ? Encoding::kLittleEndian : Encoding::kBigEndian;
      file_.set_line_end(InputFile::LineEnd::kLineFeed);
    }
    values_.emplace(file_, encoding);
    expect_end(section);
  }

  struct TextWords {
    std::string_view rest;
    std::string_view next() {
      rest.remove_prefix(std::min(rest.find_first_not_of(" \t"), rest.size()));
      const std::string_view word = rest.substr(0, rest.find_first_of(" \t"));
      rest.remove_prefix(word.size());
      return word;
    }
  };

  // After values the next line is the end, or it is the rest of the last value's.
  void expect_end(const std::string& section) {
    values_->text().skip_line();
    const std::string end = "$End" + section.substr(1);
    std::string_view line;
    do {
      if (!next_line(line))
        file_.refuse(fmt::format("ends in its section {}: it is cut off; fetch or export it again",
                                 section));
    } while (trimmed(line).empty());
    if (trimmed(line) != end)
      file_.refuse(
          fmt::format("{}: its section {} does not end here, as it promises; the file is "
                      "damaged or cut off",
                      here(), section));
  }
  std::string here() const {
    return values_ && !values_->is_text() ? fmt::format("before byte {}", file_.position())
                                          : fmt::format("line {}", file_.line_number());
  }

  // Of what it holds nothing is known, but how it ends.
  void skip_section(const std::string& section) {
    const std::string end = "$End" + section.substr(1);
    if (!values_ || values_->is_text()) {
      std::string_view line;
      while (next_line(line))
        if (trimmed(line) == end) return;
      file_.refuse_truncated();
    }
    constexpr std::size_t kView = std::size_t{1} << 16;
    for (;;) {
      const std::string_view view = file_.peek(kView);
      const std::size_t found = view.find(end);
      if (found != view.npos) {
        file_.take(found + end.size());
        return;
      }
      if (view.size() < kView) file_.refuse_truncated();
      file_.take(kView - end.size());
    }
  }

  // ---- Numbers

  std::int64_t integer(const char* what) { return values_->integer(NumberType::kInt32, what); }
  std::uint64_t count32(const char* what) { return values_->count(NumberType::kInt32, what); }
  std::uint64_t count(const char* what) { return values_->count(NumberType::kUint64, what); }
  double coordinate() { return values_->number(NumberType::kFloat64); }

  // So many things of `min_bytes` at least are to come.
  void check_count(std::uint64_t number, std::uint64_t min_bytes, const char* what) {
    const std::uint64_t bytes = values_->is_text() ? 2 : min_bytes;
    if (number > (file_.remaining() + 1) / bytes)
      file_.refuse(
          fmt::format("{}: promises {} {}, more than the remaining {} bytes can hold; the "
                      "file is cut off or damaged",
                      here(), number, what, file_.remaining()));
  }

  // ---- Names

  // Text in files of both kinds.
  void take_names() {
    TextScanner text(file_);
    const std::uint64_t num_names = text.count_on_any_line("number of names");
    for (std::uint64_t i = 0; i < num_names; ++i) {
      const std::uint64_t dimension = text.count_on_any_line("dimension");
      const std::int64_t tag = text.integer(text.word(), "number of a group");
      std::string_view name = trimmed(text.rest());
      if (name.size() >= 2 && name.front() == '"' && name.back() == '"')
        name = name.substr(1, name.size() - 2);
      if (dimension == 2) names_.emplace(tag, name.substr(0, kMostNameBytes));
      if (names_.size() > kMostNames) refuse_many_names();
      text.skip_line();
    }
  }
  [[noreturn]] void refuse_many_names() const {
    file_.refuse(fmt::format("has more than {} physical groups; unite some", kMostNames));
  }

  void take_entities() {
    std::array<std::uint64_t, 4> counts{};
    for (std::uint64_t& c : counts) c = count("number of entities");
    for (std::size_t dimension = 0; dimension < counts.size(); ++dimension)
      for (std::uint64_t i = 0; i < counts[dimension]; ++i) take_entity(dimension);
  }
  void take_entity(std::size_t dimension) {
    const std::int64_t tag = integer("number of an entity");
    for (int i = 0; i < (dimension == 0 ? 3 : 6); ++i) values_->skip(NumberType::kFloat64);
    const std::uint64_t num_physical = count("number of physical groups");
    for (std::uint64_t i = 0; i < num_physical; ++i) {
      const Physical physical = integer("number of a group");
      if (i == 0 && dimension == 2) physical_of_[tag] = physical;
    }
    if (physical_of_.size() > kMostNames) refuse_many_names();
    if (dimension == 0) return;
    const std::uint64_t num_sides = count("number of entities");
    for (std::uint64_t i = 0; i < num_sides; ++i) integer("number of an entity");
  }

  void begin_group(Physical physical) {
    const Physical tag = physical < 0 ? -physical : physical;
    if (group_ == tag) return;
    group_ = tag;
    const auto name = names_.find(tag);
    if (tag == 0)
      sink_.group("");
    else
      sink_.group(name != names_.end() ? name->second : fmt::format("physical surface {}", tag));
  }

  // ---- Nodes

  void begin_nodes(std::uint64_t number) {
    if (nodes_.num_vertices() > 0) file_.refuse_line("has nodes for the second time");
    check_count(number, 28, "nodes");
  }
  void add_tag(std::uint64_t tag) {
    if (!nodes_.add(tag))
      file_.refuse(
          fmt::format("{}: the tags of its nodes leave more than {} gaps; number them "
                      "anew, by gmsh.model.mesh.renumberNodes()",
                      here(), TagRuns::kMaxRuns));
  }
  void end_nodes() {
    if (const auto tag = nodes_.finish())
      file_.refuse(fmt::format("two nodes have the tag {}; the file is damaged", *tag));
    has_nodes_ = true;
  }
  void take_position() {
    const double x = coordinate(), y = coordinate(), z = coordinate();
    give_vertex(file_, num_given_++, {x, y, z}, sink_);
  }

  void take_old_nodes() {
    // The number of nodes is text in binary files, too.
    TextScanner text(file_);
    const std::uint64_t number = text.count_on_any_line("number of nodes");
    begin_nodes(number);
    for (std::uint64_t i = 0; i < number; ++i) {
      add_tag(count32("number of a node"));
      take_position();
      values_->text().skip_line();
    }
    end_nodes();
  }

  void take_nodes() {
    const std::uint64_t num_blocks = count("number of blocks");
    const std::uint64_t num_nodes = count("number of nodes");
    begin_nodes(num_nodes);
    count("least tag");
    count("largest tag");
    std::uint64_t num_left = num_nodes;
    for (std::uint64_t b = 0; b < num_blocks; ++b) {
      const std::uint64_t dimension = count32("dimension");
      integer("number of an entity");
      const bool has_parameters = integer("whether there are parameters") != 0;
      const std::uint64_t number = count("number of nodes");
      if (number > num_left || dimension > 3)
        file_.refuse(
            fmt::format("{}: a block of {} nodes, of dimension {}, cannot be; the file is "
                        "damaged",
                        here(), number, dimension));
      num_left -= number;
      for (std::uint64_t i = 0; i < number; ++i) add_tag(count("number of a node"));
      for (std::uint64_t i = 0; i < number; ++i) {
        take_position();
        for (std::uint64_t p = 0; has_parameters && p < dimension; ++p)
          values_->skip(NumberType::kFloat64);
      }
    }
    end_nodes();
  }

  // ---- Elements

  const ElementType& type_numbered(std::int64_t number) const {
    for (const ElementType& type : kElementTypes)
      if (type.number == number) return type;
    file_.refuse(
        fmt::format("{}: there is no element of type {} that can be read; the file is "
                    "damaged, or save it with first order",
                    here(), number));
  }

  void require_nodes() const {
    if (!has_nodes_) file_.refuse_line("has elements before its nodes; export it again");
  }

  void take_corners(const ElementType& type, bool is_turned, NumberType tag_type) {
    corners_.clear();
    for (std::uint64_t i = 0; i < type.num_nodes; ++i) {
      const std::uint64_t tag = values_->count(tag_type, "number of a node");
      if (type.dimension != 2 || i >= type.num_corners) continue;
      const auto vertex = nodes_.vertex(tag);
      if (!vertex)
        file_.refuse(fmt::format("{}: there is no node {}; the file is damaged", here(), tag));
      corners_.push_back(*vertex);
    }
    if (type.dimension == 3) ++num_volume_cells_;
    if (type.dimension != 2) return;
    if (is_turned) std::ranges::reverse(corners_);
    sink_.polygon(corners_, values_->place(num_faces_));
    ++num_faces_;
  }

  void take_old_elements() {
    require_nodes();
    TextScanner text(file_);
    const std::uint64_t number = text.count_on_any_line("number of elements");
    check_count(number, 8, "elements");
    sink_.announce(number);
    for (std::uint64_t i = 0; i < number;) {
      std::uint64_t num_alike = 1, num_tags = 0;
      const ElementType* type = nullptr;
      if (values_->is_text()) {
        integer("number of an element");
        type = &type_numbered(integer("type of an element"));
        num_tags = count32("number of tags");
        take_old_element(*type, num_tags);
        values_->text().skip_line();
      } else {
        type = &type_numbered(integer("type of an element"));
        num_alike = count32("number of elements");
        num_tags = count32("number of tags");
        if (num_alike == 0 || num_alike > number - i)
          file_.refuse(fmt::format("{}: a block of {} elements cannot be; the file is damaged",
                                   here(), num_alike));
        for (std::uint64_t e = 0; e < num_alike; ++e) {
          integer("number of an element");
          take_old_element(*type, num_tags);
        }
      }
      i += num_alike;
    }
  }
  void take_old_element(const ElementType& type, std::uint64_t num_tags) {
    Physical physical = 0;
    for (std::uint64_t t = 0; t < num_tags; ++t) {
      const std::int64_t tag = integer("tag of an element");
      if (t == 0) physical = tag;
    }
    if (type.dimension == 2) begin_group(physical);
    take_corners(type, physical < 0, NumberType::kInt32);
  }

  void take_elements() {
    require_nodes();
    const std::uint64_t num_blocks = count("number of blocks");
    std::uint64_t num_left = count("number of elements");
    check_count(num_left, 16, "elements");
    sink_.announce(num_left);
    count("least tag");
    count("largest tag");
    for (std::uint64_t b = 0; b < num_blocks; ++b) {
      count32("dimension");
      const std::int64_t entity = integer("number of an entity");
      const ElementType& type = type_numbered(integer("type of an element"));
      const std::uint64_t number = count("number of elements");
      if (number > num_left)
        file_.refuse(fmt::format("{}: a block of {} elements cannot be; the file is damaged",
                                 here(), number));
      num_left -= number;
      Physical physical = 0;
      if (type.dimension == 2) {
        const auto found = physical_of_.find(entity);
        if (found != physical_of_.end()) physical = found->second;
        begin_group(physical);
      }
      for (std::uint64_t e = 0; e < number; ++e) {
        count("number of an element");
        take_corners(type, physical < 0, NumberType::kUint64);
      }
    }
  }

  static constexpr std::size_t kMostNameBytes = 256;

  InputFile& file_;
  SurfaceSink& sink_;
  std::optional<ValueReader> values_;
  double version_ = 0;
  std::map<std::int64_t, std::string> names_;     // of physical surfaces
  std::map<std::int64_t, Physical> physical_of_;  // of entities that are surfaces
  TagRuns nodes_;
  bool has_nodes_ = false;
  std::optional<Physical> group_;
  std::uint64_t num_given_ = 0, num_faces_ = 0, num_volume_cells_ = 0;
  std::vector<std::uint64_t> corners_;
};

}  // namespace

void parse_gmsh(InputFile& file, SurfaceSink& sink) { GmshParser(file, sink).run(); }

}  // namespace locvol
