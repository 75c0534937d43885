#include "tools/page/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/engine.h"
#include "engine/inspect/crease_table.h"
#include "engine/inspect/mesh_statistics.h"
#include "engine/inspect/sheet_table.h"
#include "engine/output/stored_mesh.h"
#include "engine/plan/option_table.h"
#include "engine/ranks/counts_of_ranks.h"
#include "engine/ranks/rank_store.h"
#include "engine/run/run_timeline.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/partial_file.h"
#include "engine/shared/scratch_directory.h"
#include "tools/arguments.h"
#include "tools/commands.h"
#include "tools/faces.h"
#include "tools/forecast.h"
#include "tools/page/page_charts.h"
#include "tools/page/page_data.h"
#include "tools/page/page_resources.h"
#include "tools/results.h"
#include "tools/stored_run.h"

namespace locvol {
namespace {

constexpr std::string_view kThreeNotice =
    "three.js r111. The MIT License. Copyright © 2010-2019 three.js authors. "
    "Permission is hereby granted, free of charge, to any person obtaining a copy of this software "
    "and associated documentation files (the \"Software\"), to deal in the Software without "
    "restriction, including without limitation the rights to use, copy, modify, merge, publish, "
    "distribute, sublicense, and/or sell copies of the Software, and to permit persons to whom the "
    "Software is furnished to do so, subject to the following conditions: The above copyright "
    "notice and this permission notice shall be included in all copies or substantial portions of "
    "the Software. THE SOFTWARE IS PROVIDED \"AS IS\", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR "
    "IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A "
    "PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE "
    "LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR "
    "OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER "
    "DEALINGS IN THE SOFTWARE.";

// 1234567 as "1,234,567".
std::string grouped(std::uint64_t number) {
  std::string text = std::to_string(number);
  for (std::size_t place = text.size(); place > 3; place -= 3) text.insert(place - 3, 1, ',');
  return text;
}

// The text of a script element must not end it.
std::string script_text(std::string text) {
  for (std::size_t at = 0; (at = text.find("</", at)) != std::string::npos; at += 3)
    text.insert(at + 1, 1, '\\');
  return text;
}

// Writes to a PartialFile from the front.
class PageFile {
 public:
  explicit PageFile(const std::filesystem::path& file) : file_(file), out_(file_, 0) {}
  void write(std::string_view text) { out_.append(std::as_bytes(std::span(text))); }
  std::uint64_t publish() {
    out_.flush();
    file_.publish();
    return out_.offset();
  }

 private:
  PartialFile file_;
  FileSection out_;
};

class Page {
 public:
  Page(const Store& store, const ViewLimits& limits, int num_threads, Exchange& exchange)
      : run_(run_of(store)),
        timeline_(store.snapshot().timeline()),
        memory_(store.snapshot().memory()) {
    run_.counts = total_counts(exchange, run_.counts);
    if (is_done()) statistics_ = mesh_statistics(store, num_threads, {}, nullptr, exchange);
    if (is_done() && keeps_creases(run_)) creases_ = crease_table(store, nullptr, exchange);
    view_ = mesh_view(store, limits, exchange);
    if (is_done() && !view_.sheets.sheets.empty())
      sheets_ = sheet_table(store, temporary_directory() / "page", nullptr, exchange);
    num_sites_ = view_.sites.size();
    if (num_poor_cells() > 0) {
      poor_cells_ = first_poor_cells(store, limits.max_sites, num_threads, exchange);
      mark_poor_cells();
    }
  }

  PageSummary write(const std::filesystem::path& file) {
    PageSummary summary{.num_mesh_cells = run_.counts.num_cells};
    for (const ViewCells& cells : view_.cells) summary.num_cells += cells.cells.size();
    PageFile out(file);
    std::string_view rest = page_template();
    while (true) {
      const std::size_t begin = rest.find("{{");
      out.write(rest.substr(0, begin));
      if (begin == std::string_view::npos) break;
      const std::size_t end = rest.find("}}", begin);
      put_part(rest.substr(begin + 2, end - begin - 2), out);
      rest.remove_prefix(end + 2);
    }
    summary.bytes = out.publish();
    return summary;
  }

