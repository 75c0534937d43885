#include "tools/page/page_resources.h"

// The assembler reads a file's bytes as they are; LOCVOL_PAGE_DIR and LOCVOL_THREE_DIR come from
// CMakeLists.txt, which also says that this file depends on them.
#define LOCVOL_RESOURCE(name, file)                                       \
  __asm__(                                                                \
      ".pushsection .rodata\n"                                            \
      "locvol_" #name "_begin: .incbin \"" file                           \
      "\"\n"                                                              \
      "locvol_" #name                                                     \
      "_end: .byte 0\n"                                                   \
      ".popsection\n");                                                   \
  extern "C" const char name##_begin[] __asm__("locvol_" #name "_begin"); \
  extern "C" const char name##_end[] __asm__("locvol_" #name "_end");

LOCVOL_RESOURCE(page_html, LOCVOL_PAGE_DIR "/page.html")
LOCVOL_RESOURCE(page_css, LOCVOL_PAGE_DIR "/page.css")
LOCVOL_RESOURCE(page_viewer_js, LOCVOL_PAGE_DIR "/viewer.js")
#ifdef LOCVOL_THREE_DIR
LOCVOL_RESOURCE(three_js, LOCVOL_THREE_DIR "/three.min.js")
LOCVOL_RESOURCE(orbit_js, LOCVOL_THREE_DIR "/examples/js/controls/OrbitControls.js")
#endif

namespace locvol {

std::string_view page_template() { return {page_html_begin, page_html_end}; }
std::string_view page_style() { return {page_css_begin, page_css_end}; }
std::string_view page_viewer() { return {page_viewer_js_begin, page_viewer_js_end}; }
#ifdef LOCVOL_THREE_DIR
std::string_view three_library() { return {three_js_begin, three_js_end}; }
std::string_view three_controls() { return {orbit_js_begin, orbit_js_end}; }
#else
std::string_view three_library() { return {}; }
std::string_view three_controls() { return {}; }
#endif

}  // namespace locvol
