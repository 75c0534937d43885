#include "engine/shared/standard_streams.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

namespace locvol {
namespace {

bool is_open(int descriptor) { return ::fcntl(descriptor, F_GETFD) >= 0 || errno != EBADF; }

// The lowest descriptor that is free. Without a /dev/null it is one that can be neither read nor
// written, which is as good: it is taken.
int take_descriptor() {
  const int null = ::open("/dev/null", O_RDWR);
  return null >= 0 ? null : ::open("/", O_PATH);
}

}  // namespace

void open_standard_streams() {
  for (int descriptor = 0; descriptor <= 2; ++descriptor) {
    if (is_open(descriptor)) continue;
    const int taken = take_descriptor();  // this one, for those below it are open
    if (taken < 0)
      throw std::system_error(errno, std::generic_category(),
                              "standard input, output or error is closed, and cannot be opened");
    // Another thread was faster.
    if (taken > 2) ::close(taken);
  }
}

}  // namespace locvol
