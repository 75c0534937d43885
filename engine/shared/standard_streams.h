#pragma once

namespace locvol {

// Makes sure that descriptors 0, 1 and 2 are open; those that are closed lead to /dev/null from now
// on. Otherwise the next file that is opened becomes one of them, and whatever is printed is
// written into it: a store was damaged so.
// To be called before a file is opened, by a program and by each entry to the library.
// Throws std::system_error.
void open_standard_streams();

}  // namespace locvol
