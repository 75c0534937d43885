// The options that a mesh depends on, a row each. From the rows follow what the command line takes
// and its help says (and with that the manual page and completions), what is refused as out of
// range, what a run's record keeps, how records are compared, and what is printed of them, as text
// and as JSON. A new option is a member of Options, one of RunParameters with its bytes
// (storage/codec.cpp), and a row: a member without a row does not compile.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "engine/plan/options.h"
#include "storage/records.h"

namespace locvol {

enum class OptionGroup {
  kSizes,    // how large cells are: for all who mesh or estimate
  kSurface,  // what the surface is taken for: likewise
  kRun       // for who meshes alone
};

// In texts, {least}, {most} and {standard} stand for these values: see filled().
struct OptionText {
  struct Name {
    const char* typed;  // on the command line; the refusal of a store calls it so, too
    const char* key;    // in JSON
  };
  struct Help {
    const char* value = "";  // what it calls the value
    const char* text = "";   // empty: commands declare the option themselves, or nobody can give it
  };
  struct Range {
    double least = 0, most = std::numeric_limits<double>::infinity();
  };
  Name name;
  OptionGroup group = OptionGroup::kRun;
  Help help = {};
  // "growth 2: give a number from 0 to 0.3": what a message calls the value, and the cure.
  const char* noun = "";
  Range range = {};
  const char* cure = "give a number from {least} to {most}";
  double standard = 0;       // what stands for a number that is not given
  bool is_required = false;  // of other lengths, 0 stands for none
  // What people are told of a number in the record that is not what it is there by default; empty:
  // whoever tells it has words of its own.
  const char* phrase = "";
};

// `Given`: the member of MeshOptions; nullptr: nobody can give it. `Kept`: the member of
// RunParameters. A length is given as the user has it, and kept in the units of the coordinates.
template <auto Given, auto Kept>
struct Option : OptionText {
  static constexpr auto given = Given;
  static constexpr auto kept = Kept;
};

// In the order in which they are compared and printed.
inline constexpr std::tuple kOptions{
    Option<&MeshOptions::size, &RunParameters::size>{
        {.name = {"--size", "size"}, .noun = "size", .is_required = true}},
    Option<&MeshOptions::leaf_capacity, &RunParameters::leaf_capacity>{
        {.name = {"--leaf-capacity", "leaf_capacity"},
         .help = {"K", "Split a leaf with more points than this"},
         .range = {.least = 1}}},
    Option<&MeshOptions::init, &RunParameters::init>{
        {.name = {"--init", "init"},
         .help = {"cover|paper",
                  "First points: cover the domain, or few as in the paper (default: cover)"}}},
    Option<&MeshOptions::seed, &RunParameters::seed>{
        {.name = {"--seed", "seed"}, .help = {"N", "Seed of the surface sample (default: 0)"}}},
    Option<nullptr, &RunParameters::radius_edge_bound>{
        {.name = {"the radius-edge bound", "radius_edge_bound"}}},
    Option<&MeshOptions::min_dihedral, &RunParameters::min_dihedral>{
        {.name = {"--min-dihedral", "min_dihedral"},
         .help = {"DEG",
                  "Leave no cell with a dihedral angle below this, in degrees; 0: any (default: "
                  "{standard}; with --init paper 0)"},
         .noun = "smallest dihedral angle",
         .range = {.most = 40},
         .cure = "give degrees from {least}, which asks for none, to {most}; 15 to 25 can be had",
         .standard = kDefaultMinDihedral}},
    Option<&MeshOptions::spacing_floor, &RunParameters::spacing_floor>{
        {.name = {"--spacing-floor", "spacing_floor"},
         .help = {"F",
                  "Insert no point closer than this to another, as a fraction of λ (default: "
                  "{standard})"},
         .noun = "spacing floor",
         .range = {std::numeric_limits<double>::min(), 0.5},  // without one, no run need end
         .cure = "give a fraction of the size above 0, up to {most}",
         .standard = 0.02}},
    Option<&MeshOptions::growth, &RunParameters::growth>{
        {.name = {"--growth", "growth"},
         .group = OptionGroup::kSizes,
         .help = {"G",
                  "Cells grow from the surface inwards, by so much of the way: 0 (the default: one "
                  "size) to {most}"},
         .noun = "growth",
         .range = {.most = 0.3},  // above it, the octree of sizes need not be balanced
         .cure = "give a number from {least}, which asks for one size everywhere, to {most}",
         .phrase = "; λ grows by {} of the way from the surface"}},
    Option<&MeshOptions::max_size, &RunParameters::max_size>{
        {.name = {"--max-size", "max_size"},
         .group = OptionGroup::kSizes,
         .help = {"SIZE", "What cells do not grow beyond, as --size"},
         .noun = "largest size",
         .phrase = ", to {}"}},
    // These four are one option, which the commands declare: files.
    Option<&MeshOptions::shapes, &RunParameters::shapes>{{.name = {"--sizes", "num_shapes"}}},
    Option<&MeshOptions::sheets, &RunParameters::sheet_sizes>{
        {.name = {"--sizes", "sheet_sizes"}, .noun = "sheet"}},
    Option<&MeshOptions::bodies, &RunParameters::body_sizes>{
        {.name = {"--sizes", "body_sizes"}, .noun = "body"}},
    Option<&MeshOptions::size_image, &RunParameters::size_image>{
        {.name = {"--sizes", "size_image"}, .noun = "image"}},
    Option<&MeshOptions::per_circle, &RunParameters::per_circle>{
        {.name = {"--per-circle", "per_circle"},
         .group = OptionGroup::kSizes,
         .help = {"N", "Smaller cells where the surface is curved: so many edges around a circle"},
         .noun = "number of edges per circle",
         .range = {3, 1000},
         .phrase = "; {} edges around circles"}},
    Option<&MeshOptions::deviation, &RunParameters::deviation>{
        {.name = {"--deviation", "deviation"},
         .group = OptionGroup::kSizes,
         .help = {"LENGTH",
                  "Smaller cells where the boundary would be farther from the surface, as --size"},
         .noun = "deviation",
         .phrase = "; boundary within {} of the surface"}},
    Option<&MeshOptions::layers, &RunParameters::layers>{
        {.name = {"--layers", "layers"},
         .group = OptionGroup::kSizes,
         .help = {"K", "Smaller cells where a part is thin: so many across it"},
         .noun = "number of layers",
         .range = {1, 20},
         .phrase = "; {} layers across thin parts"}},
    Option<&MeshOptions::min_size, &RunParameters::min_size>{
        {.name = {"--min-size", "min_size"},
         .group = OptionGroup::kSizes,
         .help = {"SIZE", "What these three do not go below, as --size (default: {standard} λ)"},
         .noun = "smallest size",
         .standard = kDefaultLeast,
         .phrase = "; no smaller than {}"}},
    Option<&MeshOptions::weld, &RunParameters::weld>{
        {.name = {"--weld", "weld"},
         .group = OptionGroup::kSurface,
         .help = {"LENGTH",
                  "Join points of the surface that lie closer to each other than this, a length or "
                  "a percentage as --size; 0: none (default: auto, those that close a surface "
                  "which is not closed otherwise)"}}},
    Option<&MeshOptions::sharp_angle, &RunParameters::sharp_angle>{
        {.name = {"--sharp-angle", "sharp_angle"},
         .group = OptionGroup::kSurface,
         .help =
             {"DEG",
              "Edges where the surface turns by more degrees are kept as edges of the mesh, and "
              "part its sheets; 0: none are, and sheets end only where names do that the file "
              "gives them (default: {standard})"},
         .noun = "sharp angle",
         .range = {.most = 179},
         .cure = "give degrees from {least}, at which nothing is sharp, to {most}",
         .standard = 40,
         .phrase = "; it is sharp where it turns by more than {}°"}},
    // A file, too.
    Option<&MeshOptions::sharp_polylines, &RunParameters::sharp_polylines>{
        {.name = {"--sharp", "sharp"}, .noun = "file of polylines"}},
    // These two are declared by the commands: a flag, and names.
    Option<&MeshOptions::has_bodies, &RunParameters::has_bodies>{
        {.name = {"--bodies", "has_bodies"}, .group = OptionGroup::kSurface}},
    Option<&MeshOptions::voids, &RunParameters::voids>{
        {.name = {"--void", "voids"}, .group = OptionGroup::kSurface}},
    Option<&MeshOptions::gap, &RunParameters::gap>{
        {.name = {"--gap", "gap"},
         .group = OptionGroup::kSurface,
         .help = {"LENGTH",
                  "Bodies that are nearer to each other than this are made to touch: a length or a "
                  "percentage, as --size (default: only what rounding parts)"},
         .noun = "gap",
         .phrase = "; bodies nearer than {} touch"}},
    // Likewise.
    Option<&MeshOptions::is_surface_only, &RunParameters::is_surface_only>{
        {.name = {"--surface-only", "surface_only"}, .group = OptionGroup::kSizes}},
    Option<&MeshOptions::inside, &RunParameters::inside>{
        {.name = {"--inside", "inside"},
         .group = OptionGroup::kSurface,
         .help = {"closed|winding|wrap",
                  "Inside is what a closed surface encloses; or what triangles of any kind wind "
                  "around by more than half, so that holes close, what overlaps is united, and "
                  "doubled and inner walls vanish; or what a new surface encloses that wraps all "
                  "triangles (default: closed)"}}},
    Option<&MeshOptions::wrap_alpha, &RunParameters::wrap_alpha>{
        {.name = {"--wrap-alpha", "wrap_alpha"},
         .group = OptionGroup::kSurface,
         .help = {"LENGTH",
                  "With --inside wrap: bridge what a ball of this radius does not go through "
                  "(default: a 50th of the longest side)"},
         .noun = "wrap alpha"}},
    Option<&MeshOptions::wrap_offset, &RunParameters::wrap_offset>{
        {.name = {"--wrap-offset", "wrap_offset"},
         .group = OptionGroup::kSurface,
         .help = {"LENGTH",
                  "With --inside wrap: how far the new surface is from the triangles (default: a "
                  "30th of alpha)"},
         .noun = "wrap offset"}}};

// Calls visit(option) for each row, in order.
template <class Visit>
void for_each_option(const Visit& visit) {
  std::apply([&](const auto&... options) { (visit(options), ...); }, kOptions);
}

// The same for each that can be given.
template <class Visit>
void for_each_given_option(const Visit& visit) {
  for_each_option([&](const auto& option) {
    if constexpr (!std::is_same_v<decltype(option.given), const std::nullptr_t>) visit(option);
  });
}

// The text, one of the option's, with its values in their places.
std::string filled(const char* text, const OptionText& option);

// What can be typed for --init, by Initialization.
inline constexpr std::array<std::string_view, 2> kInitNames = {"cover", "paper"};
inline std::string_view init_name(Initialization init) {
  return kInitNames[static_cast<std::size_t>(init)];
}

// What can be typed for --inside, by InsideRule.
inline constexpr std::array<std::string_view, 3> kInsideNames = {"closed", "winding", "wrap"};
inline std::string_view inside_name(InsideRule inside) {
  return kInsideNames[static_cast<std::size_t>(inside)];
}

}  // namespace locvol
