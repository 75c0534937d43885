#include "engine/plan/option_table.h"

#include <fmt/format.h>

#include <cstddef>

namespace locvol {
namespace {

struct Anything {
  template <class T>
  operator T() const {
    return T();
  }
};

// Of an aggregate; a base is one.
template <class T, class... Values>
consteval std::size_t num_members() {
  if constexpr (requires { T{Values()..., Anything()}; })
    return num_members<T, Values..., Anything>();
  else
    return sizeof...(Values);
}

constexpr std::size_t kNumRows = std::tuple_size_v<decltype(kOptions)>;
// Besides the rows: the surface's digest, and what is known of an image.
static_assert(num_members<RunParameters>() == kNumRows + 2, "a parameter is missing in kOptions");
// The bound on the radius-edge ratio cannot be given; `store`, `scratch` and `is_forced` change no
// mesh, and `input` and `more_inputs` are told apart by the digest.
static_assert(num_members<Options>() + num_members<MeshOptions>() - 1 == kNumRows - 1 + 5,
              "an option is missing in kOptions");

}  // namespace

std::string filled(const char* text, const OptionText& option) {
  return fmt::format(fmt::runtime(text), fmt::arg("least", option.range.least),
                     fmt::arg("most", option.range.most), fmt::arg("standard", option.standard));
}

}  // namespace locvol