 private:
  using Rows = std::vector<std::pair<std::string, std::string>>;

  static RunRecord run_of(const Store& store) {
    auto run = store.snapshot().run();
    if (!run || run->phase == Phase::kIngest)
      throw std::runtime_error(
          fmt::format("the store {} holds no surface yet: there is nothing to show",
                      store.directory().string()));
    return *std::move(run);
  }

  std::uint64_t num_poor_cells() const { return statistics_ ? statistics_->num_poor_cells : 0; }

  // As sites are marked.
  void mark_poor_cells() {
    for (const LeafPoorCell& cell : poor_cells_) {
      const auto after = std::ranges::upper_bound(
          view_.leaves, cell.leaf, {}, [](const ViewLeaf& leaf) { return leaf.key.range_min(); });
      view_.sites.push_back({{kNumConditions, cell.position, cell.radius},
                             static_cast<std::uint32_t>(after - view_.leaves.begin()) - 1});
    }
  }

  bool is_done() const { return run_.phase == Phase::kDone; }
  std::string name() const { return std::filesystem::path(run_.surface.file).filename().string(); }

  void put_part(std::string_view part, PageFile& out) {
    const std::map<std::string_view, std::function<std::string()>> texts = {
        {"title", [&] { return html_text(name() + " – locvol"); }},
        {"name", [&] { return html_text(name()); }},
        {"style", [] { return std::string(page_style()); }},
        {"summary", [&] { return summary(); }},
        {"viewer_class", [] { return std::string(three_library().empty() ? "is-failed" : ""); }},
        {"failure", [] { return failure(); }},
        {"marked", [&] { return marked(); }},
        {"shown", [&] { return shown(); }},
        {"section_note",
         [&] {
           return view_.sites.empty()
                      ? ""
                      : fmt::format("Dots are {}, wherever they lie along the line of sight.",
                                    num_poor_cells() == 0 ? "unresolved sites"
                                    : num_sites_ == 0     ? "poor cells"
                                                          : "unresolved sites and poor cells");
         }},
        {"sections", [&] { return sections(); }},
        {"statistics", [&] { return statistics(); }},
        {"timeline", [&] { return timeline(); }},
        {"counts", [&] { return counts(); }},
        {"facts", [&] { return facts(); }},
        {"footer", [&] { return footer(); }},
        {"three", [] { return three(); }},
    };
    if (part == "data") return put_data(out);
    out.write(texts.at(part)());
  }

  std::string summary() const {
    std::string text =
        fmt::format("{} tetrahedra, {} vertices, λ = {:.6g}", grouped(run_.counts.num_cells),
                    grouped(run_.counts.num_points), run_.parameters.size);
    if (!is_done())
      text = fmt::format("<strong>not finished</strong> (phase: {}); so far ",
                         phase_name(run_.phase)) +
             text;
    if (run_.counts.num_unresolved > 0)
      text += fmt::format("; <strong>{} unresolved sites</strong>",
                          grouped(run_.counts.num_unresolved));
    if (num_poor_cells() > 0) text += fmt::format("; <strong>{}</strong>", poor_cells_text());
    return text;
  }

  std::string poor_cells_text() const {
    std::string text = fmt::format("{} {} a dihedral angle below {}°", grouped(num_poor_cells()),
                                   num_poor_cells() == 1 ? "cell has" : "cells have",
                                   run_.parameters.min_dihedral);
    if (statistics_->num_forced_cells > 0)
      text += fmt::format(", {} in thin walls or at acute creases",
                          grouped(statistics_->num_forced_cells));
    return text;
  }

