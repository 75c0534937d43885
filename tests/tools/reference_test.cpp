// The manual page and the completions hold all that --help lists; bash's is asked as bash asks it.
#include "tools/reference.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/temp_dir.h"
#include "tests/tools/process.h"

namespace locvol {
namespace {

using Words = std::set<std::string>;

std::string help_of(const std::string& command) {
  return command.empty() ? run_locvol({"--help"}).out : run_locvol({command, "--help"}).out;
}

// The words that begin the lines under the heading "Subcommands:".
std::vector<std::string> commands() {
  std::vector<std::string> names;
  std::istringstream help(help_of(""));
  bool is_under_heading = false;
  for (std::string line; std::getline(help, line);) {
    if (line == "Subcommands:")
      is_under_heading = true;
    else if (line.empty())
      is_under_heading = false;
    else if (is_under_heading && line[2] != ' ')
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
  }
  return names;
}

// "-o" and "--output" of "  -o,--output FILE REQUIRED   File to write".
Words options(const std::string& command) {
  Words names;
  const std::string help = help_of(command);
  static const std::regex line("(?:^|\n) +(-[-a-z]+)(?:,(--[-a-z]+))?(?=[ \n])");
  for (std::sregex_iterator match(help.begin(), help.end(), line), end; match != end; ++match)
    for (const std::size_t group : {std::size_t{1}, std::size_t{2}})
      if ((*match)[group].matched) names.insert((*match)[group]);
  return names;
}

std::string reference_in(const std::string& form) {
  const ProcessResult result = run_locvol({"reference", form});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.err, "");
  return result.out;
}

// What bash offers for the last of the words, in the directory.
Words offered(const TempDir& dir, const std::string& words) {
  std::ofstream(dir / "script") << reference_in("bash")
                                << fmt::format(
                                       "cd {}/work\nCOMP_WORDS=(locvol {})\nCOMP_CWORD=$((${{#COMP_"
                                       "WORDS[@]}}-1))\n_locvol\nprintf '%s\\n' "
                                       "\"${{COMPREPLY[@]}}\"\n",
                                       dir.path().string(), words);
  FILE* bash = popen(("bash " + (dir / "script").string()).c_str(), "r");
  std::string text;
  std::array<char, 256> buffer{};
  while (std::fgets(buffer.data(), buffer.size(), bash) != nullptr) text += buffer.data();
  EXPECT_EQ(pclose(bash), 0);
  Words result;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (!line.empty()) result.insert(line);
  return result;
}

TEST(Reference, HelpIsReadAsMeant) {
  EXPECT_GE(commands().size(), 9u);
  const Words of_mesh = options("mesh");
  for (const char* name : {"-h", "--help", "-o", "--output", "--size", "--init", "--json"})
    EXPECT_TRUE(of_mesh.contains(name)) << name;
  EXPECT_TRUE(options("inspect").contains("--where")) << "an option of a group";
}

TEST(Reference, ManualPageHasEveryCommandAndOption) {
  const std::string page = reference_in("man");
  for (const std::string& command : commands()) {
    const std::size_t begin = page.find(".SS \\fBlocvol " + command + "\\fR");
    ASSERT_NE(begin, std::string::npos) << command;
    const std::string section = page.substr(begin, page.find("\n.S", begin + 1) - begin);
    for (const std::string& option : options(command)) {
      if (option == "-h" || option == "--help") continue;  // said once, for all
      const std::string name = std::regex_replace(option, std::regex("-"), "\\-");
      EXPECT_NE(section.find("\\fB" + name + "\\fR"), std::string::npos) << command << option;
    }
  }
  for (const char* code : {"0", "1", "2", "3", "4"})
    EXPECT_NE(page.find(fmt::format("\n.B {}\n", code)), std::string::npos) << code;
}

TEST(Reference, ScriptsHaveEveryCommandAndOption) {
  const TempDir dir;
  std::filesystem::create_directory(dir / "work");
  const std::string zsh = reference_in("zsh"), fish = reference_in("fish");
  const Words first = offered(dir, "''");
  for (const std::string& command : commands()) {
    EXPECT_TRUE(first.contains(command)) << command;
    EXPECT_EQ(offered(dir, command + " -"), options(command)) << command;
    EXPECT_NE(zsh.find("    " + command + ")\n"), std::string::npos) << command;
    const std::size_t section = zsh.find("    " + command + ")\n");
    const std::string of_zsh = zsh.substr(section, zsh.find(";;", section) - section);
    for (const std::string& option : options(command)) {
      EXPECT_NE(of_zsh.find(option), std::string::npos) << command << ' ' << option;
      if (!option.starts_with("--")) continue;
      const std::regex line(
          fmt::format("__fish_seen_subcommand_from {}'[^\n]* -l {} ", command, option.substr(2)));
      EXPECT_TRUE(std::regex_search(fish, line)) << command << ' ' << option;
    }
  }
}

TEST(Reference, BashOffersFilesDirectoriesAndNames) {
  const TempDir dir;
  for (const char* name : {"work", "work/stores", "work/some models"})
    std::filesystem::create_directory(dir / name);
  for (const char* name :
       {"work/a.stl", "work/b c.PLY", "work/d.off.gz", "work/notes.txt", "work/a.vtu"})
    std::ofstream(dir / name) << "";
  EXPECT_EQ(offered(dir, "mesh ''"),
            (Words{"a.stl", "b c.PLY", "d.off.gz", "some models", "stores"}));
  EXPECT_EQ(offered(dir, "mesh a.stl -o a"), (Words{"a.stl", "a.vtu"}));
  EXPECT_EQ(offered(dir, "inspect s"), (Words{"some models", "stores"}));
  EXPECT_EQ(offered(dir, "mesh a.stl --init ''"), (Words{"cover", "paper"}));
  EXPECT_EQ(offered(dir, "mesh a.stl --init = pa"), (Words{"paper"}));
  EXPECT_EQ(offered(dir, "mesh a.stl --size ''"), Words{});
  EXPECT_TRUE(offered(dir, "generate ''").contains("gyroid-ball"));
}

TEST(Reference, RefusesOtherForms) {
  const ProcessResult result = run_locvol({"reference", "tcsh"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("man, bash, zsh, fish"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace locvol
