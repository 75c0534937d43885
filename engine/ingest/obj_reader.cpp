#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "engine/ingest/surface_formats.h"
#include "engine/ingest/text_scanner.h"

namespace locvol {
namespace {

// Lines that say nothing about the shape; those that hold names end with the line, though it may
// end with a backslash. Of the names, those of groups, objects and materials are told.
constexpr std::array<std::string_view, 9> kIgnored = {"vn", "vt",    "vp",       "s",       "l",
                                                      "p",  "bevel", "c_interp", "d_interp"};
constexpr std::array<std::string_view, 12> kNames = {"g",          "o",         "mtllib", "usemtl",
                                                     "shadow_obj", "trace_obj", "usemap", "maplib",
                                                     "call",       "csh",       "mg",     "lod"};
// Curves and curved surfaces.
constexpr std::array<std::string_view, 14> kFreeForm = {"cstype", "deg",  "bmat", "step", "curv",
                                                        "curv2",  "surf", "parm", "trim", "hole",
                                                        "scrv",   "sp",   "end",  "con"};

template <std::size_t N>
bool is_among(std::string_view word, const std::array<std::string_view, N>& words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

class ObjParser {
 public:
  ObjParser(InputFile& file, SurfaceSink& sink) : file_(file), sink_(sink), scanner_(file, '#') {}

  void run() {
    while (scanner_.next_line()) {
      if (take(scanner_.word())) skip_continued_line();
      scanner_.skip_line();
    }
    if (num_unknown_ > 0)
      sink_.note(fmt::format("left out {} whose first word OBJ does not know, as {}",
                             num_unknown_ == 1 ? "a line" : fmt::format("{} lines", num_unknown_),
                             first_unknown_));
  }

 private:
  // False: the line is no longer than it seems.
  bool take(std::string_view word) {
    if (word == "v")
      take_vertex();
    else if (word == "f" || word == "fo")
      take_face();
    else if (!is_among(word, kIgnored))
      return take_other(word);
    return true;
  }

  // Also words that programs have added, such as those of materials: in lines by themselves.
  bool take_other(std::string_view word) {
    if (is_among(word, kNames)) {
      take_name(word);
      return false;
    }
    if (is_among(word, kFreeForm))
      file_.refuse_line("has free-form curves or surfaces; export it as polygons");
    const auto is_letter = [](char c) {
      return ('a' <= (c | 0x20) && (c | 0x20) <= 'z') || c == '_';
    };
    if (!std::all_of(word.begin(), word.end(), is_letter))
      file_.refuse_line("is no line of an OBJ file; the file is damaged");
    if (num_unknown_++ == 0)
      first_unknown_ = fmt::format("\"{}\" in line {}", shown(word), file_.line_number());
    return false;
  }

  // A face is of the group that it stands in (g); of its object (o), if that has no groups; and
  // else of its material (usemtl). A group ends where the next object begins. "default" is what
  // programs call the group of what is in none.
  void take_name(std::string_view word) {
    const std::string_view name = trimmed(scanner_.rest());
    if (word == "g") {
      group_ = name == "default" ? "" : name;
    } else if (word == "o") {
      object_ = name;
      group_.clear();
    } else if (word == "usemtl") {
      material_ = name;
    }
    sink_.group(!group_.empty() ? group_ : !object_.empty() ? object_ : material_);
  }

  void skip_continued_line() {
    while (is_continued_ || scanner_.rest().ends_with('\\')) {
      is_continued_ = false;
      if (!scanner_.next_line()) return;
    }
  }

  void take_vertex() {
    const double x = coordinate(), y = coordinate(), z = coordinate();
    sink_.vertex({x, y, z});
    ++num_vertices_;
  }

  void take_face() {
    const FilePlace place{FilePlace::Unit::kLine, file_.line_number()};
    corners_.clear();
    for (auto word = next_word(); !word.empty(); word = next_word())
      corners_.push_back(vertex_named(word.substr(0, word.find('/'))));
    sink_.polygon(corners_, place);
  }

  double coordinate() {
    const std::string_view word = next_word();
    if (word.empty()) file_.refuse_line("a coordinate is missing; the file is damaged or cut off");
    return scanner_.coordinate(word);
  }

  // Empty at the end of the line. A backslash at its end continues it on the next one.
  std::string_view next_word() {
    std::string_view word;
    do {
      if (is_continued_ && !scanner_.next_line()) file_.refuse_truncated();
      word = scanner_.word();
      is_continued_ = word.ends_with('\\');
      if (is_continued_) word.remove_suffix(1);
    } while (is_continued_ && word.empty());
    return word;
  }

  // Vertices count from 1; negative numbers count back from the last one so far.
  std::uint64_t vertex_named(std::string_view word) const {
    const std::int64_t number = scanner_.integer(word, "number of a vertex");
    const auto num_vertices = static_cast<std::int64_t>(num_vertices_);
    if (number == 0 || number < -num_vertices)
      file_.refuse_line(fmt::format("there is no vertex {}; the file is damaged", number));
    return static_cast<std::uint64_t>(number > 0 ? number - 1 : num_vertices + number);
  }

  InputFile& file_;
  SurfaceSink& sink_;
  TextScanner scanner_;
  std::uint64_t num_vertices_ = 0;
  std::string group_, object_, material_;
  bool is_continued_ = false;  // the line ended in a backslash
  std::uint64_t num_unknown_ = 0;
  std::string first_unknown_;
  std::vector<std::uint64_t> corners_;
};

}  // namespace

bool is_obj_keyword(std::string_view word) {
  return word == "v" || word == "f" || word == "fo" || is_among(word, kIgnored) ||
         is_among(word, kNames) || is_among(word, kFreeForm);
}

void parse_obj(InputFile& file, SurfaceSink& sink) { ObjParser(file, sink).run(); }

}  // namespace locvol
