#include "tools/page/page_charts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "tools/arguments.h"
#include "tools/forecast.h"
#include "tools/results.h"

namespace locvol {
namespace {

constexpr std::string_view kBlue = "#3b6ea5";
constexpr std::array<std::string_view, kNumConditions> kConditionColors = {
    "#3b6ea5", "#e1812c", "#3a923a", "#c03d3e", "#8064a2", "#7f6a5a", "#1a9aa0"};

// -- Axes ----------------------------------------------------------------------------------------

// A number as people read it: 0.25, 12, 3.4k, 56M.
std::string short_text(double value) {
  constexpr std::array kSuffixes = {"", "k", "M", "G", "T"};
  std::size_t power = 0;
  while (std::abs(value) >= 1000 && power + 1 < kSuffixes.size()) {
    value /= 1000;
    ++power;
  }
  return fmt::format("{:.3g}{}", value, kSuffixes[power]);
}

// The least of 1, 2, 5 times a power of ten that cuts `range` into at most `most` parts.
double tick_step(double range, int most) {
  double step = std::pow(10, std::floor(std::log10(range / most)));
  for (const double factor : {1.0, 2.0, 5.0, 10.0})
    if (range / (step * factor) <= most) return step * factor;
  return 10 * step;
}

struct Rectangle {
  double left, top, width, height;
  double right() const { return left + width; }
  double bottom() const { return top + height; }
};

struct Scale {
  double low, high, from, to;  // values, and where on the picture they are
  double operator()(double value) const {
    return high > low ? from + (value - low) / (high - low) * (to - from) : from;
  }
};

std::string svg(double width, double height, std::string_view label, std::string_view content) {
  return fmt::format("<svg viewBox=\"0 0 {:g} {:g}\" role=\"img\" aria-label=\"{}\">{}</svg>\n",
                     width, height, html_text(label), content);
}

std::string line(double x1, double y1, double x2, double y2, std::string_view style) {
  return fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" class=\"{}\"/>",
                     x1, y1, x2, y2, style);
}

std::string text_at(double x, double y, std::string_view text, std::string_view anchor = "middle",
                    std::string_view style = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\"{}>{}</text>", x, y, anchor,
                     style.empty() ? "" : fmt::format(" class=\"{}\"", style), html_text(text));
}

std::string bar(double x, double y, double width, double height, std::string_view title) {
  return fmt::format(
      "<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\">"
      "<title>{}</title></rect>",
      x, y, std::max(width, 0.2), height, kBlue, html_text(title));
}

// -- Histograms ----------------------------------------------------------------------------------

constexpr double kChartWidth = 460, kChartHeight = 230;
constexpr Rectangle kPlot{56, 12, kChartWidth - 72, kChartHeight - 46};

// "12%", "0.03%"; below a thousandth of a percent "2·10⁻⁵%".
std::string percent_text(double share) {
  constexpr std::array kDigits = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  const double percent = 100 * share;
  if (percent >= 0.00099 || percent == 0) return fmt::format("{:.3g}%", percent);
  const int power = static_cast<int>(std::floor(std::log10(percent) + 1e-9));
  std::string exponent;
  for (const char c : std::to_string(-power))
    exponent.append(kDigits[static_cast<std::size_t>(c - '0')]);
  const std::string factor = fmt::format("{:.2g}", percent / std::pow(10, power));
  return fmt::format("{}10⁻{}%", factor == "1" ? "" : factor + "·", exponent);
}

struct CountBar {
  std::string label, title;
  std::uint64_t count = 0;
};

