#include "tools/arguments.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <stdexcept>

#include "engine/plan/run_setup.h"
#include "tests/temp_dir.h"

namespace locvol {
namespace {

TEST(ParseSize, TakesLengthsAndPercentages) {
  EXPECT_EQ(parse_size("0.01").value, 0.01);
  EXPECT_FALSE(parse_size("0.01").is_percent);
  EXPECT_EQ(parse_size("2%").value, 2);
  EXPECT_TRUE(parse_size("2%").is_percent);
  EXPECT_EQ(parse_size("1e-3").value, 1e-3);
}

class BadSize : public testing::TestWithParam<const char*> {};

TEST_P(BadSize, IsRefused) { EXPECT_THROW(parse_size(GetParam()), std::invalid_argument); }

INSTANTIATE_TEST_SUITE_P(ParseSize, BadSize,
                         testing::Values("", "%", "0", "0%", "-1", "-2%", "nan", "inf", "1e999",
                                         "2 %", "2%%", "0.01m", "0x10", " 1"));

TEST(ParseCount, TakesSuffixes) {
  EXPECT_EQ(parse_count("1"), 1u);
  EXPECT_EQ(parse_count("50000"), 50'000u);
  EXPECT_EQ(parse_count("50k"), 50'000u);
  EXPECT_EQ(parse_count("1.5M"), 1'500'000u);
  EXPECT_EQ(parse_count("2G"), 2'000'000'000u);
}

class BadCount : public testing::TestWithParam<const char*> {};

TEST_P(BadCount, IsRefused) { EXPECT_THROW(parse_count(GetParam()), std::invalid_argument); }

INSTANTIATE_TEST_SUITE_P(ParseCount, BadCount,
                         testing::Values("", "k", "0", "-5", "1.5", "0.0001k", "nan", "inf", "10kk",
                                         "1e300", "9007199254740992"));

TEST(ParseMemory, TakesPowersOf1024) {
  EXPECT_EQ(parse_memory("1"), 1u);
  EXPECT_EQ(parse_memory("64K"), 65'536u);
  EXPECT_EQ(parse_memory("512M"), 536'870'912u);
  EXPECT_EQ(parse_memory("512MiB"), 536'870'912u);
  EXPECT_EQ(parse_memory("1.5G"), 1'610'612'736u);
  EXPECT_EQ(parse_memory("1T"), std::uint64_t{1} << 40);
}

TEST(ParseMemory, TakesAPercentageOfWhatIsFree) {
  const auto all = static_cast<double>(parse_memory("100%"));
  EXPECT_NEAR(static_cast<double>(parse_memory("25%")), all / 4, all / 10);
}

class BadMemory : public testing::TestWithParam<const char*> {};

TEST_P(BadMemory, IsRefused) { EXPECT_THROW(parse_memory(GetParam()), std::invalid_argument); }

INSTANTIATE_TEST_SUITE_P(ParseMemory, BadMemory,
                         testing::Values("", "M", "iB", "512iB", "0", "-1G", "101%", "0%", "nanM",
                                         "1X", "1MM", "1e30", "512 M"));

TEST(ParseNumber, LiesInTheOptionsRange) {
  const OptionText angle{.name = {"--angle", "angle"}, .noun = "angle", .range = {0, 40}};
  EXPECT_EQ(parse_number("0", angle), 0);
  EXPECT_EQ(parse_number("17.5", angle), 17.5);
  EXPECT_EQ(parse_number("40", angle), 40);
  for (const char* text : {"", "-1", "40.5", "50", "x", "15°", "nan", "inf", "2%"})
    EXPECT_THROW(parse_number(text, angle), std::invalid_argument) << text;
  try {
    parse_number("50", angle);
  } catch (const std::invalid_argument& e) {
    EXPECT_STREQ(e.what(), "'50' is no angle: give a number from 0 to 40");
  }
}

TEST(ParseSeed, TakesAll64Bits) {
  EXPECT_EQ(parse_seed("0"), 0u);
  EXPECT_EQ(parse_seed("18446744073709551615"), ~std::uint64_t{0});
  for (const char* text : {"", "-1", "1.5", "18446744073709551616", "x"}) {
    EXPECT_THROW(parse_seed(text), std::invalid_argument) << text;
  }
}

TEST(ParseInit, KnowsTwo) {
  EXPECT_EQ(parse_init("cover"), Initialization::kCover);
  EXPECT_EQ(parse_init("paper"), Initialization::kPaper);
  EXPECT_THROW(parse_init("Cover"), std::invalid_argument);
}

TEST(ParseThreads, TakesAWholeNumberThatCanBeMeant) {
  EXPECT_EQ(parse_threads("1"), 1);
  EXPECT_EQ(parse_threads("1024"), 1024);
  for (const char* text : {"", "0", "-1", "1025", "1.5", "2k", "two", "99999999999"})
    EXPECT_THROW(parse_threads(text), std::invalid_argument) << text;
}

TEST(ParseKey, ReadsWhatKeyTextPrints) {
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE(kSeed);
  std::mt19937_64 random(kSeed);
  for (int i = 0; i < 1000; ++i) {
    const int level = static_cast<int>(random() % (MortonKey::kMaxLevel + 1));
    MortonKey key = MortonKey::root();
    for (int depth = 0; depth < level; ++depth) key = key.child(static_cast<int>(random() % 8));
    EXPECT_EQ(parse_key(key_text(key)), key);
    EXPECT_EQ(parse_key("0x" + key_text(key)), key);
  }
}

TEST(ParseKey, RefusesWhatNamesNoNode) {
  // 2: its lowest 1 is at no multiple of three bits.
  for (const char* text : {"", "0x", "0", "2", "xyz", "10000000000000000", "-8", "8 "}) {
    EXPECT_THROW(parse_key(text), std::invalid_argument) << text;
  }
}

TEST(ParseLeaf, TakesAKeyOrAPoint) {
  const MortonKey key = MortonKey::root().child(3);
  EXPECT_EQ(std::get<MortonKey>(parse_leaf(key_text(key))), key);
  const Point point{0.5, -1e-3, 2};
  for (const char* text : {"0.5,-1e-3,2", "(0.5, -0.001, 2)", " 0.5 ,-0.001,2.0"})
    EXPECT_EQ(std::get<Point>(parse_leaf(text)), point) << text;
  for (const char* text : {"", "1,2", "1,2,3,4", "1,,3", "a,b,c", "1,2,nan", ",,"})
    EXPECT_THROW(parse_leaf(text), std::invalid_argument) << text;
}

TEST(ParseOutput, KnowsFormatsByExtension) {
  EXPECT_EQ(parse_output("a/b.vtu", {".vtu"}), "a/b.vtu");
  EXPECT_EQ(parse_output("b.ply", {".stl", ".ply"}), "b.ply");
  for (const char* text : {"", "vtu", ".vtu", "b.VTK", "b.vtu/"}) {
    EXPECT_THROW(parse_output(text, {".vtu"}), std::invalid_argument) << text;
  }
}

TEST(AbsoluteSize, PercentageIsOfTheSmallestSide) {
  const Box box{{-1, 0, 5}, {1, 4, 25}};
  EXPECT_EQ(absolute_size({50, true}, box), 1);
  EXPECT_EQ(absolute_size({0.5, false}, box), 0.5);
  const Box flat{{0, 0, 1}, {20, 40, 1}};
  EXPECT_EQ(absolute_size({0.5, false}, flat), 0.5);
  try {
    absolute_size({5, true}, flat);
    ADD_FAILURE() << "a part of nothing";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("flat: give a length, such as 2,"), std::string::npos)
        << e.what();
  }
}

TEST(RequireWritable, NamesWhatIsWrong) {
  const TempDir dir;
  EXPECT_NO_THROW(require_writable(dir / "out.vtu"));
  EXPECT_FALSE(std::filesystem::exists(dir / "out.vtu"));
  EXPECT_NO_THROW(require_writable("out.vtu"));
  EXPECT_THROW(require_writable(dir / "missing" / "out.vtu"), std::runtime_error);
  std::filesystem::create_directory(dir / "folder.vtu");
  EXPECT_THROW(require_writable(dir / "folder.vtu"), std::runtime_error);
  std::ofstream(dir / "file") << "x";
  EXPECT_THROW(require_writable(dir / "file" / "out.vtu"), std::runtime_error);
}

}  // namespace
}  // namespace locvol
