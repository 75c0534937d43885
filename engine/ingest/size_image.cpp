#include "engine/ingest/size_image.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <ranges>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/input_file.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/vtk_values.h"
#include "engine/ingest/vtk_xml.h"
#include "engine/ingest/xml_tags.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMostSliceValues = std::uint64_t{1} << 28;
constexpr std::size_t kMostArrays = 1000;
constexpr double kMostIndex = std::numeric_limits<std::int32_t>::max();  // of VTK's points
constexpr std::array<double, 9> kNoTurn = {1, 0, 0, 0, 1, 0, 0, 0, 1};

struct FoundArray {
  XmlTag tag;
  bool is_point_data = false;
  bool is_scalars = false;            // which an attribute of its section calls it
  std::optional<std::uint64_t> text;  // place of what stands between its tags

  std::string name() const { return tag.get("Name", ""); }
  std::string num_components() const { return tag.get("NumberOfComponents", "1"); }
  std::optional<NumberType> type() const { return vtk_type_named(tag.get("type", "")); }
  bool is_usable() const { return type() && num_components() == "1"; }
};

// The tags of a file that say something of its sizes.
struct ImageTags {
  VtkXml vtk;
  XmlTag image, piece;
  std::vector<FoundArray> arrays;
};

// Up to the end of the file, or to its appended data.
class TagReader {
 public:
  explicit TagReader(InputFile& file) : file_(file), xml_(file) {}

  ImageTags read() {
    require_xml(file_, "a VTK XML image (.vti)");
    std::optional<XmlTag> tag;
    while ((tag = xml_.next())) {
      if (tags_.vtk.file.name.empty()) check_file(*tag);
      take(*tag);
      if (tags_.vtk.appended) {
        tags_.vtk.appended_place = place_of_appended_data(file_);
        return std::move(tags_);
      }
      if (tag->name == "VTKFile" && tag->is_end) return std::move(tags_);
    }
    if (tags_.vtk.file.name.empty())
      file_.refuse("has no element VTKFile: export it as VTK XML (.vti)");
    file_.refuse_truncated();
  }

 private:
  void check_file(const XmlTag& tag) {
    if (tag.name != "VTKFile")
      file_.refuse(
          fmt::format("its first element is {}, not VTKFile; export it as a VTK XML image "
                      "(.vti)",
                      shown(tag.name)));
    tags_.vtk.file = tag;
    if (const std::string type = tag.get("type", ""); type != "ImageData")
      file_.refuse(
          fmt::format("is a VTK file of type \"{}\", not ImageData; resample it to an "
                      "image, in one file (.vti)",
                      shown(type)));
  }

  void take(const XmlTag& tag) {
    if (array_depth_ > 0) return take_within_array(tag);
    const bool is_section = tag.name == "PointData" || tag.name == "CellData";
    if (tag.is_start && is_section) {
      section_ = tag;
    } else if (tag.is_start && tag.name == "DataArray") {
      if (section_) add(tag);
      array_depth_ = tag.is_end ? 0 : 1;
    } else if (tag.is_start && tag.name == "ImageData") {
      tags_.image = tag;
    } else if (tag.is_start && tag.name == "Piece") {
      if (!tags_.piece.name.empty())
        file_.refuse("has several pieces; save the image as one piece");
      tags_.piece = tag;
    } else if (tag.is_start && tag.name == "AppendedData") {
      tags_.vtk.appended = tag;
    }
    if (tag.is_end && is_section) section_.reset();
  }

  void add(const XmlTag& tag) {
    const std::string* const scalars = section_->find("Scalars");
    FoundArray array;
    array.tag = tag;
    array.is_point_data = section_->name == "PointData";
    array.is_scalars = scalars != nullptr && *scalars == array.name();
    tags_.arrays.push_back(std::move(array));
    if (tags_.arrays.size() > kMostArrays)
      file_.refuse(fmt::format("has more than {} arrays; save the sizes alone", kMostArrays));
  }

  // Its values are what stands in no element within it.
  void take_within_array(const XmlTag& tag) {
    if (array_depth_ == 1 && section_ && !tags_.arrays.back().text)
      tags_.arrays.back().text = tag.text;
    array_depth_ += tag.is_start;
    array_depth_ -= tag.is_end;
  }

