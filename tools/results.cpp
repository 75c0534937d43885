#include "tools/results.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <functional>
#include <span>

#include "engine/formats/sheet_names.h"
#include "engine/output/stored_mesh.h"
#include "engine/plan/option_table.h"
#include "engine/run/leaf_queue.h"
#include "engine/shared/memory_budget.h"
#include "tools/arguments.h"

namespace locvol {
namespace {

std::string plural(std::uint64_t count, std::string_view noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

template <typename... Values>
std::string row(std::string_view name, fmt::format_string<Values...> format, Values&&... values) {
  return fmt::format("{:<16} {}\n", name, fmt::format(format, std::forward<Values>(values)...));
}

std::string mesh_and_input(std::string_view name, const auto& mesh, const auto& input) {
  return fmt::format("{:<28} {:>14} {:>14}\n", name, mesh, input);
}

// Of some bins of a histogram, taken together.
struct Bar {
  std::string name;
  std::uint64_t count = 0;
};

// One for each group of bins whose edges are `edges`; the last one takes what lies above, too.
// REQUIRES: each is an edge of the histogram
std::vector<Bar> bars_of(const Histogram& histogram, const std::vector<double>& edges,
                         const std::function<std::string(double low, double high)>& name) {
  std::vector<Bar> bars;
  for (std::size_t i = 0; i + 1 < edges.size(); ++i)
    bars.push_back({name(edges[i], edges[i + 1]), 0});
  for (std::size_t bin = 0, bar = 0; bin < histogram.counts.size(); ++bin) {
    if (bar + 1 < bars.size() && histogram.edges[bin] >= edges[bar + 1]) ++bar;
    bars[bar].count += histogram.counts[bin];
  }
  return bars;
}

std::string bar_text(const Bar& bar, std::uint64_t total, std::uint64_t largest) {
  constexpr int kLength = 16;
  if (bar.count == 0) return fmt::format("{:>7}", bar.name);
  const auto count = static_cast<double>(bar.count);
  const double percent = 100 * count / static_cast<double>(total);
  const auto length =
      static_cast<std::size_t>(std::round(kLength * count / static_cast<double>(largest)));
  return fmt::format("{:>7} {:>6} {}", bar.name,
                     percent < 0.05 ? "< 0.1%" : fmt::format("{:.1f}%", percent),
                     length > 0 ? std::string(length, '#') : ".");
}

std::vector<std::string> lines_of(const std::vector<Bar>& bars) {
  std::uint64_t total = 0, largest = 1;
  for (const Bar& bar : bars) {
    total += bar.count;
    largest = std::max(largest, bar.count);
  }
  std::vector<std::string> lines;
  for (const Bar& bar : bars) lines.push_back(bar_text(bar, total, largest));
  return lines;
}

std::vector<std::string> angle_lines(const Histogram& angles) {
  std::vector<double> edges = {0};
  for (int edge = 5; edge < 180; edge += 10) edges.push_back(edge);
  edges.push_back(180);
  return lines_of(bars_of(angles, edges, [](double low, double high) {
    return fmt::format("{:.0f}-{:.0f}", low, high);
  }));
}

std::vector<double> every_second(const std::vector<double>& edges) {
  std::vector<double> some;
  for (std::size_t i = 0; i < edges.size(); i += 2) some.push_back(edges[i]);
  return some;
}

std::vector<std::string> ratio_lines(const Histogram& ratios) {
  std::vector<double> edges = every_second(ratios.edges);
  edges.push_back(ratios.edges.back());
  return lines_of(bars_of(ratios, edges, [](double low, double high) {
    return low < 1.99 ? fmt::format("{:.1f}-{:.1f}", low, high) : std::string("2.0-");
  }));
}

std::vector<std::string> radius_lines(const Histogram& radii) {
  return lines_of(bars_of(radii, every_second(radii.edges), [](double low, double high) {
    return fmt::format("{:.1f}-{:.1f}", low, high);
  }));
}

std::vector<std::string> octave_lines(const std::map<int, std::uint64_t>& num_cells_by_octave) {
  std::vector<Bar> bars;
  for (const auto& [octave, num_cells] : num_cells_by_octave)
    bars.push_back({fmt::format("{:.3g}-", std::ldexp(1.0, octave)), num_cells});
  return lines_of(bars);
}

// Under their titles, side by side.
std::string columns_text(const std::string& left_title, const std::string& right_title,
                         const std::vector<std::string>& left,
                         const std::vector<std::string>& right) {
  std::string text = fmt::format("\n{:<33} {}\n", left_title, right_title);
  for (std::size_t i = 0; i < std::max(left.size(), right.size()); ++i) {
    std::string line =
        fmt::format("{:<34}{}", i < left.size() ? left[i] : "", i < right.size() ? right[i] : "");
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text;
}

// Of a run whose sizes vary.
std::string size_statistics_text(const MeshStatistics& statistics, const RunRecord& run) {
  return row("uniform", "{}", uniform_text(run, statistics.num_cells)) +
         row("neighbors", "{}", neighbors_text(statistics)) +
         columns_text("cells by size at their center",
                      fmt::format("circumradius over that size, at most {:.6g}",
                                  statistics.max_radius_over_size),
                      octave_lines(statistics.num_cells_by_octave),
                      radius_lines(statistics.radii_over_size));
}

std::string disk_text(double bytes) {
  return bytes < 9e18 ? bytes_text(static_cast<std::uint64_t>(bytes)) : "more than any disk";
}

std::string rough_duration_text(double seconds) {
  return seconds < 10     ? fmt::format("{:.2g} s", seconds)
         : seconds < 60   ? fmt::format("{:.0f} s", seconds)
         : seconds < 3600 ? fmt::format("{:.0f} min", seconds / 60)
                          : fmt::format("{:.1f} h", seconds / 3600);
}

// "about 1.2 s (0.5 s to 3 s)"
std::string range_text(double value, double factor,
                       const std::function<std::string(double)>& text) {
  return fmt::format("about {} ({} to {})", text(value), text(value / factor),
                     text(value * factor));
}

Json to_json(const Histogram& histogram) {
  return {{"edges", histogram.edges}, {"counts", histogram.counts}};
}

// What a run's record keeps of an option. There is no infinite number in JSON.
Json option_json(double value) { return std::isfinite(value) ? Json(value) : Json(); }
Json option_json(std::uint64_t value) { return value; }
Json option_json(Initialization init) { return init_name(init); }
Json option_json(InsideRule inside) { return inside_name(inside); }
Json option_json(const std::optional<double>& weld) { return weld ? Json(*weld) : Json("auto"); }
Json option_json(const std::string& image) { return image.empty() ? Json() : Json(image); }
Json option_json(const std::vector<SizeShape>& shapes) { return shapes.size(); }
Json option_json(bool value) { return value; }
Json option_json(const std::vector<std::string>& names) { return names; }
Json option_json(const std::vector<PartSize>& parts) {
  Json json = Json::object();
  for (const auto& [name, size] : parts) json[name] = size;
  return json;
}

// A file name need not be UTF-8; JSON must be.
std::string dump(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// One violation count of an audit, its name in JSON and in text.
struct Check {
  std::string_view key, text;
  std::uint64_t AuditReport::*count;
};

constexpr std::array kChecks = {
    Check{"nonempty_circumballs", "cells with a point in the circumball",
          &AuditReport::num_nonempty_circumballs},
    Check{"overused_facets", "facets used more than twice or twice on one side",
          &AuditReport::num_overused_facets},
    Check{"bad_boundary_edges", "boundary edges not in two boundary facets",
          &AuditReport::num_bad_boundary_edges},
    Check{"bad_boundary_vertices", "boundary vertices whose link is no cycle",
          &AuditReport::num_bad_boundary_vertices},
    Check{"wrong_facets", "boundary facets listed wrong or not at all",
          &AuditReport::num_wrong_facets},
    Check{"large_facets", "facets with a circumradius of λ or more",
          &AuditReport::num_large_facets},
    Check{"misoriented_edges", "edges whose two facets do not face the same way",
          &AuditReport::num_misoriented_edges},
    Check{"off_surface_vertices", "boundary vertices off the surface",
          &AuditReport::num_off_surface_vertices},
    Check{"large_cells", "cells with a circumradius of λ or more", &AuditReport::num_large_cells},
    Check{"badly_shaped_cells", "cells above the radius-edge bound",
          &AuditReport::num_badly_shaped_cells},
    Check{"lost_creases", "pieces of creases that are no edges", &AuditReport::num_lost_creases},
    Check{"lost_corners", "corners that are no vertices", &AuditReport::num_lost_corners},
    Check{"misoriented_cells", "cells flat or inverted", &AuditReport::num_misoriented_cells},
    Check{"repeated_cells", "cells stored twice", &AuditReport::num_repeated_cells},
    Check{"unknown_vertices", "vertices that no leaf owns", &AuditReport::num_unknown_vertices},
};

double kept_crease_length(const AuditReport& report) {
  return report.crease_length - report.lost_crease_length;
}

std::string poor_cells_text(const AuditReport& report) {
  std::string text = fmt::format("poor cells {}, with a dihedral angle below {}°",
                                 report.num_poor_cells, report.min_dihedral_bound);
  if (report.num_poor_cells > 0)
    text += fmt::format("; the worst at {}, leaf {}", point_text(report.worst_place),
                        key_text(report.worst_leaf));
  return text + "\n";
}

}  // namespace

std::int64_t genus(std::uint64_t num_components, std::int64_t euler_characteristic) {
  return static_cast<std::int64_t>(num_components) - euler_characteristic / 2;
}

std::string_view phase_name(Phase phase) { return facts_of(phase).name; }

std::string_view kind_name(PointKind kind) {
  switch (kind) {
    case PointKind::kSurface:
      return "surface";
    case PointKind::kVolume:
      return "volume";
    case PointKind::kLattice:
      return "lattice";
    case PointKind::kInserted:
      return "inserted";
    case PointKind::kCrease:
      return "crease";
  }
  return "unknown";
}

std::string count_text(double count) {
  if (count < 999.5) return fmt::format("{:.0f}", count);
  for (const auto& [unit, name] : {std::pair(1e3, "thousand"), {1e6, "million"}})
    if (count < 999.5 * unit) return fmt::format("{:.3g} {}", count / unit, name);
  return fmt::format("{:.3g} billion", count / 1e9);
}

std::string duration_text(double seconds) {
  const auto total = static_cast<std::uint64_t>(std::llround(seconds));
  const std::uint64_t hours = total / 3600, minutes = total / 60 % 60;
  return hours > 0 ? fmt::format("{}:{:02}:{:02}", hours, minutes, total % 60)
                   : fmt::format("{}:{:02}", minutes, total % 60);
}

std::string bytes_text(std::uint64_t bytes) {
  constexpr std::array<std::string_view, 5> kUnits = {"B", "kB", "MB", "GB", "TB"};
  if (bytes < 1000) return fmt::format("{} B", bytes);
  double value = static_cast<double>(bytes);
  std::size_t unit = 0;
  while (value >= 999.5 && unit + 1 < kUnits.size()) {
    value /= 1000;
    ++unit;
  }
  return fmt::format("{:.3g} {}", value, kUnits[unit]);
}

std::string in_mebibytes(std::uint64_t bytes) {
  return fmt::format("{:.1f} MiB", static_cast<double>(bytes) / (1 << 20));
}

std::string point_text(const Point& point) {
  return fmt::format("({}, {}, {})", point.x, point.y, point.z);
}

std::string box_text(const Box& box) {
  return fmt::format("{} to {}", point_text(box.min), point_text(box.max));
}

std::string rounded_text(const Point& p) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", p.x, p.y, p.z);
}

std::string site_text(const LeafSite& site) {
  return fmt::format("C{} at {}, radius {:.6g}, leaf {}", site.site.condition,
                     point_text(site.site.position), site.site.radius, key_text(site.leaf));
}

std::string poor_cell_text(const LeafPoorCell& cell) {
  return fmt::format("angle {:.4g}° at {}, radius {:.6g}, leaf {}{}", cell.degrees,
                     point_text(cell.position), cell.radius, key_text(cell.leaf),
                     cell.is_forced ? ", forced by a wall or crease" : "");
}

std::string bounds_text(const RunParameters& parameters) {
  const std::string angle =
      parameters.min_dihedral > 0 ? fmt::format("at least {}°", parameters.min_dihedral) : "any";
  std::string text = fmt::format("radius-edge ratio {}, dihedral angles {}, spacing floor {} λ",
                                 parameters.radius_edge_bound, angle, parameters.spacing_floor);
  for_each_option([&](const auto& option) {
    const auto& value = parameters.*option.kept;
    if constexpr (std::same_as<decltype(value), const double&>)
      if (*option.phrase != '\0' && value != RunParameters().*option.kept)
        text += fmt::format(fmt::runtime(option.phrase), value);
  });
  if (parameters.has_image())
    text += fmt::format("; an image of sizes, from {} on", parameters.image_least);
  if (parameters.weld)
    text += *parameters.weld > 0
                ? fmt::format("; points of the surface closer than {} joined", *parameters.weld)
                : "; no points of the surface joined";
  if (!parameters.sharp_polylines.empty()) text += "; polylines along edges that are sharp";
  if (!parameters.shapes.empty())
    text += fmt::format("; {} shapes with sizes from {} on", parameters.shapes.size(),
                        parameters.sizes().least);
  for (const auto& [name, size] : parameters.sheet_sizes)
    text += fmt::format("; {} at {}", size, name);
  for (const auto& [name, size] : parameters.body_sizes)
    text += fmt::format("; {} in {}", size, name);
  return text;
}

std::string insertions_text(std::span<const std::uint64_t> num_insertions) {
  std::string text;
  for (std::size_t i = 0; i < num_insertions.size(); ++i) {
    text += fmt::format("{}C{} {}", i == 0 ? "" : ", ", i + 1, num_insertions[i]);
  }
  return text;
}

std::string fault_text(const Fault& fault) { return fmt::format("DAMAGED: {}", fault.message); }

std::string position_text(const QueuePosition& position) {
  return position.color == kNoColor
             ? fmt::format("epoch {}", position.epoch)
             : fmt::format("epoch {}, color {}", position.epoch, position.color);
}

std::string quality_text(const CellQuality& quality, double size) {
  return fmt::format(
      "circumradius {:.4g} λ, radius-edge ratio {:.4g}, dihedral angles {:.4g} to "
      "{:.4g} degrees",
      quality.circumradius / size, quality.radius_edge_ratio, quality.min_dihedral_degrees,
      quality.max_dihedral_degrees);
}

std::string line_text(std::string_view name, std::string_view value) {
  return row(name, "{}", value);
}

std::string facts_text(const SurfaceFacts& facts) {
  std::string text = row("surface", "{}", facts.file) +
                     row("triangles", "{}, {} vertices", facts.num_triangles, facts.num_vertices) +
                     row("topology", "{}, Euler characteristic {}, genus {}",
                         plural(facts.num_components, "component"), facts.euler_characteristic,
                         genus(facts.num_components, facts.euler_characteristic)) +
                     row("area, volume", "{:.6g}, {:.6g}", facts.area, facts.volume) +
                     row("bounding box", "{}", box_text(facts.box));
  for (const std::string& note : facts.notes) text += row("note", "{}", note);
  return text;
}

namespace {

std::string bodies_text(const RunParameters& parameters) {
  if (!parameters.has_bodies && parameters.voids.empty()) return {};
  return row(
      "bodies are", "{}{}", parameters.has_bodies ? "groups or shells that are closed" : "files",
      parameters.voids.empty() ? ""
                               : fmt::format(", but for {}", fmt::join(parameters.voids, ", ")));
}

}  // namespace

std::string parameters_text(const RunParameters& parameters) {
  return row("size λ", "{}", parameters.size) + bodies_text(parameters) +
         (parameters.inside == InsideRule::kWinding
              ? row("inside is", "where the winding number is above 1/2")
          : parameters.inside == InsideRule::kWrap
              ? row("inside is", "what wraps the surface encloses")
              : "") +
         (parameters.wrap_alpha > 0 ? row("wrap alpha", "{}", parameters.wrap_alpha) : "") +
         (parameters.wrap_offset > 0 ? row("wrap offset", "{}", parameters.wrap_offset) : "") +
         (parameters.is_surface_only ? row("mesh of", "the surface alone") : "") +
         row("leaf capacity κ", "{}", parameters.leaf_capacity) +
         row("initialization", "{}, seed {}", init_name(parameters.init), parameters.seed) +
         row("bounds", "{}", bounds_text(parameters));
}

namespace {

constexpr std::size_t kMostShown = 20;

std::string bodies_text(const SurfaceSheets& sheets) {
  if (sheets.bodies.empty()) return {};
  std::string text = row("bodies", "{}", sheets.bodies.size());
  for (std::size_t b = 0; b < std::min(sheets.bodies.size(), kMostShown); ++b) {
    const BodyFacts& body = sheets.bodies[b];
    text += fmt::format(
        "  {}  {}: {}, volume {:.6g}{}\n", b + 1, body.name, plural(body.num_triangles, "triangle"),
        body.volume, body.around == kNoBody ? "" : ", in " + sheets.bodies[body.around - 1].name);
  }
  if (sheets.bodies.size() > kMostShown)
    text += fmt::format("  and {} more: --json lists all\n", sheets.bodies.size() - kMostShown);
  return text;
}

}  // namespace

std::string body_text(const BodyFacts& facts, const MeshStatistics& body) {
  if (body.num_cells == 0) return "no cells";
  return fmt::format("{}, volume {:.6g}, {:+.2g}% of the input's; {:.2f}° to {:.2f}°",
                     plural(body.num_cells, "cell"), body.volume,
                     100 * (body.volume - facts.volume) / facts.volume, body.min_dihedral_degrees,
                     body.max_dihedral_degrees);
}

std::string body_statistics_text(const SurfaceSheets& sheets, const MeshStatistics& statistics) {
  std::string text;
  for (std::size_t b = 0; b < std::min(statistics.bodies.size(), kMostShown); ++b)
    text += row(b == 0 ? "bodies" : "", "{}: {}", sheets.bodies[b].name,
                body_text(sheets.bodies[b], statistics.bodies[b]));
  return text;
}

std::string sheets_text(const SurfaceSheets& sheets) {
  if (sheets.sheets.empty()) return bodies_text(sheets);
  std::string text = bodies_text(sheets) + row("sheets", "{}", sheets.sheets.size());
  for (std::size_t s = 0; s < std::min(sheets.sheets.size(), kMostShown); ++s) {
    const SheetFacts& sheet = sheets.sheets[s];
    text += fmt::format("  {}  {}: {}, area {:.6g}, centroid {}\n", s + 1, sheet.name,
                        plural(sheet.num_triangles, "triangle"), sheet.area,
                        rounded_text(sheet.centroid));
  }
  if (sheets.sheets.size() > kMostShown)
    text += fmt::format("  and {} more: --json lists all\n", sheets.sheets.size() - kMostShown);
  return text;
}

std::string kept_share_text(const CreaseTable& kept) {
  if (kept.not_whole.empty()) return "100%";
  return fmt::format("{:.4g}%",
                     std::min(99.99, 100 * kept.kept_length() / std::max(kept.length, 1e-300)));
}

std::string creases_text(const SurfaceSheets& sheets, const CreaseTable* kept) {
  if (sheets.creases.empty() && sheets.num_corners == 0) return {};
  double length = 0;
  for (const CreaseFacts& crease : sheets.creases) length += crease.length;
  std::string share;
  if (kept != nullptr && kept->length > 0) share = ", " + kept_share_text(*kept) + " kept";
  std::string text = row("creases", "{} ({:.6g} long{}), {}", sheets.creases.size(), length, share,
                         plural(sheets.num_corners, "corner"));
  if (kept == nullptr || kept->not_whole.empty()) return text;
  constexpr std::size_t kMostNamed = 10;
  const std::vector<std::string> names = crease_names(sheets);
  std::vector<std::string> some;
  for (const CreaseId crease :
       std::span(kept->not_whole).first(std::min(kept->not_whole.size(), kMostNamed)))
    some.push_back(names[crease - 1]);
  return text + row("not whole", "{}: {}{}", plural(kept->not_whole.size(), "crease"),
                    fmt::join(some, ", "), some.size() < kept->not_whole.size() ? ", ..." : "");
}

std::string crease_list_text(const SurfaceSheets& sheets, std::optional<std::uint64_t> limit,
                             const CreaseTable* kept) {
  const bool is_known = kept != nullptr && kept->kept.size() == sheets.creases.size();
  const std::vector<std::string> names = crease_names(sheets);
  std::string text = fmt::format("crease      edges       length {}  corners          sheets\n",
                                 is_known ? "        kept" : "");
  for (std::size_t c = 0; c < sheets.creases.size() && c < limit.value_or(c + 1); ++c) {
    const auto& [num_edges, length, corners, sides] = sheets.creases[c];
    const std::string ends =
        sheets.creases[c].is_closed() ? "-" : fmt::format("{} {}", corners[0], corners[1]);
    const std::string of_mesh = is_known ? fmt::format("{:>12.6g}", kept->kept[c].length) : "";
    const std::string default_name = fmt::format("crease {}", c + 1);
    text += fmt::format("{:>6} {:>10} {:>12.6g} {}  {:<15}  {} {}{}\n", c + 1, num_edges, length,
                        of_mesh, ends, sides[0], sides[1],
                        names[c] == default_name ? "" : "  " + names[c]);
  }
  return text + creases_text(sheets, kept);
}

std::string summary_text(const RunSummary& summary, const CreaseTable* kept) {
  return row("phase", "{}", phase_name(summary.run.phase)) +
         row("mesh", "{}, {}",
             plural(summary.run.counts.num_cells,
                    summary.run.parameters.is_surface_only ? "triangle" : "cell"),
             plural(summary.run.counts.num_points, "point")) +
         row("visits", "{}, at most {} to one of {} leaves", summary.run.counts.num_visits,
             summary.max_visits_of_a_leaf, summary.num_leaves) +
         row("insertions", "{}", insertions_text(summary.run.counts.num_insertions)) +
         row("deletions", "{}", summary.run.counts.num_deletions) +
         row("moves", "{}", summary.run.counts.num_moves) +
         row("unresolved", "{}", plural(summary.run.counts.num_unresolved, "site")) +
         sheets_text(summary.sheets) + creases_text(summary.sheets, kept);
}

// Of all of a mesh.
std::string topology_text(const AuditReport& report) {
  std::string text = mesh_and_input("", "mesh", "input");
  text += mesh_and_input("volume", fmt::format("{:.6g}", report.volume),
                         fmt::format("{:.6g}", report.surface_volume));
  for (std::size_t b = 0; b < report.body_volumes.size(); ++b)
    text += mesh_and_input(fmt::format("volume of body {}", b + 1),
                           fmt::format("{:.6g}", report.body_volumes[b]),
                           fmt::format("{:.6g}", report.surface_body_volumes[b]));
  text +=
      mesh_and_input("boundary components", report.num_components, report.surface_num_components);
  text += mesh_and_input("Euler characteristic", report.euler_characteristic,
                         report.surface_euler_characteristic);
  text += mesh_and_input("genus", genus(report.num_components, report.euler_characteristic),
                         genus(report.surface_num_components, report.surface_euler_characteristic));
  if (report.surface_crease_length > 0)
    text += mesh_and_input("creases", fmt::format("{:.6g}", kept_crease_length(report)),
                           fmt::format("{:.6g}", report.surface_crease_length));
  return text;
}

std::string audit_text(const AuditReport& report) {
  std::string text = report.is_sample() ? fmt::format("a sample: {} of {} leaves, and of these\n",
                                                      report.num_checked_leaves, report.num_leaves)
                                        : topology_text(report);
  text += report.is_surface_only ? fmt::format(
                                       "triangles {}, vertices {}\n"
                                       "largest circumradius {:.6g} λ, smallest angle {:.2f}°\n",
                                       report.num_boundary_facets, report.num_boundary_vertices,
                                       report.max_circumradius, report.min_facet_degrees)
                                 : fmt::format(
                                       "cells {}, vertices {}; boundary facets {}, vertices {}\n"
                                       "largest circumradius {:.6g} λ, radius-edge ratio {:.6g}\n"
                                       "dihedral angles {:.2f}° to {:.2f}°\n",
                                       report.num_cells, report.num_vertices,
                                       report.num_boundary_facets, report.num_boundary_vertices,
                                       report.max_circumradius, report.max_radius_edge_ratio,
                                       report.min_dihedral_degrees, report.max_dihedral_degrees);
  text += fmt::format(
      "boundary vertices at most {:.3g} λ off the surface\n"
      "unresolved sites {}\n",
      report.max_surface_distance, report.num_unresolved);
  if (report.crease_length > 0)
    text += fmt::format("creases kept {:.6g}%\n",
                        100 * kept_crease_length(report) / report.crease_length);
  if (report.min_dihedral_bound > 0) text += poor_cells_text(report);
  for (const Check& check : kChecks) {
    if (report.*check.count > 0)
      text += fmt::format("BAD: {} {}\n", report.*check.count, check.text);
  }
  for (const std::string& violation : report.violations) text += fmt::format("  {}\n", violation);
  if (!report.is_valid()) return text + "NOT VALID\n";
  if (report.num_unresolved == 0)
    return text + (report.is_sample() ? "valid, as far as it was checked\n" : "valid\n");
  return text +
         fmt::format("manifold; guarantee open at {}\n", plural(report.num_unresolved, "site"));
}

std::string uniform_text(const RunRecord& run, std::uint64_t num_cells) {
  const double num_uniform = num_uniform_cells(run);
  return fmt::format("{} cells if all were of size λ, {:.3g} times as many",
                     count_text(num_uniform), num_uniform / static_cast<double>(num_cells));
}

std::string neighbors_text(const MeshStatistics& statistics) {
  return fmt::format("circumradii at most {:.3g} times each other's",
                     statistics.max_neighbor_ratio);
}

// The bound is not asked of cells whose shortest edge leads from sheet to sheet.
std::string excused_cells_text(const MeshStatistics& statistics, const RunRecord& run) {
  return fmt::format("{}, with radius-edge ratios of {:.4g} to {:.4g}, beside creases{}",
                     statistics.num_above_ratio, run.parameters.radius_edge_bound,
                     statistics.max_radius_edge_ratio,
                     run.counts.num_unresolved > 0 ? " or unresolved sites" : "");
}

double num_uniform_cells(const RunRecord& run) {
  return estimated_num_cells(run.surface, run.has_creases, run.parameters.size);
}

std::string poor_cells_text(const MeshStatistics& statistics) {
  return fmt::format("{}, with a dihedral angle below {}°", statistics.num_poor_cells,
                     statistics.min_dihedral_bound) +
         (statistics.num_forced_cells > 0
              ? fmt::format("; {} forced by thin walls or acute creases",
                            statistics.num_forced_cells)
              : "");
}

std::string statistics_text(const MeshStatistics& statistics, const RunRecord& run) {
  const double volume = run.surface.volume;
  const bool is_excused = keeps_creases(run) && statistics.num_above_ratio > 0;
  return row("volume", "{:.6g}, {:+.2g}% of the input's {:.6g}", statistics.volume,
             100 * (statistics.volume - volume) / volume, volume) +
         row("cells", "{} of the lattice core; circumradius at most {:.4g} λ",
             statistics.num_core_cells, statistics.max_circumradius) +
         (statistics.min_dihedral_bound > 0 ? row("poor cells", "{}", poor_cells_text(statistics))
                                            : "") +
         (is_excused ? row("slender cells", "{}", excused_cells_text(statistics, run)) : "") +
         (run.parameters.sizes().is_uniform() ? "" : size_statistics_text(statistics, run)) +
         columns_text(fmt::format("dihedral angles {:.2f}° to {:.2f}°",
                                  statistics.min_dihedral_degrees, statistics.max_dihedral_degrees),
                      fmt::format("radius-edge ratios, at most {:.4g}",
                                  is_excused ? statistics.max_bounded_ratio
                                             : statistics.max_radius_edge_ratio),
                      angle_lines(statistics.dihedral_angles),
                      ratio_lines(statistics.radius_edge_ratios));
}

std::vector<std::string> notes_of(const RunEstimate& estimate) {
  std::vector<std::string> notes;
  if (const std::string narrow = narrow_text(estimate); !narrow.empty())
    notes.push_back("cells: " + narrow);
  if (const std::string lost = lost_text(estimate); !lost.empty()) notes.push_back(lost);
  if (estimate.is_thin && !estimate.is_narrow_known)
    notes.push_back("the surface is thinner than λ on average: it may be several times as much");
  return notes;
}

std::string estimate_text(const RunEstimate& estimate, MeshFormat format, int num_threads,
                          std::uint64_t least_memory) {
  const double seconds = estimate.total_seconds();
  std::string text =
      row("size λ", "{}", estimate.size) +
      row(estimate.is_surface_only ? "triangles" : "cells", "{}{}",
          estimate.is_least ? "at least " : "",
          range_text(estimate.num_cells, kCellsFactor * estimate.doubt, count_text)) +
      row("store", "{}",
          range_text(estimate.store_bytes, kBytesFactor * estimate.doubt, disk_text)) +
      row("mesh file", "{}, as {}",
          range_text(estimate.output.file_bytes, kFileFactor * estimate.doubt, disk_text),
          info_of(format).name);
  if (seconds > 0)
    text += row("time", "{}, on {}",
                range_text(seconds, kSecondsFactor * estimate.doubt, rough_duration_text),
                plural(static_cast<std::uint64_t>(num_threads), "thread"));
  text += row("memory", "at least {}; with more, it is faster", memory_text(least_memory));
  for (const std::string& note : notes_of(estimate)) text += row("note", "{}", note);
  return text;
}

std::string sizes_text(const SizeReport& report) {
  std::string text =
      row("sizes", "{:.4g} to {:.4g}, in {} cubes", report.least, report.most, report.num_cubes);
  double all = 0;
  for (const SizeOctave& octave : report.octaves) all += octave.num_cells;
  for (const auto& [least, volume, num_cells] : report.octaves)
    text += line_text(
        "", fmt::format("{:.3g} to {:.3g}: {} cells, {:.1f}%, in a volume of {:.4g}", least,
                        2 * least, count_text(num_cells), 100 * num_cells / all, volume));
  return text;
}

Json to_json(const SizeReport& report) {
  Json octaves = Json::array();
  for (const auto& [least, volume, num_cells] : report.octaves)
    octaves.push_back({{"least", least}, {"volume", volume}, {"estimated_cells", num_cells}});
  return {{"num_cubes", report.num_cubes},
          {"least", report.least},
          {"most", report.most},
          {"octaves", octaves}};
}

std::string brief_estimate_text(const RunEstimate& estimate, int num_threads) {
  const std::string_view noun = estimate.is_surface_only ? "triangles" : "tetrahedra";
  if (estimate.is_least)
    return fmt::format(
        "λ = {:.6g}: how many {} it takes is known once the surface has "
        "been measured; at that size alone {}",
        estimate.size, noun, count_text(estimate.num_cells));
  std::string text =
      fmt::format("λ = {:.6g}: {} {}, a file of {}, a store of {}", estimate.size,
                  range_text(estimate.num_cells, kCellsFactor * estimate.doubt, count_text), noun,
                  disk_text(estimate.output.file_bytes), disk_text(estimate.store_bytes));
  if (const double seconds = estimate.total_seconds(); seconds > 0)
    text += fmt::format(", {} on {}",
                        range_text(seconds, kSecondsFactor * estimate.doubt, rough_duration_text),
                        plural(static_cast<std::uint64_t>(num_threads), "thread"));
  for (const std::string& note : notes_of(estimate)) text += "; " + note;
  return text;
}

Json to_json(const Point& point) { return {point.x, point.y, point.z}; }

Json to_json(const Box& box) { return {{"min", to_json(box.min)}, {"max", to_json(box.max)}}; }

Json to_json(const SurfaceFacts& facts) {
  return {{"file", facts.file},
          {"num_vertices", facts.num_vertices},
          {"num_triangles", facts.num_triangles},
          {"num_components", facts.num_components},
          {"euler_characteristic", facts.euler_characteristic},
          {"genus", genus(facts.num_components, facts.euler_characteristic)},
          {"area", facts.area},
          {"volume", facts.volume},
          {"box", to_json(facts.box)},
          {"notes", facts.notes}};
}

Json bodies_json(const SurfaceSheets& sheets) {
  Json all = Json::array();
  for (const BodyFacts& body : sheets.bodies)
    all.push_back({{"id", all.size() + 1},
                   {"name", body.name},
                   {"num_triangles", body.num_triangles},
                   {"num_shells", body.num_shells},
                   {"volume", body.volume},
                   {"around", body.around}});
  return all;
}

std::string color_text(const Color& color) {
  return fmt::format("#{:02x}{:02x}{:02x}", color.red, color.green, color.blue);
}

Json to_json(const SurfaceSheets& sheets) {
  Json all = Json::array();
  for (const SheetFacts& sheet : sheets.sheets) {
    all.push_back({{"id", all.size() + 1},
                   {"name", sheet.name},
                   {"group", sheet.group},
                   {"first_triangle", sheet.first_triangle},
                   {"num_triangles", sheet.num_triangles},
                   {"area", sheet.area},
                   {"centroid", to_json(sheet.centroid)},
                   {"box", to_json(sheet.box)},
                   {"bodies", sheet.bodies}});
    if (sheet.color) all.back()["color"] = color_text(*sheet.color);
  }
  return all;
}

Json creases_json(const SurfaceSheets& sheets, const CreaseTable* kept) {
  const bool is_known = kept != nullptr && kept->kept.size() == sheets.creases.size();
  const std::vector<std::string> names = crease_names(sheets);
  Json all = Json::array();
  for (const CreaseFacts& crease : sheets.creases) {
    Json corners = Json::array();
    if (!crease.is_closed()) corners = crease.corners;
    const std::size_t place = all.size();
    Json json = {{"id", place + 1},
                 {"name", names[place]},
                 {"num_edges", crease.num_edges},
                 {"length", crease.length}};
    if (is_known) {
      json["num_mesh_edges"] = kept->kept[place].num_edges;
      json["kept_length"] = kept->kept[place].length;
    }
    json["corners"] = corners;
    json["sheets"] = crease.sheets;
    all.push_back(std::move(json));
  }
  return all;
}

void add_kept_creases(const SurfaceSheets& sheets, const CreaseTable& kept, Json& json) {
  json["creases"] = creases_json(sheets, &kept);
  json["crease_length"] = kept.length;
  json["kept_crease_length"] = kept.kept_length();
  json["creases_not_whole"] = kept.not_whole;
  json["num_kept_corners"] = kept.num_corners;
}

Json to_json(const RunParameters& parameters) {
  Json json = {{"input_digest", parameters.input_digest}};
  for_each_option(
      [&](const auto& option) { json[option.name.key] = option_json(parameters.*option.kept); });
  return json;
}

Json to_json(const LeafInfo& info) {
  Json json = {{"num_visits", info.num_visits},
               {"num_points", info.num_points},
               {"num_cells", info.num_cells},
               {"num_core_points", info.num_core_points},
               {"num_core_cells", info.num_core_cells},
               {"num_triangles", info.num_triangles},
               {"insertions", insertions_json(info.num_insertions)},
               {"num_deletions", info.num_deletions},
               {"num_moves", info.num_moves},
               {"num_unresolved", info.num_unresolved},
               {"is_center_inside", info.center.body() != kNoBody}};
  if (info.queued) json["queued"] = to_json(*info.queued);
  return json;
}

Json to_json(const QueuePosition& position) {
  Json json = {{"epoch", position.epoch}, {"color", nullptr}};
  if (position.color != kNoColor) json["color"] = position.color;
  return json;
}

Json to_json(const LeafSite& site) {
  return {{"leaf", key_text(site.leaf)},
          {"condition", fmt::format("C{}", site.site.condition)},
          {"position", to_json(site.site.position)},
          {"radius", site.site.radius}};
}

Json to_json(const LeafPoorCell& cell) {
  return {{"leaf", key_text(cell.leaf)},          {"condition", "angle"},
          {"position", to_json(cell.position)},   {"radius", cell.radius},
          {"min_dihedral_degrees", cell.degrees}, {"is_forced", cell.is_forced}};
}

Json to_json(const Fault& fault) {
  Json json = {{"leaf", nullptr}, {"message", fault.message}};
  if (fault.leaf.is_valid()) json["leaf"] = key_text(fault.leaf);
  return json;
}

Json to_json(const std::vector<Fault>& faults) {
  Json json = Json::array();
  for (const Fault& fault : faults) json.push_back(to_json(fault));
  return json;
}

Json to_json(const CellQuality& quality, double size) {
  return {{"max_circumradius_over_size", quality.circumradius / size},
          {"max_radius_edge_ratio", quality.radius_edge_ratio},
          {"min_dihedral_degrees", quality.min_dihedral_degrees},
          {"max_dihedral_degrees", quality.max_dihedral_degrees}};
}

Json to_json(const DatabaseSize& size) {
  return {{"name", size.name}, {"bytes", size.bytes}, {"num_entries", size.num_entries}};
}

Json to_json(const RunSummary& summary) {
  return {{"phase", phase_name(summary.run.phase)},
          {"num_points", summary.run.counts.num_points},
          {"num_cells", summary.run.counts.num_cells},
          {"num_leaves", summary.num_leaves},
          {"num_visits", summary.run.counts.num_visits},
          {"max_visits_of_a_leaf", summary.max_visits_of_a_leaf},
          {"insertions", insertions_json(summary.run.counts.num_insertions)},
          {"num_deletions", summary.run.counts.num_deletions},
          {"num_moves", summary.run.counts.num_moves},
          {"num_unresolved", summary.run.counts.num_unresolved},
          {"parameters", to_json(summary.run.parameters)},
          {"surface", to_json(summary.run.surface)},
          {"sheets", to_json(summary.sheets)},
          {"bodies", bodies_json(summary.sheets)},
          {"creases", creases_json(summary.sheets)},
          {"num_corners", summary.sheets.num_corners}};
}

Json to_json(const WriteSummary& summary) {
  return {{"num_vertices", summary.num_vertices},
          {"num_cells", summary.num_cells},
          {"bytes", summary.bytes}};
}

Json to_json(const MeshStatistics& statistics, const RunRecord& run) {
  Json json = {{"num_cells", statistics.num_cells},
               {"num_core_cells", statistics.num_core_cells},
               {"volume", statistics.volume},
               {"min_dihedral_degrees", statistics.min_dihedral_degrees},
               {"max_dihedral_degrees", statistics.max_dihedral_degrees},
               {"min_dihedral_bound", statistics.min_dihedral_bound},
               {"num_poor_cells", statistics.num_poor_cells},
               {"num_forced_cells", statistics.num_forced_cells},
               {"max_radius_edge_ratio", statistics.max_radius_edge_ratio},
               {"max_bounded_radius_edge_ratio", statistics.max_bounded_ratio},
               {"num_above_radius_edge_ratio", statistics.num_above_ratio},
               {"max_circumradius", statistics.max_circumradius * run.parameters.size},
               {"max_circumradius_over_size", statistics.max_radius_over_size},
               {"dihedral_angles", to_json(statistics.dihedral_angles)},
               {"min_dihedral_angles", to_json(statistics.min_dihedral_angles)},
               {"radius_edge_ratios", to_json(statistics.radius_edge_ratios)},
               {"circumradii_over_size", to_json(statistics.radii_over_size)}};
  for (const MeshStatistics& body : statistics.bodies) {
    Json of_body = to_json(body, run);
    of_body["id"] = json["bodies"].size() + 1;
    json["bodies"].push_back(std::move(of_body));
  }
  if (run.parameters.sizes().is_uniform()) return json;
  json["max_ratio_of_neighbors"] = statistics.max_neighbor_ratio;
  json["estimated_uniform_cells"] = num_uniform_cells(run);
  json["octaves"] = Json::array();
  for (const auto& [octave, num_cells] : statistics.num_cells_by_octave)
    json["octaves"].push_back({{"least", std::ldexp(1.0, octave)}, {"num_cells", num_cells}});
  return json;
}

Json to_json(const RunEstimate& estimate) {
  const auto range = [](double value, double factor) -> Json {
    return {{"low", value / factor}, {"expected", value}, {"high", value * factor}};
  };
  return {{"size", estimate.size},
          {"is_thin", estimate.is_thin},
          {"narrow",
           {{"num_cells", estimate.narrow.num_cells},
            {"distance", estimate.narrow.distance},
            {"is_outside", estimate.narrow.is_outside},
            {"lost_area", estimate.narrow.lost_area},
            {"lost_distance", estimate.narrow.lost_distance}}},
          {"num_cells", range(estimate.num_cells, kCellsFactor * estimate.doubt)},
          {"num_vertices", range(estimate.num_vertices, kCellsFactor * estimate.doubt)},
          {"store_bytes", range(estimate.store_bytes, kBytesFactor * estimate.doubt)},
          {"file_bytes", range(estimate.output.file_bytes, kFileFactor * estimate.doubt)},
          {"output_disk_bytes", range(estimate.output.disk_bytes(), kFileFactor * estimate.doubt)},
          {"seconds", range(estimate.total_seconds(), kSecondsFactor * estimate.doubt)}};
}

Json to_json(const AuditReport& report) {
  Json violations, worst;
  for (const Check& check : kChecks) violations[std::string(check.key)] = report.*check.count;
  violations["examples"] = report.violations;
  if (report.worst_leaf.is_valid())
    worst = {{"leaf", key_text(report.worst_leaf)}, {"position", to_json(report.worst_place)}};
  return {{"is_valid", report.is_valid()},
          {"num_leaves", report.num_leaves},
          {"num_checked_leaves", report.num_checked_leaves},
          {"mesh",
           {{"num_cells", report.num_cells},
            {"num_vertices", report.num_vertices},
            {"num_boundary_facets", report.num_boundary_facets},
            {"num_boundary_vertices", report.num_boundary_vertices},
            {"volume", report.volume},
            {"body_volumes", report.body_volumes},
            {"num_components", report.num_components},
            {"euler_characteristic", report.euler_characteristic},
            {"genus", genus(report.num_components, report.euler_characteristic)},
            {"crease_length", kept_crease_length(report)}}},
          {"input",
           {{"volume", report.surface_volume},
            {"body_volumes", report.surface_body_volumes},
            {"num_components", report.surface_num_components},
            {"euler_characteristic", report.surface_euler_characteristic},
            {"genus", genus(report.surface_num_components, report.surface_euler_characteristic)},
            {"crease_length", report.surface_crease_length}}},
          {"lost_crease_length", report.lost_crease_length},
          {"max_circumradius_over_size", report.max_circumradius},
          {"max_radius_edge_ratio", report.max_radius_edge_ratio},
          {"min_dihedral_degrees", report.min_dihedral_degrees},
          {"max_dihedral_degrees", report.max_dihedral_degrees},
          {"min_dihedral_bound", report.min_dihedral_bound},
          {"min_facet_degrees", report.is_surface_only ? Json(report.min_facet_degrees) : Json()},
          {"num_poor_cells", report.num_poor_cells},
          {"smallest_angle_at", worst},
          {"max_surface_distance_over_size", report.max_surface_distance},
          {"num_unresolved", report.num_unresolved},
          {"num_open", report.num_open},
          {"violations", violations}};
}

Json insertions_json(std::span<const std::uint64_t> num_insertions) {
  Json json;
  for (std::size_t i = 0; i < num_insertions.size(); ++i) {
    json[fmt::format("C{}", i + 1)] = num_insertions[i];
  }
  return json;
}

std::string json_line(const Json& json) { return dump(json, -1); }

std::string json_text(const Json& json) { return dump(json, 2) + "\n"; }

void print_json(const Json& json) { fmt::print("{}", json_text(json)); }

JsonArrayPrinter::JsonArrayPrinter() { fmt::print("["); }
JsonArrayPrinter::~JsonArrayPrinter() { fmt::print("{}]\n", is_empty_ ? "" : "\n"); }

void JsonArrayPrinter::add(std::string_view element) {
  fmt::print("{}\n  {}", is_empty_ ? "" : ",", element);
  is_empty_ = false;
}

}  // namespace locvol