// `unit`: what is counted.
std::string bars_svg(std::span<const CountBar> bars, std::string_view name, std::string_view unit) {
  double most = 0;
  for (const CountBar& bar : bars) most = std::max(most, static_cast<double>(bar.count));
  const double slot = kPlot.width / static_cast<double>(std::max<std::size_t>(bars.size(), 4));
  const Scale y{0, most, kPlot.bottom(), kPlot.top + 14};
  std::string content = line(kPlot.left, kPlot.bottom(), kPlot.right(), kPlot.bottom(), "axis");
  const double step = std::max(1.0, tick_step(most, 5));
  for (double value = 0; value <= most; value += step)
    content += line(kPlot.left, y(value), kPlot.right(), y(value), "grid") +
               text_at(kPlot.left - 6, y(value) + 4, short_text(value), "end");
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const auto& [label, title, number] = bars[i];
    const double at = kPlot.left + slot * static_cast<double>(i);
    const auto count = static_cast<double>(number);
    if (number > 0)
      content += bar(at + 0.15 * slot, y(count), 0.7 * slot, kPlot.bottom() - y(count),
                     fmt::format("{}: {} {}", title, number, unit)) +
                 text_at(at + 0.5 * slot, y(count) - 4, short_text(count));
    if (number > 0 && (bars.size() <= 12 || i % 4 == 0))
      content += text_at(at + 0.5 * slot, kPlot.bottom() + 17, label);
  }
  return svg(kChartWidth, kChartHeight, name, content);
}

// The last edge that is shown: that after the last bin with something in it, or a little farther.
double last_edge(const Histogram& histogram, double step) {
  std::size_t last = histogram.counts.size();
  while (last > 1 && histogram.counts[last - 1] == 0) --last;
  return std::min(histogram.edges.back(), step * std::ceil(histogram.edges[last] / step - 1e-9));
}

std::string value_axis(const Scale& x, double step, std::string_view unit) {
  std::string axis = line(kPlot.left, kPlot.bottom(), kPlot.right(), kPlot.bottom(), "axis");
  for (double value = std::ceil(x.low / step - 1e-9) * step + 0.0; value <= x.high + 1e-9 * step;
       value += step)
    axis += line(x(value), kPlot.bottom(), x(value), kPlot.bottom() + 4, "axis") +
            text_at(x(value), kPlot.bottom() + 17, fmt::format("{:g}{}", value, unit));
  return axis;
}

}  // namespace

std::string html_text(std::string_view text) {
  std::string escaped;
  for (const char c : text) switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  return escaped;
}

std::string histogram_svg(const Histogram& histogram, std::string_view unit) {
  const auto total = static_cast<double>(std::max<std::uint64_t>(histogram.total(), 1));
  // From one in the total, or from a millionth of a percent, up to all.
  const int low = std::clamp(static_cast<int>(std::floor(std::log10(1 / total))), -8, -1);
  const double step = unit.empty() ? 0.2 : 20;
  const Scale x{histogram.edges.front(), last_edge(histogram, step), kPlot.left, kPlot.right()};
  const Scale y{static_cast<double>(low), 0, kPlot.bottom(), kPlot.top};
  std::string content;
  for (int power = low; power <= 0; ++power) {
    content += line(kPlot.left, y(power), kPlot.right(), y(power), "grid");
    if ((power - low) % (low < -5 ? 2 : 1) == 0)
      content += text_at(kPlot.left - 6, y(power) + 4, percent_text(std::pow(10, power)), "end");
  }
  for (std::size_t i = 0; i < histogram.counts.size(); ++i) {
    if (histogram.counts[i] == 0) continue;
    const auto count = static_cast<double>(histogram.counts[i]);
    const double top = y(std::max(std::log10(count / total), low + 0.05));
    const double from = x(histogram.edges[i]), to = x(histogram.edges[i + 1]);
    content += bar(from + 0.25, top, to - from - 0.5, kPlot.bottom() - top,
                   fmt::format("{:.4g}{} to {:.4g}{}: {} ({})", histogram.edges[i], unit,
                               histogram.edges[i + 1], unit, histogram.counts[i],
                               percent_text(count / total)));
  }
  content += value_axis(x, step, unit);
  return svg(kChartWidth, kChartHeight, "histogram", content);
}

