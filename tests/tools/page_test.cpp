// The page of `locvol report`: what is packed into it can be unpacked, it needs nothing else, and
// it stays small.
#include "tools/page/page.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <map>
#include <regex>
#include <sstream>

#include "storage/store.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/tools/process.h"
#include "tools/page/page_charts.h"
#include "tools/page/page_data.h"
#include "tools/page/page_resources.h"

namespace locvol {
namespace {

constexpr char kNoThree[] = "built without three.js (libjs-three). To run it: tools/test.sh";

// -- Undoing what page_data does ----------------------------------------------------------------

std::string from_base64(const std::string& text) {
  constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t bits = 0;
  int num_bits = 0;
  for (const char c : text) {
    if (c == '=') break;
    const std::size_t digit = kDigits.find(c);
    if (digit == std::string_view::npos) throw std::invalid_argument("not base64");
    bits = bits << 6 | static_cast<std::uint32_t>(digit);
    num_bits += 6;
    if (num_bits < 8) continue;
    num_bits -= 8;
    bytes += static_cast<char>(bits >> num_bits & 0xff);
  }
  return bytes;
}

std::string inflated(const std::string& bytes, std::size_t size) {
  std::string result(size + 1, '\0');
  uLongf length = result.size();
  EXPECT_EQ(uncompress(reinterpret_cast<Bytef*>(result.data()), &length,
                       reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()),
            Z_OK);
  result.resize(length);
  return result;
}

TEST(PageData, Base64IsThatOfTheStandard) {  // RFC 4648, section 10
  for (const auto& [bytes, text] : std::map<std::string, std::string>{{"", ""},
                                                                      {"f", "Zg=="},
                                                                      {"fo", "Zm8="},
                                                                      {"foo", "Zm9v"},
                                                                      {"foob", "Zm9vYg=="},
                                                                      {"fooba", "Zm9vYmE="},
                                                                      {"foobar", "Zm9vYmFy"}})
    EXPECT_EQ(base64(bytes), text);
  EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

TEST(PageData, DeflatedBytesComeBack) {
  std::string bytes;
  for (unsigned i = 0; i < 100'000; ++i) bytes += static_cast<char>(i * i % 251);
  EXPECT_EQ(inflated(deflated(bytes), bytes.size()), bytes);
  EXPECT_EQ(inflated(deflated(""), 0), "");
}

TEST(PageData, PositionsAreStepsModulo65536) {
  const PageGrid grid({{-1, 0, 2}, {1, 1, 2}});
  EXPECT_DOUBLE_EQ(grid.step(), 2.0 / 65535);
  const std::vector<Point> points = {{1, 0, 2}, {-1, 1, 2}, {7, -5, 2}};  // the last is outside
  const std::string packed = packed_positions(points, grid);
  ASSERT_EQ(packed.size(), 18U);
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(packed[i]); };
  const std::array<std::array<unsigned, 3>, 3> expected = {
      {{65535, 0, 65535}, {0, 32768, 0}, {0, 0, 0}}};
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t i = 0, value = 0; i < 3; ++i) {
      value = (value + byte(6 * axis + i) + 256U * byte(6 * axis + 3 + i)) % 65536;
      EXPECT_EQ(value, expected[axis][i]) << axis << ' ' << i;
    }
}

TEST(PageData, ReferencesCountBackFromTheNewestVertex) {
  const std::vector<std::array<std::uint32_t, 4>> cells = {
      {0, 1, 2, 3}, {1, 2, 3, 4}, {4, 0, 2, 1}};
  const std::string packed =
      packed_references(std::span<const std::array<std::uint32_t, 4>>(cells));
  ASSERT_EQ(packed.size(), 4U * 4 * 3);
  const std::array<std::array<int, 3>, 4> lowest = {{{0, 3, 1}, {0, 2, 5}, {0, 1, 3}, {0, 0, 4}}};
  for (std::size_t corner = 0; corner < 4; ++corner)
    for (std::size_t cell = 0; cell < 3; ++cell) {
      EXPECT_EQ(packed[12 * corner + cell], lowest[corner][cell]);
      for (std::size_t plane = 1; plane < 4; ++plane)
        EXPECT_EQ(packed[12 * corner + 3 * plane + cell], 0);
    }
}

TEST(PageData, LevelsAreClampedAndNeverNaN) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const std::vector<float> values = {0, 75, 37.5F, -3, kInfinity, std::nanf("")};
  EXPECT_EQ(packed_levels(values, 0, 75), std::string("\x00\xff\x80\x00\xff\x00", 6));
}

TEST(PageCharts, EscapesWhatItIsGiven) {
  EXPECT_EQ(html_text("a<b> & \"c\""), "a&lt;b&gt; &amp; &quot;c&quot;");
  const Histogram histogram{{0, 1, 2}, {3, 1}};
  EXPECT_NE(histogram_svg(histogram, "").find("0 to 1: 3 (75%)"), std::string::npos);
  EXPECT_EQ(timeline_svg({}), "");
}

// -- Whole pages ---------------------------------------------------------------------------------

// A mesh of a ball in a store, and pages about it.
class PageTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    dir_ = new TempDir;
    run_locvol({"generate", "sphere", "-o", path("a <b> & c.stl"), "--triangles", "3k"});
    const ProcessResult result =
        run_locvol({"mesh", path("a <b> & c.stl"), "-o", path("s.vtu"), "--size", "4%",
                    "--leaf-capacity", "800", "--store", path("store"), "--quiet"});
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  static void TearDownTestSuite() { delete dir_; }

