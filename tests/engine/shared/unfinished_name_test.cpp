#include "engine/shared/unfinished_name.h"

#include <gtest/gtest.h>

#include <fstream>
#include <list>
#include <string>

#include "tests/temp_dir.h"

namespace locvol {
namespace {

class UnfinishedNameTest : public testing::Test {
 protected:
  std::filesystem::path made(const std::string& name) const {
    std::ofstream(dir_ / name) << "something";
    return dir_ / name;
  }
  const TempDir dir_;
};

TEST_F(UnfinishedNameTest, IsRemovedWhileItIsUnfinished) {
  const auto finished = made("finished"), unfinished = made("unfinished"), other = made("other");
  { const UnfinishedName name(finished); }
  const UnfinishedName name(unfinished), of_no_file(dir_ / "missing");
  UnfinishedName::remove_all();
  EXPECT_TRUE(std::filesystem::exists(finished));
  EXPECT_FALSE(std::filesystem::exists(unfinished));
  EXPECT_TRUE(std::filesystem::exists(other));
}

// The process may be elsewhere by the time.
TEST_F(UnfinishedNameTest, IsRemovedWhereItWas) {
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(dir_.path());
  made("relative");
  const UnfinishedName name("relative");
  std::filesystem::current_path(before);
  UnfinishedName::remove_all();
  EXPECT_FALSE(std::filesystem::exists(dir_ / "relative"));
}

TEST_F(UnfinishedNameTest, IsForgottenIfThereAreTooMany) {
  std::list<UnfinishedName> names;
  for (int i = 0; i < 100; ++i) names.emplace_back(made(std::to_string(i)));
  UnfinishedName::remove_all();
  EXPECT_FALSE(std::filesystem::exists(dir_ / "0"));
  EXPECT_TRUE(std::filesystem::exists(dir_ / "99"));
  names.clear();
  const UnfinishedName name(dir_ / "99");
  UnfinishedName::remove_all();
  EXPECT_FALSE(std::filesystem::exists(dir_ / "99"));
}

}  // namespace
}  // namespace locvol
