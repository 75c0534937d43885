// What writing the mesh of a finished run costs in each format, from its store to files.
//
//   writer_benchmark STORE DIRECTORY [Google Benchmark's options]
//
// The files are written again and again, with one thread and with two, and removed.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>

#include "engine/formats/writer.h"
#include "engine/locvol.h"
#include "engine/shared/standard_streams.h"
#include "storage/store.h"

namespace locvol {
namespace {

// What the store holds comes from the page cache from the second time on; the files go to it.
void write(benchmark::State& state, const Store& store, const std::filesystem::path& file,
           const OutputOptions& options) {
  WriteSummary written;
  for (auto _ : state) written = write_mesh(store, file, options, static_cast<int>(state.range(0)));
  for (const auto& part : files_of(options, file)) {
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
  }
  const auto rate = [&](std::uint64_t count) {
    return benchmark::Counter(double(count), benchmark::Counter::kIsIterationInvariantRate);
  };
  state.counters["cells/s"] = rate(written.num_cells);
  state.counters["bytes/s"] = rate(written.bytes);
  state.counters["bytes"] = double(written.bytes);
}

void add_benchmark(const Store& store, const std::filesystem::path& directory,
                   const OutputOptions& options) {
  const std::string name =
      std::string(info_of(options.format).name) + (options.has_quality ? "+quality" : "");
  const std::filesystem::path file = directory / ("writer_benchmark-" + name);
  benchmark::RegisterBenchmark(
      name.c_str(),
      [&store, file, options](benchmark::State& state) { write(state, store, file, options); })
      ->ArgName("threads")
      ->Arg(1)
      ->Arg(2)
      ->Unit(benchmark::kMillisecond)
      ->MeasureProcessCPUTime()
      ->UseRealTime();
}

}  // namespace
}  // namespace locvol

int main(int argc, char** argv) {
  using namespace locvol;
  open_standard_streams();
  share_one_heap();
  benchmark::Initialize(&argc, argv);
  if (argc != 3 || !std::filesystem::is_directory(argv[2])) {
    std::fprintf(stderr, "usage: writer_benchmark STORE DIRECTORY [--benchmark_…]\n");
    return 2;
  }
  try {
    const Store store = Store::open(argv[1], {.read_only = true});
    for (const FormatInfo& info : mesh_formats()) {
      add_benchmark(store, argv[2], {info.format, false});
      if (info.has_cell_data) add_benchmark(store, argv[2], {info.format, true});
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "writer_benchmark: %s\n", error.what());
    return 1;
  }
}
