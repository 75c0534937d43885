#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/affine_map.h"
#include "engine/ingest/number_bytes.h"
#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/value_reader.h"

namespace locvol {
namespace {

using Json = nlohmann::json;

constexpr std::uint64_t kMostJsonBytes = std::uint64_t{1} << 24;
constexpr std::size_t kMostNodeDepth = 1000, kMostNodes = 1'000'000;

// Extensions without which the shape cannot be read.
constexpr std::array<std::string_view, 4> kUnreadable = {
    "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression",
    "EXT_mesh_gpu_instancing"};

// Bytes that the file's JSON speaks of: of the file, or of the JSON itself, decoded.
struct GltfBuffer {
  std::uint64_t place = 0, bytes = 0;
  std::shared_ptr<const std::vector<unsigned char>> decoded;  // null: they lie in the file
};

// Values of one or three numbers, one after the other.
class GltfElements {
 public:
  GltfElements(const InputFile& file, const GltfBuffer& buffer, std::uint64_t place,
               std::uint64_t count, std::uint64_t stride, std::uint64_t element_bytes)
      : buffer_(buffer), place_(place), num_left_(count), stride_(stride), bytes_(element_bytes) {
    if (buffer.decoded || count == 0) return;
    file_ = std::make_unique<InputFile>(file.another());
    file_->skip_to(buffer.place + place);
  }

  // Valid until the next call. REQUIRES: there is one more
  const unsigned char* next() {
    --num_left_;
    const std::uint64_t bytes = num_left_ == 0 ? bytes_ : stride_;  // the last one ends there
    if (file_) return file_->take(bytes);
    const unsigned char* const element = buffer_.decoded->data() + place_;
    place_ += bytes;
    return element;
  }

 private:
  GltfBuffer buffer_;
  std::uint64_t place_, num_left_, stride_, bytes_;
  std::unique_ptr<InputFile> file_;
};

struct GltfAccessor {
  NumberType type = NumberType::kFloat32;
  bool is_normalized = false;
  std::uint64_t count = 0;
  GltfElements elements;

  double number(const unsigned char* element, int component) const {
    const unsigned char* const bytes =
        element + static_cast<std::size_t>(component) * bytes_of(type);
    const double value = number_in(bytes, type, false);
    if (!is_normalized) return value;
    switch (type) {
      case NumberType::kInt8:
        return std::max(value / 127, -1.0);
      case NumberType::kUint8:
        return value / 255;
      case NumberType::kInt16:
        return std::max(value / 32767, -1.0);
      case NumberType::kUint16:
        return value / 65535;
      default:
        return value;
    }
  }
};

std::optional<std::vector<unsigned char>> decode_base64(std::string_view text) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::array<signed char, 256> values{};
  values.fill(-1);
  for (std::size_t i = 0; i < kDigits.size(); ++i)
    values[static_cast<unsigned char>(kDigits[i])] = static_cast<signed char>(i);
  while (text.ends_with('=')) text.remove_suffix(1);
  std::vector<unsigned char> bytes;
  bytes.reserve(text.size() / 4 * 3 + 3);
  unsigned bits = 0;
  int num_bits = 0;
  for (const char c : text) {
    const int value = values[static_cast<unsigned char>(c)];
    if (value < 0) return std::nullopt;
    bits = (bits << 6 | static_cast<unsigned>(value)) & 0xffff;
    num_bits += 6;
    if (num_bits >= 8) bytes.push_back(static_cast<unsigned char>(bits >> (num_bits -= 8) & 0xff));
  }
  return bytes;
}

class GltfParser {
 public:
  GltfParser(const InputFile& file, SurfaceSink& sink) : file_(file), sink_(sink) {}

  void run() {
    try {
      read_json();
      check_extensions();
      find_buffers();
      place_all();
    } catch (const Json::exception& error) {
      file_.refuse(fmt::format("its JSON is not that of glTF: {}; export it again",
                               shown_long(error.what())));
    }
    if (num_others_ > 0)
      sink_.note(fmt::format(
          "left out {} of points and lines",
          num_others_ == 1 ? "a primitive" : fmt::format("{} primitives", num_others_)));
    if (has_skins_) sink_.note("has skins or morph targets; the shape is the one without them");
  }

 private:
  static std::string shown_long(std::string_view text) {
    std::string all;
    for (; !text.empty() && all.size() < 200;
         text.remove_prefix(std::min<std::size_t>(40, text.size())))
      all += shown(text.substr(0, 40));
    return all;
  }
  [[noreturn]] void refuse(const std::string& what) const {
    file_.refuse(what + "; the file is damaged: export it again");
  }

