#include "engine/ingest/size_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "engine/shared/input_error.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

class SizeFile : public testing::Test {
 protected:
  GivenSizes read(const std::string& text) const {
    std::ofstream(file()) << text;
    return read_size_file(file());
  }
  std::string refusal_of(const std::string& text) const {
    try {
      read(text);
    } catch (const InputError& e) {
      return e.what();
    }
    return "not refused";
  }
  std::filesystem::path file() const { return dir_ / "sizes"; }

 private:
  const TempDir dir_;
};

void expect_all_kinds(const GivenSizes& sizes) {
  const std::vector<SizedShape>& shapes = sizes.shapes;
  const std::vector<SizedShape> all = {SizedShape::ball({0.1}, {1, 2, 3}),
                                       SizedShape::ball(Size::percent(2), {0, 0, 0}, 4.5),
                                       SizedShape::box({0.2}, {1, 0, 0}, {-1, 2, 3}),
                                       SizedShape::segment({0.3}, {0, 0, 0}, {1, 0, 0}),
                                       SizedShape::segment({0.3}, {1, 0, 0}, {1, 1, 0})};
  ASSERT_EQ(shapes.size(), all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ(shapes[i].kind, all[i].kind) << i;
    EXPECT_EQ(shapes[i].size.value, all[i].size.value) << i;
    EXPECT_EQ(shapes[i].size.is_percent, all[i].size.is_percent) << i;
    EXPECT_EQ(shapes[i].a, all[i].a) << i;
    EXPECT_EQ(shapes[i].b, all[i].b) << i;
    EXPECT_EQ(shapes[i].radius, all[i].radius) << i;
  }
  ASSERT_EQ(sizes.sheets.size(), 1U);
  EXPECT_EQ(sizes.sheets[0].name, "inlet pipe 2");
  EXPECT_EQ(sizes.sheets[0].size.value, 0.5);
  EXPECT_TRUE(sizes.sheets[0].size.is_percent);
  ASSERT_EQ(sizes.bodies.size(), 1U);
  EXPECT_EQ(sizes.bodies[0].name, "rotor 1");
  EXPECT_EQ(sizes.bodies[0].size.value, 2);
}

TEST_F(SizeFile, ReadsAllKindsAsText) {
  const GivenSizes sizes = read(
      "# sizes\n"
      "point 0.1  1 2 3\n"
      "ball 2%  0 0 0  4.5   # a comment\r\n"
      "\n"
      "box 0.2  1 0 0  -1 2 3\n"
      "line 3e-1  0 0 0  1 0 0  1 1 0\n"
      "sheet 0.5%  inlet pipe  2  # a name\n"
      "body 2% rotor 1");
  expect_all_kinds(sizes);
  EXPECT_NE(sizes.shapes[2].place.find("line 5"), std::string::npos) << sizes.shapes[2].place;
  EXPECT_NE(sizes.sheets[0].place.find("line 7"), std::string::npos) << sizes.sheets[0].place;
}

TEST_F(SizeFile, ReadsAllKindsAsJson) {
  const GivenSizes sizes = read(R"( {"shapes": [
      {"kind": "point", "size": 0.1, "points": [[1, 2, 3]]},
      {"kind": "ball", "size": "2%", "points": [[0, 0, 0]], "radius": 4.5},
      {"kind": "box", "size": 0.2, "points": [[1, 0, 0], [-1, 2, 3]]},
      {"kind": "line", "size": 0.3, "points": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]},
      {"kind": "sheet", "size": "0.5%", "name": "inlet pipe 2"},
      {"kind": "body", "size": "2%", "name": "rotor 1"}]})");
  expect_all_kinds(sizes);
  EXPECT_NE(sizes.shapes[2].place.find("shape 3"), std::string::npos) << sizes.shapes[2].place;
}

