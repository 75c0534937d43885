// The files of the page, compiled into the program.
#pragma once

#include <string_view>

namespace locvol {

std::string_view page_template();  // tools/page/page.html
std::string_view page_style();     // tools/page/page.css
std::string_view page_viewer();    // tools/page/viewer.js
// three.js and its OrbitControls as Debian packages them (libjs-three); empty if the program was
// built without.
std::string_view three_library();
std::string_view three_controls();

}  // namespace locvol
