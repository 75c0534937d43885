#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/ingest/affine_map.h"
#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"
#include "engine/ingest/value_reader.h"
#include "engine/ingest/xml_tags.h"
#include "engine/ingest/zip_archive.h"
#include "engine/shared/input_error.h"

namespace locvol {
namespace {

constexpr std::size_t kMostObjects = 100'000, kMostPlaced = 100'000, kMostObjectDepth = 100;
constexpr std::size_t kMostParts = 10'000;

struct ObjectUse {
  std::size_t part = 0;  // of the archive that has the object
  std::string object;
  AffineMap map;
};

struct MeshObject {
  std::string name, type;
  std::size_t part = 0;
  std::optional<std::uint64_t> mesh;  // place of its mesh in the part
  std::uint64_t num_triangles = 0;
  std::vector<ObjectUse> components;
};

// A mesh at its place.
struct PlacedMesh {
  const MeshObject* object = nullptr;
  AffineMap map;
  std::string name;
};

// XML has names in a namespace, as in p:path.
std::string_view local_name(std::string_view name) {
  const std::size_t colon = name.rfind(':');
  return colon == name.npos ? name : name.substr(colon + 1);
}

std::string plain_text(std::string text) {
  constexpr std::array<std::pair<std::string_view, char>, 5> kEntities = {
      {{"&lt;", '<'}, {"&gt;", '>'}, {"&quot;", '"'}, {"&apos;", '\''}, {"&amp;", '&'}}};
  for (const auto& [entity, c] : kEntities)
    for (std::size_t at = 0; (at = text.find(entity, at)) != text.npos; ++at)
      text.replace(at, entity.size(), 1, c);
  return text;
}

class ThreeMfParser {
 public:
  ThreeMfParser(const InputFile& file, SurfaceSink& sink)
      : file_(file), archive_(file.bytes()), sink_(sink) {}

  void run() {
    part_named(root());
    for (std::size_t part = 0; part < parts_.size(); ++part) scan(part);
    place_all();
    std::ranges::stable_sort(placed_, {}, [](const PlacedMesh& placed) {
      return std::pair(placed.object->part, *placed.object->mesh);
    });
    if (placed_.empty()) file_.refuse("its build places no object that has a mesh");
    if (num_supports_ > 0)
      sink_.note(
          fmt::format("left out {} of supports",
                      num_supports_ == 1 ? "an object" : fmt::format("{} objects", num_supports_)));
    if (!unit_.empty() && unit_ != "millimeter")
      sink_.note(fmt::format("its coordinates are in the unit {}", shown(unit_)));
    std::uint64_t num_triangles = 0;
    for (const PlacedMesh& placed : placed_) num_triangles += placed.object->num_triangles;
    sink_.announce(num_triangles);
    for (const PlacedMesh& placed : placed_) give(placed);
  }

 private:
  // The name of the part that the archive's relations call the model.
  std::string root() const {
    if (const auto* const entry = archive_.find("_rels/.rels")) {
      InputFile file = archive_.open(*entry, file_.stop());
      XmlTags tags(file);
      while (const auto tag = tags.next())
        if (local_name(tag->name) == "Relationship" && tag->get("Type", "").ends_with("/3dmodel") &&
            tag->find("Target"))
          return *tag->find("Target");
    }
    return "3D/3dmodel.model";
  }

  std::size_t part_named(const std::string& name) {
    const auto* const entry = archive_.find(name);
    if (entry == nullptr)
      file_.refuse(
          fmt::format("is a zip archive without \"{}\", so no 3MF file; unpack it, by "
                      "unzip, or export the surface again",
                      shown(name)));
    const auto found = std::ranges::find(parts_, entry);
    if (found != parts_.end()) return static_cast<std::size_t>(found - parts_.begin());
    if (parts_.size() == kMostParts)
      file_.refuse(fmt::format("has models in more than {} files", kMostParts));
    parts_.push_back(entry);
    return parts_.size() - 1;
  }

  // ---- What is where

