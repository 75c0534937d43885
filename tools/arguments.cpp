#include "tools/arguments.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <optional>
#include <ranges>
#include <stdexcept>
#include <system_error>

#include "engine/shared/memory_budget.h"
#include "tools/generate.h"

namespace locvol {
namespace {

// All of `text` as a number, or nothing.
template <typename Number, typename... Format>
std::optional<Number> number_in(std::string_view text, Format... format) {
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value, format...);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

// Takes the suffix off `text` and returns its factor.
double take_factor(std::string_view& text) {
  const char suffix = text.empty() ? '\0' : text.back();
  const double factor = suffix == 'k' || suffix == 'K' ? 1e3
                        : suffix == 'M'                ? 1e6
                        : suffix == 'G'                ? 1e9
                                                       : 1;
  if (factor > 1) text.remove_suffix(1);
  return factor;
}

}  // namespace

Size parse_size(const std::string& text) {
  const bool is_percent = text.ends_with('%');
  const auto value = number_in<double>(std::string_view(text).substr(0, text.size() - is_percent));
  if (!value || !std::isfinite(*value) || *value <= 0) {
    throw std::invalid_argument(fmt::format(
        "'{}' is no size: give a positive length (0.01) or a percentage of the smallest side of "
        "the bounding box (2%)",
        text));
  }
  return {*value, is_percent};
}

std::optional<Size> parse_weld(const std::string& text) try {
  if (text == "auto") return std::nullopt;
  if (text == "0") return Size{};
  return parse_size(text);
} catch (const std::invalid_argument&) {
  throw std::invalid_argument(fmt::format(
      "'{}' is no distance: give auto, 0, a positive length (1e-6) or a percentage of the smallest "
      "side of the bounding box (0.01%)",
      text));
}

double parse_number(const std::string& text, const OptionText& option) {
  const auto value = number_in<double>(text);
  if (!value || !(*value >= option.range.least && *value <= option.range.most))
    throw std::invalid_argument(
        fmt::format("'{}' is no {}: {}", text, option.noun, filled(option.cure, option)));
  return *value;
}

std::uint64_t parse_count(const std::string& text) {
  std::string_view digits = text;
  const double factor = take_factor(digits);
  const auto number = number_in<double>(digits);
  const double value = number.value_or(0) * factor;
  if (!(value >= 1) || value >= 0x1p53 || value != std::floor(value)) {
    throw std::invalid_argument(
        fmt::format("'{}' is no count: give a whole number, at least 1 (50000, 50k, 1.5M)", text));
  }
  return static_cast<std::uint64_t>(value);
}

std::uint64_t parse_memory(const std::string& text) {
  std::string_view digits = text;
  double factor = 1;
  if (digits.ends_with('%')) {
    digits.remove_suffix(1);
    factor = static_cast<double>(free_memory()) / 100;
  } else {
    if (digits.ends_with("iB")) digits.remove_suffix(2);
    constexpr std::string_view kUnits = "KMGT";
    const char unit = digits.empty() ? '\0' : digits.back();
    const std::size_t power = kUnits.find(unit == 'k' ? 'K' : unit);
    if (power != kUnits.npos) {
      digits.remove_suffix(1);
      factor = std::pow(1024.0, static_cast<double>(power + 1));
    } else if (digits.size() != text.size()) {
      digits = {};  // "iB" of nothing
    }
  }
  const double bytes = number_in<double>(digits).value_or(0) * factor;
  if (!(bytes >= 1) || bytes >= 0x1p53 || (text.ends_with('%') && bytes > 100 * factor)) {
    throw std::invalid_argument(fmt::format(
        "'{}' is no amount of memory: give one such as 512M or 2G, or a percentage of what is free "
        "(25%)",
        text));
  }
  return static_cast<std::uint64_t>(bytes);
}

int parse_threads(const std::string& text) {
  constexpr int kMost = 1024;
  const auto value = number_in<int>(text);
  if (!value || *value < 1 || *value > kMost) {
    throw std::invalid_argument(
        fmt::format("'{}' is no number of threads: give a whole number from 1 to {}", text, kMost));
  }
  return *value;
}

std::uint64_t parse_seed(const std::string& text) {
  const auto value = number_in<std::uint64_t>(text);
  if (!value) {
    throw std::invalid_argument(
        fmt::format("'{}' is no seed: give a whole number from 0 to 2^64 - 1", text));
  }
  return *value;
}

Initialization parse_init(const std::string& text) {
  for (const Initialization init : {Initialization::kCover, Initialization::kPaper})
    if (init_name(init) == text) return init;
  throw std::invalid_argument(
      fmt::format("'{}' is no initialization: give {}", text, fmt::join(kInitNames, " or ")));
}

InsideRule parse_inside(const std::string& text) {
  for (const InsideRule inside : {InsideRule::kClosed, InsideRule::kWinding, InsideRule::kWrap})
    if (inside_name(inside) == text) return inside;
  throw std::invalid_argument(fmt::format("'{}' does not tell what is inside: give {}", text,
                                          fmt::join(kInsideNames, ", ")));
}

std::string parse_shape(const std::string& text) {
  if (text != kPolycrystal &&
      std::ranges::find(shapes(), text, &ShapeInfo::name) == shapes().end()) {
    throw std::invalid_argument(
        fmt::format("'{}' is no shape: `locvol generate --help` lists all", text));
  }
  return text;
}

MortonKey parse_key(const std::string& text) {
  std::string_view digits = text;
  if (digits.starts_with("0x")) digits.remove_prefix(2);
  const auto bits = number_in<std::uint64_t>(digits, 16);
  if (!bits || !MortonKey::from_bits(*bits).is_valid()) {
    throw std::invalid_argument(
        fmt::format("'{}' is no leaf key: give one as `locvol inspect DIR --leaves` prints it, "
                    "such as {}",
                    text, key_text(MortonKey::root())));
  }
  return MortonKey::from_bits(*bits);
}

LeafSpec parse_leaf(const std::string& text) {
  if (text.find(',') == std::string::npos) return parse_key(text);
  std::string numbers = text;
  std::erase_if(numbers, [](char c) { return c == ' ' || c == '(' || c == ')'; });
  Point point;
  std::string_view rest = numbers;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t end = axis < 2 ? rest.find(',') : rest.size();
    const auto value = number_in<double>(rest.substr(0, end));
    if (end == std::string_view::npos || !value || !std::isfinite(*value)) {
      throw std::invalid_argument(
          fmt::format("'{}' is no point: give three numbers, x,y,z, or a leaf's key", text));
    }
    point[axis] = *value;
    if (axis < 2) rest.remove_prefix(end + 1);
  }
  return point;
}