  std::string marked() const {
    std::string text = fmt::format("unresolved sites ({})", grouped(run_.counts.num_unresolved));
    if (num_poor_cells() > 0) text += fmt::format(", poor cells ({})", grouped(num_poor_cells()));
    return text;
  }

  static std::string failure() {
    return three_library().empty()
               ? "This locvol was built without three.js (Debian's libjs-three), so that the page "
                 "has no interactive view; its still figures follow."
               : "";
  }

  // What the view shows, and what it leaves out.
  std::string shown() const {
    std::string text;
    if (view_.has_all_cells()) {
      text = "The view holds the whole mesh: its boundary, and all cells that the plane meets.";
    } else {
      text = view_.surface.grid > 0
                 ? fmt::format(
                       "The view shows the input surface, thinned to {} triangles (from {}: "
                       "vertices within {:.3g} are joined), and what lies inside filled in "
                       "the color of the leaf.",
                       grouped(view_.surface.triangles.size()), grouped(run_.surface.num_triangles),
                       view_.surface.grid)
                 : "The view shows the input surface, and what lies inside filled in the color of "
                   "the leaf.";
      if (!is_done())
        text += " The run is not finished: no cells are shown.";
      else if (view_.cells.empty())
        text += fmt::format(" Even the cells at one plane are too many for a page, of {}.",
                            grouped(run_.counts.num_cells));
      else
        text += fmt::format(
            " Of the {} cells, the page holds the {} that meet {} planes across "
            "the axes; the slider catches at them, and ◂ ▸ go from one to the "
            "next.",
            grouped(run_.counts.num_cells), grouped(num_shown_cells()), view_.cells.size());
    }
    std::uint64_t num_edges = 0;
    for (const CreaseFacts& crease : view_.sheets.creases) num_edges += crease.num_edges;
    if (view_.creases.size() < num_edges)
      text += fmt::format(" Of the {} edges of creases, {} are drawn.", grouped(num_edges),
                          grouped(view_.creases.size()));
    if (num_sites_ < run_.counts.num_unresolved)
      text += fmt::format(" The first {} unresolved sites are marked.", num_sites_);
    if (poor_cells_.size() < num_poor_cells())
      text += fmt::format(" The first {} poor cells are marked.", poor_cells_.size());
    return text;
  }

  std::uint64_t num_shown_cells() const {
    std::uint64_t num = 0;
    for (const ViewCells& cells : view_.cells) num += cells.cells.size();
    return num;
  }

  std::string sections() const {
    std::string text;
    for (int axis = 0; axis < 3; ++axis) {
      const double at = 0.5 * (run_.surface.box.min[axis] + run_.surface.box.max[axis]);
      text += fmt::format(
          "<figure>{}<figcaption>{} = {:.4g}; {} to the right, {} up</figcaption>"
          "</figure>\n",
          section_svg(view_, run_, axis), "xyz"[axis], at, "yxx"[axis], "zzy"[axis]);
    }
    return text;
  }

  std::string statistics() const {
    if (!statistics_) return "";
    const double share = static_cast<double>(statistics_->num_core_cells) /
                         static_cast<double>(std::max<std::uint64_t>(statistics_->num_cells, 1));
    const std::string core =
        share < 0.005 ? ""
                      : fmt::format(
                            " The peaks are the cells of the lattice inside, {:.0f}% of all: "
                            "angles of 60° and 90°, ratio 0.645.",
                            100 * share);
    return fmt::format(
               "<section><h2>Quality of the cells</h2><p>Shares of all cells, on a logarithmic "
               "scale.{}</p>\n<div class=\"figures\"><figure><h3>Dihedral angles, {:.2f}° to "
               "{:.2f}°</h3>{}"
               "</figure>\n<figure><h3>Smallest dihedral angle of each cell{}</h3>{}</figure>\n"
               "<figure><h3>Radius-edge ratios, at most {:.4g}</h3>{}</figure>{}</div></section>\n",
               core, statistics_->min_dihedral_degrees, statistics_->max_dihedral_degrees,
               histogram_svg(statistics_->dihedral_angles, "°"), below_bound(),
               histogram_svg(statistics_->min_dihedral_angles, "°"),
               statistics_->max_radius_edge_ratio,
               histogram_svg(statistics_->radius_edge_ratios, ""), sizes()) +
           bodies_by_angle();
  }