  // ---- The file

  void read_json() {
    InputFile file = file_.another();
    constexpr std::uint32_t kGlb = 0x46546c67, kJsonChunk = 0x4e4f534a, kBinChunk = 0x004e4942;
    std::uint64_t json_bytes = file.size();
    const auto word = [&] { return bits_in(file.take(4), 4, false); };
    const std::string_view head = file.peek(4);
    const bool is_glb = head.size() == 4 && bits_in(head.data(), 4, false) == kGlb;
    if (is_glb) {
      file.take(4);
      if (const auto version = word(); version != 2)
        file.refuse(fmt::format("is glTF of version {}; export it as version 2", version));
      const std::uint64_t length = word();
      if (length > file.size()) file.refuse_truncated();
      json_bytes = word();
      if (word() != kJsonChunk) refuse("does not begin with JSON");
      if (json_bytes > file.remaining()) file.refuse_truncated();
    }
    if (json_bytes > kMostJsonBytes)
      file.refuse(
          fmt::format("has {} bytes of JSON, more than {}; export it as GLB, with its "
                      "triangles as bytes",
                      json_bytes, kMostJsonBytes));
    const unsigned char* const json = file.take(json_bytes);
    std::string_view text(reinterpret_cast<const char*>(json), json_bytes);
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    document_ = Json::parse(text);
    if (!document_.is_object()) refuse("its JSON is no object");
    if (is_glb && file.remaining() >= 8) {
      const std::uint64_t bytes = word();
      if (word() == kBinChunk) chunk_ = GltfBuffer{file.position(), bytes, nullptr};
      if (bytes > file.remaining()) file.refuse_truncated();
    }
  }

  void check_extensions() {
    if (!document_.contains("extensionsRequired")) return;
    for (const Json& extension : document_.at("extensionsRequired")) {
      const auto name = extension.get<std::string>();
      if (std::ranges::find(kUnreadable, name) != kUnreadable.end())
        file_.refuse(
            fmt::format("is compressed by {}, which cannot be read; export it without "
                        "compression",
                        name));
    }
  }

  void find_buffers() {
    if (!document_.contains("buffers")) return;
    for (const Json& json : document_.at("buffers")) {
      GltfBuffer buffer;
      const std::uint64_t bytes = number(json, "byteLength");
      if (!json.contains("uri")) {
        if (!buffers_.empty() || !chunk_) refuse("has a buffer without bytes");
        buffer = *chunk_;
      } else {
        const auto& uri = json.at("uri").get_ref<const std::string&>();
        const std::size_t comma = uri.find(";base64,");
        if (!uri.starts_with("data:") || comma == uri.npos)
          file_.refuse(
              fmt::format("has its triangles in another file, \"{}\"; export it as GLB, "
                          "which is one file",
                          shown(uri)));
        auto decoded = decode_base64(std::string_view(uri).substr(comma + 8));
        if (!decoded) refuse("has base64 with a character that is none of it");
        buffer.bytes = decoded->size();
        buffer.decoded = std::make_shared<const std::vector<unsigned char>>(std::move(*decoded));
      }
      if (bytes > buffer.bytes)
        refuse(fmt::format("has a buffer of {} bytes, of which only {} are there", bytes,
                           buffer.bytes));
      buffer.bytes = bytes;
      buffers_.push_back(std::move(buffer));
    }
  }

  // ---- JSON

  std::uint64_t number(const Json& json, const char* key) const {
    const Json& value = json.at(key);
    if (!value.is_number_unsigned()) refuse(fmt::format("its \"{}\" is no count", key));
    return value.get<std::uint64_t>();
  }
  std::uint64_t number(const Json& json, const char* key, std::uint64_t otherwise) const {
    return json.contains(key) ? number(json, key) : otherwise;
  }
  const Json& item(const char* list, std::uint64_t index) const {
    const Json& items = document_.at(list);
    if (!items.is_array() || index >= items.size())
      refuse(fmt::format("there is no number {} of its \"{}\"", index, list));
    return items[index];
  }
  static std::string name_of(const Json& json) {
    return json.contains("name") ? json.at("name").get<std::string>() : "";
  }
  template <std::size_t N>
  std::optional<std::array<double, N>> numbers(const Json& json, const char* key) const {
    if (!json.contains(key)) return std::nullopt;
    const Json& list = json.at(key);
    if (!list.is_array() || list.size() != N)
      refuse(fmt::format("its \"{}\" has not {} numbers", key, N));
    std::array<double, N> values{};
    for (std::size_t i = 0; i < N; ++i) {
      values[i] = list[i].get<double>();
      if (!std::isfinite(values[i])) refuse(fmt::format("its \"{}\" has no finite numbers", key));
    }
    return values;
  }

