// What the user types, made into values. A value that cannot be meant throws std::invalid_argument
// with a message that says what can: a usage error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "engine/engine.h"
#include "engine/formats/mesh_format.h"
#include "engine/plan/option_table.h"
#include "octree/geometry.h"
#include "octree/morton_key.h"

namespace locvol {

// "0.01", a length; "2%", of the smallest side of the bounding box. Positive and finite.
Size parse_size(const std::string& text);
// "auto": nothing; "0"; or a size as above.
std::optional<Size> parse_weld(const std::string& text);
// In the option's range.
double parse_number(const std::string& text, const OptionText& option);
// "50000", "50k", "1.5M", "2G" (powers of 1000). A whole number, at least 1 and below 2^53.
std::uint64_t parse_count(const std::string& text);
// "512M", "2G", "1.5GiB" (K, M, G and T are powers of 1024), or "25%" of the memory that is free.
// In bytes.
std::uint64_t parse_memory(const std::string& text);
// A whole number from 1 to 1024.
int parse_threads(const std::string& text);
// A whole number from 0 to 2^64 - 1.
std::uint64_t parse_seed(const std::string& text);
Initialization parse_init(const std::string& text);  // "cover" or "paper"
InsideRule parse_inside(const std::string& text);    // "closed", "winding" or "wrap"
std::string parse_shape(const std::string& text);    // a name from shapes(), or kPolycrystal
// Morton bits in hexadecimal, as key_text() prints them; "0x" may precede.
MortonKey parse_key(const std::string& text);
std::string key_text(MortonKey key);
// A leaf by its key, or by a point in it: "x,y,z", or as point_text() prints it.
using LeafSpec = std::variant<MortonKey, Point>;
LeafSpec parse_leaf(const std::string& text);

// `text` as a path, if its extension is one of `extensions` (".vtu").
std::filesystem::path parse_output(const std::string& text,
                                   const std::vector<std::string_view>& extensions);

// `text` as a path, if it is not empty.
std::filesystem::path parse_directory(const std::string& text);

// The format with this name, such as "msh2".
MeshFormat parse_format(const std::string& text);
// "leaf" or "quality": whether the quality is cell data, too.
bool parse_cell_data(const std::string& text);

// Throws std::runtime_error unless a file could be made under this name: asked before hours of
// work, so that they end in a file.
void require_writable(const std::filesystem::path& output);

}  // namespace locvol
