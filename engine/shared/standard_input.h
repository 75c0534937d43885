// What a surface is called that comes through the standard input.
#pragma once

namespace locvol {

// In place of a file, by those who ask for it: MeshOptions::input.
inline constexpr const char* kFromStandardInput = "-";
// By messages and stores.
inline constexpr const char* kStandardInput = "standard input";

}  // namespace locvol
