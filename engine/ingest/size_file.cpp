#include "engine/ingest/size_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "engine/ingest/input_file.h"
#include "engine/ingest/text_scanner.h"
#include "engine/shared/input_error.h"

namespace locvol {
namespace {

constexpr std::size_t kMostShapes = 1'000'000;
constexpr std::size_t kMostJsonBytes = std::size_t{256} << 20;

// A shape as it is written.
struct Written {
  std::string kind;
  Size size;
  std::vector<Coordinates> points;
  std::optional<double> radius;
  std::string name;  // of a part
};

// What has a name instead of a place.
constexpr std::string_view kSheet = "sheet", kBody = "body";
bool is_part(std::string_view kind) { return kind == kSheet || kind == kBody; }

struct Kind {
  std::string_view name;
  SizedShape::Kind shape;
  std::size_t least_points, most_points;
};
constexpr std::array kKinds{Kind{"point", SizedShape::Kind::kBall, 1, 1},
                            Kind{"ball", SizedShape::Kind::kBall, 1, 1},
                            Kind{"box", SizedShape::Kind::kBox, 2, 2},
                            Kind{"line", SizedShape::Kind::kSegment, 2, kMostShapes}};

const Kind* kind_of(std::string_view name) {
  const auto* kind = std::ranges::find(kKinds, name, &Kind::name);
  return kind == kKinds.end() ? nullptr : kind;
}

// What is wrong with it; empty: nothing.
std::string fault_of(const Written& shape) {
  const Kind* kind = kind_of(shape.kind);
  const bool has_name = is_part(shape.kind);
  if (kind == nullptr && !has_name)
    return fmt::format("'{}' is no shape: give point, ball, box, line, sheet or body",
                       shape.kind.substr(0, 40));
  if (!(shape.size.value > 0) || !std::isfinite(shape.size.value))
    return fmt::format("size {}: give a finite number above 0", shape.size.value);
  if (has_name) {
    if (shape.name.empty()) return fmt::format("a {} without a name", shape.kind);
    if (shape.points.empty() && !shape.radius) return {};
    return fmt::format("a {} with points or a radius", shape.kind);
  }
  if (!shape.name.empty()) return fmt::format("a {} with a name", shape.kind);
  const std::size_t num = shape.points.size();
  if (num < kind->least_points || num > kind->most_points)
    return fmt::format("a {} of {} points: give {}{}", shape.kind, num, kind->least_points,
                       kind->most_points > kind->least_points ? " or more" : "");
  const bool is_ball = shape.kind == "ball";
  if (is_ball && !shape.radius) return "a ball without a radius";
  if (!is_ball && shape.radius) return fmt::format("a {} with a radius", shape.kind);
  if (shape.radius && !(*shape.radius >= 0))
    return fmt::format("radius {}: give a number of at least 0", *shape.radius);
  return {};
}

void append(const Written& shape, const std::string& place, GivenSizes& all) {
  if (is_part(shape.kind)) {
    (shape.kind == kSheet ? all.sheets : all.bodies).push_back({shape.name, shape.size, place});
    return;
  }
  std::vector<SizedShape>& shapes = all.shapes;
  const std::vector<Coordinates>& points = shape.points;
  SizedShape made{.kind = kind_of(shape.kind)->shape,
                  .size = shape.size,
                  .a = points[0],
                  .b = points[0],
                  .radius = shape.radius.value_or(0),
                  .place = place};
  if (made.kind == SizedShape::Kind::kBall) shapes.push_back(made);
  for (std::size_t i = 1; i < points.size(); ++i) {
    made.a = points[i - 1], made.b = points[i];
    shapes.push_back(made);
  }
}

// ---- Text

// A name may have blanks within.
std::string rest_of_line(TextScanner& scanner) {
  std::string rest;
  for (std::string_view word = scanner.word(); !word.empty(); word = scanner.word())
    rest.append(rest.empty() ? "" : " ").append(word);
  return rest;
}

// "#7" is an id where a name is to be, and else a comment; empty: it is one.
std::string id_in(std::string_view comment) {
  std::size_t end = 1;
  while (end < comment.size() && std::isdigit(static_cast<unsigned char>(comment[end]))) ++end;
  return end > 1 ? std::string(comment.substr(0, end)) : std::string();
}

Written read_line(TextScanner& scanner, InputFile& file) {
  Written shape;
  shape.kind = scanner.word();
  if (kind_of(shape.kind) == nullptr && !is_part(shape.kind)) file.refuse_line(fault_of(shape));
  const auto number = [&](const char* what) {
    const std::string_view word = scanner.word();
    if (word.empty()) file.refuse_line(fmt::format("the {} is missing", what));
    return scanner.coordinate(word);
  };
  std::string_view size = scanner.word();
  if (size.empty()) file.refuse_line("the size is missing");
  shape.size.is_percent = size.ends_with('%');
  if (shape.size.is_percent) size.remove_suffix(1);
  shape.size.value = scanner.coordinate(size);
  if (is_part(shape.kind)) {
    shape.name = rest_of_line(scanner);
    if (shape.name.empty()) shape.name = id_in(scanner.comment());
    if (const std::string fault = fault_of(shape); !fault.empty()) file.refuse_line(fault);
    return shape;
  }
  const std::size_t most = kind_of(shape.kind)->most_points;
  while (!scanner.at_line_end()) {
    if (shape.points.size() == most && shape.kind == "ball" && !shape.radius) {
      shape.radius = number("radius");
      continue;
    }
    if (shape.points.size() == most)
      file.refuse_line(fmt::format("more numbers than a {} has", shape.kind));
    const double x = number("x"), y = number("y"), z = number("z");
    shape.points.push_back({x, y, z});
  }
  if (const std::string fault = fault_of(shape); !fault.empty()) file.refuse_line(fault);
  return shape;
}

GivenSizes read_text(InputFile& file) {
  GivenSizes all;
  TextScanner scanner(file, '#');
  while (scanner.next_line()) {
    const Written shape = read_line(scanner, file);
    append(shape, fmt::format("{}, line {}", file.path().string(), file.line_number()), all);
    if (all.shapes.size() > kMostShapes)
      file.refuse_line(fmt::format("more than {} shapes: leave some out", kMostShapes));
  }
  return all;
}

// ---- JSON

using Json = nlohmann::json;

double number_in(const Json& value, const char* what) {
  if (!value.is_number()) throw InputError(fmt::format("{} is no number", what));
  return value.get<double>();
}

Written shape_in(const Json& value) {
  if (!value.is_object()) throw InputError("it is no object");
  for (const auto& [name, ignored] : value.items())
    if (name != "kind" && name != "size" && name != "points" && name != "radius" && name != "name")
      throw InputError(fmt::format("'{}' is unknown: give kind, size, points, radius, name", name));
  const bool has_kind = value.contains("kind") && value["kind"].is_string();
  const bool has_name = has_kind && is_part(value["kind"].get<std::string>());
  if (has_name &&
      (!value.contains("size") || !value.contains("name") || !value["name"].is_string()))
    throw InputError("give its size, and its name");
  if (!has_name && (!has_kind || !value.contains("size") || !value.contains("points") ||
                    !value["points"].is_array()))
    throw InputError("give its kind, its size, and its points as a list");
  Written shape;
  shape.kind = value["kind"].get<std::string>();
  if (value.contains("name") && value["name"].is_string())
    shape.name = value["name"].get<std::string>();
  const Json& size = value["size"];
  if (size.is_string()) {
    const std::string text = size.get<std::string>();
    const auto percent = text.ends_with('%')
                             ? parse_number(std::string_view(text).substr(0, text.size() - 1))
                             : std::nullopt;
    if (!percent)
      throw InputError(fmt::format("'{}' is no size: give a number, or a string such as \"2%\"",
                                   text.substr(0, 40)));
    shape.size = {*percent, true};
  } else {
    shape.size.value = number_in(size, "size");
  }
  for (const Json& point : value.value("points", Json::array())) {
    if (!point.is_array() || point.size() != 3) throw InputError("a point has three coordinates");
    shape.points.push_back(
        {number_in(point[0], "x"), number_in(point[1], "y"), number_in(point[2], "z")});
  }
  if (value.contains("radius")) shape.radius = number_in(value["radius"], "radius");
  if (const std::string fault = fault_of(shape); !fault.empty()) throw InputError(fault);
  return shape;
}

GivenSizes read_json(InputFile& file) {
  if (file.size() > kMostJsonBytes)
    file.refuse("more than 256 MiB of JSON: leave some shapes out, or give them as text");
  const auto size = static_cast<std::size_t>(file.remaining());
  const unsigned char* bytes = file.take(size);
  Json json;
  try {
    json = Json::parse(bytes, bytes + size);
  } catch (const Json::parse_error& e) {
    file.refuse(std::string("no valid JSON: ") + e.what());
  }
  if (!json.is_object() || !json.contains("shapes") || !json["shapes"].is_array())
    file.refuse("no list \"shapes\" in it");
  GivenSizes all;
  std::size_t number = 0;
  for (const Json& value : json["shapes"]) {
    const std::string place = fmt::format("{}, shape {}", file.path().string(), ++number);
    try {
      append(shape_in(value), place, all);
    } catch (const InputError& e) {
      throw InputError(place + ": " + e.what());
    }
    if (all.shapes.size() > kMostShapes)
      throw InputError(fmt::format("{}: more than {} shapes: leave some out", place, kMostShapes));
  }
  return all;
}

}  // namespace

GivenSizes read_size_file(const std::filesystem::path& path) {
  InputFile file(path);
  const std::string_view start = file.peek(256);
  const std::size_t first = start.find_first_not_of(" \t\r\n");
  const bool is_json = first != start.npos && start[first] == '{';
  GivenSizes all = is_json ? read_json(file) : read_text(file);
  if (all.shapes.empty() && all.sheets.empty() && all.bodies.empty())
    file.refuse(
        "no shape in it: give one a line, such as 'ball 0.1 0 0 0 2' (size, center, radius)");
  return all;
}

}  // namespace locvol
