// The cap on memory, as the user sets it: kept, and without influence on the mesh.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "engine/shared/memory_budget.h"
#include "tests/directories.h"
#include "tests/file_bytes.h"
#include "tests/skip_reasons.h"
#include "tests/temp_dir.h"
#include "tests/tools/process.h"
#include "tools/generate.h"

namespace locvol {
namespace {

constexpr std::uint64_t kMiB = std::uint64_t{1} << 20;

class MemoryCap : public testing::Test {
 protected:
  void SetUp() override { generate("three-holes", 30000, dir_ / "surface.stl"); }

  // The bytes of the mesh under a cap; "" if it failed.
  std::string mesh_under(const std::string& cap, std::uint64_t data_bytes = 0,
                         const std::string& num_threads = "2") {
    result_ = run_locvol({"mesh", surface(), "-o", output(), "--size", "7%", "--leaf-capacity",
                          "1000", "--memory", cap, "--threads", num_threads, "--quiet"},
                         data_bytes);
    return result_.exit_code == 0 ? bytes_of(output()) : "";
  }

  std::string surface() const { return (dir_ / "surface.stl").string(); }
  std::string output() const { return (dir_ / "mesh.vtu").string(); }

  TempDir dir_;
  ProcessResult result_;
};

TEST_F(MemoryCap, HasNoInfluenceOnTheMesh) {
  const std::string mesh = mesh_under("4G");
  ASSERT_NE(mesh, "") << result_.err;
  EXPECT_TRUE(mesh_under("96M") == mesh) << result_.err;
}

TEST_F(MemoryCap, IsKept) {
  if (is_sanitized()) GTEST_SKIP() << kSanitized;
  ASSERT_NE(mesh_under("96M"), "") << result_.err;
  EXPECT_LT(result_.peak_bytes, 96 * kMiB);
  EXPECT_GT(result_.peak_bytes, 10 * kMiB);
}

// Heaps and stacks of threads have to fit in as well.
TEST_F(MemoryCap, IsKeptByManyThreads) {
  const std::string mesh = mesh_under("96M", 0, "1");
  ASSERT_NE(mesh, "") << result_.err;
  for (const std::string num_threads : {"8", "100"}) {
    EXPECT_TRUE(mesh_under("96M", 0, num_threads) == mesh) << num_threads << result_.err;
    EXPECT_TRUE(is_sanitized() || result_.peak_bytes < 96 * kMiB) << num_threads;
  }
  if (is_sanitized()) return;
  EXPECT_TRUE(mesh_under("96M", 96 * kMiB, "8") == mesh) << result_.err;
}

TEST_F(MemoryCap, HoldsAgainstTheKernelToo) {
  if (is_sanitized()) GTEST_SKIP() << kSanitized;
  const std::string mesh = mesh_under("96M");
  EXPECT_TRUE(mesh_under("96M", 96 * kMiB) == mesh) << result_.err;
  EXPECT_EQ(result_.exit_code, 0);
}

// A disk with hundreds of teeth, all of it as small as λ: its creases have points, with balls
// around them, that are tiny beside the leaf.
TEST_F(MemoryCap, HoldsWhereCreasesAreFineForTheSize) {
  constexpr int kNumCorners = 400;
  std::ofstream out(dir_ / "teeth.off");
  out << "OFF\n" << 2 * kNumCorners + 2 << ' ' << 4 * kNumCorners << " 0\n";
  for (const double z : {0.0, 0.3})
    for (int i = 0; i < kNumCorners; ++i) {
      const double angle = 2 * std::numbers::pi * i / kNumCorners, radius = i % 2 == 0 ? 1 : 0.99;
      out << radius * std::cos(angle) << ' ' << radius * std::sin(angle) << ' ' << z << '\n';
    }
  out << "0 0 0\n0 0 0.3\n";
  const auto triangle = [&](int a, int b, int c) {
    out << "3 " << a << ' ' << b << ' ' << c << '\n';
  };
  for (int i = 0; i < kNumCorners; ++i) {
    const int next = (i + 1) % kNumCorners, above = i + kNumCorners, after = next + kNumCorners;
    triangle(2 * kNumCorners, next, i);
    triangle(2 * kNumCorners + 1, above, after);
    triangle(i, next, after);
    triangle(i, after, above);
  }
  out.close();
  result_ = run_locvol({"mesh", (dir_ / "teeth.off").string(), "-o", output(), "--size", "1",
                        "--memory", "96M", "--threads", "1", "--quiet"},
                       is_sanitized() ? 0 : 96 * kMiB);
  EXPECT_EQ(result_.exit_code, 0) << result_.err;
  EXPECT_TRUE(is_sanitized() || result_.peak_bytes < 96 * kMiB) << result_.peak_bytes;
}

TEST_F(MemoryCap, TooSmallIsRefusedAtOnceWithOneThatWorks) {
  EXPECT_EQ(mesh_under("20M"), "");
  EXPECT_EQ(result_.exit_code, 1);
  const std::size_t at = result_.err.find("give ");
  ASSERT_NE(at, std::string::npos) << result_.err;
  const std::string named = result_.err.substr(at + 5, result_.err.find('M', at) - at - 4);
  EXPECT_NE(mesh_under(named), "") << named << ": " << result_.err;
}

}  // namespace
}  // namespace locvol