  void scan(std::size_t part) {
    InputFile file = archive_.open(*parts_[part], file_.stop());
    XmlTags tags(file);
    MeshObject* object = nullptr;
    bool is_in_build = false, has_model = false;
    while (const auto tag = tags.next()) {
      const std::string_view name = local_name(tag->name);
      if (name == "model" && tag->is_start) {
        has_model = true;
        if (part == 0) unit_ = tag->get("unit", "millimeter");
      } else if (name == "object") {
        object = tag->is_start ? &add_object(file, part, *tag) : nullptr;
      } else if (name == "mesh" && tag->is_start && object != nullptr && !tag->is_end) {
        object->mesh = file.position();
      } else if (name == "triangle" && tag->is_start && object != nullptr) {
        ++object->num_triangles;
      } else if (name == "component" && tag->is_start && object != nullptr) {
        object->components.push_back(component(file, part, *tag));
      } else if (name == "build") {
        is_in_build = tag->is_start && !tag->is_end;
      } else if (name == "item" && tag->is_start && is_in_build && part == 0) {
        if (items_.size() == kMostPlaced) refuse_many();
        items_.push_back(component(file, part, *tag));
      }
    }
    if (!has_model) file.refuse("has no model; export it again");
    file.digest();  // reads it to its end, and compares its checksum
  }

  MeshObject& add_object(const InputFile& file, std::size_t part, const XmlTag& tag) {
    if (objects_.size() == kMostObjects)
      file_.refuse(fmt::format("has more than {} objects", kMostObjects));
    const std::string id = tag.get("id", "");
    const auto [object, is_new] = objects_.emplace(std::pair(part, id), MeshObject{});
    if (!is_new) file.refuse(fmt::format("has two objects with the id \"{}\"", shown(id)));
    object->second.name = plain_text(tag.get("name", ""));
    object->second.type = tag.get("type", "model");
    object->second.part = part;
    return object->second;
  }

  ObjectUse component(const InputFile& file, std::size_t part, const XmlTag& tag) {
    ObjectUse found;
    found.part = part;
    found.object = tag.get("objectid", "");
    for (const auto& [key, value] : tag.attributes) {
      if (local_name(key) == "path") found.part = part_named(value);
      if (key == "transform") found.map = map_of(file, value);
    }
    return found;
  }