  // ---- Nodes

  void place_all() {
    const bool has_nodes = document_.contains("nodes");
    if (!has_nodes && document_.contains("meshes")) {
      for (std::uint64_t m = 0; m < document_.at("meshes").size(); ++m) give_mesh(m, {}, "");
    } else if (document_.contains("scenes") && !document_.at("scenes").empty()) {
      const Json& scene = item("scenes", number(document_, "scene", 0));
      if (scene.contains("nodes"))
        for (const Json& node : scene.at("nodes")) place(index(node), {}, 0);
    } else if (has_nodes) {
      place_roots();
    }
    if (num_vertices_ == 0) file_.refuse("has no triangles in its scene; export it again");
  }
  void place_roots() {
    const Json& nodes = document_.at("nodes");
    std::vector<bool> is_child(nodes.size());
    for (const Json& node : nodes)
      if (node.contains("children"))
        for (const Json& child : node.at("children"))
          if (index(child) < is_child.size()) is_child[index(child)] = true;
    for (std::uint64_t n = 0; n < is_child.size(); ++n)
      if (!is_child[n]) place(n, {}, 0);
  }
  std::uint64_t index(const Json& json) const {
    if (!json.is_number_unsigned()) refuse("names a node by what is no count");
    return json.get<std::uint64_t>();
  }

  void place(std::uint64_t number_of_node, const AffineMap& around, std::size_t depth) {
    if (depth > kMostNodeDepth || ++num_placed_ > kMostNodes)
      refuse("has nodes that hold themselves, or too many");
    const Json& node = item("nodes", number_of_node);
    const AffineMap map = around * map_of(node);
    if (node.contains("skin")) has_skins_ = true;
    if (node.contains("mesh")) give_mesh(number(node, "mesh"), map, name_of(node));
    if (node.contains("children"))
      for (const Json& child : node.at("children")) place(index(child), map, depth + 1);
  }

