// What a surface is called that comes through the standard input.
#pragma once

namespace locvol {

// Stands in place of a file for those who ask for it: MeshOptions::input.
inline constexpr const char* kFromStandardInput = "-";
// Names it in messages and stores.
inline constexpr const char* kStandardInput = "standard input";

}  // namespace locvol