std::string counts_svg(const std::map<std::uint64_t, std::uint64_t>& num_leaves_of,
                       std::string_view name) {
  constexpr std::uint64_t kMaxBars = 24;
  if (num_leaves_of.empty()) return "";
  const std::uint64_t first = num_leaves_of.begin()->first;
  const std::uint64_t per_bar = (num_leaves_of.rbegin()->first - first) / kMaxBars + 1;
  const std::uint64_t num = (num_leaves_of.rbegin()->first - first) / per_bar + 1;
  std::vector<CountBar> bars(num);
  for (std::uint64_t i = 0; i < num; ++i) {
    const std::uint64_t low = first + i * per_bar;
    bars[i].label =
        per_bar == 1 ? std::to_string(low) : fmt::format("{}–{}", low, low + per_bar - 1);
    bars[i].title = fmt::format("{} {}", name, bars[i].label);
  }
  for (const auto& [value, count] : num_leaves_of) bars[(value - first) / per_bar].count += count;
  return bars_svg(bars, fmt::format("leaves by {}", name), "leaves");
}

std::string octaves_svg(const std::map<int, std::uint64_t>& num_cells_by_octave) {
  std::vector<CountBar> bars;
  for (const auto& [octave, count] : num_cells_by_octave) {
    const double least = std::ldexp(1.0, octave);
    bars.push_back({fmt::format("{:.3g}", least),
                    fmt::format("size {:.3g} to {:.3g}", least, 2 * least), count});
  }
  return bars_svg(bars, "cells by size", "cells");
}

// -- Timeline ------------------------------------------------------------------------------------

namespace {

constexpr double kTimelineWidth = 960, kPanelHeight = 92, kPanelGap = 34, kTimelineTop = 44;

class TimelineFigure {
 public:
  explicit TimelineFigure(const TimelineRecord& timeline)
      : samples_(timeline.samples),
        x_{0, seconds(samples_.back()), kLeft, kTimelineWidth - kRight} {}

  std::string text() {
    add_stages();
    add_rate();
    add_memory();
    add_lines("leaves that wait",
              {{kBlue, "", [](const TimelineSample& s) { return s.num_queued; }}});
    add_lines("cells", {{kBlue, "", [](const TimelineSample& s) { return s.counts.num_cells; }}});
    add_insertions();
    const double bottom = top_ - kPanelGap + 12;
    add_sittings(bottom);
    add_time_axis(bottom);
    return svg(kTimelineWidth, bottom + 40, "timeline of the run", content_);
  }

 private:
  static constexpr double kLeft = 64, kRight = 130;

  struct Line {
    std::string_view color;
    std::string name;
    std::function<std::uint64_t(const TimelineSample&)> value;
  };

  static double seconds(const TimelineSample& sample) {
    return static_cast<double>(sample.milliseconds) / 1000;
  }

  Scale begin_panel(std::string_view title, double most,
                    const std::function<std::string(double)>& text) {
    const double high = most > 0 ? most : 1;
    const Scale y{0, high, top_ + kPanelHeight, top_};
    content_ += text_at(kLeft, top_ - 8, title, "start", "title");
    const double step = tick_step(high, 4);
    for (double value = 0; value <= high * (1 + 1e-9); value += step)
      content_ += line(kLeft, y(value), kTimelineWidth - kRight, y(value), "grid") +
                  text_at(kLeft - 6, y(value) + 4, text(value), "end");
    top_ += kPanelHeight + kPanelGap;
    return y;
  }

  // Vertices of a path, at least half a unit apart in x.
  void add_path(const std::vector<std::array<double, 2>>& points, std::string_view color,
                std::string_view extra = "") {
    std::string path;
    for (const auto& [px, py] : points)
      path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", px, py);
    content_ += fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\" {}/>",
                            path, color, extra);
  }

