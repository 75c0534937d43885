// locvol-cad: reads a CAD file for the engine, which starts it (engine/ingest/cad_protocol.h).
#include <sys/prctl.h>
#include <unistd.h>

#include <Standard_Failure.hxx>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string>
#include <string_view>

#include "tools/cad/shape_file.h"
#include "tools/cad/sink.h"
#include "tools/cad/triangulator.h"

namespace locvol::cad {
namespace {

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

void serve(const std::string& file, CadFormat format, Sink& sink) {
  const ShapeFile shapes = read_shapes(file, format, sink);
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
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // whoever is killed while it reads leaves nothing behind
  cad::run(arguments[1], static_cast<CadFormat>(format - kCadFormatNames.begin()));
  ::_exit(0);  // what is in memory need not be taken down
}
