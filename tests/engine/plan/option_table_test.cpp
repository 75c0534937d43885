#include "engine/plan/option_table.h"

#include <gtest/gtest.h>

#include <string>
#include <type_traits>

#include "engine/plan/same_run.h"
#include "storage/codec.h"
#include "tests/engine/plan/changed_parameters.h"

namespace locvol {
namespace {

TEST(OptionTable, EachParameterIsStored) {
  RunRecord run;
  run.parameters.size = 0.1;
  for_each_change(run.parameters, [&](const auto& option, const RunParameters& changed) {
    RunRecord other = run;
    other.parameters = changed;
    EXPECT_NE(other, run) << option.name.key;
    EXPECT_EQ(decode<RunRecord>(encode(other, MortonKey()), MortonKey()), other) << option.name.key;
  });
}

TEST(OptionTable, EachParameterIsCompared) {
  RunRecord held;
  held.parameters.size = 0.1;
  EXPECT_NO_THROW(require_same_run(held, held, "dir"));
  for_each_change(held.parameters, [&](const auto& option, const RunParameters& changed) {
    RunRecord asked = held;
    asked.parameters = changed;
    try {
      require_same_run(held, asked, "dir");
      ADD_FAILURE() << option.name.key;
    } catch (const StoreMismatch& e) {
      EXPECT_NE(std::string(e.what()).find(std::string(option.name.typed) + " is "),
                std::string::npos)
          << option.name.key << ": " << e.what();
    }
  });
}

TEST(OptionTable, TellsWhatStandsForNumbersThatAreNotGiven) {
  for_each_option([](const auto& option) {
    if constexpr (std::is_same_v<decltype(option.given), double Options::*const>) {
      EXPECT_EQ(MeshOptions().*option.given, option.standard) << option.name.key;
    }
  });
}

}  // namespace
}  // namespace locvol