TEST_F(SizeFile, NamesTheLineThatIsBad) {
  const std::string good = "point 0.1 0 0 0\n";
  for (const auto& [line, words] : {std::pair{"point 0 1 2 3", "above 0"},
                                    {"point -1 1 2 3", "above 0"},
                                    {"point nan 1 2 3", "nan"},
                                    {"point 1e999 1 2 3", "1e999"},
                                    {"point 0.1 1 2", "the z is missing"},
                                    {"point 0.1 1 2 3 4", "more numbers"},
                                    {"point 0.1", "a point of 0 points"},
                                    {"point", "the size is missing"},
                                    {"point 0.1 1 two 3", "two"},
                                    {"ball 0.1 1 2 3", "without a radius"},
                                    {"ball 0.1 1 2 3 -4", "radius -4"},
                                    {"box 0.1 1 2 3", "a box of 1 points"},
                                    {"line 0.1 1 2 3", "a line of 1 points"},
                                    {"line 0.1 1 2 3 4 5", "the z is missing"},
                                    {"sheet 0.1", "without a name"},
                                    {"body 0.1", "a body without a name"},
                                    {"sheet inlet 0.1", "inlet"},
                                    {"cone 0.1 1 2 3", "'cone' is no shape"}}) {
    const std::string refusal = refusal_of(good + line + "\n" + good);
    EXPECT_NE(refusal.find("line 2"), std::string::npos) << line << ": " << refusal;
    EXPECT_NE(refusal.find(words), std::string::npos) << line << ": " << refusal;
  }
}

TEST_F(SizeFile, NamesTheShapeThatIsBad) {
  const std::string good = R"({"kind": "point", "size": 1, "points": [[0, 0, 0]]})";
  for (const auto& [shape, words] :
       {std::pair{R"({"kind": "point", "size": -1, "points": [[0, 0, 0]]})", "above 0"},
        {R"({"kind": "point", "size": "1", "points": [[0, 0, 0]]})", "no size"},
        {R"({"kind": "point", "size": "%", "points": [[0, 0, 0]]})", "no size"},
        {R"({"kind": "point", "size": 1, "points": [[0, 0]]})", "three coordinates"},
        {R"({"kind": "point", "size": 1, "points": [[0, 0, "a"]]})", "no number"},
        {R"({"kind": "point", "size": 1, "points": []})", "a point of 0 points"},
        {R"({"kind": "ball", "size": 1, "points": [[0, 0, 0]]})", "without a radius"},
        {R"({"kind": "point", "size": 1, "points": [[0, 0, 0]], "radius": 1})", "with a radius"},
        {R"({"kind": "point", "sise": 1, "points": [[0, 0, 0]]})", "'sise' is unknown"},
        {R"({"kind": "cone", "size": 1, "points": [[0, 0, 0]]})", "no shape"},
        {R"({"size": 1})", "give its kind"},
        {R"({"kind": "sheet", "size": 1})", "its name"},
        {R"({"kind": "sheet", "size": 1, "name": ""})", "without a name"},
        {R"({"kind": "sheet", "size": 1, "name": "a", "points": [[0, 0, 0]]})", "with points"},
        {R"({"kind": "body", "size": 1, "name": "a", "radius": 1})", "a body with points or"},
        {R"({"kind": "point", "size": 1, "name": "a", "points": [[0, 0, 0]]})", "with a name"},
        {"7", "no object"}}) {
    const std::string refusal = refusal_of("{\"shapes\": [" + good + ", " + shape + "]}");
    EXPECT_NE(refusal.find("shape 2"), std::string::npos) << shape << ": " << refusal;
    EXPECT_NE(refusal.find(words), std::string::npos) << shape << ": " << refusal;
  }
}

TEST_F(SizeFile, RefusesWhatIsNoListOfShapes) {
  for (const auto& [text, words] : {std::pair{"", "no shape in it"},
                                    {"# nothing\n\n", "no shape in it"},
                                    {R"({"shapes": []})", "no shape in it"},
                                    {R"({"shapes": 3})", "no list"},
                                    {R"({"a": [1]})", "no list"},
                                    {R"({"shapes": [)", "no valid JSON"}}) {
    const std::string refusal = refusal_of(text);
    EXPECT_NE(refusal.find(words), std::string::npos) << text << ": " << refusal;
  }
  EXPECT_THROW(read_size_file(file().parent_path() / "missing"), InputError);
  EXPECT_THROW(read_size_file(file().parent_path()), InputError);
}

}  // namespace
}  // namespace locvol
