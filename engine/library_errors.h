// Errors of the engine as those of the library: for locvol.cpp, and for what is built on both.
#pragma once

namespace locvol {

// Throws the exception that is being handled as an Error. REQUIRES: there is one
[[noreturn]] void rethrow_as_error();

}  // namespace locvol