  void add_label(double y, std::string_view color, std::string_view text) {
    content_ +=
        fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" fill=\"{}\" style=\"fill:{}\">{}</text>",
                    kTimelineWidth - kRight + 8, y, color, color, html_text(text));
  }

  void add_stages() {
    constexpr std::array<std::string_view, 3> kFills = {"#dfe6ee", "#e9e2d3", "#dcead9"};
    for (std::size_t i = 0, first = 0; i < samples_.size(); ++i) {
      const RunStage stage = stage_of(samples_[i].phase);
      if (i + 1 < samples_.size() && stage_of(samples_[i + 1].phase) == stage) continue;
      const double from = first == 0 ? 0 : seconds(samples_[first - 1]);
      const double left = x_(from), right = x_(seconds(samples_[i]));
      content_ += fmt::format(
          "<rect x=\"{:.1f}\" y=\"4\" width=\"{:.1f}\" height=\"16\" fill=\"{}\"><title>{}: {:.1f} "
          "s</title></rect>",
          left, std::max(right - left, 0.5), kFills[static_cast<std::size_t>(stage)],
          stage_name(stage), seconds(samples_[i]) - from);
      if (right - left > 60) content_ += text_at((left + right) / 2, 16, stage_name(stage));
      first = i + 1;
    }
  }

  // Between two samples the same number of visits a second.
  void add_rate() {
    std::vector<std::array<double, 3>> rates;  // from, to, visits a second
    double from = 0;
    std::uint64_t before = 0;
    for (const TimelineSample& sample : samples_) {
      const double to = seconds(sample);
      // Commits that follow one another closely are taken together.
      if (to - from < 0.004 * x_.high && &sample != &samples_.back()) continue;
      if (to > from)
        rates.push_back(
            {from, to, static_cast<double>(sample.counts.num_visits - before) / (to - from)});
      from = to;
      before = sample.counts.num_visits;
    }
    double most = 0;
    for (const auto& rate : rates) most = std::max(most, rate[2]);
    const Scale y = begin_panel("visits to leaves, a second", most, short_text);
    std::vector<std::array<double, 2>> path;
    for (const auto& [start, end, rate] : rates) {
      path.push_back({x_(start), y(rate)});
      path.push_back({x_(end), y(rate)});
    }
    add_path(path, kBlue);
    const double total = static_cast<double>(samples_.back().counts.num_visits);
    add_label(y(0) - 4, kBlue, fmt::format("{} visits", short_text(total)));
  }

  void add_memory() {
    std::uint64_t peak = 0, cap = 0;
    for (const TimelineSample& sample : samples_) {
      peak = std::max(peak, sample.resident);
      cap = std::max(cap, sample.memory_cap);
    }
    const bool is_cap_near = cap < 6 * peak;
    const double most =
        is_cap_near ? 1.05 * static_cast<double>(cap) : 1.3 * static_cast<double>(peak);
    constexpr double kMiB = 1 << 20;
    const Scale y = begin_panel("memory of the process, MiB", most / kMiB,
                                [](double value) { return fmt::format("{:g}", value); });
    std::vector<std::array<double, 2>> path;
    for (const TimelineSample& sample : samples_)
      path.push_back({x_(seconds(sample)), y(static_cast<double>(sample.resident) / kMiB)});
    add_path(path, kBlue);
    const double last = y(static_cast<double>(samples_.back().resident) / kMiB);
    add_label(std::min(last + 4, y(0) - 4), kBlue,
              fmt::format("most {:.0f} MiB", static_cast<double>(peak) / kMiB));
    const auto last_cap = static_cast<double>(samples_.back().memory_cap);
    const std::string cap_text = fmt::format("cap {:.0f} MiB", last_cap / kMiB);
    if (!is_cap_near) return add_label(y(most / kMiB) + 4, "#b3261e", cap_text);
    std::vector<std::array<double, 2>> caps;
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      const double height = y(static_cast<double>(samples_[i].memory_cap) / kMiB);
      caps.push_back({i == 0 ? x_(0) : x_(seconds(samples_[i - 1])), height});
      caps.push_back({x_(seconds(samples_[i])), height});
    }
    add_path(caps, "#b3261e", "stroke-dasharray=\"5 3\"");
    add_label(caps.back()[1] + 4, "#b3261e", cap_text);
  }

  // `lines`: in order of their last values.
  void add_lines(std::string_view title, const std::vector<Line>& lines) {
    std::uint64_t most = 0;
    for (const Line& l : lines)
      for (const TimelineSample& sample : samples_) most = std::max(most, l.value(sample));
    const Scale y = begin_panel(title, static_cast<double>(most), short_text);
    double above = std::numeric_limits<double>::infinity();  // of the label before
    for (const Line& l : lines) {
      std::vector<std::array<double, 2>> path;
      for (const TimelineSample& sample : samples_)
        path.push_back({x_(seconds(sample)), y(static_cast<double>(l.value(sample)))});
      add_path(path, l.color);
      const auto last = static_cast<double>(l.value(samples_.back()));
      above = std::min(y(last) + 4, above - 12);
      add_label(above, l.color,
                l.name.empty() ? short_text(last) : fmt::format("{} {}", l.name, short_text(last)));
    }
  }

  void add_insertions() {
    std::vector<Line> lines;
    for (std::size_t c = 0; c < kNumConditions; ++c) {
      if (samples_.back().counts.num_insertions[c] == 0) continue;
      lines.push_back({kConditionColors[c], fmt::format("C{}", c + 1),
                       [c](const TimelineSample& s) { return s.counts.num_insertions[c]; }});
    }
    if (samples_.back().counts.num_deletions > 0)
      lines.push_back(
          {"#6b7280", "deleted", [](const TimelineSample& s) { return s.counts.num_deletions; }});
    if (samples_.back().counts.num_moves > 0)
      lines.push_back(
          {"#b5517f", "moved", [](const TimelineSample& s) { return s.counts.num_moves; }});
    std::ranges::sort(lines, {}, [&](const Line& l) { return l.value(samples_.back()); });
    add_lines(lines.empty() ? "points inserted: none" : "points inserted, by condition", lines);
  }

  void add_sittings(double bottom) {
    for (std::size_t i = 1; i < samples_.size(); ++i) {
      if (samples_[i].sitting == samples_[i - 1].sitting) continue;
      const double at = x_(seconds(samples_[i - 1]));
      content_ +=
          fmt::format("<g><title>sitting {} begins</title>{}{}</g>", samples_[i].sitting + 1,
                      line(at, 4, at, bottom, "sitting"),
                      text_at(at + 3, 32, fmt::format("sitting {}", samples_[i].sitting + 1),
                              "start", "sitting"));
    }
  }

  void add_time_axis(double bottom) {
    content_ += line(kLeft, bottom, kTimelineWidth - kRight, bottom, "axis");
    const double step = tick_step(x_.high, 10);
    for (double value = 0; value <= x_.high * (1 + 1e-9); value += step)
      content_ += line(x_(value), bottom, x_(value), bottom + 4, "axis") +
                  text_at(x_(value), bottom + 18,
                          x_.high >= 120 ? duration_text(value) : fmt::format("{:g}", value));
    content_ += text_at(kTimelineWidth - kRight + 8, bottom + 18,
                        x_.high >= 120 ? "h:min:s" : "seconds", "start");
  }

  std::span<const TimelineSample> samples_;
  Scale x_;
  double top_ = kTimelineTop;
  std::string content_;
};

}  // namespace

