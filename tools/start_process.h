#pragma once

namespace locvol {

// Makes of whatever a process was started in what its code relies on. To be called first in main().
//   - Descriptors 0, 1 and 2 are open (open_standard_streams()).
//   - No signal is blocked. A file that outgrows its limit (`ulimit -f`) is an error of the write,
//     which is told, and no signal that ends the process.
//   - Limits that the system lets a process lift are lifted to what any run gets along with: open
//     files, the stack. Threads have stacks of 8 MiB, but for those that ask for another size,
//     whatever the limit on that of the first one.
//   - All threads share one heap (share_one_heap()).
//   - Where there is no memory for an exact number, that is an error (std::bad_alloc), too.
// What cannot be had is left as it is: whoever needs it says so.
void start_process();

}  // namespace locvol
