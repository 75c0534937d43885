#include "engine/ingest/size_image.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "engine/formats/deflate.h"
#include "engine/shared/input_error.h"
#include "tests/directories.h"
#include "tests/stops_at.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

// ---- A writer

std::string base64(const std::string& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t b = i; b < i + 3; ++b)
      bits = bits << 8 | (b < bytes.size() ? static_cast<unsigned char>(bytes[b]) : 0U);
    for (const int shift : {18, 12, 6, 0}) text += kDigits[bits >> shift & 63];
  }
  if (bytes.size() % 3 > 0) text.replace(text.size() - (3 - bytes.size() % 3), 2, "==");
  text.resize(4 * ((bytes.size() + 2) / 3));
  return text;
}

template <class T>
std::string bytes_of_value(T value, bool is_big_endian) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  if (is_big_endian) std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

std::string bytes_of_value(const std::string& type, double value, bool is_big_endian) {
  if (type == "Int8") return bytes_of_value(static_cast<std::int8_t>(value), is_big_endian);
  if (type == "UInt8") return bytes_of_value(static_cast<std::uint8_t>(value), is_big_endian);
  if (type == "Int16") return bytes_of_value(static_cast<std::int16_t>(value), is_big_endian);
  if (type == "UInt16") return bytes_of_value(static_cast<std::uint16_t>(value), is_big_endian);
  if (type == "Int32") return bytes_of_value(static_cast<std::int32_t>(value), is_big_endian);
  if (type == "UInt32") return bytes_of_value(static_cast<std::uint32_t>(value), is_big_endian);
  if (type == "Int64") return bytes_of_value(static_cast<std::int64_t>(value), is_big_endian);
  if (type == "UInt64") return bytes_of_value(static_cast<std::uint64_t>(value), is_big_endian);
  if (type == "Float32") return bytes_of_value(static_cast<float>(value), is_big_endian);
  return bytes_of_value(value, is_big_endian);
}

// An image of points, 5 x 4 x 3 unless told otherwise.
struct Written {
  std::string type = "Float32";
  std::string format = "ascii";  // or binary, raw, base64: the last two are appended
  bool is_big_endian = false, has_wide_head = false, is_compressed = false;
  std::size_t block_bytes = 20;  // which most values do not divide
  std::int64_t extra_bytes = 0;  // which the head claims
  bool is_head_apart = false;    // padded before the values, as VTK does if they are compressed
  std::vector<double> values = std::vector<double>(60, 1.5);
  std::string extent = "0 4 0 3 0 2";