std::string timeline_svg(const TimelineRecord& timeline) {
  if (timeline.samples.size() < 2 || timeline.samples.back().milliseconds == 0) return "";
  return TimelineFigure(timeline).text();
}

// -- Sections ------------------------------------------------------------------------------------

namespace {

std::string level_fill(int level, int least, int most) {
  const double t = most > least ? static_cast<double>(level - least) / (most - least) : 0.2;
  const auto mix = [t](double from, double to) { return std::lround(from + t * (to - from)); };
  return fmt::format("rgb({},{},{})", mix(236, 120), mix(242, 170), mix(247, 212));
}

// Calls visit(triangle's corners) for the surface, or for the boundary of the cells.
void for_each_triangle(const MeshView& view,
                       const std::function<void(const std::array<Point, 3>&)>& visit) {
  for (const auto& [a, b, c] : view.surface.triangles)
    visit({view.surface.vertices[a], view.surface.vertices[b], view.surface.vertices[c]});
  for (const ViewCells& set : view.cells)
    for (std::size_t i = 0; i < set.boundary.size(); ++i)
      for (std::size_t opposite = 0; opposite < 4; ++opposite) {
        if ((set.boundary[i] >> opposite & 1) == 0) continue;
        std::array<Point, 3> corners;
        for (std::size_t k = 0, n = 0; k < 4; ++k)
          if (k != opposite) corners[n++] = set.vertices[set.cells[i][k]];
        visit(corners);
      }
}

}  // namespace