  static std::string path(const std::string& name) { return (*dir_ / name).string(); }
  static std::string report(const std::vector<std::string>& options = {}) {
    std::vector<std::string> arguments = {"report", path("store"), "-o", path("page.html")};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const ProcessResult result = run_locvol(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return bytes_of(path("page.html"));
  }

  static TempDir* dir_;
};
TempDir* PageTest::dir_ = nullptr;

std::string without(std::string text, std::string_view part) {
  const std::size_t at = part.empty() ? std::string::npos : text.find(part);
  if (at != std::string::npos) text.erase(at, part.size());
  return text;
}

std::string element(const std::string& page, const std::string& id) {
  const std::string mark = "id=\"" + id + "\">";
  const std::size_t begin = page.find(mark);
  if (begin == std::string::npos) return "";
  EXPECT_EQ(page.find(mark, begin + 1), std::string::npos) << id << " is there twice";
  const std::size_t from = begin + mark.size();
  return page.substr(from, page.find("</script>", from) - from);
}

TEST_F(PageTest, NeedsNothingFromElsewhere) {
  std::string page = without(without(report(), three_library()), three_controls());
  EXPECT_TRUE(page.starts_with("<!DOCTYPE html>"));
  EXPECT_TRUE(page.ends_with("</html>\n"));
  for (const char* text : {"http:", "https:", "src=", "@import", "url(", "fetch(", "XMLHttp",
                           "import(", "{{", "}}\n<"})
    EXPECT_EQ(page.find(text), std::string::npos) << text;
  const std::regex link("href=\"(?!data:,\")");
  EXPECT_FALSE(std::regex_search(page.substr(0, page.find("<script")), link));
}

TEST_F(PageTest, NamesTheSurfaceEscaped) {
  const std::string page = report();
  EXPECT_NE(page.find("<h1>a &lt;b&gt; &amp; c.stl</h1>"), std::string::npos);
  EXPECT_EQ(page.find("<b>"), std::string::npos);
}

TEST_F(PageTest, HoldsAllCellsAndTheirLeaves) {
  if (three_library().empty()) GTEST_SKIP() << kNoThree;
  const std::string page = report();
  const Json view = Json::parse(element(page, "view-data"));
  EXPECT_TRUE(view["is_done"]);
  ASSERT_EQ(view["cells"].size(), 1U);
  const Json& set = view["cells"][0];
  EXPECT_EQ(set["axis"], -1);
  const auto num_cells = set["num_cells"].get<std::uint64_t>();
  const auto num_vertices = set["num_vertices"].get<std::uint64_t>();
  EXPECT_GT(num_cells, 5000U);
  const auto bytes_of = [&](const char* name) {
    return inflated(from_base64(element(page, set[name])), 1 << 22).size();
  };
  EXPECT_EQ(bytes_of("vertices"), 6 * num_vertices);
  EXPECT_EQ(bytes_of("cells"), 16 * num_cells);
  EXPECT_EQ(bytes_of("min_dihedral_degrees"), num_cells);
  EXPECT_EQ(bytes_of("radius_edge_ratios"), num_cells);
  EXPECT_EQ(bytes_of("boundary"), num_cells);
  std::uint64_t num_in_leaves = 0;
  for (const Json& count : view["leaves"]["cells"]) num_in_leaves += count.get<std::uint64_t>();
  EXPECT_EQ(num_in_leaves, num_cells);
  for (const char* field : {"key", "level", "state", "visits"})
    EXPECT_EQ(view["leaves"][field].size(), view["leaves"]["cells"].size()) << field;
}

TEST_F(PageTest, ColorsCellsBySizeWhereSizesVary) {
  EXPECT_EQ(report().find("Cells by the size asked for"), std::string::npos);
  const ProcessResult result =
      run_locvol({"mesh", path("a <b> & c.stl"), "-o", path("g.vtu"), "--size", "4%", "--growth",
                  "0.3", "--store", path("graded"), "--quiet"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  ASSERT_EQ(run_locvol({"report", path("graded"), "-o", path("g.html")}).exit_code, 0);
  const std::string page = bytes_of(path("g.html"));
  for (const char* text : {"Circumradius over the size asked for, at most 0.9",
                           "Cells by the size asked for", "times as many", "each other's"})
    EXPECT_NE(page.find(text), std::string::npos) << text;
  if (three_library().empty()) GTEST_SKIP() << kNoThree;
  EXPECT_FALSE(Json::parse(element(report(), "view-data")).contains("radius_octaves"));
  const Json view = Json::parse(element(page, "view-data"));
  ASSERT_EQ(view["cells"].size(), 1U);
  const std::string levels =
      inflated(from_base64(element(page, view["cells"][0]["circumradii"])), 1 << 22);
  EXPECT_EQ(levels.size(), view["cells"][0]["num_cells"].get<std::size_t>());
  const auto [least, most] =
      std::ranges::minmax(levels, {}, [](char c) { return static_cast<unsigned char>(c); });
  EXPECT_EQ(least, '\0');
  EXPECT_EQ(most, '\xff');
  const double low = view["radius_octaves"][0], high = view["radius_octaves"][1];
  EXPECT_GT(high - low, 1);
  EXPECT_LT(high - low, 4);
}

TEST_F(PageTest, StaysSmallWhateverTheMesh) {
  const std::size_t whole = report().size();
  EXPECT_LT(report({"--cells", "10"}).size(), whole);
  const std::string page = report({"--cells", "15000"});
  EXPECT_LT(page.size(), whole);
  EXPECT_NE(page.find("planes across the axes"), std::string::npos);
  if (three_library().empty()) GTEST_SKIP() << kNoThree;
  const Json view = Json::parse(element(page, "view-data"));
  std::uint64_t num_cells = 0;
  for (const Json& set : view["cells"]) num_cells += set["num_cells"].get<std::uint64_t>();
  EXPECT_GT(num_cells, 3000U);
  EXPECT_LE(num_cells, 15000U);
  EXPECT_GT(view["surface"]["num_triangles"], 2000);
}

TEST_F(PageTest, HasFiguresThatNeedNoScript) {
  const std::string page = report();
  const std::string still = page.substr(0, page.find("<script"));
  std::size_t num_figures = 0;
  for (std::size_t at = 0; (at = still.find("<svg viewBox", at + 1)) != std::string::npos;)
    ++num_figures;
  EXPECT_EQ(num_figures, 3U + 3 + 1 + 2);  // sections, histograms, timeline, leaves
  for (const char* text : {"Dihedral angles", "visits to leaves, a second", "memory of the process",
                           "Leaves by visits", "radius-edge ratio"})
    EXPECT_NE(still.find(text), std::string::npos) << text;
  for (const char* text : {"nan", "inf\"", "-0°"}) EXPECT_EQ(still.find(text), std::string::npos);
}

// Of a mesh made without a bound on angles, in a store that says there was one.
TEST_F(PageTest, MarksPoorCells) {
  const std::string page = report();
  EXPECT_NE(page.find("Smallest dihedral angle of each cell, none below 15°"), std::string::npos);
  EXPECT_EQ(page.find("Poor cells"), std::string::npos);
  const ProcessResult meshed = run_locvol({"mesh", path("a <b> & c.stl"), "-o", path("p.vtu"), "-s",
                                           "8%", "--store", path("poor"), "--min-dihedral", "0"});
  ASSERT_EQ(meshed.exit_code, 0) << meshed.err;
  {
    Store store = Store::open(path("poor"));
    Batch batch = store.begin();
    RunRecord run = batch.run().value();
    run.parameters.min_dihedral = 15;
    batch.put_run(run);
    batch.commit();
  }
  ASSERT_EQ(run_locvol({"report", path("poor"), "-o", path("poor.html")}).exit_code, 0);
  const std::string poor = bytes_of(path("poor.html"));
  const ProcessResult inspected = run_locvol({"inspect", path("poor"), "--json"});
  const auto num = Json::parse(inspected.out)["statistics"]["num_poor_cells"].get<std::uint64_t>();
  ASSERT_GT(num, 1U);
  ASSERT_LT(num, 1000U);  // one group of digits
  const std::string count = std::to_string(num);
  for (const std::string& text :
       {"<strong>" + count + " cells have a dihedral angle below 15°</strong>",
        "Smallest dihedral angle of each cell, " + count + " below 15°",
        "unresolved sites (0), poor cells (" + count + ")",
        std::string("Dots are poor cells, wherever"), std::string("<caption>Poor cells</caption>"),
        std::string("<title>C7, (")})
    EXPECT_NE(poor.find(text), std::string::npos) << text;
  if (three_library().empty()) GTEST_SKIP() << kNoThree;
  EXPECT_EQ(Json::parse(element(poor, "view-data"))["sites"].size(), num);
}

TEST_F(PageTest, PrintsWhatItWrote) {
  const ProcessResult result =
      run_locvol({"report", path("store"), "-o", path("page.html"), "--json"});
  const Json json = Json::parse(result.out);
  EXPECT_EQ(json["num_cells"], json["num_cells_shown"]);
  EXPECT_EQ(json["bytes"], std::filesystem::file_size(path("page.html")));
}

TEST_F(PageTest, RefusesWhatItCannotShow) {
  ProcessResult result = run_locvol({"report", path("no-store"), "-o", path("page.html")});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("no-store"), std::string::npos) << result.err;
  result = run_locvol({"report", path("store"), "-o", path("page.txt")});
  EXPECT_EQ(result.exit_code, 2);
  result = run_locvol({"report", path("store"), "-o", path("no-directory/page.html")});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("no-directory"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace locvol