  // Twelve numbers: for x, y, z and 1 what each adds to the three coordinates.
  AffineMap map_of(const InputFile& file, std::string_view text) const {
    AffineMap map;
    for (std::size_t column = 0; column < 4; ++column)
      for (std::size_t row = 0; row < 3; ++row) {
        text.remove_prefix(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
        const std::string_view word = text.substr(0, text.find_first_of(" \t\r\n"));
        text.remove_prefix(word.size());
        const auto number = parse_number(word);
        if (!number || !std::isfinite(*number))
          file.refuse(
              fmt::format("before byte {}: a transform has \"{}\" where one of twelve "
                          "numbers must stand; export it again",
                          file.position(), shown(word)));
        map.rows[row][column] = *number;
      }
    return map;
  }

  // ---- What is placed

  [[noreturn]] void refuse_many() const {
    file_.refuse(fmt::format("places more than {} objects; export fewer", kMostPlaced));
  }

  void place_all() {
    for (const ObjectUse& item : items_) place(item, AffineMap(), "", 0);
    // The same name means the same group: other copies of an object get numbers.
    std::map<std::string, int> uses;
    for (PlacedMesh& placed : placed_) {
      if (placed.name.empty()) continue;
      if (const int use = ++uses[placed.name]; use > 1) placed.name += fmt::format(" {}", use);
    }
  }

  void place(const ObjectUse& component, const AffineMap& around, const std::string& name,
             std::size_t depth) {
    const auto found = objects_.find(std::pair(component.part, component.object));
    if (found == objects_.end())
      file_.refuse(fmt::format("there is no object with the id \"{}\"; the file is damaged",
                               shown(component.object)));
    const MeshObject& object = found->second;
    if (depth > kMostObjectDepth || ++num_steps_ > 10 * kMostPlaced) refuse_many();
    if (object.type == "support" || object.type == "solidsupport") {
      ++num_supports_;
      return;
    }
    const AffineMap map = around * component.map;
    const std::string& named = object.name.empty() ? name : object.name;
    if (object.mesh) {
      if (placed_.size() == kMostPlaced) refuse_many();
      placed_.push_back({&object, map, named});
    }
    for (const ObjectUse& part : object.components) place(part, map, named, depth + 1);
  }

  // ---- Meshes

  void give(const PlacedMesh& placed) {
    const MeshObject& object = *placed.object;
    if (!reader_ || reader_part_ != object.part || reader_->position() > *object.mesh) {
      reader_.emplace(archive_.open(*parts_[object.part], file_.stop()));
      reader_part_ = object.part;
    }
    reader_->skip_to(*object.mesh);
    sink_.group(placed.name);
    XmlTags tags(*reader_);
    const bool turns = placed.map.turns();
    const std::uint64_t first_vertex = num_vertices_;
    bool is_in_triangles = false;
    while (const auto tag = tags.next()) {
      const std::string_view name = local_name(tag->name);
      if (name == "vertex" && tag->is_start && !is_in_triangles) {
        const Point p{coordinate(*tag, "x"), coordinate(*tag, "y"), coordinate(*tag, "z")};
        give_vertex(*reader_, num_vertices_++, placed.map(p), sink_);
      } else if (name == "triangle" && tag->is_start && is_in_triangles) {
        const std::uint64_t a = first_vertex + number(*tag, "v1", first_vertex),
                            b = first_vertex + number(*tag, "v2", first_vertex),
                            c = first_vertex + number(*tag, "v3", first_vertex);
        sink_.polygon(turns ? std::array{a, c, b} : std::array{a, b, c},
                      {FilePlace::Unit::kFace, ++num_faces_});
      } else if (name == "triangles") {
        is_in_triangles = tag->is_start && !tag->is_end;
      } else if (name == "mesh" && tag->is_end) {
        return;
      }
    }
    reader_->refuse_truncated();
  }

  const std::string& attribute(const XmlTag& tag, std::string_view key) const {
    const std::string* const value = tag.find(key);
    if (value == nullptr)
      reader_->refuse(fmt::format("before byte {}: a {} has no {}; export it again",
                                  reader_->position(), shown(tag.name), key));
    return *value;
  }
  double coordinate(const XmlTag& tag, std::string_view key) const {
    const std::string& text = attribute(tag, key);
    const auto value = parse_number(trimmed(text));
    if (!value)
      reader_->refuse(fmt::format("before byte {}: {}=\"{}\" is no number", reader_->position(),
                                  key, shown(text)));
    return *value;
  }
  std::uint64_t number(const XmlTag& tag, std::string_view key, std::uint64_t first) const {
    const std::string& text = attribute(tag, key);
    const std::uint64_t most = num_vertices_ - first;
    std::uint64_t value = 0;
    const bool is_number = !text.empty() && text.size() < 19 &&
                           std::ranges::all_of(text, [](char c) { return '0' <= c && c <= '9'; });
    if (is_number)
      for (const char c : text) value = 10 * value + static_cast<std::uint64_t>(c - '0');
    if (!is_number || value >= most)
      reader_->refuse(
          fmt::format("before byte {}: {}=\"{}\" names no vertex, of which its mesh has "
                      "{}; the file is damaged",
                      reader_->position(), key, shown(text), most));
    return value;
  }

  const InputFile& file_;
  ZipArchive archive_;
  SurfaceSink& sink_;
  std::vector<const ZipArchive::Entry*> parts_;  // that hold models; the first has the build
  std::map<std::pair<std::size_t, std::string>, MeshObject> objects_;
  std::vector<ObjectUse> items_;
  std::vector<PlacedMesh> placed_;
  std::string unit_;
  std::size_t num_supports_ = 0, num_steps_ = 0;
  std::optional<InputFile> reader_;  // of the part, and up to where meshes have been given
  std::size_t reader_part_ = 0;
  std::uint64_t num_vertices_ = 0, num_faces_ = 0;
};

}  // namespace

bool is_3mf(const InputFile& file) {
  if (file.is_unpacked() || !ZipArchive::is_zip(*file.bytes())) return false;
  try {
    const ZipArchive archive(file.bytes());
    return archive.find("3D/3dmodel.model") != nullptr ||
           (archive.find("_rels/.rels") != nullptr &&
            std::ranges::any_of(archive.entries(), [](const ZipArchive::Entry& entry) {
              return entry.name.ends_with(".model");
            }));
  } catch (const InputError&) {
    return false;  // no archive, or a damaged one
  }
}

void parse_3mf(const InputFile& file, SurfaceSink& sink) { ThreeMfParser(file, sink).run(); }

}  // namespace locvol