std::string section_svg(const MeshView& view, const RunRecord& run, int axis) {
  constexpr double kSide = 300, kMargin = 6;
  const Box& box = run.surface.box;
  const int u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  const double width = box.max[u] - box.min[u], height = box.max[v] - box.min[v];
  const double scale = (kSide - 2 * kMargin) / std::max({width, height, 1e-300});
  const auto x = [&](const Point& p) { return kMargin + (p[u] - box.min[u]) * scale; };
  const auto y = [&](const Point& p) { return kMargin + (box.max[v] - p[v]) * scale; };
  const double at = 0.5 * (box.min[axis] + box.max[axis]);

  int least = MortonKey::kMaxLevel, most = 0;
  for (const ViewLeaf& leaf : view.leaves) {
    least = std::min(least, leaf.key.level());
    most = std::max(most, leaf.key.level());
  }
  std::string content;
  for (const ViewLeaf& leaf : view.leaves) {
    const Box b = run.frame.box(leaf.key);
    if (!(b.min[axis] <= at && at < b.max[axis])) continue;
    content += fmt::format(
        "<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\" "
        "class=\"leaf\"><title>{}: level {}, {} cells, {} visits</title></rect>",
        x(b.min), y(b.max), (b.max[u] - b.min[u]) * scale, (b.max[v] - b.min[v]) * scale,
        level_fill(leaf.key.level(), least, most), key_text(leaf.key), leaf.key.level(),
        leaf.num_cells, leaf.num_visits);
  }
  std::string outline;
  for_each_triangle(view, [&](const std::array<Point, 3>& corners) {
    std::vector<Point> ends;
    for (std::size_t i = 0; i < 3; ++i) {
      const Point &p = corners[i], &q = corners[(i + 1) % 3];
      if ((p[axis] <= at) == (q[axis] <= at)) continue;
      ends.push_back(p + (at - p[axis]) / (q[axis] - p[axis]) * (q - p));
    }
    if (ends.size() == 2)
      outline += fmt::format("M{:.1f} {:.1f}L{:.1f} {:.1f}", x(ends[0]), y(ends[0]), x(ends[1]),
                             y(ends[1]));
  });
  content += fmt::format("<path d=\"{}\" class=\"outline\"/>", outline);
  for (const auto& [site, leaf] : view.sites)
    content += fmt::format(
        "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"2.5\" class=\"site\"><title>C{}, "
        "{}</title></circle>",
        x(site.position), y(site.position), site.condition, point_text(site.position));
  return svg(2 * kMargin + width * scale, 2 * kMargin + height * scale,
             fmt::format("section at {} = {:.4g}", "xyz"[axis], at), content);
}

}  // namespace locvol
