// Surfaces that come through the standard input of the command, or through a pipe with a name.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <thread>

#include "tests/cube_off.h"
#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/tools/process.h"

namespace locvol {
namespace {

class StandardInput : public testing::Test {
 protected:
  StandardInput() { std::ofstream(file_) << kCube; }

  std::string path(const std::string& name) const { return (dir_ / name).string(); }
  bool has(const std::string& output, std::string_view text) const {
    return output.find(text) != std::string::npos;
  }
  // Of the command, with `content` in a pipe that is called `pipe`.
  ProcessResult run_with_pipe(const std::vector<std::string>& arguments, const std::string& pipe,
                              std::string_view content, bool is_standard_input) const {
    mkfifo(pipe.c_str(), 0600);
    std::thread writer([&] {
      const int out = ::open(pipe.c_str(), O_WRONLY | O_CLOEXEC);
      for (const char c : content)
        if (::write(out, &c, 1) != 1) break;
      ::close(out);
    });
    const ProcessResult result =
        Process(arguments, 0, is_standard_input ? pipe : "/dev/null").wait();
    writer.join();
    std::filesystem::remove(pipe);
    return result;
  }
  ProcessResult run_with_input(const std::vector<std::string>& arguments,
                               std::string_view content) const {
    return run_with_pipe(arguments, path("pipe"), content, true);
  }
  std::string mesh_of_file() const {
    EXPECT_EQ(run_locvol({"mesh", file_, "-o", path("file.vtu"), "-s", "0.2"}).exit_code, 0);
    return bytes_of(path("file.vtu"));
  }

