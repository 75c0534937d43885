// The manual page and the shells' completions, made from the declared command line: what can be
// typed is said in one place.
#pragma once

#include <string>
#include <string_view>

namespace CLI {
class App;
}

namespace locvol {

// The forms: "man" (roff), and "bash", "zsh" or "fish", scripts that the shell reads.
bool is_reference_form(std::string_view form);
// REQUIRES: a form
std::string reference(const CLI::App& app, std::string_view form);

}  // namespace locvol
