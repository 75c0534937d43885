// Files that several ranks write together, against those of one process.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <span>
#include <string>

#include "engine/exchange/thread_ranks.h"
#include "engine/formats/mesh_format.h"
#include "engine/formats/writer.h"
#include "storage/store.h"
#include "tests/file_bytes.h"

namespace locvol {

// `whole`: what the ranks' stores hold together; part(exchange): the store of one of three.
template <class PartOf>
void expect_files_of_one_process(const Store& whole, const PartOf& part,
                                 std::span<const OutputOptions> outputs,
                                 const std::filesystem::path& directory) {
  for (const OutputOptions& output : outputs) {
    SCOPED_TRACE(std::string(info_of(output.format).name) + " of order " +
                 std::to_string(output.order));
    const std::filesystem::path one = directory / "one.node", all = directory / "all.node";
    const WriteSummary written = write_mesh(whole, one, output, 1);
    run_as_ranks(3, [&](Exchange& exchange) {
      const WriteSummary by_rank =
          write_mesh(part(exchange), all, output, 2, {}, nullptr, exchange);
      EXPECT_EQ(by_rank.bytes, written.bytes);
    });
    const auto files = files_of(output, one), others = files_of(output, all);
    for (std::size_t i = 0; i < files.size(); ++i)
      EXPECT_TRUE(bytes_of(files[i]) == bytes_of(others[i])) << files[i];
  }
}

}  // namespace locvol