  std::string word(std::uint64_t value) const {
    if (has_wide_head) return bytes_of_value(value, is_big_endian);
    return bytes_of_value(static_cast<std::uint32_t>(value), is_big_endian);
  }
  std::string raw_values() const {
    std::string bytes;
    for (const double value : values) bytes += bytes_of_value(type, value, is_big_endian);
    return bytes;
  }
  // The head and what follows it.
  std::pair<std::string, std::string> parts() const {
    const std::string bytes = raw_values();
    const auto extra = static_cast<std::uint64_t>(extra_bytes);
    if (!is_compressed) return {word(bytes.size() + extra), bytes};
    std::string sizes, blocks;
    std::uint64_t num_blocks = 0;
    for (std::size_t begin = 0; begin < bytes.size(); begin += block_bytes, ++num_blocks) {
      const auto block =
          std::span(bytes).subspan(begin, std::min(block_bytes, bytes.size() - begin));
      const auto deflated_block = deflated(std::as_bytes(block));
      sizes += word(deflated_block.size());
      blocks.append(reinterpret_cast<const char*>(deflated_block.data()), deflated_block.size());
    }
    const std::uint64_t last = bytes.size() % block_bytes + extra;
    return {word(num_blocks) + word(block_bytes) + word(last) + sizes, blocks};
  }
  std::string data() const {
    if (format == "ascii") {
      std::ostringstream text;
      text.precision(17);
      for (std::size_t i = 0; i < values.size(); ++i)
        text << values[i] << (i % 6 == 5 ? '\n' : ' ');
      return text.str();
    }
    const auto [head, rest] = parts();
    if (format == "raw") return head + rest;
    return is_head_apart || is_compressed ? base64(head) + base64(rest) : base64(head + rest);
  }
  std::string file() const {
    const bool is_appended = format == "raw" || format == "base64";
    const std::string array = "<DataArray type=\"" + type + "\" Name=\"size\" format=\"" +
                              (is_appended ? "appended\" offset=\"3\"/>\n"
                                           : format + "\">\n" + data() + "\n</DataArray>\n");
    return std::string("<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\"") +
           " byte_order=\"" + (is_big_endian ? "BigEndian" : "LittleEndian") + "\" header_type=\"" +
           (has_wide_head ? "UInt64" : "UInt32") + "\"" +
           (is_compressed ? " compressor=\"vtkZLibDataCompressor\"" : "") +
           ">\n<ImageData WholeExtent=\"" + extent +
           "\" Origin=\"0 10 -1\" Spacing=\"0.5 1 2\">\n<Piece Extent=\"" + extent +
           "\">\n<PointData Scalars=\"size\">\n" + array +
           "</PointData>\n<CellData>\n</CellData>\n</Piece>\n</ImageData>\n" +
           (is_appended ? "<AppendedData encoding=\"" + format + "\">\n _abc" + data() +
                              "\n</AppendedData>\n"
                        : "") +
           "</VTKFile>\n";
  }
  std::string name() const {
    return type + ' ' + format + (is_big_endian ? " big" : " little") +
           (has_wide_head ? " 64" : " 32") + (is_compressed ? " zlib" : " plain") +
           (is_head_apart ? " apart" : "");
  }
};

// In which every way of writing bytes is once.
std::vector<Written> in_every_way(const Written& image) {
  std::vector<Written> all;
  all.push_back(image);
  for (const char* const format : {"binary", "raw", "base64"})
    for (unsigned bits = 0; bits < 16; ++bits) {
      Written one = image;
      one.format = format;
      one.is_big_endian = (bits & 1) != 0;
      one.has_wide_head = (bits & 2) != 0;
      one.is_compressed = (bits & 4) != 0;
      one.is_head_apart = (bits & 8) != 0;
      all.push_back(one);
    }
  return all;
}

std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  if (place == std::string::npos) throw std::invalid_argument("no " + from);
  return text.replace(place, from.size(), to);
}

// ---- A reader

struct Reading {
  SizeImage image;
  std::vector<float> sizes;
  std::uint64_t num_slices = 0;
};

class SizeImageFile : public testing::Test {
 protected:
  Reading read(const std::string& content, const StopToken* stop = nullptr) const {
    write(content);
    Reading reading;
    bool has_header = false;
    read_size_image(file(),
                    {[&](const SizeImage& image) {
                       EXPECT_FALSE(std::exchange(has_header, true));
                       reading.image = image;
                     },
                     [&](std::uint64_t k, std::span<const float> sizes) {
                       EXPECT_TRUE(has_header);
                       EXPECT_EQ(k, reading.num_slices++);
                       EXPECT_EQ(sizes.size(), reading.image.num[0] * reading.image.num[1]);
                       reading.sizes.insert(reading.sizes.end(), sizes.begin(), sizes.end());
                     }},
                    stop);
    EXPECT_EQ(reading.num_slices, reading.image.num[2]);
    return reading;
  }
  std::string refusal_of(const std::string& content) const {
    try {
      read(content);
    } catch (const InputError& e) {
      return e.what();
    }
    return "not refused";
  }
  void expect_refused(const std::string& content, const std::vector<std::string>& words) const {
    const std::string refusal = refusal_of(content);
    EXPECT_EQ(refusal.find(file().string()), 0U) << refusal;
    for (const std::string& word : words)
      EXPECT_NE(refusal.find(word), std::string::npos) << refusal << "\nlacks: " << word;
  }
  void write(const std::string& content) const {
    std::ofstream(file(), std::ios::binary) << content;
  }
  std::filesystem::path file() const { return dir_ / "sizes.vti"; }

 private:
  const TempDir dir_;
};