  TempDir dir_;
  std::string file_ = (dir_ / "cube.off").string();
};

TEST_F(StandardInput, IsMeshedAsAFileIs) {
  const std::string expected = mesh_of_file();
  const std::string out = path("out.vtu");
  const std::vector<std::string> arguments = {"mesh", "-", "-o", out, "-s", "0.2", "--json"};
  const ProcessResult through_pipe = run_with_input(arguments, kCube);
  EXPECT_EQ(through_pipe.exit_code, 0) << through_pipe.err;
  EXPECT_TRUE(has(through_pipe.out, "standard input")) << through_pipe.out;
  EXPECT_EQ(bytes_of(out), expected);

  std::filesystem::remove(out);
  const ProcessResult redirected = Process(arguments, 0, file_).wait();  // <cube.off
  EXPECT_EQ(redirected.exit_code, 0) << redirected.err;
  EXPECT_EQ(bytes_of(out), expected);

  std::filesystem::remove(out);
  const std::string pipe = path("63");  // as <(cat cube.off) is one
  const ProcessResult named =
      run_with_pipe({"mesh", pipe, "-o", out, "-s", "0.2", "--json"}, pipe, kCube, false);
  EXPECT_EQ(named.exit_code, 0) << named.err;
  EXPECT_TRUE(has(named.out, pipe)) << named.out;
  EXPECT_EQ(bytes_of(out), expected);
  EXPECT_EQ(names_in(dir_), (Names{"cube.off", "file.vtu", "out.vtu"}));
}

TEST_F(StandardInput, IsReadAsOftenAsTheCommandNeeds) {
  const std::string out = path("out.vtu");
  const ProcessResult chosen = run_with_input({"mesh", "-", "-o", out, "--quiet"}, kCube);
  EXPECT_EQ(chosen.exit_code, 0) << chosen.err;  // a size is chosen, then it is meshed
  const ProcessResult info = run_with_input({"info", "-", "--json"}, kCube);
  ASSERT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(nlohmann::json::parse(info.out)["digest"],
            nlohmann::json::parse(run_locvol({"info", file_, "--json"}).out)["digest"]);
  const ProcessResult sizes =  // surveyed, then taken in to find the sizes
      run_with_input({"info", "-", "-s", "0.3", "--layers", "3", "--json"}, kCube);
  EXPECT_EQ(sizes.exit_code, 0) << sizes.err;
}

TEST_F(StandardInput, TheSameCommandGoesOn) {
  const std::string store = path("store"), out = path("out.vtu");
  const std::vector<std::string> arguments = {"mesh", "-",   "-o",      out,
                                              "-s",   "0.2", "--store", store};
  ASSERT_EQ(run_with_input(arguments, kCube).exit_code, 0);
  const std::string expected = bytes_of(out);
  std::filesystem::remove(out);
  EXPECT_EQ(run_with_input(arguments, kCube).exit_code, 0);
  EXPECT_EQ(bytes_of(out), expected);

  const ProcessResult other = run_with_input(arguments, std::string(kCube) + "# another file\n");
  EXPECT_EQ(other.exit_code, 1);
  EXPECT_TRUE(has(other.err, "store")) << other.err;

  std::filesystem::remove(out);  // what has been taken in is not needed again
  const ProcessResult resumed = run_locvol({"resume", store, "-o", out});
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_EQ(bytes_of(out), expected);
  const ProcessResult from_file =
      run_locvol({"mesh", file_, "-o", out, "-s", "0.2", "--store", store});
  EXPECT_EQ(from_file.exit_code, 0) << from_file.err;
}

TEST_F(StandardInput, WhatIsNoSurfaceIsRefusedByItsName) {
  const std::vector<std::string> arguments = {"mesh", "-", "-o", path("out.vtu"), "-s", "0.2"};
  for (const auto& [content, part] :
       {std::pair<std::string_view, std::string_view>{"", "empty (0 bytes)"},
        {"nothing\n", "no known format"},
        {kCube.substr(0, 80), "header"}}) {
    const ProcessResult result = run_with_input(arguments, content);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_TRUE(has(result.err, "locvol: error: standard input: ")) << result.err;
    EXPECT_TRUE(has(result.err, part)) << result.err;
  }
  const ProcessResult nothing = run_locvol(arguments);  // </dev/null
  EXPECT_EQ(nothing.exit_code, 1);
  EXPECT_TRUE(has(nothing.err, "standard input: is neither a file nor a pipe")) << nothing.err;
  EXPECT_EQ(names_in(dir_), Names{"cube.off"});
}

TEST_F(StandardInput, ATerminalIsRefusedWithAHint) {
  const int terminal = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (terminal < 0 || ::grantpt(terminal) != 0 || ::unlockpt(terminal) != 0)
    GTEST_SKIP() << "no terminal can be made";
  const ProcessResult result =
      Process({"mesh", "-", "-o", path("out.vtu"), "-s", "0.2"}, 0, ::ptsname(terminal)).wait();
  ::close(terminal);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(has(result.err, "is a terminal")) << result.err;
  EXPECT_TRUE(has(result.err, "| locvol mesh - ")) << result.err;
}

TEST_F(StandardInput, TheSurfaceIsNotOverwrittenByItsMesh) {
  const std::string ply = path("ball.ply");
  ASSERT_EQ(run_locvol({"generate", "sphere", "-o", ply, "-n", "1000"}).exit_code, 0);
  const std::string before = bytes_of(ply);
  const ProcessResult result = Process({"mesh", "-", "-o", ply, "-s", "0.3"}, 0, ply).wait();
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(has(result.err, "it is the surface")) << result.err;
  EXPECT_EQ(bytes_of(ply), before);
}

TEST_F(StandardInput, ASignalEndsTheWaitForIt) {
  const std::string pipe = path("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const int end = ::open(pipe.c_str(), O_RDWR | O_CLOEXEC);  // which writes nothing
  Process process({"mesh", "-", "-o", path("out.vtu"), "-s", "0.2"}, 0, pipe);
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  process.send(SIGTERM);
  const auto sent = std::chrono::steady_clock::now();
  EXPECT_EQ(process.wait().exit_code, 4);
  EXPECT_LT(std::chrono::steady_clock::now() - sent, std::chrono::seconds(2));
  ::close(end);
}

}  // namespace
}  // namespace locvol
