#include "tools/python/python_options.h"

#include <fmt/format.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "engine/locvol.h"
#include "engine/plan/option_table.h"
#include "engine/shared/closest_word.h"
#include "tools/arguments.h"

namespace locvol {
namespace py = pybind11;
namespace {

std::string text_of(const py::handle& value) { return py::repr(value); }

[[noreturn]] void refuse(std::string_view key, const py::handle& value, std::string_view what) {
  throw py::type_error(fmt::format("{}: give {}, not {}", key, what, text_of(value)));
}

// The value that a text means.
template <class Parse>
auto parsed(std::string_view key, const std::string& text, const Parse& parse) {
  try {
    return parse(text);
  } catch (const std::invalid_argument& error) {
    throw Error(ErrorCode::kInput, fmt::format("{} '{}': {}", key, text, error.what()));
  }
}

// A cast that says which option it is of. bool is no number here, though Python takes it for one.
template <class T>
T cast(std::string_view key, const py::handle& value, std::string_view what) {
  if (py::isinstance<py::bool_>(value)) refuse(key, value, what);
  try {
    return value.cast<T>();
  } catch (const py::cast_error&) {
    refuse(key, value, what);
  }
}

Size size_of(std::string_view key, const py::handle& value) {
  if (py::isinstance<py::str>(value)) return parsed(key, value.cast<std::string>(), parse_size);
  return Size::length(
      cast<double>(key, value, "a length in the units of the surface, or a percentage like '2%'"));
}

void take(std::string_view key, const py::handle& value, Size& size) { size = size_of(key, value); }

// Of lengths, the weld may be absent or 0.
void take(std::string_view key, const py::handle& value, std::optional<Size>& size) {
  size = py::isinstance<py::str>(value) ? parsed(key, value.cast<std::string>(), parse_weld)
                                        : size_of(key, value);
}

void take(std::string_view key, const py::handle& value, double& number) {
  number = cast<double>(key, value, "a number");
}

void take(std::string_view key, const py::handle& value, std::optional<double>& number) {
  number = cast<double>(key, value, "a number");
}

void take(std::string_view key, const py::handle& value, std::uint64_t& number) {
  number = cast<std::uint64_t>(key, value, "a whole number, 0 or more");
}

void take(std::string_view key, const py::handle& value, bool& is) {
  if (!py::isinstance<py::bool_>(value)) refuse(key, value, "True or False");
  is = value.cast<bool>();
}

void take(std::string_view key, const py::handle& value, Initialization& init) {
  init = parsed(key, cast<std::string>(key, value, "'cover' or 'paper'"), parse_init);
}

void take(std::string_view key, const py::handle& value, InsideRule& inside) {
  inside =
      parsed(key, cast<std::string>(key, value, "'closed', 'winding' or 'wrap'"), parse_inside);
}

void take(std::string_view key, const py::handle& value, std::filesystem::path& file) {
  file = cast<std::filesystem::path>(key, value, "the name of a file");
}

void take(std::string_view key, const py::handle& value, std::vector<std::string>& names) {
  constexpr std::string_view kWhat = "a list of names";
  if (py::isinstance<py::str>(value)) refuse(key, value, kWhat);
  names = cast<std::vector<std::string>>(key, value, kWhat);
}

// From names to sizes.
void take(std::string_view key, const py::handle& value, std::vector<SizedPart>& parts) {
  constexpr std::string_view kWhat = "a dict from names to sizes";
  if (!py::isinstance<py::dict>(value)) refuse(key, value, kWhat);
  for (const auto& [name, size] : value.cast<py::dict>())
    parts.push_back(
        {.name = cast<std::string>(key, name, kWhat), .size = size_of(key, size), .place = {}});
}

// Of locvol.Ball, locvol.Box and locvol.Segment.
void take(std::string_view key, const py::handle& value, std::vector<SizedShape>& shapes) {
  constexpr std::string_view kWhat = "a list of Ball, Box and Segment";
  for (const py::handle shape : cast<py::list>(key, value, kWhat)) {
    const auto has = [&](const char* name) { return py::hasattr(shape, name); };
    const auto place = [&](const char* name) {
      return cast<Coordinates>(key, shape.attr(name), "three coordinates");
    };
    if (!has("size")) refuse(key, shape, kWhat);
    const Size size = size_of(key, shape.attr("size"));
    if (has("center") && has("radius"))
      shapes.push_back(SizedShape::ball(size, place("center"),
                                        cast<double>(key, shape.attr("radius"), "a radius")));
    else if (has("a") && has("b") && py::hasattr(shape, "is_box"))
      shapes.push_back(shape.attr("is_box").cast<bool>()
                           ? SizedShape::box(size, place("a"), place("b"))
                           : SizedShape::segment(size, place("a"), place("b")));
    else
      refuse(key, shape, kWhat);
  }
}

// JSON has the number of shapes.
std::string key_of(const OptionText& option) {
  const std::string key = option.name.key;
  return key == "num_shapes" ? "shapes" : key;
}

}  // namespace

Size size_given(const py::handle& given) { return size_of("size", given); }

void set_options(const py::dict& given, Options& options) {
  for (const auto& [name, value] : given) {
    const auto key = name.cast<std::string>();
    std::vector<std::string> known;
    bool is_known = false;
    for_each_given_option([&](const auto& option) {
      known.push_back(key_of(option));
      if (known.back() != key) return;
      is_known = true;
      if (!value.is_none()) take(key, value, options.*option.given);
    });
    if (is_known) continue;
    const std::string meant = closest_word(key, known);
    throw py::type_error(fmt::format("there is no option '{}'{}", key,
                                     meant.empty() ? "" : fmt::format("; is '{}' meant?", meant)));
  }
}

py::list option_rows() {
  py::list rows;
  for_each_given_option([&](const auto& option) {
    rows.append(py::dict(py::arg("name") = key_of(option), py::arg("typed") = option.name.typed,
                         py::arg("help") = filled(option.help.text, option)));
  });
  return rows;
}

}  // namespace locvol
