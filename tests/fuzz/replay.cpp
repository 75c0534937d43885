// Gives a fuzz target the inputs that are in the files and directories named, once each: what
// libFuzzer does with them, for compilers that lack it.

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

namespace fs = std::filesystem;

std::vector<fs::path> inputs_in(const fs::path& place) {
  if (!fs::is_directory(place)) return {place};
  std::vector<fs::path> inputs;
  for (const auto& entry : fs::directory_iterator(place))
    if (entry.is_regular_file()) inputs.push_back(entry.path());
  std::ranges::sort(inputs);
  return inputs;
}

// In a block of just this size, so that the address sanitizer sees a step beyond its end.
std::vector<std::uint8_t> content_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  return {text.begin(), text.end()};
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t num_inputs = 0;
  for (int i = 1; i < argc; ++i) {
    for (const fs::path& path : inputs_in(argv[i])) {
      std::fprintf(stderr, "%s\n", path.c_str());  // the last line tells which one failed
      const std::vector<std::uint8_t> content = content_of(path);
      LLVMFuzzerTestOneInput(content.data(), content.size());
      ++num_inputs;
    }
  }
  std::fprintf(stderr, "%zu inputs\n", num_inputs);
  return num_inputs > 0 ? 0 : 1;
}
