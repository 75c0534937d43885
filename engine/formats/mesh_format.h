// The formats that a mesh is written in, and how much each can hold.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/shared/input_error.h"

namespace locvol {

enum class MeshFormat {
  kVtu,
  kVtuZlib,
  kVtkHdf,
  kMsh4,
  kMsh2,
  kMedit,
  kMeditBinary,
  kAbaqus,
  kTetgen,
  kStl,
  kStlText,
  kPly,
  kObj,
};

class MeshSource;
class PartialFile;
struct MeshSizes;

// What a mesh has of all that a format numbers.
struct MeshCounts {
  std::uint64_t num_vertices = 0, num_cells = 0;
  std::uint64_t num_boundary_facets = 0, num_boundary_vertices = 0;
};

// All that is known of a format; one row of a table. A function that is null: nothing.
struct FormatInfo {
  MeshFormat format;
  std::string_view name;                     // as --format takes it
  std::vector<std::string_view> extensions;  // that mean this format; may be none
  std::string_view description;
  bool has_cell_data = false;
  bool is_surface = false;    // holds the boundary alone
  bool has_boundary = false;  // alone or with the cells
  // Some of it has no known place in a file that several processes write: see AppendedFile.
  bool waits_for_its_place = false;
  struct Limit {
    std::string_view what;
    std::uint64_t count = 0, most = 0;
  };
  std::vector<Limit> (*limits)(const MeshCounts& n) = nullptr;
  // On average, without a head.
  double (*bytes)(const MeshSizes& n, bool has_quality) = nullptr;
  // `second`: of formats with two files. Returns the bytes of all.
  std::uint64_t (*write)(MeshSource& mesh, bool has_quality, PartialFile& file,
                         PartialFile* second) = nullptr;
};

std::span<const FormatInfo> mesh_formats();
const FormatInfo& info_of(MeshFormat format);
// The format that a file's name asks for by its extension, whatever its case.
std::optional<MeshFormat> format_of(const std::filesystem::path& file);
std::optional<MeshFormat> format_named(std::string_view name);
// Gives what format_of() gives; throws InputError, which lists the extensions, if that is none.
MeshFormat format_meant_by(const std::filesystem::path& file);

// What is written of a mesh.
struct OutputOptions {
  MeshFormat format = MeshFormat::kVtu;
  bool has_quality = false;  // as cell data, where the format has any
  bool is_by_ranks = false;  // several processes write one file
};

// The mesh has more of something than the format can number. The message says what, and names
// formats that hold it.
class FormatLimit : public InputError {
 public:
  using InputError::InputError;
};
// Throws FormatLimit. What is not known yet is 0. For the message: `file`, and `counted`, as in
// "there are 3000000000".
void check_limits(MeshFormat format, const MeshCounts& counts, const std::filesystem::path& file,
                  std::string_view counted = "there are");

// The files that an output is made of: TetGen's are two.
std::vector<std::filesystem::path> files_of(MeshFormat format, const std::filesystem::path& output);

}  // namespace locvol
