// The options of a run, from Python: each row of the option table by its key.
#pragma once

#include <pybind11/pybind11.h>

#include "engine/plan/library_options.h"

namespace locvol {

// Sets what the keys name; the others stay. Throws py::type_error for a key that is none, with the
// one that is meant, and for a value of another type; Error (kInput) for a text that means nothing.
void set_options(const pybind11::dict& given, Options& options);
// A dict for each that can be given, in order: "name", its key, but "shapes" for those; "typed",
// what the command calls it; "help", for people, empty where the command has words of its own.
pybind11::list option_rows();
// A length or a percentage: 0.01, "0.01", "2%". Throws as set_options().
Size size_given(const pybind11::handle& given);

}  // namespace locvol