std::string key_text(MortonKey key) { return fmt::format("{:016x}", key.bits()); }

std::filesystem::path parse_output(const std::string& text,
                                   const std::vector<std::string_view>& extensions) {
  std::filesystem::path path(text);
  if (std::ranges::find(extensions, path.extension().string()) == extensions.end()) {
    throw std::invalid_argument(fmt::format("'{}' names no known format: it must end in {}", text,
                                            fmt::join(extensions, " or ")));
  }
  return path;
}

std::filesystem::path parse_directory(const std::string& text) {
  if (text.empty()) throw std::invalid_argument("is empty: give the name of a directory");
  return text;
}

MeshFormat parse_format(const std::string& text) {
  if (const auto format = format_named(text)) return *format;
  const auto names = std::views::transform(mesh_formats(), &FormatInfo::name);
  throw std::invalid_argument(
      fmt::format("'{}' is no format: give {}", text, fmt::join(names.begin(), names.end(), ", ")));
}

bool parse_cell_data(const std::string& text) {
  if (text == "leaf" || text == "quality") return text == "quality";
  throw std::invalid_argument(fmt::format("'{}' is no cell data: give leaf or quality", text));
}

void require_writable(const std::filesystem::path& output) {
  const auto folder = output.has_parent_path() ? output.parent_path() : std::filesystem::path(".");
  if (!std::filesystem::is_directory(folder)) {
    throw std::runtime_error(
        fmt::format("cannot write {}: there is no directory {}", output.string(), folder.string()));
  }
  if (std::filesystem::is_directory(output)) {
    throw std::runtime_error(fmt::format("cannot write {}: it is a directory", output.string()));
  }
  if (access(folder.c_str(), W_OK | X_OK) != 0) {
    throw std::runtime_error(
        fmt::format("cannot write {}: {}", output.string(),
                    std::error_code(errno, std::generic_category()).message()));
  }
}

}  // namespace locvol
