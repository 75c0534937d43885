// Why tests are skipped, and what runs them: for GTEST_SKIP(). tools/run_tests.py collects it.
#pragma once

namespace locvol {

inline constexpr char kNoModels[] =
    "needs the shared models. To run it: LOCVOL_MODELS=DIR tools/test.sh";
inline constexpr char kSanitized[] =
    "measures memory, where a sanitizer has its own. To run it: tools/test.sh";

}  // namespace locvol
