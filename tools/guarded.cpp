#include "tools/guarded.h"

#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <cassert>
#include <cstdio>
#include <cstring>
#include <exception>
#include <initializer_list>
#include <new>
#include <stdexcept>
#include <system_error>

#include "tools/exit_code.h"

namespace locvol {
namespace {

std::array<char, 4096> store_name{};

// A result that did not reach its reader is no result.
void flush_output() {
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    throw std::runtime_error("cannot write to standard output");
  }
}

// In one piece, so that nothing that others print comes between. Allocates nothing.
void print_error(std::initializer_list<const char*> texts) {
  std::array<iovec, 8> pieces{};
  assert(texts.size() <= pieces.size());
  auto piece = pieces.begin();
  for (const char* text : texts) *piece++ = {const_cast<char*>(text), std::strlen(text)};
  [[maybe_unused]] const ssize_t written =
      ::writev(STDERR_FILENO, pieces.data(), static_cast<int>(texts.size()));
}

bool is_directory_gone() {
  std::error_code error;
  [[maybe_unused]] const auto current = std::filesystem::current_path(error);
  return error == std::errc::no_such_file_or_directory;
}

int fail(const char* name, const char* message) {
  print_error({name, ": error: ", message, "\n"});
  return kExitError;
}

// The system refused memory or a file, for now: nothing is lost. Allocates nothing.
int fail_resumably(const char* name, const char* message, const char* cure) {
  constexpr const char* kAgain = ", and give the same command again\n";
  if (store_name[0] == '\0')
    print_error({name, ": error: ", message, "; ", cure, kAgain});
  else
    print_error({name, ": error: ", message, "; the store ", store_name.data(),
                 " keeps what was committed: ", cure, kAgain});
  return kExitError;
}

}  // namespace

void note_store(const std::filesystem::path& store) {
  std::snprintf(store_name.data(), store_name.size(), "%s", store.c_str());
}

int guarded(const char* name, const std::function<int()>& run) {
  try {
    const int code = run();
    flush_output();
    return code;
  } catch (const std::bad_alloc&) {
    return fail_resumably(name, "out of memory", "free some memory");
  } catch (const std::filesystem::filesystem_error& error) {
    if (!is_directory_gone()) return fail_resumably(name, error.what(), "mend that");
    return fail(name,
                "the working directory is no more: change to one that is, or give whole paths");
  } catch (const std::system_error& error) {
    return fail_resumably(name, error.what(), "mend that");
  } catch (const std::exception& error) {
    return fail(name, error.what());
  } catch (...) {
    return fail(name, "unknown error");
  }
}

}  // namespace locvol