std::vector<float> as_floats(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}

TEST_F(SizeImageFile, IsReadInEveryWayItCanBeWritten) {
  for (const auto& [type, largest] : {std::pair{"Int8", 127.},
                                      {"UInt8", 255.},
                                      {"Int16", 32767.},
                                      {"UInt16", 65535.},
                                      {"Int32", 2147483647.},
                                      {"UInt32", 4294967295.},
                                      {"Int64", 0x7fffffffffff0000p0},
                                      {"UInt64", 0xffffffffffff0000p0},
                                      {"Float32", 0x1.fffffep127},
                                      {"Float64", 1e38}}) {
    Written image;
    image.type = type;
    for (std::size_t i = 0; i < 60; ++i) image.values[i] = static_cast<double>(1 + i);
    image.values[37] = largest;
    if (image.type.starts_with("Float")) image.values[38] = 0.1, image.values[39] = 0x1p-149;
    for (const Written& one : in_every_way(image)) {
      SCOPED_TRACE(one.name());
      const Reading reading = read(one.file());
      EXPECT_EQ(reading.sizes, as_floats(one.values));
      EXPECT_EQ(reading.image.num, (std::array<std::uint64_t, 3>{5, 4, 3}));
    }
  }
}

// Larger than each of the buffers.
TEST_F(SizeImageFile, IsReadInPieces) {
  Written image;
  image.type = "Float64";
  image.extent = "0 199 0 29 0 2";
  image.block_bytes = 32'767;
  image.values.clear();
  std::mt19937 random(7);
  for (int i = 0; i < 18'000; ++i)
    image.values.push_back(1 + 1e-6 * static_cast<double>(random() % 1'000'000));
  for (const Written& one : in_every_way(image)) {
    SCOPED_TRACE(one.name());
    EXPECT_EQ(read(one.file()).sizes, as_floats(one.values));
  }
}

TEST_F(SizeImageFile, VoxelsAreAroundPoints) {
  const SizeImage image = read(Written().file()).image;
  EXPECT_EQ(image.num_values(), 60U);
  EXPECT_EQ(image.voxel(0, 0, 0), (Box{{-0.25, 9.5, -2}, {0.25, 10.5, 0}}));
  EXPECT_EQ(image.voxel(4, 3, 2), (Box{{1.75, 12.5, 2}, {2.25, 13.5, 4}}));
}

TEST_F(SizeImageFile, VoxelsAreCells) {
  Written image;
  image.values.assign(3 * 2 * 1, 2);  // z has one layer
  image.extent = "-1 2 3 5 7 8";
  std::string text = with(image.file(), "<PointData Scalars=\"size\">", "<PointData/><CellData>");
  text = with(text, "</PointData>\n<CellData>", "");
  const SizeImage cells = read(text).image;
  EXPECT_EQ(cells.num, (std::array<std::uint64_t, 3>{3, 2, 1}));
  EXPECT_EQ(cells.voxel(0, 0, 0), (Box{{-0.5, 13, 13}, {0, 14, 15}}));
  EXPECT_EQ(cells.voxel(2, 1, 0), (Box{{0.5, 14, 13}, {1, 15, 15}}));
  const SizeImage flat = read(with(with(text, "7 8", "7 7"), "7 8", "7 7")).image;
  EXPECT_EQ(flat.num, cells.num);
  EXPECT_EQ(flat.voxel(2, 1, 0), (Box{{0.5, 14, 12}, {1, 15, 14}}));
}

TEST_F(SizeImageFile, VoxelsShareTheirSides) {
  SizeImage image;
  image.low = {0.1, -7.3, 1e9};
  image.spacing = {0.1, 1. / 3, 1e-3};
  for (std::uint64_t i = 0; i < 1000; ++i)
    EXPECT_EQ(image.voxel(i, i, i).max, image.voxel(i + 1, i + 1, i + 1).min);
}

TEST_F(SizeImageFile, XmlMayBeWrittenOtherwise) {
  std::string text = Written().file();
  text =
      with(text, "<?xml version=\"1.0\"?>", "\xef\xbb\xbf<!-- <VTKFile> -->\n<!DOCTYPE VTKFile>");
  text =
      with(text, "type=\"ImageData\" version=\"1.0\"", "version = '1.0'\r\n\ttype\n=\n'ImageData'");
  text = with(text, " byte_order=\"LittleEndian\" header_type=\"UInt32\"", " remark='a \"> b'");
  text = with(text, "<ImageData",
              "<FieldData><DataArray type=\"Int8\" Name=\"size\" format=\"ascii\">0</DataArray>"
              "<Array type=\"String\" Name=\"h\">0</Array></FieldData><ImageData");
  text = with(text, " Scalars=\"size\"", "");
  text = with(text, "format=\"ascii\">\n",
              "format=\"ascii\"><!-- 7 --><InformationKey name=\"a\"><Value index=\"0\">8</Value>"
              "</InformationKey>\n");
  text = with(text, "</DataArray>\n</PointData>",
              "<!-- 7 --><InformationKey name=\"b\">9</InformationKey></DataArray >\n</PointData>");
  EXPECT_EQ(read(text).sizes, std::vector<float>(60, 1.5F));
  EXPECT_EQ(read(with(Written().file(), " Origin=\"0 10 -1\" Spacing=\"0.5 1 2\"", "")).image.low,
            (Point{-0.5, -0.5, -0.5}));
}

// ---- Which array

// Arrays beside that of the sizes: its name, and the attributes of others.
std::string with_arrays(const std::string& name, const std::vector<std::string>& points,
                        const std::vector<std::string>& cells = {}) {
  std::string text = with(Written().file(), "Name=\"size\"", "Name=\"" + name + "\"");
  const auto listed = [](const std::vector<std::string>& all) {
    std::string tags;
    for (const std::string& attributes : all)
      tags += "<DataArray " + attributes + " format=\"ascii\">1 2</DataArray>\n";
    return tags;
  };
  text = with(text, "<DataArray", listed(points) + "<DataArray");
  return with(text, "<CellData>", "<CellData>" + listed(cells));
}

TEST_F(SizeImageFile, OneOfSeveralArraysIsChosen) {
  const std::string other = "type=\"Float64\" Name=\"other\"";
  const std::string size = "type=\"Float64\" Name=\"size\"";
  const std::string vectors = "type=\"Float64\" Name=\"v\" NumberOfComponents=\"3\"";
  const std::string words = "type=\"String\" Name=\"w\"";
  const auto scalars = [](const std::string& text, const std::string& name) {
    return with(text, " Scalars=\"size\"", name.empty() ? "" : " Scalars=\"" + name + "\"");
  };
  for (const std::string& text : {with_arrays("size", {other, vectors}, {other}),
                                  scalars(with_arrays("x", {other, size}), "x"),
                                  scalars(with_arrays("size", {other}, {other}), ""),
                                  scalars(with_arrays("h", {other}, {other}), "missing"),
                                  scalars(with_arrays("x", {vectors, words}, {vectors}), "")})
    EXPECT_EQ(read(text).sizes, std::vector<float>(60, 1.5F)) << text;

  expect_refused(
      scalars(with_arrays("x", {other, vectors}, {words}), ""),
      {"no one array", "\"other\" (points, 1 of Float64)", "\"v\" (points, 3 of Float64)",
       "\"x\" (points, 1 of Float32)", "\"w\" (cells, 1 of String)", "save it alone"});
  expect_refused(scalars(with_arrays("h", {}, {size}), ""),
                 {"no one array", "(cells, 1 of Float64)"});
  expect_refused(scalars(with_arrays("x", {vectors}), "v"), {"Scalars are \"v\" (points, 3"});
  expect_refused(scalars(with_arrays("x", std::vector<std::string>(30, other)), ""), {", ..."});
  const std::string none = Written().file();
  const std::size_t begin = none.find("<DataArray"), end = none.find("</PointData>");
  expect_refused(none.substr(0, begin) + none.substr(end), {"has no array"});
}

// ---- Refusals

// Lets this process have some more memory, which is less than damaged numbers may ask for;
// not under a sanitizer, which has a heap of its own.
class LittleMoreMemory {
 public:
  LittleMoreMemory() {
    std::uint64_t pages = 0, ignored = 0;  // of data
    std::ifstream("/proc/self/statm") >> ignored >> ignored >> ignored >> ignored >> ignored >>
        pages;
    getrlimit(RLIMIT_DATA, &before_);
    const rlimit limit{pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE)) + (256U << 20),
                       before_.rlim_max};
    if (!is_sanitized()) setrlimit(RLIMIT_DATA, &limit);
  }
  ~LittleMoreMemory() { setrlimit(RLIMIT_DATA, &before_); }

 private:
  rlimit before_{};
};

