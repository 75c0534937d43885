#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
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
#include "engine/ingest/vtk_values.h"
#include "engine/ingest/vtk_xml.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMostVtpCount = std::uint64_t{1} << 48;  // a double has all of these
constexpr std::size_t kMostVtpPieces = 10'000;

struct VtpArray {
  XmlTag tag;
  std::optional<std::uint64_t> text;  // place of what stands between its tags

  std::string name() const { return tag.get("Name", ""); }
  std::optional<NumberType> type() const { return vtk_type_named(tag.get("type", "")); }
};

// The kinds of cells of a piece, in the order in which arrays of cells count them.
constexpr std::array<std::string_view, 4> kVtpKinds = {"Verts", "Lines", "Polys", "Strips"};

struct VtpCells {
  std::uint64_t count = 0;
  std::optional<VtpArray> connectivity, offsets;
};

struct VtpPiece {
  std::uint64_t num_points = 0;
  std::array<VtpCells, kVtpKinds.size()> cells;
  std::optional<VtpArray> points, groups;
};

struct VtpData {
  VtkXml vtk;
  std::vector<VtpPiece> pieces;
};

// Of an array of cells, the lower the better; kGroupProperties.size(): it tells no groups.
std::size_t rank_as_groups(const VtpArray& array) {
  const auto type = array.type();
  if (!type || !is_integer(*type) || array.tag.get("NumberOfComponents", "1") != "1")
    return kGroupProperties.size();
  return static_cast<std::size_t>(std::ranges::find(kGroupProperties, array.name()) -
                                  kGroupProperties.begin());
}

class VtpTagReader {
 public:
  explicit VtpTagReader(InputFile& file) : file_(file), xml_(file) {}

  VtpData read() {
    require_xml(file_, "VTK XML polydata (.vtp)");
    std::optional<XmlTag> tag;
    while ((tag = xml_.next())) {
      if (data_.vtk.file.name.empty()) check_file(*tag);
      take(*tag);
      if (data_.vtk.appended) {
        data_.vtk.appended_place = place_of_appended_data(file_);
        return std::move(data_);
      }
      if (tag->name == "VTKFile" && tag->is_end) return std::move(data_);
    }
    if (data_.vtk.file.name.empty())
      file_.refuse("has no element VTKFile: export it as VTK XML polydata (.vtp)");
    file_.refuse_truncated();
  }

 private:
  void check_file(const XmlTag& tag) {
    if (tag.name != "VTKFile")
      file_.refuse(
          fmt::format("its first element is {}, not VTKFile; export it as VTK XML "
                      "polydata (.vtp)",
                      shown(tag.name)));
    data_.vtk.file = tag;
    if (const std::string type = tag.get("type", ""); type != "PolyData")
      file_.refuse(
          fmt::format("is a VTK file of type \"{}\", not PolyData; extract its surface, and save "
                      "that in one file (.vtp)",
                      shown(type)));
  }

  void take(const XmlTag& tag) {
    if (array_depth_ > 0) return take_within_array(tag);
    if (tag.is_start && tag.name == "Piece") {
      begin_piece(tag);
    } else if (tag.is_start && tag.name == "DataArray") {
      add({tag, std::nullopt});
      array_depth_ = tag.is_end ? 0 : 1;
    } else if (tag.is_start && tag.name == "AppendedData") {
      data_.vtk.appended = tag;
    } else if (!tag.is_end) {
      section_ = tag.name;
    } else if (!tag.is_start) {
      section_.clear();
    }
  }

  void begin_piece(const XmlTag& tag) {
    if (data_.pieces.size() == kMostVtpPieces)
      file_.refuse(fmt::format("has more than {} pieces; save it as one", kMostVtpPieces));
    VtpPiece& piece = data_.pieces.emplace_back();
    piece.num_points = count(tag, "NumberOfPoints");
    for (std::size_t i = 0; i < kVtpKinds.size(); ++i)
      piece.cells[i].count = count(tag, fmt::format("NumberOf{}", kVtpKinds[i]));
  }

  std::uint64_t count(const XmlTag& tag, const std::string& attribute) const {
    const double value = numbers_in<1>(file_, tag, attribute.c_str(), "0")[0];
    if (!(value >= 0) || value > static_cast<double>(kMostVtpCount) || value != std::floor(value))
      file_.refuse(fmt::format("Piece {}=\"{}\" is no count; export it again", attribute, value));
    return static_cast<std::uint64_t>(value);
  }