  // Of several bodies, those with the smallest angles first.
  std::string bodies_by_angle() const {
    constexpr std::size_t kMostDrawn = 12;
    const std::vector<MeshStatistics>& bodies = statistics_->bodies;
    if (bodies.size() < 2) return "";
    std::vector<std::size_t> order(bodies.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, {}, [&](std::size_t b) {
      return bodies[b].num_cells > 0 ? bodies[b].min_dihedral_degrees : 180;
    });
    const std::size_t num = std::min(bodies.size(), kMostDrawn);
    std::string text = fmt::format(
        "<section><h2>Quality by body</h2><p>Smallest dihedral angle of each cell: {}.</p>\n"
        "<div class=\"figures\">",
        num < bodies.size() ? fmt::format("the {} bodies with the smallest angles, of {}", num,
                                          grouped(bodies.size()))
                            : "bodies with the smallest angles first");
    for (const std::size_t b : std::span(order).first(num)) {
      if (bodies[b].num_cells == 0) continue;
      text += fmt::format("<figure><h3>{}: {} cells, {:.2f}° to {:.2f}°</h3>{}</figure>\n",
                          html_text(view_.sheets.bodies[b].name), grouped(bodies[b].num_cells),
                          bodies[b].min_dihedral_degrees, bodies[b].max_dihedral_degrees,
                          histogram_svg(bodies[b].min_dihedral_angles, "°"));
    }
    return text + "</div></section>\n";
  }

  bool has_sizes() const { return !run_.parameters.sizes().is_uniform(); }

  // Of a mesh whose sizes vary.
  std::string sizes() const {
    if (!has_sizes()) return "";
    return fmt::format(
        "\n<figure><h3>Circumradius over the size asked for, at most {:.6g}</h3>{}</figure>\n"
        "<figure><h3>Cells by the size asked for</h3>{}</figure>",
        statistics_->max_radius_over_size, histogram_svg(statistics_->radii_over_size, ""),
        octaves_svg(statistics_->num_cells_by_octave));
  }

  std::string below_bound() const {
    if (run_.parameters.min_dihedral == 0) return "";
    return fmt::format(", {} below {}°", num_poor_cells() == 0 ? "none" : grouped(num_poor_cells()),
                       run_.parameters.min_dihedral);
  }

  std::string timeline() const {
    const std::string figure = timeline_svg(timeline_);
    if (figure.empty()) return "<p>The store has no timeline of this run.</p>";
    return fmt::format("<p>Over {} of work{}.</p>\n<div id=\"timeline\">{}</div>\n",
                       duration_text(seconds()), sittings(), figure);
  }
  double seconds() const {
    return timeline_.samples.empty()
               ? 0
               : static_cast<double>(timeline_.samples.back().milliseconds) / 1000;
  }
  std::string sittings() const {
    if (timeline_.samples.empty() || timeline_.samples.back().sitting == 0) return "";
    return fmt::format(", in {} sittings", timeline_.samples.back().sitting + 1);
  }

  std::string counts() const {
    return fmt::format(
        "<figure><h3>Leaves by visits</h3>{}</figure>\n"
        "<figure><h3>Leaves by level in the octree</h3>{}</figure>\n",
        counts_svg(view_.leaf_counts.by_visits, "visits"),
        counts_svg(view_.leaf_counts.by_level, "level"));
  }

