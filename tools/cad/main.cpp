// locvol-cad: reads a CAD file for the engine, which starts it (engine/ingest/cad_protocol.h).
#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <Standard_Failure.hxx>
#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string>
#include <string_view>

#include "tools/cad/contacts.h"
#include "tools/cad/shape_file.h"
#include "tools/cad/sink.h"
#include "tools/cad/triangulator.h"

namespace locvol::cad {
namespace {

// Whoever is killed while it reads leaves nothing behind.
void die_with_parent() { ::prctl(PR_SET_PDEATHSIG, SIGKILL); }

// The next law that is asked for; false: none is any more.
bool next_law(CadLaw& law) {
  auto* place = reinterpret_cast<char*>(&law);
  std::size_t count = sizeof law;
  while (count > 0) {
    const ssize_t got = ::read(STDIN_FILENO, place, count);
    if (got <= 0) return false;
    place += got;
    count -= static_cast<std::size_t>(got);
  }
  return true;
}

[[noreturn]] void end_like(pid_t process) {
  int status = 0;
  while (::waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  ::_exit(WIFEXITED(status) ? WEXITSTATUS(status) : 1);
}

// OpenCASCADE does not survive all that it is to fuse. So another process does that, and goes on
// from there; this one waits for its end, or goes on with the shapes as they are.
void fuse_or_leave(ShapeFile& shapes, Sink& sink) {
  const ContactGroups groups = contact_groups(shapes);
  if (groups.empty()) return;
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) return tell_unfused(groups, sink);
  const pid_t parent = ::getpid(), process = ::fork();
  if (process < 0) return tell_unfused(groups, sink);
  if (process == 0) {
    die_with_parent();
    if (::getppid() != parent) ::_exit(1);  // it has died before
    fuse_contacts(shapes, groups, sink);
    const char done = 1;
    if (::write(ends[1], &done, 1) != 1) ::_exit(1);
    ::close(ends[0]);
    ::close(ends[1]);
    return;
  }
  ::close(ends[1]);
  char done = 0;
  ssize_t got = 0;
  while ((got = ::read(ends[0], &done, 1)) < 0 && errno == EINTR) {
  }
  ::close(ends[0]);
  if (got == 1) end_like(process);
  ::waitpid(process, nullptr, 0);
  tell_unfused(groups, sink);
}

void serve(const std::string& file, CadFormat format, Sink& sink) {
  ShapeFile shapes = read_shapes(file, format, sink);
  fuse_or_leave(shapes, sink);
  sink.facts(facts_of(shapes));
  for (CadLaw law; next_law(law);) {
    triangulate(shapes, law, sink);
    sink.end();
  }
}

std::string fault_of(const char* kind, const char* what) {
  return std::string("cannot be read by OpenCASCADE (") + kind + ": " + what +
         "): it is damaged; fetch or export it again";
}

void run(const std::string& file, CadFormat format) {
  Sink sink;
  try {
    serve(file, format, sink);
  } catch (const Refusal& refusal) {
    sink.refuse(refusal.what());
  } catch (const std::bad_alloc&) {
    sink.tell_out_of_memory();
  } catch (const Standard_Failure& failure) {
    sink.refuse(fault_of(failure.DynamicType()->Name(), failure.GetMessageString()));
  } catch (const std::exception& error) {
    sink.refuse(fault_of("exception", error.what()));
  }
}

}  // namespace
}  // namespace locvol::cad

int main(int num_arguments, char** arguments) {
  using namespace locvol;
  const auto* format = num_arguments == 4 && std::string_view(arguments[3]) == kCadVersion
                           ? std::ranges::find(kCadFormatNames, std::string_view(arguments[2]))
                           : kCadFormatNames.end();
  if (format == kCadFormatNames.end()) {
    std::fputs(
        "locvol-cad reads STEP, IGES and BREP for locvol of the same version, which starts it\n",
        stderr);
    return 2;
  }
  cad::die_with_parent();
  cad::run(arguments[1], static_cast<CadFormat>(format - kCadFormatNames.begin()));
  ::_exit(0);  // what is in memory need not be taken down
}