  void add(VtpArray array) {
    open_ = nullptr;
    if (data_.pieces.empty()) return;
    VtpPiece& piece = data_.pieces.back();
    if (section_ == "Points" && !piece.points) {
      open_ = &piece.points.emplace(std::move(array));
    } else if (section_ == "CellData") {
      const std::size_t rank = rank_as_groups(array);
      if (rank < (piece.groups ? rank_as_groups(*piece.groups) : kGroupProperties.size()))
        open_ = &piece.groups.emplace(std::move(array));
    } else {
      const auto kind = std::ranges::find(kVtpKinds, section_);
      if (kind == kVtpKinds.end()) return;
      VtpCells& cells = piece.cells[static_cast<std::size_t>(kind - kVtpKinds.begin())];
      if (array.name() == "connectivity")
        open_ = &cells.connectivity.emplace(std::move(array));
      else if (array.name() == "offsets")
        open_ = &cells.offsets.emplace(std::move(array));
    }
  }

  // Its values are what stands in no element within it.
  void take_within_array(const XmlTag& tag) {
    if (array_depth_ == 1 && open_ != nullptr && !open_->text) open_->text = tag.text;
    array_depth_ += tag.is_start;
    array_depth_ -= tag.is_end;
  }

  InputFile& file_;
  XmlTags xml_;
  VtpData data_;
  std::string section_;
  VtpArray* open_ = nullptr;       // whose text is to come; null: of no use
  std::uint64_t array_depth_ = 0;  // of open elements, with the array's; 0: in none
};

// The values of an array, one after the other, read through a file of its own.
class VtpValues {
 public:
  VtpValues(const InputFile& file, const VtkXml& vtk, const VtpArray& array, std::uint64_t count)
      : name_(array.name()), num_left_(count), file_(std::make_unique<InputFile>(file.another())) {
    if (!array.type())
      file.refuse(
          fmt::format("array \"{}\" is of the type \"{}\", which no number has; export it "
                      "again",
                      shown(name_), shown(array.tag.get("type", ""))));
    VtkArray found = array_in(file, vtk, array.tag, array.text, count);
    found.counted_by = "its piece";
    values_ = open_vtk_values(*file_, found);
  }

  double next() {
    if (begin_ == end_) load();
    return buffer_[begin_++];
  }
  std::uint64_t next_count() {
    const double value = next();
    if (!(value >= 0) || value > static_cast<double>(kMostVtpCount) || value != std::floor(value))
      file_->refuse(
          fmt::format("array \"{}\" holds {}, which is no number of a vertex or cell; the "
                      "file is damaged: export it again",
                      shown(name_), value));
    return static_cast<std::uint64_t>(value);
  }
  std::int64_t next_integer() { return static_cast<std::int64_t>(next()); }
  void check_end() { values_->check_end(); }

 private:
  void load() {
    begin_ = 0;
    end_ = static_cast<std::size_t>(std::min<std::uint64_t>(num_left_, buffer_.size()));
    values_->read(std::span(buffer_).first(end_));
    num_left_ -= end_;
  }

  std::string name_;
  std::uint64_t num_left_;  // beyond the buffer
  std::unique_ptr<InputFile> file_;
  std::unique_ptr<VtkValues> values_;
  std::array<double, 1024> buffer_;
  std::size_t begin_ = 0, end_ = 0;
};

class VtpParser {
 public:
  VtpParser(const InputFile& file, const VtpData& data, SurfaceSink& sink)
      : file_(file), data_(data), sink_(sink) {}

  void run() {
    std::uint64_t num_faces = 0;
    for (const VtpPiece& piece : data_.pieces) {
      num_faces += piece.cells[2].count;
      check_counts(piece);
    }
    sink_.announce(num_faces);
    for (const VtpPiece& piece : data_.pieces) {
      give_points(piece);
      give_cells(piece);
      num_points_ += piece.num_points;
    }
  }