  std::string facts() const {
    const SurfaceFacts& s = run_.surface;
    const RunParameters& p = run_.parameters;
    Rows surface = {
        {"file", s.file},
        {"triangles",
         fmt::format("{}, {} vertices", grouped(s.num_triangles), grouped(s.num_vertices))},
        {"topology",
         fmt::format("{} {}, Euler characteristic {}, genus {}", s.num_components,
                     s.num_components == 1 ? "component" : "components", s.euler_characteristic,
                     genus(s.num_components, s.euler_characteristic))},
        {"area, volume", fmt::format("{:.6g}, {:.6g}", s.area, s.volume)},
        {"bounding box",
         fmt::format("({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g})", s.box.min.x,
                     s.box.min.y, s.box.min.z, s.box.max.x, s.box.max.y, s.box.max.z)},
    };
    for (const std::string& note : s.notes) surface.emplace_back("repair", note);
    Rows run = {
        {"size λ", fmt::format("{}", p.size)},
        {"leaf capacity κ", grouped(p.leaf_capacity)},
        {"initialization", fmt::format("{}, seed {}", init_name(p.init), p.seed)},
        {"bounds", bounds_text(p)},
        {"phase", std::string(phase_name(run_.phase))},
        {"leaves", fmt::format("{}, of which {} are not empty",
                               grouped(view_.leaf_counts.num_leaves), grouped(num_nonempty()))},
        {"visits",
         fmt::format("{}, the last in epoch {}", grouped(run_.counts.num_visits), run_.epoch)},
        {"insertions", insertions_text(run_.counts.num_insertions)},
        {"deletions", grouped(run_.counts.num_deletions)},
        {"moves", grouped(run_.counts.num_moves)},
    };
    if (!timeline_.samples.empty()) run.emplace_back("time", time_text());
    if (memory_)
      run.emplace_back("memory", fmt::format("most {}, cap {}", mebibytes(memory_->peak_resident),
                                             mebibytes(memory_->cap)));
    Rows mesh = {{"tetrahedra", grouped(run_.counts.num_cells)},
                 {"vertices", grouped(run_.counts.num_points)},
                 {"unresolved", fmt::format("{} sites", grouped(run_.counts.num_unresolved))}};
    if (creases_ && creases_->length > 0)
      mesh.emplace_back("creases",
                        fmt::format("{} ({:.6g} long), {} kept; {} corners",
                                    grouped(creases_->kept.size()), creases_->length,
                                    kept_share_text(*creases_), grouped(creases_->num_corners)));
    if (statistics_) {
      const MeshStatistics& m = *statistics_;
      mesh.emplace_back("of the lattice core",
                        fmt::format("{} tetrahedra", grouped(m.num_core_cells)));
      mesh.emplace_back("volume", fmt::format("{:.6g}, {:+.2g}% of the input's", m.volume,
                                              100 * (m.volume - s.volume) / s.volume));
      mesh.emplace_back("dihedral angles", fmt::format("{:.3f}° to {:.3f}°", m.min_dihedral_degrees,
                                                       m.max_dihedral_degrees));
      if (run_.parameters.min_dihedral > 0)
        mesh.emplace_back("poor cells", locvol::poor_cells_text(m));
      const bool is_excused = keeps_creases(run_) && m.num_above_ratio > 0;
      mesh.emplace_back("radius-edge ratio",
                        fmt::format("at most {:.4f}",
                                    is_excused ? m.max_bounded_ratio : m.max_radius_edge_ratio));
      if (is_excused) mesh.emplace_back("slender cells", excused_cells_text(m, run_));
      mesh.emplace_back("circumradius", fmt::format("at most {:.4f} λ", m.max_circumradius));
      if (has_sizes()) add_sizes(mesh);
    }
    return table("Surface", surface) + table("Mesh", mesh) + table("Run", run) + bodies() +
           sheets() + sites() + poor_cells();
  }

  void add_sizes(Rows& mesh) const {
    mesh.emplace_back("over the size", fmt::format("circumradius at most {:.6g} of the size there",
                                                   statistics_->max_radius_over_size));
    mesh.emplace_back("neighbors", neighbors_text(*statistics_));
    mesh.emplace_back("uniform", uniform_text(run_, run_.counts.num_cells));
  }

