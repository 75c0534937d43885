// What can be typed: options that several commands share, and commands of two programs.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "engine/plan/options.h"
#include "tools/commands.h"

namespace locvol {

inline constexpr const char* kFooter =
    "Results go to stdout, progress to stderr.\n"
    "Exit codes: 0 done; 1 error (audit: not valid); 2 usage; 3 done, but with unresolved sites;\n"
    "4 interrupted, and resumable.";
inline constexpr const char* kSurfaceHelp =
    "Closed surface: STEP, IGES, BREP (by the package locvol-cad), STL, OBJ, OFF, PLY, VTK (.vtp, "
    ".vtk), Gmsh (.msh), 3MF or glTF, which gzip may have packed; -: from the standard input";
inline constexpr const char* kSizeHelp =
    "Bound λ of circumradii and surface balls: a length (0.01), or a percentage of the smallest "
    "side of the bounding box (2%)";

// An option whose text `parse` makes into a value; its std::invalid_argument is a usage error.
template <typename Parse>
CLI::Option* add_parsed(CLI::App& app, const std::string& name, Parse parse, auto& target,
                        const std::string& description) {
  const auto assign = [name, parse, &target](const std::string& text) {
    try {
      target = parse(text);
    } catch (const std::invalid_argument& error) {
      throw CLI::ValidationError(name, error.what());
    }
  };
  return app.add_option_function<std::string>(name, assign, description);
}

CLI::Option* add_output(CLI::App& app, std::filesystem::path& output,
                        std::vector<std::string_view> extensions);
CLI::Option* add_format(CLI::App& app, OutputOptions& options, const std::string& otherwise);
CLI::Option* add_cell_data(CLI::App& app, OutputOptions& options);
void check_output(const OutputOptions& options);
CLI::Option* add_boundary(CLI::App& app, OutputOptions& options);
CLI::Option* add_order(CLI::App& app, OutputOptions& options);
CLI::Option* add_split_interfaces(CLI::App& app, OutputOptions& options);
CLI::Option* add_faces(CLI::App& app, OutputOptions& options);
// The mesh's file; its format, by name or by extension; what is written besides.
// `choose`: the name of a file where none is given; null: there is no file then.
CLI::Option* add_mesh_output(CLI::App& app, std::filesystem::path& output, OutputOptions& options,
                             const std::function<std::filesystem::path()>& choose = {});
std::string format_list();
void add_store(CLI::App& app, std::filesystem::path& store);
void add_json(CLI::App& app, bool& is_json);
void add_memory(CLI::App& app, std::uint64_t& memory_bytes);
void add_threads(CLI::App& app, int& num_threads);
void add_quiet(CLI::App& app, bool& is_quiet);
// What cells are as large as, and what the surface is taken for.
void add_sizes(CLI::App& app, MeshOptions& options);
// A file, or several.
void add_surfaces(CLI::App& app, std::filesystem::path& first,
                  std::vector<std::filesystem::path>& others);
CLI::Option* add_leaf(CLI::App& app, std::optional<LeafSpec>& leaf, const std::string& description);
CLI::Option* add_vtu(CLI::App& app, std::filesystem::path& file, const std::string& description);
CLI::Option* add_limit(CLI::App& app, std::optional<std::uint64_t>& limit,
                       const std::string& description);
CLI::App* declare_mesh(CLI::App& app, MeshCommand& command);
CLI::App* declare_resume(CLI::App& app, ResumeCommand& command);
CLI::App* declare_export(CLI::App& app, ExportCommand& command);
CLI::App* declare_report(CLI::App& app, ReportCommand& command);
CLI::App* declare_audit(CLI::App& app, AuditCommand& command);
CLI::App* declare_inspect(CLI::App& app, InspectCommand& command);
// What is wrong with the line that was typed. Returns the exit code; --help and --version come
// here, too.
int report_usage(const CLI::App& app, const CLI::ParseError& error);

}  // namespace locvol