  InputFile& file_;
  XmlTags xml_;
  ImageTags tags_;
  std::optional<XmlTag> section_;  // which is open
  std::uint64_t array_depth_ = 0;  // of open elements, with the array's; 0: in none
};

// Of points: the first and the last along x, along y, and along z.
std::array<double, 6> extent(const InputFile& file, const ImageTags& tags) {
  if (tags.image.name.empty() || tags.image.find("WholeExtent") == nullptr)
    file.refuse("has no element ImageData with a WholeExtent; export it again");
  if (tags.piece.name.empty()) file.refuse("has no element Piece; export it again");
  const auto whole = numbers_in<6>(file, tags.image, "WholeExtent", "");
  const auto piece = numbers_in<6>(file, tags.piece, "Extent", "");
  if (whole != piece)
    file.refuse(
        fmt::format("its piece has the extent \"{}\", but the image \"{}\"; save it as one "
                    "piece",
                    fmt::join(piece, " "), fmt::join(whole, " ")));
  const auto is_index = [](double v) { return v == std::floor(v) && std::abs(v) <= kMostIndex; };
  if (!std::ranges::all_of(whole, is_index) || whole[1] < whole[0] || whole[3] < whole[2] ||
      whole[5] < whole[4])
    file.refuse(
        fmt::format("WholeExtent=\"{}\" is empty or no list of 32-bit integers; give the "
                    "first and the last point along x, y and z",
                    fmt::join(whole, " ")));
  return whole;
}

SizeImage image_of(const InputFile& file, const ImageTags& tags, bool is_point_data) {
  const std::array<double, 6> points = extent(file, tags);
  const auto origin = numbers_in<3>(file, tags.image, "Origin", "0 0 0");
  const auto spacing = numbers_in<3>(file, tags.image, "Spacing", "1 1 1");
  if (numbers_in<9>(file, tags.image, "Direction", "1 0 0 0 1 0 0 0 1") != kNoTurn)
    file.refuse("its Direction turns the image; resample it along the axes");
  SizeImage image;
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    const double num_cells = points[2 * a + 1] - points[2 * a];
    const bool is_around_points = is_point_data || num_cells == 0;
    image.num[a] = static_cast<std::uint64_t>(num_cells) + (is_around_points ? 1 : 0);
    image.spacing[axis] = spacing[a];
    image.low[axis] = origin[a] + (points[2 * a] - (is_around_points ? 0.5 : 0)) * spacing[a];
  }
  return image;
}

void check(const InputFile& file, const SizeImage& image) {
  const auto [x, y, z] = image.num;
  const Box last = image.voxel(x - 1, y - 1, z - 1), first = image.voxel(0, 0, 0);
  for (int axis = 0; axis < 3; ++axis)
    if (!std::isfinite(first.min[axis]) || !std::isfinite(last.max[axis]) ||
        !(first.min[axis] < first.max[axis]) || !(last.min[axis] < last.max[axis]))
      file.refuse(
          fmt::format("its voxels have no volume: the Spacing along {} is {}, from {} on; "
                      "give a finite one above 0 that rounding leaves there",
                      "xyz"[axis], image.spacing[axis], image.low[axis]));
  if (x > kMostSliceValues / y)
    file.refuse(
        fmt::format("has {} x {} values in a slice, but at most {} can be read; make it "
                    "coarser, or z its longest side",
                    x, y, kMostSliceValues));
}

// ---- Which array

std::string described(const FoundArray& array) {
  return fmt::format("\"{}\" ({}, {} of {})", shown(array.name()),
                     array.is_point_data ? "points" : "cells", shown(array.num_components()),
                     shown(array.tag.get("type", "no type")));
}

std::string list_of(const std::vector<FoundArray>& arrays) {
  constexpr std::size_t kMostListed = 20;
  std::vector<std::string> names;
  for (const FoundArray& array : arrays | std::views::take(kMostListed))
    names.push_back(described(array));
  if (arrays.size() > kMostListed) names.emplace_back("...");
  return fmt::format("{}", fmt::join(names, ", "));
}