  std::uint64_t num_nonempty() const {
    std::uint64_t num = 0;
    for (const auto& [level, count] : view_.leaf_counts.by_level) num += count;
    return num;
  }

  std::string time_text() const {
    const auto stages = milliseconds_by_stage(timeline_);
    std::string text = duration_text(seconds()) + sittings() + ":";
    for (std::size_t i = 0; i < stages.size(); ++i)
      text += fmt::format("{} {} {:.1f} s", i == 0 ? "" : ",", stage_name(static_cast<RunStage>(i)),
                          static_cast<double>(stages[i]) / 1000);
    return text;
  }
  static std::string mebibytes(std::uint64_t bytes) {
    return fmt::format("{:.1f} MiB", static_cast<double>(bytes) / (1 << 20));
  }

  std::string bodies() const {
    constexpr std::size_t kMaxListed = 50;
    const std::vector<BodyFacts>& all = view_.sheets.bodies;
    if (all.size() < 2) return "";
    Rows rows;
    for (std::size_t b = 0; b < std::min(all.size(), kMaxListed); ++b)
      rows.emplace_back(fmt::format("{} {}", b + 1, all[b].name),
                        statistics_ ? body_text(all[b], statistics_->bodies.at(b))
                                    : fmt::format("volume {:.6g} of the input", all[b].volume));
    if (all.size() > kMaxListed)
      rows.emplace_back("", fmt::format("and {} more: locvol inspect DIR --json",
                                        grouped(all.size() - kMaxListed)));
    return table("Bodies", rows);
  }

  std::string sheets() const {
    constexpr std::size_t kMaxListed = 50;
    if (!sheets_) return "";
    Rows rows;
    for (const SheetRow& row :
         std::span(sheets_->rows).first(std::min(sheets_->rows.size(), kMaxListed)))
      rows.emplace_back(fmt::format("{} {}", rows.size() + 1, row.surface.name), sheet_text(row));
    if (sheets_->rows.size() > rows.size())
      rows.emplace_back("", fmt::format("and {} more: locvol inspect DIR --faces",
                                        grouped(sheets_->rows.size() - rows.size())));
    return table("Sheets", rows);
  }

  std::string sites() const {
    constexpr std::size_t kMaxListed = 20;
    if (num_sites_ == 0) return "";
    Rows rows;
    for (std::size_t i = 0; i < std::min(num_sites_, kMaxListed); ++i) {
      const UnresolvedSite& site = view_.sites[i].site;
      rows.emplace_back(
          fmt::format("C{}", site.condition),
          fmt::format("({:.6g}, {:.6g}, {:.6g}), radius {:.4g} λ", site.position.x, site.position.y,
                      site.position.z, site.radius / run_.parameters.size));
    }
    if (run_.counts.num_unresolved > rows.size())
      rows.emplace_back("", fmt::format("and {} more: locvol inspect DIR --unresolved",
                                        grouped(run_.counts.num_unresolved - rows.size())));
    return table("Unresolved sites", rows);
  }

  std::string poor_cells() const {
    constexpr std::size_t kMaxListed = 20;
    if (poor_cells_.empty()) return "";
    Rows rows;
    for (std::size_t i = 0; i < std::min(poor_cells_.size(), kMaxListed); ++i) {
      const auto& [leaf, position, radius, degrees, is_forced] = poor_cells_[i];
      rows.emplace_back(fmt::format("{:.3g}°", degrees),
                        fmt::format("({:.6g}, {:.6g}, {:.6g}), radius {:.4g} λ{}", position.x,
                                    position.y, position.z, radius / run_.parameters.size,
                                    is_forced ? ", forced by a wall or crease" : ""));
    }
    if (num_poor_cells() > rows.size())
      rows.emplace_back("", fmt::format("and {} more: locvol inspect DIR --unresolved",
                                        grouped(num_poor_cells() - rows.size())));
    return table("Poor cells", rows);
  }

