// Results as text for people and as JSON for programs; both from the same structs.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/audit/audit.h"
#include "engine/engine.h"
#include "engine/formats/writer.h"
#include "engine/inspect/cell_mesh.h"
#include "engine/inspect/crease_table.h"
#include "engine/inspect/leaf_scan.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/size_report.h"
#include "engine/plan/run_estimate.h"
#include "storage/records.h"
#include "storage/store.h"

namespace locvol {

using Json = nlohmann::ordered_json;  // keeps the order in which fields are set

struct LeafSite {
  MortonKey leaf;
  UnresolvedSite site;
};

Json to_json(const Point& point);
Json to_json(const Box& box);
Json to_json(const SurfaceFacts& facts);
std::string color_text(const Color& color);  // "#rrggbb"
Json to_json(const SurfaceSheets& sheets);   // an array
// `kept`: of a finished mesh; null: not known.
Json creases_json(const SurfaceSheets& sheets, const CreaseTable* kept = nullptr);
// "97.31%"; not 100% where something is lost.
std::string kept_share_text(const CreaseTable& kept);
// "7, with radius-edge ratios of 2 to 2.893, beside creases": of which the bound is not asked.
std::string excused_cells_text(const MeshStatistics& statistics, const RunRecord& run);
// Adds what a finished mesh keeps of creases to what is told of its run.
void add_kept_creases(const SurfaceSheets& sheets, const CreaseTable& kept, Json& json);
// A line for each, `limit` at most.
std::string crease_list_text(const SurfaceSheets& sheets, std::optional<std::uint64_t> limit,
                             const CreaseTable* kept = nullptr);
Json to_json(const RunParameters& parameters);
Json to_json(const LeafInfo& info);
Json to_json(const QueuePosition& position);  // color: null until the epoch opens
Json to_json(const LeafSite& site);
Json to_json(const LeafPoorCell& cell);
Json to_json(const Fault& fault);
Json to_json(const std::vector<Fault>& faults);
Json to_json(const CellQuality& quality, double size);
Json to_json(const DatabaseSize& size);
Json to_json(const RunSummary& summary);
Json to_json(const WriteSummary& summary);
Json to_json(const AuditReport& report);
Json to_json(const MeshStatistics& statistics, const RunRecord& run);
Json to_json(const RunEstimate& estimate);
Json insertions_json(std::span<const std::uint64_t> num_insertions);  // by condition, from C1

std::string_view phase_name(Phase phase);
std::string_view kind_name(PointKind kind);
std::string count_text(double count);  // "999", "12.3 thousand", "9.94 million"
// "1:02:03", "4:05"; rounded to seconds. REQUIRES: seconds >= 0
std::string duration_text(double seconds);
std::string bytes_text(std::uint64_t bytes);    // "999 B", "1.2 MB": powers of 1000
std::string in_mebibytes(std::uint64_t bytes);  // "1.5 MiB": the unit of --memory
std::string point_text(const Point& point);     // round-trips
std::string box_text(const Box& box);
std::string rounded_text(const Point& point);  // to six digits
std::string site_text(const LeafSite& site);
std::string poor_cell_text(const LeafPoorCell& cell);
std::string poor_cells_text(const MeshStatistics& statistics);
std::string bounds_text(const RunParameters& parameters);
std::string fault_text(const Fault& fault);
std::string position_text(const QueuePosition& position);
std::string quality_text(const CellQuality& quality, double size);
std::string insertions_text(std::span<const std::uint64_t> num_insertions);

// Each of these texts ends its lines itself.
std::string line_text(std::string_view name, std::string_view value);  // of a table
std::string facts_text(const SurfaceFacts& facts);
std::string sheets_text(const SurfaceSheets& sheets);  // of the first ones, and of bodies
// Of each body, where there are several.
// "1,234 cells, volume 2, +0.1% of the input's, ...", of one.
std::string body_text(const BodyFacts& facts, const MeshStatistics& body);
std::string body_statistics_text(const SurfaceSheets& sheets, const MeshStatistics& statistics);
// By id; none where there is one body.
Json bodies_json(const SurfaceSheets& sheets);
std::string parameters_text(const RunParameters& parameters);
std::string summary_text(const RunSummary& summary, const CreaseTable* kept = nullptr);
std::string audit_text(const AuditReport& report);
// The estimate of a run on so many threads; `least_memory`: the least cap that would do, in bytes.
std::string estimate_text(const RunEstimate& estimate, MeshFormat format, int num_threads,
                          std::uint64_t least_memory);
// The estimate in one line, without its end.
std::string brief_estimate_text(const RunEstimate& estimate, int num_threads);
std::string sizes_text(const SizeReport& report);
Json to_json(const SizeReport& report);
// `run`: whose mesh it is.
std::string statistics_text(const MeshStatistics& statistics, const RunRecord& run);
// What a mesh of λ everywhere would have, of a run whose sizes vary (an estimate); and how fast
// cells grow.
std::string uniform_text(const RunRecord& run, std::uint64_t num_cells);
std::string neighbors_text(const MeshStatistics& statistics);
// The estimate for a run like this one but for its sizes: λ everywhere.
double num_uniform_cells(const RunRecord& run);

// How many handles a closed surface has: the sum over its components.
std::int64_t genus(std::uint64_t num_components, std::int64_t euler_characteristic);

std::string json_text(const Json& json);
void print_json(const Json& json);
std::string json_line(const Json& json);  // without its end

// Prints a JSON array element by element, so that a long one is never in memory as a whole.
class JsonArrayPrinter {
 public:
  JsonArrayPrinter();
  ~JsonArrayPrinter();  // prints the end
  JsonArrayPrinter(const JsonArrayPrinter&) = delete;
  JsonArrayPrinter& operator=(const JsonArrayPrinter&) = delete;
  void add(std::string_view element);  // as json_line() makes it

 private:
  bool is_empty_ = true;
};

}  // namespace locvol
