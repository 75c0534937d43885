// The formats that a mesh is written in, and how much each can hold.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/formats/output_options.h"
#include "engine/shared/input_error.h"

namespace locvol {

class MeshSource;
class PartialFile;
struct MeshSizes;

// All that is known of a format; one row of a table. A function that is null: nothing.
struct FormatInfo {
  MeshFormat format;
  std::string_view name;                     // as --format takes it
  std::vector<std::string_view> extensions;  // that mean this format; may be none
  std::string_view description;
  bool has_cell_data = false;
  bool is_surface = false;    // holds the boundary alone
  bool has_boundary = false;  // always, alone or with the cells; others have it on request
  bool has_second_order() const { return !is_surface; }
  bool holds_triangles_alone = true;  // as elements of their own, without cells
  // Some of it has no known place in a file that several processes write: see AppendedFile.
  bool waits_for_its_place = false;
  struct Limit {
    std::string_view what;
    std::uint64_t count = 0, most = 0;
  };
  std::vector<Limit> (*limits)(const MeshCounts& n) = nullptr;
  // On average, without a head.
  double (*bytes)(const MeshSizes& n, const OutputOptions& output) = nullptr;
  // `files`: those of files_of(). Returns the bytes of all.
  std::uint64_t (*write)(MeshSource& mesh, const OutputOptions& output,
                         std::span<PartialFile* const> files) = nullptr;
};

std::span<const FormatInfo> mesh_formats();
const FormatInfo& info_of(MeshFormat format);
// The format that a file's name asks for by its extension, whatever its case.
std::optional<MeshFormat> format_of(const std::filesystem::path& file);
std::optional<MeshFormat> format_named(std::string_view name);
// Gives what format_of() gives; throws InputError, which lists the extensions, if that is none.
MeshFormat format_meant_by(const std::filesystem::path& file);

bool holds_boundary(const OutputOptions& output);

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

// Throws InputError if the format has no cells of the order; the message names those that have.
void require_order(const OutputOptions& output);
// Likewise if cells are to have measures, and the format has no data of cells.
void require_cell_data(const OutputOptions& output);

// Of a run of the surface alone: what is to be written, with the boundary where the format has it
// on request. Throws InputError if the format, or what is asked of it, has no sense without cells.
OutputOptions of_surface(OutputOptions output);

// The files that an output is made of: TetGen's are two, or three.
std::vector<std::filesystem::path> files_of(const OutputOptions& options,
                                            const std::filesystem::path& output);

}  // namespace locvol