  static std::string table(std::string_view caption, const Rows& rows) {
    std::string text = fmt::format("<table><caption>{}</caption>\n", caption);
    for (const auto& [name, value] : rows)
      text += fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", html_text(name), html_text(value));
    return text + "</table>\n";
  }

  std::string footer() const {
    return "Written by locvol report from the store of the run alone. C1 to C7 are the conditions "
           "that a "
           "visit restores: C1 to C4 of the boundary, C5 of circumradii, C6 of radius-edge ratios, "
           "C7 of dihedral angles.";
  }

  static std::string three() {
    if (three_library().empty()) return "";
    return fmt::format("<!-- {} -->\n<script>{}</script>\n<script>{}</script>\n", kThreeNotice,
                       three_library(), three_controls());
  }

  void put_data(PageFile& out) {
    if (three_library().empty()) return;
    const Json json =
        page_view(std::move(view_), run_, [&](const std::string& id, const std::string& text) {
          out.write(fmt::format("<script type=\"text/plain\" id=\"{}\">", id));
          out.write(text);
          out.write("</script>\n");
        });
    out.write(fmt::format("<script type=\"application/json\" id=\"view-data\">{}</script>\n",
                          script_text(json.dump())));
    out.write(fmt::format("<script>\n{}</script>\n", page_viewer()));
  }

  RunRecord run_;
  TimelineRecord timeline_;
  std::optional<MemoryRecord> memory_;
  std::optional<MeshStatistics> statistics_;
  std::optional<SheetTable> sheets_;
  std::optional<CreaseTable> creases_;
  MeshView view_;
  std::size_t num_sites_ = 0;             // unresolved ones in view_.sites; poor cells follow
  std::vector<LeafPoorCell> poor_cells_;  // as many as are marked
};

}  // namespace

PageSummary write_page(const Store& store, const std::filesystem::path& file,
                       const ViewLimits& limits, int num_threads, Exchange& exchange) {
  if (locvol::run_of(store).parameters.is_surface_only)
    throw InputError(
        "a page shows cells, and a run with --surface-only has none: look at its mesh, which "
        "`locvol export` writes");
  Page page(store, limits, num_threads, exchange);
  const bool is_first = exchange.rank() == 0;
  return is_first ? page.write(file) : PageSummary();
}

namespace {

ViewLimits limits_of(const ReportCommand& command) {
  ViewLimits limits;
  if (command.max_cells) limits.max_cells = *command.max_cells;
  return limits;
}

void tell_page(const ReportCommand& command, const PageSummary& page) {
  if (command.is_json) {
    print_json({{"file", command.output.string()},
                {"bytes", page.bytes},
                {"num_cells", page.num_mesh_cells},
                {"num_cells_shown", page.num_cells}});
  } else {
    fmt::print("{:<16} {}: {} of {} cells, {}\n", "written", command.output.string(),
               page.num_cells, page.num_mesh_cells, bytes_text(page.bytes));
  }
}

}  // namespace

int run_report(const ReportCommand& command) {
  require_writable(command.output);
  const Store store = open_whole(command.store);
  tell_page(command, write_page(store, command.output, limits_of(command),
                                num_streaming_threads(0, free_memory() / 2)));
  return kExitDone;
}

int run_report_as_rank(const ReportCommand& command, Exchange& exchange) {
  const bool is_first = exchange.rank() == 0;
  if (is_first) require_writable(command.output);
  const Store store = open_part(command.store, exchange);
  const std::uint64_t memory =
      free_memory() / 2 / static_cast<std::uint64_t>(num_ranks_here(exchange));
  const PageSummary page = write_page(store, command.output, limits_of(command),
                                      num_streaming_threads(0, memory), exchange);
  if (is_first) tell_page(command, page);
  return kExitDone;
}

}  // namespace locvol