 private:
  // What zlib has compressed stands for at most 1032 times as many bytes.
  void check_counts(const VtpPiece& piece) const {
    const std::uint64_t most = 1032 * file_.size();
    std::uint64_t count = piece.num_points;
    for (const VtpCells& cells : piece.cells) count = std::max(count, cells.count);
    if (count > most)
      file_.refuse(
          fmt::format("has a piece with {} points or cells, more than its {} bytes can "
                      "hold; it is damaged or cut off",
                      count, file_.size()));
  }

  VtpValues open(const std::optional<VtpArray>& array, std::string_view what,
                 std::uint64_t count) const {
    if (!array) file_.refuse(fmt::format("has no array {}; export it again", what));
    return {file_, data_.vtk, *array, count};
  }

  void give_points(const VtpPiece& piece) {
    if (piece.num_points == 0) return;
    if (piece.points && piece.points->tag.get("NumberOfComponents", "1") != "3")
      file_.refuse("its points do not have 3 components; export it again");
    VtpValues values = open(piece.points, "of points", 3 * piece.num_points);
    for (std::uint64_t i = 0; i < piece.num_points; ++i) {
      const double x = values.next(), y = values.next(), z = values.next();
      give_vertex(file_, num_points_ + i, {x, y, z}, sink_);
    }
    values.check_end();
  }

  void give_cells(const VtpPiece& piece) {
    std::uint64_t num_cells = 0;
    for (const VtpCells& cells : piece.cells) num_cells += cells.count;
    std::optional<VtpValues> groups;
    if (piece.groups && num_cells > 0) groups.emplace(file_, data_.vtk, *piece.groups, num_cells);
    const auto next_group = [&] { return groups->next_integer(); };
    for (std::size_t kind = 0; kind < kVtpKinds.size(); ++kind) {
      const VtpCells& cells = piece.cells[kind];
      if (cells.count > 0)
        give_cells(cells, kind, groups ? next_group : std::function<std::int64_t()>(),
                   groups ? piece.groups->name() : "");
    }
  }

  // The last number of the offsets is the length of the connectivity.
  std::uint64_t num_corners(const VtpCells& cells, const std::string& offsets) const {
    VtpValues values = open(cells.offsets, offsets, cells.count);
    std::uint64_t end = 0;
    for (std::uint64_t c = 0; c < cells.count; ++c) {
      const std::uint64_t next = values.next_count();
      if (next < end)
        file_.refuse(
            fmt::format("the offsets of {} decrease from {} to {}; the file is damaged: "
                        "export it again",
                        offsets, end, next));
      end = next;
    }
    values.check_end();
    return end;
  }

  void give_cells(const VtpCells& cells, std::size_t kind,
                  const std::function<std::int64_t()>& next_group, const std::string& group_name) {
    CellSection section;
    section.num_cells = cells.count;
    std::optional<VtpValues> offsets, connectivity;
    std::uint64_t end = 0;
    if (kVtpKinds[kind] == "Polys" || kVtpKinds[kind] == "Strips") {
      const std::string what = fmt::format("\"offsets\" of {}", kVtpKinds[kind]);
      section.kind =
          kVtpKinds[kind] == "Polys" ? CellSection::Kind::kPolygons : CellSection::Kind::kStrips;
      section.num_corners = num_corners(cells, what);
      if (section.num_corners == 0)
        file_.refuse(fmt::format("its {} have no corners; export it again", kVtpKinds[kind]));
      offsets.emplace(open(cells.offsets, what, cells.count));
      connectivity.emplace(open(cells.connectivity,
                                fmt::format("\"connectivity\" of {}", kVtpKinds[kind]),
                                section.num_corners));
      section.next_length = [&] {
        const std::uint64_t begin = end;
        end = offsets->next_count();
        return end - begin;
      };
      section.next_corner = [&] { return connectivity->next_count(); };
    }
    locvol::give_cells(file_, section, num_points_, num_faces_, next_group, group_name, sink_);
    if (connectivity) {
      connectivity->check_end();
      num_faces_ += cells.count;
    }
  }

  const InputFile& file_;
  const VtpData& data_;
  SurfaceSink& sink_;
  std::uint64_t num_points_ = 0, num_faces_ = 0;  // of the pieces before
};

}  // namespace

void parse_vtp(const InputFile& file, SurfaceSink& sink) {
  InputFile tags = file.another();
  const VtpData data = VtpTagReader(tags).read();
  VtpParser(file, data, sink).run();
}

}  // namespace locvol
