// What writing the mesh of a finished run costs, from its store to a file.
//
//   writer_benchmark STORE OUTPUT.vtu [Google Benchmark's options]
//
// The file is written again and again, and removed at the end.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <system_error>

#include "engine/output/writer.h"
#include "storage/store.h"

namespace locvol {
namespace {

// What the store holds comes from the page cache from the second time on; the file goes to it.
void vtu(benchmark::State& state, const Store& store, const std::filesystem::path& file) {
  WriteSummary written;
  for (auto _ : state) written = write_vtu(store, file);
  const auto rate = [&](std::uint64_t count) {
    return benchmark::Counter(double(count), benchmark::Counter::kIsIterationInvariantRate);
  };
  state.counters["cells/s"] = rate(written.num_cells);
  state.counters["bytes/s"] = rate(written.bytes);
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  using namespace locvol;
  benchmark::Initialize(&argc, argv);
  if (argc != 3) {
    std::fprintf(stderr, "usage: writer_benchmark STORE OUTPUT.vtu [--benchmark_…]\n");
    return 2;
  }
  try {
    const std::filesystem::path file = argv[2];
    if (std::filesystem::exists(file)) throw StoreError(file.string() + " exists already");
    const Store store = Store::open(argv[1], {.read_only = true});
    benchmark::RegisterBenchmark("vtu", [&](benchmark::State& state) { vtu(state, store, file); })
        ->Unit(benchmark::kMillisecond)
        ->UseRealTime();
    benchmark::RunSpecifiedBenchmarks();
    std::error_code ignored;
    std::filesystem::remove(file, ignored);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "writer_benchmark: %s\n", error.what());
    return 1;
  }
}