TEST_F(SizeImageFile, RefusesValuesThatAreNoSizes) {
  for (const auto& [value, words] : {std::pair{std::numeric_limits<double>::quiet_NaN(), "is nan"},
                                     {std::numeric_limits<double>::infinity(), "is inf"},
                                     {0., "is 0"},
                                     {-2., "is -2"},
                                     {1e-60, "is 1e-60"},
                                     {1e60, "is 1e+60"}}) {
    Written image;
    image.type = "Float64";
    image.values[33] = value;
    for (const Written& one : in_every_way(image)) {
      SCOPED_TRACE(one.name());
      expect_refused(one.file(), {"its value 33 (counted from 0)", "voxel (3, 2, 1)",
                                  "around (1.5, 12, 1)", words, "correct it"});
    }
  }
  Written image;
  image.type = "Int8";
  image.format = "raw";
  image.values[0] = -56;  // 200, if it had no sign
  expect_refused(image.file(), {"its value 0 ", "is -56"});
  expect_refused(with(Written().file(), "1.5 ", "1e999 "), {"its value 0 ", "is inf"});
}

TEST_F(SizeImageFile, RefusesExtentsOfOtherNumbersOfValues) {
  for (const std::size_t num : {0U, 40U, 59U, 61U, 80U}) {
    Written image;
    image.values.assign(num, 1.5);
    for (const Written& one : in_every_way(image)) {
      SCOPED_TRACE(one.name() + " " + std::to_string(num));
      const std::string refusal = refusal_of(one.file());
      EXPECT_EQ(refusal.find(file().string()), 0U) << refusal;
      if (one.format != "ascii" && num > 0) {
        EXPECT_NE(
            refusal.find("says " + std::to_string(4 * num) + " bytes, but its extent needs 240"),
            std::string::npos)
            << refusal;
      }
    }
  }
  Written image;
  image.values.assign(59, 1.5);
  expect_refused(image.file(), {"ends after 59 values, but its extent has 60", "export"});
  {
    const LittleMoreMemory little;
    image.values.assign(5000, 1.5);
    image.extent = "0 16383 0 16383 0 0";  // a GiB of floats
    expect_refused(image.file(), {"ends after 5000 values, but its extent has 268435456"});
    image.extent = Written().extent;
  }
  image.values.assign(61, 1.5);
  expect_refused(image.file(), {"goes on after the 60 values", "export"});
}