  AffineMap map_of(const Json& node) const {
    AffineMap map;
    if (const auto matrix = numbers<16>(node, "matrix")) {
      for (std::size_t row = 0; row < 3; ++row)
        for (std::size_t column = 0; column < 4; ++column)
          map.rows[row][column] = (*matrix)[4 * column + row];
      return map;
    }
    const auto moved = numbers<3>(node, "translation"), scale = numbers<3>(node, "scale");
    if (const auto turned = numbers<4>(node, "rotation")) {
      const auto& [x, y, z, w] = *turned;
      map.rows = {{{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 0},
                   {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 0},
                   {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), 0}}};
    }
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t column = 0; scale && column < 3; ++column)
        map.rows[row][column] *= (*scale)[column];
      if (moved) map.rows[row][3] = (*moved)[row];
    }
    return map;
  }

  // ---- Meshes

  void give_mesh(std::uint64_t mesh_number, const AffineMap& map, std::string name) {
    const Json& mesh = item("meshes", mesh_number);
    if (name.empty()) name = name_of(mesh);
    sink_.group(name);
    given_.reset();
    for (const Json& primitive : mesh.at("primitives")) give(primitive, map);
  }

  GltfAccessor accessor(std::uint64_t number_of_accessor, std::uint64_t components) const {
    const Json& json = item("accessors", number_of_accessor);
    if (json.contains("sparse"))
      file_.refuse("has sparse accessors, which cannot be read; export it without them");
    const std::string shape = json.at("type").get<std::string>();
    if (shape != (components == 1 ? "SCALAR" : "VEC3"))
      refuse(fmt::format("has an accessor of \"{}\" where {} must be", shown(shape),
                         components == 1 ? "SCALAR" : "VEC3"));
    const NumberType type = type_of(number(json, "componentType"));
    const std::uint64_t count = number(json, "count");
    const Json& view = item("bufferViews", number(json, "bufferView"));
    const std::uint64_t buffer_number = number(view, "buffer");
    if (buffer_number >= buffers_.size()) refuse("names a buffer that is not there");
    const GltfBuffer& buffer = buffers_[buffer_number];
    const std::uint64_t element_bytes = components * bytes_of(type);
    const std::uint64_t stride = number(view, "byteStride", element_bytes);
    const std::uint64_t view_place = number(view, "byteOffset", 0),
                        view_bytes = number(view, "byteLength"),
                        place = number(json, "byteOffset", 0);
    const bool is_view_there =
        view_place <= buffer.bytes && view_bytes <= buffer.bytes - view_place;
    if (!is_view_there || stride < element_bytes || place > view_bytes ||
        (count > 0 && (view_bytes - place < element_bytes ||
                       count - 1 > (view_bytes - place - element_bytes) / stride)))
      refuse(fmt::format("its accessor {} promises {} values, more than its {} bytes hold",
                         number_of_accessor, count, view_bytes));
    return {type, json.contains("normalized") && json.at("normalized").get<bool>(), count,
            GltfElements(file_, buffer, view_place + place, count, stride, element_bytes)};
  }
  NumberType type_of(std::uint64_t component_type) const {
    switch (component_type) {
      case 5120:
        return NumberType::kInt8;
      case 5121:
        return NumberType::kUint8;
      case 5122:
        return NumberType::kInt16;
      case 5123:
        return NumberType::kUint16;
      case 5125:
        return NumberType::kUint32;
      case 5126:
        return NumberType::kFloat32;
      default:
        refuse(
            fmt::format("has an accessor of the component type {}, which is none", component_type));
    }
  }

  void give(const Json& primitive, const AffineMap& map) {
    constexpr std::uint64_t kTriangles = 4, kStrip = 5, kFan = 6;
    const std::uint64_t mode = number(primitive, "mode", kTriangles);
    if (mode < kTriangles) {
      ++num_others_;
      return;
    }
    if (mode > kFan) refuse(fmt::format("has a primitive of the mode {}, which is none", mode));
    if (primitive.contains("targets")) has_skins_ = true;
    const std::uint64_t positions = number(primitive.at("attributes"), "POSITION");
    if (!given_ || given_->accessor != positions) give_positions(positions, map);
    std::optional<GltfAccessor> indices;
    if (primitive.contains("indices")) {
      indices.emplace(accessor(number(primitive, "indices"), 1));
      if (!is_integer(indices->type)) refuse("has indices that are no integers");
    }
    const std::uint64_t count = indices ? indices->count : given_->count;
    if (mode == kTriangles && count % 3 != 0)
      refuse(fmt::format("has {} corners of triangles, which is no multiple of three", count));
    const bool turns = map.turns();
    std::array<std::uint64_t, 3> corners{};
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t vertex =
          indices ? bits_in(indices->elements.next(), bytes_of(indices->type), false) : i;
      if (vertex >= given_->count)
        refuse(fmt::format("face {} names vertex {} (counted from 0), but its mesh has {}",
                           num_faces_ + 1, vertex, given_->count));
      const std::uint64_t k = mode == kTriangles ? i % 3 : std::min<std::uint64_t>(i, 2);
      if (mode == kStrip && i > 2) corners = {corners[1], corners[2], 0};
      if (mode == kFan && i > 2) corners[1] = corners[2];
      corners[k] = given_->first + vertex;
      if (k < 2) continue;
      give_triangle(corners, turns != (mode == kStrip && i % 2 == 1), mode != kTriangles);
    }
  }
  void give_triangle(const std::array<std::uint64_t, 3>& corners, bool turns, bool may_collapse) {
    const auto& [a, b, c] = corners;
    ++num_faces_;
    if (may_collapse && (a == b || b == c || c == a)) return;  // which strips turn around by
    sink_.polygon(turns ? std::array{a, c, b} : corners, {FilePlace::Unit::kFace, num_faces_});
  }

  void give_positions(std::uint64_t number_of_accessor, const AffineMap& map) {
    GltfAccessor positions = accessor(number_of_accessor, 3);
    given_ = Given{number_of_accessor, num_vertices_, positions.count};
    for (std::uint64_t i = 0; i < positions.count; ++i) {
      const unsigned char* const element = positions.elements.next();
      const Point p{positions.number(element, 0), positions.number(element, 1),
                    positions.number(element, 2)};
      give_vertex(file_, num_vertices_++, map(p), sink_);
    }
  }

  // The vertices of the mesh at hand that came last, which several primitives may share.
  struct Given {
    std::uint64_t accessor, first, count;
  };

  const InputFile& file_;
  SurfaceSink& sink_;
  Json document_;
  std::optional<GltfBuffer> chunk_;
  std::vector<GltfBuffer> buffers_;
  std::optional<Given> given_;
  std::size_t num_placed_ = 0;
  std::uint64_t num_vertices_ = 0, num_faces_ = 0, num_others_ = 0;
  bool has_skins_ = false;
};

}  // namespace

void parse_gltf(const InputFile& file, SurfaceSink& sink) { GltfParser(file, sink).run(); }

}  // namespace locvol
