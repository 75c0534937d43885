#include "tests/directories.h"

namespace locvol {

std::filesystem::path models_directory() { return LOCVOL_MODELS_DIR; }

std::filesystem::path tests_directory() { return LOCVOL_TESTS_DIR; }

bool is_sanitized() { return LOCVOL_IS_SANITIZED; }

}  // namespace locvol