TEST_F(SizeImageFile, RefusesHeadsThatLie) {
  for (Written image : in_every_way({})) {
    if (image.format == "ascii") continue;
    SCOPED_TRACE(image.name());
    image.extra_bytes = image.is_compressed ? 4 : -40;
    expect_refused(image.file(), {"its head says ", " bytes, but its extent needs 240"});
    if (image.is_compressed) continue;
    image.extra_bytes = 0;
    image.extent = "0 999 0 999 0 999";  // for which there would be no memory
    expect_refused(image.file(), {"says 240 bytes, but its extent needs 4000000000"});
    image.extra_bytes = 4'000'000'000 - 240;
    expect_refused(image.file(), {"ends too early"});
  }
  // More follows than the head says.
  Written image;
  image.format = "binary";
  for (const bool is_compressed : {false, true}) {
    image.is_compressed = is_compressed;
    expect_refused(with(image.file(), "\n</DataArray>", "AAAA\n</DataArray>"),
                   {"goes on after the 60 values"});
  }
}

// Of zlib's blocks, in an image of one value in 4 bytes.
TEST_F(SizeImageFile, RefusesBlocksThatCannotBe) {
  Written image;
  image.format = "raw";
  image.is_compressed = true;
  image.block_bytes = 4;
  image.values = {1.5};
  image.extent = "0 0 0 0 0 0";
  const auto refuse = [&](const std::vector<std::uint64_t>& head, const std::string& words) {
    std::string old, changed;
    for (const std::uint64_t value : {1, 4, 0}) old += image.word(value);
    for (const std::uint64_t value : head) changed += image.word(value);
    old +=
        image.parts().first.substr(old.size(), changed.size() > old.size() ? std::string::npos : 0);
    expect_refused(with(image.file(), "_abc" + old, "_abc" + changed), {words});
  };
  for (const bool has_wide_head : {false, true}) {
    image.has_wide_head = has_wide_head;
    EXPECT_EQ(read(image.file()).sizes, std::vector<float>{1.5F});
    refuse({0, 4, 0}, "0 blocks of 4 bytes");
    refuse({1, 0, 0}, "1 blocks of 0 bytes");
    refuse({2, 4, 5}, "the last of 5");
    refuse({4'000'000'000, 4, 0}, "4000000000 blocks");
    refuse({1, 4'000'000'000, 0}, "save it with blocks of another size");
    refuse({1, 4, 0, 0}, "0 compressed bytes");
    refuse({1, 4, 0, 4'000'000'000}, "4000000000 compressed bytes");
    refuse({1, 4, 0, 5}, "block 0 of 1");
    refuse({2, 2, 0, 200, 9}, "ends too early");
  }
  refuse({~std::uint64_t{0}, ~std::uint64_t{0}, 0}, "blocks of 18446744073709551615 bytes");
}

TEST_F(SizeImageFile, RefusesDamagedBytes) {
  Written image;
  image.format = "binary";
  expect_refused(with(image.file(), "AADAPw", "A\x01_APw"),
                 {"which base64 does not have", "damaged"});
  expect_refused(with(image.file(), "AADAPw", "A=DAPw"), {"is '=', which base64 does not have"});
  expect_refused(with(image.file(), "\n</DataArray>", "AA\n</DataArray>"), {"goes on after"});
  expect_refused(with(image.file(), "==\n</DataArray>", "A=\n</DataArray>"), {"goes on after"});
  expect_refused(with(image.file(), "==\n</DataArray>", "=A\n</DataArray>"),
                 {"is 'A', which base64 does not have"});
  image.values.pop_back();
  image.extra_bytes = 4;
  expect_refused(image.file(), {"base64 ends too early", "fewer values"});

  image = {};
  image.format = "raw";
  image.is_compressed = true;
  std::string text = image.file();
  const auto [head, blocks] = image.parts();
  const std::size_t place = text.find("_abc") + 4 + head.size();
  text[place + blocks.size() / 2] = static_cast<char>(~text[place + blocks.size() / 2]);
  expect_refused(text, {"its block ", " of 12 (counted from 0) cannot be decompressed", "fetch"});
  expect_refused(with(Written().file(), "1.5 ", "1,5 "),
                 {"value 0 (counted", "\"1,5\"", "no number"});
}

TEST_F(SizeImageFile, RefusesImagesThatItCannotPlace) {
  const std::string text = Written().file();
  const std::string extents = "0 4 0 3 0 2";
  const auto extent = [&](const std::string& other) {
    return with(with(text, "\"" + extents, "\"" + other), "\"" + extents, "\"" + other);
  };
  expect_refused(extent("0 -1 0 3 0 2"), {"0 -1 0 3 0 2", "empty"});
  expect_refused(extent("0 4 0 3 0 4294967296"), {"32-bit integers"});
  expect_refused(extent("0 4 0 3 0 1.5"), {"32-bit integers"});
  expect_refused(extent("0 4 0 3 0"), {"no list of 6 finite numbers"});
  expect_refused(extent("0 4 0 3 0 2 1"), {"no list of 6 finite numbers"});
  expect_refused(extent("0 4 0 3 0 nan"), {"no list of 6 finite numbers"});
  const std::string all = "-2147483647 2147483647 ";
  expect_refused(extent(all + all + all), {"4294967295 x 4294967295", "make it coarser"});
  expect_refused(with(text, "Piece Extent=\"0 4", "Piece Extent=\"1 4"),
                 {"1 4 0 3 0 2", "0 4 0 3 0 2", "one piece"});
  expect_refused(with(text, "</Piece>", "</Piece><Piece Extent=\"0 4 0 3 0 2\"></Piece>"),
                 {"several pieces"});
  expect_refused(with(text, "<Piece", "<Peace"), {"no element Piece"});
  expect_refused(with(text, "WholeExtent", "Extent"), {"WholeExtent"});
  for (const char* const spacing : {"0.5 0 2", "0.5 -1 2", "0.5 1e-20 2", "0.5 1e308 2"})
    expect_refused(with(text, "Spacing=\"0.5 1 2\"", "Spacing=\"" + std::string(spacing) + "\""),
                   {"no volume", "Spacing along y"});
  expect_refused(with(text, "Spacing=\"0.5 1 2\"", "Spacing=\"0.5 inf 2\""), {"finite"});
  expect_refused(with(text, "Origin=\"0 10 -1\"", "Origin=\"0 x -1\""), {"Origin=\"0 x -1\""});
  EXPECT_EQ(read(with(text, "Origin", "Direction=\"1 0 0 0 1 0 0 0 1\" Origin")).image.num[0], 5U);
  expect_refused(with(text, "Origin", "Direction=\"0 1 0 1 0 0 0 0 1\" Origin"),
                 {"Direction", "resample"});
}

TEST_F(SizeImageFile, RefusesWhatItCannotRead) {
  Written image;
  image.format = "raw";
  const std::string raw = image.file();
  image.format = "binary";
  const std::string binary = image.file();
  const auto compressed = [&](const std::string& by) {
    return with(binary, " header_type", " compressor=\"" + by + "\" header_type");
  };
  for (const char* const by : {"vtkLZ4DataCompressor", "vtkLZMADataCompressor"})
    expect_refused(compressed(by), {by, "without compression or with zlib"});
  EXPECT_EQ(read(compressed("")).sizes.size(), 60U);
  expect_refused(with(binary, "LittleEndian", "MiddleEndian"), {"byte_order=\"MiddleEndian\""});
  expect_refused(with(binary, "UInt32", "UInt16"), {"header_type=\"UInt16\""});
  expect_refused(with(binary, "format=\"binary\"", "format=\"hex\""), {"format=\"hex\""});
  expect_refused(with(raw, "encoding=\"raw\"", "encoding=\"hex\""), {"encoding=\"hex\""});
  expect_refused(with(raw, "offset=\"3\"", "offset=\"-3\""), {"offset=\"-3\""});
  expect_refused(with(raw, "offset=\"3\"", "offset=\"1e18\""), {"ends too early"});
  expect_refused(with(raw, "offset=\"3\"", ""), {"offset=\"\""});
  expect_refused(with(raw, " _abc", " abc"), {"begin with byte 97"});
  expect_refused(with(binary, "format=\"binary\"", "format=\"appended\" offset=\"0\""),
                 {"no element AppendedData"});
  expect_refused(with(raw, "format=\"appended\"", "format=\"ascii\""), {"has no values"});
  expect_refused(with(binary, "type=\"ImageData\"", "type=\"PImageData\""),
                 {"\"PImageData\", not ImageData", "in one file"});
}

TEST_F(SizeImageFile, RefusesWhatIsNoVtkFile) {
  expect_refused("", {"is empty"});
  expect_refused("# vtk DataFile Version 3.0\n", {"is no XML", "# vtk DataFile Vers", ".vti"});
  expect_refused(std::string("\0\1\2", 3), {"is no XML", "???"});
  expect_refused("<html></html>", {"first element is html"});
  expect_refused("<!-- nothing -->", {"no element VTKFile"});
  expect_refused("<!-- nothing", {"ends too early"});
  expect_refused("< >", {"at byte 0 is no tag"});
  expect_refused(with(Written().file(), "Origin=\"", "Origin="), {"has no end within"});
  expect_refused(with(Written().file(), "Origin=", "Origin"), {"is no tag"});
  expect_refused("<a " + std::string(100'000, 'b'), {"has no end within"});
  expect_refused("<VTKFile type=\"ImageData\"/>", {"has no array"});
  EXPECT_THROW(read_size_image(file().parent_path() / "missing", {}), InputError);
  EXPECT_THROW(read_size_image(file().parent_path(), {}), InputError);
}

TEST_F(SizeImageFile, RefusesFilesThatAreCut) {
  for (const Written& one : in_every_way({})) {
    SCOPED_TRACE(one.name());
    const std::string text = one.file();
    const std::size_t needed = one.format == "raw" || one.format == "base64"
                                   ? text.find("\n</AppendedData>")
                                   : text.find("</VTKFile>") + 10;
    for (std::size_t length = needed % 11; length < needed; length += 11)
      EXPECT_NE(refusal_of(text.substr(0, length)), "not refused") << length;
    expect_refused(text.substr(0, needed - 1), {"cut off", "fetch or export it again"});
  }
}

TEST_F(SizeImageFile, RefusesFilesThatAreCutBeforeItTellsOfThem) {
  Written image;
  image.format = "raw";
  const std::string text = image.file();
  write(text.substr(0, text.find("\n</AppendedData>") - 1));
  const auto untold = [](const SizeImage&) { FAIL() << "the last value is missing"; };
  EXPECT_THROW(read_size_image(file(), {untold, {}}), InputError);
}

TEST_F(SizeImageFile, StopsWheneverItAsks) {
  Written image;
  image.format = "raw";
  image.extent = "0 0 0 0 0 59";
  write(image.file());
  const SizeImageSink sink{[](const SizeImage&) {}, [](std::uint64_t, std::span<const float>) {}};
  const StopsAt never(StopsAt::kNever);
  read_size_image(file(), sink, &never);
  EXPECT_GE(never.num_asked(), 60U) << "once a slice";
  for (std::uint64_t question = 1; question <= never.num_asked(); ++question) {
    const StopsAt stop(question);
    EXPECT_THROW(read_size_image(file(), sink, &stop), Stopped) << question;
  }
}

std::string damaged(std::string text, std::mt19937& random) {
  for (unsigned n = 1 + random() % 4; n > 0; --n) {
    const std::size_t place = random() % text.size();
    const char other =
        random() % 2 == 0 ? static_cast<char>(random() % 256) : "<>\"'= -_/09"[random() % 12];
    switch (random() % 4) {
      case 0:
        text[place] = other;
        break;
      case 1:
        text.erase(place, 1 + random() % 20);
        break;
      case 2:
        text.insert(place, text, random() % text.size(), random() % 50);
        break;
      default:
        text.insert(place, 1, other);
    }
    if (text.empty()) break;
  }
  if (random() % 8 == 0) text.resize(random() % (text.size() + 1));
  return text;
}

TEST_F(SizeImageFile, DamagedBytesAreRefusedOrReadAndNothingElse) {
  const LittleMoreMemory little;
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::size_t num_refused = 0, num_tried = 0;
  for (const Written& one : in_every_way({})) {
    const std::string text = one.file();
    for (int i = 0; i < 100; ++i, ++num_tried) {
      const std::string changed = damaged(text, random);
      try {
        write(changed);
        read_size_image(file(), {[](const SizeImage&) {},
                                 [](std::uint64_t, std::span<const float> sizes) {
                                   for (const float size : sizes) EXPECT_GT(size, 0);
                                 }});
      } catch (const InputError&) {
        ++num_refused;
      } catch (const std::exception& e) {
        ADD_FAILURE() << one.name() << ": " << e.what() << "\n" << changed;
      }
    }
  }
  EXPECT_GT(num_refused, num_tried / 4);
  EXPECT_LT(num_refused, num_tried);
}

}  // namespace
}  // namespace locvol
