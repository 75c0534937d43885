// The command where it is started in worse worlds than a shell: with closed or broken streams,
// tight limits, odd signals, no directory.
#include <gtest/gtest.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "tests/file_bytes.h"
#include "tests/temp_dir.h"
#include "tests/tools/process.h"

namespace locvol {
namespace {

class Surroundings : public testing::Test {
 protected:
  Surroundings() {
    setenv("LOCVOL", locvol_command().c_str(), 1);
    EXPECT_EQ(shell("$LOCVOL generate sphere -o ball.stl -n 500 > /dev/null"), 0);
    EXPECT_EQ(shell("$LOCVOL mesh ball.stl -o plain.vtu --size 20% > /dev/null 2> err"), 0)
        << err();
  }

  // The exit code of a script of the shell in the test's directory; -1: a signal ended it.
  int shell(const std::string& script) const {
    const int status = std::system(("cd " + dir_.path().string() + "; " + script).c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string file(const std::string& name) const { return (dir_ / name).string(); }
  std::string err() const { return bytes_of(dir_ / "err"); }
  void expect_plain_mesh(const std::string& name) const {
    EXPECT_EQ(bytes_of(dir_ / name), bytes_of(dir_ / "plain.vtu")) << name << '\n' << err();
  }
  bool err_says(const std::string& text) const { return err().find(text) != std::string::npos; }

  TempDir dir_;
};

TEST_F(Surroundings, ClosedStandardStreamsChangeNoByte) {
  for (int closed = 0; closed < 8; ++closed) {
    std::string streams;
    streams += closed & 1 ? " <&-" : " < /dev/null";
    streams += closed & 2 ? " >&-" : " > /dev/null";
    streams += closed & 4 ? " 2>&-" : " 2> err";
    SCOPED_TRACE("streams:" + streams);
    const std::string n = std::to_string(closed);
    EXPECT_EQ(shell("$LOCVOL mesh ball.stl -o " + n + ".vtu --size 20% --store " + n + streams), 0);
    expect_plain_mesh(n + ".vtu");
    // What was committed is a whole store.
    EXPECT_EQ(shell("$LOCVOL audit " + n + " > /dev/null 2> err"), 0) << err();
    EXPECT_EQ(shell("$LOCVOL export " + n + " -o again.vtu" + streams), 0);
    expect_plain_mesh("again.vtu");
    EXPECT_EQ(shell("$LOCVOL info ball.stl" + streams), 0);
    EXPECT_EQ(shell("$LOCVOL inspect " + n + " --leaves" + streams), 0);
  }
}

TEST_F(Surroundings, WhatNobodyCanReadEndsNoRun) {
  EXPECT_EQ(shell("$LOCVOL mesh ball.stl -o full.vtu --size 20% > /dev/null 2> /dev/full"), 0);
  expect_plain_mesh("full.vtu");
  // The reader of the progress has gone before there is any.
  EXPECT_EQ(shell("{ sleep 0.1; $LOCVOL mesh ball.stl -o gone.vtu --size 20% 2>&1 > /dev/null;"
                  "  echo $? > code; } | true; test \"$(cat code)\" = 0"),
            0);
  expect_plain_mesh("gone.vtu");
}

TEST_F(Surroundings, ResultsThatDoNotReachTheirReaderAreAnError) {
  EXPECT_EQ(shell("$LOCVOL info ball.stl > /dev/full 2> err"), 1);
  EXPECT_TRUE(err_says("cannot write to standard output")) << err();
}

TEST_F(Surroundings, ALimitOnTheSizeOfFilesIsTold) {
  constexpr const char* kMesh = "$LOCVOL mesh ball.stl -o small.vtu --size 20% > /dev/null 2> err";
  EXPECT_EQ(shell(std::string("ulimit -f 1; ") + kMesh), 1);
  EXPECT_TRUE(err_says("locvol: error: ")) << err();
  EXPECT_TRUE(err_says("File too large")) << err();
  EXPECT_FALSE(std::filesystem::exists(dir_ / "small.vtu"));
  EXPECT_EQ(shell(kMesh), 0) << err();
  expect_plain_mesh("small.vtu");
}

TEST_F(Surroundings, FewOpenFilesAreEnoughOrTheErrorSaysSo) {
  // The shell needs some itself, unless the command takes its place.
  const auto mesh_with = [&](const std::string& limit) {
    return shell("exec > /dev/null 2> err 3>&- 4>&- 5>&- 6>&- 7>&- 8>&- 9>&-; ulimit " + limit +
                 "; exec $LOCVOL mesh ball.stl -o few.vtu --size 20%");
  };
  for (int limit = 4; limit <= 24; ++limit) {
    SCOPED_TRACE(limit);
    const int code = mesh_with("-n " + std::to_string(limit));
    if (err_says("error while loading shared libraries")) continue;  // it has not begun
    EXPECT_TRUE(code == 0 || code == 1) << code << err();
    if (code == 1) {
      EXPECT_TRUE(err_says("Too many open files")) << err();
    }
    if (code == 0) expect_plain_mesh("few.vtu");
    shell("rm -rf few.vtu*");
  }
  EXPECT_EQ(mesh_with("-n 24"), 0) << err();
  shell("rm -rf few.vtu*");
  // One that may be lifted is.
  EXPECT_EQ(mesh_with("-S -n 4"), 0) << err();
  expect_plain_mesh("few.vtu");
}

TEST_F(Surroundings, ASmallStackIsEnough) {
  EXPECT_EQ(shell("ulimit -s 128; $LOCVOL mesh ball.stl -o stack.vtu --size 20% > o 2> err"), 0)
      << err();
  expect_plain_mesh("stack.vtu");
}

TEST_F(Surroundings, AWorkingDirectoryThatIsGoneIsNotNeededOrNamed) {
  const std::string gone = "mkdir -p gone; cd gone; rmdir ../gone; ";
  EXPECT_EQ(shell(gone + "$LOCVOL mesh " + file("ball.stl") + " -o " + file("whole.vtu") +
                  " --size 20% > /dev/null 2> " + file("err")),
            0)
      << err();
  expect_plain_mesh("whole.vtu");
  EXPECT_EQ(shell(gone + "$LOCVOL mesh " + file("ball.stl") + " -o a.vtu --size 20% > " +
                  file("out") + " 2> " + file("err")),
            1);
  EXPECT_TRUE(err_says("the working directory is no more")) << err();
}

TEST_F(Surroundings, AnEnvironmentWithoutAnythingIsEnough) {
  EXPECT_EQ(shell("env -i $LOCVOL mesh ball.stl -o none.vtu --size 20% > /dev/null 2> err"), 0)
      << err();
  expect_plain_mesh("none.vtu");
  EXPECT_EQ(shell("TMPDIR=/no/such $LOCVOL info ball.stl > /dev/null 2> err"), 1);
  EXPECT_TRUE(err_says("TMPDIR")) << err();
}

// Is sent a signal while it works, and started again if that ended it.
TEST_F(Surroundings, BlockedSignalsStopARunAllTheSame) {
  sigset_t all, before;
  sigfillset(&all);
  sigprocmask(SIG_SETMASK, &all, &before);
  Process run({"mesh", file("ball.stl"), "-o", file("large.vtu"), "--size", "0.7%"});
  sigprocmask(SIG_SETMASK, &before, nullptr);
  while (run.err().empty() && !run.has_ended()) usleep(1000);
  run.send(SIGTERM);
  const ProcessResult result = run.wait();
  EXPECT_EQ(result.exit_code, 4) << result.err;
}

TEST_F(Surroundings, WhatAShellStartsInTheBackgroundIsNotInterrupted) {
  // Ctrl-C is sent to all that the shell has started.
  EXPECT_EQ(shell("trap '' INT; $LOCVOL mesh ball.stl -o back.vtu --size 4% --store s 2> err > o & "
                  "while [ ! -s err ]; do sleep 0.01; done; kill -INT $!; wait $!"),
            0)
      << err();
  EXPECT_EQ(shell("$LOCVOL audit s > /dev/null 2> err"), 0) << err();
}

}  // namespace
}  // namespace locvol