// The sizes, by the first of the three rules that names one array.
const FoundArray& choose_array(const InputFile& file, const std::vector<FoundArray>& arrays) {
  const auto the_one = [&](auto is_meant) -> const FoundArray* {
    const auto found = std::ranges::find_if(arrays, is_meant);
    if (found == arrays.end()) return nullptr;
    return std::ranges::count_if(arrays, is_meant) == 1 ? &*found : nullptr;
  };
  if (const auto* array = the_one(&FoundArray::is_scalars)) {
    if (array->is_usable()) return *array;
    file.refuse(
        fmt::format("its Scalars are {}; give numbers of one component", described(*array)));
  }
  const auto is_named_so = [](const FoundArray& array) {
    return array.is_usable() && (array.name() == "size" || array.name() == "h");
  };
  if (const auto* array = the_one(is_named_so)) return *array;
  if (const auto* array = the_one(&FoundArray::is_usable)) return *array;
  if (arrays.empty()) file.refuse("has no array of points or cells; save the sizes with it");
  file.refuse(
      fmt::format("has no one array that could be the sizes, numbers of one component: {}; "
                  "save it alone, or name it \"size\"",
                  list_of(arrays)));
}

// ---- The values

class SliceReader {
 public:
  SliceReader(InputFile& file, const SizeImage& image, const VtkArray& array)
      : file_(file), image_(image), array_(array), values_(open_vtk_values(file, array)) {}

  std::span<const float> read(std::uint64_t k) {
    const auto num = static_cast<std::size_t>(image_.num[0] * image_.num[1]);
    slice_.clear();
    while (slice_.size() < num) {
      const auto values = std::span(buffer_).first(std::min(buffer_.size(), num - slice_.size()));
      values_->read(values);
      make_room(values.size(), num);
      for (const double value : values) slice_.push_back(size_of(value, k));
    }
    return slice_;
  }
  void check_end() { values_->check_end(); }

 private:
  // As much as the file has filled already: its extent may promise what it does not have.
  void make_room(std::size_t num_more, std::size_t num_all) {
    const std::size_t needed = slice_.size() + num_more;
    if (needed > slice_.capacity())
      slice_.reserve(std::min(std::max(2 * slice_.size(), needed), num_all));
  }

  float size_of(double value, std::uint64_t k) const {
    if (value > 0 && value <= std::numeric_limits<float>::max()) {
      const auto size = static_cast<float>(value);
      if (size > 0) return size;
    }
    refuse(value, slice_.size() % image_.num[0], slice_.size() / image_.num[0], k);
  }

  [[noreturn]] void refuse(double value, std::uint64_t i, std::uint64_t j, std::uint64_t k) const {
    const Point p = image_.voxel(i, j, k).center();
    file_.refuse(fmt::format(
        "array \"{}\": its value {} (counted from 0), of the voxel ({}, {}, {}) around ({}, {}, "
        "{}), is {}, but a size is finite and above 0, as a 32-bit float has it; correct it",
        shown(array_.name), i + image_.num[0] * (j + image_.num[1] * k), i, j, k, p.x, p.y, p.z,
        value));
  }

  InputFile& file_;
  SizeImage image_;
  VtkArray array_;
  std::unique_ptr<VtkValues> values_;
  std::vector<float> slice_;
  std::array<double, 2048> buffer_;
};

}  // namespace

Box SizeImage::voxel(std::uint64_t i, std::uint64_t j, std::uint64_t k) const {
  const auto corner = [&](std::uint64_t up) {
    return low + Point{static_cast<double>(i + up) * spacing.x,
                       static_cast<double>(j + up) * spacing.y,
                       static_cast<double>(k + up) * spacing.z};
  };
  return {corner(0), corner(1)};
}

void read_size_image(const std::filesystem::path& path, const SizeImageSink& sink,
                     const StopToken* stop) {
  InputFile file(path, stop);
  const ImageTags tags = TagReader(file).read();
  const FoundArray& found = choose_array(file, tags.arrays);
  const SizeImage image = image_of(file, tags, found.is_point_data);
  check(file, image);
  SliceReader slices(file, image,
                     array_in(file, tags.vtk, found.tag, found.text, image.num_values()));
  sink.on_header(image);
  for (std::uint64_t k = 0; k < image.num[2]; ++k) {
    throw_if_stopped(stop);
    sink.on_slice(k, slices.read(k));
  }
  slices.check_end();
}

}  // namespace locvol
